"""One ray through a scene, from surface to surface to its end: Snell, Fresnel, total internal reflection.

Rules: at a surface the refracted ray goes on, the reflected one may become a secondary (`budget.py`); total reflection
costs nothing. Whether a ray is in resin or air is a state that a refraction turns over. A ray that lands within
`corner` of a corner is given up, for no normal is defined there. Tables are read through pointers (see `compiled.py`).
"""

from __future__ import annotations

import math

from analysis.optics.compiled import compiled, inner
from analysis.optics.scene.frame import CORNER_A, CORNER_B, RECEIVER
from analysis.optics.scene.geometry import C_INVERSE_L, CELL_COLUMNS, SURFACE_COLUMNS, Geometry
from analysis.optics.tracer.budget import Queue, offer
from analysis.optics.tracer.nearest import in_air, in_resin
from analysis.optics.tracer.rays import (
    BY_BOUNCE,
    BY_TIME,
    CORNER,
    CUT,
    DETECTED,
    DROPPED,
    E_ABSORBED,
    E_CUT,
    E_DETECTED,
    E_ESCAPED,
    ESCAPED,
    HITS,
    TRAPPED,
    Book,
    Ray,
    Rules,
    draw,
)

MOST_HITS = 200_000
"""Beyond, rounding turns a ray that creeps along a wall."""


@inner
def reflected_part(ratio: float, ci: float, ct: float) -> float:
    """Fresnel's reflectance of unpolarised light; `ratio` is n1 / n2, `ci` and `ct` the cosines inside and out."""
    rs, rp = (ratio * ci - ct) / (ratio * ci + ct), (ci - ratio * ct) / (ci + ratio * ct)
    return 0.5 * (rs * rs + rp * rp)


@inner
def _share(rules: Rules, child: Ray, q: Queue, book: Book) -> None:
    """Offer a reflected part to the budget, or give it up."""
    if child.power < rules.faintest:
        book.energy[E_CUT] += child.power
        return
    key = float(child.root)
    if rules.order == BY_TIME:
        key = math.floor(child.optical / rules.tick + 0.5)
    elif rules.order == BY_BOUNCE:
        key = float(child.bounce)
    offer(q, child, key, -1, book)


@inner
def _at_corner(g: Geometry, i: int, x: float, y: float, near: float) -> bool:
    corners = g.corners[i] & (CORNER_A | CORNER_B)
    if corners == 0:
        return False
    t, r = g.surfaces, i * SURFACE_COLUMNS
    start = (x - t[r + 8]) * t[r + 10] + (y - t[r + 9]) * t[r + 11]
    end = (t[r + 12] - x) * t[r + 14] + (t[r + 13] - y) * t[r + 15]
    return bool((corners & CORNER_A != 0 and start < near) or (corners & CORNER_B != 0 and end < near))


@inner
def _arrive(g: Geometry, rules: Rules, at: int, ray: Ray) -> int:
    """How a ray ends where it has just arrived: a tally, or -1 if it goes on."""
    if ray.way > rules.path_cap:
        return TRAPPED if ray.medium == 1 else CUT
    if g.kinds[at] == RECEIVER:
        return DETECTED if ray.dx * rules.way_x + ray.dy * rules.way_y > 0.0 else ESCAPED
    return CORNER if _at_corner(g, at, ray.x, ray.y, rules.corner) else -1


@inner
def _normal(g: Geometry, at: int, x: float, y: float) -> tuple[float, float]:
    """The unit normal of surface `at` at a point on it. A cell's edges take it from the cell, which is at hand."""
    if at < 4 * g.most_cells and at & 2 == 0:
        r = (at >> 2) * CELL_COLUMNS
        k, inverse = g.cells[r + 4], g.cells[r + C_INVERSE_L + (at & 1)]
        return (k * (x - g.cells[r]) - g.cells[r + 2]) * inverse, (k * (y - g.cells[r + 1]) - g.cells[r + 3]) * inverse
    r, t = at * SURFACE_COLUMNS, g.surfaces
    return (t[r + 4] * (x - t[r]) - t[r + 2]) * t[r + 7], (t[r + 4] * (y - t[r + 1]) - t[r + 3]) * t[r + 7]


@inner
def _meet(g: Geometry, rules: Rules, at: int, ray: Ray, q: Queue, book: Book) -> Ray:
    """The ray as it goes on from surface `at`; a reflected part is offered to the budget."""
    nx, ny = _normal(g, at, ray.x, ray.y)
    cosine = ray.dx * nx + ray.dy * ny
    ratio = rules.refractive if ray.medium == 1 else 1.0 / rules.refractive
    # 1 - ratio^2 (1 - cosine^2) without cancellation: a grazing ray passes where both indices are the same
    square = (1.0 - ratio) * (1.0 + ratio) + ratio * ratio * cosine * cosine
    rx, ry = ray.dx - 2.0 * cosine * nx, ray.dy - 2.0 * cosine * ny
    cell = at >> 2 if at < 4 * g.most_cells else g.owners[at]
    power, way, optical, medium, root, bounce = ray.power, ray.way, ray.optical, ray.medium, ray.root, ray.bounce + 1
    if square <= 0.0:
        return Ray(ray.x, ray.y, rx, ry, power, way, optical, medium, at, cell, root, bounce)
    ct = math.sqrt(square)
    lost = power * reflected_part(ratio, abs(cosine), ct)
    _share(rules, Ray(ray.x, ray.y, rx, ry, lost, way, optical, medium, at, cell, root, bounce), q, book)
    turn = math.copysign(ct, cosine) - ratio * cosine
    tx, ty = ratio * ray.dx + turn * nx, ratio * ray.dy + turn * ny
    unit = 1.5 - 0.5 * (tx * tx + ty * ty)
    return Ray(ray.x, ray.y, tx * unit, ty * unit, power - lost, way, optical, 1 - medium, at, cell, root, bounce)


@compiled
def follow(g: Geometry, rules: Rules, ray: Ray, q: Queue, book: Book, number: int) -> None:
    """Follow one ray to its end; its reflected parts go to the queue. Tables, queue and book come as pointers."""
    tally, hits = CUT, 0
    if book.room > 0:
        draw(book, ray.x, ray.y, ray.power, number, ray.medium)
    while hits < MOST_HITS:
        resin = ray.medium == 1
        if resin and g.most_cells > 0:
            t, at = in_resin(g, ray.x, ray.y, ray.dx, ray.dy, ray.cell, ray.last)
        else:
            t, at = in_air(g, ray.x, ray.y, ray.dx, ray.dy, ray.last, resin)
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
            draw(book, ray.x, ray.y, power, number, ray.medium)
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
