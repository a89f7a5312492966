"""Elongation from one picture after the other: the distance of the tip's mark from the base's, less that at rest.

Strategy: the first pictures give the plane of the marks: the projective map that makes both of them squares of their
known side, which corrects the camera's tilt and gives the scale. After that each picture is measured alone: both marks
are mapped to the plane, the base's mark is brought back to its place (so a shaken camera cancels), and the displacement
of the tip along the axis is the elongation. The axis leads from the middle of the base's mark to that of the tip's.

Rules: a picture that is not certain gives no value and the reason why (`PictureFault`); no value is carried over from
the picture before. The marks are looked for in the whole picture twice a second, else where they were.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from analysis.tracking.lens import Lens, Picture
from analysis.tracking.marks import BASE, TIP, Mark, PictureFault, find_marks, homography, measure_mark, project
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError
from protocol.base.optional import optional

LEARNED_PICTURES = 15
SEARCH_EVERY = 15  # pictures
FROZEN_S = 0.5
FASTEST_MM_PER_S = 60.0  # an actuator that vents moves 4 mm in 250 ms
MOVED_MM, MOVED_SCALE = 3.0, 0.03  # of the base's mark, where the plane is no longer the one that was learned
DISTORTED = 0.02  # relative change of the tip's mark
UNKNOWN_LENS = 0.002  # relative standard uncertainty of the scale without a calibrated lens
CORNER_SHARE = 0.6  # standard deviation of a corner over that of the crossings, measured
U_GRID = 0.001  # relative standard uncertainty of a printed millimetre grid
GRID_APART = 0.015  # relative difference of the marks' scale and the grid's
_GRID_PER_MM = 24  # pixels of the map in which the grid is looked for
_CARD = 0.75  # half the card of a mark over its side
_GRID_CLEAR = 6.0  # height of a peak over the median of its spectrum


@dataclass(frozen=True, slots=True)
class Optics:
    """What is known of camera and marks.

    `mark_mm`: side of the black square of both marks; 0 takes the scale from the millimetre grid in the picture.
    """

    mark_mm: float = 10.0
    u_mark_mm: float = 0.02
    lens: Lens | None = None  # None where it was not calibrated


@dataclass(frozen=True, slots=True)
class Tracked:
    """The elongation in one picture."""

    time_s: float
    elongation_mm: float  # with u_mm: value and standard uncertainty; NaN where there is none
    u_mm: float
    fault: PictureFault | None  # why there is no value; None where there is one
    base_px: FloatArray | None = None  # with tip_px: [4, 2] corners of the marks in the picture, None where not found
    tip_px: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Plane:
    """The plane of the marks."""

    to_mm: FloatArray  # [3, 3] from undistorted pixels to mm, the base's mark about the origin
    tip_mm: FloatArray  # middle of the tip's mark when it was learned
    axis: FloatArray  # unit vector along which the elongation counts
    mm_per_px: float
    u_scale: float  # relative standard uncertainty of lengths


def square(side_mm: float) -> FloatArray:
    """Return the corners [4, 2] of a mark about the origin, in its own order."""
    return 0.5 * side_mm * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def learn_plane(base_px: FloatArray, tip_px: FloatArray, side_mm: float, optics: Optics) -> Plane:
    """Return the plane in which both marks are squares of their side.

    `base_px`, `tip_px`: [pictures, 4, 2] undistorted corners; the tip may move meanwhile. `optics`: uncertainty of the
    side, and the lens.
    """
    corners, n = square(side_mm), len(tip_px)
    start = homography(corners, base_px.mean(axis=0))
    from_base = np.asarray(np.linalg.inv(start), np.float64)
    poses = [_pose(project(from_base, quad)) for quad in tip_px]

    def residuals(unknown: FloatArray) -> FloatArray:
        to_px: FloatArray = np.append(unknown[:8], 1.0).reshape(3, 3)
        pose = unknown[8:].reshape(n, 3)
        cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        turned = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2) @ corners.T
        tips: FloatArray = turned.transpose(0, 2, 1) + pose[:, None, :2]
        every: FloatArray = np.concatenate([corners, tips.reshape(-1, 2)])
        seen = project(to_px, every)
        base = math.sqrt(n) * (seen[:4] - base_px.mean(axis=0))
        return np.concatenate([base.ravel(), (seen[4:].reshape(n, 4, 2) - tip_px).ravel()])

    unknown = np.concatenate([(start / start[2, 2]).ravel()[:8], np.ravel(poses)])
    fit = least_squares(residuals, unknown, x_scale="jac", max_nfev=50)
    to_px = np.append(fit.x[:8], 1.0).reshape(3, 3)
    tip_mm = fit.x[8:].reshape(n, 3)[:, :2].mean(axis=0)
    axis = tip_mm / np.linalg.norm(tip_mm)
    along = project(to_px, np.array([tip_mm - 0.5 * axis, tip_mm + 0.5 * axis]))
    mm_per_px = 1.0 / float(np.linalg.norm(along[1] - along[0]))
    # what corners miss the model by, over the sides: a bent lens, or marks that are not in one plane
    misfit = math.sqrt(2.0 * fit.cost / max(1, 8 * n + 8 - fit.x.size)) * mm_per_px / side_mm
    lens = optics.lens
    u_lens = UNKNOWN_LENS if lens is None else lens.reprojection_px / math.sqrt(max(lens.views, 1)) / lens.size[0] * 4
    u_side = optics.u_mark_mm / side_mm if optics.mark_mm else U_GRID
    u_scale = math.hypot(u_side, misfit, u_lens)
    return Plane(np.linalg.inv(to_px), tip_mm, axis, mm_per_px, u_scale)


def _pose(quad_mm: FloatArray) -> tuple[float, float, float]:
    """Return middle and angle of a mark [4, 2] in the plane."""
    middle, first = quad_mm.mean(axis=0), quad_mm[1] - quad_mm[0] + quad_mm[2] - quad_mm[3]
    return float(middle[0]), float(middle[1]), math.atan2(first[1], first[0])


def similarity(points: FloatArray, target: FloatArray) -> tuple[complex, complex, float]:
    """Return a and b of target = a points + b as complex numbers, and the rms of the residuals of a coordinate."""
    z, w = points @ np.array([1.0, 1.0j]), target @ np.array([1.0, 1.0j])
    dz, dw = z - z.mean(), w - w.mean()
    a = complex((dz.conj() * dw).sum() / (dz.conj() * dz).sum())
    off = dw - a * dz
    return a, complex(w.mean() - a * z.mean()), math.sqrt(float((abs(off) ** 2).sum()) / 4.0)


class RepeatWatch:
    """Detects a camera that gives the same picture again."""

    def __init__(self) -> None:
        self._before: Picture | None = None
        self._same_since_s: float | None = None

    def fault(self, grey: Picture, time_s: float) -> PictureFault | None:
        """Return whether a picture is the one before once more, to the last bit: noise differs in every new one."""
        same = self._before is not None and np.array_equal(grey[::5], self._before[::5])
        self._before = grey
        if not same:
            self._same_since_s = None
            return None
        self._same_since_s = time_s if self._same_since_s is None else self._same_since_s
        return PictureFault.FROZEN if time_s - self._same_since_s >= FROZEN_S else PictureFault.REPEATED


class MarkTracker:
    """Reads the elongation in one picture after the other.

    `plane`: None until enough pictures were learned from. `grid`: scale of the marks over that of the millimetre grid
    in the picture; None where no grid is seen.
    """

    def __init__(self, optics: Optics) -> None:
        self.optics, self.lens = optics, optics.lens
        self.side_mm = optics.mark_mm or 1.0
        self.plane: Plane | None = None
        self.grid: float | None = None
        self._learned: list[tuple[Mark, Mark]] = []
        self._near: dict[int, FloatArray] = {}
        self._ambiguous = False
        self._since_search = SEARCH_EVERY
        self._repeats = RepeatWatch()
        self._good: deque[tuple[float, float]] = deque(maxlen=1)
        self._size = 1.0

    def read(self, picture: Picture, time_s: float) -> Tracked:
        """Return the elongation in a picture. `picture`: [height, width] grey or [height, width, 3] BGR."""
        grey = picture if picture.ndim == 2 else optional("cv2").cvtColor(picture, 6)  # COLOR_BGR2GRAY
        if (fault := self._repeats.fault(grey, time_s)) is not None:
            return Tracked(time_s, math.nan, math.nan, fault)
        base, tip = self._measured(grey)
        if isinstance(base, PictureFault) or isinstance(tip, PictureFault):
            found = [None if isinstance(mark, PictureFault) else mark.raw_px for mark in (base, tip)]
            fault = next(mark for mark in (base, tip) if isinstance(mark, PictureFault))
            return Tracked(time_s, math.nan, math.nan, fault, *found)
        if self.plane is None and not self._learn(grey, base, tip):
            return Tracked(time_s, math.nan, math.nan, PictureFault.LEARNING, base.raw_px, tip.raw_px)
        return self._elongation(base, tip, time_s)

    def read_checked(self, picture: Picture, time_s: float) -> Tracked:
        """Return the elongation in a picture, as `read`, and refuse marks that contradict the grid."""
        learned = self.plane is not None
        tracked = self.read(picture, time_s)
        if self.plane is not None and not learned:
            check_grid(self)
        return tracked

    def _measured(self, grey: Picture) -> tuple[Mark | PictureFault, Mark | PictureFault]:
        """Return both marks, or why each is not measured."""
        self._since_search += 1
        if self._since_search >= SEARCH_EVERY or len(self._near) < 2:
            self._search(grey)
        if self._ambiguous:
            return PictureFault.AMBIGUOUS, PictureFault.AMBIGUOUS
        marks = self._at_places(grey)
        if any(isinstance(mark, PictureFault) for mark in marks) and self._since_search:
            self._search(grey)
            marks = (PictureFault.AMBIGUOUS, PictureFault.AMBIGUOUS) if self._ambiguous else self._at_places(grey)
        for number, mark in zip((BASE, TIP), marks, strict=True):
            if isinstance(mark, PictureFault):
                self._near.pop(number, None)
            else:
                self._near[number] = mark.raw_px
        return marks

    def _at_places(self, grey: Picture) -> tuple[Mark | PictureFault, Mark | PictureFault]:
        base, tip = (
            measure_mark(grey, n, self._near[n], self.optics.lens) if n in self._near else PictureFault.LOST
            for n in (BASE, TIP)
        )
        return base, tip

    def _search(self, grey: Picture) -> None:
        """Look for the marks in the whole picture."""
        self._since_search = 0
        found = find_marks(grey)
        self._ambiguous = any(len(found.get(n, ())) > 1 for n in (BASE, TIP))
        for n in (BASE, TIP):
            if len(found.get(n, ())) == 1:
                at = found[n][0]
                if n not in self._near or abs(at - self._near[n]).max() > 3.0:
                    self._near[n] = at

    def _learn(self, grey: Picture, base: Mark, tip: Mark) -> bool:
        """Take a picture's marks for the plane; return whether there are enough."""
        self._learned.append((base, tip))
        if len(self._learned) < LEARNED_PICTURES:
            return False
        corners = np.array([[mark.corners_px for mark in pair] for pair in self._learned])
        self.plane = learn_plane(corners[:, 0], corners[:, 1], self.side_mm, self.optics)
        if not self.optics.mark_mm:  # a millimetre was the marks' side until here
            side_mm = find_side(grey, self.plane)
            if side_mm is None:
                cause = "no millimetre grid is seen in the picture"
                raise DataError(cause, "State the side of the marks' black square.")
            self.side_mm = side_mm
            self.plane = learn_plane(corners[:, 0], corners[:, 1], side_mm, self.optics)
        tips = project(self.plane.to_mm, corners[:, 1].reshape(-1, 2)).reshape(-1, 4, 2)
        turn, _, _ = similarity(square(self.side_mm), tips.mean(axis=0))
        self._size = abs(turn)
        self.grid = grid_ratio(grey, self.plane, self.side_mm)
        self._learned.clear()
        return True

    def _elongation(self, base: Mark, tip: Mark, time_s: float) -> Tracked:
        plane, side = self.plane, self.side_mm
        assert plane is not None
        shown = (base.raw_px, tip.raw_px)
        seen = project(plane.to_mm, base.corners_px)
        back, shift, base_off = similarity(seen, square(side))
        moved = max(float(np.linalg.norm(seen.mean(axis=0))), side * abs(np.angle(back)))
        if moved > MOVED_MM or abs(abs(back) - 1.0) > MOVED_SCALE:
            return Tracked(time_s, math.nan, math.nan, PictureFault.MOVED, *shown)
        quad = project(plane.to_mm, tip.corners_px) @ np.array([1.0, 1.0j]) * back + shift
        corners = np.column_stack([quad.real, quad.imag])
        turn, _, tip_off = similarity(square(side), corners)
        if abs(abs(turn) / self._size - 1.0) > DISTORTED:
            return Tracked(time_s, math.nan, math.nan, PictureFault.DISTORTED, *shown)
        x = float((corners.mean(axis=0) - plane.tip_mm) @ plane.axis)
        if any(abs(x - x0) > FASTEST_MM_PER_S * (time_s - t0) + 0.5 for t0, x0 in self._good):
            self._good[0] = (self._good[0][0], self._good[0][1])
            return Tracked(time_s, math.nan, math.nan, PictureFault.JUMPED, *shown)
        self._good.append((time_s, x))
        per_px = CORNER_SHARE * plane.mm_per_px
        sd_base, sd_tip = math.hypot(base_off, per_px * base.residual_px), math.hypot(tip_off, per_px * tip.residual_px)
        lever = float(np.linalg.norm(plane.tip_mm)) / side
        u_fit = math.sqrt(sd_tip**2 / 4 + sd_base**2 * (1 / 4 + lever**2 / 2))
        return Tracked(time_s, x, math.hypot(u_fit, plane.u_scale * x), None, *shown)


def find_side(grey: Picture, plane: Plane) -> float | None:
    """Return the side of the marks by the millimetre grid in a picture; None where none is clearly seen.

    `plane`: learned with marks of 1 mm.
    """
    for side_mm in np.geomspace(3.0, 60.0, 8):  # each finds a grid within a factor of 1.6
        scale = np.diag([side_mm, side_mm, 1.0])
        trial = replace(plane, to_mm=scale @ plane.to_mm, tip_mm=side_mm * plane.tip_mm)
        ratio = grid_ratio(grey, trial, side_mm)
        if ratio is not None and 0.75 < ratio < 1.35:
            return float(side_mm * ratio)
    return None


def grid_ratio(grey: Picture, plane: Plane, side_mm: float) -> float | None:
    """Return the scale of the marks over that of a millimetre grid around them; None where no grid is clearly seen.

    The picture is mapped to the plane; the grid is the highest peak of the spectrum of its rows and columns near one
    line a millimetre.
    """
    cv2 = optional("cv2")
    height, width = grey.shape
    border = project(plane.to_mm, np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]]))
    low, high = border.min(axis=0), border.max(axis=0)
    size = np.minimum(np.ceil((high - low) * _GRID_PER_MM), 2400).astype(int)
    to_map = np.array([[_GRID_PER_MM, 0, -low[0] * _GRID_PER_MM], [0, _GRID_PER_MM, -low[1] * _GRID_PER_MM], [0, 0, 1]])
    flat = cv2.warpPerspective(grey, to_map @ plane.to_mm, size.tolist(), flags=cv2.INTER_LINEAR, borderValue=0)
    whole = cv2.warpPerspective(np.ones_like(grey), to_map @ plane.to_mm, size.tolist(), borderValue=0) > 0
    reach = _CARD * side_mm
    ends = np.array([np.minimum(-reach, plane.tip_mm - reach), np.maximum(reach, plane.tip_mm + reach + 2.0)])
    first, last = np.rint((ends - low) * _GRID_PER_MM).astype(int)
    found = []
    for axis in (0, 1):  # along y in the columns, along x in the rows, where no card is
        inside = np.moveaxis(whole, axis, 0)
        free = inside.mean(axis=0) > 0.95
        free[max(0, first[axis]) : max(0, last[axis])] = False
        if free.sum() < _GRID_PER_MM:
            return None
        found.append(_lines_per_mm(np.moveaxis(flat, axis, 0)[:, free].astype(float)))
    if any(peak is None for peak in found):
        return None
    return float(np.mean([peak for peak in found if peak is not None]))


def _lines_per_mm(columns: FloatArray) -> float | None:
    """Return the lines a millimetre along the first axis of a part of the map; None where there is no clear peak."""
    n = len(columns)
    window = np.hanning(n)[:, None]
    padded = 8 * n
    spectrum = np.abs(np.fft.rfft((columns - columns.mean(axis=0)) * window, padded, axis=0)).mean(axis=1)
    per_mm = np.arange(spectrum.size) * _GRID_PER_MM / padded
    band = (per_mm > 0.6) & (per_mm < 1.7)
    if not band.any():
        return None
    inside = np.flatnonzero(band)
    at = int(inside[np.argmax(spectrum[band])])
    if at in (inside[0], inside[-1]) or spectrum[at] < _GRID_CLEAR * np.median(spectrum[band]):
        return None
    left, middle, right = np.log(spectrum[at - 1 : at + 2])
    shift = 0.5 * (left - right) / (left - 2 * middle + right)
    return float((at + shift) * _GRID_PER_MM / padded)


def check_grid(tracker: MarkTracker) -> None:
    """Refuse marks whose stated size contradicts the millimetre grid in the picture.

    Raises DataError: names the size by the grid.
    """
    ratio, side = tracker.grid, tracker.side_mm
    if ratio is not None and abs(ratio - 1.0) > GRID_APART:
        cause = (
            f"the marks' side is {side * ratio:.2f} mm by the millimetre grid in the picture, {side:g} mm are stated"
        )
        raise DataError(cause, "Measure the black square of a mark and state its side.")
