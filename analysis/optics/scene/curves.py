"""The deformed centrelines: 15 states of two guides, from any source.

`curves` is an array (states, 2, points, 2) in mm, state 0 the most compressed. The shadow, a file and the parametric
set return it; `frames_of` makes scenes of it. Coordinates are (x, z), z along the actuator by convention; a scene may
be moved and turned. The default are the shadow's fifteen states, read from `shadow_states.csv`, which `boat-daq shadow
states --out FILE` writes; nothing of the shadow is imported here.
"""

from __future__ import annotations

from functools import cache, lru_cache
from pathlib import Path

import numpy as np

from analysis.optics.scene.arc_spline import biarcs, smooth
from analysis.optics.scene.frame import SceneFrame, two_guides
from analysis.optics.scene.parameters import STATES, Waveguide
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError

REST_STATE = 7
POINTS = 7
_LENGTH_MM = 75.0  # six unit cells of 12.5 mm (paper)
COMPRESSION_MM, ELONGATION_MM = -2.70, 3.80  # elongation at -40 and +50 kPa, derived from the paper's figures
BOW_MM = 12.5  # assumed in the parametric set: at rest the middle of a guide is one unit cell off the axis
BOW_PER_ELONGATION = 0.925
"""Assumed: mm of bow a mm of elongation. The bladders push the guides out as they lengthen (paper: straighter in
compression, more bent in elongation): 10.0 mm at the most compressed state, 16.0 mm at the most elongated."""


@cache
def _shadow_states() -> FloatArray:
    """Return the rows of the packaged file: state, guide, point, x, z, pressure, elongation."""
    path = Path(__file__).with_name("shadow_states.csv")
    return np.loadtxt(path, delimiter=",", comments=("#", "state"), encoding="utf-8")


def default_curves() -> FloatArray:
    """Return the shadow's fifteen states of the paper's actuator, (15, 2, 7, 2), mm."""
    return _shadow_states()[:, 3:5].reshape(STATES, 2, -1, 2).copy()


def elongations() -> FloatArray:
    """Return the elongations of the default states, mm: even steps of pressure from -40 to 0 and from 0 to +50 kPa."""
    return _shadow_states()[:, 6].reshape(STATES, -1)[:, 0].copy()


def parametric_elongations() -> FloatArray:
    """Return the elongations of the parametric states, mm: 7 even steps of compression, rest, 7 of elongation."""
    return np.concatenate(
        [np.linspace(COMPRESSION_MM, 0.0, REST_STATE + 1), np.linspace(0.0, ELONGATION_MM, REST_STATE + 1)[1:]]
    )


def parametric_curves(states: FloatArray | None = None) -> FloatArray:
    """Return two guides bowed like a boat's sides, x = +-bow sin(pi z / length), (states, 2, 7, 2), mm.

    `states`: elongation of each, mm; by default the 15 of `parametric_elongations`.
    """
    e = parametric_elongations() if states is None else np.asarray(states, dtype=float)
    part = np.linspace(0.0, 1.0, POINTS)
    z = (_LENGTH_MM + e)[:, None] * part
    x = (BOW_MM + BOW_PER_ELONGATION * e)[:, None] * np.sin(np.pi * part)
    x[:, [0, -1]] = 0.0
    return np.stack([np.stack([-x, z], axis=2), np.stack([x, z], axis=2)], axis=1)


def checked_curves(curves: FloatArray) -> FloatArray:
    """Return `curves` as float64 (states, 2, points, 2), checked."""
    curves = np.asarray(curves, dtype=np.float64)
    if curves.ndim != 4 or curves.shape[1] != 2 or curves.shape[3] != 2:
        cause = f"curves of shape {curves.shape} are not (states, 2 guides, points, 2 coordinates)"
        raise DataError(cause, "give x and z of two guides for each state")
    if curves.shape[0] not in (1, STATES):
        remedy = f"give {STATES} states, most compressed first, or a single one"
        raise DataError(f"curves of {curves.shape[0]} states", remedy)
    if curves.shape[2] < POINTS:
        raise DataError(f"{curves.shape[2]} points a guide are too few", f"give {POINTS} points or more for each guide")
    if not np.all(np.isfinite(curves)):
        state, guide = np.argwhere(~np.isfinite(curves))[0][:2]
        raise DataError(
            f"state {state}, guide {guide + 1} has a coordinate that is not a number", "give every point's x and z"
        )
    extent = float(np.max(np.ptp(curves, axis=2)))
    if not 1.0 <= extent <= 10_000.0:
        raise DataError(f"guides {extent:.3g} mm long are not those of an actuator", "give the curves in mm")
    return curves


def frames_of(curves: FloatArray, guide: Waveguide) -> list[SceneFrame]:
    """Return one frame for each state."""
    checked = np.ascontiguousarray(checked_curves(curves))
    return list(_frames(checked.tobytes(), checked.shape, guide))


@lru_cache(maxsize=16)
def _frames(curves: bytes, shape: tuple[int, ...], guide: Waveguide) -> tuple[SceneFrame, ...]:
    """Return the frames, kept because a sweep is repeated with other designs, rays and fans on the same states."""
    states = np.frombuffer(curves).reshape(shape)
    return tuple(_frame(pair, guide, f"state {number}") for number, pair in enumerate(states))


def frame_of(curves: FloatArray, state: int, guide: Waveguide) -> SceneFrame:
    """Return the frame of one state. `curves`: (states, 2, points, 2), mm."""
    return _frame(checked_curves(curves)[state], guide, f"state {state}")


def _frame(pair: FloatArray, guide: Waveguide, name: str) -> SceneFrame:
    a, b = pair
    if _squares(a[-1] - b[-1], a[0] - b[0]) > _squares(a[-1] - b[0], a[0] - b[-1]):
        b = b[::-1]
    a, b = _joined(a, b, guide.thickness_mm / 2)
    left, right = (biarcs(*smooth(points, guide.knots)) for points in (a, b))
    middle_a, middle_b = (c.frame(np.array([c.length / 2]))[0][0] for c in (left, right))
    along, across = a[-1] - a[0], middle_b - middle_a
    if along[0] * across[1] - along[1] * across[0] > 0:
        left, right = right, left
    return two_guides(left, right, guide, name)


def _squares(*vectors: FloatArray) -> float:
    return float(sum(v @ v for v in vectors))


def _joined(a: FloatArray, b: FloatArray, reach: float) -> tuple[FloatArray, FloatArray]:
    """Extend both guides to a common junction at each end.

    Ends closer than half a thickness are moved to their midpoint; ends further apart (a shadow's tracked points end
    with the lattice) get a junction half their gap further out, so that both guides enter it at 45 degrees.
    """
    for end, inner in ((0, 1), (-1, -2)):
        gap = float(np.hypot(*(a[end] - b[end])))
        middle = (a[end] + b[end]) / 2
        if gap <= reach:
            a, b = a.copy(), b.copy()
            a[end], b[end] = middle, middle
            continue
        out = middle - (a[inner] + b[inner]) / 2
        side = (a[end] - b[end]) / gap
        out = out - (out @ side) * side
        junction = middle + out / np.hypot(*out) * gap / 2
        at = 0 if end == 0 else len(a)
        a, b = np.insert(a, at, junction, axis=0), np.insert(b, at, junction, axis=0)
    return a, b
