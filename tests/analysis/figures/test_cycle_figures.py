"""Repeatability, drift, and the figures of each cycle."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from analysis import Options, analyse
from analysis.figures.cycle_figures import (
    FiguresByCycle,
    Trend,
    _pooled_and_worst,
    cycle_sensitivities,
    drift,
    figures_by_cycle,
    lift_of_maximum,
    repeatability,
)
from analysis.figures.figure import Reason
from analysis.segmentation.loops import Loops
from analysis.statistics import resampling_weights
from tests.analysis.boat_builder import PAPER, Plant, Staircase, triangle
from tests.analysis.figures.by_hand import WEIGHTS, loops_of

QUICK = Options(mcmc=False, x_resolution_mm=0.0)
SPANS = [abs(curve(3.8) - curve(-2.7)) for curve in map(np.polynomial.Polynomial, PAPER)]  # 255.6, 189.9 mV


def test_drift_is_the_slope_of_all_levels_over_the_cycles() -> None:
    """0.3 mV a cycle of 150 mV are 20 % in 100 cycles; a cycle's number counts, not its place."""
    base = np.broadcast_to(np.array([0.0, 60.0, 150.0]), (2, 4, 3))
    signal = base + 0.3 * np.array([1.0, 2.0, 3.0, 6.0])[None, :, None]
    found = drift(loops_of(signal, numbers=(1, 2, 3, 6)), 0, 150.0)
    assert (found.value, found.low, found.high) == pytest.approx((20.0, 20.0, 20.0))
    hidden = np.ones(signal.shape, bool)
    hidden[0, 1, 2] = False
    signal[0, 1, 2] = 1e6
    assert drift(loops_of(signal, numbers=(1, 2, 3, 6), own=hidden), 0, 150.0).value == pytest.approx(20.0)
    assert drift(loops_of(signal[:, :2]), 0, 150.0).reason is Reason.FEW_CYCLES
    assert drift(loops_of(base[:, :3]), 0, 150.0).value == pytest.approx(0.0, abs=1e-9)
    assert drift(loops_of(signal), 0, 0.0).reason is Reason.NO_FULL_SCALE
    assert drift(loops_of(base + 0.001 * np.arange(4.0)[:, None]), 0, 0.5).value == pytest.approx(20.0)
    nowhere = loops_of(signal, own=np.zeros(signal.shape, bool))
    assert drift(nowhere, 0, 150.0).reason is Reason.NO_COMMON_LEVEL


def test_repeatability_by_hand() -> None:
    """Cycles at -1, 0, 1 and at -2, 0, 2 mV about two levels: sd 1 and 2, pooled sqrt(2.5), of 50 mV."""
    signal = np.zeros((2, 3, 2))
    signal[:, :, 0], signal[:, :, 1] = [-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0]
    found = repeatability(loops_of(100.0 + signal), 0, 50.0, WEIGHTS)
    assert found["repeatability_percent_fso"].value == pytest.approx(2.0 * math.sqrt(2.5))
    assert found["repeatability_worst_percent_fso"].value == pytest.approx(4.0)
    signal[1, 1:, 1] = np.nan  # one cycle is left there: it has no sd
    signal[1, 2, 0] = np.nan  # two: (-1, 0), variance 1/2 with one degree of freedom
    part = repeatability(loops_of(100.0 + signal), 0, 50.0, WEIGHTS)
    assert part["repeatability_percent_fso"].value == pytest.approx(2.0 * math.sqrt((2 + 8 + 0.5) / 5))
    for cycles, full_scale, reason in ((1, 50.0, Reason.FEW_CYCLES), (3, 0.0, Reason.NO_FULL_SCALE)):
        none = repeatability(loops_of(signal[:, :cycles]), 0, full_scale, WEIGHTS[:, :cycles])
        assert {figure.reason for figure in none.values()} == {reason}


def test_noise_of_bins_is_taken_out_of_the_repeatability() -> None:
    """0.5 mV of noise, of which levels have shares 0.4 and 2: variances 1 and 4 less 0.1 and 0.5 mV^2."""
    signal = np.zeros((2, 3, 3))
    signal[:, :, 0], signal[:, :, 1] = [-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0]
    signal[:, 1:, 2] = np.nan  # one cycle has this level: neither its spread nor its noise counts
    loops = loops_of(100.0 + signal, noise_share=lambda _: np.tile([0.4, 2.0, 90.0], (2, 1)))
    found = repeatability(loops, 0, 50.0, WEIGHTS, 0.5)
    assert found["repeatability_percent_fso"].value == pytest.approx(2.0 * math.sqrt(2.5 - 0.3))
    assert found["repeatability_worst_percent_fso"].value == pytest.approx(2.0 * math.sqrt(4.0 - 0.5))
    assert found["repeatability_worst_percent_fso"].low <= found["repeatability_percent_fso"].low
    two = repeatability(loops_of(signal[:, :2, :2]), 0, 50.0, np.ones((4, 2)))
    assert two["repeatability_percent_fso"].value == pytest.approx(2.0 * math.sqrt((0.5 + 2.0) / 2.0))


def test_repeatability_of_three_cycles_has_the_interval_of_two_degrees_of_freedom() -> None:
    """Cycles that differ as a whole: chi-square of 2, 0.52 to 6.3 times; resamples of one cycle have no spread."""
    offset = np.array([-0.4, 0.1, 0.3])
    signal = np.broadcast_to(np.array([0.0, 60.0, 150.0]), (2, 3, 3)) + offset[None, :, None]
    weights = resampling_weights(3, np.random.default_rng(0), 2000)
    found = repeatability(loops_of(signal), 0, 150.0, weights)["repeatability_percent_fso"]
    sd = 100.0 / 150.0 * offset.std(ddof=1)
    reach = np.sqrt(2.0 / stats.chi2.ppf([0.975, 0.025], 2))
    assert (found.value, found.low, found.high) == pytest.approx((sd, *(sd * reach)), rel=0.02)


def test_pooled_and_worst_of_resamples() -> None:
    """A cycle drawn twice counts twice; one cycle alone has no sd."""
    series = np.array([[0.0, 0.0], [1.0, 2.0], [5.0, 4.0]])
    pooled, worst = _pooled_and_worst(series, WEIGHTS)
    for row, picked in enumerate(([0, 1, 2], None, [1, 1, 2], [0, 2, 2])):
        if picked is None:
            assert (np.isnan(pooled[row]), worst[row]) == (True, 0.0)
            continue
        variance = series[picked].var(axis=0, ddof=1)
        assert (pooled[row], worst[row]) == pytest.approx((np.sqrt(variance.mean()), np.sqrt(variance.max())))


def test_repeatability_and_its_interval_hold_the_true_scatter() -> None:
    """4 cycles of 74 levels with a scatter of 1 % FSO: unbiased, and 19 of 20 intervals at least near it hold it."""
    held, values = 0, []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        loops = SimpleNamespace(
            own=np.ones((2, 4, 37), bool),
            signal_mv=rng.standard_normal((1, 2, 4, 37)),
            n_cycles=4,
            numbers=(1, 2, 3, 4),
        )
        found = repeatability(loops, 0, 100.0, resampling_weights(4, rng, 500))["repeatability_percent_fso"]
        held += found.low <= 1.0 <= found.high
        values.append(found.value)
    assert np.sqrt(np.mean(np.square(values))) == pytest.approx(1.0, abs=0.02)
    assert held >= 17


def test_sensitivity_of_a_cycle_is_over_elongation_where_it_was_read(tmp_path: Path) -> None:
    """The paper's 39.3 and 29.2 mV/mm in every cycle."""
    stairs = Staircase(Plant(loop_mm=0.25), cycles=3)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    analysis = analyse(stairs.recording(), tmp_path / "e.csv", options=QUICK)
    for sensor, span in enumerate(SPANS):
        values, unit = cycle_sensitivities(analysis.loops, sensor)
        assert unit == "mV/mm"
        assert values == pytest.approx(np.full(3, span / 6.5), rel=2e-3)


def test_sensitivity_of_a_cycle_is_over_pressure_where_one_cycle_was_not_read(tmp_path: Path) -> None:
    """One unread cycle makes all of them mV/kPa, so that cycles stay comparable: span over 90 kPa."""
    stairs = Staircase(cycles=3)
    table = stairs.elongations()
    table.loc[np.arange(len(table)) >= 37, "elongation_mm"] = np.nan  # the third cycle
    rows = table.assign(
        cycle=[k for _, _, k in stairs.levels()],
        branch=["loading" if up else "unloading" for _, up, _ in stairs.levels()],
    ).dropna()
    rows.to_csv(tmp_path / "e.csv", index=False)
    analysis = analyse(stairs.recording(), tmp_path / "e.csv", options=QUICK)
    for sensor, span in enumerate(SPANS):
        values, unit = cycle_sensitivities(analysis.loops, sensor)
        assert unit == "mV/kPa"
        assert values == pytest.approx(np.full(3, span / 90.0), rel=2e-3)


def test_sensitivity_of_a_cycle_of_a_continuous_run() -> None:
    """Bins represent the levels: the chord between the outermost bins' centres, 88 kPa of 90 apart."""
    analysis = analyse(Plant().run(*triangle(4, 20)), options=QUICK)
    curves = map(np.polynomial.Polynomial, PAPER)
    for sensor, curve in enumerate(curves):
        values, unit = cycle_sensitivities(analysis.loops, sensor)
        inner = 6.5 / 90.0  # one kPa in mm; half a bin is 1 kPa
        assert unit == "mV/kPa"
        assert values == pytest.approx(np.full(4, (curve(3.8 - inner) - curve(-2.7 + inner)) / 88.0), rel=5e-3)


def test_no_cycle_has_no_sensitivity() -> None:
    """A pressure that never turns: nothing to give, and no exception."""
    rest = np.zeros(1000)
    values, unit = cycle_sensitivities(analyse(Plant().run(rest, rest > 0, rest), options=QUICK).loops, 0)
    assert (values.size, unit) == (0, "mV/kPa")


def test_lift_of_a_maximum_is_that_of_the_normal_distribution() -> None:
    """No loop: E|z| = sqrt(2/pi) for one level, 2.16 for 20; a loop far wider at one level than its scatter: none.

    2.16 is the mean of the largest of 20 |z| by numerical integration of 1 - (2 Phi - 1)^20.
    """
    z = np.linspace(0, 8, 80_001)
    one, twenty = (float(np.trapezoid(1 - (2 * stats.norm.cdf(z) - 1) ** m, z)) for m in (1, 20))
    rng = np.random.default_rng(0)
    for levels, expected in ((1, one), (20, twenty)):
        signal = np.zeros((2, 4000, levels))
        signal[1] = rng.standard_normal((4000, levels))
        assert lift_of_maximum(signal) == pytest.approx(expected, abs=0.05)
    wide = np.zeros((2, 4000, 20))
    wide[1] = rng.standard_normal((4000, 20)) + 30.0 * (np.arange(20) == 9)
    assert lift_of_maximum(wide) == pytest.approx(0.0, abs=0.08)
    assert np.isnan(lift_of_maximum(np.zeros((2, 1, 5))))


def test_a_cycle_less_its_lift_has_the_hysteresis_of_the_mean_loop() -> None:
    """Thirty continuous cycles with noise: the median cycle is wider than the mean loop by the lift, within a fifth."""
    analysis = analyse(Plant(loop_mm=0.3, noise_mv=(6.0, 4.0)).run(*triangle(30, 10)), options=QUICK)
    for sensor in analysis.sensors:
        lift = sensor.by_cycle.hysteresis_lift_percent_fso
        wider = np.median(sensor.system_hysteresis_per_cycle) - sensor.figures["system_hysteresis_percent_fso"].value
        assert lift > 0.2
        assert wider == pytest.approx(lift, rel=0.2)


@pytest.mark.parametrize(("offset_mv", "warm_up"), [(0.02, 0), (2.0, 1)])
def test_warm_up_is_named_only_where_it_matters(offset_mv: float, warm_up: int) -> None:
    """A first cycle off by 0.01 % of full scale is none, however quiet the others are; 0.8 % is."""
    pressure, loading, cycle = triangle(8, 10)
    run = Plant(noise_mv=(0.001, 0.001)).run(pressure, loading, cycle)
    moved = replace(run, signal_mv=run.signal_mv + np.where(cycle == cycle.min(), offset_mv, 0.0)[:, None])
    found = analyse(moved, options=QUICK)
    assert found.sensors[0].by_cycle.warm_up == warm_up


def by_cycle(signal: np.ndarray, full_scale_mv: float, *noise: list[float]) -> FiguresByCycle:
    """Return the figures by cycle of signals [2, cycles, levels] whose loops are 1 mV wide."""
    parts = [np.asarray(part) for part in noise or ([], [], [])]
    width = SimpleNamespace(per_cycle=np.ones(signal.shape[1]))
    return figures_by_cycle(loops_of(signal, elongation_mm=None), 0, full_scale_mv, width, tuple(parts))


def test_figures_of_each_cycle_by_hand() -> None:
    """Three cycles lifted by 0, 3 and 5 mV, of 150 mV: each value by hand; one level is unknown in one branch."""
    lift = np.array([0.0, 3.0, 5.0])
    signal = np.broadcast_to(np.array([0.0, 60.0, 150.0]), (2, 3, 3)) + lift[:, None] + np.zeros((2, 1, 1))
    signal = signal + np.array([-1.0, 1.0])[:, None, None]
    found = by_cycle(signal, 150.0, [8.0, 18.0, 0.0], [2.0, 2.0, 0.0], [1.0, 2.0, 3.0])
    assert found.hysteresis_percent_fso == pytest.approx(np.full(3, 100.0 / 150.0))
    assert found.span_mv.tolist() == [150.0, 150.0, 150.0]
    assert found.snr_db[:2] == pytest.approx(20.0 * np.log10([75.0, 50.0]))
    assert np.isnan(found.snr_db[2])
    assert found.displacement_percent_fso == pytest.approx((lift - 4.0) / 1.5)  # from the median of the last two
    assert found.level_displacement_percent_fso == pytest.approx(np.tile((lift - lift.mean())[:, None] / 1.5, 3))
    assert found.branch_displacement_percent_fso[1] == pytest.approx(found.level_displacement_percent_fso)
    assert (found.sensitivity_unit, found.sensitivity.tolist()) == ("mV/kPa", [150.0 / 80.0] * 3)
    assert by_cycle(signal[:, :, :2], 150.0).span_mv.tolist() == [60.0, 60.0, 60.0]
    assert found.hysteresis_lift_percent_fso == pytest.approx(0.0, abs=1e-9)
    assert found.warm_up == 0  # the later two differ as much
    single = by_cycle(signal, 150.0, [2.0], [1.0], [1.0])
    assert single.snr_db[0] == pytest.approx(20.0 * math.log10(150.0 / math.sqrt(2.0)))
    assert np.isnan(by_cycle(signal, 150.0, [0.0], [9.0], [1.0]).snr_db[0])
    for unknown in (0.0, math.nan):
        assert np.isnan(by_cycle(signal, unknown).displacement_percent_fso).all()


def test_warm_up_needs_two_later_cycles_and_an_offset_that_matters() -> None:
    """Later cycles alike: a first one off by 0.11 % of 0.5 mV is warm-up, 0.09 % is none; three cycles are enough."""
    for offset, cycles, warm_up in ((0.11, 4, 1), (0.09, 4, 0), (0.11, 3, 1), (0.11, 2, 0)):
        signal = np.broadcast_to(np.array([0.0, 0.2, 0.5]), (2, cycles, 3)).copy()
        signal[:, 0] += offset / 100.0 * 0.5
        assert by_cycle(signal, 0.5).warm_up == warm_up, (offset, cycles)


@pytest.mark.parametrize(("settling_mv", "warm_up"), [(0.0, 0), (30.0, 3)])
def test_steady_drift_is_no_warm_up(settling_mv: float, warm_up: int) -> None:
    """40 cycles drift by 0.5 mV each: no warm-up; 30, 21.5, 15.4 mV more are beyond 3 robust sd, 11.1 mV."""
    number = np.arange(40.0)
    means = 0.5 * number - settling_mv * np.exp(-number / 3.0) + 0.1 * np.cos(9.0 * number)
    signal = np.broadcast_to(np.array([0.0, 60.0, 150.0]), (2, 40, 3)) + means[:, None]
    assert by_cycle(signal, 150.0).warm_up == warm_up


def test_lift_counts_levels_of_two_cycles() -> None:
    """A level that one cycle has both branches of has no scatter; with two it has."""
    signal = np.zeros((2, 2, 2))
    signal[1] = [[1.0, 5.0], [3.0, np.nan]]
    assert lift_of_maximum(signal) == lift_of_maximum(signal[:, :, :1]) != 0.0


def test_trend_of_a_signal_is_its_regression_on_time() -> None:
    """Slope and reach are those of scipy's regression of the means of four cycles; what is not significant is zero."""
    time_s, noise = np.array([0.0, 10.0, 25.0, 30.0, 41.0]), np.array([0.3, -0.2, 0.1, -0.4, 0.2])
    for slope, significant in ((0.5, True), (-0.5, True), (0.001, False)):
        means = 100.0 + slope * time_s + noise
        signal = np.broadcast_to(np.array([0.0, 60.0]), (2, 5, 2)) + means[:, None]
        found, line = Trend.of(loops_of(signal), 0, time_s), stats.linregress(time_s, means)
        expected = (line.slope, stats.t.ppf(0.975, 3) * line.stderr) if significant else (0.0, 0.0)
        assert found.slope == pytest.approx(expected[0])
        assert expected[1] <= found.reach + 1e-12 <= 2.0 * expected[1] + 1e-12  # wider if cycles depend on one another
    assert Trend.of(loops_of(signal[:, :2]), 0, time_s[:2]) == Trend()
    assert Trend.of(loops_of(signal), 0, np.zeros(5)) == Trend()
    three = np.broadcast_to(np.array([0.0, 60.0]), (2, 3, 2)) + np.array([0.0, 1.0, 2.001])[:, None]
    assert Trend.of(loops_of(three), 0, np.array([0.0, 0.1, 0.2])).slope == pytest.approx(10.0, rel=1e-3)


@pytest.mark.parametrize(("cycles", "assumed"), [(29, True), (30, False)])
def test_independence_of_few_cycles_is_an_assumption(cycles: int, assumed: bool) -> None:
    """Below 30 cycles dependence is often not noticed, so the definition says what is assumed."""
    signal = np.zeros((2, cycles, 3)) + np.random.default_rng(2).standard_normal(cycles)[:, None] + np.arange(3.0)
    found = drift(loops_of(signal), 0, 2.0)
    assert ("assumed to be independent" in found.definition) is assumed
    assert found.reason is Reason.NONE


def test_two_cycles_have_no_warm_up() -> None:
    """The second half of two cycles is one cycle, which has no scatter to compare the first with."""
    pressure, loading, cycle = triangle(2, 10)
    assert (
        analyse(Plant(drift_mv_per_cycle=3.0).run(pressure, loading, cycle), options=QUICK).sensors[0].by_cycle.warm_up
        == 0
    )


def test_one_cycle_has_no_drift_of_its_levels() -> None:
    """One value is its own mean: its distance from it is not zero but unknown."""
    found = analyse(Plant().run(*triangle(1, 10)), options=QUICK).sensors[0].by_cycle
    assert len(found.numbers) == 1
    assert np.isnan(found.level_displacement_percent_fso).all()


def test_snr_of_each_cycle_is_that_of_its_span_over_its_noise() -> None:
    """A noise of 0.5 mV under spans of 255.6 and 189.9 mV: 54.2 and 51.6 dB in each of four cycles."""
    found = analyse(Plant(noise_mv=(0.5, 0.5)).run(*triangle(4, 20)), options=QUICK)
    for sensor, span in zip(found.sensors, SPANS, strict=True):
        assert sensor.figures["noise_mv"].value == pytest.approx(0.5, rel=0.02)  # 4 % more or less by wrong freedom
        assert sensor.by_cycle.snr_db == pytest.approx(np.full(4, 20 * np.log10(span * 88 / 90 / 0.5)), abs=0.5)


def test_one_cycle_in_370_of_a_steady_sensor_is_outside_three_sigma() -> None:
    """A first cycle 2.5 robust sd away is scatter, one 3.5 away is warm-up; both are more than 0.1 % of full scale."""
    level = np.linspace(0.0, 90.0, 10)
    later = np.asarray([-1.0, 1.0, -0.6745, 0.6745, 0.0, -0.3, 0.3, 0.9, -0.9])  # of robust sd 1
    for offset, warm_up in ((2.5, 0), (3.5, 1)):
        common = np.concatenate([[offset], np.zeros(8), later / (1.4826 * np.median(np.abs(later)))])
        signal = np.broadcast_to(level + common[:, None], (1, 2, common.size, level.size)).copy()
        shape = signal.shape[1:]
        loops = Loops(
            level, np.broadcast_to(level, shape), None, signal, np.ones(shape, bool), tuple(range(1, common.size + 1)),
            (), (0.0, 90.0), False,
        )  # fmt: skip
        found = figures_by_cycle(
            loops, 0, 90.0, SimpleNamespace(per_cycle=np.zeros(common.size)), (np.empty(0), np.empty(0), np.empty(0))
        )
        assert found.warm_up == warm_up
