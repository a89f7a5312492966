"""Small statistics against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal, stats

from analysis.statistics import (
    bootstrap_interval,
    effective_count,
    interpolate,
    limit_error,
    resampling_weights,
    standard_error,
    theil_sen,
    white_noise_sd,
)


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
        weights = resampling_weights(8, rng, 2_000)
        low, high = bootstrap_interval(float(values.mean()), weights @ values / 8, 8)
        ratios.append((high - low) / (2 * stats.t.ppf(0.975, 7) * values.std(ddof=1) / 8**0.5))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.1)
    assert np.isnan(bootstrap_interval(1.0, np.ones(10), 1)).all()


@pytest.mark.parametrize("phi", [0.0, 0.8])
def test_the_error_of_a_limit_is_that_of_other_chains(phi: float) -> None:
    """Of normal draws, independent or autoregressive: the rms distance from the true quantile, twice."""
    true, errors, stated = np.array([-1.0, 1.0]) * stats.norm.ppf(0.975), [], []
    for seed in range(60):
        noise = np.random.default_rng(seed).standard_normal(8_000)
        chain = signal.lfilter([np.sqrt(1.0 - phi**2)], [1.0, -phi], noise)
        errors.append(np.percentile(chain, [2.5, 97.5]) - true)
        stated.append(limit_error(chain[:, None]))
    # the worse of two limits, each known to 18 %
    assert 0.9 < np.mean(stated) / (2.0 * np.sqrt(np.mean(np.square(errors)))) < 1.4


def test_theil_sen_ignores_an_outlier() -> None:
    """A line with one outlier keeps its slope; two points have none."""
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
