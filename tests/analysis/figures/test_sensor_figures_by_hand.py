"""Figures of a sensor against values worked out by hand, one definition at a time."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from analysis.calibration.adequacy import CurveVerdict
from analysis.calibration.fit import fit_calibration
from analysis.calibration.joint_fit import LoopEstimate
from analysis.figures import sensor_figures as metrics
from analysis.figures.figure import Figure, Reason
from analysis.figures.sensor_figures import CurveDraws
from analysis.segmentation.loops import LoopWidth
from analysis.statistics import bootstrap_interval

WEIGHTS = np.array([[1.0, 1.0, 1.0], [3.0, 0.0, 0.0], [0.0, 2.0, 1.0], [1.0, 0.0, 2.0]])


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
    found = metrics.sensitivities(draws())
    assert found["sensitivity_mv_per_mm"].value == pytest.approx(28.0)
    assert found["slope_at_rest_mv_per_mm"].value == pytest.approx(-30.0)
    assert found["least_squares_slope_mv_per_mm"].value == pytest.approx(-28.0)
    half = 0.5 * stats.norm.ppf(0.975) * stats.t.ppf(0.975, 10) / stats.norm.ppf(0.975)
    for figure in found.values():
        assert (figure.value - figure.low, figure.high - figure.value) == pytest.approx((half, half), rel=0.02)
    assert metrics.full_scale(draws()).value == pytest.approx(168.0)
    assert metrics.full_scale(draws()).high == pytest.approx(168.0 + 6.0 * half, rel=1e-3)


@pytest.mark.parametrize(("ends", "inside"), [((0.0, 4.0), True), ((-2.0, 0.0), True), ((0.5, 4.0), False)])
def test_slope_at_rest_needs_rest_in_the_range(ends: tuple[float, float], inside: bool) -> None:
    """The ends of the range are in it."""
    found = metrics.sensitivities(draws(ends=ends))["slope_at_rest_mv_per_mm"]
    assert (found.reason is Reason.REST_OUTSIDE_RANGE) is not inside


def test_nonlinearity_of_a_parabola() -> None:
    """x^2 on -2 to 4 is largest off its line at an end: (9 - mean of (x - 1)^2) / 168 in %, by the points' own mean."""
    found = metrics.nonlinearity(draws())
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
    alone, both = metrics.curve_figures(one), metrics.curve_figures(one, other, verdict=str(CurveVerdict.DOUBTFUL))
    wide = metrics.curve_figures(other)
    for key, figure in both.items():
        assert figure.value == alone[key].value
        assert (figure.low, figure.high) == (
            min(alone[key].low, wide[key].low),
            max(alone[key].high, wide[key].high),
        )
        assert figure.reason is Reason.DOUBTFUL
    assert set(both) == set(alone)


def width(mean: float = 5.0, shared: float = 1.0, void: str = "") -> LoopWidth:
    """Return a loop of 5 mV with replicates from 4.5 to 5.5."""
    flat = np.zeros(3)
    return LoopWidth(np.full(3, mean), mean, np.linspace(0.9 * mean, 1.1 * mean, 201), flat, flat, flat, void, shared)


@pytest.mark.parametrize(("shared", "reason"), [(1.0, Reason.NONE), (0.85, Reason.NONE), (0.84, Reason.PART_OF_RANGE)])
def test_hysteresis_is_a_share_of_full_scale(shared: float, reason: Reason) -> None:
    """5 of 200 mV are 2.5 %; of branches that share less than 85 % of the abscissa a wider loop may be missed."""
    found = metrics.hysteresis(width(shared=shared), 200.0, 5, "d")
    assert (found.value, found.reason) == (pytest.approx(2.5), reason)
    factor = math.exp(stats.t.ppf(0.975, 4) / stats.norm.ppf(0.975) * math.sqrt(1.25) * math.log(1.095))
    assert found.high == pytest.approx(2.5 * factor, rel=1e-3)
    assert metrics.hysteresis(width(), 0.0, 5, "d").reason is Reason.NO_FULL_SCALE
    assert metrics.hysteresis(width(void="apart"), 200.0, 5, "d").void == "apart"


def test_joint_hysteresis_is_the_estimate_s() -> None:
    """3 (2 to 5) of 200 mV: 1.5 % (1 to 2.5 %); the share of the abscissa stays named."""
    estimate = LoopEstimate(3.0, 2.0, 5.0)
    found = metrics.joint_hysteresis(estimate, width(), 200.0, 5)
    assert (found.value, found.low, found.high, found.n) == (1.5, 1.0, 2.5, 5)
    assert (found.note, found.reason) == ("", Reason.NONE)
    part = metrics.joint_hysteresis(estimate, width(shared=0.5), 200.0, 5)
    assert (part.value, part.reason) == (1.5, Reason.PART_OF_RANGE)
    assert "50 %" in part.note
    one = metrics.joint_hysteresis(estimate, width(), 200.0, 1)
    assert (one.reason, one.note) == (Reason.NONE, "")
    assert metrics.joint_hysteresis(estimate, width(), 0.0, 5).reason is Reason.NO_FULL_SCALE


def test_noise_makes_a_loop_of_its_own() -> None:
    """The greatest of m differences of two means of 4 cycles: u sqrt(2 / 4) sqrt(2 ln 2m)."""
    loops = SimpleNamespace(n_cycles=4, level_kpa=np.arange(10.0))
    greatest = math.sqrt(0.5) * math.sqrt(2.0 * math.log(20.0))
    plateaus = [SimpleNamespace(signal_se_mv=(se,), branch="loading", void="") for se in (0.1, 0.3, 0.9)]
    plateaus += [SimpleNamespace(signal_se_mv=(9.0,), branch=b, void=v) for b, v in (("", ""), ("loading", "damaged"))]
    assert metrics.loop_made_by_noise(plateaus, loops, None, 0, 2.0) == pytest.approx(0.3 * greatest)
    cycles = SimpleNamespace(used=[SimpleNamespace(first=100, last=100 + n) for n in (400, 600)])
    assert metrics.loop_made_by_noise((), loops, cycles, 0, 2.0) == pytest.approx(2.0 / 5.0 * greatest)
    few = SimpleNamespace(used=[SimpleNamespace(first=0, last=10)])
    assert metrics.loop_made_by_noise((), loops, few, 0, 2.0) == pytest.approx(2.0 * greatest)
    one = SimpleNamespace(n_cycles=1, level_kpa=np.zeros(1))
    assert metrics.loop_made_by_noise((), one, few, 0, 2.0) == pytest.approx(
        2.0 / math.sqrt(5.0) * math.sqrt(2.0) * math.sqrt(2.0 * math.log(4.0))
    )
    assert metrics.loop_made_by_noise((), loops, few, 0, math.nan) == 0.0
    assert metrics.loop_made_by_noise((), SimpleNamespace(n_cycles=0, level_kpa=np.zeros(2)), few, 0, 2.0) == 0.0
    unknown = [SimpleNamespace(signal_se_mv=(math.nan,), branch="loading", void="")]
    assert metrics.loop_made_by_noise(unknown, loops, None, 0, 2.0) == 0.0


@pytest.mark.parametrize(("floor", "bound"), [(0.5, False), (0.51, True)])
def test_hysteresis_of_which_a_quarter_is_noise_is_an_upper_bound(floor: float, bound: bool) -> None:
    """2 % with 0.5 % of noise: no bound yet; the interval reaches down by the floor, not below zero."""
    found = metrics.limited(Figure(2.0, "% FSO", 5, 1.9, 2.2, note="n"), floor, "noise")
    assert found.low == pytest.approx(2.0 - floor)
    assert (found.reason is Reason.UPPER_BOUND, found.note.startswith("only an upper bound: noise")) == (bound, bound)
    assert found.note.endswith("n")
    assert metrics.limited(Figure(2.0, "% FSO", 5, 1.0, 2.2), floor, "noise").low == 1.0
    assert metrics.limited(Figure(2.0, "% FSO", 5, 1.0, 2.2), 3.0, "noise").low == 0.0


def loops_of(signal: np.ndarray, **more: object) -> SimpleNamespace:
    """Return loops of signals [2, cycles, levels] at pressures -40, 0, 40 and so on."""
    pressure = -40.0 + 40.0 * np.arange(signal.shape[2])
    known = {
        "own": np.ones(signal.shape, bool), "signal_mv": signal[None], "n_cycles": signal.shape[1],
        "numbers": tuple(range(1, signal.shape[1] + 1)), "level_kpa": pressure, "binned": False,
        "pressure_kpa": np.broadcast_to(pressure, signal.shape), "ends_kpa": (pressure[0], pressure[-1]),
    }  # fmt: skip
    return SimpleNamespace(**{**known, **more})


def test_drift_is_the_slope_of_all_levels_over_the_cycles() -> None:
    """0.3 mV a cycle of 150 mV are 20 % in 100 cycles; a cycle's number counts, not its place."""
    base = np.broadcast_to(np.array([0.0, 60.0, 150.0]), (2, 4, 3))
    signal = base + 0.3 * np.array([1.0, 2.0, 3.0, 6.0])[None, :, None]
    found = metrics.drift(loops_of(signal, numbers=(1, 2, 3, 6)), 0, 150.0)
    assert (found.value, found.low, found.high) == pytest.approx((20.0, 20.0, 20.0))
    hidden = np.ones(signal.shape, bool)
    hidden[0, 1, 2] = False
    signal[0, 1, 2] = 1e6
    assert metrics.drift(loops_of(signal, numbers=(1, 2, 3, 6), own=hidden), 0, 150.0).value == pytest.approx(20.0)
    assert metrics.drift(loops_of(signal[:, :2]), 0, 150.0).reason is Reason.FEW_CYCLES
    assert metrics.drift(loops_of(base[:, :3]), 0, 150.0).value == pytest.approx(0.0, abs=1e-9)
    assert metrics.drift(loops_of(signal), 0, 0.0).reason is Reason.NO_FULL_SCALE
    assert metrics.drift(loops_of(base + 0.001 * np.arange(4.0)[:, None]), 0, 0.5).value == pytest.approx(20.0)
    nowhere = loops_of(signal, own=np.zeros(signal.shape, bool))
    assert metrics.drift(nowhere, 0, 150.0).reason is Reason.NO_COMMON_LEVEL


def test_repeatability_by_hand() -> None:
    """Cycles at -1, 0, 1 and at -2, 0, 2 mV about two levels: sd 1 and 2, pooled sqrt(2.5), of 50 mV."""
    signal = np.zeros((2, 3, 2))
    signal[:, :, 0], signal[:, :, 1] = [-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0]
    found = metrics.repeatability(loops_of(100.0 + signal), 0, 50.0, WEIGHTS)
    assert found["repeatability_percent_fso"].value == pytest.approx(2.0 * math.sqrt(2.5))
    assert found["repeatability_worst_percent_fso"].value == pytest.approx(4.0)
    signal[1, 1:, 1] = np.nan  # one cycle is left there: it has no sd
    signal[1, 2, 0] = np.nan  # two: (-1, 0), variance 1/2 with one degree of freedom
    part = metrics.repeatability(loops_of(100.0 + signal), 0, 50.0, WEIGHTS)
    assert part["repeatability_percent_fso"].value == pytest.approx(2.0 * math.sqrt((2 + 8 + 0.5) / 5))
    for cycles, full_scale, reason in ((1, 50.0, Reason.FEW_CYCLES), (3, 0.0, Reason.NO_FULL_SCALE)):
        none = metrics.repeatability(loops_of(signal[:, :cycles]), 0, full_scale, WEIGHTS[:, :cycles])
        assert {figure.reason for figure in none.values()} == {reason}


def test_pooled_and_worst_of_resamples() -> None:
    """A cycle drawn twice counts twice; one cycle alone has no sd."""
    series = np.array([[0.0, 0.0], [1.0, 2.0], [5.0, 4.0]])
    pooled, worst = metrics._pooled_and_worst(series, WEIGHTS)
    for row, picked in enumerate(([0, 1, 2], None, [1, 1, 2], [0, 2, 2])):
        if picked is None:
            assert (np.isnan(pooled[row]), worst[row]) == (True, 0.0)
            continue
        variance = series[picked].var(axis=0, ddof=1)
        assert (pooled[row], worst[row]) == pytest.approx((np.sqrt(variance.mean()), np.sqrt(variance.max())))


def test_pressure_figures_of_a_parabola() -> None:
    """0, 60, 150 mV at -40, 0, 40 kPa: span 150, off its line by 10 mV in the middle: 6.67 %."""
    signal = np.broadcast_to(np.array([0.0, 60.0, 150.0]), (2, 3, 3)) + np.array([-1.0, 1.0])[:, None, None]
    lifted = signal + 1000.0 + np.array([0.0, 1.0, 5.0])[:, None] * [1.0, 1.0, 1.0]  # a lift of all levels is no span
    assert metrics.pressure_full_scale(loops_of(lifted), 0, WEIGHTS).high == pytest.approx(150.0)
    span = metrics.pressure_full_scale(loops_of(signal), 0, WEIGHTS)
    assert (span.value, span.low, span.high) == pytest.approx((150.0, 150.0, 150.0))
    found = metrics.pressure_nonlinearity(loops_of(signal), 0, 150.0, WEIGHTS)
    assert (found.value, found.high) == pytest.approx((100.0 * 10.0 / 150.0,) * 2)
    other = signal + np.array([0.0, -5.0, 5.0])[:, None] * [0.0, 1.0, 0.0]
    assert metrics.pressure_nonlinearity(loops_of(other), 0, 150.0, WEIGHTS[1:]).value == pytest.approx(found.value)
    alone = metrics.pressure_nonlinearity(loops_of(signal[:, :1]), 0, 150.0, np.ones((4, 1)))
    assert (alone.value, alone.reason) == (pytest.approx(found.value), Reason.ONE_CYCLE)
    assert metrics.pressure_nonlinearity(loops_of(signal), 0, 0.0, WEIGHTS).void
    assert metrics.pressure_nonlinearity(loops_of(signal[:, :, :2]), 0, 150.0, WEIGHTS).reason is Reason.NO_CYCLE
    no_cycle = loops_of(np.zeros((2, 0, 3)))
    assert metrics.pressure_full_scale(no_cycle, 0, np.zeros((4, 0))).reason is Reason.NO_CYCLE


def noise_parts(*squares: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return parts of three cycles with 50 degrees of freedom each."""
    return np.array(squares), np.full(3, 50.0), np.array([1.0, 2.0, 3.0])


def test_noise_that_agrees_by_chance_has_the_interval_of_its_samples() -> None:
    """Three cycles of the very same noise: 1.96 / sqrt(2 * 150) of it, and 20 log10 of one more that share, in dB."""
    noise, snr = metrics.noise_and_snr(noise_parts(50.0, 50.0, 50.0), (1, 2, 3), 100.0, WEIGHTS)
    least = 1.96 / math.sqrt(300.0)
    assert (noise.value, noise.low, noise.high) == pytest.approx((1.0, 1.0 - least, 1.0 + least))
    reach = 20.0 * math.log10(1.0 + least)
    assert (snr.value, snr.low, snr.high) == pytest.approx((40.0, 40.0 - reach, 40.0 + reach))
    assert metrics.noise_and_snr(noise_parts(0.0, 0.0, 0.0), (1, 2, 3), 100.0, WEIGHTS)[1].reason is Reason.NO_NOISE
    assert metrics.noise_and_snr(noise_parts(0.0, 0.0, 0.0), (1, 2, 3), 0.0, WEIGHTS)[1].void == "the signal is flat"
    loud = metrics.noise_and_snr(noise_parts(50.0, 50.0, 50.0), (1, 2, 3), 0.0, WEIGHTS)[1]
    assert (loud.value, loud.reason, loud.n) == (-math.inf, Reason.NO_FULL_SCALE, 3)
    assert (
        metrics.noise_and_snr(noise_parts(50.0, 50.0, 50.0), (1, 2, 3), math.nan, WEIGHTS)[1].reason is Reason.NO_CYCLE
    )
    rounding = metrics.noise_and_snr(noise_parts(50.0, 50.0, 50.0), (1, 2, 3), 100.0, WEIGHTS, 1.0)[1]
    assert (rounding.value, rounding.reason) == (math.inf, Reason.NO_NOISE)
    empty = tuple(part[:0] for part in noise_parts(1.0, 1.0, 1.0))
    assert {one.reason for one in metrics.noise_and_snr(empty, (), 100.0, WEIGHTS)} == {Reason.NO_SAMPLES}


def test_interval_of_the_noise_is_that_of_the_cycles_drawn() -> None:
    """Cycles of 0.6, 1 and 1.4 mV: each resample has the rms of its cycles; none drawn gives no interval."""
    parts = noise_parts(18.0, 50.0, 98.0)
    noise, _ = metrics.noise_and_snr(parts, (1, 2, 3), 100.0, WEIGHTS)
    drawn = np.sqrt(WEIGHTS @ parts[0] / (WEIGHTS @ parts[1]))
    value = math.sqrt(166.0 / 150.0)
    low, high = bootstrap_interval(value, drawn, 3, positive=True)
    assert (noise.value, noise.low, noise.high) == pytest.approx((value, low, high))
    alone, snr = metrics.noise_and_snr(parts, (), 100.0, np.ones((4, 0)))
    assert (alone.value, snr.value) == pytest.approx((value, 20.0 * math.log10(100.0 / value)))
    assert math.isnan(alone.low)


def test_noise_of_a_staircase_takes_the_plateaus_that_count() -> None:
    """Void, outside the cycles, or of one sample: left out; 3 samples of sd 2 are 8 with 2 degrees of freedom."""

    def plateau(n: int, *, void: str = "", branch: str = "loading") -> SimpleNamespace:
        return SimpleNamespace(void=void, branch=branch, n=(n,), signal_sd_mv=(2.0,), cycle=4)

    found = metrics.staircase_noise(
        (plateau(3), plateau(2), plateau(1), plateau(9, void="x"), plateau(9, branch="")), 0
    )
    assert [part.tolist() for part in found] == [[8.0, 4.0], [2.0, 1.0], [4.0, 4.0]]


@pytest.mark.parametrize(
    ("unit", "value", "expected"),
    [
        ("dB", 40.0, (20 * math.log10(2), 20 * math.log10(1.5))),
        ("% FSO", 6.0, (2.0, 6.0)),  # of a full scale 1.5 times as large, and of one half as large
        ("% FSO", 3.5, (3.5 / 3.0, 3.5)),
        ("% FSO/100 cycles", -6.0, (6.0, 2.0)),
    ],
)
def test_interval_takes_in_that_of_the_full_scale(unit: str, value: float, expected: tuple[float, float]) -> None:
    """Full scale 100 (50 to 150): its part and the figure's own, 3 and 4, add in squares."""
    full_scale = Figure(100.0, "mV", 5, 50.0, 150.0)
    found = metrics.with_full_scale(Figure(value, unit, 5, value - 3.0, value + 4.0), full_scale)
    low = value - math.hypot(3.0, expected[0])
    assert found.low == pytest.approx(max(low, 0.0) if unit == "% FSO" else low)
    assert found.high == pytest.approx(value + math.hypot(4.0, expected[1]))
    same = Figure(value, "mV", 5, value - 3.0, value + 4.0)
    assert metrics.with_full_scale(same, full_scale) is same
    unknown = Figure(value, unit, 5, value - 3.0, value + 4.0)
    assert metrics.with_full_scale(unknown, Figure(100.0, "mV", 5, 0.0, 150.0)) is unknown


def test_combined_error_by_hand() -> None:
    """3, 4 and 12 %: 13 %; an end of a part moves it by that part's share of the whole."""
    parts = [Figure(3.0, "% FSO", 9, 2.0, 5.0), Figure(4.0, "% FSO", 5, 3.0, 4.5), Figure(12.0, "% FSO", 7, 11.0, 12.2)]
    found = metrics.combined_error(parts)
    assert (found.value, found.n) == (13.0, 5)
    assert found.low == pytest.approx(13.0 - math.sqrt(3.0**2 + 4.0**2 + 12.0**2) / 13.0)
    assert found.high == pytest.approx(13.0 + math.sqrt(6.0**2 + 2.0**2 + 2.4**2) / 13.0)
    small = metrics.combined_error([replace(p, value=p.value / 100, low=p.low / 100, high=p.high / 100) for p in parts])
    assert (small.value, small.low, small.high) == pytest.approx((0.13, found.low / 100, found.high / 100))
    zero = Figure(0.0, "% FSO", 5, 0.0, 0.0)
    assert (metrics.combined_error([zero, zero]).low, metrics.combined_error([zero, zero]).high) == (0.0, 0.0)
    void = Figure.nothing("% FSO", Reason.FEW_CYCLES, "few")
    assert metrics.combined_error([*parts, void]).reason is Reason.FEW_CYCLES


def test_lack_of_fit_is_that_of_the_adequacy() -> None:
    """The remainder in %, with the verdict; without one the reason."""
    adequacy = SimpleNamespace(verdict=CurveVerdict.INADEQUATE, sentence="it bends", remainder_percent=2.5)
    found = metrics.lack_of_fit(adequacy, 37)
    assert (found.value, found.n, found.reason) == (2.5, 37, Reason.INADEQUATE)
    assert found.note == "inadequate: it bends"
    assert metrics.lack_of_fit(None, 37).reason is Reason.FEW_POSITIONS


def test_one_cycle_gives_no_interval() -> None:
    """A value with its reason, and two cycles with an interval, never below zero of what is never negative."""
    one = metrics._figure(5.0, np.full(9, 5.0), "mV", 1, "d")
    assert (one.value, one.reason, math.isnan(one.low)) == (5.0, Reason.ONE_CYCLE, True)
    two = metrics._figure(5.0, np.linspace(0.0, 10.0, 9), "mV", 2, "d")
    assert (two.reason, two.low) == (Reason.NONE, pytest.approx(0.0, abs=1e-6))
    assert metrics._figure(5.0, np.linspace(0.0, 10.0, 9), "mV/mm", 2, "d").low < 0.0


def test_curve_of_no_span_has_no_nonlinearity() -> None:
    """A share of nothing."""
    level = CurveDraws(Curve(5.0, 0.0, 0.0), np.arange(3.0), (0.0, 2.0), np.zeros((4, 3)), np.zeros((4, 2)), 3, 9.0)
    assert metrics.nonlinearity(level).reason is Reason.NO_FULL_SCALE


def test_resample_is_the_fit_to_the_cycles_that_were_drawn() -> None:
    """A cycle drawn twice counts twice; the range is that of the cycles drawn."""
    rng = np.random.default_rng(4)
    cycle = np.repeat(np.arange(3), 7)
    x = np.tile(np.linspace(-2.0, 4.0, 7), 3) + 0.01 * cycle
    fit = fit_calibration(x, 5.0 - 30.0 * x + x**2 + rng.standard_normal(21), 2)
    found, at = metrics.resample_fit(fit, cycle, WEIGHTS), np.linspace(-2.0, 4.0, 5)
    for row, weights in enumerate(WEIGHTS):
        polynomial = np.polyfit(x, fit.y, 2, w=np.sqrt(weights[cycle]))
        assert found.values(at)[row] == pytest.approx(np.polyval(polynomial, at), abs=1e-8)
        drawn = x[weights[cycle] > 0]
        assert found.ends[row] == pytest.approx([drawn.min(), drawn.max()])
        assert found.spans()[row] == pytest.approx(np.subtract(*np.polyval(polynomial, [drawn.max(), drawn.min()])))
    assert (found.n_cycles, found.x_range) == (3, fit.x_range)
    assert math.isnan(found.dof)


def test_loop_of_a_curved_sensor_is_what_its_curve_leaves() -> None:
    """Branches at other elongations, 1 mV above and 2 mV below one parabola: 3 mV apart, whatever its curvature."""
    x = np.broadcast_to(np.linspace(-2.0, 4.0, 7), (2, 3, 7)) + np.array([0.0, 0.4])[:, None, None]
    curve = Curve(5.0, -30.0, 4.0)
    signal = curve.predict(x) + np.array([1.0, -2.0])[:, None, None]
    loops = SimpleNamespace(elongation_mm=x, signal_mv=signal[None])
    assert metrics.sensor_loop_width(loops, 0, curve, WEIGHTS).mean_loop == pytest.approx(3.0)
    assert metrics.sensor_loop_width(loops, 0, None, WEIGHTS).mean_loop != pytest.approx(3.0, abs=0.01)
    np.testing.assert_array_equal(loops.signal_mv[0], signal)


def test_noise_about_a_local_cubic_leaves_out_turns_gaps_and_damage() -> None:
    """1 mV on ramps of three cycles; what is large near a turn, a gap or an unusable sample counts nothing."""
    rng = np.random.default_rng(8)
    n, period = 6000, 2000
    used = [
        SimpleNamespace(first=k * period, turn=k * period + 1000, last=(k + 1) * period - 1, number=k + 1,
                        rows=slice(k * period, (k + 1) * period))
        for k in range(3)
    ]  # fmt: skip
    y = 0.1 * np.abs(np.arange(n) % period - 1000) + rng.standard_normal(n)
    y[[1003, 2990, 4500]] += 1e3  # near a turn, near a gap, not usable
    usable = np.ones((n, 1), bool)
    usable[4500] = False
    recording = SimpleNamespace(n=n, signal_mv=y[:, None], usable=usable, gaps=(SimpleNamespace(row=2990),))
    squares, dof, cycle = metrics.continuous_noise(recording, SimpleNamespace(used=used), 0)
    assert np.sqrt(squares / dof) == pytest.approx(np.ones(3), abs=0.06)
    assert cycle.tolist() == [1.0, 2.0, 3.0]
    assert (dof > 1500).all()
    assert (dof < 2000).all()
    for few in (SimpleNamespace(used=[]), SimpleNamespace(used=used)):
        short = SimpleNamespace(n=10 if few.used else n, signal_mv=y[:, None], usable=usable, gaps=())
        assert [part.size for part in metrics.continuous_noise(short, few, 0)] == [0, 0, 0]
