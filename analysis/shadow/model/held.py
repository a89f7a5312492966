"""States held by pressure and elongation whose equilibrium is not stable, off the nominal curve.

A test takes 30 ms and there are some hundred places: those of the default actuator come with its table.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from analysis.shadow.model.frames import Shadow

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


def unstable_places(shadow: Shadow, steps: Iterable[int]) -> frozenset[Place]:
    """Return the unstable places at these steps of pressure."""
    table, found = shadow.table, set()
    lowest, highest = (float(mm) / HELD_MM for mm in table.elongation_range_mm)
    places = np.arange(math.floor(lowest), math.ceil(highest) + 1, dtype=np.float64)
    for step in steps:
        pressure = step * HELD_KPA
        nominal = float(table.nominal_elongation(np.array(pressure))[0])
        mm: NDArray[np.float64] = places * HELD_MM
        held = table.holds(np.full(mm.shape, pressure), mm)
        near = np.abs(mm - nominal) < HELD_OFF_MM - HELD_MM / 2
        for place in places[held & ~near].astype(int).tolist():
            solution, _ = shadow.solution(pressure_kpa=pressure, elongation_mm=place * HELD_MM)
            if shadow.model.stability.unstable_mode(solution) is not None:
                found.add((step, place))
    return frozenset(found)


def vacuum_steps(shadow: Shadow) -> range:
    """Return the steps of pressure at which a held state can be unstable."""
    lowest = math.floor(float(shadow.table.pressure_range_kpa[0]) / HELD_KPA)
    return range(lowest, math.floor(HELD_BELOW_KPA / HELD_KPA) + 1)
