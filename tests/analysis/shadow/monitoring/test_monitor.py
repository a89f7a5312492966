"""Alarms: what they find, how soon, and how rarely they are wrong."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from analysis.errors import DataError, RequestError
from analysis.shadow.model.reduced import ReducedModel
from analysis.shadow.monitoring.cusum import SelfStartingCusum, cycles_between_alarms, threshold_for
from analysis.shadow.monitoring.leak import LeakWatch, Loop, loss_percent_per_min
from analysis.shadow.monitoring.monitor import (
    Alarm,
    CycleFigures,
    Monitor,
    cycle_figures,
    deviation_mm,
    fade_percent_per_min,
    find_holds,
    pressure_residual_kpa,
    running_level,
)
from analysis.shadow.monitoring.periodic_interference import find_hum
from tests.analysis.shadow.bench_actuator import Illness, Run, run_actuator

UNITS = ("SA1", "SA2", "SA3")


def alarms_of(table: ReducedModel, run: Run) -> list[Alarm]:
    """All alarms of a run."""
    monitor = Monitor(table)
    watched = (monitor.watch(run.time_s[c], run.pressure_kpa[c], run.elongations_mm[c]) for c in run.cycles)
    return [alarm for raised in watched for alarm in raised]


def false_alarms(runs: int, cycles: int, seed: int) -> float:
    """Healthy cycles for each false alarm, over `runs` actuators of which each starts anew after an alarm."""
    watched = np.array([[1, 0], [1, 0], [1, 1], [1, 1], [1, 1], [1, 1]], dtype=bool)
    threshold = threshold_for(1000.0, int(watched.sum()))
    rng, cusum, alarms = np.random.default_rng(seed), SelfStartingCusum(np.full((runs, 6), 1e-12)), 0
    for _ in range(cycles):
        hit = ((cusum.update(rng.standard_normal((runs, 6))) > threshold) & watched).any(axis=(1, 2))
        alarms += int(hit.sum())
        for name in ("count", "mean", "squares", "sums", "length", "shift"):
            getattr(cusum, name)[hit] = 0.0
    return runs * cycles / alarms


def test_one_false_alarm_in_a_thousand_healthy_cycles() -> None:
    """Over all ten one-sided sums together, with the baseline learnt on the way, to the simulation's own error."""
    assert 850.0 < false_alarms(200, 1200, 0) < 1250.0


@pytest.mark.nightly
def test_one_false_alarm_in_a_thousand_healthy_cycles_closely() -> None:
    """The same over two million cycles."""
    assert 950.0 < false_alarms(500, 4000, 1) < 1120.0


def test_threshold_and_interval_are_inverse() -> None:
    """Siegmund's formula and its inverse; h = 5 and k = 1/2 give 938.2 cycles (D. Montgomery's textbook)."""
    assert cycles_between_alarms(5.0) == pytest.approx(938.2, rel=1e-4)
    assert cycles_between_alarms(threshold_for(1000.0, 4)) == pytest.approx(4000.0, rel=1e-6)


def test_scores_are_standard_normal_from_the_start() -> None:
    """Whatever mean and spread the healthy values have, the first sums are those of standard normal scores."""
    values = 7.0 + 3.0 * np.random.default_rng(0).standard_normal((20, 4000))
    cusum, first = SelfStartingCusum(np.full(4000, 1e-12)), np.zeros(4000)
    for row in values[:5]:
        sums = cusum.update(row)
        first = np.maximum(sums[:, 0], sums[:, 1])
    assert (first > 1.5).mean() == pytest.approx(0.065, abs=0.03)
    assert first.max() < 8.0


def test_healthy_actuator_raises_no_alarm(table: ReducedModel) -> None:
    """Fifty continuous cycles, and twelve staircases."""
    assert alarms_of(table, run_actuator(50, staircase=False)) == []
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
    first = alarms_of(table, run_actuator(18, Illness(begins=10, leak_percent_per_min=2.0)))[0]
    assert first.illness == "leak"
    assert 11 <= first.cycle <= 18
    assert first.shift == pytest.approx(2.0, abs=0.8)


def test_leak_in_continuous_cycles(table: ReducedModel) -> None:
    """Found, as a leak, without a single hold; the drift that it brings comes later and names it."""
    alarms = alarms_of(table, run_actuator(50, Illness(begins=30, leak_percent_per_min=2.0), staircase=False))
    assert alarms[0].illness == "leak"
    assert 31 <= alarms[0].cycle <= 45
    assert all("leak" in a.may_follow_from for a in alarms[1:])


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("staircase", "begins", "cycles", "median", "most"), [(False, 30, 55, 10, 14), (True, 10, 24, 6, 8)]
)
def test_delays_of_a_leak(
    table: ReducedModel, staircase: bool, begins: int, cycles: int, median: int, most: int
) -> None:
    """Median and 90 % of the delay, in cycles, over three units; each first alarm is a leak."""
    ill, delays = Illness(begins=begins, leak_percent_per_min=2.0), []
    for k in range(9):
        run = run_actuator(cycles, ill, staircase=staircase, seed=20 + k, unit_name=UNITS[k % 3])
        first = alarms_of(table, run)[0]
        assert first.illness == "leak"
        delays.append(first.cycle - begins)
    assert 1 <= np.median(delays) <= median
    assert np.percentile(delays, 90) <= most


@pytest.mark.parametrize(("percent", "named"), [(5.0, "softening"), (-5.0, "stiffening")])
def test_softening_of_five_percent_over_fifty_cycles(table: ReducedModel, percent: float, named: str) -> None:
    """Found within ten cycles of its beginning, when it is one per cent, and dated to within four."""
    run = run_actuator(45, Illness(begins=30, softening_percent_in_50=percent), staircase=False)
    first = alarms_of(table, run)[0]
    assert first.illness == named
    assert 31 <= first.cycle <= 41
    assert 28 <= first.since_cycle <= 35
    assert named in first.sentence


def test_sensors_that_part(table: ReducedModel) -> None:
    """Two millivolts between the sensors are found within four cycles, and later alarms name what they follow from."""
    alarms = alarms_of(table, run_actuator(30, Illness(begins=20, disagreement_mv=4.0), staircase=False))
    first = next(a for a in alarms if a.illness == "sensor disagreement")
    assert 21 <= first.cycle <= 25
    other = [a for a in alarms if a.illness in ("softening", "stiffening", "drift")]
    assert all("sensor disagreement" in a.may_follow_from for a in other if a.cycle >= first.cycle)


def test_one_wild_cycle_is_no_alarm(table: ReducedModel) -> None:
    """A single figure far off, among healthy ones, does not raise an alarm by itself."""
    monitor, rng = Monitor(table), np.random.default_rng(4)
    for cycle in range(40):
        noise = 0.5 * rng.standard_normal(6) * (0.3, 0.3, 0.002, 0.02, 0.02, 0.005)
        values = noise + (100.0 if cycle == 30 else 0.0)
        assert monitor.take(CycleFigures(*values.tolist())) == []


def test_missing_figures_wait(table: ReducedModel) -> None:
    """NaN neither counts nor alarms; an alarm stands until its sum is back at zero."""
    monitor = Monitor(table)
    nothing = CycleFigures(*[np.nan] * 6)
    for _ in range(5):
        assert monitor.take(nothing) == []
    for _ in range(20):
        monitor.take(CycleFigures(0.0, np.nan, 1.0, 0.0, np.nan, np.nan))
    raised = [a for _ in range(8) for a in monitor.take(CycleFigures(0.0, np.nan, 1.05, 0.0, np.nan, np.nan))]
    assert [a.illness for a in raised] == ["softening"]
    assert [a.illness for a in monitor.standing()] == ["softening"]
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


def test_loss_is_the_leak_behind_the_gauge() -> None:
    """r' = loss p is recovered whatever offset and gain lie beneath; a cycle without pressure gives NaN."""
    time = np.arange(0, 40, 0.01)
    pressure = 5 + 45 * np.sin(2 * np.pi * time / 40)
    integral = np.concatenate([[0], np.cumsum((pressure[1:] + pressure[:-1]) / 2 * 0.01)])
    residual = 1.0 + 0.03 * pressure + 2 / 6000 * integral
    assert loss_percent_per_min(time, pressure, residual) == pytest.approx(2.0, rel=1e-6)
    # the leak's own growth from cycle to cycle is 5 kPa a second on average; any other drift is none of it
    assert loss_percent_per_min(time, pressure, residual, 2 / 6000 * 5) == pytest.approx(2.0, rel=1e-3)
    assert loss_percent_per_min(time, pressure, residual + 0.1 * time, 2 / 6000 * 5 + 0.1) == pytest.approx(
        2.0, rel=1e-3
    )
    assert np.isnan(loss_percent_per_min(time, np.zeros_like(time), residual))


def test_hysteresis_and_the_length_of_holds_are_no_leak() -> None:
    """A loop of +-4 kPa and holds that double leave next to nothing; two per cent a minute are seen."""
    watch, losses, lost, start = LeakWatch(2), [], 0.0, 0.0
    for cycle in range(8):
        hold = np.full(300 if cycle % 2 else 600, 1.0)
        down, up = np.linspace(50, -40, 4500), np.linspace(-40, 50, 4500)
        pressure = np.concatenate([50 * hold, down, -40 * hold, up])
        loop = np.concatenate([0 * hold, -4 * (1 - ((down - 5) / 45) ** 2), 0 * hold, 4 * (1 - ((up - 5) / 45) ** 2)])
        leak = np.cumsum(pressure) * 0.01 * 2 / 6000 * (cycle >= 5)
        time = start + 0.01 * np.arange(len(pressure))
        losses.append(watch.take(time, pressure, 0.02 * pressure + loop + lost + leak))
        lost, start = lost + leak[-1], time[-1] + 0.01
    assert np.isnan(losses[:2]).all()
    np.testing.assert_allclose(losses[2:5], 0.0, atol=0.3)
    np.testing.assert_allclose(losses[6:], 2.0, atol=0.3)


def test_a_hum_is_found_and_noise_is_none() -> None:
    """A sine's values come back within its error; noise, or fewer than three cycles, gives none."""
    time, rng = np.arange(0, 200, 0.5), np.random.default_rng(0)
    columns = np.stack([np.ones_like(time), np.sin(2 * np.pi * time / 20), time / 200], axis=1)
    wave, noise = 0.05 * np.cos(2 * np.pi * time / 25 + 1), 0.03 * rng.standard_normal(time.size)
    found = find_hum(time, columns @ [1.0, 0.5, 0.2] + wave + noise, columns, 20.0)
    assert found.frequency_hz == pytest.approx(0.04, abs=5e-4)
    assert np.abs(found.at(time) - wave).max() < 0.02
    assert not find_hum(time, noise, columns, 20.0).at(time).any()
    assert not find_hum(time[:90], (wave + noise)[:90], columns[:90], 20.0).at(time).any()


def test_a_loop_of_nothing_is_none() -> None:
    """Pressure that stands still, or no residual at all."""
    assert Loop.of([(np.full(20, 5.0), np.zeros(20))]) is None
    assert Loop.of([(np.linspace(-40, 50, 20), np.full(20, np.nan))]) is None


def test_deviation_residual_and_level(table: ReducedModel) -> None:
    """Zero on the nominal curve, NaN where a value is; the level forgets with its time constant and skips NaN."""
    pressure = np.array([-40.0, 0.0, 50.0])
    nominal = table.nominal_elongation(pressure)[0]
    np.testing.assert_allclose(deviation_mm(table, pressure, nominal + 0.1), 0.1, atol=1e-12)
    np.testing.assert_allclose(pressure_residual_kpa(table, pressure, nominal), 0.0, atol=1e-4)
    assert np.isnan(deviation_mm(table, np.array([0.0]), np.array([np.nan]))[0])
    time = np.arange(0, 100, 0.1)
    values = np.where(time < 50, 0.0, 1.0)
    values[100:110] = np.nan
    level = running_level(time, values, 10.0)
    assert level[549] == pytest.approx(1 - np.exp(-0.5), abs=0.02)
    assert level[105] == 0.0


def test_bad_cycles_and_requests(table: ReducedModel) -> None:
    """Lengths that differ, time that stands, no elongation at all, a false-alarm rate that is none."""
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
