"""The published figures against the virtual board's own truth."""

from __future__ import annotations

from analysis import published
from protocol.simulator.specimens import find_specimen


def test_published_sensors_are_the_first_specimens() -> None:
    """Coefficients, noise and range of unit SA1, which protocol and analysis each hold for themselves."""
    first = find_specimen(published.UNIT)
    assert first.range_mm == published.RANGE_MM
    assert [sensor.coefficients for sensor in first.sensors] == [sensor.coefficients for sensor in published.SENSORS]
    assert tuple(sensor.noise_mv for sensor in first.sensors) == published.NOISE_MV
