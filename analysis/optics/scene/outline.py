"""The outline of a scene: closed contours of lines and arcs, for drawing and for other programs.

The contours are chained from the very surfaces the tracer uses, arcs as arcs, so that a picture or another simulator
shows the same scene.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from analysis.optics.scene.frame import NO_SURFACE, RECEIVER, SceneFrame
from analysis.optics.scene.geometry import geometry_of
from analysis.optics.scene.parameters import Design
from protocol.base.arrays import FloatArray

_ARC_POINTS = 9
_JOINED_MM = 1e-7


@dataclass(frozen=True, slots=True)
class Contour:
    """A closed line: `points` (n, 2) in mm and for each the middle of the arc to the next one, NaN for a line."""

    points: FloatArray
    middles: FloatArray

    def sampled(self) -> FloatArray:
        """Return the contour as a polygon (k, 2) for drawing."""
        out = []
        for start, middle, end in zip(self.points, self.middles, np.roll(self.points, -1, axis=0), strict=True):
            out.append(start[None] if np.isnan(middle[0]) else _arc_points(start, middle, end))
        return np.concatenate(out)

    @property
    def area(self) -> float:
        """Return the signed area of the polygon, mm^2; positive if it turns to the left."""
        x, y = self.sampled().T
        return float(0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


@dataclass(frozen=True, slots=True)
class Outline:
    """The outline of a scene."""

    contours: tuple[Contour, ...]
    receiver: FloatArray  # (2, 2) its segment, NaN without one
    emitter: FloatArray  # (2, 2) its point and direction


def laid(frame: SceneFrame, points: FloatArray) -> FloatArray:
    """Return points (n, 2) turned so that the actuator lies along x from the emitter at 0, mm."""
    axis = frame.emitter[2:]
    moved = points - frame.emitter[:2]
    return np.stack([moved @ axis, moved @ np.array([-axis[1], axis[0]])], axis=1)


def _arc_points(start: FloatArray, middle: FloatArray, end: FloatArray) -> FloatArray:
    chord = end - start
    half = np.hypot(*chord) / 2
    rise = middle - (start + end) / 2
    turn = 2 * math.atan2(float(np.hypot(*rise)), half)
    part = np.linspace(-1.0, 1.0, _ARC_POINTS)[:-1] * turn
    along = chord / (2 * half)
    across = rise / max(float(np.hypot(*rise)), 1e-300)
    radius = half / math.sin(turn) if turn > 1e-9 else math.inf
    if math.isinf(radius):
        return start[None]
    offset = radius * (np.cos(part) - math.cos(turn))
    return np.asarray((start + end) / 2 + (radius * np.sin(part))[:, None] * along + offset[:, None] * across)


def outline(frame: SceneFrame, design: Design) -> Outline:
    """Chain the surfaces of a scene into closed contours."""
    g = geometry_of(frame, design)
    kept = (g.kinds != NO_SURFACE) & (g.kinds != RECEIVER)
    receivers = g.surfaces[g.kinds == RECEIVER]
    receiver = np.stack([receivers[0, 8:10], receivers[0, 12:14]]) if len(receivers) else np.full((2, 2), np.nan)
    contours = sorted(_chained(g.surfaces[kept]), key=lambda contour: -abs(contour.area))
    return Outline(tuple(contours), receiver, np.stack([frame.emitter[:2], frame.emitter[2:]]))


def _chained(surfaces: FloatArray) -> list[Contour]:
    """Join surfaces end to end; a gap (of the receiver) is closed by a line."""
    ends = np.stack([surfaces[:, 8:10], surfaces[:, 12:14]], axis=1)
    middles = np.array([_middle(row) for row in surfaces])
    left, contours = np.ones(len(surfaces), dtype=bool), []
    while left.any():
        chain = [(int(np.argmax(left)), 0)]
        left[chain[0][0]] = False
        for grow_back in (False, True):
            while left.any():
                surface, start = chain[0] if grow_back else chain[-1]
                apart = ends - ends[surface, start if grow_back else 1 - start]
                distance = np.where(left[:, None], np.hypot(apart[..., 0], apart[..., 1]), np.inf)
                i, e = divmod(int(np.argmin(distance)), 2)
                if distance[i, e] > _JOINED_MM:
                    break
                left[i] = False
                if grow_back:
                    chain.insert(0, (i, 1 - e))
                else:
                    chain.append((i, e))
        contours.append(_contour(chain, ends, middles))
    return contours


def _contour(chain: list[tuple[int, int]], ends: FloatArray, middles: FloatArray) -> Contour:
    points = [ends[i, e] for i, e in chain]
    arcs = [middles[i] for i, _ in chain]
    last = ends[chain[-1][0], 1 - chain[-1][1]]
    if np.hypot(*(last - points[0])) > _JOINED_MM:
        points.append(last)
        arcs.append(np.full(2, np.nan))
    return Contour(np.array(points), np.array(arcs))


def _middle(row: FloatArray) -> FloatArray:
    bend = row[4] * row[7]
    chord = row[12:14] - row[8:10]
    half = float(np.hypot(*chord)) / 2
    if abs(bend) * half < 1e-9:
        return np.full(2, np.nan)
    rise = half * math.tan(math.asin(bend * half) / 2)
    return np.asarray((row[8:10] + row[12:14]) / 2 - rise * np.array([-chord[1], chord[0]]) / (2 * half))
