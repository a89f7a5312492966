"""States held by pressure and elongation whose equilibrium is not stable, off the nominal curve.

A test takes 30 ms and there are some hundred places: those of the default actuator come with its table, found by
`tests/analysis/shadow/make_default_table.py`.
"""

from __future__ import annotations

Place = tuple[int, int]  # steps of pressure and elongation
HELD_KPA, HELD_MM = 1.0, 0.5  # steps of the states tested
HELD_BELOW_KPA = -20.0  # only vacuum,
HELD_OFF_MM = 1.0  # and only a tip held off its nominal place, can be unstable


def place_of(pressure_kpa: float, elongation_mm: float) -> Place:
    """Return the place of the table that a state is at."""
    return round(pressure_kpa / HELD_KPA), round(elongation_mm / HELD_MM)


def can_be_unstable(pressure_kpa: float, deviation_mm: float) -> bool:
    """Return whether a state with its tip so far off its nominal place can be unstable."""
    return pressure_kpa <= HELD_BELOW_KPA and abs(deviation_mm) >= HELD_OFF_MM
