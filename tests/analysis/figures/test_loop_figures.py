"""Figures of loops against values worked out by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from analysis.calibration.joint_fit import LoopEstimate
from analysis.figures.figure import Figure, Reason
from analysis.figures.loop_figures import (
    hysteresis,
    joint_hysteresis,
    limited,
    loop_made_by_noise,
    pressure_full_scale,
    pressure_nonlinearity,
    sensor_loop_width,
    with_what_lies_between,
)
from analysis.segmentation.loops import LoopWidth
from analysis.statistics import bootstrap_interval
from tests.analysis.figures.by_hand import WEIGHTS, loops_of


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


def width(mean: float = 5.0, shared: float = 1.0, void: str = "") -> LoopWidth:
    """Return a loop of 5 mV with replicates from 4.5 to 5.5."""
    flat = np.zeros(3)
    return LoopWidth(np.full(3, mean), mean, np.linspace(0.9 * mean, 1.1 * mean, 201), flat, flat, flat, void, shared)


@pytest.mark.parametrize(("shared", "reason"), [(1.0, Reason.NONE), (0.85, Reason.NONE), (0.84, Reason.PART_OF_RANGE)])
def test_hysteresis_is_a_share_of_full_scale(shared: float, reason: Reason) -> None:
    """5 of 200 mV are 2.5 %; of branches that share less than 85 % of the abscissa a wider loop may be missed."""
    found = hysteresis(width(shared=shared), 200.0, 5, "d")
    assert (found.value, found.reason) == (pytest.approx(2.5), reason)
    factor = math.exp(stats.t.ppf(0.975, 4) / stats.norm.ppf(0.975) * math.sqrt(1.25) * math.log(1.095))
    assert found.high == pytest.approx(2.5 * factor, rel=1e-3)
    assert hysteresis(width(), 0.0, 5, "d").reason is Reason.NO_FULL_SCALE
    assert hysteresis(width(void="apart"), 200.0, 5, "d").void == "apart"


def test_joint_hysteresis_is_the_estimate_s() -> None:
    """3 (2 to 5) of 200 mV: 1.5 % (1 to 2.5 %); the share of the abscissa stays named."""
    estimate = LoopEstimate(3.0, 2.0, 5.0)
    found = joint_hysteresis(estimate, width(), 200.0, 5)
    assert (found.value, found.low, found.high, found.n) == (1.5, 1.0, 2.5, 5)
    assert (found.note, found.reason) == ("", Reason.NONE)
    part = joint_hysteresis(estimate, width(shared=0.5), 200.0, 5)
    assert (part.value, part.reason) == (1.5, Reason.PART_OF_RANGE)
    assert "50 %" in part.note
    one = joint_hysteresis(estimate, width(), 200.0, 1)
    assert (one.reason, one.note) == (Reason.NONE, "")
    assert joint_hysteresis(estimate, width(), 0.0, 5).reason is Reason.NO_FULL_SCALE
    assert joint_hysteresis(estimate, width(), 0.5, 5).value == 600.0


def test_joint_hysteresis_holds_what_lies_at_and_between_the_readings() -> None:
    """Of 200 mV: 1.5 % where 1.1 % was read adds 0.4 % below in squares; a bound of 2 % between adds 0.5 % above."""
    found = joint_hysteresis(LoopEstimate(3.0, 2.4, 5.0, at_levels=2.2, between=4.0), width(), 200.0, 5)
    assert found.low == pytest.approx(1.5 - math.hypot(0.3, 0.4))
    assert found.high == pytest.approx(2.5 + 0.5)
    for low, expected in ((0.2, 0.0), (0.0, 0.0)):
        assert joint_hysteresis(LoopEstimate(3.0, low, 5.0, at_levels=0.0), width(), 200.0, 5).low == expected
    assert joint_hysteresis(LoopEstimate(3.0, -0.1, 5.0), width(), 200.0, 5).low == 0.0


def test_hysteresis_over_pressure_holds_what_lies_between_levels() -> None:
    """Branches 0, 3, 3, 0 mV apart at 0, 10, 20, 30 kPa: a concave loop may be 4.5 mV between, 2.25 % of 200 mV."""
    level, apart = np.array([0.0, 10.0, 20.0, 30.0]), np.array([0.0, 3.0, 3.0, 0.0])
    common = np.array([[5.0], [7.0], [9.0]]) + np.array([0.0, 50.0, 90.0, 99.0])
    branches = np.stack([common, common + apart + np.array([[-1.0], [0.0], [1.0]])])
    figure = Figure(1.5, "% FSO", 3, 1.2, 1.8)
    assert with_what_lies_between(figure, level, branches, 200.0).high == pytest.approx(1.8 + 2.25 - 1.5)
    assert with_what_lies_between(figure, level, branches, 200.0, 0.5).high == pytest.approx(1.8 + 2.25 - 0.5 - 1.5)
    assert with_what_lies_between(figure, level, branches, 200.0, 2.0).high == 1.8
    branches[0, 0, 1] = branches[1, 2, 1] = np.nan  # of this level the second cycle alone has both branches
    branches[0, :, 3] = np.nan  # of this none: it does not count, and the last line goes on
    of_one = with_what_lies_between(figure, level[:3], branches[:, :, :3], 200.0).high
    assert with_what_lies_between(figure, level, branches, 200.0).high == pytest.approx(of_one)
    assert of_one == pytest.approx(1.8 + 3.0 - 1.5, rel=0.05)  # 6 mV, where the first line goes on to the last level
    for same, full_scale in ((figure, 0.0), (Figure.nothing("% FSO", Reason.NO_CYCLE, "none"), 200.0)):
        assert with_what_lies_between(same, level, branches, full_scale) is same
    assert with_what_lies_between(figure, level, np.stack([common, common + apart]), 0.5).high == pytest.approx(900.3)


def test_noise_makes_a_loop_of_its_own() -> None:
    """The greatest of m differences of two means of 4 cycles: u sqrt(2 / 4) sqrt(2 ln 2m)."""
    loops = SimpleNamespace(n_cycles=4, level_kpa=np.arange(10.0))
    greatest = math.sqrt(0.5) * math.sqrt(2.0 * math.log(20.0))
    plateaus = [SimpleNamespace(signal_se_mv=(se,), branch="loading", void="") for se in (0.1, 0.3, 0.9)]
    plateaus += [SimpleNamespace(signal_se_mv=(9.0,), branch=b, void=v) for b, v in (("", ""), ("loading", "damaged"))]
    assert loop_made_by_noise(plateaus, loops, None, 0, 2.0) == pytest.approx(0.3 * greatest)
    cycles = SimpleNamespace(used=[SimpleNamespace(first=100, last=100 + n) for n in (400, 600)])
    assert loop_made_by_noise((), loops, cycles, 0, 2.0) == pytest.approx(2.0 / 5.0 * greatest)
    few = SimpleNamespace(used=[SimpleNamespace(first=0, last=10)])
    assert loop_made_by_noise((), loops, few, 0, 2.0) == pytest.approx(2.0 * greatest)
    one = SimpleNamespace(n_cycles=1, level_kpa=np.zeros(1))
    assert loop_made_by_noise((), one, few, 0, 2.0) == pytest.approx(
        2.0 / math.sqrt(5.0) * math.sqrt(2.0) * math.sqrt(2.0 * math.log(4.0))
    )
    assert loop_made_by_noise((), loops, few, 0, math.nan) == 0.0
    assert loop_made_by_noise((), SimpleNamespace(n_cycles=0, level_kpa=np.zeros(2)), few, 0, 2.0) == 0.0
    unknown = [SimpleNamespace(signal_se_mv=(math.nan,), branch="loading", void="")]
    assert loop_made_by_noise(unknown, loops, None, 0, 2.0) == 0.0


@pytest.mark.parametrize(("floor", "bound"), [(0.5, False), (0.51, True)])
def test_hysteresis_of_which_a_quarter_is_noise_is_an_upper_bound(floor: float, bound: bool) -> None:
    """2 % with 0.5 % of noise: no bound yet; the interval reaches down by the floor, not below zero."""
    found = limited(Figure(2.0, "% FSO", 5, 1.9, 2.2, note="n"), floor, "noise")
    assert found.low == pytest.approx(2.0 - floor)
    assert (found.reason is Reason.UPPER_BOUND, found.note.startswith("only an upper bound: noise")) == (bound, bound)
    assert found.note.endswith("n")
    assert limited(Figure(2.0, "% FSO", 5, 1.0, 2.2), floor, "noise").low == 1.0
    whole = limited(Figure(2.0, "% FSO", 5, 1.0, 2.2), 3.0, "noise")
    assert (whole.low, whole.note.endswith("for up to all of it")) == (0.0, True)  # not "3 % FSO of it"


def test_pressure_figures_of_a_parabola() -> None:
    """0, 60, 150 mV at -40, 0, 40 kPa: span 150, off its line by 10 mV in the middle: 6.67 %."""
    signal = np.broadcast_to(np.array([0.0, 60.0, 150.0]), (2, 3, 3)) + np.array([-1.0, 1.0])[:, None, None]
    lifted = signal + 1000.0 + np.array([0.0, 1.0, 5.0])[:, None] * [1.0, 1.0, 1.0]  # a lift of all levels is no span
    assert pressure_full_scale(loops_of(lifted), 0, WEIGHTS).high == pytest.approx(150.0)
    span = pressure_full_scale(loops_of(signal), 0, WEIGHTS)
    assert (span.value, span.low, span.high) == pytest.approx((150.0, 150.0, 150.0))
    found = pressure_nonlinearity(loops_of(signal), 0, 150.0, WEIGHTS)
    assert (found.value, found.high) == pytest.approx((100.0 * 10.0 / 150.0,) * 2)
    lift = np.array([-5.0, 0.0, 5.0])  # of the middle level: each mV is two thirds of a mV from the line
    other = pressure_nonlinearity(loops_of(signal + lift[:, None] * [0.0, 1.0, 0.0]), 0, 150.0, WEIGHTS)
    drawn = 100.0 / 150.0 * np.abs(-10.0 + 2.0 / 3.0 * WEIGHTS @ lift / 3.0)
    assert (other.low, other.high) == pytest.approx(bootstrap_interval(found.value, drawn, 3, positive=True))
    again = pressure_nonlinearity(loops_of(signal + lift[:, None] * [0.0, 1.0, 0.0]), 0, 150.0, WEIGHTS[1:])
    assert again.value == pytest.approx(found.value)
    unknown = np.concatenate([signal, np.full((2, 3, 1), np.nan)], axis=2)
    assert pressure_nonlinearity(loops_of(unknown), 0, 150.0, WEIGHTS).value == pytest.approx(found.value)
    assert pressure_nonlinearity(loops_of(np.zeros((2, 0, 3))), 0, 150.0, np.zeros((4, 0))).reason is Reason.NO_CYCLE
    alone = pressure_nonlinearity(loops_of(signal[:, :1]), 0, 150.0, np.ones((4, 1)))
    assert (alone.value, alone.reason) == (pytest.approx(found.value), Reason.ONE_CYCLE)
    assert pressure_nonlinearity(loops_of(signal), 0, 0.0, WEIGHTS).void
    assert pressure_nonlinearity(loops_of(signal[:, :, :2]), 0, 150.0, WEIGHTS).reason is Reason.NO_CYCLE
    no_cycle = loops_of(np.zeros((2, 0, 3)))
    assert pressure_full_scale(no_cycle, 0, np.zeros((4, 0))).reason is Reason.NO_CYCLE


def test_loop_of_a_curved_sensor_is_what_its_curve_leaves() -> None:
    """Branches at other elongations, 1 mV above and 2 mV below one parabola: 3 mV apart, whatever its curvature."""
    x = np.broadcast_to(np.linspace(-2.0, 4.0, 7), (2, 3, 7)) + np.array([0.0, 0.4])[:, None, None]
    curve = Curve(5.0, -30.0, 4.0)
    signal = curve.predict(x) + np.array([1.0, -2.0])[:, None, None]
    loops = SimpleNamespace(one_branch=(), elongation_mm=x, signal_mv=signal[None])
    assert sensor_loop_width(loops, 0, curve, WEIGHTS).mean_loop == pytest.approx(3.0)
    assert sensor_loop_width(loops, 0, None, WEIGHTS).mean_loop != pytest.approx(3.0, abs=0.01)
    np.testing.assert_array_equal(loops.signal_mv[0], signal)
