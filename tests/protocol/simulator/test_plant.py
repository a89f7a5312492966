"""Pneumatics, body and sensors: what each does, and where it must not depend on the cut."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.simulator.plant import PUMP_KPA_PER_S, TICK_S, Body, Pneumatics, Sensors, cubic
from protocol.simulator.specimens import find_specimen

SA1 = find_specimen("SA1")


def pressures(pneumatics: Pneumatics, seconds: float) -> np.ndarray:
    """Gauge pressure after each tick of a stretch without noise."""
    values = []
    for _ in range(round(seconds / TICK_S)):
        pneumatics.step(0.0)
        values.append(pneumatics.pressure_kpa)
    return np.array(values)


@pytest.mark.parametrize("target", [50.0, -40.0])
def test_target_is_reached_with_a_small_overshoot(target):
    """The pressure follows the ramp with a lag, overshoots by less than a kPa, and stays."""
    pneumatics = Pneumatics()
    pneumatics.command(target, 10.0)
    way = pressures(pneumatics, abs(target) / 10.0 + 5.0) / target
    halfway = round(abs(target) / 20.0 / TICK_S)
    assert 0.4 < way[halfway] < 0.5  # behind the setpoint
    assert 1.0 < way.max() < 1.0 + 1.0 / abs(target)
    assert abs(way[-1] - 1.0) * abs(target) < 0.01


def test_ramp_zero_is_as_fast_as_the_pumps_go():
    """Ramp 0, and any ramp beyond the pumps, is the pumps' own rate."""
    ways = []
    for ramp in (0.0, 1000.0, PUMP_KPA_PER_S):
        pneumatics = Pneumatics()
        pneumatics.command(50.0, ramp)
        ways.append(pressures(pneumatics, 3.0))
    np.testing.assert_array_equal(ways[0], ways[1])
    np.testing.assert_array_equal(ways[0], ways[2])
    assert np.diff(ways[0]).max() / TICK_S < 1.2 * PUMP_KPA_PER_S


def test_vent_empties():
    """The open valve brings any pressure to ambient within two seconds, and a standing pump keeps it there."""
    pneumatics = Pneumatics()
    pneumatics.command(50.0, 0.0)
    pressures(pneumatics, 5.0)
    pneumatics.vent()
    assert abs(pressures(pneumatics, 2.0)[-1]) < 0.05


def test_leak_behind_the_gauge_affects_only_the_bladder():
    """At 6 % a minute the gauge keeps its 50 kPa and the bladder has lost 3 kPa after a minute, to first order."""
    pneumatics = Pneumatics()
    pneumatics.command(50.0, 0.0)
    pressures(pneumatics, 10.0)
    pneumatics.leak_per_s = 0.06 / 60
    pressures(pneumatics, 60.0)
    assert pneumatics.pressure_kpa == pytest.approx(50.0, abs=0.01)
    assert pneumatics.bladder_kpa == pytest.approx(50.0 * np.exp(-0.06), abs=0.01)


def test_failed_pump_and_stall():
    """With failed pumps the pressure does not rise; with stalling pumps it rises to their limit."""
    dead, weak = Pneumatics(), Pneumatics()
    dead.pump_works = False
    weak.reach_kpa = (-30.0, 30.0)
    for pneumatics in (dead, weak):
        pneumatics.command(50.0, 0.0)
    assert abs(pressures(dead, 5.0)[-1]) < 1e-9
    assert pressures(weak, 5.0)[-1] == pytest.approx(30.0, abs=0.01)


def test_creep_comes_late_and_in_full():
    """Of a step's elongation 0.7 % comes late; in the end the hysteresis operator's value is reached."""
    step = np.full(20_000, 40.0)
    elongation = Body(SA1.actuator).advance(step)
    late = 1.0 - elongation[0] / elongation[-1]
    assert late == pytest.approx(sum(share for share, _ in SA1.actuator.creep), rel=0.02)
    assert (np.diff(elongation) >= 0.0).all()


@given(st.lists(st.floats(-45.0, 55.0), min_size=1, max_size=80), st.lists(st.integers(0, 80), max_size=5))
def test_body_and_sensors_do_not_depend_on_the_cut(pressure, cuts):
    """The same pressures in other blocks give the same elongation and signal bit for bit."""

    def run(blocks: list[np.ndarray]) -> np.ndarray:
        body, sensors = Body(SA1.actuator), Sensors(SA1.sensors, SA1.range_mm)
        return np.concatenate([sensors.advance(body.advance(block)) for block in blocks if block.size])

    values = np.array(pressure)
    places = sorted(cut % (values.size + 1) for cut in cuts)
    np.testing.assert_array_equal(run([values]), run(np.split(values, places)))


def test_sensor_loop_is_a_lens_about_the_cubic():
    """On a full cycle the loop closes at both ends, is widest in the middle, and its branches average to the cubic."""
    low, high = SA1.range_mm
    way = np.concatenate([np.linspace(high, low, 1001), np.linspace(low, high, 1001)])
    sensors = Sensors(SA1.sensors, SA1.range_mm)
    for _ in range(3):
        signal = sensors.advance(way)
    falling, rising = signal[:1001][::-1], signal[1001:]
    for number, sensor in enumerate(SA1.sensors):
        width = falling[:, number] - rising[:, number]
        middle = (falling[:, number] + rising[:, number]) / 2
        truth = cubic(sensor.coefficients, way[1001:])
        assert width[500] == pytest.approx(2 * sensor.loop_mv, rel=1e-3)
        assert abs(width[0]) < 1e-9
        assert abs(width[-1]) < 1e-9
        assert np.abs(middle - truth).max() < 0.1 * abs(sensor.loop_mv)
