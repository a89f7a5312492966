"""A smooth curve through points, made of circular arcs: its offsets are arcs again, exactly.

Rules: an arc is its start point, unit tangent, curvature and length; a straight line is an arc of curvature 0, not a
special case. Joints share one point and one tangent, bit for bit. Positions along a curve are measured by arc length s;
offsets u to the left of its direction are positive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError


@dataclass(frozen=True, slots=True)
class ArcSpline:
    """Consecutive arcs with a common tangent at every joint."""

    nodes: FloatArray  # (m + 1, 5) x, y, unit tangent x, y, arc length s of each joint, mm
    curvature: FloatArray  # (m,) of each arc, 1/mm, positive to the left

    @property
    def length(self) -> float:
        return float(self.nodes[-1, 4])

    def frame(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points (n, 2) in mm and unit tangents (n, 2) at arc lengths `s` (n,); the end arcs are extended."""
        s = np.asarray(s, dtype=float)
        i = np.clip(np.searchsorted(self.nodes[:, 4], s, side="right") - 1, 0, len(self.curvature) - 1)
        step = s - self.nodes[i, 4]
        turn = self.curvature[i] * step
        tangent = self.nodes[i, 2:4]
        normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
        along = step * np.sinc(turn / np.pi)
        across = step * np.sin(turn / 2) * np.sinc(turn / (2 * np.pi))
        point = self.nodes[i, :2] + along[:, None] * tangent + across[:, None] * normal
        turned = np.cos(turn)[:, None] * tangent + np.sin(turn)[:, None] * normal
        return point, turned

    def offset(self, s: FloatArray, u: float) -> FloatArray:
        """Return points (n, 2) at arc lengths `s`, `u` mm to the left of the curve."""
        point, tangent = self.frame(s)
        return point + u * np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)

    def reversed(self) -> ArcSpline:
        nodes = self.nodes[::-1].copy()
        nodes[:, 2:4] *= -1
        nodes[:, 4] = self.length - nodes[:, 4]
        return ArcSpline(nodes, -self.curvature[::-1])


def smooth(points: FloatArray, knots: int = 10) -> tuple[FloatArray, FloatArray]:
    """Return points (k, 2), mm, and unit tangents (k, 2) of the cubic spline through `points`, at `knots` or more."""
    chord = np.hypot(*np.diff(points, axis=0).T)
    if not np.all(chord > 1e-9 * chord.sum()):
        raise DataError("two neighbouring points of a guide coincide", "remove the repeated point from the curve file")
    length = np.concatenate([[0.0], np.cumsum(chord)])
    spline = CubicSpline(length, points)
    at = length if len(points) >= knots else np.linspace(0.0, length[-1], knots)
    velocity = spline(at, 1)
    return spline(at), velocity / np.hypot(velocity[:, 0], velocity[:, 1])[:, None]


def biarcs(points: FloatArray, tangents: FloatArray) -> ArcSpline:
    """Join points (n, 2) with unit tangents (n, 2) by biarcs with equal control lengths d, |v - d (T0 + T1)| = 2 d.

    Source: K. M. Bolton, Biarc curves, Computer-Aided Design 7 (1975) 89-92.
    """
    v = np.diff(points, axis=0)
    t0, t1 = tangents[:-1], tangents[1:]
    both = np.sum(v * (t0 + t1), axis=1)
    open_ = 2 * (1 - np.sum(t0 * t1, axis=1))
    square = np.sum(v * v, axis=1)
    if np.any(np.sum(v * t0, axis=1) <= 0) or np.any(np.sum(v * t1, axis=1) <= 0):
        cause = "a guide doubles back on itself between two of its points"
        raise DataError(cause, "give its points in order along the guide, and more of them where it bends sharply")
    d = (square / (both + np.sqrt(both**2 + np.maximum(open_, 0.0) * square)))[:, None]
    middle = (points[:-1] + d * t0 + points[1:] - d * t1) / 2
    along = v - d * (t0 + t1)
    middle_tangent = along / np.hypot(along[:, 0], along[:, 1])[:, None]
    xy = np.empty((2 * len(v) + 1, 2))
    tangent = np.empty_like(xy)
    xy[::2], xy[1::2] = points, middle
    tangent[::2], tangent[1::2] = tangents, middle_tangent
    return _from_joints(xy, tangent)


def _from_joints(xy: FloatArray, tangent: FloatArray) -> ArcSpline:
    chord = np.diff(xy, axis=0)
    cross = tangent[:-1, 0] * chord[:, 1] - tangent[:-1, 1] * chord[:, 0]
    dot = np.sum(tangent[:-1] * chord, axis=1)
    half = np.arctan2(cross, dot)
    length = np.hypot(chord[:, 0], chord[:, 1]) / np.sinc(half / np.pi)
    curvature = 2 * cross / np.sum(chord * chord, axis=1)
    s = np.concatenate([[0.0], np.cumsum(length)])
    return ArcSpline(np.column_stack([xy, tangent, s]), curvature)


def straight(start: tuple[float, float], end: tuple[float, float]) -> ArcSpline:
    """Return a straight line as an arc spline of one arc, mm."""
    xy = np.array([start, end], dtype=float)
    span = xy[1] - xy[0]
    length = np.hypot(*span)
    tangent = span / length
    nodes = np.column_stack([xy, [tangent, tangent], [0.0, length]])
    return ArcSpline(nodes, np.zeros(1))


def ring(radius_mm: float, angle_rad: float, arcs: int = 2) -> ArcSpline:
    """Return a sector of a ring about the origin, from the positive x axis to the left, in `arcs` equal arcs."""
    at = np.linspace(0.0, angle_rad, arcs + 1)
    nodes = np.column_stack([radius_mm * np.cos(at), radius_mm * np.sin(at), -np.sin(at), np.cos(at), radius_mm * at])
    return ArcSpline(nodes, np.full(arcs, 1.0 / radius_mm))
