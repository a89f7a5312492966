"""The controller without a board: bumpless start, limits, lost sensors, and what stops it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from analysis.elongation_control.controller import Bounds, ElongationController, StopCode, Tuning
from analysis.elongation_control.dynamics import Lag
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
    assert [out.saturated for out in found[100:]] == [True] * 150
    # and as if it had never been there: what lies ahead of the present elongation is that of its own correction
    freed = [controller.advance(10.04 + t, 10.02 + t, (3.0, 0, 0), signals(3.0), WIDE) for t in 0.04 * np.arange(1, 76)]
    assert freed[-1].pressure_kpa < WIDE[1] - 1.0


def test_a_step_is_a_critically_damped_one_and_a_followed_setpoint_is_taken_as_it_is():
    """Against (1 + w t) exp(-w t) of a step that needs no full ramp; from rest, and after a pause of the caller."""
    w = regulator().tuning.shape_rad_per_s
    for times in (0.04 * np.arange(1, 40), np.array([0.04, 0.3, 0.5, 0.9])):
        controller = begun(regulator())
        found = [controller.advance(t, t - 0.02, (0.55, 0, 0), signals(0.5), WIDE).setpoint_mm for t in times]
        left = (1 + w * times) * np.exp(-w * times)
        at = controller._past[0][1]
        np.testing.assert_allclose(found, 0.55 - (0.55 - at) * left, atol=0.03 * (0.55 - at))
    assert controller.advance(0.94, 0.92, (0.7, 0.2, 0.0), signals(0.5), WIDE, shaped=False).setpoint_mm == 0.7
    after = controller.advance(0.98, 0.96, (0.704, 0.0, 0.0), signals(0.5), WIDE)  # the ramp ends where it has arrived
    assert after.setpoint_mm == 0.704


def test_gains_of_an_identified_lag_and_of_none():
    """The feed-forward inverts s**2 / w**2 + 2 z s / w + 1; without a step test nothing leads, and margins are wide."""
    slow, late = Tuning.of(Lag(0.02, 5.0, 0.5), 36.0), Tuning.of(Lag(0.25, 20.0, 0.5), 36.0)
    assert slow.lead_s2 == pytest.approx(1 / 5.0**2)
    assert slow.shape_rad_per_s == pytest.approx(0.6 * 5.0)  # limited by the plant
    assert late.shape_rad_per_s == pytest.approx(0.35 / 0.25)  # limited by the delay
    found = Tuning.cautious()
    assert (found.lead_s, found.lead_s2, found.lag) == (0.0, 0.0, None)
    assert 1.5 <= found.shape_rad_per_s <= 2.5
    at = next(w for w in np.arange(0.4, 0.6, 1e-5) if 0.5 / w * 25.0 / (25.0 + w**2) <= 1.0)  # |loop| = 1: 5/s, z = 1
    closed_deg = 90.0 - 2.0 * math.degrees(math.atan(at / 5.0)) - math.degrees(at * (0.1 + 0.04))
    assert found.margins.phase_deg == pytest.approx(closed_deg, abs=0.5)


def test_a_late_period_counts_as_two_at_most():
    """The integrator after 40 ms, 80 ms and 1 s without samples."""
    grown = []
    for late_s in (0.04, 0.08, 1.0):
        controller = begun(regulator())
        controller.advance(0.04, 0.02, (0.5, 0.0, 0.0), signals(0.5), WIDE, shaped=False)
        before = controller._offset
        at_s, seen = 0.04 + late_s, signals(0.45, noise_mv=0.0)
        controller.advance(at_s, at_s - 0.02, (0.5, 0.0, 0.0), seen, (-1e9, 1e9), shaped=False)
        grown.append(controller._offset - before)
    assert grown == pytest.approx([grown[0], 2.0 * grown[0], 2.0 * grown[0]], rel=1e-6)
    assert grown[0] > 0.0
    assert math.isfinite(controller.advance(at_s, at_s, (0.5, 0.0, 0.0), seen, WIDE).pressure_kpa)  # no time at all


def test_setpoint_outside_the_calibrated_range_is_refused():
    controller = regulator()
    for mm in controller.sensors.range_mm:
        controller.check(mm)
    with pytest.raises(RequestError, match="outside the calibrated range"):
        controller.check(6.0)


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


@pytest.mark.parametrize(("lever", "code"), [(0.96, None), (1.04, StopCode.UNCERTAIN)])
def test_default_bounds_are_those_of_the_documents(lever, code):
    """U of 0.8 mm; a deviation of 0.5 mm for 3 s: at rest nothing stops for 4 s."""
    controller = begun(regulator())
    plain = controller.sensors.measure

    def measure(signal_mv, dt_s):
        return dataclasses.replace(plain(signal_mv, dt_s), u_mm=0.8 * lever)

    controller.sensors.measure = measure
    assert {out.stop for out in steps(controller, 0.5, *[signals(0.5, seed=k) for k in range(100)])} == {None} | {code}


def test_samples_that_are_not_usable_do_not_stop_a_loop_at_once():
    found = steps(begun(regulator()), 0.5, np.full((4, 2), np.nan), signals(0.5))
    assert [out.stop for out in found] == [None, None]


def test_identified_range_and_step_of_the_converter_are_those_of_the_unit():
    low, high = regulator().sensors.range_mm
    assert low == pytest.approx(swings("SA1")[1][1000:].min(), abs=0.05)
    assert high == pytest.approx(3.8, abs=0.05)
    assert STEP_MV < 1.0
