"""One design in one state as arrays for the tracer, built inside the compiled part.

Strategy: a guide is a row of **cells** between straight cross-sections, cut at the joints of its arcs and at the
cavities' walls. In a cell both edges are concentric arcs (or parallel lines), so that a ray inside meets one of two
edges or enters the next cell: no search. A cavity is a run of cells with one edge moved inwards; its walls lie in the
cross-sections. Beside a void inside the guide a stretch is two cells, left and right of it. Rays in the air search a
BVH over all surfaces.

Surfaces are numbered 4 c + 0, 1, 2, 3 for cell c's left edge, right edge, start wall and end wall (absent ones have
kind 0), then the junctions' surfaces from `frame.py`, whose row of 16 numbers they share.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from analysis.compiled import inside, interpreted
from analysis.optics.scene import frame as surface
from analysis.optics.scene.frame import INTERFACE, NO_CELL, NO_SURFACE, SceneFrame, check_design
from analysis.optics.scene.parameters import FACES, Design
from protocol.base.arrays import FloatArray, IntArray

# columns of a cell: reference point and normal of its arc, curvature, levels of both edges, the two cross-sections
# (point and tangent each), offsets of both edges, 1 / |grad f| on both
C_LEVEL_L, C_LEVEL_R, C_START, C_END, C_LEFT, C_RIGHT, C_INVERSE_L, CELL_COLUMNS = 5, 6, 7, 11, 15, 16, 17, 19
SURFACE_COLUMNS = 16
# where cavities are cut: numbers of `parameters.FACES`, 0 and 1 being replaced by the side
_LEFT, _RIGHT, BOTH, MIDLINE = range(4)
# what bounds a cell before and after: nothing, a wall on one side, a void between this cell and the next two, two walls
OPEN, _WALL, FORK, WALLS = range(4)
# columns of a cell's links: cell before, cell after, what bounds it before and after, arc it lies on
BEFORE, AFTER, WALL_BEFORE, WALL_AFTER, ARC, LINK_COLUMNS = range(6)
# columns of a cavity: its first and last cell, its side (0 left, 1 right), 1 if its mouth is free
CAVITY_COLUMNS, NO_CAVITY = 4, -1
_SLIVER = 1e-9


class Geometry(NamedTuple):
    """Arrays of one scene.

    `surfaces`, `kinds`, `owners`, `corners`: (n, 16) and (n,). The owner of a surface is the cavity it bounds or
    NO_CAVITY, that of a junction's surface is the junction.
    """

    cells: FloatArray  # with links: (c, 19) and (c, 5), columns as above
    links: IntArray
    surfaces: FloatArray
    kinds: IntArray
    owners: IntArray
    corners: IntArray
    cavities: IntArray  # (p, 4), columns as above
    end_cells: IntArray  # (2, 2) first and last cell of each guide
    bvh_boxes: FloatArray  # with bvh_nodes, bvh_order: (2 n + 2, 4), (2 n + 2, 3) and (n,) of the BVH, see `build_bvh`
    bvh_nodes: IntArray
    bvh_order: IntArray
    emitter: FloatArray  # with receiver_direction: (4,) and (2,) as in `SceneFrame`
    receiver_direction: FloatArray
    source_cell: int  # cell in which the rays start
    cell_count: int
    surface_count: int


@inside
def _copy(target: FloatArray, source: FloatArray) -> None:
    """Copy the numbers of a row, as `target[:] = source` does, which takes numba three times as long to compile."""
    for i in range(len(source)):
        target[i] = source[i]


@inside
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


@inside
def _write_cell(cell: FloatArray, node: FloatArray, k: float, left: float, right: float) -> None:
    cell[0], cell[1], cell[2], cell[3], cell[4] = node[0], node[1], -node[3], node[2], k
    cell[C_LEVEL_L], cell[C_LEVEL_R] = -left + k * left * left / 2, -right + k * right * right / 2
    cell[C_LEFT], cell[C_RIGHT] = left, right
    cell[C_INVERSE_L], cell[C_INVERSE_L + 1] = 1.0 / (1.0 - k * left), 1.0 / (1.0 - k * right)


@inside
def _cut_guide(
    g: Geometry,
    first: int,
    nodes: FloatArray,
    curvature: FloatArray,
    ends: FloatArray,
    walls: FloatArray,
    half: float,
    deep: float,
    side: int,
) -> int:
    """Fill cells from `first` on; return the number after the last one."""
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
            left = half - deep if inside and side in (_LEFT, BOTH) else half
            right = -half + deep if inside and side in (_RIGHT, BOTH) else -half
            void = inside and side == MIDLINE
            _write_cell(cells[c], nodes[arc], curvature[arc], left, deep / 2 if void else right)
            g.links[c, ARC] = arc
            _copy(cells[c, C_START : C_START + 4], section)
            _section(nodes, curvature, arc, stop, section)
            _copy(cells[c, C_END : C_END + 4], section)
            if void:  # the resin on the right of the void is the next cell
                _copy(cells[c + 1], cells[c])
                _write_cell(cells[c + 1], nodes[arc], curvature[arc], -deep / 2, right)
                g.links[c + 1, ARC] = arc
                c += 1
            c += 1
            s = stop
        if wall < len(walls) and stop == walls[wall]:
            wall += 1
        if stop == nodes[arc + 1, 4] and arc + 2 < len(nodes):
            arc += 1
    return c


@inside
def _edge(row: FloatArray, cell: FloatArray, left: bool) -> None:
    u = cell[C_LEFT] if left else cell[C_RIGHT]
    _copy(row, cell[:5])
    row[5] = cell[C_LEVEL_L] if left else cell[C_LEVEL_R]
    row[6] = -1.0 if left else 1.0
    row[7] = cell[C_INVERSE_L] if left else cell[C_INVERSE_L + 1]
    for at, section in ((8, C_START), (12, C_END)):
        x, y, tx, ty = cell[section], cell[section + 1], cell[section + 2], cell[section + 3]
        row[at], row[at + 1], row[at + 2], row[at + 3] = x - u * ty, y + u * tx, tx, ty


@inside
def _wall(g: Geometry, cell: int, at_end: bool, low: float, high: float) -> None:
    """Write the wall at an end of a cell from offset `low` to `high`, the resin on the cell's side."""
    number, section = (4 * cell + 3, C_END) if at_end else (4 * cell + 2, C_START)
    x, y = g.cells[cell, section], g.cells[cell, section + 1]
    tx, ty = g.cells[cell, section + 2], g.cells[cell, section + 3]
    row = g.surfaces[number]
    row[0], row[1], row[2], row[3], row[4], row[5] = x, y, tx, ty, 0.0, 0.0
    row[6], row[7] = -1.0 if at_end else 1.0, 1.0
    row[8], row[9], row[10], row[11] = x - low * ty, y + low * tx, -ty, tx
    row[12], row[13], row[14], row[15] = x - high * ty, y + high * tx, -ty, tx
    g.kinds[number], g.corners[number] = INTERFACE, surface.CORNER_A | surface.CORNER_B
    g.links[cell, WALL_AFTER if at_end else WALL_BEFORE] = _WALL


@inside
def _step_in(g: Geometry, thick: int, thin: int) -> None:
    """Write the wall between a full cell and its shallower neighbour, and mark the corners at both its ends."""
    cells, at_end = g.cells, thin > thick
    left = cells[thin, C_LEFT] < cells[thick, C_LEFT]
    low = cells[thin, C_LEFT] if left else cells[thick, C_RIGHT]
    high = cells[thick, C_LEFT] if left else cells[thin, C_RIGHT]
    _wall(g, thick, at_end, low, high)
    side = 0 if left else 1
    g.corners[4 * thick + side] |= surface.CORNER_B if at_end else surface.CORNER_A
    g.corners[4 * thin + side] |= surface.CORNER_A if at_end else surface.CORNER_B


@inside
def _step_in_both(g: Geometry, thick: int, thin: int) -> None:
    """Write the walls between a full cell and a neighbour cut from both sides; the right one takes the thin's place."""
    cells, at_end = g.cells, thin > thick
    spare = 4 * thin + (2 if at_end else 3)
    _wall(g, thick, at_end, cells[thick, C_RIGHT], cells[thin, C_RIGHT])
    number = 4 * thick + (3 if at_end else 2)
    _copy(g.surfaces[spare], g.surfaces[number])
    g.kinds[spare], g.corners[spare] = INTERFACE, g.corners[number]
    _wall(g, thick, at_end, cells[thin, C_LEFT], cells[thick, C_LEFT])
    g.links[thick, WALL_AFTER if at_end else WALL_BEFORE] = WALLS
    for side in range(2):
        g.corners[4 * thick + side] |= surface.CORNER_B if at_end else surface.CORNER_A
        g.corners[4 * thin + side] |= surface.CORNER_A if at_end else surface.CORNER_B


@inside
def _fork(g: Geometry, full: int, left: int) -> None:
    """Write the wall between a full cell and a void, and link the full cell to the two cells beside the void."""
    at_end = left > full  # the void begins there
    _wall(g, full, at_end, g.cells[left + 1, C_LEFT], g.cells[left, C_RIGHT])
    g.links[full, WALL_AFTER if at_end else WALL_BEFORE] = FORK
    g.links[full, AFTER if at_end else BEFORE] = left
    g.links[left, BEFORE if at_end else AFTER] = full
    g.links[left + 1, BEFORE if at_end else AFTER] = full
    g.corners[4 * left + 1] |= surface.CORNER_A if at_end else surface.CORNER_B
    g.corners[4 * left + 4] |= surface.CORNER_A if at_end else surface.CORNER_B


@inside
def _link_voids(g: Geometry, first: int, after: int) -> None:
    """Link the cells of a guide with voids: pairs of cells side by side between full ones."""
    full = g.cells[first, C_RIGHT]
    c = first
    while c < after - 1:
        if g.cells[c, C_RIGHT] == full:
            if g.cells[c + 1, C_RIGHT] != full:
                _fork(g, c, c + 1)
            c += 1
        else:
            if g.cells[c + 2, C_RIGHT] == full:
                _fork(g, c + 2, c)
            else:
                for beside in range(2):
                    g.links[c + beside, AFTER], g.links[c + beside + 2, BEFORE] = c + beside + 2, c + beside
            c += 2


@inside
def _link(g: Geometry, guide: int, first: int, after: int, joined: bool, side_cut: int) -> None:
    """Write edges, walls and neighbours of the cells of one guide."""
    for c in range(first, after):
        for side in range(2):
            _edge(g.surfaces[4 * c + side], g.cells[c], side == 0)
            g.kinds[4 * c + side] = INTERFACE
        g.links[c, BEFORE], g.links[c, AFTER] = c - 1, c + 1
    g.links[first, BEFORE], g.links[after - 1, AFTER] = (
        (surface.JUNCTION_START, surface.JUNCTION_END) if joined else (NO_CELL, NO_CELL)
    )
    if side_cut == MIDLINE:
        _link_voids(g, first, after)
    for c in range(first, after - 1 if side_cut != MIDLINE else first):
        now = g.cells[c, C_LEFT] - g.cells[c, C_RIGHT]
        then = g.cells[c + 1, C_LEFT] - g.cells[c + 1, C_RIGHT]
        thick, thin = (c, c + 1) if then < now else (c + 1, c)
        if then != now and side_cut == BOTH:
            _step_in_both(g, thick, thin)
        elif then != now:
            _step_in(g, thick, thin)
    g.end_cells[guide, 0], g.end_cells[guide, 1] = first, after - 1
    for side in range(2):
        g.corners[4 * first + side] |= surface.CORNER_A
        g.corners[4 * (after - 1) + side] |= surface.CORNER_B
    if not joined:
        for end in range(2):
            cell = first if end == 0 else after - 1
            _wall(g, cell, end == 1, g.cells[cell, C_RIGHT], g.cells[cell, C_LEFT])
        g.kinds[4 * (after - 1) + 3] = surface.RECEIVER


@inside
def _mark(g: Geometry, first: int, after: int, free: IntArray, cavity: int) -> None:
    """Mark edges that are free, and the surfaces of each cavity with its number, counted from `cavity`.

    `free`: (arcs, 2) whether the uncut edge of an arc has the whole scene behind its tangents.
    """
    start = int(NO_CELL)  # no literal, for which numba would compile `_mark_cavity` once more
    for c in range(first, after):
        thickness = g.cells[c, C_LEFT] - g.cells[c, C_RIGHT]
        before = g.cells[c - 1, C_LEFT] - g.cells[c - 1, C_RIGHT] if c > first else thickness
        if thickness < before:
            start = c
        elif thickness > before and start != NO_CELL:
            _mark_cavity(g, start, c - 1, free, cavity)
            cavity, start = cavity + 1, NO_CELL
        if start == NO_CELL:
            for side in range(2):
                g.corners[4 * c + side] |= surface.FREE if free[g.links[c, ARC], side] else 0
        else:
            side = 1 if g.cells[c, C_LEFT] < g.cells[start - 1, C_LEFT] else 0
            g.corners[4 * c + side] |= surface.FREE if free[g.links[c, ARC], side] else 0


@inside
def _mark_faces(g: Geometry, first: int, after: int, free: IntArray, half: float) -> None:
    """Mark the guide's own faces that are free; light leaving into a cavity or void searches all surfaces."""
    for c in range(first, after):
        for side in range(2):
            own = g.cells[c, C_LEFT] == half if side == 0 else g.cells[c, C_RIGHT] == -half
            g.corners[4 * c + side] |= surface.FREE if own and free[g.links[c, ARC], side] else 0


@inside
def _mark_cavity(g: Geometry, start: int, end: int, free: IntArray, cavity: int) -> None:
    """Number the bottom and the walls of the cavity in cells `start` to `end`."""
    side = 0 if g.cells[start, C_LEFT] < g.cells[start - 1, C_LEFT] else 1
    mouth = 1
    for c in range(start, end + 1):
        g.owners[4 * c + side] = cavity
        mouth = min(mouth, free[g.links[c, ARC], side])
    g.owners[4 * start - 1], g.owners[4 * end + 6] = cavity, cavity
    row = g.cavities[cavity]
    row[0], row[1], row[2], row[3] = start, end, side, mouth


@inside
def _write_order(g: Geometry, first: IntArray) -> int:
    """Write the numbers of all surfaces in the order of the outline; return how many there are."""
    n = 0
    for guide in range(len(first) - 1):
        for side in range(2):
            for c in range(first[guide], first[guide + 1]):
                for number in (4 * c + side, 4 * c + 2 + side):
                    if g.kinds[number] != NO_SURFACE:
                        g.bvh_order[n] = number
                        n += 1
    for number in range(4 * len(g.cells), len(g.kinds)):
        if g.kinds[number] != NO_SURFACE:
            g.bvh_order[n] = number
            n += 1
    return n


def allocate(guides: int, arcs: int, junction: int, most_cavities: int, source_cell: int, face: int) -> Geometry:
    """Return unfilled arrays for guides of so many arcs with up to so many cavities each; `build` fills them."""
    cells = guides * (arcs + 2 * most_cavities + 2) * (2 if face == MIDLINE else 1)
    n = 4 * cells + junction
    return Geometry(
        np.empty((cells, CELL_COLUMNS)),
        np.empty((cells, LINK_COLUMNS), dtype=np.int32),
        np.empty((n, SURFACE_COLUMNS)),
        np.empty(n, dtype=np.int32),
        np.empty(n, dtype=np.int32),
        np.empty(n, dtype=np.int32),
        np.empty((guides * most_cavities, CAVITY_COLUMNS), dtype=np.int32),
        np.empty((2, 2), dtype=np.int32),
        np.empty((2 * n + 2, 4)),
        np.empty((2 * n + 2, 3), dtype=np.int32),
        np.empty(n, dtype=np.int32),
        np.empty(4),
        np.empty(2),
        source_cell,
        cells,
        n,
    )


@inside
def _place_walls(walls: FloatArray, middle: float, pattern: FloatArray) -> None:
    """Write the arc lengths of a guide's cavity walls, around its middle and rising."""
    n = len(walls) // 2
    for i in range(n):
        centre = middle + (i - (n - 1) / 2) * (pattern[1] + pattern[3])
        walls[2 * i], walls[2 * i + 1] = centre - pattern[1] / 2, centre + pattern[1] / 2


@inside
def build(g: Geometry, frame: SceneFrame, pattern: FloatArray) -> None:
    """Cut the guides of a frame by a pattern of cavities."""
    guides, n, face = len(frame.nodes), int(pattern[0]), int(pattern[4])
    for i in range(len(g.kinds)):
        g.kinds[i], g.corners[i], g.owners[i] = NO_SURFACE, 0, NO_CAVITY
    for i in range(len(g.links)):
        g.links[i, WALL_BEFORE], g.links[i, WALL_AFTER] = 0, 0
    _copy(g.emitter, frame.emitter)
    _copy(g.receiver_direction, frame.receiver_direction)
    walls, first = np.empty(2 * n), np.zeros(guides + 1, dtype=np.int64)
    for i in range(guides):
        nodes, curvature, ends = frame.nodes[i], frame.curvature[i], frame.ends[i]
        _place_walls(walls, nodes[-1, 4] / 2, pattern)
        side = face if face >= BOTH else _LEFT if (frame.outer[i] > 0) == (face == 0) else _RIGHT
        start = first[i]
        after = _cut_guide(g, start, nodes, curvature, ends, walls, frame.half_mm, pattern[2], side)
        _link(g, i, start, after, len(frame.surfaces) > 0, side)
        if side >= BOTH:
            _mark_faces(g, start, after, frame.free[i], frame.half_mm)
        else:
            _mark(g, start, after, frame.free[i], i * n)
        first[i + 1] = after
    base = 4 * len(g.cells)
    for i in range(len(frame.kinds)):
        _copy(g.surfaces[base + i], frame.surfaces[i])
        g.kinds[base + i], g.owners[base + i], g.corners[base + i] = frame.kinds[i], frame.owners[i], frame.corners[i]
    build_bvh(g.surfaces, g.bvh_order, _write_order(g, first), g.bvh_boxes, g.bvh_nodes)


def geometry_of(frame: SceneFrame, design: Design) -> Geometry:
    """Return the geometry of one frame and design."""
    check_design(frame, design, "this state")
    guides, arcs = frame.curvature.shape
    pattern = pattern_of(design)
    g = allocate(guides, arcs, len(frame.surfaces), design.cavities, frame.source_cell, int(pattern[4]))
    interpreted(build)(g, frame, pattern)  # 2 ms, and seconds to compile
    return g


def pattern_of(design: Design) -> FloatArray:
    """Return a design as the five numbers that `build` reads."""
    return np.array([*design.values, float(FACES.index(design.face))])


LEAF_SURFACES = 3


@inside
def build_bvh(surfaces: FloatArray, order: IntArray, n: int, boxes: FloatArray, nodes: IntArray) -> None:
    """Build a BVH over the surfaces order[:n], neighbours of the outline side by side, in a depth-first walk.

    `boxes`: (2 s + 2, 4) is filled with centre and half size of each node. `nodes`: (2 s + 2, 3), with the node after a
    miss (of the root: the number of all), and the first and last + 1 place in `order` (0 for a node with children).
    """
    stack = np.empty((64, 2), dtype=np.int64)
    stack[0, 0], stack[0, 1] = 0, (n + LEAF_SURFACES - 1) // LEAF_SURFACES
    top, node = 1, 0
    while top > 0:
        top -= 1
        low, high = stack[top, 0], stack[top, 1]
        leaf = high - low == 1
        nodes[node, 0] = node + 2 * (high - low) - 1
        nodes[node, 1] = low * LEAF_SURFACES
        nodes[node, 2] = min(high * LEAF_SURFACES, n) if leaf else 0
        if not leaf:
            middle = (low + high) // 2
            stack[top, 0], stack[top, 1] = middle, high
            stack[top + 1, 0], stack[top + 1, 1] = low, middle
            top += 2
        node += 1
    _compute_boxes(surfaces, order, boxes, nodes)


@inside
def _compute_boxes(surfaces: FloatArray, order: IntArray, boxes: FloatArray, nodes: IntArray) -> None:
    """Compute boxes from the leaves upwards; a node's children come after it in number."""
    count = nodes[0, 0]
    for node in range(count - 1, -1, -1):
        box = boxes[node]
        box[0], box[1], box[2], box[3] = math.inf, math.inf, -math.inf, -math.inf
        for i in range(nodes[node, 1], nodes[node, 2]):
            _enlarge(box, surfaces[order[i]])
        if nodes[node, 2] == 0:
            for side in range(2):
                child = node + 1 if side == 0 else nodes[node + 1, 0]
                box[0], box[1] = min(box[0], boxes[child, 0]), min(box[1], boxes[child, 1])
                box[2], box[3] = max(box[2], boxes[child, 2]), max(box[3], boxes[child, 3])
    for node in range(count):
        box = boxes[node]
        box[0], box[2] = 0.5 * (box[0] + box[2]), 0.5 * (box[2] - box[0])
        box[1], box[3] = 0.5 * (box[1] + box[3]), 0.5 * (box[3] - box[1])


@inside
def _enlarge(box: FloatArray, row: FloatArray) -> None:
    """Enlarge box (x0, y0, x1, y1) by one surface: its two ends and the bulge of its arc."""
    ax, ay, bx, by = row[8], row[9], row[12], row[13]
    half = 0.5 * math.sqrt((bx - ax) ** 2 + (by - ay) ** 2)
    curve = abs(row[4] * row[7]) * half
    bulge = half * curve / (1.0 + math.sqrt(max(1.0 - curve * curve, 0.0))) + 1e-9 * (half + 1.0)
    box[0], box[1] = min(box[0], ax - bulge, bx - bulge), min(box[1], ay - bulge, by - bulge)
    box[2], box[3] = max(box[2], ax + bulge, bx + bulge), max(box[3], ay + bulge, by + bulge)
