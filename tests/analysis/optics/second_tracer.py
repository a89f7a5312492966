"""A second tracer with secondaries, for reference counts: the outline's segments one by one, textbook circles, a heap.

It shares nothing with the product's tracer but the scene's outline, as `tests/analysis/optics/plain_tracer.py` does,
from which it takes the reading of the outline; compiled, so that a million rays are followed in seconds. Only counts:
powers are not followed. Budget by time of flight.
"""

from __future__ import annotations

import heapq
import math

import numpy as np
from numba import njit

from analysis.optics.scene.outline import Outline
from tests.analysis.optics.plain_tracer import Plain, chords, read

__all__ = ["chords", "detected", "read"]
CAP_MM, FAR = 1000.0, 1e300
SAME_PLACE_MM = 1e-9


@njit(cache=True)
def _nearest(a, b, centre, radius, middle, reach, px, py, dx, dy, last):  # type: ignore[no-untyped-def]
    best, at = FAR, -1
    for i in range(len(a)):
        ox, oy = middle[i, 0] - px, middle[i, 1] - py
        if abs(ox * dy - oy * dx) > reach[i] or ox * dx + oy * dy < -reach[i]:
            continue
        ex, ey = b[i, 0] - a[i, 0], b[i, 1] - a[i, 1]
        if math.isnan(radius[i]):
            if i == last:
                continue
            cross = dx * ey - dy * ex
            if cross == 0.0:
                continue
            qx, qy = a[i, 0] - px, a[i, 1] - py
            t, part = (qx * ey - qy * ex) / cross, (qx * dy - qy * dx) / cross
            if 0.0 < t < best and 0.0 <= part < 1.0:
                best, at = t, i
            continue
        mx, my = px - centre[i, 0], py - centre[i, 1]
        along = mx * dx + my * dy
        square = along * along - (mx * mx + my * my) + radius[i] ** 2
        if square <= 0.0:
            continue
        side = (centre[i, 0] - a[i, 0]) * ey - (centre[i, 1] - a[i, 1]) * ex
        for sign in (-1.0, 1.0):
            t = -along + sign * math.sqrt(square)
            if not (SAME_PLACE_MM if i == last else 0.0) < t < best:
                continue
            x, y = px + t * dx, py + t * dy
            if ((x - a[i, 0]) * ey - (y - a[i, 1]) * ex) * side < 0.0:
                best, at = t, i
    return best, at


@njit(cache=True)
def _count(  # type: ignore[no-untyped-def]
    a, b, centre, radius, middle, near, receiver, emitter, index, rays, phase, half, budget
):
    mid_x, mid_y = (receiver[0, 0] + receiver[1, 0]) / 2, (receiver[0, 1] + receiver[1, 1]) / 2
    reach = math.hypot(receiver[1, 0] - receiver[0, 0], receiver[1, 1] - receiver[0, 1]) / 2
    across_x = (receiver[1, 0] - receiver[0, 0]) / (2 * reach)
    across_y = (receiver[1, 1] - receiver[0, 1]) / (2 * reach)
    waiting = [(0.0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 1, -1)]
    waiting.clear()
    detected, granted, number = 0, 0, 0
    while True:
        if number < rays:
            turn = half * (2.0 * (number + 0.5 + phase) / rays - 1.0)
            c, s = math.cos(turn), math.sin(turn)
            px, py = emitter[0, 0], emitter[0, 1]
            dx, dy = c * emitter[1, 0] - s * emitter[1, 1], c * emitter[1, 1] + s * emitter[1, 0]
            flight, root, way, resin, last = 0.0, number, 0.0, 1, -1
            number += 1
        elif granted < budget and len(waiting) > 0:
            flight, root, px, py, dx, dy, way, resin, last = heapq.heappop(waiting)
            granted += 1
        else:
            return detected
        while True:
            t, i = _nearest(a, b, centre, radius, middle, near, px, py, dx, dy, last)
            if i < 0:
                break
            px, py, way, last = px + t * dx, py + t * dy, way + t, i
            flight += t * index if resin == 1 else t
            if way > CAP_MM:
                break
            fx, fy = px - mid_x, py - mid_y
            if abs(fx * across_y - fy * across_x) < 1e-9 and abs(fx * across_x + fy * across_y) <= reach:
                detected += 1 if resin == 1 else 0
                break
            if math.isnan(radius[i]):
                nx, ny = -(b[i, 1] - a[i, 1]), b[i, 0] - a[i, 0]
            else:
                nx, ny = px - centre[i, 0], py - centre[i, 1]
            size = math.hypot(nx, ny)
            nx, ny = nx / size, ny / size
            cosine = dx * nx + dy * ny
            ratio = index if resin == 1 else 1.0 / index
            square = 1.0 - ratio * ratio * (1.0 - cosine * cosine)
            rx, ry = dx - 2.0 * cosine * nx, dy - 2.0 * cosine * ny
            if square <= 0.0:
                dx, dy = rx, ry
                continue
            if budget > 0:
                heapq.heappush(waiting, (flight, root, px, py, rx, ry, way, resin, last))
            through = math.copysign(math.sqrt(square), cosine) - ratio * cosine
            dx, dy = ratio * dx + through * nx, ratio * dy + through * ny
            size = math.hypot(dx, dy)
            dx, dy, resin = dx / size, dy / size, 1 - resin


def detected(
    scene: Plain, shape: Outline, rays: int, budget: int, *, phase: float = 0.0, index: float = 1.5, cone: float = 120.0
) -> int:
    """Return how many rays reach the receiver, secondaries by time of flight included."""
    half_chord = np.hypot(*(scene.b - scene.a).T) / 2
    reach = 1.000001 * np.where(np.isnan(scene.radius), half_chord, 1.5 * half_chord)  # an arc here is a shallow one
    return int(
        _count(
            scene.a, scene.b, scene.centre, scene.radius, (scene.a + scene.b) / 2, reach, shape.receiver,
            shape.emitter, index, rays, phase, math.radians(cone) / 2, budget,
        )
    )  # fmt: skip
