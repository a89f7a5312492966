"""The controller without a board: bumpless start, limits, lost sensors, and what stops it."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.elongation_control.controller import Bounds, ElongationController, StopCode
from analysis.elongation_control.measurement import SensorWatch
from protocol.base.errors import RequestError
from tests.analysis.twin_unit import STEP_MV, identified, regulator, swings

WIDE = (-40.0, 50.0)


def signals(mm: float, n: int = 4, *, noise_mv: float = 1.0, seed: int = 0) -> np.ndarray:
    """Return n samples of SA1's signals at an elongation."""
    curves = [inverse.calibration.predict(np.array([mm]))[0] for inverse in identified("SA1")[1].inverses]
    return np.array(curves) + np.random.default_rng(seed).normal(0.0, noise_mv, (n, 2))


def begun(controller: ElongationController, mm: float = 0.5, pressure_kpa: float = 8.0) -> ElongationController:
    controller.begin(0.0, pressure_kpa, signals(mm))
    return controller


def steps(controller: ElongationController, target: float, *samples: np.ndarray) -> list:
    return [
        controller.advance(0.04 * k, 0.04 * k - 0.02, (target, 0.0, 0.0), sample, WIDE)
        for k, sample in enumerate(samples, 1)
    ]


def test_first_pressure_is_the_one_before_the_start():
    found = steps(begun(regulator(), 0.5, 8.0), 0.5, signals(0.5))
    assert found[0].pressure_kpa == pytest.approx(8.0, abs=0.3)


def test_pressure_keeps_limits_and_ramp_and_the_integrator_does_not_wind_up():
    controller = begun(regulator(bounds=Bounds(follow_s=100.0)))
    stuck = [signals(0.5, seed=k) for k in range(250)]  # nothing moves: a leak
    found = steps(controller, 3.5, *stuck)
    pressures = [out.pressure_kpa for out in found]
    assert max(pressures) <= WIDE[1]
    assert 30.0 < max(out.ramp_kpa_per_s for out in found) <= 36.0
    assert np.abs(np.diff(pressures)).max() <= 36.0 * 0.04 + 1e-9
    back = controller.advance(10.04, 10.02, (0.5, 0.0, 0.0), signals(3.5), WIDE)
    assert back.pressure_kpa < pressures[-1]  # it leaves the limit at once


def test_setpoint_outside_the_calibrated_range_is_refused():
    with pytest.raises(RequestError, match="outside the calibrated range"):
        regulator().check(6.0)


def test_start_without_a_known_elongation_is_refused():
    with pytest.raises(RequestError, match="no sensor gives an elongation"):
        regulator().begin(0.0, 0.0, np.zeros((4, 2)))


@pytest.mark.parametrize(
    ("offset_mv", "bounds", "code"),
    [
        ((0.0, 25.0), Bounds(), StopCode.DISAGREEMENT),
        ((0.0, 60.0), Bounds(), StopCode.DISAGREEMENT),  # just outside its range
        ((-900.0, -900.0), Bounds(), StopCode.UNKNOWN),
        ((0.0, 0.0), Bounds(u_mm=0.02), StopCode.UNCERTAIN),
        ((40.0, 29.0), Bounds(follow_s=0.5), StopCode.NOT_FOLLOWING),
    ],
)
def test_what_cannot_be_controlled_stops_with_a_cause(offset_mv, bounds, code):
    controller = begun(regulator(bounds=bounds))
    found = steps(controller, 0.5, *[signals(0.5, seed=k) + offset_mv for k in range(40)])
    stopped = next(out for out in found if out.stop is not None)
    assert stopped.stop is code
    assert stopped.cause and stopped.remedy
    assert found[0].stop is None  # one period is no reason


@pytest.mark.parametrize(("share", "stops"), [(1.02, False), (0.98, True)])
def test_control_stops_where_u_exceeds_its_bound(share, stops):
    """The bound is the one given: 2 % more than the uncertainty there is allowed, 2 % less is not."""
    there = max(out.u_mm for out in steps(begun(regulator()), 0.5, *[signals(0.5, seed=k) for k in range(40)]))
    controller = begun(regulator(bounds=Bounds(u_mm=share * there)))
    found = steps(controller, 0.5, *[signals(0.5, seed=k) for k in range(40)])
    assert {out.stop for out in found} - {None} == ({StopCode.UNCERTAIN} if stops else set())


def test_a_saturated_or_frozen_sensor_is_lost_once_and_the_other_carries_on():
    for spoil in (lambda s: s * [0.0, 1.0], lambda s: np.column_stack([np.full(len(s), 1674.0), s[:, 1]])):
        controller = begun(regulator())
        found = steps(controller, 0.5, *[spoil(signals(0.5, seed=k)) for k in range(30)])
        assert [out.lost for out in found if out.lost] == [(1,)]
        assert found[-1].stop is None
        assert found[-1].elongation_mm == pytest.approx(0.5, abs=0.1)


def test_a_steady_signal_of_a_coarse_converter_is_no_loss():
    watch = SensorWatch(identified("SA1")[1], step_mv=50.0)
    assert all(not watch.measure(np.full((4, 2), [1674.0, 1640.0]), 0.04).lost for _ in range(30))


def test_samples_that_are_not_usable_do_not_stop_a_loop_at_once():
    found = steps(begun(regulator()), 0.5, np.full((4, 2), np.nan), signals(0.5))
    assert [out.stop for out in found] == [None, None]


def test_identified_range_and_step_of_the_converter_are_those_of_the_unit():
    low, high = regulator().sensors.range_mm
    assert low == pytest.approx(swings("SA1")[1][1000:].min(), abs=0.05)
    assert high == pytest.approx(3.8, abs=0.05)
    assert STEP_MV < 1.0
