"""The picture of a virtual camera: a unit on millimetre paper, with marks at base and tip.

Strategy: a pinhole camera with radial distortion looks at a plane. Where each of 3 x 3 points of a pixel meets the
plane is computed once; a frame then draws the two cards at their places, of the true elongation's mean over the
exposure, and averages the points of each pixel: an edge lies where the true one does, to thousandths of a pixel,
and no interpolation of a tracker is used.

The light, the motion's and the lens's blur and the noise follow in the order of a camera. The same seed and frame
number give the same noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from protocol.base.arrays import FloatArray
from protocol.base.optional import optional

Picture = npt.NDArray[np.uint8]

_POINTS = 3  # per pixel and direction
_TEXELS = 24  # per module of a mark
_FOCUS = 1.4  # focal length over the picture's width
_PAPER, _BODY, _WHITE, _BLACK, _LINE = 190.0, 120.0, 215.0, 35.0, 160.0
_GRID_MM, _LINE_MM = 1.0, 0.15
_TRAVEL_MM = 4.0  # of the tip, about 1 mm from rest, where only a part of the picture is drawn again
_EDGE_PX = 6


@dataclass(frozen=True, slots=True)
class CameraScene:
    """What the camera sees, and how well."""

    width: int = 640
    height: int = 480
    px_per_mm: float = 20.0
    mark_mm: float = 8.0  # side of a mark's black square
    apart_mm: float = 13.0  # from the base's mark to the tip's at rest, centre to centre
    tilt_deg: float = 0.0
    distortion: float = 0.0  # first radial term of the lens
    blur_px: float = 0.7  # standard deviation of the lens's blur
    exposure_s: float = 0.008
    noise_grey: float = 2.0  # standard deviation of a pixel
    uneven: float = 0.15  # share of the light that is missing at the right edge
    flicker: float = 0.02  # share by which the light of frames varies, 100 Hz lamps
    seed: int = 0

    @property
    def matrix(self) -> FloatArray:
        focus = _FOCUS * self.width
        return np.array([[focus, 0, (self.width - 1) / 2], [0, focus, (self.height - 1) / 2], [0, 0, 1.0]])


@dataclass(frozen=True, slots=True)
class Disturbance:
    """What is wrong with one frame."""

    blur_px: float = 0.0  # added to the lens's blur
    gain: float = 1.0  # of the light; above about 1.2 the white saturates
    covered: float = 0.0  # share of the tip's mark that a hand covers
    base_covered: float = 0.0  # the same of the base's
    swapped: bool = False  # the two marks are exchanged
    second_tip: bool = False  # another tip's mark lies beside the unit
    shift_px: tuple[float, float] = (0.0, 0.0)
    noise_grey: float = 0.0


FAULTLESS = Disturbance()
Window: TypeAlias = tuple[slice, slice]  # rows and columns, pixels


class Renderer:
    """Draws frames of one scene."""

    def __init__(self, scene: CameraScene) -> None:
        self.scene = scene
        self._cv = optional("cv2")
        self._plane = _plane_of_points(scene)
        self._cards = [self._card(number) for number in (0, 1)]
        self._base_mm = -(scene.apart_mm / 2 + 1.5)
        self._whole = (slice(0, scene.height), slice(0, scene.width))
        self._points = self._background()
        self._draw(self._points, self._whole, 0, self._base_mm)
        self._still = self._exposed(self._points, scene.blur_px)
        self._travel = self._window(self._base_mm + scene.apart_mm + 1.0, 0.9 * scene.mark_mm + _TRAVEL_MM)
        light = np.linspace(1.0, 1.0 - scene.uneven, scene.width, dtype=np.float32)
        self._light = np.tile(light, (scene.height, 1))

    def frame(self, number: int, elongation_mm: FloatArray, time_s: float, wrong: Disturbance = FAULTLESS) -> Picture:
        """Return the picture [height, width] of one frame."""
        s = self.scene
        tip_mm = self._base_mm + s.apart_mm + float(np.mean(elongation_mm))
        smear_mm = float(np.ptp(elongation_mm))
        plain = wrong == replace(FAULTLESS, gain=wrong.gain, noise_grey=wrong.noise_grey)
        plain = plain and -_TRAVEL_MM < float(np.mean(elongation_mm)) < _TRAVEL_MM + 2.0
        window = self._travel if plain else self._whole
        points = self._points[_of_points(window)].copy()
        if wrong.swapped:
            self._draw(points, window, 1, self._base_mm)
        self._draw(points, window, 0 if wrong.swapped else 1, tip_mm, smear_mm)
        if wrong.second_tip:
            self._draw(points, window, 1, 0.0, y_mm=-1.1 * s.mark_mm)
        for share, at in ((wrong.covered, tip_mm), (wrong.base_covered, self._base_mm)):
            if share > 0.0:
                self._cover(points, at, share)
        drawn = self._exposed(points, math.hypot(s.blur_px, wrong.blur_px))
        picture = self._still.copy() if plain else drawn
        if plain:  # the blur at the window's own edge lacks what is beyond it
            rows, columns = (slice(part.start + _EDGE_PX, part.stop - _EDGE_PX) for part in window)
            picture[rows, columns] = drawn[_EDGE_PX:-_EDGE_PX, _EDGE_PX:-_EDGE_PX]
        if any(wrong.shift_px):
            move = np.array([[1, 0, wrong.shift_px[0]], [0, 1, wrong.shift_px[1]]], np.float64)
            size = (s.width, s.height)
            picture = self._cv.warpAffine(picture, move, size, flags=self._cv.INTER_CUBIC, borderValue=_PAPER)
        rng = np.random.default_rng((s.seed, 2, number))
        gain = wrong.gain * (1.0 + s.flicker * math.sin(2 * math.pi * 100.0 * time_s))
        picture *= self._light * np.float32(gain)
        noise_grey = np.float32(math.hypot(s.noise_grey, wrong.noise_grey))
        picture += noise_grey * rng.standard_normal(picture.shape, dtype=np.float32)
        return np.asarray(self._cv.convertScaleAbs(np.maximum(picture, 0.0)), np.uint8)  # rounds and saturates

    def _exposed(self, points: npt.NDArray[np.float32], blur_px: float) -> npt.NDArray[np.float32]:
        """Return the mean of the points of each pixel, blurred by the lens."""
        size = (points.shape[1] // _POINTS, points.shape[0] // _POINTS)
        picture = self._cv.resize(points, size, interpolation=self._cv.INTER_AREA)
        return np.asarray(self._cv.GaussianBlur(picture, (0, 0), blur_px), np.float32)

    def _background(self) -> npt.NDArray[np.float32]:
        """Return millimetre paper with the body of the unit on it, three points a pixel."""
        x, y = self._plane[..., 0], self._plane[..., 1]
        lines = np.zeros(x.shape, bool)
        for axis in (x, y):
            lines |= abs((axis + _GRID_MM / 2) % _GRID_MM - _GRID_MM / 2) < _LINE_MM / 2
        ground = np.where(lines, _LINE, _PAPER)
        body = (abs(y) < 1.5) & (x > self._base_mm) & (x < self._base_mm + self.scene.apart_mm)
        return np.where(body, _BODY, ground).astype(np.float32)

    def _card(self, number: int) -> npt.NDArray[np.float32]:
        """Return a card: the mark with a margin of one module."""
        cv = self._cv
        dictionary = cv.aruco.getPredefinedDictionary(cv.aruco.DICT_4X4_50)
        modules = np.full((8, 8), 255, np.uint8)
        modules[1:7, 1:7] = cv.aruco.generateImageMarker(dictionary, number, 6)
        grey = _BLACK + modules.astype(np.float32) / 255 * (_WHITE - _BLACK)
        return np.repeat(np.repeat(grey, _TEXELS, axis=0), _TEXELS, axis=1)

    def _draw(
        self,
        points: npt.NDArray[np.float32],
        window: Window,
        number: int,
        x_mm: float,
        smear_mm: float = 0.0,
        y_mm: float = 0.0,
    ) -> None:
        """Draw a card whose centre is at a place on the plane, smeared along x by the motion."""
        cv, per_mm = self._cv, _TEXELS * 6 / self.scene.mark_mm
        card, alpha = self._cards[number], np.ones_like(self._cards[number])
        # a point stands for a third of a pixel: its mean, not its middle
        wide, smear = (max(1, round(mm * per_mm)) for mm in (1 / self.scene.px_per_mm / _POINTS, smear_mm))
        margin = 2 * wide + smear
        card, alpha = (cv.copyMakeBorder(a, *[margin] * 4, cv.BORDER_CONSTANT, value=0) for a in (card, alpha))
        card, alpha = (cv.blur(cv.blur(a, (wide, wide)), (smear, 1)) for a in (card, alpha))
        half_mm = card.shape[0] / 2 / per_mm
        rows, columns = (
            slice(max(own.start, part.start), max(own.start, part.start, min(own.stop, part.stop)))
            for own, part in zip(window, self._window(x_mm, half_mm, y_mm), strict=True)
        )
        if rows.stop <= rows.start or columns.stop <= columns.start:
            return
        at = self._plane[_of_points((rows, columns))]
        u = (at[..., 0] - np.float32(x_mm - half_mm)) * np.float32(per_mm) - np.float32(0.5)
        v = (at[..., 1] - np.float32(y_mm - half_mm)) * np.float32(per_mm) - np.float32(0.5)
        drawn, cover = (
            cv.remap(a, u, v, cv.INTER_LINEAR, borderMode=cv.BORDER_CONSTANT, borderValue=0) for a in (card, alpha)
        )
        below, right = window[0].start, window[1].start
        shifted = (slice(rows.start - below, rows.stop - below), slice(columns.start - right, columns.stop - right))
        part = points[_of_points(shifted)]
        part *= 1.0 - cover
        part += drawn

    def _window(self, x_mm: float, half_mm: float, y_mm: float = 0.0) -> Window:
        """Return rows and columns of the pixels within a square of the plane, with some more."""
        middle = self._plane[1 :: 3 * _POINTS, 1 :: 3 * _POINTS]
        inside = np.maximum(abs(middle[..., 0] - x_mm), abs(middle[..., 1] - y_mm)) <= half_mm
        found = (np.flatnonzero(inside.any(axis=axis)) for axis in (1, 0))
        rows, columns = (
            slice(max(0, 3 * (int(i[0]) - 2)), min(size, 3 * (int(i[-1]) + 3))) if i.size else slice(0, 0)
            for i, size in zip(found, (self.scene.height, self.scene.width), strict=True)
        )
        return rows, columns

    def _cover(self, points: npt.NDArray[np.float32], x_mm: float, share: float) -> None:
        """Draw a hand over a share of a mark, from below, in the points of the whole picture."""
        s = self.scene
        x, y = self._plane[..., 0], self._plane[..., 1]
        edge_mm = 0.7 * s.mark_mm - 1.4 * s.mark_mm * share
        hand = (y > edge_mm + 0.4 * np.sin(x - x_mm)) & (abs(x - x_mm) < 0.9 * s.mark_mm)
        points[hand] = _BODY + 20 * np.sin(3 * x[hand])


def _of_points(window: Window) -> Window:
    """Return rows and columns of the points of some pixels."""
    rows, columns = (slice(_POINTS * part.start, _POINTS * part.stop) for part in window)
    return rows, columns


def _plane_of_points(scene: CameraScene) -> npt.NDArray[np.float32]:
    """Return where the camera's rays through the points of all pixels meet the plane, mm [rows, columns, 2]."""
    matrix = scene.matrix
    u = (np.arange(_POINTS * scene.width) + 0.5) / _POINTS - 0.5
    v = (np.arange(_POINTS * scene.height) + 0.5) / _POINTS - 0.5
    seen = np.stack(np.meshgrid((u - matrix[0, 2]) / matrix[0, 0], (v - matrix[1, 2]) / matrix[1, 1]), axis=-1)
    rays = seen.copy()
    for _ in range(12 if scene.distortion else 0):  # the model gives the distorted ray of an ideal one
        rays = seen / (1.0 + scene.distortion * (rays**2).sum(axis=-1, keepdims=True))
    tilt = math.radians(scene.tilt_deg)
    distance_mm = matrix[0, 0] / scene.px_per_mm
    # the plane through (0, 0, distance) turned about the vertical axis: x cos, z = distance + x sin
    x = distance_mm * rays[..., 0] / (math.cos(tilt) - rays[..., 0] * math.sin(tilt))
    y = rays[..., 1] * (distance_mm + x * math.sin(tilt))
    return np.stack([x, y], axis=-1).astype(np.float32)
