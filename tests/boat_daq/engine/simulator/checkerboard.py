"""A checkerboard held before a virtual camera, for the calibration of its lens."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from boat_daq.engine.simulator.picture import _BLACK, _POINTS, _WHITE, CameraScene, Picture, _plane_of_points
from protocol.base.arrays import FloatArray
from protocol.base.optional import optional


def checkerboard(
    scene: CameraScene, tilt_deg: float, *, squares: tuple[int, int] = (9, 7), pitch_mm: float = 3.0
) -> Picture:
    """Return the picture of a checkerboard held before the camera."""
    plane = _plane_of_points(replace(scene, tilt_deg=tilt_deg))
    column = np.floor(plane[..., 0] / pitch_mm + squares[0] / 2)
    row = np.floor(plane[..., 1] / pitch_mm + squares[1] / 2)
    inside = (column >= 0) & (column < squares[0]) & (row >= 0) & (row < squares[1])
    grey = np.where(inside & ((column + row) % 2 == 0), _BLACK, _WHITE)
    picture = grey.reshape(scene.height, _POINTS, scene.width, _POINTS).mean(axis=(1, 3))
    rng = np.random.default_rng((scene.seed, 3, round(100 * tilt_deg) % 36_000))
    noise = scene.noise_grey * rng.standard_normal(picture.shape)
    blurred: FloatArray = optional("cv2").GaussianBlur(picture, (0, 0), scene.blur_px)
    rounded: Picture = np.clip(np.rint(blurred + noise), 0, 255).astype(np.uint8)
    return rounded
