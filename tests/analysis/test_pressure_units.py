"""Pressure units of imported files against those of device profiles."""

from __future__ import annotations

import pytest

from analysis.pressure_units import KPA_PER_UNIT
from protocol.text.profile import PA_PER_UNIT


@pytest.mark.parametrize("unit", sorted(PA_PER_UNIT))
def test_factors_are_those_of_device_profiles(unit: str) -> None:
    """A unit means the same pressure in a CSV and in a device profile."""
    assert KPA_PER_UNIT[unit] == pytest.approx(PA_PER_UNIT[unit] / 1000.0, rel=1e-12)
