"""Readings of elongation that are off a running fit over pressure: marked while a run is read, never removed."""

from __future__ import annotations

import numpy as np

from protocol.base.arrays import BoolArray, FloatArray

SIGMAS = 4.0
FLOOR_MM = 0.35  # on a half-millimetre grid a reading may be so far off without being wrong
LEAST_READINGS = 8  # before a fit means anything
MOST_DROPPED = 4  # at most one reading in so many
_MAD_TO_SD = 1.4826  # of a normal distribution


def outlying(pressure_kpa: FloatArray, loading: BoolArray, elongation_mm: FloatArray) -> FloatArray:
    """Return the distance (mm) of each outlying reading [n] from the fit; NaN for others and below `LEAST_READINGS`.

    The fit is a cubic in pressure with an offset between the branches; the farthest reading is dropped, and the rest
    fitted again, until none is far: one bad reading must not hide itself. The scale is the median absolute deviation of
    the readings kept (Rousseeuw and Croux, 1993), at least `FLOOR_MM` / `SIGMAS`.
    """
    n = elongation_mm.size
    if n < LEAST_READINGS:
        return np.full(n, np.nan)
    u = pressure_kpa / max(1.0, float(np.abs(pressure_kpa).max()))
    design = np.column_stack([np.ones_like(u), u, u**2, u**3, loading * (1 - u**2)])
    kept = np.ones(n, dtype=bool)
    residual = np.zeros(n)
    for _ in range(n // MOST_DROPPED + 1):
        residual = elongation_mm - design @ np.linalg.lstsq(design[kept], elongation_mm[kept], rcond=None)[0]
        sd = max(_MAD_TO_SD * float(np.median(np.abs(residual[kept]))), FLOOR_MM / SIGMAS)
        worst = int(np.argmax(np.where(kept, np.abs(residual), -1.0)))
        if abs(residual[worst]) <= SIGMAS * sd or (~kept).sum() >= n // MOST_DROPPED:
            break
        kept[worst] = False
    return np.where(kept, np.nan, residual)
