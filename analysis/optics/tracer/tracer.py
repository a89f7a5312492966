"""One ray through a scene, from surface to surface to its end: Snell, Fresnel, total internal reflection.

Rules: at a surface the refracted ray is followed, the reflected one may become a secondary (`budget.py`); total
reflection costs nothing. Whether a ray is in resin or air is a state that a refraction changes. A ray that lands within
`corner_mm` of a corner is given up, for no normal is defined there. Tables are read through pointers (see
`analysis.compiled`).
"""

from __future__ import annotations

import math

from analysis.compiled import inner, inside
from analysis.optics.scene.frame import CORNER_A, CORNER_B, RECEIVER
from analysis.optics.scene.geometry import C_INVERSE_L, CELL_COLUMNS, SURFACE_COLUMNS, Geometry
from analysis.optics.tracer import tally as ledger
from analysis.optics.tracer.budget import Queue, offer
from analysis.optics.tracer.nearest import in_air, in_resin
from analysis.optics.tracer.rays import BY_BOUNCE, BY_TIME, Ray, Rules
from analysis.optics.tracer.tally import DETECTED, Tally, draw

MOST_HITS = 200_000  # beyond, rounding turns a ray that creeps along a wall


@inner
def reflected_part(ratio: float, ci: float, ct: float) -> float:
    """Return Fresnel's reflectance of unpolarised light."""
    rs, rp = (ratio * ci - ct) / (ratio * ci + ct), (ci - ratio * ct) / (ci + ratio * ct)
    return 0.5 * (rs * rs + rp * rp)


@inner
def _share(rules: Rules, child: Ray, q: Queue, tally: Tally) -> None:
    """Offer a reflected part to the budget, or drop it."""
    if child.power < rules.faintest:
        tally.energy[ledger.E_CUT] += child.power
        return
    key = float(child.root)
    if rules.order == BY_TIME:
        key = math.floor(child.optical_path_mm / rules.tick_mm + 0.5)
    elif rules.order == BY_BOUNCE:
        key = float(child.bounce)
    offer(q, child, key, -1, tally)


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
    """Return how a ray ends where it has just arrived: an entry of the ledger, or -1 if it continues."""
    if ray.path_mm > rules.path_cap_mm:
        return ledger.TRAPPED if ray.medium == 1 else ledger.CUT
    if g.kinds[at] == RECEIVER:
        along = ray.dx * g.receiver_direction[0] + ray.dy * g.receiver_direction[1]
        return DETECTED if along > 0.0 else ledger.ESCAPED
    return ledger.CORNER if _at_corner(g, at, ray.x, ray.y, rules.corner_mm) else -1


@inner
def _normal(g: Geometry, at: int, x: float, y: float) -> tuple[float, float]:
    """Return the unit normal of surface `at` at a point on it; a cell's edges take it from the cell, already loaded."""
    if at < 4 * g.cell_count and at & 2 == 0:
        r = (at >> 2) * CELL_COLUMNS
        k, inverse = g.cells[r + 4], g.cells[r + C_INVERSE_L + (at & 1)]
        return (k * (x - g.cells[r]) - g.cells[r + 2]) * inverse, (k * (y - g.cells[r + 1]) - g.cells[r + 3]) * inverse
    r, t = at * SURFACE_COLUMNS, g.surfaces
    return (t[r + 4] * (x - t[r]) - t[r + 2]) * t[r + 7], (t[r + 4] * (y - t[r + 1]) - t[r + 3]) * t[r + 7]


@inner
def _meet(g: Geometry, rules: Rules, at: int, ray: Ray, q: Queue, tally: Tally) -> Ray:
    """Return the ray as it leaves surface `at`; a reflected part is offered to the budget."""
    nx, ny = _normal(g, at, ray.x, ray.y)
    cosine = ray.dx * nx + ray.dy * ny
    ratio = rules.refractive if ray.medium == 1 else 1.0 / rules.refractive
    # 1 - ratio^2 (1 - cosine^2) without cancellation: a grazing ray passes where both indices are the same
    square = (1.0 - ratio) * (1.0 + ratio) + ratio * ratio * cosine * cosine
    rx, ry = ray.dx - 2.0 * cosine * nx, ray.dy - 2.0 * cosine * ny
    cell = at >> 2 if at < 4 * g.cell_count else g.owners[at]
    power, path, optical = ray.power, ray.path_mm, ray.optical_path_mm
    medium, root, bounce = ray.medium, ray.root, ray.bounce + 1
    if square <= 0.0:
        return Ray(ray.x, ray.y, rx, ry, power, path, optical, medium, at, cell, root, bounce)
    ct = math.sqrt(square)
    lost = power * reflected_part(ratio, abs(cosine), ct)
    _share(rules, Ray(ray.x, ray.y, rx, ry, lost, path, optical, medium, at, cell, root, bounce), q, tally)
    turn = math.copysign(ct, cosine) - ratio * cosine
    tx, ty = ratio * ray.dx + turn * nx, ratio * ray.dy + turn * ny
    unit = 1.5 - 0.5 * (tx * tx + ty * ty)
    return Ray(ray.x, ray.y, tx * unit, ty * unit, power - lost, path, optical, 1 - medium, at, cell, root, bounce)


@inside
def follow(g: Geometry, rules: Rules, ray: Ray, q: Queue, tally: Tally, number: int) -> None:
    """Follow one ray to its end."""
    end, hits = ledger.CUT, 0
    if tally.capacity > 0:
        draw(tally, ray.x, ray.y, ray.power, number, ray.medium)
    while hits < MOST_HITS:
        resin = ray.medium == 1
        if resin:
            t, at = in_resin(g, ray.x, ray.y, ray.dx, ray.dy, ray.cell, ray.last)
        else:
            t, at = in_air(g, ray.x, ray.y, ray.dx, ray.dy, ray.last)
        if at < 0:
            end = ledger.CORNER if resin else ledger.ESCAPED
            break
        power = ray.power
        if resin and rules.attenuation > 0.0:
            power *= math.exp(-rules.attenuation * t)
            tally.energy[ledger.E_ABSORBED] += ray.power - power
        x, y, path = ray.x + t * ray.dx, ray.y + t * ray.dy, ray.path_mm + t
        optical = ray.optical_path_mm + (t * rules.refractive if resin else t)
        last, cell, root = ray.last, ray.cell, ray.root
        ray = Ray(x, y, ray.dx, ray.dy, power, path, optical, ray.medium, last, cell, root, ray.bounce)
        hits += 1
        if tally.capacity > 0:
            draw(tally, x, y, power, number, ray.medium)
        end = _arrive(g, rules, at, ray)
        if end >= 0:
            break
        ray = _meet(g, rules, at, ray, q, tally)
        if ray.power < rules.faintest:
            end = ledger.DROPPED
            break
    tally.counts[ledger.HITS] += hits
    end = ledger.CUT if end < 0 else end
    tally.counts[end] += 1
    if end == DETECTED:
        tally.by_root[2 * ray.root] += 1.0
        tally.by_root[2 * ray.root + 1] += ray.power
    tally.energy[
        ledger.E_DETECTED if end == DETECTED else ledger.E_ESCAPED if end == ledger.ESCAPED else ledger.E_CUT
    ] += ray.power
