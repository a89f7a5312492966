"""Figures over the cycles of a run: repeatability (ISO 5725), drift (Theil-Sen), each cycle's own, and warm-up.

Warm-up are the first cycles, without a break, whose mean displacement from the second half of the run, and from the
drift of that half continued, is beyond three robust standard deviations of it and beyond a share of full scale that
matters. It is named, not removed. Noise
lifts the hysteresis of one cycle, the largest of many differences, more than that of the mean loop; the lift follows
from the scatter of the differences between the cycles. `weights` are [resamples, cycles] of the bootstrap.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from analysis.figures.figure import Figure, Reason
from analysis.figures.intervals import bootstrap_figure, no_full_scale
from analysis.segmentation.cycle_effect import CycleEffect
from analysis.segmentation.loops import Loops, LoopWidth, branch_mean
from analysis.segmentation.serial_correlation import Dependence
from analysis.statistics import robust_sd, theil_sen
from protocol.base.arrays import FloatArray

WARM_UP_SIGMA = 3.0
WARM_UP_PERCENT = 0.1
"""Of full-scale output: a fiftieth of the published hysteresis, below what any reader of a report acts upon."""
LEAST_LATER = 2  # cycles in the second half: one has no scatter to compare with
_LEAST_FOR_TREND = 3
_SHOW_DEPENDENCE = 30  # cycles: of fewer a random walk is often not noticed
_DRAWS = 2_000  # of simulated cycles: their mean maximum is then known to a fortieth of its scatter
POOLED = "pooled sd over cycles of all levels / FSO"
WORST = "largest sd over cycles of a level / FSO"


def repeatability(
    loops: Loops, sensor: int, full_scale_value: float, weights: FloatArray, noise_mv: float = 0.0
) -> dict[str, Figure]:
    """ISO 5725 repeatability sd over cycles at each pressure and branch, % FSO: pooled and worst; full scale in mV.

    The noise of the mean of a bin, which depends on the rate of a continuous run, is taken out.
    """
    names = ("repeatability_percent_fso", "repeatability_worst_percent_fso")
    values = np.where(loops.own, loops.signal_mv[sensor], np.nan)
    counts = np.isfinite(values).sum(axis=1)
    enough = counts >= 2
    if loops.n_cycles < 2 or not enough.any():
        return {name: Figure.nothing("% FSO", Reason.FEW_CYCLES, "fewer than two complete cycles") for name in names}
    if not full_scale_value > 0:
        return {name: no_full_scale("% FSO") for name in names}
    series = values.transpose(1, 0, 2)[:, enough]  # [cycles, level and branch]
    scale = 100.0 / full_scale_value
    pooled, worst = _pooled_and_worst(series, np.ones((1, loops.n_cycles)))
    n = loops.n_cycles
    # a resample's variance is (n - 1) / n of the sample's on average: without this the interval would sit too low
    pooled_b, worst_b = (np.sqrt(n / (n - 1.0)) * part for part in _pooled_and_worst(series, weights))
    figure = bootstrap_figure(scale * pooled[0], scale * pooled_b, "% FSO", n, POOLED)
    effect = CycleEffect.of(loops, sensor)
    if figure.value > 0.0:  # resamples of few cycles scatter less than the sd does; of three, many have one cycle
        low, high = (scale * end for end in effect.interval(float(pooled[0])))
        least, most = (np.fmin, np.fmax) if n > 2 else (np.minimum, np.maximum)  # two have one degree of freedom
        figure = replace(figure, low=float(least(figure.low, low)), high=float(most(figure.high, high)))
    of_worst = bootstrap_figure(scale * worst[0], scale * worst_b, "% FSO", n, WORST)
    by_noise = (scale * noise_mv) ** 2 * loops.noise_share(sensor)[enough] if noise_mv > 0 else np.zeros(enough.sum())
    at = int(np.argmax(np.nanvar(series, axis=0)))
    figure, of_worst = _without_noise(figure, float(by_noise.mean())), _without_noise(of_worst, float(by_noise[at]))
    if by_noise.any():  # the greatest of many spreads that noise alone makes
        of_worst = replace(of_worst, low=min(of_worst.low, figure.low))
    return {names[0]: _noted(figure, effect.dependence), names[1]: of_worst}


def _without_noise(figure: Figure, variance: float) -> Figure:
    """Return a spread without a known variance, in its unit."""
    if not variance > 0.0:
        return figure
    value, low, high = (float(np.sqrt(max(v**2 - variance, 0.0))) for v in (figure.value, figure.low, figure.high))
    return replace(figure, value=value, low=low, high=high)


def drift(loops: Loops, sensor: int, full_scale_value: float) -> Figure:
    """Drift, % FSO per 100 cycles: Theil-Sen slope of the mean displacement of all levels; full scale in mV."""
    definition, unit = "Theil-Sen slope over cycles of the mean displacement of all levels", "% FSO/100 cycles"
    if loops.n_cycles < 3:
        return Figure.nothing(unit, Reason.FEW_CYCLES, "fewer than three complete cycles", definition)
    if not full_scale_value > 0:
        return no_full_scale(unit, definition)
    common = cycle_means(loops, sensor)
    if not common.size:
        return Figure.nothing(unit, Reason.NO_COMMON_LEVEL, "no level is known in every cycle", definition)
    number, scale = np.asarray(loops.numbers, dtype=np.float64), 100.0 * 100.0 / full_scale_value
    slope, low, high = (scale * v for v in theil_sen(number, common))
    dependence = _about_a_line(loops, sensor, common)
    low, high = slope - dependence.slope_widening * (slope - low), slope + dependence.slope_widening * (high - slope)
    return _noted(Figure(slope, unit, loops.n_cycles, low, high, definition=definition), dependence)


def _about_a_line(loops: Loops, sensor: int, means: FloatArray) -> Dependence:
    noticed = CycleEffect.of(loops, sensor).dependence
    return replace(noticed, columns=2) if noticed.noticed else Dependence.of(means, 2)


def _noted(figure: Figure, dependence: Dependence) -> Figure:
    """Return the figure with the note that its cycles depend on one another, or the assumption that they do not."""
    if dependence.noticed:
        note = f"cycles depend on one another (correlation up to {dependence.rho:g}): the interval allows for it"
        return replace(figure, note=note, reason=Reason.DEPENDENT)
    if figure.n >= _SHOW_DEPENDENCE:
        return figure
    return replace(figure, definition=f"{figure.definition}; {figure.n} cycles are assumed to be independent")


@dataclass(frozen=True, slots=True)
class Trend:
    """A drift of the signal in time: slope, mV/s, and half its 95 % interval; zeros where it is not significant."""

    slope: float = 0.0
    reach: float = 0.0

    @classmethod
    def of(cls, loops: Loops, sensor: int, time_s: FloatArray) -> Trend:
        """Fit the means of the cycles, at times [cycles]; Student's t, widened if cycles depend on one another."""
        means = cycle_means(loops, sensor)
        if means.size < _LEAST_FOR_TREND or not np.ptp(time_s) > 0:
            return cls()
        away = time_s - time_s.mean()
        spread = float(away @ away)
        slope = float(away @ means) / spread
        left = means - means.mean() - slope * away
        dof = means.size - 2
        se = float(np.sqrt(left @ left / dof / spread))
        reach = float(stats.t.ppf(0.975, dof)) * se * _about_a_line(loops, sensor, means).slope_widening
        return cls(slope, reach) if abs(slope) > reach else cls()


def cycle_means(loops: Loops, sensor: int) -> FloatArray:
    """Return the mean signal of each cycle over the places that all cycles have, [cycles] mV; empty without any."""
    values = np.where(loops.own, loops.signal_mv[sensor], np.nan)
    whole = np.isfinite(values).all(axis=1)
    common: FloatArray = values.transpose(1, 0, 2)[:, whole].mean(axis=1) if whole.any() else np.empty(0)
    return common


def _pooled_and_worst(series: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pooled and largest sd over cycles, for every row of weights; NaN in `series` [cycles, levels] is left out."""
    known = np.isfinite(series)
    filled = np.where(known, series - np.nanmean(series, axis=0), 0.0)
    count = weights @ known
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = weights @ filled / count
        squares = weights @ filled**2 - count * mean**2
        distinct = (weights > 0).astype(float) @ known
        dof = np.where(distinct >= 2, count - 1, np.nan)
        variance = np.maximum(squares, 0.0) / dof
        pooled = np.sqrt(np.nansum(variance * dof, axis=1) / np.nansum(dof, axis=1))
    return pooled, np.sqrt(np.nanmax(np.where(np.isfinite(variance), variance, 0.0), axis=1))


@dataclass(frozen=True, slots=True)
class FiguresByCycle:
    """Figures of one sensor cycle by cycle."""

    numbers: tuple[int, ...]
    hysteresis_percent_fso: FloatArray  # [cycles] over pressure
    span_mv: FloatArray  # [cycles]
    snr_db: FloatArray  # [cycles]
    displacement_percent_fso: FloatArray  # [cycles] levels' mean less its median over the run's second half
    level_displacement_percent_fso: FloatArray  # [cycles, levels] less its mean over the cycles
    branch_displacement_percent_fso: FloatArray  # [2, cycles, levels] the same of a branch
    sensitivity: FloatArray  # [cycles] end to end, mV/mm, or mV/kPa if x was not read in every cycle
    sensitivity_unit: str
    warm_up: int
    hysteresis_lift_percent_fso: float  # mean lift of the hysteresis of a cycle by noise; NaN below two cycles


def figures_by_cycle(
    loops: Loops, sensor: int, full_scale_mv: float, width: LoopWidth, noise: tuple[FloatArray, FloatArray, FloatArray]
) -> FiguresByCycle:
    """Return the figures of one sensor cycle by cycle; those relative to a full scale of zero or NaN are NaN.

    `noise`: sums of squares, degrees of freedom and cycle, as `noise_figures.staircase_noise` returns them.
    """
    levels = branch_mean(loops.signal_mv[sensor])
    whole = np.isfinite(levels).all(axis=0) if loops.n_cycles else np.zeros(0, bool)
    unknown = np.full(loops.n_cycles, np.nan)
    common = levels[:, whole].mean(axis=1) if whole.any() else unknown
    span = np.abs(levels[:, whole][:, -1] - levels[:, whole][:, 0]) if whole.sum() > 1 else unknown
    later = common[loops.n_cycles // 2 :]
    centre = float(np.median(later)) if later.size else float("nan")
    scale = 100.0 / full_scale_mv if full_scale_mv > 0 else float("nan")
    warm_up = _warm_up(common, np.asarray(loops.numbers, dtype=np.float64), WARM_UP_PERCENT / scale)
    own = np.where(loops.own, loops.signal_mv[sensor], np.nan)
    sensitivity, unit = cycle_sensitivities(loops, sensor)
    return FiguresByCycle(
        loops.numbers, scale * width.per_cycle, span, _snr(loops.numbers, span, noise), scale * (common - centre),
        scale * _centred(branch_mean(own), 0), scale * _centred(own, 1), sensitivity, unit, warm_up,
        scale * lift_of_maximum(loops.signal_mv[sensor]),
    )  # fmt: skip


def _warm_up(means: FloatArray, numbers: FloatArray, least: float) -> int:
    """Return how many first cycles are warm-up; `least` is the displacement that matters, in the unit of the means."""
    half = means.size // 2
    later = means[half:]
    if later.size < LEAST_LATER or not np.isfinite(means).all():
        return 0
    slope = np.nan_to_num(theil_sen(numbers[half:], later)[0])
    away = means - np.median(later)
    beyond_drift = away - slope * (numbers - np.median(numbers[half:]))
    outside = np.minimum(np.abs(away), np.abs(beyond_drift)) > max(WARM_UP_SIGMA * robust_sd(later), least)
    return int(np.argmin(outside))


def lift_of_maximum(signal: FloatArray) -> float:
    """Return how much scatter lifts the widest distance of the branches of one cycle above that of the mean loop.

    `signal` is [2, cycles, levels]; NaN below two cycles. The distances of simulated cycles have the mean and the sd of
    those of the cycles at each level.
    """
    apart = signal[1] - signal[0]
    known = np.isfinite(apart).sum(axis=0) >= 2
    if not known.any():
        return float("nan")
    mean, sd = np.nanmean(apart[:, known], axis=0), np.nanstd(apart[:, known], axis=0, ddof=1)
    drawn = mean + sd * np.random.default_rng(0).standard_normal((_DRAWS, mean.size))
    return float(np.abs(drawn).max(axis=1).mean() - np.abs(mean).max())


def cycle_sensitivities(loops: Loops, sensor: int) -> tuple[FloatArray, str]:
    """Return the end-to-end sensitivity of each cycle, [cycles], and its unit.

    Span of the signal between the outermost levels that every cycle has, over the span of the elongation there (mV/mm)
    if it was read in every cycle; else over that of the pressure (mV/kPa), as in a continuous run.
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
    """Return the values less their mean along an axis, NaN left out; NaN where there is one value or none."""
    count = np.isfinite(values).sum(axis=axis, keepdims=True)
    with np.errstate(invalid="ignore"):
        mean = np.nansum(values, axis=axis, keepdims=True) / np.where(count > 1, count, np.nan)
    return np.asarray(values - mean, dtype=np.float64)


def _snr(numbers: tuple[int, ...], span: FloatArray, noise: tuple[FloatArray, FloatArray, FloatArray]) -> FloatArray:
    squares, dof, of = noise
    found = np.full(len(numbers), np.nan)
    for k, number in enumerate(numbers):
        inside = of == number
        if dof[inside].sum() > 0 and squares[inside].sum() > 0 and span[k] > 0:
            found[k] = 20.0 * np.log10(span[k] / np.sqrt(squares[inside].sum() / dof[inside].sum()))
    return found
