"""Rays through one scene: Snell, Fresnel, total internal reflection, a budget of secondaries, and a ledger of all of
it.

Strategy: along a ray x = p + t d a surface's f is k t^2 / 2 + b t + c / 2 (see `frame.py`), so lines and arcs have one
formula, and the root with the right sign of slope is the one that leaves (or enters) the resin. The surface just left
has c = 0 exactly: its root at 0 is skipped without an epsilon. Whether a ray is in resin or air is a state that a
refraction turns over.

Rules: at a surface the refracted ray goes on, the reflected one may become a secondary; total reflection costs nothing.
A ray that lands within `corner` of a corner is given up, for no normal is defined there. Powers are in units of one
released ray until the summary divides by their number. Tables are read through pointers (see `compiled.py`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from analysis.optics.compiled import Floats, Ints, compiled, inner, pointer
from analysis.optics.frame import CORNER_A, CORNER_B, FORK_START, NO_CELL, RECEIVER
from analysis.optics.geometry import (
    AFTER,
    BEFORE,
    C_END,
    C_LEFT,
    C_LEVEL_L,
    C_RIGHT,
    C_START,
    CELL_COLUMNS,
    SURFACE_COLUMNS,
    WALL_AFTER,
    WALL_BEFORE,
    Geometry,
)

RELEASED, DETECTED, ESCAPED, TRAPPED, CUT, CORNER, DROPPED, HITS, GRANTED, REFUSED, TALLIES = range(11)
E_DETECTED, E_ESCAPED, E_ABSORBED, E_CUT, ENERGIES = range(5)
BY_TIME, BY_BOUNCE, BY_INDEX = range(3)
MOST_HITS = 1_000_000
_JOINT = 1e-9


class Rules(NamedTuple):
    """What the tracer keeps to: refractive index, attenuation (1/mm), path cap (mm), faintest power, corner (mm),
    order of the budget, the way along which light counts as detected, and the tick of time (mm) below which two
    flights are equal."""

    refractive: float
    attenuation: float
    path_cap: float
    faintest: float
    corner: float
    order: int
    way_x: float
    way_y: float
    tick: float


class Ray(NamedTuple):
    """A ray where it was born: place, direction, power, way and optical way so far (mm); medium (1 resin, 0 air), last
    surface, cell, number of the released ray it stems from, bounces so far."""

    x: float
    y: float
    dx: float
    dy: float
    power: float
    way: float
    optical: float
    medium: int
    last: int
    cell: int
    root: int
    bounce: int


RAY_NUMBERS, RAY_LABELS = 8, 5
KEY = 7
ROOT = 3


class Queue(NamedTuple):
    """Secondaries that may yet be followed, sorted by key: `rank[head:head + n]` are their slots.

    `state` is (head, n, how many the budget still affords); the other places of `rank` are free slots. `numbers`
    (capacity, 8) and `labels` (capacity, 5) hold the rays.
    """

    numbers: Floats
    labels: Ints
    rank: Ints
    state: Ints
    capacity: int


class Book(NamedTuple):
    """What has happened: counts, energies, detections by released ray, and the drawn ways of up to `room` points."""

    counts: Ints
    energy: Floats
    by_root: Ints
    drawn: Floats
    drawn_by: Ints
    room: int


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
        pointer(g.doors),
        pointer(g.boxes),
        pointer(g.branches),
        pointer(g.leaves),
        g.most_cells,
        g.all_surfaces,
        g.tree_nodes,
    )


@compiled
def queue_of(q: Queue) -> Queue:
    """The same queue with pointers for its arrays."""
    return Queue(pointer(q.numbers), pointer(q.labels), pointer(q.rank), pointer(q.state), q.capacity)


@compiled
def book_of(book: Book) -> Book:
    """The same book with pointers for its arrays."""
    return Book(
        pointer(book.counts),
        pointer(book.energy),
        pointer(book.by_root),
        pointer(book.drawn),
        pointer(book.drawn_by),
        book.room,
    )


@inner
def _root(b: float, c: float, k: float, slope: float) -> float:
    """First t > 0 with k t^2 + 2 b t + c = 0 and slope's sign, or inf; stable for k -> 0, exact for c = 0."""
    square = b * b - k * c
    if square < 0.0:
        return math.inf
    s = slope * math.sqrt(square)
    t: float = -c / (b + s) if slope * b > 0.0 else (s - b) / k
    return t if 0.0 < t < math.inf else math.inf


@inner
def _reach(table: Floats, i: int, px: float, py: float, dx: float, dy: float, slope: float, left: bool) -> float:
    """Distance along a ray to surface `i` within its extent, or inf."""
    r = i * SURFACE_COLUMNS
    qx, qy, nx, ny, k = px - table[r], py - table[r + 1], table[r + 2], table[r + 3], table[r + 4]
    b = dx * (k * qx - nx) + dy * (k * qy - ny)
    if slope * b <= 0.0 and slope * k <= 0.0:  # turned away, and the surface does not come round
        return math.inf
    if k == 0.0:
        if left:
            return math.inf
        t: float = (nx * qx + ny * qy + table[r + 5]) / b
        if t <= 0.0:
            return math.inf
    else:
        c = 0.0 if left else k * (qx * qx + qy * qy) - 2.0 * (nx * qx + ny * qy + table[r + 5])
        t = _root(b, c, k, slope)
        if t == math.inf:
            return t
    x, y = px + t * dx, py + t * dy
    if (x - table[r + 8]) * table[r + 10] + (y - table[r + 9]) * table[r + 11] < 0.0:
        return math.inf
    if (x - table[r + 12]) * table[r + 14] + (y - table[r + 13]) * table[r + 15] >= 0.0:
        return math.inf
    return t


@inner
def in_air(g: Geometry, px: float, py: float, dx: float, dy: float, last: int) -> tuple[float, int]:
    """Nearest surface in front of a ray in the air: distance and number, or (inf, -1)."""
    best, found, node = math.inf, -1, 0
    ax, ay = abs(dx), abs(dy)
    while node < g.tree_nodes:
        r = 4 * node
        cx, cy, ex, ey = g.boxes[r] - px, g.boxes[r + 1] - py, g.boxes[r + 2], g.boxes[r + 3]
        ahead, spread = cx * dx + cy * dy, ex * ax + ey * ay
        if abs(cx * dy - cy * dx) > ex * ay + ey * ax or ahead + spread < 0.0 or ahead - spread > best:
            node = g.branches[3 * node]
            continue
        for j in range(g.branches[3 * node + 1], g.branches[3 * node + 2]):
            number = g.leaves[j]
            slope = g.surfaces[number * SURFACE_COLUMNS + 6]
            t = _reach(g.surfaces, number, px, py, dx, dy, -slope, number == last)
            if g.kinds[number] == RECEIVER:
                t = min(t, _reach(g.surfaces, number, px, py, dx, dy, slope, number == last))
            if t < best:
                best, found = t, number
        node += 1
    return best, found


@inner
def _in_fork(g: Geometry, px: float, py: float, dx: float, dy: float, fork: int, last: int) -> tuple[float, int, int]:
    """Nearest surface of a junction, or the door into a guide: distance, number (-1 for a door), cell."""
    best, found, cell = math.inf, -1, fork
    for number in range(4 * g.most_cells, g.all_surfaces):
        if g.owners[number] == fork:
            t = _reach(g.surfaces, number, px, py, dx, dy, g.surfaces[number * SURFACE_COLUMNS + 6], number == last)
            if t < best:
                best, found = t, number
    at_start = fork == FORK_START
    for guide in range(2):
        c = g.doors[2 * guide + (0 if at_start else 1)]
        r = c * CELL_COLUMNS
        at = r + (C_START if at_start else C_END)
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
    """First edge of a cell that a ray inside meets: distance and side (0 left, 1 right), or inf.

    It meets the edge it heads for; only where that is the inside of a bend can it miss it and meet the other. A
    neighbour's bend may let it cross the circle before it comes to this cell; that crossing does not count.
    """
    r = cell * CELL_COLUMNS
    k, nx, ny = g.cells[r + 4], g.cells[r + 2], g.cells[r + 3]
    qx, qy = px - g.cells[r], py - g.cells[r + 1]
    b = dx * (k * qx - nx) + dy * (k * qy - ny)
    f = k * (qx * qx + qy * qy) - 2.0 * (nx * qx + ny * qy)
    side = 0 if b < 0.0 else 1
    t = _root(b, 0.0 if last == 4 * cell + side else f - 2.0 * g.cells[r + C_LEVEL_L + side], k, 2.0 * side - 1.0)
    if t < math.inf:
        at = r + (C_START if forward else C_END)
        past = (px + t * dx - g.cells[at]) * g.cells[at + 2] + (py + t * dy - g.cells[at + 1]) * g.cells[at + 3]
        slack = _JOINT * (g.cells[r + C_LEFT] - g.cells[r + C_RIGHT])
        if (past if forward else -past) < -slack:
            t = math.inf
    if t == math.inf:
        side = 1 - side
        t = _root(b, 0.0 if last == 4 * cell + side else f - 2.0 * g.cells[r + C_LEVEL_L + side], k, 2.0 * side - 1.0)
    return t, side


@inner
def in_resin(g: Geometry, px: float, py: float, dx: float, dy: float, cell: int, last: int) -> tuple[float, int]:
    """First surface that a ray in the resin meets, walking from cell to cell: distance and number, or (inf, -1).

    A ray that crosses the cross-section ahead between the edges, and heads for the same edge there as here, has met
    neither: told without a root or a division, by the offset u there times |speed| through the section.
    """
    for _ in range(4 * g.most_cells + 8):
        if cell < 0:
            t, number, cell = _in_fork(g, px, py, dx, dy, cell, last)
            if number >= 0 or cell < 0:
                return t, number
        r = cell * CELL_COLUMNS
        k = g.cells[r + 4]
        gx, gy = k * (px - g.cells[r]) - g.cells[r + 2], k * (py - g.cells[r + 1]) - g.cells[r + 3]
        forward = gx * dy - gy * dx > 0.0
        at = r + (C_END if forward else C_START)
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
        after = g.links[4 * cell + (AFTER if forward else BEFORE)]
        if g.links[4 * cell + (WALL_AFTER if forward else WALL_BEFORE)] == 1:
            wall, n = 4 * cell + (3 if forward else 2), after * CELL_COLUMNS
            if after == NO_CELL or u >= g.cells[n + C_LEFT] * speed or u < g.cells[n + C_RIGHT] * speed:
                return (short / speed, wall) if short > 0.0 and wall != last else (math.inf, -1)
        cell = after
    return math.inf, -1


@compiled
def _write(q: Queue, slot: int, ray: Ray, key: float) -> None:
    n, m = slot * RAY_NUMBERS, slot * RAY_LABELS
    q.numbers[n], q.numbers[n + 1], q.numbers[n + 2], q.numbers[n + 3] = ray.x, ray.y, ray.dx, ray.dy
    q.numbers[n + 4], q.numbers[n + 5], q.numbers[n + 6], q.numbers[n + 7] = ray.power, ray.way, ray.optical, key
    q.labels[m], q.labels[m + 1], q.labels[m + 2], q.labels[m + 3] = ray.medium, ray.last, ray.cell, ray.root
    q.labels[m + 4] = ray.bounce


@compiled
def read(q: Queue, slot: int) -> Ray:
    """The ray in a slot of the queue."""
    n, m = slot * RAY_NUMBERS, slot * RAY_LABELS
    return Ray(
        q.numbers[n],
        q.numbers[n + 1],
        q.numbers[n + 2],
        q.numbers[n + 3],
        q.numbers[n + 4],
        q.numbers[n + 5],
        q.numbers[n + 6],
        q.labels[m],
        q.labels[m + 1],
        q.labels[m + 2],
        q.labels[m + 3],
        q.labels[m + 4],
    )


@inner
def _sooner(q: Queue, key: float, root: int, slot: int) -> bool:
    other = q.numbers[slot * RAY_NUMBERS + KEY]
    return bool(key < other or (key == other and root < q.labels[slot * RAY_LABELS + ROOT]))


@compiled
def offer(q: Queue, ray: Ray, key: float, book: Book) -> None:
    """Put a secondary in its place in the queue; where the budget is full, the last in rank is refused."""
    head, n = q.state[0], q.state[1]
    end = head + n
    full = n == q.state[2]
    if full and (n == 0 or not _sooner(q, key, ray.root, q.rank[end - 1])):
        book.counts[REFUSED] += 1
        book.energy[E_CUT] += ray.power
        return
    low, high = head, end
    while low < high:
        middle = (low + high) // 2
        if _sooner(q, key, ray.root, q.rank[middle]):
            high = middle
        else:
            low = middle + 1
    if not full and head > 0 and (end == q.capacity or low - head < end - low):
        slot = q.rank[head - 1]
        for i in range(head, low):
            q.rank[i - 1] = q.rank[i]
        low -= 1
        q.state[0], q.state[1] = head - 1, n + 1
    else:
        last = end - 1 if full else end
        slot = q.rank[last]
        if full:
            book.counts[REFUSED] += 1
            book.energy[E_CUT] += q.numbers[slot * RAY_NUMBERS + 4]
        else:
            q.state[1] = n + 1
        for i in range(last, low, -1):
            q.rank[i] = q.rank[i - 1]
    q.rank[low] = slot
    _write(q, slot, ray, key)


@compiled
def _share(rules: Rules, child: Ray, q: Queue, book: Book) -> None:
    """Offer a reflected part to the budget, or give it up."""
    if child.power < rules.faintest or q.capacity == 0:
        book.counts[REFUSED] += 1 if child.power >= rules.faintest else 0
        book.energy[E_CUT] += child.power
    elif rules.order == BY_TIME:
        offer(q, child, math.floor(child.optical / rules.tick + 0.5), book)
    else:
        offer(q, child, float(child.bounce if rules.order == BY_BOUNCE else child.root), book)


@inner
def _draw(book: Book, x: float, y: float, power: float, number: int, medium: int) -> None:
    n = book.counts[TALLIES]
    if n < book.room:
        book.drawn[3 * n], book.drawn[3 * n + 1], book.drawn[3 * n + 2] = x, y, power
        book.drawn_by[2 * n], book.drawn_by[2 * n + 1] = number, medium
        book.counts[TALLIES] = n + 1


@inner
def _at_corner(g: Geometry, i: int, x: float, y: float, near: float) -> bool:
    corners, r = g.corners[i], i * SURFACE_COLUMNS
    if corners == 0:
        return False
    t = g.surfaces
    start = (x - t[r + 8]) * t[r + 10] + (y - t[r + 9]) * t[r + 11]
    end = (t[r + 12] - x) * t[r + 14] + (t[r + 13] - y) * t[r + 15]
    return bool((corners & CORNER_A != 0 and start < near) or (corners & CORNER_B != 0 and end < near))


@inner
def reflected_part(ratio: float, ci: float, ct: float) -> float:
    """Fresnel's reflectance of unpolarised light; `ratio` is n1 / n2, `ci` and `ct` the cosines inside and out."""
    rs, rp = (ratio * ci - ct) / (ratio * ci + ct), (ci - ratio * ct) / (ci + ratio * ct)
    return 0.5 * (rs * rs + rp * rp)


@inner
def _arrive(g: Geometry, rules: Rules, at: int, ray: Ray) -> int:
    """How a ray ends where it has just arrived: a tally, or -1 if it goes on."""
    if ray.way > rules.path_cap:
        return TRAPPED if ray.medium == 1 else CUT
    if g.kinds[at] == RECEIVER:
        return DETECTED if ray.dx * rules.way_x + ray.dy * rules.way_y > 0.0 else ESCAPED
    return CORNER if _at_corner(g, at, ray.x, ray.y, rules.corner) else -1


@inner
def _meet(g: Geometry, rules: Rules, at: int, ray: Ray, q: Queue, book: Book) -> Ray:
    """The ray as it goes on from surface `at`; a reflected part is offered to the budget."""
    r = at * SURFACE_COLUMNS
    k, inv, resin = g.surfaces[r + 4], g.surfaces[r + 7], ray.medium == 1
    nx = (k * (ray.x - g.surfaces[r]) - g.surfaces[r + 2]) * inv
    ny = (k * (ray.y - g.surfaces[r + 1]) - g.surfaces[r + 3]) * inv
    cosine = ray.dx * nx + ray.dy * ny
    ratio = rules.refractive if resin else 1.0 / rules.refractive
    square = 1.0 - ratio * ratio * (1.0 - cosine * cosine)
    rx, ry = ray.dx - 2.0 * cosine * nx, ray.dy - 2.0 * cosine * ny
    cell = g.owners[at]
    if square <= 0.0:
        return Ray(
            ray.x, ray.y, rx, ry, ray.power, ray.way, ray.optical, ray.medium, at, cell, ray.root, ray.bounce + 1
        )
    ct = math.sqrt(square)
    lost = ray.power * reflected_part(ratio, abs(cosine), ct)
    _share(
        rules,
        Ray(ray.x, ray.y, rx, ry, lost, ray.way, ray.optical, ray.medium, at, cell, ray.root, ray.bounce + 1),
        q,
        book,
    )
    turn = math.copysign(ct, cosine) - ratio * cosine
    tx, ty = ratio * ray.dx + turn * nx, ratio * ray.dy + turn * ny
    unit = 1.5 - 0.5 * (tx * tx + ty * ty)
    return Ray(
        ray.x,
        ray.y,
        tx * unit,
        ty * unit,
        ray.power - lost,
        ray.way,
        ray.optical,
        1 - ray.medium,
        at,
        cell,
        ray.root,
        ray.bounce + 1,
    )


@compiled
def follow(g: Geometry, rules: Rules, ray: Ray, q: Queue, book: Book, number: int) -> None:
    """Follow one ray to its end; its reflected parts go to the queue. Tables, queue and book come as pointers."""
    tally, hits = CUT, 0
    if book.room > 0:
        _draw(book, ray.x, ray.y, ray.power, number, ray.medium)
    while hits < MOST_HITS:
        resin = ray.medium == 1
        if resin:
            t, at = in_resin(g, ray.x, ray.y, ray.dx, ray.dy, ray.cell, ray.last)
        else:
            t, at = in_air(g, ray.x, ray.y, ray.dx, ray.dy, ray.last)
        if at < 0:
            tally = CORNER if resin else ESCAPED
            break
        power = ray.power
        if resin and rules.attenuation > 0.0:
            power *= math.exp(-rules.attenuation * t)
            book.energy[E_ABSORBED] += ray.power - power
        ray = Ray(
            ray.x + t * ray.dx,
            ray.y + t * ray.dy,
            ray.dx,
            ray.dy,
            power,
            ray.way + t,
            ray.optical + (t * rules.refractive if resin else t),
            ray.medium,
            ray.last,
            ray.cell,
            ray.root,
            ray.bounce,
        )
        hits += 1
        if book.room > 0:
            _draw(book, ray.x, ray.y, power, number, ray.medium)
        tally = _arrive(g, rules, at, ray)
        if tally >= 0:
            break
        ray = _meet(g, rules, at, ray, q, book)
        if ray.power < rules.faintest:
            tally = DROPPED
            break
    book.counts[HITS] += hits
    tally = CUT if tally < 0 else tally
    book.counts[tally] += 1
    if tally == DETECTED:
        book.by_root[ray.root] += 1
    book.energy[E_DETECTED if tally == DETECTED else E_ESCAPED if tally == ESCAPED else E_CUT] += ray.power
