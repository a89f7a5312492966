"""Figures of a sensor's loops: hysteresis, and full scale and non-linearity over pressure (ISA-S37.1).

A hysteresis that noise or the reading can make by itself is marked as an upper bound. A full scale has the unit of the
loop's width; `weights` are [resamples, cycles] of the bootstrap.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.calibration.fit import Calibration
from analysis.calibration.joint_fit import LoopEstimate
from analysis.figures.figure import Figure, Reason
from analysis.figures.intervals import bootstrap_figure, no_full_scale, with_reach
from analysis.numbers import percent
from analysis.segmentation.cycles import Cycles
from analysis.segmentation.loops import Loops, LoopWidth, branch_mean, end_levels, width_of_loops
from analysis.segmentation.plateaus import Plateau
from analysis.statistics import bound_between
from protocol.base.arrays import FloatArray

LEAST_SHARED = 0.85  # of the abscissa: below it a wider loop may be missed
BOUND_SHARE = 0.25  # of a hysteresis: what else may make so much of it turns it into an upper bound


def joint_hysteresis(
    estimate: LoopEstimate, width: LoopWidth, full_scale_value: float, n: int, over: str = "x"
) -> Figure:
    """Hysteresis, % of full scale, of the loop of a joint fit."""
    definition = f"max over {over} of |loading - unloading| / FSO, loop of the joint fit, less its variance"
    plain = hysteresis(width, full_scale_value, n, definition)
    if plain.void or not full_scale_value > 0:
        return plain
    scale = 100.0 / full_scale_value
    value, low, high = (scale * v for v in (estimate.width, estimate.low, estimate.high))
    low = max(value - np.hypot(value - low, max(value - scale * estimate.at_levels, 0.0)), 0.0) if low > 0.0 else 0.0
    high += max(scale * estimate.between - value, 0.0)
    keep = plain.reason is Reason.PART_OF_RANGE
    return replace(
        plain, value=value, low=low, high=high, note=plain.note if keep else "",
        reason=plain.reason if keep else Reason.NONE,
    )  # fmt: skip


def with_what_lies_between(
    figure: Figure, level_kpa: FloatArray, branches: FloatArray, full_scale_value: float, floor: float = 0.0
) -> Figure:
    """Return a hysteresis over pressure, % of full scale, whose interval holds what a loop may do between levels.

    `branches` are [2, cycles, levels]; `floor`, % of full scale, what else than a loop sets them apart by.
    """
    if not np.isfinite([figure.value, figure.high]).all() or not full_scale_value > 0:
        return figure
    both = np.isfinite(branches).all(axis=0, keepdims=True) & np.isfinite(branches)
    count = both.sum(axis=1)
    means = np.where(both, branches, 0.0).sum(axis=1) / np.where(count > 0, count, np.nan)
    more = 100.0 / full_scale_value * bound_between(level_kpa, means[1] - means[0]) - floor - figure.value
    return replace(figure, high=float(figure.high + max(more, 0.0)))


def sensor_loop_width(loops: Loops, sensor: int, calibration: Calibration | None, weights: FloatArray) -> LoopWidth:
    """Measure the loop of a sensor's signal over elongation, mV.

    The actuator's loop sets the branches' points apart, and a chord between two points is off a curved sensor by y''
    d^2 / 8. Therefore the calibration is subtracted first: the curve is common to both branches and drops out of their
    difference. Without a calibration the points themselves are interpolated.
    """
    assert loops.elongation_mm is not None
    x, signal = loops.elongation_mm, loops.signal_mv[sensor].copy()
    if calibration is not None:
        known = np.isfinite(x)
        signal[known] -= calibration.predict(x[known])
    return width_of_loops(loops, x, signal, weights)


def hysteresis(width: LoopWidth, full_scale_value: float, n: int, definition: str) -> Figure:
    """Hysteresis, % of full scale, of the loop averaged over cycles."""
    if width.void:
        reason = Reason.ONE_BRANCH if width.one_branch else Reason.NO_OVERLAP
        return Figure.nothing("% FSO", reason, width.void, definition)
    if not full_scale_value > 0:
        return no_full_scale("% FSO", definition)
    scale = 100.0 / full_scale_value
    figure = bootstrap_figure(scale * width.mean_loop, scale * width.replicates, "% FSO", n, definition)
    if width.shared < LEAST_SHARED:
        note = f"the branches share only {percent(width.shared)} of the range: a wider loop elsewhere is not seen"
        figure = replace(figure, note=note, reason=Reason.PART_OF_RANGE)
    return figure


def loop_made_by_noise(
    plateaus: tuple[Plateau, ...], loops: Loops, cycles: Cycles, sensor: int, noise_mv: float
) -> float:
    """Width, mV, that noise alone gives the mean loop: the greatest of many differences that are zero in truth.

    sd sqrt(2 ln 2m) for m levels, sd that of the difference of two branch means; 0 where it is not known.
    """
    if not loops.n_cycles or not np.isfinite(noise_mv):
        return 0.0
    if plateaus:
        errors = np.asarray([p.signal_se_mv[sensor] for p in plateaus if p.branch and not p.void])
        error = float(np.median(errors)) if errors.size and np.isfinite(errors).all() else 0.0
    else:
        samples = sum(c.last - c.first for c in cycles.used) / len(cycles.used)
        error = noise_mv / np.sqrt(max(samples / (2 * loops.level_kpa.size), 1.0))
    levels = max(loops.level_kpa.size, 2)
    return float(error * np.sqrt(2.0 / loops.n_cycles) * np.sqrt(2.0 * np.log(2.0 * levels)))


def limited(figure: Figure, floor: float, by: str, share: float = BOUND_SHARE) -> Figure:
    """Mark a hysteresis as an upper bound if a cause `by` other than a loop makes a share of it, `floor` in its unit.

    It lifts the maximum: the interval reaches down to the figure less the floor.
    """
    figure = replace(figure, low=float(np.minimum(figure.low, np.maximum(figure.value - floor, 0.0))))
    if not floor > share * figure.value:
        return figure
    part = f"about {floor:.2g} {figure.unit}" if floor < figure.value else "all"
    note = f"only an upper bound: {by} alone accounts for up to {part} of it"
    return replace(figure, note=f"{note}; {figure.note}" if figure.note else note, reason=Reason.UPPER_BOUND)


def pressure_full_scale(loops: Loops, sensor: int, weights: FloatArray) -> Figure:
    """Full-scale output, mV, of a run without x: between the extreme pressures."""
    (low,), (high,), bent = end_levels(loops, sensor)
    if not np.isfinite(high - low):
        return Figure.nothing("mV", Reason.NO_CYCLE, "no complete cycle")
    lows, highs, _ = end_levels(loops, sensor, weights)
    definition = "|y(p_max) - y(p_min)|, means over cycles"
    found = bootstrap_figure(float(abs(high - low)), np.abs(highs - lows), "mV", loops.n_cycles, definition)
    return with_reach(found, bent)


def pressure_nonlinearity(loops: Loops, sensor: int, full_scale_value: float, weights: FloatArray) -> Figure:
    """Non-linearity against pressure, for runs without x: the middle of the mean loop and its straight line."""
    definition = "max |middle of the mean loop - line| / FSO against pressure"
    middle = branch_mean(loops.signal_mv[sensor])
    known = np.isfinite(middle).all(axis=0) & (loops.n_cycles > 0)
    if known.sum() < 3 or not full_scale_value > 0:
        return Figure.nothing("% FSO", Reason.NO_CYCLE, "no complete cycle, or no span", definition)
    p = loops.level_kpa[known]
    rows = np.vander(p, 2)
    hat = rows @ np.linalg.pinv(rows)
    curves = np.vstack([middle[:, known].mean(axis=0), weights @ middle[:, known] / weights.sum(axis=1, keepdims=True)])
    apart = 100.0 / full_scale_value * np.abs(curves - curves @ hat.T).max(axis=1)
    return bootstrap_figure(float(apart[0]), apart[1:], "% FSO", loops.n_cycles, definition)
