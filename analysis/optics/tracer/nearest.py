"""The next surface that a ray meets: cell by cell in the resin, by the BVH in the air.

Strategy: along a ray x = p + t d a surface's f is k t^2 / 2 + b t + c / 2 (see `frame.py`), so lines and arcs have one
formula, and the root with the right sign of slope is the one that leaves (or enters) the resin. The surface just left
has c = 0 exactly: its root at 0 is skipped without an epsilon. A ray that leaves through a free surface (one that has
the whole scene behind its tangents) meets nothing more; one that starts in a cavity is tested against that cavity
first.

Rule: tables are read through pointers (see `analysis.compiled`).
"""

from __future__ import annotations

import math

from analysis.compiled import inner
from analysis.optics.scene import geometry as table
from analysis.optics.scene.frame import FREE, JUNCTION_START, NO_CELL, RECEIVER
from analysis.optics.scene.geometry import C_LEFT, C_RIGHT, CELL_COLUMNS, SURFACE_COLUMNS, Geometry
from protocol.base.arrays import FloatArray

_JOINT = 1e-9


@inner
def root(b: float, c: float, k: float, slope: float) -> float:
    """Return the first t > 0 with k t^2 + 2 b t + c = 0 and slope's sign, or inf.

    It is stable for k -> 0 and exact for c = 0.
    """
    square = b * b - k * c
    if square < 0.0:
        return math.inf
    s = slope * math.sqrt(square)
    if slope * b > 0.0:
        t: float = -c / (b + s)
    elif k != 0.0:
        t = (s - b) / k
    else:
        return math.inf
    return t if 0.0 < t < math.inf else math.inf


@inner
def _reach(table: FloatArray, i: int, px: float, py: float, dx: float, dy: float, slope: float, left: bool) -> float:
    """Return the distance along a ray to surface `i` within its extent, or inf."""
    r = i * SURFACE_COLUMNS
    qx, qy, nx, ny, k = px - table[r], py - table[r + 1], table[r + 2], table[r + 3], table[r + 4]
    b = dx * (k * qx - nx) + dy * (k * qy - ny)
    if slope * b <= 0.0 and slope * k <= 0.0:  # heading away, and the surface does not curve back
        return math.inf
    if k == 0.0:
        if left:
            return math.inf
        t: float = (nx * qx + ny * qy + table[r + 5]) / b
        if t <= 0.0:
            return math.inf
    else:
        c = 0.0 if left else k * (qx * qx + qy * qy) - 2.0 * (nx * qx + ny * qy + table[r + 5])
        t = root(b, c, k, slope)
        if t == math.inf:
            return t
    x, y = px + t * dx, py + t * dy
    if (x - table[r + 8]) * table[r + 10] + (y - table[r + 9]) * table[r + 11] < 0.0:
        return math.inf
    if (x - table[r + 12]) * table[r + 14] + (y - table[r + 13]) * table[r + 15] >= 0.0:
        return math.inf
    return t


@inner
def _by_bvh(g: Geometry, px: float, py: float, dx: float, dy: float, last: int) -> tuple[float, int]:
    """Return the nearest of all surfaces from the air: distance and number, or (inf, -1)."""
    best, found, node, count = math.inf, -1, 0, g.bvh_nodes[0]
    ax, ay = abs(dx), abs(dy)
    while node < count:
        r = 4 * node
        cx, cy, ex, ey = g.bvh_boxes[r] - px, g.bvh_boxes[r + 1] - py, g.bvh_boxes[r + 2], g.bvh_boxes[r + 3]
        ahead, spread = cx * dx + cy * dy, ex * ax + ey * ay
        if abs(cx * dy - cy * dx) > ex * ay + ey * ax or ahead + spread < 0.0 or ahead - spread > best:
            node = g.bvh_nodes[3 * node]
            continue
        for j in range(g.bvh_nodes[3 * node + 1], g.bvh_nodes[3 * node + 2]):
            number = g.bvh_order[j]
            slope = g.surfaces[number * SURFACE_COLUMNS + 6]
            t = _reach(g.surfaces, number, px, py, dx, dy, -slope, number == last)
            if g.kinds[number] == RECEIVER:
                t = min(t, _reach(g.surfaces, number, px, py, dx, dy, slope, number == last))
            if t < best:
                best, found = t, number
        node += 1
    return best, found


@inner
def _in_cavity(g: Geometry, px: float, py: float, dx: float, dy: float, cavity: int, last: int) -> tuple[float, int]:
    """Return the nearest wall or bottom of a cavity seen from inside it, or (inf, -1) through its mouth."""
    best, found, r = math.inf, -1, table.CAVITY_COLUMNS * cavity
    first, final, side = g.cavities[r], g.cavities[r + 1], g.cavities[r + 2]
    for cell in range(first - 1, final + 2):
        number = 4 * cell + (3 if cell < first else 2 if cell > final else side)
        slope = -g.surfaces[number * SURFACE_COLUMNS + 6]
        t = _reach(g.surfaces, number, px, py, dx, dy, slope, number == last)
        if t < best:
            best, found = t, number
    return best, found


@inner
def in_air(g: Geometry, px: float, py: float, dx: float, dy: float, last: int) -> tuple[float, int]:
    """Return the nearest surface in front of a ray in the air: distance and number, or (inf, -1)."""
    if g.corners[last] & FREE != 0:
        return math.inf, -1
    cavity = g.owners[last] if last < 4 * g.cell_count else -1
    if cavity >= 0:
        t, found = _in_cavity(g, px, py, dx, dy, cavity, last)
        if found >= 0 or g.cavities[table.CAVITY_COLUMNS * cavity + 3] != 0:
            return t, found
    return _by_bvh(g, px, py, dx, dy, last)


@inner
def _in_junction(
    g: Geometry, px: float, py: float, dx: float, dy: float, junction: int, last: int
) -> tuple[float, int, int]:
    """Return the nearest surface of a junction, or the end of a guide: distance, number (-1 for a guide), cell."""
    best, found, cell = math.inf, -1, junction
    for number in range(4 * g.cell_count, g.surface_count):
        if g.owners[number] == junction:
            t = _reach(g.surfaces, number, px, py, dx, dy, g.surfaces[number * SURFACE_COLUMNS + 6], number == last)
            if t < best:
                best, found = t, number
    at_start = junction == JUNCTION_START
    for guide in range(2):
        c = g.end_cells[2 * guide + (0 if at_start else 1)]
        r = c * CELL_COLUMNS
        at = r + (table.C_START if at_start else table.C_END)
        x, y, tx, ty = g.cells[at], g.cells[at + 1], g.cells[at + 2], g.cells[at + 3]
        speed = dx * tx + dy * ty
        if (speed > 0.0) == at_start and speed != 0.0:
            t = ((x - px) * tx + (y - py) * ty) / speed
            u = (py + t * dy - y) * tx - (px + t * dx - x) * ty
            if 0.0 < t < best and g.cells[r + C_RIGHT] <= u <= g.cells[r + C_LEFT]:
                best, found, cell = t, -1, c
    return best, found, cell


@inner
def _at_edge(
    g: Geometry, px: float, py: float, dx: float, dy: float, cell: int, last: int, forward: bool
) -> tuple[float, int]:
    """Return the first edge of a cell that a ray inside meets: distance and side (0 left, 1 right), or inf.

    It meets the edge it heads for; only where that is the inside of a bend can it miss it and meet the other. In a
    neighbour's bend it may cross the circle before it enters this cell; that crossing does not count.
    """
    r = cell * CELL_COLUMNS
    k, nx, ny = g.cells[r + 4], g.cells[r + 2], g.cells[r + 3]
    qx, qy = px - g.cells[r], py - g.cells[r + 1]
    b = dx * (k * qx - nx) + dy * (k * qy - ny)
    f = k * (qx * qx + qy * qy) - 2.0 * (nx * qx + ny * qy)
    side = 0 if b < 0.0 else 1
    slope = -1.0 if b < 0.0 else 1.0
    t = root(b, 0.0 if last == 4 * cell + side else f - 2.0 * g.cells[r + table.C_LEVEL_L + side], k, slope)
    if t < math.inf:
        at = r + (table.C_START if forward else table.C_END)
        past = (px + t * dx - g.cells[at]) * g.cells[at + 2] + (py + t * dy - g.cells[at + 1]) * g.cells[at + 3]
        slack = _JOINT * (g.cells[r + C_LEFT] - g.cells[r + C_RIGHT])
        if (past if forward else -past) < -slack:
            t = math.inf
    if t == math.inf:
        side = 1 - side
        t = root(b, 0.0 if last == 4 * cell + side else f - 2.0 * g.cells[r + table.C_LEVEL_L + side], k, -slope)
    return t, side


@inner
def in_resin(g: Geometry, px: float, py: float, dx: float, dy: float, cell: int, last: int) -> tuple[float, int]:
    """Return the first surface that a ray in the resin meets, from cell to cell: distance and number, or (inf, -1).

    A ray that crosses the cross-section ahead between the edges, and heads for the same edge there as here, has met
    neither: decided without a root or a division, by the offset u there times |speed| through the section.
    """
    for _ in range(4 * g.cell_count + 8):
        if cell < 0:
            t, number, cell = _in_junction(g, px, py, dx, dy, cell, last)
            if number >= 0 or cell < 0:
                return t, number
        r = cell * CELL_COLUMNS
        k = g.cells[r + 4]
        gx, gy = k * (px - g.cells[r]) - g.cells[r + 2], k * (py - g.cells[r + 1]) - g.cells[r + 3]
        forward = gx * dy - gy * dx > 0.0
        at = r + (table.C_END if forward else table.C_START)
        x, y, tx, ty = px - g.cells[at], py - g.cells[at + 1], g.cells[at + 2], g.cells[at + 3]
        sign = 1.0 if forward else -1.0
        speed, short = sign * (dx * tx + dy * ty), -sign * (x * tx + y * ty)
        u = (y * tx - x * ty) * speed + short * (dy * tx - dx * ty)
        b = gx * dx + gy * dy
        clear = b * (b * speed + k * short) > 0.0 and g.cells[r + C_RIGHT] * speed <= u < g.cells[r + C_LEFT] * speed
        if not (clear and speed > 0.0):
            t, side = _at_edge(g, px, py, dx, dy, cell, last, forward)
            if t < math.inf:
                beyond = sign * ((x + t * dx) * tx + (y + t * dy) * ty)
                if beyond < 0.0 or (beyond == 0.0 and not forward):
                    return t, 4 * cell + side
        link = table.LINK_COLUMNS * cell
        after = g.links[link + (table.AFTER if forward else table.BEFORE)]
        bound = g.links[link + (table.WALL_AFTER if forward else table.WALL_BEFORE)]
        if bound != table.OPEN:
            wall, n = 4 * cell + (3 if forward else 2), after * CELL_COLUMNS
            if after == NO_CELL or u >= g.cells[n + C_LEFT] * speed or u < g.cells[n + C_RIGHT] * speed:
                if bound == table.FORK and u < g.cells[n + CELL_COLUMNS + C_LEFT] * speed:
                    cell = after + 1
                    continue
                if bound == table.WALLS and u < g.cells[n + C_RIGHT] * speed:
                    wall = 4 * after + (2 if forward else 3)
                return (short / speed, wall) if short > 0.0 and wall != last else (math.inf, -1)
        cell = after
    return math.inf, -1
