"""Figures of a curve against values worked out by hand."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from analysis.calibration.adequacy import CurveVerdict
from analysis.calibration.fit import fit_calibration
from analysis.figures.curve_figures import (
    CurveDraws,
    curve_figures,
    full_scale,
    lack_of_fit,
    nonlinearity,
    resample_fit,
    sensitivities,
)
from analysis.figures.figure import Reason
from analysis.statistics import resampling_weights
from tests.analysis.boat_builder import PAPER
from tests.analysis.figures.by_hand import WEIGHTS


class Curve:
    """y = a + b x + c x^2, as a fitted curve."""

    def __init__(self, *coefficients: float) -> None:
        self.coefficients = np.array(coefficients)

    def predict(self, x: object) -> np.ndarray:
        return np.polynomial.polynomial.polyval(np.asarray(x, dtype=float), self.coefficients)

    def slope(self, x: object) -> np.ndarray:
        return np.polynomial.polynomial.polyval(np.asarray(x, dtype=float), self.coefficients[1:] * [1.0, 2.0])

    def rows(self, x: object) -> np.ndarray:
        return np.vander(np.atleast_1d(np.asarray(x, dtype=float)), 3, increasing=True)

    def slope_rows(self, x: object) -> np.ndarray:
        at = np.atleast_1d(np.asarray(x, dtype=float))
        return np.column_stack([0.0 * at, 1.0 + 0.0 * at, 2.0 * at])


def draws(*, dof: float = 10.0, ends: tuple[float, float] = (-2.0, 4.0), size: int = 4000) -> CurveDraws:
    """Return draws about y = 5 - 30 x + x^2 on -2 to 4, whose slope b alone scatters, by 0.5."""
    b = -30.0 + 0.5 * stats.norm.ppf((np.arange(size) + 0.5) / size)
    coefficients = np.column_stack([np.full(size, 5.0), b, np.ones(size)])
    x = np.linspace(*ends, 13)
    return CurveDraws(Curve(5.0, -30.0, 1.0), x, ends, coefficients, np.tile(ends, (size, 1)), 3, dof)


def test_sensitivities_of_a_parabola() -> None:
    """y = 5 - 30 x + x^2 over -2 to 4: ends at 69 and -99; at rest -30; the secant's slope is b + c (low + high)."""
    found = sensitivities(draws())
    assert found["sensitivity_mv_per_mm"].value == pytest.approx(28.0)
    assert found["slope_at_rest_mv_per_mm"].value == pytest.approx(-30.0)
    assert found["least_squares_slope_mv_per_mm"].value == pytest.approx(-28.0)
    half = 0.5 * stats.norm.ppf(0.975) * stats.t.ppf(0.975, 10) / stats.norm.ppf(0.975)
    for figure in found.values():
        assert (figure.value - figure.low, figure.high - figure.value) == pytest.approx((half, half), rel=0.02)
    assert full_scale(draws()).value == pytest.approx(168.0)
    assert full_scale(draws()).high == pytest.approx(168.0 + 6.0 * half, rel=1e-3)


@pytest.mark.parametrize(("ends", "inside"), [((0.0, 4.0), True), ((-2.0, 0.0), True), ((0.5, 4.0), False)])
def test_slope_at_rest_needs_rest_in_the_range(ends: tuple[float, float], inside: bool) -> None:
    """The ends of the range are in it."""
    found = sensitivities(draws(ends=ends))["slope_at_rest_mv_per_mm"]
    assert (found.reason is Reason.REST_OUTSIDE_RANGE) is not inside


def test_nonlinearity_of_a_parabola() -> None:
    """x^2 on -2 to 4 is largest off its line at an end: (9 - mean of (x - 1)^2) / 168 in %, by the points' own mean."""
    found = nonlinearity(draws())
    x = np.linspace(-2.0, 4.0, 13)
    assert found.value == pytest.approx(100.0 * (9.0 - np.mean((x - 1.0) ** 2)) / 168.0)
    spread = 100.0 * (9.0 - np.mean((x - 1.0) ** 2)) / (168.0 - 6.0 * 0.5 * stats.t.ppf(0.975, 10))
    assert found.high == pytest.approx(spread, rel=0.002)
    assert found.low < found.value < found.high


def test_interval_of_a_curve_s_figure_mirrors_its_draws() -> None:
    """What the draws are above the value, the truth is below it; either way takes the wider; never below zero."""
    curves = draws(dof=10.0)
    skewed = 10.0 + np.linspace(-1.0, 3.0, 1001)
    widen = stats.t.ppf(0.975, 10) / stats.norm.ppf(0.975)
    one = curves.figure(10.0, skewed, "mV/mm", "d")
    assert (one.low, one.high) == pytest.approx((10.0 - widen * 2.9, 10.0 + widen * 0.9))
    both = curves.figure(10.0, skewed, "mV/mm", "d", either_way=True)
    assert (both.low, both.high) == pytest.approx((10.0 - widen * 2.9, 10.0 + widen * 2.9))
    assert curves.figure(1.0, skewed - 9.0, "mV", "d").low == 0.0
    aside = curves.figure(10.0, skewed + 5.0, "mV/mm", "d")  # all draws above: the value is the upper end
    assert aside.high == 10.0
    assert curves.figure(10.0, skewed - 5.0, "mV/mm", "d").low == 10.0


def test_curve_figures_hold_those_of_the_curve_it_may_deviate_from() -> None:
    """The wider end of either interval, with the verdict in note and reason."""
    one, other = draws(), draws(dof=2.0)
    alone, both = curve_figures(one), curve_figures(one, other, verdict=str(CurveVerdict.DOUBTFUL))
    wide = curve_figures(other)
    for key, figure in both.items():
        assert figure.value == alone[key].value
        assert (figure.low, figure.high) == (
            min(alone[key].low, wide[key].low),
            max(alone[key].high, wide[key].high),
        )
        assert figure.reason is Reason.DOUBTFUL
    assert set(both) == set(alone)


def test_lack_of_fit_is_that_of_the_adequacy() -> None:
    """The remainder in %, with its limits and the verdict; without one, or without a test, the reason."""
    given = {"verdict": CurveVerdict.INADEQUATE, "sentence": "it bends", "remainder_percent": 2.5}
    found = lack_of_fit(SimpleNamespace(**given, limits_percent=(1.0, 3.0)), 37)
    assert (found.value, found.low, found.high, found.n, found.reason) == (2.5, 1.0, 3.0, 37, Reason.INADEQUATE)
    untested = lack_of_fit(SimpleNamespace(**given | {"remainder_percent": np.nan}), 37)
    assert untested.void == "no position is left to test the curve by"
    assert found.note == "inadequate: it bends"
    assert lack_of_fit(None, 37).reason is Reason.FEW_POSITIONS


def test_curve_of_no_span_has_no_nonlinearity() -> None:
    """A share of nothing."""
    level = CurveDraws(Curve(5.0, 0.0, 0.0), np.arange(3.0), (0.0, 2.0), np.zeros((4, 3)), np.zeros((4, 2)), 3, 9.0)
    assert nonlinearity(level).reason is Reason.NO_FULL_SCALE


def test_resample_is_the_fit_to_the_cycles_that_were_drawn() -> None:
    """A cycle drawn twice counts twice; the range is that of the cycles drawn."""
    rng = np.random.default_rng(4)
    cycle = np.repeat(np.arange(3), 7)
    x = np.tile(np.linspace(-2.0, 4.0, 7), 3) + 0.01 * cycle
    fit = fit_calibration(x, 5.0 - 30.0 * x + x**2 + rng.standard_normal(21), 2)
    found, at = resample_fit(fit, cycle, WEIGHTS), np.linspace(-2.0, 4.0, 5)
    for row, weights in enumerate(WEIGHTS):
        polynomial = np.polyfit(x, fit.y, 2, w=np.sqrt(weights[cycle]))
        assert found.values(at)[row] == pytest.approx(np.polyval(polynomial, at), abs=1e-8)
        drawn = x[weights[cycle] > 0]
        assert found.ends[row] == pytest.approx([drawn.min(), drawn.max()])
        assert found.spans()[row] == pytest.approx(np.subtract(*np.polyval(polynomial, [drawn.max(), drawn.min()])))
    assert (found.n_cycles, found.x_range) == (3, fit.x_range)
    assert math.isnan(found.dof)


def test_the_reading_error_is_in_the_intervals_of_the_curve(tmp_path: Path) -> None:
    """Readings misread alike in every cycle: over 40 grids the sensitivity's interval holds the truth 36 times or more.

    The cycles agree with one another, so that without the reading error the interval would hold it hardly ever.
    """
    rng, inside = np.random.default_rng(5), []
    levels, truth = np.linspace(-2.7, 3.8, 10), np.polynomial.Polynomial(PAPER[0])
    weights = resampling_weights(5, rng, 500)
    for _ in range(40):
        read = levels + 0.1 * rng.standard_normal(10)
        x, cycle = np.tile(read, 5), np.repeat(np.arange(5.0), 10)
        fit = fit_calibration(x, truth(np.tile(levels, 5)) + 0.05 * rng.standard_normal(50))
        both = [resample_fit(fit.with_reading(sd), cycle, weights, rng) for sd in (0.0, 0.1)]
        figures = [sensitivities(one)["sensitivity_mv_per_mm"] for one in both]
        low, high = fit.x_range
        inside.append([f.low <= (truth(high) - truth(low)) / (high - low) <= f.high for f in figures])
    without, with_reading = np.sum(np.asarray(inside), axis=0)
    assert with_reading >= 36
    assert without <= 8
