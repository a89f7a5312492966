"""Jobs of the shadow: build its table and compiled code, and find its unstable held states.

The libraries are imported inside the functions: the window imports this module, and loads or looks up the results.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from analysis.fidelity import fidelity

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


def shadow_of(
    level: str = "normal",
    *,
    progress: Callable[[float, float], None] | None = None,
) -> Shadow:
    """Return the shadow at a level of precision; table and compiled code are loaded from the cache, or built."""
    from analysis.shadow.model.frames import Shadow, actuator, table_settings
    from analysis.shadow.model.table import load_table

    chosen = fidelity(level)
    parameters = actuator(chosen)
    shadow = Shadow(parameters, load_table(parameters, table_settings(chosen), progress=progress))
    shadow.state(pressure_kpa=20.0, elongation_mm=1.0)  # compiled now, not in the first frame
    return shadow


def warm(
    level: str = "normal",
    *,
    progress: Callable[[float, float], None] | None = None,
) -> None:
    """Build table and compiled code, or load them from the cache; parameters as `shadow_of`."""
    shadow_of(level, progress=progress)


def unstable_held_states(level: str = "normal") -> frozenset[Place]:
    """Return the places of the table under vacuum whose equilibrium is not stable, off the nominal curve.

    30 ms a place and some hundred places: too much for the window's interpreter, even on another thread.
    """
    shadow = shadow_of(level)
    lowest = math.floor(float(shadow.table.pressure_range_kpa[0]) / HELD_KPA)
    return unstable_places(shadow, range(lowest, math.floor(HELD_BELOW_KPA / HELD_KPA) + 1))


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
