"""Pressure units of imported files and of device profiles: one table."""

from __future__ import annotations

import pytest

from protocol.pressure_units import KPA_PER_UNIT
from protocol.text.profile import PA_PER_UNIT

PA = {"Pa": 1.0, "hPa": 100.0, "mbar": 100.0, "kPa": 1e3, "bar": 1e5, "psi": 6894.757293168}


@pytest.mark.parametrize("unit", PA)
def test_factors_are_those_of_device_profiles(unit: str) -> None:
    """A unit means the same pressure in a CSV and in a device profile."""
    assert PA_PER_UNIT[unit] == pytest.approx(PA[unit], rel=1e-12)
    assert KPA_PER_UNIT[unit.lower()] == pytest.approx(PA[unit] / 1000.0, rel=1e-12)


def test_a_pascal_is_exact() -> None:
    """A pressure in Pa stays the whole number that it is."""
    assert (PA_PER_UNIT["Pa"], set(PA_PER_UNIT)) == (1.0, set(PA))
