"""What a flickering lamp leaves in signals, against the lamp that was put in and against random phases of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis import Options, analyse
from analysis.calibration.joint_fit import PolynomialBasis, PositionMeans, greatest_loop_width, joint_fit
from analysis.data.recording import Recording
from analysis.figures.pipeline import Analysis
from boat_daq.commands.demo import truth_of
from boat_daq.engine.plan import load_plan
from protocol.base.arrays import FloatArray
from tests.analysis.boat_builder import Plant, Staircase
from tests.analysis.stopping.simulated_run import SimulatedRun

QUICK = Options(mcmc=False, fidelity="draft")
LIGHT_MV, REMAINS_MV, PERIOD_S = 5.0, 0.3, 9.0
DARK_NOISE_MV = 0.5
LSB_MV = 3300 / 4096


def under_a_lamp(recording: Recording, period_s: float, remains_mv: float) -> tuple[Recording, FloatArray]:
    """Return a run whose dark readings show a slow wave, its signals a quarter of a period on, and that part."""
    phase = 2.0 * np.pi * recording.time_s / period_s
    noise = DARK_NOISE_MV * np.random.default_rng(3).standard_normal((recording.n, recording.n_sensors))
    light_mv = 120.0 + LIGHT_MV * np.sin(phase)[:, None] + noise
    dark = np.rint(light_mv / LSB_MV).astype(np.uint16)
    lit = np.rint((recording.signal_mv + light_mv) / LSB_MV).astype(np.uint16)
    remains = remains_mv * np.cos(phase)
    return replace(recording, dark=dark, lit=lit, signal_mv=recording.signal_mv + remains[:, None]), remains


@pytest.fixture(scope="module")
def staircase() -> Recording:
    return Staircase(Plant(rate_hz=50.0), dwell_s=1.6).recording()


def ambient_errors(run: Analysis, remains: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the error of each plateau, mV, as it is found, and as it was put in: the mean of its position."""
    used = np.asarray([i for i, p in enumerate(run.plateaus) if p.cycle in run.loops.numbers])
    wave = np.asarray([remains[run.plateaus[i].settled_first : run.plateaus[i].last + 1].mean() for i in used])
    _, place = np.unique(run.position_of(used), return_inverse=True)
    return run.ambient_mv[:, used], (np.bincount(place, wave) / np.bincount(place))[place]


def test_what_remains_of_a_lamp_is_found_with_its_signs(staircase: Recording) -> None:
    """Size and signs are those that were put in; a sensor's share of the light is that of the other."""
    recording, remains = under_a_lamp(staircase, PERIOD_S, REMAINS_MV)
    found, put_in = ambient_errors(analyse(recording, options=QUICK), remains)
    for of_sensor in found:
        assert abs(np.corrcoef(of_sensor, put_in)[0, 1]) > 0.98
        assert np.linalg.norm(of_sensor) == pytest.approx(np.linalg.norm(put_in), rel=0.35)


def test_without_light_that_changes_nothing_is_added(staircase: Recording) -> None:
    """Dark readings of noise alone, and a source without them, leave every interval as it is."""
    constant, _ = under_a_lamp(staircase, 1e12, 0.0)
    assert not analyse(constant, options=QUICK).ambient_mv.any()
    assert not analyse(staircase, options=QUICK).ambient_mv.any()


def test_a_lamp_widens_the_interval_of_the_systems_loop(staircase: Recording) -> None:
    """By the error of the difference of two branches, and it does not move the figure."""
    recording, _ = under_a_lamp(staircase, PERIOD_S, REMAINS_MV)
    bare = replace(recording, dark=None, lit=None)
    lit, dark = (
        analyse(one, options=QUICK).sensors[0].figures["system_hysteresis_percent_fso"] for one in (recording, bare)
    )
    assert lit.value == dark.value
    assert lit.high - lit.low > dark.high - dark.low


def test_shared_error_of_positions_is_propagated_with_its_signs() -> None:
    """Covariance, draws and width of the loop are those of 4,000 fits to means that one cause moves together."""
    rng = np.random.default_rng(1)
    x = np.linspace(-2.7, 3.8, 10)
    x, branch = np.concatenate([x, x[1:-1]]), np.concatenate([[0.0], np.ones(8), [0.0], -np.ones(8)])
    y, shared = 40.0 * x - 2.0 * x**2, 0.2 * np.cos(1.1 * np.arange(18))
    means = PositionMeans(x, y, branch, np.zeros(18), np.full(18, 0.01), 72)
    fit = joint_fit(means.with_shared(shared, np.arange(18)), PolynomialBasis(3))
    errors = 0.1 * rng.standard_normal((4000, 18)) + rng.standard_normal((4000, 1)) * shared
    moved = errors @ fit.influence.T
    assert np.sqrt(np.diag(fit.covariance)) == pytest.approx(moved.std(axis=0), rel=0.05)
    drawn, _ = fit.draws(rng, 4000)
    assert drawn.std(axis=0) == pytest.approx(moved.std(axis=0)[:4], rel=0.05)
    alone = joint_fit(replace(means, y_variance=means.y_variance + shared**2), PolynomialBasis(3))
    assert fit.coefficients == pytest.approx(alone.coefficients)
    wide, narrow = (greatest_loop_width(each, np.random.default_rng(0)) for each in (fit, joint_fit(means, fit.basis)))
    assert wide.high - wide.width > narrow.high - narrow.width


@pytest.mark.nightly
def test_intervals_hold_the_truth_under_the_virtual_boards_flicker() -> None:
    """Of 20 runs of five cycles, full scale and system hysteresis: bootstrap and scatter alone held 90 and 8 %."""
    plan = load_plan("calibration")
    truth, held = truth_of("SA1", plan), []
    for seed in range(20):
        run = SimulatedRun(plan, seed=seed)
        for _ in range(plan.cycles):
            run.run_cycle()
        analysis = analyse(run.recording(), options=QUICK)
        for sensor, true in zip(analysis.sensors, truth.sensors, strict=True):
            figures = [(sensor.figures[key], getattr(true, key)) for key in ("fso_mv", "system_hysteresis_percent_fso")]
            held += [figure.low <= value <= figure.high for figure, value in figures]
    assert np.mean(held) > 0.85
