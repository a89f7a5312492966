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

from analysis.optics.compiled import Floats, Ints, compiled
from analysis.optics.frame import CORNER_A, CORNER_B, INTERFACE, NO_CELL, NOTHING, RECEIVER, Frame
from analysis.optics.parameters import Design

# columns of a cell: reference point and normal of its arc, curvature, levels of both edges, the two cross-sections
# (point and tangent each), offsets of both edges
C_LEVEL_L, C_LEVEL_R, C_START, C_END, C_LEFT, C_RIGHT, CELL_COLUMNS = 5, 6, 7, 11, 15, 16, 17
SURFACE_COLUMNS = 16
# columns of a cell's links: cell before, cell after, wall before, wall after (0 or 1)
BEFORE, AFTER, WALL_BEFORE, WALL_AFTER = 0, 1, 2, 3
_LEAF = 3
_SLIVER = 1e-9


class Geometry(NamedTuple):
    """Arrays of one scene: cells (c, 17), links (c, 4), surfaces (n, 16), kinds, owners, corners (n,), doors (2, 2),
    boxes (t, 4) as centre and half size, branches (t, 3), leaves (n,), and the lengths c, n and t."""

    cells: Floats
    links: Ints
    surfaces: Floats
    kinds: Ints
    owners: Ints
    corners: Ints
    doors: Ints
    boxes: Floats
    branches: Ints
    leaves: Ints
    most_cells: int
    all_surfaces: int
    tree_nodes: int


@compiled
def _section(nodes: Floats, curvature: Floats, arc: int, s: float, out: Floats) -> None:
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
def _write_cell(cell: Floats, node: Floats, k: float, left: float, right: float) -> None:
    cell[0], cell[1], cell[2], cell[3], cell[4] = node[0], node[1], -node[3], node[2], k
    cell[C_LEVEL_L], cell[C_LEVEL_R] = -left + k * left * left / 2, -right + k * right * right / 2
    cell[C_LEFT], cell[C_RIGHT] = left, right


@compiled
def _cut_guide(
    cells: Floats,
    first: int,
    nodes: Floats,
    curvature: Floats,
    ends: Floats,
    walls: Floats,
    half: float,
    deep: float,
    on_left: bool,
) -> int:
    """Fill cells from `first` on, cut at `walls` (arc lengths, rising); returns the number after the last one."""
    arc, wall, c, s, last = 0, 0, first, ends[0], ends[1]
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
def _edge(row: Floats, cell: Floats, left: bool) -> None:
    u = cell[C_LEFT] if left else cell[C_RIGHT]
    row[:5] = cell[:5]
    row[5] = cell[C_LEVEL_L] if left else cell[C_LEVEL_R]
    row[6] = -1.0 if left else 1.0
    row[7] = 1.0 / (1.0 - cell[4] * u)
    for at, section in ((8, C_START), (12, C_END)):
        x, y, tx, ty = cell[section], cell[section + 1], cell[section + 2], cell[section + 3]
        row[at], row[at + 1], row[at + 2], row[at + 3] = x - u * ty, y + u * tx, tx, ty


@compiled
def _wall(row: Floats, section: Floats, low: float, high: float, at_end: bool) -> None:
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
    g.kinds[number], g.owners[number], g.corners[number] = INTERFACE, thick, CORNER_A | CORNER_B
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
    g.kinds[number], g.owners[number], g.corners[number] = kind, cell, CORNER_A | CORNER_B
    g.links[cell, WALL_AFTER if at_end else WALL_BEFORE] = 1


@compiled
def _link(g: Geometry, guide: int, first: int, after: int, forked: bool) -> None:
    """Edges, walls and neighbours of the cells of one guide."""
    for c in range(first, after):
        for side in range(2):
            _edge(g.surfaces[4 * c + side], g.cells[c], side == 0)
            g.kinds[4 * c + side], g.owners[4 * c + side] = INTERFACE, c
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
def _grow_box(box: Floats, row: Floats) -> None:
    """Widen box (x0, y0, x1, y1) by one surface: its two ends and the bulge of its arc."""
    ax, ay, bx, by = row[8], row[9], row[12], row[13]
    half = math.hypot(bx - ax, by - ay) / 2
    curve = abs(row[4] * row[7]) * half
    bulge = half * curve / (1.0 + math.sqrt(max(1.0 - curve * curve, 0.0))) + 1e-9 * (half + 1.0)
    box[0], box[1] = min(box[0], ax - bulge, bx - bulge), min(box[1], ay - bulge, by - bulge)
    box[2], box[3] = max(box[2], ax + bulge, bx + bulge), max(box[3], ay + bulge, by + bulge)


@compiled
def _plant(g: Geometry, cells: Ints) -> int:
    """Order the surfaces along the outline and stand a tree of boxes over them; returns the number of its nodes."""
    n = 0
    for guide in range(len(cells) - 1):
        for side in range(2):
            for c in range(cells[guide], cells[guide + 1]):
                wall = c * 4 + 2
                for number in (4 * c + side, wall + side):
                    if g.kinds[number] != NOTHING:
                        g.leaves[n] = number
                        n += 1
    for number in range(4 * len(g.cells), len(g.kinds)):
        if g.kinds[number] != NOTHING:
            g.leaves[n] = number
            n += 1
    groups = (n + _LEAF - 1) // _LEAF
    stack = np.empty((64, 2), dtype=np.int64)
    stack[0, 0], stack[0, 1] = 0, groups
    top, node = 1, 0
    while top > 0:
        top -= 1
        low, high = stack[top, 0], stack[top, 1]
        box = g.boxes[node]
        box[0], box[1], box[2], box[3] = math.inf, math.inf, -math.inf, -math.inf
        for i in range(low * _LEAF, min(high * _LEAF, n)):
            _grow_box(box, g.surfaces[g.leaves[i]])
        box[0], box[2] = 0.5 * (box[0] + box[2]), 0.5 * (box[2] - box[0])
        box[1], box[3] = 0.5 * (box[1] + box[3]), 0.5 * (box[3] - box[1])
        g.branches[node, 0] = node + 2 * (high - low) - 1
        g.branches[node, 1] = low * _LEAF
        g.branches[node, 2] = min(high * _LEAF, n) if high - low == 1 else 0
        node += 1
        if high - low > 1:
            middle = (low + high) // 2
            stack[top, 0], stack[top, 1] = middle, high
            stack[top + 1, 0], stack[top + 1, 1] = low, middle
            top += 2
    return node


@compiled
def _allocate(most: int, fork: int) -> Geometry:
    n = 4 * most + fork
    return Geometry(
        np.zeros((most, CELL_COLUMNS)),
        np.zeros((most, 4), dtype=np.int64),
        np.zeros((n, 16)),
        np.zeros(n, dtype=np.int64),
        np.zeros(n, dtype=np.int64),
        np.zeros(n, dtype=np.int64),
        np.zeros((2, 2), dtype=np.int64),
        np.zeros((2 * n + 2, 4)),
        np.zeros((2 * n + 2, 3), dtype=np.int64),
        np.zeros(n, dtype=np.int64),
        most,
        n,
        0,
    )


@compiled
def build(
    nodes: Floats,
    curvature: Floats,
    ends: Floats,
    outer: Floats,
    half: float,
    fork: Floats,
    fork_kinds: Ints,
    fork_owners: Ints,
    fork_corners: Ints,
    pattern: Floats,
) -> Geometry:
    """Cut the guides of a frame by a pattern of cavities.

    Parameters
    ----------
    nodes ... fork_corners : the arrays of a `Frame`.
    pattern : cavities, width, depth, spacing (mm), +1 for the outer face or -1 for the inner one.
    """
    guides, n = len(nodes), int(pattern[0])
    most = guides * (len(curvature[0]) + 2 * n + 2)
    g = _allocate(most, len(fork))
    walls, first = np.empty(2 * n), np.zeros(guides + 1, dtype=np.int64)
    for guide in range(guides):
        middle = nodes[guide, -1, 4] / 2
        for i in range(n):
            centre = middle + (i - (n - 1) / 2) * (pattern[1] + pattern[3])
            walls[2 * i], walls[2 * i + 1] = centre - pattern[1] / 2, centre + pattern[1] / 2
        first[guide + 1] = _cut_guide(
            g.cells,
            first[guide],
            nodes[guide],
            curvature[guide],
            ends[guide],
            walls,
            half,
            pattern[2],
            outer[guide] * pattern[4] > 0,
        )
        _link(g, guide, first[guide], first[guide + 1], len(fork) > 0)
    base = 4 * most
    g.surfaces[base:], g.kinds[base:], g.owners[base:], g.corners[base:] = fork, fork_kinds, fork_owners, fork_corners
    used = _plant(g, first)
    return Geometry(
        g.cells,
        g.links,
        g.surfaces,
        g.kinds,
        g.owners,
        g.corners,
        g.doors,
        g.boxes,
        g.branches,
        g.leaves,
        most,
        len(g.kinds),
        used,
    )


def geometry_of(frame: Frame, design: Design) -> Geometry:
    """The compiled geometry of one frame and design."""
    return build(*frame_arrays(frame), pattern_of(design))


def frame_arrays(frame: Frame) -> tuple[Floats, Floats, Floats, Floats, float, Floats, Ints, Ints, Ints]:
    """The part of a frame that `build` reads, in its order."""
    return (
        frame.nodes,
        frame.curvature,
        frame.ends,
        frame.outer,
        frame.half_mm,
        frame.surfaces,
        frame.kinds,
        frame.owners,
        frame.corners,
    )


def pattern_of(design: Design) -> Floats:
    """A design as the five numbers `build` reads."""
    return np.array([*design.values, 1.0 if design.face == "outer" else -1.0])
