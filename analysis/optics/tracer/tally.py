"""The tally of a simulation: how many rays ended in which way, with which power, and their drawn paths.

Powers are in units of one released ray until the summary divides by their number.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from analysis.compiled import inner, inside
from protocol.base.arrays import FloatArray, IntArray

RELEASED, DETECTED, ESCAPED, TRAPPED, CUT, CORNER, DROPPED, HITS, GRANTED, REFUSED, COUNTS = range(11)
E_DETECTED, E_ESCAPED, E_ABSORBED, E_CUT, ENERGIES = range(5)
LEDGER = ("released", "detected", "escaped", "trapped", "cut", "corner", "dropped")
ENERGY = ("detected", "escaped", "absorbed", "cut")


class Tally(NamedTuple):
    """Tally of a simulation so far."""

    counts: IntArray  # (11,) by the constants above; the last one is the number of drawn points
    energy: FloatArray  # (4,) powers by their end
    by_root: FloatArray  # (rays, 2) detections, and detected power, by the released ray that they stem from
    # drawn, drawn_by: (capacity, 3) position and power of drawn points; (capacity, 2) ray and medium of each
    drawn: FloatArray
    drawn_by: IntArray
    capacity: int  # most points that are drawn


def new_tally(by_root: FloatArray, drawn: FloatArray, drawn_by: IntArray) -> Tally:
    """Return an empty tally over a shared account by released ray."""
    return Tally(np.zeros(COUNTS + 1, dtype=np.int64), np.zeros(ENERGIES), by_root, drawn, drawn_by, len(drawn))


@inside
def clear(tally: Tally) -> None:
    """Empty a tally, but for its account by released ray."""
    for i in range(COUNTS + 1):
        tally.counts[i] = 0
    for i in range(ENERGIES):
        tally.energy[i] = 0.0


@inside
def add_tally(tally: Tally, later: Tally) -> None:
    """Add a later block's tally to the first."""
    for i in range(COUNTS):
        tally.counts[i] += later.counts[i]
    tally.counts[COUNTS] = later.counts[COUNTS]
    for i in range(ENERGIES):
        tally.energy[i] += later.energy[i]


@inside
def add_twins(tally: Tally, followed: int) -> None:
    """Count the mirror images of all that the first `followed` released rays became."""
    for i in range(COUNTS):
        tally.counts[i] *= 2
    for i in range(ENERGIES):
        tally.energy[i] *= 2.0
    for i in range(followed):
        for kind in range(2):
            tally.by_root[2 * followed - 1 - i, kind] = tally.by_root[i, kind]


@inner
def draw(tally: Tally, x: float, y: float, power: float, number: int, medium: int) -> None:
    """Add a point to the drawn path of ray `number`, while there is capacity."""
    n = tally.counts[COUNTS]
    if n < tally.capacity:
        tally.drawn[3 * n], tally.drawn[3 * n + 1], tally.drawn[3 * n + 2] = x, y, power
        tally.drawn_by[2 * n], tally.drawn_by[2 * n + 1] = number, medium
        tally.counts[COUNTS] = n + 1
