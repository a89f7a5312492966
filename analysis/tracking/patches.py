"""Elongation from two textured patches, where no mark can be glued: any part of base and tip with a pattern.

Each patch is found again by the enhanced correlation coefficient (Evangelidis and Psarakis 2008), which compensates for
changes of light, to hundredths of a pixel; its first guess is that of the picture before. The scale comes from the
millimetre grid in the picture, or is stated. Tilt is not
corrected: use marks where the camera looks obliquely.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.arrays import FloatArray
from analysis.errors import DataError, RequestError
from analysis.optional import optional
from analysis.tracking.lens import Picture
from analysis.tracking.marks import SATURATED_GREY, PictureFault
from analysis.tracking.tracker import (
    FASTEST_MM_PER_S,
    U_GRID,
    UNKNOWN_LENS,
    Plane,
    RepeatWatch,
    Tracked,
    grid_ratio,
)

LEAST_CORRELATION = 0.95
SMALLEST_PX, LEAST_TEXTURE_GREY = 16, 6.0
_REACH_PX = 12  # around the last place
_ITERATIONS, _PRECISION_PX = 40, 1e-4
_U_PX = 0.02  # standard uncertainty of a patch's place, measured on the virtual camera


@dataclass(frozen=True, slots=True)
class Patch:
    """A rectangle of the first picture, pixels: left, top, width, height."""

    x: int
    y: int
    width: int
    height: int


class PatchTracker:
    """Reads the elongation between two patches, as `MarkTracker` does between marks.

    Parameters
    ----------
    mm_per_px : scale; None takes the millimetre grid in the picture.
    u_scale : relative standard uncertainty of a stated scale.
    """

    def __init__(self, base: Patch, tip: Patch, *, mm_per_px: float | None = None, u_scale: float = 0.005) -> None:
        if min(base.width, base.height, tip.width, tip.height) < SMALLEST_PX:
            raise RequestError(f"a patch is smaller than {SMALLEST_PX} px", "Choose larger parts of base and tip.")
        self._patches = (base, tip)
        self._mm_per_px, self._u_stated = mm_per_px, u_scale
        self._templates: list[Picture] = []
        self._warps: list[FloatArray] = []
        self._repeats = RepeatWatch()
        self._good: tuple[float, float] | None = None
        self.side_mm, self.lens = math.nan, None
        self.plane: Plane | None = None

    def read_checked(self, picture: Picture, time_s: float) -> Tracked:
        """Return the elongation in a picture.

        Raises
        ------
        RequestError, DataError : a patch is not in the first picture or has no texture, or no grid gives the scale.
        """
        grey = picture if picture.ndim == 2 else optional("cv2").cvtColor(picture, 6)  # COLOR_BGR2GRAY
        if self.plane is None:
            self._begin(grey)
        plane = self.plane
        assert plane is not None
        if (fault := self._repeats.fault(grey, time_s)) is not None:
            return Tracked(time_s, math.nan, math.nan, fault)
        found = [self._found(grey, i) for i in (0, 1)]
        shown = [None if isinstance(f, PictureFault) else self._corners(i) + f for i, f in enumerate(found)]
        faults = [f for f in found if isinstance(f, PictureFault)]
        if faults:
            return Tracked(time_s, math.nan, math.nan, faults[0], *shown)
        base, tip = (f for f in found if not isinstance(f, PictureFault))
        x = float((tip - base) @ plane.axis) * plane.mm_per_px
        if self._good is not None and abs(x - self._good[1]) > FASTEST_MM_PER_S * (time_s - self._good[0]) + 0.5:
            return Tracked(time_s, math.nan, math.nan, PictureFault.JUMPED, *shown)
        self._good = (time_s, x)
        u_fit = math.sqrt(2.0) * _U_PX * plane.mm_per_px
        return Tracked(time_s, x, math.hypot(u_fit, plane.u_scale * x), None, *shown)

    def _begin(self, grey: Picture) -> None:
        """Cut the templates, and find the scale."""
        for patch in self._patches:
            cut = grey[patch.y : patch.y + patch.height, patch.x : patch.x + patch.width]
            if cut.shape != (patch.height, patch.width) or patch.x < 0 or patch.y < 0:
                raise RequestError("a patch lies outside the picture", "Choose parts of base and tip inside it.")
            if float(cut.std()) < LEAST_TEXTURE_GREY:
                raise DataError("a patch has no texture to track", "Choose a part with a pattern, or draw dots on it.")
            self._templates.append(cut.copy())
            self._warps.append(np.eye(2, 3))
        base, tip = (self._corners(i).mean(axis=0) for i in (0, 1))
        axis = (tip - base) / np.linalg.norm(tip - base)
        scale, u_scale = self._mm_per_px, self._u_stated
        if scale is None:
            scale, u_scale = self._by_grid(grey, tip - base), U_GRID
        self.plane = Plane(np.diag([scale, scale, 1.0]), scale * tip, axis, scale, math.hypot(u_scale, UNKNOWN_LENS))

    def _by_grid(self, grey: Picture, apart_px: FloatArray) -> float:
        """Return mm per pixel by the millimetre grid."""
        side_px = float(max(max(p.width, p.height) for p in self._patches))
        centre = self._corners(0).mean(axis=0)
        for guess in np.geomspace(0.01, 0.5, 12):
            move = np.array([[guess, 0, -guess * centre[0]], [0, guess, -guess * centre[1]], [0, 0, 1.0]])
            trial = Plane(move, guess * apart_px, np.array([1.0, 0.0]), float(guess), 0.0)
            ratio = grid_ratio(grey, trial, side_px * float(guess))
            if ratio is not None and 0.75 < ratio < 1.35:
                return float(guess * ratio)
        raise DataError("no millimetre grid is seen in the picture", "State the scale in mm per pixel.")

    def _corners(self, number: int) -> FloatArray:
        p = self._patches[number]
        return np.array(
            [[p.x, p.y], [p.x + p.width, p.y], [p.x + p.width, p.y + p.height], [p.x, p.y + p.height]], float
        )

    def _found(self, grey: Picture, number: int) -> FloatArray | PictureFault:
        """Return by how much a patch has moved since the first picture, pixels."""
        cv2: Any = optional("cv2")
        p, template, warp = self._patches[number], self._templates[number], self._warps[number]
        left = round(float(p.x + warp[0, 2])) - _REACH_PX
        top = round(float(p.y + warp[1, 2])) - _REACH_PX
        height, width = grey.shape
        x0, y0 = max(0, left), max(0, top)
        x1, y1 = min(width, left + p.width + 2 * _REACH_PX), min(height, top + p.height + 2 * _REACH_PX)
        part = grey[y0:y1, x0:x1]
        if part.shape[0] < p.height or part.shape[1] < p.width:
            return PictureFault.LOST
        if np.quantile(part, 0.9) >= SATURATED_GREY:
            return PictureFault.SATURATED
        score = cv2.matchTemplate(part, template, cv2.TM_CCOEFF_NORMED)
        _, _, _, at = cv2.minMaxLoc(score)
        first = np.array([[1, 0, at[0]], [0, 1, at[1]]], np.float32)
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, _ITERATIONS, _PRECISION_PX)
        try:
            quality, fine = cv2.findTransformECC(template, part, first, cv2.MOTION_TRANSLATION, criteria, None, 5)
        except cv2.error:
            return PictureFault.LOST
        if quality < LEAST_CORRELATION:
            return PictureFault.COVERED
        moved = np.array([fine[0, 2] + x0 - p.x, fine[1, 2] + y0 - p.y], float)
        self._warps[number] = np.array([[1.0, 0.0, moved[0]], [0.0, 1.0, moved[1]]])
        return moved
