"""Several runs: within-run and between-run spread kept apart (ISO 5725-2), units compared.

Strategy: for each pressure level and branch the cycles of every run are one-way groups. The repeatability variance
s_r^2 is the pooled variance within runs, the between-run variance s_L^2 = (MS_between - s_r^2) / n0 (floored at zero),
the reproducibility variance s_R^2 = s_r^2 + s_L^2; n0 allows for runs of unequal length (ISO 5725-2:2019, 7.4).

Rules: spread between runs is given for runs of one unit only; different units are compared figure by figure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.arrays import FloatArray
from analysis.errors import RequestError
from analysis.figures.pipeline import Analysis

SAME_LEVEL_KPA = 2.0


@dataclass(frozen=True, slots=True)
class Spread:
    """Spread of one quantity over runs: standard deviations, and how many runs and values they rest on."""

    repeatability: float
    between: float
    reproducibility: float
    runs: int
    n: int


@dataclass(frozen=True, slots=True)
class SensorSpread:
    """Spread of a sensor's levels, pooled over levels and branches, mV and % FSO of the first run."""

    name: str
    pooled: Spread
    level_kpa: FloatArray
    by_level: tuple[Spread, ...]
    full_scale_mv: float


def one_way(groups: Sequence[FloatArray]) -> Spread:
    """Separate within-group and between-group spread.

    Raises
    ------
    RequestError : fewer than two groups, or none with two values.
    """
    known = [g[np.isfinite(g)] for g in groups]
    known = [g for g in known if g.size]
    if len(known) < 2 or max(g.size for g in known) < 2:
        raise RequestError(
            "spread within and between runs takes two runs or more, with two cycles or more", "Record another run."
        )
    sizes = np.asarray([g.size for g in known], dtype=np.float64)
    total, count = float(sizes.sum()), len(known)
    within = sum(float(((g - g.mean()) ** 2).sum()) for g in known) / (total - count)
    grand = sum(float(g.sum()) for g in known) / total
    between = sum(g.size * float((g.mean() - grand) ** 2) for g in known) / (count - 1)
    n0 = (total - float((sizes**2).sum()) / total) / (count - 1)
    s_l2 = max((between - within) / n0, 0.0)
    return Spread(float(np.sqrt(within)), float(np.sqrt(s_l2)), float(np.sqrt(within + s_l2)), count, int(total))


def sensor_spread(analyses: Sequence[Analysis], sensor: int) -> SensorSpread:
    """Return the spread of one sensor's levels over runs of one unit.

    Raises
    ------
    RequestError : the runs share no pressure level, or are too few.
    """
    levels, spreads = [], []
    for pressure in analyses[0].loops.level_kpa:
        for branch in (0, 1):
            groups = [_level(a, sensor, branch, float(pressure)) for a in analyses]
            if sum(g.size > 0 for g in groups) >= 2 and max(g.size for g in groups) >= 2:
                levels.append(float(pressure))
                spreads.append(one_way(groups))
    if not spreads:
        raise RequestError("the runs share no pressure level with two cycles", "Compare runs of one plan.")
    pooled = Spread(
        _rms([s.repeatability for s in spreads]),
        _rms([s.between for s in spreads]),
        _rms([s.reproducibility for s in spreads]),
        len(analyses),
        sum(s.n for s in spreads),
    )
    fso = analyses[0].sensors[sensor].figures["fso_mv"].value
    return SensorSpread(analyses[0].sensors[sensor].name, pooled, np.asarray(levels), tuple(spreads), fso)


def between_runs_mm(analyses: Sequence[Analysis], sensor: int, x_mm: float) -> tuple[float, int]:
    """Return the sd between the calibrations of one unit, as elongation at `x_mm`, and its degrees of freedom.

    The variance over runs of y(x_mm) less what the uncertainty of each fit makes of it (floored at zero), through the
    mean slope. Spread of the signal at one pressure would hold the actuator's as well; this is the sensor's.

    Raises
    ------
    RequestError : fewer than two of the runs calibrate this sensor at `x_mm`.
    """
    found = [a.sensors[sensor].calibration for a in analyses if sensor < len(a.sensors)]
    fits = [c for c in found if c is not None and c.x_range[0] <= x_mm <= c.x_range[1]]
    if len(fits) < 2:
        raise RequestError(f"fewer than two runs are calibrated at {x_mm:+.2f} mm", "Record another calibration.")
    values = np.asarray([float(c.predict(x_mm)) for c in fits])
    by_fit = np.mean([float(c.curve_sd(x_mm)) ** 2 for c in fits])
    slope = float(np.mean([float(c.slope(x_mm)) for c in fits]))
    return float(np.sqrt(max(values.var(ddof=1) - by_fit, 0.0)) / abs(slope)), len(fits) - 1


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _level(analysis: Analysis, sensor: int, branch: int, pressure_kpa: float) -> FloatArray:
    loops = analysis.loops
    if not loops.level_kpa.size or sensor >= loops.signal_mv.shape[0]:
        return np.empty(0)
    at = int(np.argmin(np.abs(loops.level_kpa - pressure_kpa)))
    if abs(loops.level_kpa[at] - pressure_kpa) > SAME_LEVEL_KPA or not loops.own[branch, :, at].any():
        return np.empty(0)
    values = loops.signal_mv[sensor, branch, loops.own[branch, :, at], at]
    return np.asarray(values[np.isfinite(values)], dtype=np.float64)


def unit_of(analysis: Analysis) -> str:
    """Return the name of the unit of a run, "" where it is not known."""
    return str(analysis.recording.meta.get("unit") or "")
