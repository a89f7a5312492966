"""How long a benchmark runs: whole by `make bench`, which sets `BOAT_BENCH`; else shortened, as one of the daily tests.

Figures of a shortened run mean nothing: it shows that the benchmark still runs.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from analysis.shadow.model.frames import Shadow

Value = TypeVar("Value")
WHOLE = "BOAT_BENCH" in os.environ


def length(whole: Value, shortened: Value) -> Value:
    """Return a number of repeats, a size or a time."""
    return whole if WHOLE else shortened


def benchmark_shadow() -> Shadow:
    """Return the default shadow; shortened, one of two bladders on a coarse mesh."""
    from analysis.shadow.fem.parameters import ActuatorParameters
    from analysis.shadow.model.frames import Shadow
    from analysis.shadow.model.reduced import TableSettings
    from analysis.shadow.model.table import build_table

    if WHOLE:
        return Shadow()
    small = ActuatorParameters(cells=2, axial_elements=6, wall_elements=1, lattice_elements=3)
    return Shadow(small, build_table(small, TableSettings(3, 3, 2, 1)))
