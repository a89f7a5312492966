"""The two marks in one picture: found by OpenCV's ArUco detector, their edges then measured far below a pixel.

Each side of a mark is sampled along lines across it. Where the edge crosses such a line follows from the area under the
normalised profile, which no symmetric blur moves; a straight line through the crossings of one side, outliers left out,
meets those of its neighbours in the corners. The interior of the mark is read in every picture, so that another mark, a
hand or a reflection is never taken for it.

Marks are those of the dictionary DICT_4X4_50: number 0 at the base, number 1 at the tip.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from typing import Any

import numpy as np

from analysis.tracking.lens import Lens, Picture
from protocol.base.arrays import BoolArray, FloatArray
from protocol.base.optional import optional

BASE, TIP = 0, 1
MODULES = 6  # of a side, its black border included
LEAST_CONTRAST = 25.0  # grey levels between black and white
SATURATED_GREY = 253.0
WIDEST_BLUR = 0.33  # standard deviation of an edge over half the length of its profile
LARGEST_RESIDUAL_PX = 0.35
SMALLEST_MODULE_PX = 5.0
LONGEST_PROFILE_PX = 8.0  # to either side of an edge; shorter in small marks, whose interior is near
_ALONG = np.linspace(0.1, 0.9, 33)
_STEP_PX = 0.5
_NEAR_PX = 0.75  # a better guess than this is not improved
_FAR_PX = 4.0  # crossings this far from the second guess are those of something else
_FEWEST = 16  # good crossings of one side
_SEARCH_PX = 320  # pictures are searched at no more than twice this width: the edges are measured in the full one


class PictureFault(StrEnum):
    """Why a picture gives no value of a mark, or of the elongation."""

    LOST = "lost"  # not in the picture, or covered
    AMBIGUOUS = "ambiguous"  # more than once in the picture
    BLURRED = "blurred"
    SATURATED = "saturated"
    LOW_CONTRAST = "low_contrast"
    COVERED = "covered"  # in part
    REPEATED = "repeated"  # the picture before once more
    FROZEN = "frozen"  # for longer
    MOVED = "moved"  # the camera, or its marks are exchanged
    JUMPED = "jumped"  # faster than an actuator moves
    TOO_SMALL = "too_small"  # in the picture
    DISTORTED = "distorted"  # the mark has another size than at rest
    LEARNING = "learning"  # the first half second


@dataclass(frozen=True, slots=True)
class Mark:
    """One mark in one picture."""

    corners_px: FloatArray  # [4, 2] of the black square, in the mark's own order, lens corrected
    raw_px: FloatArray  # [4, 2] the same as the picture shows them
    residual_px: float  # standard deviation of the crossings about the sides
    blur_px: float  # standard deviation of the edges' profile


@cache
def interior(number: int) -> BoolArray:
    """Return the modules of a mark [6, 6], True where it is white."""
    cv2 = optional("cv2")
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    return np.asarray(cv2.aruco.generateImageMarker(dictionary, number, MODULES)) > 0


@cache
def _detector() -> Any:
    cv2 = optional("cv2")
    settings = cv2.aruco.DetectorParameters()
    settings.minMarkerPerimeterRate = 0.1
    return cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50), settings)


def find_marks(grey: Picture) -> dict[int, list[FloatArray]]:
    """Return the corners [4, 2] of every mark in a picture to about a pixel, by its number."""
    factor = max(1, round(grey.shape[1] / (2 * _SEARCH_PX)) + (grey.shape[1] > _SEARCH_PX))
    small = optional("cv2").resize(grey, None, fx=1 / factor, fy=1 / factor, interpolation=3)  # INTER_AREA
    corners, numbers, _ = _detector().detectMarkers(small)
    found: dict[int, list[FloatArray]] = {}
    for number, quad in zip(() if numbers is None else numbers.ravel().tolist(), corners, strict=True):
        found.setdefault(number, []).append((quad[0].astype(np.float64) + 0.5) * factor - 0.5)
    return found


def measure_mark(grey: Picture, number: int, near_px: FloatArray, lens: Lens | None = None) -> Mark | PictureFault:
    """Return a mark measured from its edges, or why it cannot be.

    `grey`: [height, width] picture. `near_px`: [4, 2] its corners to a few pixels. `lens`: corrects the crossings; None
    where the picture is not distorted.
    """
    edges = _edges(grey, near_px)
    if isinstance(edges, PictureFault):
        return edges
    corners, residual_px = _meet(edges.points_px, edges.good)
    off_px = float(abs(corners - near_px).max())
    if off_px > _NEAR_PX:  # once more, about the right place
        guess, edges = corners, _edges(grey, corners)
        if isinstance(edges, PictureFault):
            return edges
        corners, residual_px = _meet(edges.points_px, edges.good)
        off_px = float(abs(corners - guess).max())
    if off_px > _FAR_PX:
        return PictureFault.LOST
    straight = corners
    if lens is not None:
        points = lens.undistorted(edges.points_px.reshape(-1, 2)).reshape(edges.points_px.shape)
        straight, residual_px = _meet(points, edges.good)
    if residual_px > LARGEST_RESIDUAL_PX:
        return PictureFault.COVERED
    fault = _check_interior(grey, number, corners, edges)
    return fault or Mark(straight, corners, residual_px, edges.blur_px)


@dataclass(frozen=True, slots=True)
class _Edges:
    points_px: FloatArray  # [4, n, 2] where the sides of the mark cross the profiles
    good: BoolArray  # [4, n]
    black: float
    white: float
    blur_px: float


def _edges(grey: Picture, corners: FloatArray) -> _Edges | PictureFault:
    """Return where the edges of the black square are, on profiles across its four sides."""
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.hypot(sides[:, 0], sides[:, 1])
    module_px = float(lengths.min()) / MODULES
    if module_px < SMALLEST_MODULE_PX:
        return PictureFault.TOO_SMALL
    count = int(min(0.6 * module_px, LONGEST_PROFILE_PX) / _STEP_PX)
    half, steps = count * _STEP_PX, np.arange(-count, count + 1) * _STEP_PX
    outward = np.column_stack([sides[:, 1], -sides[:, 0]]) / lengths[:, None]
    outward *= np.sign(((corners - corners.mean(axis=0)) * outward).sum(axis=1))[:, None]
    feet = corners[:, None] + sides[:, None] * _ALONG[:, None]
    at = feet[:, :, None] + outward[:, None, None] * steps[:, None]  # [4, n, steps, 2]
    height, width = grey.shape
    if not (at.min() >= 0 and at[..., 0].max() <= width - 1.001 and at[..., 1].max() <= height - 1.001):
        return PictureFault.LOST
    profile = _sample(grey, at)
    ends = max(2, len(steps) // 5)
    inner, outer = profile[..., :ends].mean(axis=-1), profile[..., -ends:].mean(axis=-1)
    black, white = np.median(inner, axis=1), np.median(outer, axis=1)
    contrast = white - black
    if contrast.min() < LEAST_CONTRAST:
        return PictureFault.LOW_CONTRAST if contrast.max() > 0 else PictureFault.LOST
    if white.max() >= SATURATED_GREY:
        return PictureFault.SATURATED
    level = _along_side(inner)[..., None], _along_side(outer)[..., None]
    share = (profile - level[0]) / np.maximum(level[1] - level[0], 1.0)
    crossing = half - share[..., 1:-1].sum(axis=-1) * _STEP_PX - 0.5 * (share[..., 0] + share[..., -1]) * _STEP_PX
    flat = np.maximum(abs(inner - level[0][..., 0]), abs(outer - level[1][..., 0])) < 0.25 * contrast[:, None]
    good = flat & (abs(crossing) < 0.6 * half)
    blur_px = float(np.median((share * (1.0 - share)).sum(axis=-1)) * _STEP_PX * np.sqrt(np.pi))
    if blur_px > WIDEST_BLUR * half:
        return PictureFault.BLURRED
    if good.sum(axis=1).min() < _FEWEST:
        return PictureFault.COVERED
    return _Edges(
        feet + outward[:, None] * crossing[..., None], good, float(black.mean()), float(white.mean()), blur_px
    )


def _along_side(values: FloatArray) -> FloatArray:
    """Return a straight line through the levels [4, n] of each side, deviating ones left out."""
    middle = np.median(values, axis=1, keepdims=True)
    near = np.where(abs(values - middle) < 0.25 * (abs(middle) + 40.0), values, middle)
    t = _ALONG - _ALONG.mean()
    slope = (near * t).sum(axis=1, keepdims=True) / (t * t).sum()
    return np.asarray(near.mean(axis=1, keepdims=True) + slope * t)


def _meet(points: FloatArray, good: BoolArray) -> tuple[FloatArray, float]:
    """Return the corners [4, 2] where straight lines through the crossings of the sides meet, and their residual.

    `points`: [4, n, 2] crossings of each side. `good`: [4, n] those to use at first; of these the outliers are left
    out.
    """
    weights = good.astype(np.float64)
    for last in (False, True):
        centres = (points * weights[..., None]).sum(axis=1) / weights.sum(axis=1)[:, None]
        apart = points - centres[:, None]
        spread = np.einsum("sn,sni,snj->sij", weights, apart, apart)
        normals = np.linalg.eigh(spread)[1][:, :, 0]
        off = np.einsum("sni,si->sn", apart, normals)
        if not last:
            scale = 1.4826 * np.median(np.where(weights > 0, abs(off), 0.0), axis=1)
            weights = weights * (abs(off) < np.maximum(3.5 * scale, 0.1)[:, None])
    residual = float(np.sqrt((weights * off * off).sum() / max(1.0, weights.sum() - 8.0)))
    offsets = (normals * centres).sum(axis=1)
    before = np.roll(np.arange(len(normals)), 1)
    pairs = np.stack([normals[before], normals], axis=1)
    corners = np.linalg.solve(pairs, np.column_stack([offsets[before], offsets])[..., None])[..., 0]
    return np.asarray(corners), residual


def _sample(grey: Picture, at: FloatArray) -> FloatArray:
    """Return the picture between its pixels, bilinear, at points [..., 2] inside it."""
    x, y = at[..., 0], at[..., 1]
    column, row = x.astype(np.intp), y.astype(np.intp)
    dx, dy = x - column, y - row
    first = row * grey.shape[1] + column
    flat = grey.ravel()
    above = flat[first] * (1.0 - dx) + flat[first + 1] * dx
    below = flat[first + grey.shape[1]] * (1.0 - dx) + flat[first + grey.shape[1] + 1] * dx
    return np.asarray(above * (1.0 - dy) + below * dy)


def homography(source: FloatArray, target: FloatArray) -> FloatArray:
    """Return the projective map [3, 3] that takes four points [4, 2] to four others."""
    rows = []
    for (x, y), (u, v) in zip(source, target, strict=True):
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
    return np.append(np.linalg.solve(np.array(rows), target.reshape(-1)), 1.0).reshape(3, 3)


def project(plane: FloatArray, points: FloatArray) -> FloatArray:
    """Return points [n, 2] mapped by a homography [3, 3]."""
    mapped = points @ plane[:, :2].T + plane[:, 2]
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def _check_interior(grey: Picture, number: int, corners: FloatArray, edges: _Edges) -> PictureFault | None:
    """Return why the modules of the mark are not those of its number; None where they are."""
    square = np.array([[0.0, 0.0], [MODULES, 0.0], [MODULES, MODULES], [0.0, MODULES]])
    centres = np.stack(np.meshgrid(*[np.arange(MODULES) + 0.5] * 2), axis=-1).reshape(-1, 2)
    at = project(homography(square, corners), centres)
    seen = _sample(grey, at) > 0.5 * (edges.black + edges.white)
    wrong = np.count_nonzero(seen != interior(number).ravel())
    return None if not wrong else PictureFault.COVERED if wrong <= MODULES else PictureFault.LOST
