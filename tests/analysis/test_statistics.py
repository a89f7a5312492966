"""Small statistics against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal, stats

from analysis import find_cycles, find_plateaus, fit_calibration, plateau_table
from analysis.calibration.checks import compare_degrees, lack_of_fit, leave_one_out, preferred_degree
from analysis.statistics import (
    bootstrap_interval,
    effective_count,
    interpolate,
    resampling_weights,
    standard_error,
    theil_sen,
    white_noise_sd,
)
from tests.analysis.boat_builder import PAPER, Staircase


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_effective_count_of_an_autoregression(phi: float) -> None:
    """AR(1): n (1 - phi) / (1 + phi), within 15 % over 20 series."""
    rng = np.random.default_rng(0)
    n = 4000
    found = [effective_count(signal.lfilter([1], [1, -phi], rng.standard_normal(n))) for _ in range(20)]
    assert np.mean(found) == pytest.approx(n * (1 - phi) / (1 + phi), rel=0.15)


def test_standard_error_of_white_noise_is_the_plain_one() -> None:
    """s / sqrt(n) within 10 %; NaN below two samples."""
    values = np.random.default_rng(1).standard_normal(5000)
    assert standard_error(values) == pytest.approx(values.std(ddof=1) / 5000**0.5, rel=0.1)
    assert np.isnan(standard_error(values[:1]))


def test_white_noise_is_seen_on_a_slow_signal() -> None:
    """Noise of 0.3 on a ramp and a sine is found within 5 %."""
    t = np.linspace(0, 20, 5000)
    noisy = 50 * np.sin(t) + 3 * t + 0.3 * np.random.default_rng(2).standard_normal(t.size)
    assert white_noise_sd(noisy) == pytest.approx(0.3, rel=0.05)


def test_the_expanded_percentile_interval_of_a_mean_is_students() -> None:
    """For a mean of 8 values its width is that of Student's interval within 10 %, on average."""
    rng = np.random.default_rng(3)
    ratios = []
    for _ in range(60):
        values = rng.standard_normal(8)
        weights = resampling_weights(8, rng)
        low, high = bootstrap_interval(float(values.mean()), weights @ values / 8, 8)
        ratios.append((high - low) / (2 * stats.t.ppf(0.975, 7) * values.std(ddof=1) / 8**0.5))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.1)
    assert np.isnan(bootstrap_interval(1.0, np.ones(10), 1)).all()


def test_theil_sen_ignores_an_outlier() -> None:
    """A line with one wild point keeps its slope; two points have none."""
    x = np.arange(9.0)
    y = 2.0 * x
    y[4] = 500.0
    assert theil_sen(x, y)[0] == pytest.approx(2.0)
    assert np.isnan(theil_sen(x[:2], y[:2])).all()


@given(st.lists(st.floats(-100, 100), min_size=2, max_size=20, unique=True))
def test_interpolation_never_extrapolates(points: list[float]) -> None:
    """NaN outside the span, the ordinate at the points themselves, in any order."""
    x = np.asarray(points)
    span = np.asarray([x.min() - 1, x.max() + 1])
    assert np.isnan(interpolate(span, x, 2 * x)).all()
    np.testing.assert_allclose(interpolate(x, x, 2 * x), 2 * x)


def test_degree_three_is_right_for_the_papers_cubic() -> None:
    """AICc and cross-validation choose 3 for the paper's cubic with its noise, and lack of fit finds a line lacking."""
    x = np.repeat(np.linspace(-2.7, 3.8, 10), 5)
    group = np.tile(np.arange(5), 10)
    y = np.polynomial.Polynomial(PAPER[0])(x) + 0.3 * np.random.default_rng(4).standard_normal(x.size)
    rows = compare_degrees(x, y, group)
    assert preferred_degree(rows) == 3
    best = min(rows, key=lambda row: row["prediction_rms"])
    assert best["degree"] in (3, 4)
    line, cubic = (lack_of_fit(fit_calibration(x, y, degree)) for degree in (1, 3))
    assert line is not None
    assert cubic is not None
    assert line["p"] < 1e-6 < cubic["p"]
    assert leave_one_out(x, y, group, 3)["prediction_rms"] == pytest.approx(0.3, rel=0.3)


def test_lack_of_fit_is_the_f_test_by_hand() -> None:
    """Two replicates at three x, a line: sums of squares computed on paper."""
    x = np.asarray([0.0, 0.0, 1.0, 1.0, 2.0, 2.0])
    y = np.asarray([0.0, 1.0, 2.0, 3.0, 0.0, 1.0])
    found = lack_of_fit(fit_calibration(x, y, 1))
    assert found is not None
    # means 0.5, 2.5, 0.5; line is 7/6 flat: SS_lack = 2 (4/9 + 16/9 + 4/9) = 16/3, SS_pure = 3/2
    assert found["f"] == pytest.approx((16 / 3 / 1) / (1.5 / 3))
    assert lack_of_fit(fit_calibration(np.arange(5.0), y[:5], 1)) is None


def test_the_table_of_plateaus_has_a_row_a_hold() -> None:
    """Sensors are numbered from 1 in its columns."""
    recording = Staircase(cycles=1).recording()
    table = plateau_table(find_plateaus(recording, find_cycles(recording)))
    assert len(table) == 21
    assert {"pressure_kpa", "s1_mv", "s2_se_mv", "void"} <= set(table.columns)
