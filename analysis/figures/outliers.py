"""Readings of elongation that are off: marked while a run is read, left out of its calibration on request.

While a run is read a reading is compared with a running fit over pressure, and never removed. On request the readings
whose points are off the curve of a sensor (`analysis.calibration.left_out`) are left out, each with a warning.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analysis.warning import Warning, WarningCode
from protocol.base.arrays import BoolArray, FloatArray

if TYPE_CHECKING:  # the window marks readings while a run is read, and imports none of the fit's libraries for it
    from analysis.figures.sensor_analysis import SegmentedRun

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


def wrong_readings(run: SegmentedRun) -> dict[int, tuple[str, ...]]:
    """Return the plateaus, counted from 0, whose reading is off, each with a text for every sensor that shows it."""
    from analysis.calibration.curve_choice import USUAL_DEGREE
    from analysis.calibration.fit import fit_calibration
    from analysis.calibration.left_out import leave_out
    from protocol.base.errors import BoatDaqError

    degree = run.options.degree if isinstance(run.options.degree, int) else USUAL_DEGREE
    found: dict[int, tuple[str, ...]] = {}
    for sensor, name in enumerate(run.recording.sensor_names):
        points = np.flatnonzero(run.calibration_points(sensor))
        if run.elongations is None or not points.size:
            continue
        y = np.asarray([run.plateaus[i].signal_mv[sensor] for i in points])
        try:
            left = leave_out(fit_calibration(run.elongations.elongation_mm[points], y, degree)).left_out
        except BoatDaqError:
            continue  # no curve: its reason is given with the calibration
        for one in left:
            plateau = int(points[one.row])
            text = f"{name} {one.residual:+.1f} mV off the curve, {one.reason}"
            found[plateau] = (*found.get(plateau, ()), text)
    return dict(sorted(found.items()))


def without_wrong_readings(run: SegmentedRun) -> tuple[SegmentedRun, tuple[Warning, ...]]:
    """Return the run without the readings that are off, and a warning for each of them."""
    wrong = wrong_readings(run)
    if run.elongations is None or not wrong:
        return run, ()
    x = run.elongations.elongation_mm.copy()
    warnings = []
    for plateau, texts in wrong.items():
        reading = f"the reading {x[plateau]:+.2f} mm at {run.plateaus[plateau].place} is left out"
        warnings.append(Warning(WarningCode.READING_LEFT_OUT, "", f"{reading}: {'; '.join(texts)}"))
        x[plateau] = np.nan
    return run.with_elongations(replace(run.elongations, elongation_mm=x)), tuple(warnings)
