"""A scene as others see it: its outline for drawing, and a file for the 2D simulator 'ray-optics' (JSON, version 5).

The outline is chained from the very surfaces the tracer uses, arcs as arcs, so that a picture or a peer shows the
same scene. In ray-optics the resin is one Glass whose path runs round the outside, through a slit (two coincident
lines, which that program takes for no surface) and round the hole between the guides. Its point source leaves out the
last angle of its cone: the fan is turned by half a step to stand where ours does. A blocker behind the detector ends
what was counted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.arrays import FloatArray
from analysis.errors import DataError, RequestError
from analysis.optics.scene.frame import NOTHING, RECEIVER, Frame, check_row
from analysis.optics.scene.geometry import geometry_of
from analysis.optics.scene.parameters import Design, Light, Waveguide
from analysis.optics.tracer.simulation import fan_of, released

_PER_MM = 15.0
_DEPTH = 20_000
_BEFORE_FACE_MM = 1e-3
_SOURCE_STEPS = 500
_MOST_SINGLE = 20_000
_ARC_POINTS = 9


@dataclass(frozen=True, slots=True)
class Loop:
    """A closed outline: `points` (n, 2) in mm and for each the middle of the arc to the next one, NaN for a line."""

    points: FloatArray
    middles: FloatArray

    def sampled(self) -> FloatArray:
        """The outline as a polygon (k, 2) for drawing."""
        out = []
        for start, middle, end in zip(self.points, self.middles, np.roll(self.points, -1, axis=0), strict=True):
            out.append(start[None] if np.isnan(middle[0]) else _arc_points(start, middle, end))
        return np.concatenate(out)

    @property
    def area(self) -> float:
        """Signed area of the polygon, mm^2; positive if it runs to the left."""
        x, y = self.sampled().T
        return float(0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


@dataclass(frozen=True, slots=True)
class Outline:
    """The resin (outside first, then the hole), the receiver's segment (2, 2), the emitter's point and direction (2,
    2).
    """

    loops: tuple[Loop, ...]
    receiver: FloatArray
    emitter: FloatArray


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


def outline(frame: Frame, design: Design) -> Outline:
    """Chain the surfaces of a scene into closed outlines.

    Raises
    ------
    RequestError : the cavities do not fit the guide.
    """
    check_row(frame, design.row_mm, design.depth_mm if design.cavities else 0.0, "this state")
    g = geometry_of(frame, design)
    kept = (g.kinds != NOTHING) & (g.kinds != RECEIVER)
    receivers = g.surfaces[g.kinds == RECEIVER]
    receiver = np.stack([receivers[0, 8:10], receivers[0, 12:14]]) if len(receivers) else np.full((2, 2), np.nan)
    loops = sorted(_chained(g.surfaces[kept]), key=lambda loop: -abs(loop.area))
    return Outline(tuple(loops), receiver, np.stack([frame.emitter[:2], frame.emitter[2:]]))


def _chained(surfaces: FloatArray) -> list[Loop]:
    """Join surfaces end to end; a gap (the receiver's) is closed by a line."""
    ends = np.stack([surfaces[:, 8:10], surfaces[:, 12:14]], axis=1)
    middles = np.array([_middle(row) for row in surfaces])
    left, loops = list(range(len(surfaces))), []
    while left:
        chain = [(left.pop(0), 0)]
        for grow_back in (False, True):
            while left:
                surface, start = chain[0] if grow_back else chain[-1]
                tip = ends[surface, start if grow_back else 1 - start]
                near = [(float(np.hypot(*(ends[i, e] - tip))), i, e) for i in left for e in (0, 1)]
                distance, i, e = min(near)
                if distance > 1e-7:
                    break
                left.remove(i)
                if grow_back:
                    chain.insert(0, (i, 1 - e))
                else:
                    chain.append((i, e))
        loops.append(_loop(chain, ends, middles))
    return loops


def _loop(chain: list[tuple[int, int]], ends: FloatArray, middles: FloatArray) -> Loop:
    points = [ends[i, e] for i, e in chain]
    arcs = [middles[i] for i, _ in chain]
    last = ends[chain[-1][0], 1 - chain[-1][1]]
    if np.hypot(*(last - points[0])) > 1e-7:
        points.append(last)
        arcs.append(np.full(2, np.nan))
    return Loop(np.array(points), np.array(arcs))


def _middle(row: FloatArray) -> FloatArray:
    """Middle of an arc surface; NaN for a line."""
    bend = row[4] * row[7]
    chord = row[12:14] - row[8:10]
    half = float(np.hypot(*chord)) / 2
    if abs(bend) * half < 1e-9:
        return np.full(2, np.nan)
    rise = half * math.tan(math.asin(bend * half) / 2)
    return np.asarray((row[8:10] + row[12:14]) / 2 - rise * np.array([-chord[1], chord[0]]) / (2 * half))


def ray_optics_scene(frame: Frame, design: Design, guide: Waveguide, light: Light, name: str = "") -> dict[str, Any]:
    """One scene as ray-optics' own JSON, version 5; lengths in mm.

    With `light.secondary` = 0 the glass reflects nothing at a refraction, so that counts can be compared; otherwise
    it does.

    Raises
    ------
    DataError : the scene has no receiver to stand a detector on.
    RequestError : the cavities do not fit the guide.
    """
    shape = outline(frame, design)
    if np.isnan(shape.receiver[0, 0]):
        raise DataError("this scene has no receiver", "give the receiver a width above 0 mm")
    glass = {
        "type": "Glass",
        "path": _path(shape.loops),
        "refIndex": guide.index,
        "partialReflect": light.secondary > 0,
    }
    back = -_BEFORE_FACE_MM * frame.receiver_way
    beside = (shape.receiver[1] - shape.receiver[0]) * 1e-3
    detector = {"type": "Detector", **_ends(shape.receiver + 2 * back), "twoSided": True}
    blocker = {"type": "Blocker", **_ends(shape.receiver + back + np.stack([-beside, beside]) * 0)}
    centre = np.mean(shape.loops[0].points, axis=0)
    return {
        "version": 5,
        "name": name,
        "objs": [glass, *_sources(frame, light), detector, blocker],
        "mode": "rays",
        "rayModeDensity": _density(light),
        "maxRayDepth": _DEPTH,
        "lengthScale": 1 / _PER_MM,
        "scale": _PER_MM,
        "width": 1500,
        "height": 900,
        "origin": {"x": 750 - _PER_MM * float(centre[0]), "y": 450 - _PER_MM * float(centre[1])},
    }


def _point(xy: FloatArray) -> dict[str, float]:
    return {"x": float(xy[0]), "y": float(xy[1])}


def _ends(segment: FloatArray) -> dict[str, dict[str, float]]:
    return {"p1": _point(segment[0]), "p2": _point(segment[1])}


def _path(loops: tuple[Loop, ...]) -> list[dict[str, Any]]:
    """One path through all loops, from the first to each other one and back along a slit."""
    path: list[dict[str, Any]] = []
    outside = loops[0]
    if len(loops) > 1:
        gaps = np.hypot(*(outside.points[:, None] - loops[1].points[None]).transpose(2, 0, 1))
        i, j = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
        outside, hole = _rolled(outside, int(i)), _rolled(loops[1], int(j))
        return [*_vertices(outside), _vertex(outside.points[0]), *_vertices(hole), _vertex(hole.points[0])]
    path.extend(_vertices(outside))
    return path


def _rolled(loop: Loop, first: int) -> Loop:
    return Loop(np.roll(loop.points, -first, axis=0), np.roll(loop.middles, -first, axis=0))


def _vertex(xy: FloatArray, arc: bool = False) -> dict[str, Any]:
    return {**_point(xy), "arc": arc}


def _vertices(loop: Loop) -> list[dict[str, Any]]:
    out = []
    for point, middle in zip(loop.points, loop.middles, strict=True):
        out.append(_vertex(point))
        if not np.isnan(middle[0]):
            out.append(_vertex(middle, True))
    return out


def _density(light: Light) -> float:
    """Density at which ray-optics' source steps as ours does; it releases int(density 500) rays a full turn."""
    turn = round(light.rays * 360.0 / light.cone_deg)
    return (turn + 0.25) / _SOURCE_STEPS


def _sources(frame: Frame, light: Light) -> list[dict[str, Any]]:
    """The fan: one angle source where a full turn is a whole number of its steps, else ray by ray."""
    fan, turn = fan_of(light, frame), light.rays * 360.0 / light.cone_deg
    emitter, way = frame.emitter[:2], frame.emitter[2:]
    if light.emission == "uniform" and abs(turn - round(turn)) < 1e-9:
        half = math.radians(light.cone_deg) / light.rays * (0.5 + light.phase)
        turned = np.array(
            [math.cos(half) * way[0] - math.sin(half) * way[1], math.cos(half) * way[1] + math.sin(half) * way[0]]
        )
        return [
            {
                "type": "AngleSource",
                **_ends(np.stack([emitter, emitter + turned])),
                "brightness": 1.0,
                "emisAngle": light.cone_deg,
                "symmetric": True,
            }
        ]
    if light.rays > _MOST_SINGLE:
        raise RequestError(
            f"{light.rays} rays would be written one by one", f"choose {_MOST_SINGLE} or fewer, or a uniform emitter"
        )
    rays = [released(fan, i) for i in range(light.rays)]
    return [
        {"type": "SingleRay", **_ends(np.array([[r.x, r.y], [r.x + r.dx, r.y + r.dy]])), "brightness": 1.0}
        for r in rays
    ]
