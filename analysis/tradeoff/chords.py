"""A scene with its arcs replaced by chords: what other ray tracers do, and what it costs in truth.

The scene becomes a bag of straight surfaces without cells, in which every ray searches the tree of boxes. With a length
of 0 the exact arcs are put into the same bag, so that arcs and chords can be timed by the same search, and the walk
from cell to cell checked against it.
"""

from __future__ import annotations

import math

import numpy as np

from analysis.arrays import FloatArray
from analysis.errors import RequestError
from analysis.optics.scene.bvh import plant
from analysis.optics.scene.frame import CORNER_A, CORNER_B, NOTHING, Frame
from analysis.optics.scene.geometry import Geometry, allocate, geometry_of
from analysis.optics.scene.parameters import Design

_SHORTEST_MM = 1e-3


def bag_of(frame: Frame, design: Design, chord_mm: float = 0.0) -> Geometry:
    """The surfaces of a scene without its cells.

    Parameters
    ----------
    chord_mm : every arc becomes equal chords of at most this length between points on it; 0 keeps the arcs.

    Raises
    ------
    RequestError : a length below 0, or so small that the scene would not fit into memory.
    """
    if not (chord_mm == 0.0 or _SHORTEST_MM <= chord_mm < math.inf):
        raise RequestError(f"chords of {chord_mm:g} mm", f"choose {_SHORTEST_MM:g} mm or more, or 0 for the exact arcs")
    g = geometry_of(frame, design)
    kept = np.flatnonzero(g.kinds != NOTHING)
    order = g.leaves[: len(kept)]
    parts = [_chords(g.surfaces[i], int(g.corners[i]), chord_mm) for i in order]
    counts = [len(rows) for rows, _ in parts]
    bag = allocate(0, sum(counts), 0)
    bag.surfaces[:] = np.concatenate([rows for rows, _ in parts])
    bag.corners[:] = np.concatenate([corners for _, corners in parts])
    bag.kinds[:], bag.owners[:] = np.repeat(g.kinds[order], counts), 0
    bag.leaves[:] = np.arange(len(bag.leaves))
    return bag._replace(tree_nodes=plant(bag.surfaces, bag.leaves, len(bag.leaves), bag.boxes, bag.branches))


def _chords(row: FloatArray, corners: int, length_mm: float) -> tuple[FloatArray, FloatArray]:
    """One surface as rows of straight ones, and which of their ends are corners."""
    bend, chord = row[4] * row[7], row[12:14] - row[8:10]
    half = float(np.hypot(*chord)) / 2
    if length_mm == 0.0 or abs(bend) * half < 1e-12:
        return row[None], np.array([corners & (CORNER_A | CORNER_B)])
    turn = 2 * math.asin(bend * half)
    n = max(1, math.ceil(turn / bend / length_mm))
    part = (np.arange(n + 1) / n - 0.5) * turn
    along = chord / (2 * half)
    across = np.array([-along[1], along[0]])
    points = (row[8:10] + row[12:14]) / 2 + (
        np.sin(part)[:, None] * along + (math.cos(turn / 2) - np.cos(part))[:, None] * across
    ) / bend
    points[0], points[-1] = row[8:10], row[12:14]
    way = np.diff(points, axis=0)
    way /= np.hypot(way[:, 0], way[:, 1])[:, None]
    out = np.zeros((n, len(row)))
    out[:, :2], out[:, 2], out[:, 3], out[:, 6], out[:, 7] = points[:-1], -way[:, 1], way[:, 0], row[6], 1.0
    out[:, 8:10], out[:, 10:12], out[:, 12:14], out[:, 14:16] = points[:-1], way, points[1:], way
    marks = np.zeros(n, dtype=np.int64)
    marks[0] |= corners & CORNER_A
    marks[-1] |= corners & CORNER_B
    return out, marks
