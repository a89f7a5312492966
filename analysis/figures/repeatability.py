"""The figures of one sensor cycle by cycle, and how many of the first cycles are warm-up.

A cycle is warm-up while the mean displacement of its levels from the second half of the run is beyond three robust
standard deviations of that half and beyond a share of full scale that matters, from the first cycle on without a break.
The warm-up is named, not removed.

A cycle's hysteresis is the largest of many differences, which noise lifts; that of the mean loop is not lifted so. By
how much follows from the scatter of the differences between the cycles.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.segmentation.loops import Loops, LoopWidth, branch_mean
from analysis.statistics import robust_sd
from protocol.base.arrays import FloatArray

WARM_UP_SIGMA = 3.0
WARM_UP_PERCENT = 0.1
"""Of full-scale output: a fiftieth of the published hysteresis, below what any reader of a report acts upon."""
LEAST_LATER = 2
"""Cycles in the second half: one has no scatter to compare with."""
DRAWS = 2_000
"""Of simulated cycles: their mean maximum is then known to a fortieth of its scatter."""


@dataclass(frozen=True, slots=True)
class FiguresByCycle:
    """Figures of one sensor cycle by cycle.

    Attributes
    ----------
    hysteresis_percent_fso, span_mv, snr_db : [cycles] hysteresis over pressure, output span, signal-to-noise ratio.
    displacement_percent_fso : [cycles] mean of the levels less their median over the second half of the run.
    level_displacement_percent_fso : [cycles, levels] each level, mean of both branches, less its mean over the cycles.
    branch_displacement_percent_fso : [2, cycles, levels] the same of each branch alone.
    hysteresis_lift_percent_fso : how much noise lifts the hysteresis of a cycle on average; NaN below two cycles.
    sensitivity, sensitivity_unit : [cycles] end to end, mV/mm, or mV/kPa where x was not read in every cycle.
    """

    numbers: tuple[int, ...]
    hysteresis_percent_fso: FloatArray
    span_mv: FloatArray
    snr_db: FloatArray
    displacement_percent_fso: FloatArray
    level_displacement_percent_fso: FloatArray
    branch_displacement_percent_fso: FloatArray
    sensitivity: FloatArray
    sensitivity_unit: str
    warm_up: int
    hysteresis_lift_percent_fso: float


def figures_by_cycle(
    loops: Loops, sensor: int, full_scale_mv: float, width: LoopWidth, noise: tuple[FloatArray, FloatArray, FloatArray]
) -> FiguresByCycle:
    """Return the figures of one sensor cycle by cycle.

    Parameters
    ----------
    loops, sensor : the used cycles, and the sensor, counted from 0.
    full_scale_mv : full-scale output; where it is zero or NaN what is relative to it is NaN.
    width : of the sensor's loops over pressure.
    noise : sums of squares, degrees of freedom and cycle, as `sensor_figures.staircase_noise` returns them.
    """
    levels = branch_mean(loops.signal_mv[sensor])
    whole = np.isfinite(levels).all(axis=0) if loops.n_cycles else np.zeros(0, bool)
    unknown = np.full(loops.n_cycles, np.nan)
    common = levels[:, whole].mean(axis=1) if whole.any() else unknown
    span = np.abs(levels[:, whole][:, -1] - levels[:, whole][:, 0]) if whole.sum() > 1 else unknown
    later = common[loops.n_cycles // 2 :]
    centre = float(np.median(later)) if later.size else float("nan")
    scale = 100.0 / full_scale_mv if full_scale_mv > 0 else float("nan")
    matters = WARM_UP_PERCENT / scale
    away = np.abs(common - centre) > max(WARM_UP_SIGMA * robust_sd(later), matters)
    warm_up = int(np.argmin(away)) if later.size >= LEAST_LATER and not away.all() else 0
    own = np.where(loops.own, loops.signal_mv[sensor], np.nan)
    sensitivity, unit = cycle_sensitivities(loops, sensor)
    return FiguresByCycle(
        loops.numbers, scale * width.per_cycle, span, _snr(loops.numbers, span, noise), scale * (common - centre),
        scale * _centred(branch_mean(own), 0), scale * _centred(own, 1), sensitivity, unit, warm_up,
        scale * lift_of_maximum(loops.signal_mv[sensor]),
    )  # fmt: skip


def lift_of_maximum(signal: FloatArray) -> float:
    """Return how much scatter lifts the widest distance of the branches of one cycle above that of the mean loop.

    The distances of simulated cycles have the mean and the sd of those of the cycles at each level.

    Parameters
    ----------
    signal : [2, cycles, levels] of a sensor on its branches.

    Returns
    -------
    In the unit of the signal; NaN below two cycles.
    """
    apart = signal[1] - signal[0]
    known = np.isfinite(apart).sum(axis=0) >= 2
    if not known.any():
        return float("nan")
    mean, sd = np.nanmean(apart[:, known], axis=0), np.nanstd(apart[:, known], axis=0, ddof=1)
    drawn = mean + sd * np.random.default_rng(0).standard_normal((DRAWS, mean.size))
    return float(np.abs(drawn).max(axis=1).mean() - np.abs(mean).max())


def cycle_sensitivities(loops: Loops, sensor: int) -> tuple[FloatArray, str]:
    """Return the end-to-end sensitivity of each cycle, [cycles], and its unit.

    Span of the signal between the outermost levels that every cycle has, over the span of the elongation there (mV/mm)
    where it was read in every cycle; else over that of the pressure (mV/kPa), as in a continuous run.
    """
    x, unit = loops.elongation_mm, "mV/mm"
    if x is None or not (np.isfinite(branch_mean(x)).sum(axis=1) > 1).all():
        x, unit = loops.pressure_kpa, "mV/kPa"
    abscissa, signal = branch_mean(x), branch_mean(loops.signal_mv[sensor])
    whole = np.flatnonzero((np.isfinite(abscissa) & np.isfinite(signal)).all(axis=0))
    if not loops.n_cycles or whole.size < 2:
        return np.full(loops.n_cycles, np.nan), unit
    first, last = whole[0], whole[-1]
    across = np.abs(abscissa[:, last] - abscissa[:, first])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(across > 0, np.abs(signal[:, last] - signal[:, first]) / across, np.nan), unit


def _centred(values: FloatArray, axis: int) -> FloatArray:
    """Return the values less their mean along an axis, NaN left out."""
    count = np.isfinite(values).sum(axis=axis, keepdims=True)
    with np.errstate(invalid="ignore"):
        mean = np.nansum(values, axis=axis, keepdims=True) / np.where(count, count, np.nan)
    return np.asarray(values - mean, dtype=np.float64)


def _snr(numbers: tuple[int, ...], span: FloatArray, noise: tuple[FloatArray, FloatArray, FloatArray]) -> FloatArray:
    squares, dof, of = noise
    found = np.full(len(numbers), np.nan)
    for k, number in enumerate(numbers):
        inside = of == number
        if dof[inside].sum() > 0 and squares[inside].sum() > 0 and span[k] > 0:
            found[k] = 20.0 * np.log10(span[k] / np.sqrt(squares[inside].sum() / dof[inside].sum()))
    return found
