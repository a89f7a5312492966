"""Two calibrations side by side: against closed forms, a Monte Carlo run, and themselves."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.calibration.compare import compare_fits
from analysis.calibration.fit import fit_calibration
from protocol.base.errors import DataError


def line(level, slope, sd_level, sd_slope, span=(-3.0, 4.0)):
    """A straight line with independent coefficients, as `fit --json` writes it."""
    return {
        "coefficients": [level, slope],
        "std_errors": [sd_level, sd_slope],
        "covariance": [[sd_level**2, 0.0], [0.0, sd_slope**2]],
        "range": list(span),
    }


def test_two_lines_against_the_closed_form():
    """Between lines the difference and E_n are known; the coefficients are listed side by side."""
    found = compare_fits(line(1700.0, 40.0, 0.3, 0.1), line(1698.0, 39.0, 0.4, 0.2, (-2.0, 5.0)))
    assert (found.grid[0], found.grid[-1]) == (-2.0, 4.0)
    assert found.difference_mv == pytest.approx(2.0 + found.grid)
    expected = (2.0 + found.grid) / (2 * np.sqrt(0.25 + 0.05 * found.grid**2))
    assert found.e_n == pytest.approx(expected)
    assert found.difference_mm == pytest.approx((2.0 + found.grid) / 40.0)
    assert [(c.power, c.value, c.value_before) for c in found.coefficients] == [(0, 1700.0, 1698.0), (1, 40.0, 39.0)]
    assert found.agrees is False


@pytest.mark.parametrize(("apart", "agrees"), [(0.99, True), (1.01, False)])
def test_both_sides_of_the_border(apart, agrees):
    """A level apart by just less, or more, than its expanded uncertainty agrees, or does not."""
    u = 2 * np.hypot(0.3, 0.4)
    found = compare_fits(line(apart * u, 1.0, 0.3, 0.0), line(0.0, 1.0, 0.4, 0.0))
    assert found.agrees is agrees
    assert found.e_n[found.worst] == pytest.approx(apart)


def test_a_fit_agrees_with_itself():
    """The same run twice differs by nothing anywhere."""
    x = np.linspace(-3, 4, 18)
    fit = fit_calibration(x, 1650 + 40 * x - 2 * x**2 + np.random.default_rng(1).normal(0, 1, 18)).as_json()
    found = compare_fits(fit, fit)
    assert np.abs(found.difference_mv).max() == 0.0
    assert found.agrees is True


@pytest.mark.parametrize("pairs", [100, pytest.param(300, marks=pytest.mark.nightly)])
def test_repeated_runs_agree_as_often_as_they_should(pairs):
    """At one x, E_n of two runs of one truth is half a standard normal: |E_n| <= 1 in 95.4 % (t is wider a little)."""
    rng, x, inside = np.random.default_rng(4), np.linspace(-3, 4, 60), []
    for _ in range(pairs):
        fits = [fit_calibration(x, 1650 + 40 * x - 2 * x**2 + rng.normal(0, 1, x.size)).as_json() for _ in range(2)]
        inside.append(abs(compare_fits(*fits).e_n[80]) <= 1.0)
    assert 0.91 < np.mean(inside) < 0.985


def test_without_standard_errors_no_score_is_reported():
    """A fit through as many points as coefficients has no standard error: no score, but a difference."""
    bare = line(1700.0, 40.0, 0.3, 0.1) | {"covariance": [[None, None], [None, None]], "std_errors": [None, None]}
    found = compare_fits(line(1701.0, 40.0, 0.3, 0.1), bare)
    assert found.agrees is None
    assert found.difference_mv == pytest.approx(1.0)


def test_no_shared_range_is_refused():
    """Curves that never were calibrated at one place are not compared by extrapolation."""
    with pytest.raises(DataError, match="share no range"):
        compare_fits(line(0, 1, 1, 1, (-3.0, -1.0)), line(0, 1, 1, 1, (-1.0, 4.0)))
