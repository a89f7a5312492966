"""A scene as a file for the 2D simulator ray-optics (JSON, version 5).

The resin is one Glass whose path runs round the outside, through a slit (two coincident lines, which that program takes
for no surface) and round the hole between the guides. Its point source leaves out the last angle of its cone, so the
fan is turned by half a step to the angles released here. A blocker behind the detector ends what was counted.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from analysis.compiled import interpreted
from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.geometry import geometry_of
from analysis.optics.scene.outline import Contour, outline
from analysis.optics.scene.parameters import Design, Light, Waveguide
from analysis.optics.tracer.rays import fan_of, released
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError, RequestError

_PER_MM = 15.0
_DEPTH = 20_000
_BEFORE_FACE_MM = 1e-3
_SOURCE_STEPS = 500
_MOST_SINGLE = 20_000


def ray_optics_scene(
    frame: SceneFrame, design: Design, guide: Waveguide, light: Light, name: str = ""
) -> dict[str, Any]:
    """Return one scene as ray-optics' own JSON, version 5; with `light.secondary` = 0 its glass does not reflect."""
    shape = outline(frame, design)
    if len(shape.contours) > 2:
        raise RequestError("voids inside the guides cannot be written as one path", "choose cavities in a face")
    if np.isnan(shape.receiver[0, 0]):
        raise DataError("this scene has no receiver", "give the receiver a width above 0 mm")
    resin = {"refIndex": guide.index, "partialReflect": light.secondary != 0}
    glass = {"type": "Glass", "path": _path(shape.contours), **resin}
    back = -_BEFORE_FACE_MM * frame.receiver_direction
    detector = {"type": "Detector", **_ends(shape.receiver + 2 * back), "twoSided": True}
    blocker = {"type": "Blocker", **_ends(shape.receiver + back)}
    centre = np.mean(shape.contours[0].points, axis=0)
    return {
        "version": 5,
        "name": name,
        "objs": [glass, *_sources(frame, design, light), detector, blocker],
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


def _path(contours: tuple[Contour, ...]) -> list[dict[str, Any]]:
    """Return one path through both contours, from the outside to the hole and back along a slit."""
    outside = contours[0]
    if len(contours) > 1:
        gaps = np.hypot(*(outside.points[:, None] - contours[1].points[None]).transpose(2, 0, 1))
        i, j = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
        outside, hole = _rolled(outside, int(i)), _rolled(contours[1], int(j))
        return [*_vertices(outside), _vertex(outside.points[0]), *_vertices(hole), _vertex(hole.points[0])]
    return _vertices(outside)


def _rolled(contour: Contour, first: int) -> Contour:
    return Contour(np.roll(contour.points, -first, axis=0), np.roll(contour.middles, -first, axis=0))


def _vertex(xy: FloatArray, arc: bool = False) -> dict[str, Any]:
    return {**_point(xy), "arc": arc}


def _vertices(contour: Contour) -> list[dict[str, Any]]:
    out = []
    for point, middle in zip(contour.points, contour.middles, strict=True):
        out.append(_vertex(point))
        if not np.isnan(middle[0]):
            out.append(_vertex(middle, True))
    return out


def _density(light: Light) -> float:
    """Return the density at which ray-optics' source steps as ours does; it releases int(500 density) rays a turn."""
    turn = round(light.rays * 360.0 / light.cone_deg)
    return (turn + 0.25) / _SOURCE_STEPS


def _sources(frame: SceneFrame, design: Design, light: Light) -> list[dict[str, Any]]:
    """Return the fan: one angle source where a full turn is a whole number of its steps, else ray by ray."""
    turn = light.rays * 360.0 / light.cone_deg
    emitter, axis = frame.emitter[:2], frame.emitter[2:]
    if light.emission == "uniform" and not light.jittered and abs(turn - round(turn)) < 1e-9:
        half = math.radians(light.cone_deg) / light.rays * (0.5 + light.phase)
        c, s = math.cos(half), math.sin(half)
        turned = np.array([c * axis[0] - s * axis[1], c * axis[1] + s * axis[0]])
        angle = {"brightness": 1.0, "emisAngle": light.cone_deg, "symmetric": True}
        return [{"type": "AngleSource", **_ends(np.stack([emitter, emitter + turned])), **angle}]
    if light.rays > _MOST_SINGLE:
        cause = f"{light.rays} rays would be written one by one"
        raise RequestError(cause, f"choose {_MOST_SINGLE} or fewer, or a uniform emitter")
    g, fan = geometry_of(frame, design), fan_of(light)
    rays = (interpreted(released)(g, fan, i) for i in range(light.rays))
    ends = (_ends(np.array([[r.x, r.y], [r.x + r.dx, r.y + r.dy]])) for r in rays)
    return [{"type": "SingleRay", **both, "brightness": 1.0} for both in ends]
