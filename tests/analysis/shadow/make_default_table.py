"""Make the table of the default actuator: `python -m tests.analysis.shadow.make_default_table`.

It takes about twenty seconds of processor time. `test_table.py` compares a part of it with new solutions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.frames import Shadow
from analysis.shadow.model.held import HELD_BELOW_KPA, HELD_KPA, HELD_MM, HELD_OFF_MM, Place
from analysis.shadow.model.reduced import TableSettings
from analysis.shadow.model.table import DEFAULT_TABLE, build_table, table_arrays, table_digest, write_arrays


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


def main() -> None:
    """Build the table and its unstable held states, and write both."""
    table = build_table()
    unstable = unstable_places(shadow := Shadow(table=table), vacuum_steps(shadow))
    digest = table_digest(ActuatorParameters(), TableSettings())
    arrays = table_arrays(table) | {"unstable": np.array(sorted(unstable)), "digest": np.array(digest)}
    write_arrays(DEFAULT_TABLE, arrays)


if __name__ == "__main__":
    main()
