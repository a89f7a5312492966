"""Alarms: what they find, how soon, and how rarely they are wrong."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from analysis.shadow.model.reduced import ReducedModel
from analysis.shadow.monitoring.monitor import (
    Alarm,
    CycleFigures,
    Monitor,
    cycle_figures,
    deviation_mm,
    fade_percent_per_min,
    find_holds,
    pressure_residual_kpa,
)
from protocol.base.errors import DataError, RequestError
from tests.analysis.shadow.simulated_actuator import Fault, run_actuator
from tests.conftest import mostly_at_night
from tests.verification.alarm_delays import UNITS, alarms_of


def test_healthy_actuator_raises_no_alarm(table: ReducedModel) -> None:
    """Thirty continuous cycles, and twelve staircases."""
    assert alarms_of(table, run_actuator(30, staircase=False)) == []
    assert alarms_of(table, run_actuator(12)) == []


@pytest.mark.nightly
@pytest.mark.parametrize(("staircase", "cycles", "runs"), [(False, 200, 9), (True, 50, 6)])
def test_healthy_actuators_on_the_boards_model(table: ReducedModel, staircase: bool, cycles: int, runs: int) -> None:
    """No more than one false alarm in a thousand cycles, by the chance of 1 % (Poisson), on three units."""
    found = [
        alarms_of(table, run_actuator(cycles, staircase=staircase, seed=50 + k, unit_name=UNITS[k % 3]))
        for k in range(runs)
    ]
    assert sum(map(len, found)) <= stats.poisson.isf(0.01, runs * cycles / 1000)


def test_leak_of_two_percent_a_minute(table: ReducedModel) -> None:
    """Found, as a leak, within eight staircases of its beginning."""
    first = alarms_of(table, run_actuator(18, Fault(begins=10, leak_percent_per_min=2.0)))[0]
    assert first.fault == "leak"
    assert 11 <= first.cycle <= 18
    assert first.shift == pytest.approx(2.0, abs=0.8)


def test_leak_in_continuous_cycles(table: ReducedModel) -> None:
    """Found, as a leak, without a single hold; the drift that it brings comes later and names it."""
    alarms = alarms_of(table, run_actuator(36, Fault(begins=20, leak_percent_per_min=2.0), staircase=False))
    assert alarms[0].fault == "leak"
    assert 21 <= alarms[0].cycle <= 35
    assert all("leak" in a.may_follow_from for a in alarms[1:])


@pytest.mark.parametrize(("percent", "named"), mostly_at_night((5.0, "softening"), (-5.0, "stiffening")))
def test_softening_of_five_percent_over_fifty_cycles(table: ReducedModel, percent: float, named: str) -> None:
    """Found within ten cycles of its beginning, when it is one per cent, and dated to within four."""
    run = run_actuator(32, Fault(begins=20, softening_percent_in_50=percent), staircase=False)
    first = alarms_of(table, run)[0]
    assert first.fault == named
    assert 21 <= first.cycle <= 31
    assert 18 <= first.since_cycle <= 25
    assert named in first.sentence


def test_disagreeing_sensors_raise_an_alarm(table: ReducedModel) -> None:
    """Two millivolts between the sensors are found within four cycles, and later alarms name what they follow from."""
    alarms = alarms_of(table, run_actuator(30, Fault(begins=20, disagreement_mv=4.0), staircase=False))
    first = next(a for a in alarms if a.fault == "sensor disagreement")
    assert 21 <= first.cycle <= 25
    other = [a for a in alarms if a.fault in ("softening", "stiffening", "drift")]
    assert all("sensor disagreement" in a.may_follow_from for a in other if a.cycle >= first.cycle)


def test_one_outlying_cycle_is_no_alarm(table: ReducedModel) -> None:
    """A single figure far off, among healthy ones, does not raise an alarm by itself."""
    monitor, rng = Monitor(table), np.random.default_rng(4)
    for cycle in range(40):
        noise = 0.5 * rng.standard_normal(6) * (0.3, 0.3, 0.002, 0.02, 0.02, 0.005)
        values = noise + (100.0 if cycle == 30 else 0.0)
        assert monitor.take(CycleFigures(*values.tolist())) == []


def test_missing_figures_wait(table: ReducedModel) -> None:
    """NaN neither counts nor alarms; an alarm is raised once until its sum is back at zero."""
    monitor = Monitor(table)
    nothing = CycleFigures(*[np.nan] * 6)
    for _ in range(5):
        assert monitor.take(nothing) == []
    for _ in range(20):
        monitor.take(CycleFigures(0.0, np.nan, 1.0, 0.0, np.nan, np.nan))
    raised = [a for _ in range(8) for a in monitor.take(CycleFigures(0.0, np.nan, 1.05, 0.0, np.nan, np.nan))]
    assert [a.fault for a in raised] == ["softening"]
    assert raised[0].shift == pytest.approx(0.05, rel=0.3)


def test_holds_and_fade() -> None:
    """A pressure that fades by 3 % a minute under closed valves is measured as such; ramps are no holds."""
    time = np.arange(0, 60, 0.01)
    pressure = np.where(time < 5, 10 * time, 50 * np.exp(-0.03 / 60 * (time - 5)))
    holds = find_holds(time, pressure)
    assert len(holds) == 1
    assert time[holds[0]][0] > 5.0
    assert fade_percent_per_min(time, pressure) == pytest.approx(3.0, rel=0.02)
    assert np.isnan(fade_percent_per_min(time, 25 * np.sin(time)))


def test_deviation_and_residual(table: ReducedModel) -> None:
    """Zero on the nominal curve, NaN where a value is."""
    pressure = np.array([-40.0, 0.0, 50.0])
    nominal = table.nominal_elongation(pressure)[0]
    np.testing.assert_allclose(deviation_mm(table, pressure, nominal + 0.1), 0.1, atol=1e-12)
    np.testing.assert_allclose(pressure_residual_kpa(table, pressure, nominal), 0.0, atol=1e-4)
    assert np.isnan(deviation_mm(table, np.array([0.0]), np.array([np.nan]))[0])


def test_bad_cycles_and_requests(table: ReducedModel) -> None:
    """Lengths that differ, time that does not rise, no elongation at all, an impossible rate of false alarms."""
    time, pressure = np.arange(20.0), np.linspace(-40, 50, 20)
    for t, p, x in (
        (time, pressure[:-1], pressure),
        (np.zeros(20), pressure, pressure),
        (time, pressure, np.full(20, np.nan)),
        (time[:4], pressure[:4], pressure[:4]),
    ):
        with pytest.raises(DataError) as refusal:
            cycle_figures(table, t, p, x)
        assert refusal.value.remedy
    for cycles in (1.0, float("nan")):
        with pytest.raises(RequestError):
            Monitor(table, cycles)


def test_an_alarm_warns_of_dependent_cycles() -> None:
    """In its sentence, and only where they are dependent."""
    sure = Alarm("leak", "loss", "%/min", 2.0, 3, 9, 5000.0)
    unsure = Alarm("leak", "loss", "%/min", 2.0, 3, 9, 5000.0, (), independent=False)
    assert "correlated" not in sure.sentence
    assert "once in 5,000 cycles; more often if cycles are correlated" in unsure.sentence
