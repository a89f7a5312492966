"""Where the ray tracer breaks down: grazing rays, rays along a bend, corners, cavities too small or too deep.

Truth: closed forms of a straight guide and of a ring; and, with cavities, a second tracer of straight segments in
extended precision, which tries every segment for every ray.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from analysis.optics.scene.arc_spline import ring, straight
from analysis.optics.scene.frame import one_strip
from analysis.optics.scene.parameters import Design, Light, Waveguide
from analysis.optics.tracer.simulation import TraceResult, trace
from analysis.polynomial import LongArray
from analysis.studies.failure_maps.sweep import Axis, Study, StudyResult, joined

_LENGTH_MM, HALF_MM = 60.0, 1.0
_PLAIN = Design(cavities=0)
_ONE = Light(rays=1, cone_deg=0.001, secondary=0, path_cap_mm=1e6)
GIVEN_UP = ("trapped", "cut", "corner", "dropped")
_RAYS, CAP_MM = 250, 1000.0


def given_up(out: TraceResult, names: tuple[str, ...] = GIVEN_UP) -> str:
    """Return what the ledger has of rays that were not followed to an end."""
    released = out.ledger["released"]
    return joined([f"{out.ledger[name]} of {released} rays: {name}" for name in names if out.ledger[name]])


def grazing(angle: float, excess: float) -> StudyResult:
    """Trace one ray that meets a straight wall at `angle` (rad), in resin of index 1 + `excess`.

    Total reflection requires n cos(angle) > 1, which is excess > 2 n sin^2(angle / 2), free of cancellation.
    """
    guide = Waveguide(index=1.0 + excess)
    start = np.array([0.1, HALF_MM - 20.0 * math.tan(angle), math.cos(angle), math.sin(angle)])
    out = trace(one_strip(straight((0, 0), (_LENGTH_MM, 0)), guide, start), _PLAIN, guide, _ONE, threads=1)
    n = 1.0 + excess
    guided = n - 1.0 > 2.0 * n * math.sin(angle / 2.0) ** 2
    return StudyResult(float(abs(out.ledger["detected"] - guided)), given_up(out))


def whispering(depth_mm: float, radius_mm: float) -> StudyResult:
    """Trace one ray along the outer wall of a quarter ring, `depth_mm` below it at most, in resin that absorbs.

    All its chords are alike: it meets the wall after an angle b = acos(1 - depth / R), then every 2 b. The power that
    arrives is exp(-path length), summed over the chords.
    """
    outer = radius_mm + HALF_MM
    start = np.array([outer - depth_mm, 0.0, 0.0, 1.0])
    depth = outer - float(start[0])  # as the doubles have it
    b = 2.0 * math.asin(math.sqrt(depth / outer / 2.0))
    chords = max(math.floor((math.pi / 2 - b) / (2.0 * b)), 0)
    rest = math.pi / 2 - b - 2.0 * b * chords  # from the last hit to the end face
    path_mm = outer * (math.sin(b) * (2.0 + 2.0 * chords) + math.cos(b) * math.tan(rest - b))
    guide = Waveguide(attenuation_db_per_cm=100.0 / math.log(10.0) / path_mm)
    out = trace(one_strip(ring(radius_mm, math.pi / 2, 5), guide, start), _PLAIN, guide, _ONE, threads=1)
    return StudyResult(abs(out.power / math.exp(-1.0) - 1.0), given_up(out))


def corner(beside_mm: float, angle_deg: float) -> StudyResult:
    """Trace one ray aimed beside a cavity's corner, by `beside_mm` to its right."""
    design, guide = Design(1, 1.0, 0.5, 0.9), Waveguide()
    angle = math.radians(angle_deg)
    direction = np.array([math.cos(angle), math.sin(angle)])
    aim = np.array([_LENGTH_MM / 2 - 0.5, HALF_MM - 0.5]) + beside_mm * np.array([direction[1], -direction[0]])
    start = np.concatenate([aim - 0.8 * direction, direction])
    out = trace(one_strip(straight((0, 0), (_LENGTH_MM, 0)), guide, start), design, guide, _ONE, threads=1)
    ends, _ = second_tracer(segments(design), start[None, :2], start[None, 2:], 1.5, 1e6)
    return StudyResult(float(abs(out.ledger["detected"] - int((ends == 1).sum()))), given_up(out))


def cavity(width_mm: float, depth_mm: float) -> StudyResult:
    """Return the difference of two tracers on a row of five cavities, rays of 250."""
    design, guide = Design(5, width_mm, depth_mm, 0.9), Waveguide()
    light = Light(rays=_RAYS, secondary=0, path_cap_mm=CAP_MM)
    out = trace(one_strip(straight((0, 0), (_LENGTH_MM, 0)), guide), design, guide, light, threads=1)
    angle = math.radians(light.cone_deg) * ((np.arange(_RAYS) + 0.5) / _RAYS - 0.5)
    start = np.tile([guide.backing_mm, 0.0], (_RAYS, 1))
    ends, _ = second_tracer(segments(design), start, np.stack([np.cos(angle), np.sin(angle)], axis=1), 1.5, CAP_MM)
    ours = out.ledger["escaped"], out.ledger["detected"], out.ledger["trapped"] + out.ledger["cut"]
    apart = max(abs(count - int((ends == end).sum())) for end, count in enumerate(ours))
    return StudyResult(float(apart), given_up(out, ("corner", "dropped")))


def segments(design: Design) -> LongArray:
    """Return the outline of a straight guide with cavities in its upper face, (n, 2, 2), the receiver first."""
    pitch = design.width_mm + design.spacing_mm
    top, bottom = HALF_MM, HALF_MM - design.depth_mm
    path = [(0.0, top)]
    for i in range(design.cavities):
        a = _LENGTH_MM / 2 + (i - (design.cavities - 1) / 2) * pitch - design.width_mm / 2
        b = a + design.width_mm
        path += [(a, top), (a, bottom), (b, bottom), (b, top)]
    path += [(_LENGTH_MM, top), (_LENGTH_MM, -HALF_MM), (0.0, -HALF_MM), (0.0, top)]
    points = np.array(path, dtype=np.longdouble)
    rows = np.stack([points[:-1], points[1:]], axis=1)
    receiver = len(path) - 4
    return np.concatenate([rows[receiver : receiver + 1], np.delete(rows, receiver, axis=0)])


def second_tracer(
    surfaces: LongArray, start: npt.ArrayLike, direction: npt.ArrayLike, index: float, cap_mm: float
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Follow rays through straight segments without secondaries, every segment tried for every ray.

    `start`, `direction`: (rays, 2), mm and unit vectors. `cap_mm`: path length after which a ray is stopped.
    Returns (rays,) 0 escaped, 1 detected, 2 stopped at the cap; and the surfaces that each met.
    """
    p, d = np.array(start, dtype=np.longdouble), np.array(direction, dtype=np.longdouble)
    d /= np.hypot(d[:, :1], d[:, 1:])
    a, e = surfaces[:, 0], surfaces[:, 1] - surfaces[:, 0]
    normal = np.stack([-e[:, 1], e[:, 0]], axis=1) / np.hypot(e[:, :1], e[:, 1:])
    resin, last = np.ones(len(p), dtype=bool), np.full(len(p), -1)
    run, ends, hits = np.zeros(len(p), dtype=np.longdouble), np.full(len(p), -1), np.zeros(len(p), dtype=np.int64)
    live = np.arange(len(p))
    while live.size:
        q = a[None] - p[live, None]
        cross = d[live, None, 0] * e[None, :, 1] - d[live, None, 1] * e[None, :, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (q[..., 0] * e[:, 1] - q[..., 1] * e[:, 0]) / cross
            part = (q[..., 0] * d[live, None, 1] - q[..., 1] * d[live, None, 0]) / cross
        t = np.where((t > 0) & (part >= 0) & (part < 1) & (np.arange(len(a)) != last[live, None]), t, np.inf)
        at = np.argmin(t, axis=1)
        step = t[np.arange(live.size), at]
        out = ~np.isfinite(step)
        ends[live[out]] = 0
        live, at, step = live[~out], at[~out], step[~out]
        p[live] += step[:, None] * d[live]
        run[live] += step
        hits[live] += 1
        last[live] = at
        ends[live[run[live] > cap_mm]] = 2
        arrived = (at == 0) & (run[live] <= cap_mm)
        ends[live[arrived]] = np.where(d[live[arrived], 0] > 0, 1, 0)
        on = ends[live] < 0
        live, at = live[on], at[on]
        _turn(d, resin, live, normal[at], index)
    return ends, hits


def _turn(d: LongArray, resin: npt.NDArray[np.bool_], live: npt.NDArray[np.int64], n: LongArray, index: float) -> None:
    """Refract the rays `live` at surfaces of normal `n`, or reflect them where nothing passes."""
    c = (d[live] * n).sum(axis=1)
    ratio = np.where(resin[live], np.longdouble(index), 1 / np.longdouble(index))
    square = 1 - ratio**2 * (1 - c * c)
    passes = square > 0
    root = np.copysign(np.sqrt(np.maximum(square, 0)), c)
    through = ratio[:, None] * (d[live] - c[:, None] * n) + root[:, None] * n
    d[live] = np.where(passes[:, None], through, d[live] - 2 * c[:, None] * n)
    d[live] /= np.hypot(d[live, :1], d[live, 1:])
    resin[live] ^= passes


TRACER_STUDIES = (
    Study(
        "tracer-grazing", "tracer", "One ray grazes a straight wall", "Snell's law in closed form", "rays", 0.0,
        Axis("angle to the wall", "rad", (1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 0.01, 0.1, 0.3, 0.8)),
        Axis("index above that of air", "", (0.0, 1e-14, 1e-12, 1e-9, 1e-6, 1e-3, 0.02, 0.1, 0.5, 1.0)), grazing,
    ),
    Study(
        "tracer-bend", "tracer", "One ray along the wall of a bend", "equal chords of a circle, summed",
        "of the power", 1e-6,
        Axis("flattest point below the wall", "mm", (0.5, 0.1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-11, 2e-12)),
        Axis("radius of the bend", "mm", (1.03, 1.2, 2.0, 5.0, 50.0, 500.0, 5000.0)), whispering,
    ),
    Study(
        "tracer-corner", "tracer", "One ray beside a cavity's corner", "a second tracer, in extended precision",
        "rays", 0.0,
        Axis("beside the corner", "mm", (-0.1, -1e-3, -1e-6, -1e-8, -1e-10, 0.0, 1e-13, 1e-10, 1e-8, 1e-6, 1e-3, 0.1)),
        Axis("angle to the guide", "degrees", (-30.0, -5.0, 0.0, 1.0, 5.0, 20.0, 30.0, 45.0)), corner,
    ),
    Study(
        "tracer-cavity", "tracer", "Cavities small and deep", "a second tracer, in extended precision",
        "of 250 rays", 1.0,
        Axis("width", "mm", (0.005, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 11.5)),
        Axis("depth", "mm", (5e-4, 1e-3, 1e-2, 0.1, 0.5, 1.0, 1.5, 1.9, 1.999, 2.0)), cavity,
    ),
)  # fmt: skip
