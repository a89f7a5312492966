"""What a camera adds to a run: elongations of its plateaus, and the calibration on the continuous record.

Each plateau's elongation is the mean over exactly the samples of its signals; what the operator entered counts before
it. The continuous record pairs every sample with the elongation between the two frames about it. Its curve is fitted to
the mean of both branches in equal bins of elongation, so that neither branch nor a hold weighs more; its hysteresis,
of the mean loop and of every cycle, is the largest width of a smooth loop through the bins, signal over elongation; its
dynamic error is what the signal changes with speed on one branch.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from analysis.calibration.fit import Calibration, fit_calibration
from analysis.calibration.type_b import SCALE, Distribution, TypeBContribution
from analysis.data.recording import Recording
from analysis.json_object import json_object
from analysis.segmentation.cycles import Cycle
from analysis.segmentation.loops import ENDS_SHARE, branch_not_passed
from analysis.segmentation.plateau_readings import Elongations
from analysis.segmentation.plateaus import Plateau
from analysis.tracking.run import Filmed, plateau_means
from protocol.base.arrays import BoolArray, FloatArray
from protocol.base.errors import BoatDaqError

SOURCE = "camera"
_BINS = 40
FEWEST_PER_BIN = 3
_LOOP_TERMS = 3  # of the polynomial that shapes a loop
SPEED_BINS = 8  # of each direction of motion
LEAST_SPEED = 0.05  # mm/s, of a sample that moves
FEWEST_MOVING = 30  # samples of a direction
SAMPLES_PER_FRAME = 3.0  # neighbouring samples share their frame: one of three is counted
_BY_SPEED = ("speed_mm_per_s", "signal_mv", "u_mv")


@dataclass(frozen=True, slots=True)
class ContinuousCalibration:
    """One sensor on the continuous record.

    `by_speed`: [n, 3] speed, mm/s, mean distance of the signal from its branch, mV, and its standard uncertainty.
    """

    calibration: Calibration | None  # that of the means of both branches; None and `void` where it cannot be
    void: str
    r2: float = math.nan
    sensitivity_mv_per_mm: float = math.nan
    hysteresis_percent_fso: float = math.nan
    per_cycle: tuple[float, ...] = ()
    hysteresis_void: str = ""  # why no cycle has a loop
    samples: int = 0
    # dynamic_mv_per_mm_per_s, u_dynamic: change of the signal with speed, and its standard uncertainty
    dynamic_mv_per_mm_per_s: float = math.nan
    u_dynamic: float = math.nan
    apart_percent_fso: float = math.nan  # largest distance from the plateaus' curve; NaN without one
    # loop_mm, loop_mv: [2, bins] elongation and signal of the mean unloading and loading branch, NaN where unknown
    loop_mm: FloatArray = field(default_factory=lambda: np.empty((2, 0)))
    loop_mv: FloatArray = field(default_factory=lambda: np.empty((2, 0)))
    by_speed: FloatArray = field(default_factory=lambda: np.empty((0, 3)))

    def as_json(self) -> dict[str, Any]:
        """Return the object of `analyze --json`."""
        return {
            **json_object(self, "calibration", "calibration_void=void", "r2", "samples", "sensitivity_mv_per_mm"),
            "hysteresis_percent_fso": {
                "abscissa": "elongation_mm",
                "mean": self.hysteresis_percent_fso,
                "per_cycle": list(self.per_cycle),
            },
            **json_object(self, "hysteresis_void", "dynamic_mv_per_mm_per_s", "u_dynamic_mv_per_mm_per_s=u_dynamic"),
            "from_plateaus_percent_fso": self.apart_percent_fso,
            "loop": json_object(self, "elongation_mm=loop_mm", "signal_mv=loop_mv"),
            "by_speed": [dict(zip(_BY_SPEED, row, strict=True)) for row in self.by_speed.tolist()],
        }


@dataclass(frozen=True, slots=True)
class CameraFigures:
    """The camera of a run, and each sensor on its continuous record, by the numbers of its cycles."""

    film: Filmed
    sensors: tuple[ContinuousCalibration, ...]
    cycles: tuple[int, ...]

    @property
    def u_mm(self) -> float:
        """Median standard uncertainty of a frame's elongation; NaN without one."""
        record = self.film.record
        return float(np.median(record.u_mm[record.valid])) if record.valid.any() else math.nan

    def as_json(self) -> dict[str, Any]:
        """Return the key `camera` of `analyze --json`."""
        record, delay = self.film.record, self.film.delay
        return {
            "source": self.film.recording.meta.get("camera", {}).get("source", ""),
            "frames": record.time_s.size,
            "valid": int(record.valid.sum()),
            "dropped": record.dropped,
            "faults": record.faults,
            "u_mm": self.u_mm,
            "u_scale_percent": 100 * self.film.u_scale,
            "delay_s": delay.delay_s if delay else None,
            "u_delay_s": delay.u_s if delay else None,
            "drift_ppm": 1e6 * delay.drift if delay else None,
            "u_drift_ppm": 1e6 * delay.u_drift if delay else None,
            **json_object(self, "rest_mm=film.rest_mm", "cycles", "sensors"),
        }


def scale_of(film: Filmed) -> TypeBContribution:
    """Return the contribution of the camera's scale to the uncertainty of an elongation."""
    source = f"camera {film.recording.meta.get('camera', {}).get('source', '')}".strip()
    return TypeBContribution(SCALE, 100 * film.u_scale, "percent", 1.0, math.inf, Distribution.NORMAL, "", source)


def camera_elongations(film: Filmed, plateaus: Sequence[Plateau], entered: Elongations | None) -> Elongations:
    """Return the elongation of each plateau by the camera; what the operator entered counts before it.

    `entered`: readings of the operator, without those of the camera.
    """
    time_s = film.recording.time_s
    rows = [(p.settled_first, p.last - 1) for p in plateaus]
    windows = time_s[np.clip(np.array(rows, np.int64).reshape(-1, 2), 0, time_s.size - 1)]
    mean, u = plateau_means(film.record, windows, film.u_scale)
    current = film.recording.current_readings
    withdrawn = set(current.loc[pd.to_numeric(current["elongation_mm"], errors="coerce").isna(), "step"].tolist())
    mean = np.where([p.step in withdrawn for p in plateaus], np.nan, mean)
    resolution = float(np.nanmedian(u)) * math.sqrt(12.0) if np.isfinite(u).any() else math.nan
    if entered is None or not entered.known.any():
        return Elongations(mean, resolution, SOURCE)
    both = np.where(entered.known, entered.elongation_mm, mean)
    most = entered if entered.known.sum() > np.isfinite(mean).sum() / 2 else None
    return Elongations(both, most.resolution_mm if most else resolution, f"{SOURCE}, {entered.source}")


def camera_figures(
    film: Filmed, recording: Recording, cycles: Sequence[Cycle], calibrations: Sequence[Calibration | None]
) -> CameraFigures:
    """Return the calibrations on the continuous record, beside those of the plateaus.

    `recording`: the same run, what is not usable marked.
    """
    motion = film.record.at(film.recording.time_s)[:2]
    sensors = (_continuous(recording, cycles, i, motion, plateaus) for i, plateaus in enumerate(calibrations))
    return CameraFigures(film, tuple(sensors), tuple(cycle.number for cycle in cycles))


def _continuous(
    recording: Recording,
    cycles: Sequence[Cycle],
    sensor: int,
    motion: tuple[FloatArray, FloatArray],
    plateaus: Calibration | None,
) -> ContinuousCalibration:
    """Return the calibration of a sensor, counted from 0, on all samples with an elongation.

    `sensor`: counted from 0. `motion`: [n] elongation and its speed. `plateaus`: the curve of the plateaus, or None.
    """
    x, speed = motion
    y, usable = recording.signal_mv[:, sensor], recording.usable[:, sensor] & np.isfinite(x)
    inside = np.zeros(x.size, bool)
    for cycle in cycles:
        inside[cycle.rows] = True
    inside &= usable
    if inside.sum() < 10 * _BINS:
        return ContinuousCalibration(None, "too few samples of complete cycles have an elongation of the camera")
    low_mm, high_mm = np.quantile(x[inside], [0.001, 0.999]).tolist()
    edges = np.linspace(low_mm, high_mm, _BINS + 1)
    abscissa, ordinate = (np.full((2, len(cycles), _BINS), np.nan) for _ in range(2))
    for k, cycle in enumerate(cycles):
        for b, rows in enumerate((cycle.unloading, cycle.loading)):
            abscissa[b, k], ordinate[b, k] = _bin_means(x[rows], y[rows], usable[rows], edges)
    one_branch = [_one_branch(x, usable, cycle, edges) for cycle in cycles]
    driven = np.asarray([not why for why in one_branch], dtype=bool)
    if driven.any():  # else the curve is that of all cycles, without a loop
        abscissa, ordinate = abscissa[:, driven], ordinate[:, driven]
    with np.errstate(invalid="ignore"):
        known = np.isfinite(ordinate).all(axis=0)
        at, middle = abscissa.mean(axis=0)[known], ordinate.mean(axis=0)[known]
    degree = plateaus.degree if plateaus is not None and plateaus.spline is None else 3
    try:
        calibration = fit_calibration(at, middle, degree)
    except BoatDaqError as error:
        return ContinuousCalibration(None, error.cause)
    fso = calibration.full_scale
    left = y[inside] - calibration.predict(x[inside])
    loop = _mean_loop(abscissa), _mean_loop(ordinate)
    width_mv = _loop_width(*loop, calibration) if driven.any() else math.nan
    found = iter([_loop_width(abscissa[:, k], ordinate[:, k], calibration) for k in range(int(driven.sum()))])
    per_cycle_mv = [next(found) if both else math.nan for both in driven]
    off = _off_branches(x, y, cycles, loop)[inside]
    slope, u_slope = _dynamic(off, speed[inside])
    return ContinuousCalibration(
        calibration,
        "",
        1.0 - float(left @ left) / float(((y[inside] - y[inside].mean()) ** 2).sum()),
        fso / (calibration.x_range[1] - calibration.x_range[0]),
        100.0 * width_mv / fso,
        tuple(100.0 * width / fso for width in per_cycle_mv),
        "" if driven.any() else one_branch[0],
        int(inside.sum()),
        slope,
        u_slope,
        _apart_percent(calibration, plateaus),
        *loop,
        _by_speed(off, speed[inside]),
    )


def _apart_percent(calibration: Calibration, plateaus: Calibration | None) -> float:
    """Return the greatest distance from the curve of the plateaus over their common range, % of its full scale."""
    if plateaus is None or not plateaus.full_scale:
        return math.nan
    low, high = (max(calibration.x_range[0], plateaus.x_range[0]), min(calibration.x_range[1], plateaus.x_range[1]))
    grid = np.linspace(low, high, 101)
    return 100.0 * float(np.abs(calibration.predict(grid) - plateaus.predict(grid)).max()) / plateaus.full_scale


def _one_branch(x: FloatArray, usable: BoolArray, cycle: Cycle, edges: FloatArray) -> str:
    """Return which branch a cycle did not drive, from its samples inside the range of x; "" if it drove both."""
    margin = ENDS_SHARE * (edges[-1] - edges[0])
    between = usable & (x > edges[0] + margin) & (x < edges[-1] - margin)
    return branch_not_passed(int(between[cycle.unloading].sum()), int(between[cycle.loading].sum()))


def _bin_means(x: FloatArray, y: FloatArray, usable: BoolArray, edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean abscissa and ordinate of one branch in bins of x; NaN where a bin has too few samples."""
    cell = np.digitize(np.where(usable, x, np.nan), edges) - 1
    good = usable & (cell >= 0) & (cell < _BINS)
    count = np.bincount(cell[good], minlength=_BINS).astype(float)
    count[count < FEWEST_PER_BIN] = np.nan
    return (
        np.bincount(cell[good], x[good], minlength=_BINS) / count,
        np.bincount(cell[good], y[good], minlength=_BINS) / count,
    )


def _mean_loop(values: FloatArray) -> FloatArray:
    """Return the means [2, bins] over the cycles of [2, cycles, bins] that have one; NaN where none has."""
    known = np.isfinite(values)
    count = known.sum(axis=1)
    return np.where(count > 0, np.where(known, values, 0.0).sum(axis=1) / np.maximum(count, 1), np.nan)


def _loop_width(x: FloatArray, y: FloatArray, calibration: Calibration) -> float:
    """Return the largest distance of two branches, as a smooth loop that is closed at its ends; NaN where unknown.

    The largest of many noisy distances would be lifted by the noise, most of all in a single cycle.

    `x`, `y`: [2, bins] elongation and signal of the branches. `calibration`: whose curve is subtracted, so that
    elongations of a bin may differ between the branches.
    """
    apart = np.diff(y - calibration.predict(x), axis=0)[0]
    known = np.isfinite(apart)
    if known.sum() < 2 * _LOOP_TERMS:
        return math.nan
    low, high = calibration.x_range
    half = 0.5 * (high - low)
    z = (x.mean(axis=0)[known] - low) / half - 1.0
    grid = np.linspace(-1.0, 1.0, 101)
    terms, shape = (np.vander(at, _LOOP_TERMS) * (1.0 - at**2)[:, None] for at in (z, grid))
    found = np.linalg.lstsq(terms, apart[known], rcond=None)[0]
    return float(np.abs(shape @ found).max())


def _off_branches(
    x: FloatArray, y: FloatArray, cycles: Sequence[Cycle], loop: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """Return the distance of every sample [n] from the mean of its own branch; NaN outside the bins.

    `x`, `y`: [n]. `loop`: elongation and signal of the mean branches, [2, bins].
    """
    off = np.full(x.size, np.nan)
    for b, (at, level) in enumerate(zip(*loop, strict=True)):
        known = np.isfinite(level)
        if known.sum() < 2:
            continue
        for cycle in cycles:
            rows = (cycle.unloading, cycle.loading)[b]
            off[rows] = y[rows] - np.interp(x[rows], at[known], level[known], np.nan, np.nan)
    return off


def _moving(off_mv: FloatArray, speed: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """Return speed and distance from the mean branch of the samples that move, of each direction with enough."""
    chosen = ((direction * speed > LEAST_SPEED) & np.isfinite(off_mv) for direction in (-1.0, 1.0))
    return [(speed[moving], off_mv[moving]) for moving in chosen if moving.sum() > FEWEST_MOVING]


def _dynamic(off_mv: FloatArray, speed: FloatArray) -> tuple[float, float]:
    """Return the slope of the distance from the mean branch over speed, and its standard uncertainty."""
    parts = [(v - v.mean(), off - off.mean()) for v, off in _moving(off_mv, speed)]
    if not parts:
        return math.nan, math.nan
    v, r = (np.concatenate(column) for column in zip(*parts, strict=True))
    lever = float(v @ v)
    if lever <= 0:
        return math.nan, math.nan
    slope = float(v @ r) / lever
    return slope, math.sqrt(SAMPLES_PER_FRAME * float(((r - slope * v) ** 2).mean()) / lever)


def _by_speed(off_mv: FloatArray, speed: FloatArray) -> FloatArray:
    """Return the mean distance from the mean branch in bins of speed: [n, 3] speed, mean, standard uncertainty."""
    rows = []
    for v, off in _moving(off_mv, speed):
        for part in np.array_split(np.argsort(v), SPEED_BINS):
            u = math.sqrt(SAMPLES_PER_FRAME * float(off[part].var(ddof=1)) / part.size)
            rows.append((float(v[part].mean()), float(off[part].mean()), u))
    return np.array(rows).reshape(-1, 3)
