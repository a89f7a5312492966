"""The lens: pixels of a picture to pixels of an ideal pinhole camera, and its calibration from a checkerboard.

The model is Brown's with three radial and two tangential terms, fitted by OpenCV's `calibrateCamera` (Zhang's method).
A lens is stored with the unit's settings as JSON, with the reprojection error of its fit.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from analysis.json_object import json_object
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError, FileError, RequestError, writing
from protocol.base.optional import optional
from protocol.base.regular_file import read_regular
from protocol.base.whole_file import write_whole

Picture = npt.NDArray[np.uint8]

LENS_BYTES_MAX = 100_000
FEWEST_VIEWS = 5
LARGEST_REPROJECTION_PX = 1.0
_SEARCH_PX = 800  # longest side of the picture that the board is searched in: time and memory grow with its area


@dataclass(frozen=True, slots=True)
class Lens:
    """A calibrated lens."""

    matrix: tuple[tuple[float, float, float], ...]  # [3, 3] of the pinhole camera, pixels
    distortion: tuple[float, ...]  # k1, k2, p1, p2, k3
    size: tuple[int, int]  # width and height of the pictures, pixels
    reprojection_px: float  # rms distance of the checkerboard's corners from the model
    views: int = 0

    def undistorted(self, points_px: FloatArray) -> FloatArray:
        """Return where an ideal lens would show points [n, 2] of the picture, pixels."""
        matrix = np.array(self.matrix)
        points = np.ascontiguousarray(points_px, dtype=np.float64).reshape(-1, 1, 2)
        found = optional("cv2").undistortPoints(points, matrix, np.array(self.distortion), P=matrix)
        return np.asarray(found, dtype=np.float64).reshape(-1, 2)

    def as_json(self) -> dict[str, Any]:
        size = {"width_px": self.size[0], "height_px": self.size[1]}
        return json_object(self, "matrix", "distortion") | size | json_object(self, "reprojection_px", "views")

    def write(self, path: Path) -> None:
        """Write the lens as JSON."""
        with writing(path):
            write_whole(path, json.dumps(self.as_json(), indent=2) + "\n")


def lens_of(content: Mapping[str, Any], name: str) -> Lens:
    """Return the lens of an object of `Lens.as_json`. Raises FileError where it is no lens."""
    remedy = "Calibrate the lens from pictures of a checkerboard."
    try:
        matrix = np.array(content["matrix"], dtype=float).reshape(3, 3)
        distortion = np.array(content["distortion"], dtype=float).reshape(5)
        numbers = [float(content[key]) for key in ("width_px", "height_px", "reprojection_px", "views")]
    except (ValueError, KeyError, TypeError) as error:
        raise FileError(f"{name} is not a lens file: {error}", remedy) from error
    if not (np.isfinite([*matrix.ravel(), *distortion, *numbers]).all() and matrix[0, 0] > 0 and matrix[1, 1] > 0):
        raise FileError(f"{name} is not a lens file: its numbers are impossible", remedy)
    rows = tuple((float(a), float(b), float(c)) for a, b, c in matrix)
    size = (round(numbers[0]), round(numbers[1]))
    return Lens(rows, tuple(distortion.tolist()), size, numbers[2], round(numbers[3]))


def read_lens(path: Path) -> Lens:
    """Return the lens in a file of `Lens.write`. Raises FileError where it cannot be read, or is no lens."""
    try:
        text = read_regular(path, LENS_BYTES_MAX).decode("utf-8")
        content = json.loads(text)
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror or error}", "Check the name.") from error
    except (ValueError, RecursionError) as error:
        raise FileError(f"{path.name} is not a lens file: {error}", "Give the file of a calibrated lens.") from error
    return lens_of(content if isinstance(content, dict) else {}, path.name)


def calibrate_lens(pictures: Iterable[Picture], *, corners: tuple[int, int], pitch_mm: float) -> Lens:
    """Fit a lens to pictures of a checkerboard in different orientations.

    `pictures`: [height, width] grey or [height, width, 3] BGR, all of one size, held one at a time. `corners`: inner
    corners of the board, columns and rows. RequestError: an impossible board, or OpenCV is not installed. DataError:
    pictures of different size, the board is found in too few of them, or the fit is not good.
    """
    if min(corners) < 3 or not pitch_mm > 0:
        raise RequestError("a checkerboard has at least 3 by 3 inner corners and squares above 0 mm", "Check both.")
    cv2 = optional("cv2")
    sizes, found, count = set(), [], 0
    for picture in pictures:
        sizes.add(picture.shape[:2])
        if len(sizes) != 1:
            raise DataError("the pictures have 2 different sizes", "Give pictures of one camera and setting.")
        grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
        count += 1
        points = _corners_of(grey, corners)
        if points is not None:
            found.append(points)
    if len(found) < FEWEST_VIEWS:
        cause = f"the board of {corners[0]} x {corners[1]} inner corners was found in {len(found)} of {count}"
        remedy = f"Give at least {FEWEST_VIEWS} sharp pictures of the whole board, tilted differently."
        raise DataError(f"{cause} pictures", remedy)
    board = np.zeros((corners[0] * corners[1], 3), np.float32)
    board[:, :2] = pitch_mm * np.mgrid[0 : corners[0], 0 : corners[1]].T.reshape(-1, 2)
    (height, width) = sizes.pop()
    rms, matrix, distortion, _, _ = cv2.calibrateCamera([board] * len(found), found, (width, height), None, None)
    if not rms < LARGEST_REPROJECTION_PX:
        cause = f"the corners are {rms:.2f} px from the fitted lens"
        raise DataError(cause, "Leave out blurred pictures; keep the board flat and the focus fixed.")
    rows = tuple((float(a), float(b), float(c)) for a, b, c in matrix)
    terms = tuple(np.asarray(distortion, float).ravel()[:5].tolist())
    return Lens(rows, terms, (width, height), float(rms), len(found))


def _corners_of(grey: Picture, corners: tuple[int, int]) -> npt.NDArray[np.float32] | None:
    """Return the corners [n, 1, 2] of a board, pixels: found in a reduced picture, refined in the full one."""
    cv2 = optional("cv2")
    scale = max(1.0, max(grey.shape) / _SEARCH_PX)
    reduced = grey if scale == 1.0 else cv2.resize(grey, None, fx=1 / scale, fy=1 / scale, interpolation=cv2.INTER_AREA)
    seen, points = cv2.findChessboardCornersSB(reduced, corners, flags=cv2.CALIB_CB_ACCURACY)
    if not seen:
        return None
    if scale == 1.0:
        return np.asarray(points, np.float32)
    full = ((np.asarray(points, np.float64) + 0.5) * scale - 0.5).astype(np.float32)
    half = 2 * round(scale) + 1  # of the window, px: twice the pixel of the reduced picture
    until = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.01)
    return np.asarray(cv2.cornerSubPix(grey, full, (half, half), (-1, -1), until), np.float32)
