"""Do runs that end as soon as they know enough state an uncertainty that holds as often as it states?

A stopping rule chooses the runs whose estimates are small by chance. Each test compares the coverage at the end with
that of other runs of the same length that nothing ended.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import special

from analysis.calibration_export.run_record import elongation_reader
from analysis.figures.cycle_figures import drift, repeatability
from analysis.segmentation.cycle_effect import CycleEffect
from analysis.segmentation.loops import Loops
from analysis.statistics import resampling_weights
from analysis.stopping.criterion import FEWEST_CYCLES, FEWEST_REPEATS, u_at_most
from boat_daq.engine.plan import Plan, load_plan
from protocol.base.arrays import FloatArray
from tests.analysis.stopping.simulated_run import SimulatedRun

PLACES = 18
NOISE_MV, OWN_MV = 1.6, 0.1
FSO_MV = 250.0
PLAN = load_plan("calibration").changed(cycles=1000)


def loops_of(values: FloatArray) -> Loops:
    """Return the loops of one sensor, of values [cycles, places], mV."""
    cycles, places = values.shape
    signal = values.reshape(cycles, 2, places // 2).transpose(1, 0, 2)[None]
    shape, levels = signal.shape[1:], np.linspace(-40.0, 50.0, places // 2)
    numbers = tuple(range(1, cycles + 1))
    return Loops(levels, np.zeros(shape), None, signal, np.ones(shape, bool), numbers, (), (-40.0, 50.0), binned=True)


def cycles_of(rng: np.random.Generator, shared: float, own: float, cycles: int, places: int) -> FloatArray:
    """Return values [cycles, places] that differ by what their cycle shares and by what is their own."""
    return shared * rng.standard_normal((cycles, 1)) + own * rng.standard_normal((cycles, places))


def stated_u_mv(values: FloatArray) -> float:
    """Return U that a calibration with noise of a sample states of a reading, the signal in place of x."""
    effect = CycleEffect.of(loops_of(values), 0)
    pooled = float(np.sqrt(values.var(axis=0, ddof=1).mean()))
    return u_at_most(2.0 * math.hypot(NOISE_MV, effect.repeatability(pooled, 0.0)), effect, 1.0)


def coverage_of_u(shared: float, asked: float, runs: int) -> tuple[float, float, float]:
    """Return mean coverage at the end of runs, of others as long, and the mean number of cycles.

    Parameters
    ----------
    shared : sd of what the readings of a cycle differ by together, mV.
    asked : U asked for, over the standard deviation of a reading. runs : how many.
    """
    reading = math.hypot(shared, NOISE_MV)

    def inside(values: FloatArray) -> float:
        u, away = stated_u_mv(values), float(values.mean())  # by which the curve is off
        return float(special.ndtr((u - away) / reading) - special.ndtr((-u - away) / reading))

    found = []
    for seed in range(runs):
        rng = np.random.default_rng((seed, 8))
        values, other = (cycles_of(rng, shared, OWN_MV, 40, PLACES) for _ in range(2))
        n = FEWEST_CYCLES
        while n < 40 and stated_u_mv(values[:n]) > asked * reading:
            n += 1
        found.append((inside(values[:n]), inside(other[:n]), n))
    ended, fixed, cycles = np.mean(found, axis=0).tolist()
    return ended, fixed, cycles


def test_u_of_ended_runs_holds_where_cycles_differ() -> None:
    """A unit whose cycles differ by more than the noise: 40 runs."""
    ended, _, cycles = coverage_of_u(2.0, 2.6, 40)
    assert cycles > FEWEST_CYCLES
    assert ended > 0.9


@pytest.mark.nightly
@pytest.mark.parametrize("shared", [0.0, 0.5, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("asked", [2.3, 2.6, 3.5])
def test_u_of_ended_runs_holds_at_its_rate(shared: float, asked: float) -> None:
    """1,000 runs: at least 93 % at the end, and at most 5 % less than of runs that nothing ended."""
    ended, fixed, _ = coverage_of_u(shared, asked, 1000)
    assert 0.93 < ended < 0.99
    assert ended > fixed - 0.05


def coverage_of_repeats(asked_percent: float, runs: int) -> FloatArray:
    """Return coverage of drift and repeatability at the end, and of others as long, of a unit without drift."""
    shared, own, places, most, hits = 0.2, 0.1, 16, 100, []
    true_sd = math.hypot(shared, own)

    def figures(values: FloatArray, *, both: bool = False) -> tuple[float, list[bool]]:
        loops = loops_of(values * FSO_MV / 100.0)
        found = [drift(loops, 0, FSO_MV)]
        halves = [0.5 * (found[0].high - found[0].low)]
        if both or halves[0] <= asked_percent:  # a wide drift alone continues a run
            weights = resampling_weights(len(values), np.random.default_rng(0), 400)
            found.append(repeatability(loops, 0, FSO_MV, weights)["repeatability_percent_fso"])
            halves.append(0.5 * (found[1].high - found[1].low))
        truth = (0.0, true_sd)
        return max(halves), [one.low <= true <= one.high for one, true in zip(found, truth, strict=False)]

    for seed in range(runs):
        rng = np.random.default_rng((seed, 5))
        values, other = (cycles_of(rng, shared, own, most, places) for _ in range(2))
        n = FEWEST_REPEATS
        while n < most and figures(values[:n])[0] > asked_percent:
            n += 1
        hits.append([hit for each in (values, other) for hit in figures(each[:n], both=True)[1]])
    return np.asarray(np.mean(hits, axis=0))


@pytest.mark.nightly
@pytest.mark.parametrize("asked_percent", [1.0, 3.0])
def test_intervals_of_ended_repeatability_runs_hold_at_their_rate(asked_percent: float) -> None:
    """1,000 runs: drift and repeatability at the end in 92 to 98 %, as in runs of the same length."""
    found = coverage_of_repeats(asked_percent, 1000)
    assert ((found > 0.92) & (found < 0.985)).all()


def ended_run(seed: int, plan: Plan = PLAN) -> tuple[float, float, float]:
    """Return time over that of the five cycles, and coverage of new readings by U there and in the middle."""
    run = SimulatedRun(plan, seed=seed)
    analysis, found = run.run_until(0.08, 5)
    assert found.reached
    share = run.time_s / plan.changed(cycles=5).duration_s
    signal, x = run.new_readings()
    read = elongation_reader(analysis).evaluate(signal)
    known = np.isfinite(read.elongation_mm)
    away = np.abs(read.elongation_mm - x)
    middle = np.abs(x - sum(analysis.sensors[0].calibration.x_range) / 2) < 0.6  # type: ignore[union-attr]
    everywhere = (away <= 2.0 * read.standard_uncertainty_mm)[known]
    return share, float(everywhere.mean()), float((away <= found.criteria[0].now)[middle].mean())


def test_a_calibration_ends_in_half_the_time_of_five_cycles() -> None:
    """U of 0.08 mm of the virtual unit on half the levels, and new readings lie within it as often as they should."""
    share, everywhere, middle = ended_run(1, PLAN.changed(step_kpa=18.0))
    assert share < 0.5
    assert 0.93 < everywhere < 0.98
    assert 0.91 < middle < 0.99


@pytest.mark.nightly
def test_ended_calibrations_hold_at_their_rate() -> None:
    """200 runs of the virtual unit: half the time, and 93 to 97 % of new readings within U."""
    share, everywhere, middle = np.mean([ended_run(seed) for seed in range(200)], axis=0)
    assert share < 0.5
    assert 0.93 < everywhere < 0.97
    assert 0.93 < middle < 0.97
