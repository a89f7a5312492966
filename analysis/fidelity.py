"""How fine everything is computed: draft, normal or reference, chosen in one place.

A level moves every method along its own front of time against error at once. Its numbers are those that the rule of the
trade-off (`analysis.studies.tradeoff.measure.choose`) finds in the measured table with the level's margin; a test
compares them.

Rules: a level sets how fine, never what: geometry, data and seeds are the caller's. What a caller sets explicitly
(rays, a mesh of a file) overrides the level.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from protocol.base.errors import RequestError

Level = Literal["draft", "normal", "reference"]
LEVELS: tuple[Level, ...] = get_args(Level)

MARGINS: dict[Level, float] = {"draft": 0.5, "normal": 2.0, "reference": 10.0}
"""The error, times this, stays below the tolerance of its use: a draft may err by twice that, a reference by a
tenth."""


@dataclass(frozen=True, slots=True)
class Fidelity:
    """One level.

    Parameters
    ----------
    rays : released in one traced scene.
    ranking_rays : released in each scene of a sweep that ranks designs.
    mesh : elements of the shadow's full model: along a cell, across the wall, across the lattice.
    wall_modulus_kpa, neck_radius_mm : the two fitted numbers of the actuator, fitted on that mesh.
    points_a_column : looked at for each column of pixels of a live curve, of which the extremes are painted.
    """

    level: Level
    rays: int
    ranking_rays: int
    mesh: tuple[int, int, int]
    wall_modulus_kpa: float
    neck_radius_mm: float
    table: tuple[int, int, int]
    walkers: int
    posterior_samples: int
    resamples: int
    points_a_column: int


_LEVELS = {
    "draft": Fidelity("draft", 50, 2_500, (6, 2, 3), 1371.6899, 4.14997, (5, 5, 4), 64, 4_000, 100, 8),
    "normal": Fidelity("normal", 250, 5_000, (8, 2, 4), 1320.9, 4.277, (7, 7, 8), 64, 4_000, 2_000, 16),
    "reference": Fidelity(
        "reference", 1_000, 25_000, (12, 3, 6), 1299.6276, 4.31579, (7, 7, 8), 128, 32_000, 50_000, 64
    ),
}


def fidelity(level: str = "normal") -> Fidelity:
    """Return a level by its name.

    Raises
    ------
    RequestError : there is no such level.
    """
    if level not in _LEVELS:
        raise RequestError(f"there is no fidelity {level!r}", f"choose among {', '.join(LEVELS)}")
    return _LEVELS[level]
