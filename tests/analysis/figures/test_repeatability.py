"""Figures of one cycle: the end-to-end sensitivity."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from analysis import Options, analyse
from analysis.figures.repeatability import cycle_sensitivities, figures_by_cycle, lift_of_maximum
from analysis.segmentation.loops import Loops
from tests.analysis.boat_builder import PAPER, Plant, Staircase, triangle

QUICK = Options(mcmc=False, x_resolution_mm=0.0)
SPANS = [abs(curve(3.8) - curve(-2.7)) for curve in map(np.polynomial.Polynomial, PAPER)]  # 255.6, 189.9 mV


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


def test_two_cycles_have_no_warm_up() -> None:
    """The second half of two cycles is one cycle, which has no scatter to compare the first with."""
    pressure, loading, cycle = triangle(2, 10)
    assert (
        analyse(Plant(drift_mv_per_cycle=3.0).run(pressure, loading, cycle), options=QUICK).sensors[0].by_cycle.warm_up
        == 0
    )


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
