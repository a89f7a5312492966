"""One design in one state as arrays for the tracer, built inside the compiled part.

Strategy: a guide is a row of **cells** between straight cross-sections, cut at the joints of its arcs and at the
cavities' walls. In a cell both edges are concentric arcs (or parallel lines), so that a ray inside meets one of two
edges or goes on to the next cell: no search. A cavity is a run of cells with one edge moved inwards; its walls lie in
the cross-sections. Rays in the air search a tree of boxes over all surfaces.

Surfaces are numbered 4 c + 0, 1, 2, 3 for cell c's left edge, right edge, start wall and end wall (absent ones have
kind 0), then the junctions' surfaces from `frame.py`, whose row of 16 numbers they share.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from analysis.arrays import FloatArray, IntArray
from analysis.optics.compiled import compiled, pointer
from analysis.optics.scene.bvh import plant
from analysis.optics.scene.frame import CORNER_A, CORNER_B, FREE, INTERFACE, NO_CELL, NOTHING, RECEIVER, Frame
from analysis.optics.scene.parameters import Design

# columns of a cell: reference point and normal of its arc, curvature, levels of both edges, the two cross-sections
# (point and tangent each), offsets of both edges, 1 / |grad f| on both
C_LEVEL_L, C_LEVEL_R, C_START, C_END, C_LEFT, C_RIGHT, C_INVERSE_L, CELL_COLUMNS = 5, 6, 7, 11, 15, 16, 17, 19
SURFACE_COLUMNS = 16
# columns of a cell's links: cell before, cell after, wall before, wall after (0 or 1), arc it lies on
BEFORE, AFTER, WALL_BEFORE, WALL_AFTER, ARC, LINK_COLUMNS = range(6)
# columns of a cavity: its first and last cell, its side (0 left, 1 right), 1 if its mouth is free
POCKET_COLUMNS, NO_POCKET = 4, -1
_SLIVER = 1e-9


class Geometry(NamedTuple):
    """Arrays of one scene: cells (c, 19), links (c, 5), surfaces (n, 16), kinds, owners, corners (n,), pockets (p, 4),
    doors (2, 2), boxes (t, 4) as centre and half size, branches (t, 3), leaves (n,), and the lengths c, n and t.

    A surface's owner is the cavity it bounds or NO_POCKET; that of a junction's surface is the junction.
    """

    cells: FloatArray
    links: IntArray
    surfaces: FloatArray
    kinds: IntArray
    owners: IntArray
    corners: IntArray
    pockets: IntArray
    doors: IntArray
    boxes: FloatArray
    branches: IntArray
    leaves: IntArray
    most_cells: int
    all_surfaces: int
    tree_nodes: int


@compiled
def _section(nodes: FloatArray, curvature: FloatArray, arc: int, s: float, out: FloatArray) -> None:
    """Write point and tangent of the centreline at arc length `s` of one arc to out[:4]."""
    if s == nodes[arc + 1, 4]:
        out[0], out[1], out[2], out[3] = nodes[arc + 1, 0], nodes[arc + 1, 1], nodes[arc + 1, 2], nodes[arc + 1, 3]
        return
    step = s - nodes[arc, 4]
    turn = curvature[arc] * step
    tx, ty = nodes[arc, 2], nodes[arc, 3]
    if abs(turn) > 1e-9:
        along, across = step * math.sin(turn) / turn, step * math.sin(turn / 2) ** 2 / (turn / 2)
    else:
        along, across = step, step * turn / 2
    out[0] = nodes[arc, 0] + along * tx - across * ty
    out[1] = nodes[arc, 1] + along * ty + across * tx
    c, sn = math.cos(turn), math.sin(turn)
    out[2], out[3] = c * tx - sn * ty, c * ty + sn * tx


@compiled
def _write_cell(cell: FloatArray, node: FloatArray, k: float, left: float, right: float) -> None:
    cell[0], cell[1], cell[2], cell[3], cell[4] = node[0], node[1], -node[3], node[2], k
    cell[C_LEVEL_L], cell[C_LEVEL_R] = -left + k * left * left / 2, -right + k * right * right / 2
    cell[C_LEFT], cell[C_RIGHT] = left, right
    cell[C_INVERSE_L], cell[C_INVERSE_L + 1] = 1.0 / (1.0 - k * left), 1.0 / (1.0 - k * right)


@compiled
def _cut_guide(
    g: Geometry,
    first: int,
    nodes: FloatArray,
    curvature: FloatArray,
    ends: FloatArray,
    walls: FloatArray,
    half: float,
    deep: float,
    on_left: bool,
) -> int:
    """Fill cells from `first` on, cut at `walls` (arc lengths, rising); returns the number after the last one."""
    cells, arc, wall, c, s, last = g.cells, 0, 0, first, ends[0], ends[1]
    while nodes[arc + 1, 4] <= s + _SLIVER:
        arc += 1
    section = np.empty(4)
    _section(nodes, curvature, arc, s, section)
    while s < last - _SLIVER:
        stop = min(nodes[arc + 1, 4], last)
        if wall < len(walls):
            stop = min(stop, walls[wall])
        if stop - s > _SLIVER:
            inside = wall % 2 == 1
            left = half - deep if inside and on_left else half
            right = -half + deep if inside and not on_left else -half
            _write_cell(cells[c], nodes[arc], curvature[arc], left, right)
            g.links[c, ARC] = arc
            cells[c, C_START : C_START + 4] = section
            _section(nodes, curvature, arc, stop, section)
            cells[c, C_END : C_END + 4] = section
            c += 1
            s = stop
        if wall < len(walls) and stop == walls[wall]:
            wall += 1
        if stop == nodes[arc + 1, 4] and arc + 2 < len(nodes):
            arc += 1
    return c


@compiled
def _edge(row: FloatArray, cell: FloatArray, left: bool) -> None:
    u = cell[C_LEFT] if left else cell[C_RIGHT]
    row[:5] = cell[:5]
    row[5] = cell[C_LEVEL_L] if left else cell[C_LEVEL_R]
    row[6] = -1.0 if left else 1.0
    row[7] = cell[C_INVERSE_L] if left else cell[C_INVERSE_L + 1]
    for at, section in ((8, C_START), (12, C_END)):
        x, y, tx, ty = cell[section], cell[section + 1], cell[section + 2], cell[section + 3]
        row[at], row[at + 1], row[at + 2], row[at + 3] = x - u * ty, y + u * tx, tx, ty


@compiled
def _wall(row: FloatArray, section: FloatArray, low: float, high: float, at_end: bool) -> None:
    """A wall across a cross-section from offset `low` to `high`; the resin lies before it (at_end) or behind it."""
    x, y, tx, ty = section[0], section[1], section[2], section[3]
    row[0], row[1], row[2], row[3], row[4], row[5] = x, y, tx, ty, 0.0, 0.0
    row[6], row[7] = -1.0 if at_end else 1.0, 1.0
    row[8], row[9], row[10], row[11] = x - low * ty, y + low * tx, -ty, tx
    row[12], row[13], row[14], row[15] = x - high * ty, y + high * tx, -ty, tx


@compiled
def _step_in(g: Geometry, thick: int, thin: int, at_end: bool) -> None:
    """The wall between a full cell and its shallower neighbour, and the corners at both its ends."""
    cells = g.cells
    left = cells[thin, C_LEFT] < cells[thick, C_LEFT]
    low = cells[thin, C_LEFT] if left else cells[thick, C_RIGHT]
    high = cells[thick, C_LEFT] if left else cells[thin, C_RIGHT]
    number = 4 * thick + (3 if at_end else 2)
    _wall(
        g.surfaces[number],
        cells[thick, C_END : C_END + 4] if at_end else cells[thick, C_START : C_START + 4],
        low,
        high,
        at_end,
    )
    g.kinds[number], g.corners[number] = INTERFACE, CORNER_A | CORNER_B
    g.links[thick, WALL_AFTER if at_end else WALL_BEFORE] = 1
    side = 0 if left else 1
    g.corners[4 * thick + side] |= CORNER_B if at_end else CORNER_A
    g.corners[4 * thin + side] |= CORNER_A if at_end else CORNER_B


@compiled
def _end_wall(g: Geometry, cell: int, at_end: bool, kind: int) -> None:
    """Close a strip's end."""
    number = 4 * cell + (3 if at_end else 2)
    section = g.cells[cell, C_END : C_END + 4] if at_end else g.cells[cell, C_START : C_START + 4]
    _wall(g.surfaces[number], section, g.cells[cell, C_RIGHT], g.cells[cell, C_LEFT], at_end)
    g.kinds[number], g.corners[number] = kind, CORNER_A | CORNER_B
    g.links[cell, WALL_AFTER if at_end else WALL_BEFORE] = 1


@compiled
def _link(g: Geometry, guide: int, first: int, after: int, forked: bool) -> None:
    """Edges, walls and neighbours of the cells of one guide."""
    for c in range(first, after):
        for side in range(2):
            _edge(g.surfaces[4 * c + side], g.cells[c], side == 0)
            g.kinds[4 * c + side] = INTERFACE
        g.links[c, BEFORE], g.links[c, AFTER] = c - 1, c + 1
    g.links[first, BEFORE], g.links[after - 1, AFTER] = (-1, -2) if forked else (NO_CELL, NO_CELL)
    for c in range(first, after - 1):
        now = g.cells[c, C_LEFT] - g.cells[c, C_RIGHT]
        then = g.cells[c + 1, C_LEFT] - g.cells[c + 1, C_RIGHT]
        if then < now:
            _step_in(g, c, c + 1, True)
        elif then > now:
            _step_in(g, c + 1, c, False)
    g.doors[guide, 0], g.doors[guide, 1] = first, after - 1
    for side in range(2):
        g.corners[4 * first + side] |= CORNER_A
        g.corners[4 * (after - 1) + side] |= CORNER_B
    if not forked:
        _end_wall(g, first, False, INTERFACE)
        _end_wall(g, after - 1, True, RECEIVER)


@compiled
def _mark(g: Geometry, first: int, after: int, free: IntArray, pocket: int) -> None:
    """Mark edges that are free, and the surfaces of each cavity with its number, counted from `pocket`.

    Parameters
    ----------
    free : (arcs, 2) whether the uncut edge of an arc has the whole scene behind its tangents.
    """
    start = NO_CELL
    for c in range(first, after):
        thickness = g.cells[c, C_LEFT] - g.cells[c, C_RIGHT]
        before = g.cells[c - 1, C_LEFT] - g.cells[c - 1, C_RIGHT] if c > first else thickness
        if thickness < before:
            start = c
        elif thickness > before and start != NO_CELL:
            _mark_pocket(g, start, c - 1, free, pocket)
            pocket, start = pocket + 1, NO_CELL
        if start == NO_CELL:
            for side in range(2):
                g.corners[4 * c + side] |= FREE if free[g.links[c, ARC], side] else 0
        else:
            side = 1 if g.cells[c, C_LEFT] < g.cells[start - 1, C_LEFT] else 0
            g.corners[4 * c + side] |= FREE if free[g.links[c, ARC], side] else 0


@compiled
def _mark_pocket(g: Geometry, start: int, end: int, free: IntArray, pocket: int) -> None:
    """Number the floor and the walls of the cavity in cells `start` to `end`."""
    side = 0 if g.cells[start, C_LEFT] < g.cells[start - 1, C_LEFT] else 1
    mouth = 1
    for c in range(start, end + 1):
        g.owners[4 * c + side] = pocket
        mouth = min(mouth, free[g.links[c, ARC], side])
    g.owners[4 * start - 1], g.owners[4 * end + 6] = pocket, pocket
    g.pockets[pocket, 0], g.pockets[pocket, 1], g.pockets[pocket, 2], g.pockets[pocket, 3] = start, end, side, mouth


@compiled
def _in_order(g: Geometry, cells: IntArray) -> int:
    """Write the numbers of all surfaces in the order of the outline; returns how many there are."""
    n = 0
    for guide in range(len(cells) - 1):
        for side in range(2):
            for c in range(cells[guide], cells[guide + 1]):
                for number in (4 * c + side, 4 * c + 2 + side):
                    if g.kinds[number] != NOTHING:
                        g.leaves[n] = number
                        n += 1
    for number in range(4 * len(g.cells), len(g.kinds)):
        if g.kinds[number] != NOTHING:
            g.leaves[n] = number
            n += 1
    return n


@compiled
def allocate(cells: int, fork: int, cavities: int) -> Geometry:
    """Room for a scene of so many cells, junctions' surfaces and cavities; `build` fills it, again and again."""
    n = 4 * cells + fork
    return Geometry(
        np.empty((cells, CELL_COLUMNS)),
        np.empty((cells, LINK_COLUMNS), dtype=np.int32),
        np.empty((n, SURFACE_COLUMNS)),
        np.empty(n, dtype=np.int32),
        np.empty(n, dtype=np.int32),
        np.empty(n, dtype=np.int32),
        np.empty((cavities, POCKET_COLUMNS), dtype=np.int32),
        np.empty((2, 2), dtype=np.int32),
        np.empty((2 * n + 2, 4)),
        np.empty((2 * n + 2, 3), dtype=np.int32),
        np.empty(n, dtype=np.int32),
        cells,
        n,
        0,
    )


@compiled
def room_for(nodes: FloatArray, fork: FloatArray, cavities: int) -> Geometry:
    """Room for a frame's guides with up to so many cavities each."""
    guides = len(nodes)
    return allocate(guides * (nodes.shape[1] + 2 * cavities + 1), len(fork), guides * cavities)


@compiled
def _clear(g: Geometry) -> None:
    g.kinds[:], g.corners[:], g.owners[:] = NOTHING, 0, NO_POCKET
    g.links[:, WALL_BEFORE], g.links[:, WALL_AFTER] = 0, 0


@compiled
def _place_walls(walls: FloatArray, middle: float, pattern: FloatArray) -> None:
    """Write the arc lengths of a guide's cavity walls, around its middle and rising."""
    n = len(walls) // 2
    for i in range(n):
        centre = middle + (i - (n - 1) / 2) * (pattern[1] + pattern[3])
        walls[2 * i], walls[2 * i + 1] = centre - pattern[1] / 2, centre + pattern[1] / 2


@compiled
def _with_tree(g: Geometry, tree_nodes: int) -> Geometry:
    return Geometry(
        g.cells, g.links, g.surfaces, g.kinds, g.owners, g.corners, g.pockets, g.doors, g.boxes, g.branches, g.leaves,
        g.most_cells, g.all_surfaces, tree_nodes,
    )  # fmt: skip


@compiled
def build(
    room: Geometry,
    nodes: FloatArray,
    curvature: FloatArray,
    ends: FloatArray,
    outer: FloatArray,
    half: float,
    free: IntArray,
    fork: FloatArray,
    fork_kinds: IntArray,
    fork_owners: IntArray,
    fork_corners: IntArray,
    pattern: FloatArray,
) -> Geometry:
    """Cut the guides of a frame by a pattern of cavities.

    Parameters
    ----------
    room : from `room_for`; it is filled, and part of the result.
    nodes ... fork_corners : the arrays of a `Frame`.
    pattern : cavities, width, depth, spacing (mm), +1 for the outer face or -1 for the inner one.
    """
    g, guides, n = room, len(nodes), int(pattern[0])
    _clear(g)
    walls, first = np.empty(2 * n), np.zeros(guides + 1, dtype=np.int64)
    for i in range(guides):
        _place_walls(walls, nodes[i, -1, 4] / 2, pattern)
        on_left = outer[i] * pattern[4] > 0
        start = first[i]
        after = _cut_guide(g, start, nodes[i], curvature[i], ends[i], walls, half, pattern[2], on_left)
        _link(g, i, start, after, len(fork) > 0)
        _mark(g, start, after, free[i], i * n)
        first[i + 1] = after
    base = 4 * len(g.cells)
    g.surfaces[base:], g.kinds[base:], g.owners[base:], g.corners[base:] = fork, fork_kinds, fork_owners, fork_corners
    return _with_tree(g, plant(g.surfaces, g.leaves, _in_order(g, first), g.boxes, g.branches))


@compiled
def tables_of(g: Geometry) -> Geometry:
    """The same scene with pointers for its arrays."""
    return Geometry(
        pointer(g.cells),
        pointer(g.links),
        pointer(g.surfaces),
        pointer(g.kinds),
        pointer(g.owners),
        pointer(g.corners),
        pointer(g.pockets),
        pointer(g.doors),
        pointer(g.boxes),
        pointer(g.branches),
        pointer(g.leaves),
        g.most_cells,
        g.all_surfaces,
        g.tree_nodes,
    )


def geometry_of(frame: Frame, design: Design) -> Geometry:
    """The compiled geometry of one frame and design."""
    room = room_for(frame.nodes, frame.surfaces, design.cavities)
    return build(room, *frame_arrays(frame), pattern_of(design))


def frame_arrays(
    frame: Frame,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float, IntArray, FloatArray, IntArray, IntArray, IntArray]:
    """The part of a frame that `build` reads, in its order."""
    return (
        frame.nodes,
        frame.curvature,
        frame.ends,
        frame.outer,
        frame.half_mm,
        frame.free,
        frame.surfaces,
        frame.kinds,
        frame.owners,
        frame.corners,
    )


def pattern_of(design: Design) -> FloatArray:
    """A design as the five numbers `build` reads."""
    return np.array([*design.values, 1.0 if design.face == "outer" else -1.0])
