"""A ray as the tracer passes it from surface to surface, the rules of tracing, and the released fan."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from analysis.compiled import inside
from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.geometry import Geometry
from analysis.optics.scene.parameters import ORDERS, Light, Waveguide
from protocol.base.arrays import FloatArray

BY_TIME, BY_BOUNCE = ORDERS.index("time"), ORDERS.index("bounce")
_DB_PER_CM = math.log(10.0) / 100.0
_CORNER = 1e-9
_TICK = 1e-7


class Ray(NamedTuple):
    """A ray at its last surface."""

    x: float  # with y, dx, dy: position, mm, and unit direction
    y: float
    dx: float
    dy: float
    power: float
    path_mm: float  # with optical_path_mm: path length and optical path length so far
    optical_path_mm: float
    medium: int  # 1 resin, 0 air
    last: int  # with cell: last surface met, and the cell it is in
    cell: int
    root: int  # number of the released ray that it stems from
    bounce: int


class Rules(NamedTuple):
    """Rules of tracing."""

    refractive: float
    attenuation: float  # attenuation of the resin, 1/mm
    path_cap_mm: float  # path length after which a ray is given up
    faintest: float  # power below which it is
    corner_mm: float  # distance from a corner within which it is
    order: int  # order of the budget, index in `parameters.ORDERS`
    tick_mm: float  # optical path lengths that round to the same multiple of this are equal


class Fan(NamedTuple):
    """The released rays: half the cone (rad), number, Lambertian or not, phase; the first `followed` are traced.

    `places` (rays,) are those in their own steps, 0..1; (0,) where all are in the middle but for the phase.
    """

    half: float
    rays: int
    lambertian: bool
    phase: float
    followed: int
    places: FloatArray


def rules_of(guide: Waveguide, light: Light) -> Rules:
    """Return the rules of tracing for a guide and its light."""
    half, attenuation = guide.thickness_mm / 2, guide.attenuation_db_per_cm * _DB_PER_CM
    limits = light.path_cap_mm, light.faintest, _CORNER * half
    return Rules(guide.index, attenuation, *limits, ORDERS.index(light.order), _TICK * half)


def fan_of(light: Light) -> Fan:
    """Return the fan of a light, all of it followed."""
    half, lambertian = math.radians(light.cone_deg) / 2, light.emission == "lambertian"
    return Fan(half, light.rays, lambertian, light.phase, light.rays, _places(light))


def _places(light: Light) -> FloatArray:
    """Return the places of a light's rays in their steps, those of a ray and of its mirror image half a step apart."""
    if light.jitter is None:
        return np.empty(0)
    first = np.random.default_rng((light.jitter, light.rays)).random((light.rays + 1) // 2)
    return np.concatenate([first, ((1.5 - first[: light.rays // 2]) % 1.0)[::-1]])


def share_of(frame: SceneFrame, light: Light) -> tuple[int, int]:
    """Return the rays and the budget that are followed: half of both where the other half is their mirror image.

    A ray and its mirror image have the same time of flight, so that a budget by time accepts both or neither; by
    another criterion, and an odd one, it may accept one of them.
    """
    rays, budget = light.rays, light.secondary
    alike = budget <= 0 or (light.order == "time" and budget % 2 == 0)
    even = light.phase == 0.0 and rays % 2 == 0 and not light.jittered
    if not (alike and even and frame.twins):
        return rays, budget
    return rays // 2, budget // 2 if budget > 0 else budget


@inside
def released(g: Geometry, fan: Fan, i: int) -> Ray:
    """Return ray `i` of the fan."""
    x, y, axis_x, axis_y = g.emitter[0], g.emitter[1], g.emitter[2], g.emitter[3]
    place = fan.places[i] if len(fan.places) else 0.5 + fan.phase
    part = (2.0 * (i + place)) / fan.rays - 1.0
    angle = math.asin(math.sin(fan.half) * part) if fan.lambertian else fan.half * part
    c, s = math.cos(angle), math.sin(angle)
    dx, dy = c * axis_x - s * axis_y, c * axis_y + s * axis_x
    return Ray(x, y, dx, dy, 1.0, 0.0, 0.0, 1, -1, g.source_cell, i, 0)
