"""A second tracer, written for comparison only: every surface tried for every ray, textbook circles, no cells, no tree.

It shares nothing with the compiled one but the scene's outline, which it reads as arcs through three points or, on
demand, as chords. Which side a ray is on is a state; the surface just left is skipped by its parameter, corners are
not looked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from analysis.optics.scene.outline import Contour, Outline


@dataclass
class Plain:
    """Segments a, b (n, 2); centre (n, 2) and radius (n,), NaN where a segment is straight."""

    a: np.ndarray
    b: np.ndarray
    centre: np.ndarray
    radius: np.ndarray


def _circle(a: np.ndarray, m: np.ndarray, b: np.ndarray) -> np.ndarray:
    system = 2 * np.array([m - a, b - a])
    return np.linalg.solve(system, np.array([m @ m - a @ a, b @ b - a @ a]))


def read(shape: Outline) -> Plain:
    """The outline's segments as they are, arcs as arcs."""
    a, b, c, r = [], [], [], []
    for contour in shape.contours:
        for start, middle, end in zip(
            contour.points, contour.middles, np.roll(contour.points, -1, axis=0), strict=True
        ):
            a.append(start)
            b.append(end)
            centre = np.full(2, np.nan) if np.isnan(middle[0]) else _circle(start, middle, end)
            c.append(centre)
            r.append(np.nan if np.isnan(middle[0]) else float(np.hypot(*(start - centre))))
    return Plain(np.array(a), np.array(b), np.array(c), np.array(r))


def chords(shape: Outline, length_mm: float) -> Plain:
    """The outline as straight chords of about `length_mm`."""
    rings = [_chopped(contour, length_mm) for contour in shape.contours]
    a = np.concatenate(rings)
    b = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    return Plain(a, b, np.full_like(a, np.nan), np.full(len(a), np.nan))


def _chopped(contour: Contour, length_mm: float) -> np.ndarray:
    out = []
    for start, middle, end in zip(contour.points, contour.middles, np.roll(contour.points, -1, axis=0), strict=True):
        if np.isnan(middle[0]):
            out.append(start[None])
            continue
        centre = _circle(start, middle, end)
        first, last = (math.atan2(*(p - centre)[::-1]) for p in (start, end))
        turn = (last - first + math.pi) % (2 * math.pi) - math.pi
        radius = float(np.hypot(*(start - centre)))
        n = max(1, math.ceil(abs(turn) * radius / length_mm))
        angle = first + turn * np.arange(n) / n
        out.append(centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return np.concatenate(out)


def nearest(scene: Plain, p: np.ndarray, d: np.ndarray, last: int) -> tuple[float, int]:
    """Smallest t > 0 at which p + t d meets a segment, and its number; (inf, -1) if none."""
    t = np.full((2, len(scene.a)), np.inf)
    e = scene.b - scene.a
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = d[0] * e[:, 1] - d[1] * e[:, 0]
        q = scene.a - p
        along = (q[:, 0] * e[:, 1] - q[:, 1] * e[:, 0]) / cross
        part = (q[:, 0] * d[1] - q[:, 1] * d[0]) / cross
        t[0] = np.where(np.isnan(scene.radius) & (part >= 0) & (part < 1), along, np.inf)
        m = p - scene.centre
        b = m @ d
        root = np.sqrt(b * b - np.sum(m * m, axis=1) + scene.radius**2)
        for k, sign in enumerate((-1, 1)):
            s = -b + sign * root
            x = p + s[:, None] * d
            side_x = (x[:, 0] - scene.a[:, 0]) * e[:, 1] - (x[:, 1] - scene.a[:, 1]) * e[:, 0]
            side_c = (scene.centre[:, 0] - scene.a[:, 0]) * e[:, 1] - (scene.centre[:, 1] - scene.a[:, 1]) * e[:, 0]
            t[k] = np.where(~np.isnan(scene.radius) & (side_x * side_c < 0), s, t[k])
    t[~(t > 0)] = np.inf
    if last >= 0:
        same = t[:, last]
        t[:, last] = np.where(same < 1e-9, np.inf, same)
    i = int(np.argmin(t.min(axis=0)))
    return float(t[:, i].min()), i


def follow(
    scene: Plain, shape: Outline, index: float, p: np.ndarray, d: np.ndarray, cap: float = 1000.0
) -> tuple[str, int]:
    """Follow one ray without secondaries: its end ('detected', 'escaped', 'trapped') and the surfaces it met."""
    resin, last, hits, way = True, -1, 0, 0.0
    receiver = shape.receiver
    middle, half = receiver.mean(axis=0), float(np.hypot(*(receiver[1] - receiver[0]))) / 2
    while True:
        t, i = nearest(scene, p, d, last)
        if not math.isfinite(t):
            return "escaped", hits
        p, hits, way, last = p + t * d, hits + 1, way + t, i
        if way > cap:
            return "trapped", hits
        if np.hypot(*(p - middle)) <= half and _on(receiver, p):
            return "detected", hits
        n = _normal(scene, i, p)
        c = float(n @ d)
        ratio = index if resin else 1 / index
        square = 1 - ratio**2 * (1 - c * c)
        if square <= 0:
            d = d - 2 * c * n
        else:
            d = ratio * (d - c * n) + math.copysign(math.sqrt(square), c) * n
            resin = not resin
        d = d / np.hypot(*d)


def _on(segment: np.ndarray, p: np.ndarray) -> bool:
    e = segment[1] - segment[0]
    return bool(abs((p - segment[0]) @ np.array([-e[1], e[0]])) < 1e-9 * (e @ e))


def _normal(scene: Plain, i: int, p: np.ndarray) -> np.ndarray:
    if np.isnan(scene.radius[i]):
        e = scene.b[i] - scene.a[i]
        return np.array([-e[1], e[0]]) / np.hypot(*e)
    return (p - scene.centre[i]) / scene.radius[i]


def fan(emitter: np.ndarray, rays: int, cone_deg: float = 120.0) -> tuple[np.ndarray, list[np.ndarray]]:
    """The emitter's point and the directions of a uniform fan."""
    angle = math.radians(cone_deg) * ((np.arange(rays) + 0.5) / rays - 0.5)
    way = emitter[1]
    return emitter[0], [
        np.array([math.cos(t) * way[0] - math.sin(t) * way[1], math.cos(t) * way[1] + math.sin(t) * way[0]])
        for t in angle
    ]


def count(scene: Plain, shape: Outline, index: float, rays: int) -> tuple[dict[str, int], int]:
    """Ends of all rays of the fan, and the surfaces they met."""
    point, ways = fan(shape.emitter, rays)
    ends = [follow(scene, shape, index, point, way) for way in ways]
    return {name: sum(end == name for end, _ in ends) for name in ("detected", "escaped", "trapped")}, sum(
        h for _, h in ends
    )
