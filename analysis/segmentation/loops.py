"""Loops: the two branches of every cycle on one set of pressure levels, [branch, cycle, level], NaN without a value.

A staircase gives its plateaus, a continuous run the means of its samples in equal bins of pressure. Branch 0 is
unloading, 1 is loading; levels ascend in pressure; branches are compared only where they overlap, interpolated between
their own points, never extrapolated. A damaged plateau or cycle leaves NaN, and a reason.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from analysis.data.recording import Recording
from analysis.segmentation.cycles import Cycles
from analysis.segmentation.losses import LossCounter
from analysis.segmentation.plateaus import Plateau, branch_members
from analysis.statistics import interpolate
from protocol.base.arrays import BoolArray, FloatArray

_BRANCHES = ("unloading", "loading")
_BINS, MIN_BINS = 45, 6
MIN_PER_BIN = 3
FEWEST_INSIDE = 2  # levels inside the range that a branch holds, or the only one; and a third of the other's
LIKE_SPEED = 5.0  # a branch passed so many times as fast as the other was vented, not driven
ENDS_SHARE = 0.1  # of the range: samples nearer to an end may be held there
MAX_DAMAGED_CYCLE = 0.05  # share of a continuous cycle's samples that may be lost or left out


@dataclass(frozen=True, slots=True)
class Loops:
    """Branches of the used cycles; `samples` of each bin are [sensors, 2, cycles, levels], empty for a staircase."""

    level_kpa: FloatArray  # [levels] nominal, ascending
    pressure_kpa: FloatArray  # [2, cycles, levels] measured
    elongation_mm: FloatArray | None  # [2, cycles, levels]; None if x was not read
    signal_mv: FloatArray  # [sensors, 2, cycles, levels]
    own: BoolArray  # [2, cycles, levels] False for an extreme that only opens the branch: counted once
    numbers: tuple[int, ...]
    void: tuple[str, ...]  # a sentence for every cycle or plateau that carries no figure
    ends_kpa: tuple[float, float]  # lowest and highest pressure that the cycles reach
    binned: bool  # the levels are bins of a continuous run
    one_branch: tuple[str, ...] = ()  # why a cycle has no loop, "" where it has one; empty if all have
    samples: FloatArray = field(default_factory=lambda: np.empty((0, 2, 0, 0)))

    @property
    def n_cycles(self) -> int:
        return len(self.numbers)

    def noise_share(self, sensor: int) -> FloatArray:
        """[2, levels] part of the variance of one sample that is in that of a value; zeros for a staircase."""
        if not self.samples.size:
            return np.zeros(self.own.shape[::2])
        count = np.where(self.own & (self.samples[sensor] > 0), self.samples[sensor], np.nan)
        known = np.isfinite(count)
        return np.asarray(np.nansum(1.0 / count, axis=1) / np.maximum(known.sum(axis=1), 1))


def staircase_loops(
    plateaus: tuple[Plateau, ...], cycles: Cycles, elongation_mm: FloatArray | None, n_sensors: int
) -> Loops:
    """Arrange the plateaus of the used cycles as loops; `elongation_mm` is [plateaus], None if x was not read."""
    inside = [p for p in plateaus if p.cycle or p.branch]
    levels, level_of = cluster_levels(np.asarray([p.pressure_kpa for p in plateaus]))
    numbers = tuple(cycle.number for cycle in cycles.used)
    shape = (2, len(numbers), levels.size)
    pressure, x = np.full(shape, np.nan), np.full(shape, np.nan)
    signal, own = np.full((n_sensors, *shape), np.nan), np.zeros(shape, dtype=bool)
    one_branch = []
    for k, number in enumerate(numbers):
        branches = branch_members(plateaus, number)
        one_branch.append(
            _not_held(*(len({*level_of[m]} - {*level_of[m[[0, -1]]]}) if m.size else 0 for m in branches))
        )
        for b, members in enumerate(branches):
            name = _BRANCHES[b]
            for i in members:
                p, g = plateaus[i], level_of[i]
                if p.void or g < 0:
                    continue
                pressure[b, k, g] = p.pressure_kpa
                signal[:, b, k, g] = p.signal_mv
                own[b, k, g] = p.cycle == number and p.branch == name
                if elongation_mm is not None:
                    x[b, k, g] = elongation_mm[i]
    ends = (float(levels[0]), float(levels[-1])) if levels.size else (float("nan"), float("nan"))
    void = tuple(
        f"plateau {p.number}{f' ({p.place})' if p.place else ''}{which}: {reason}"
        for p in inside
        for which, reason in ([("", p.void)] if p.void else [(f" of s{i}", r) for i, r in enumerate(p.damaged, 1)])
        if reason
    )
    x_or_none = None if elongation_mm is None else x
    return Loops(levels, pressure, x_or_none, signal, own, numbers, void, ends, False, tuple(one_branch))


def _not_held(unloading: int, loading: int) -> str:
    """Return which branch a cycle did not drive, from the number of levels inside the range that each held."""
    most, least = max(unloading, loading), min(unloading, loading)
    if not most:
        return "no branch was driven: no level inside the range was held"
    if least >= min(FEWEST_INSIDE, most) and 3 * least >= most:
        return ""
    which = _BRANCHES[loading > unloading]
    levels = "no level" if not least else f"{least} of {most} levels"
    held = f"{levels} inside the range {'was' if least < 2 else 'were'} held on the other"
    return f"only the {which} branch was driven: {held}"


def branch_not_passed(unloading: int, loading: int) -> str:
    """Return which branch a continuous cycle did not drive, from the number of samples of each inside the range."""
    most, least = max(unloading, loading), min(unloading, loading)
    if least >= MIN_BINS * MIN_PER_BIN and most <= LIKE_SPEED * least:
        return ""
    if most < MIN_BINS * MIN_PER_BIN:
        return f"no branch was driven: {most} samples are inside the range, {MIN_BINS * MIN_PER_BIN} show a branch"
    how = f"the other was passed in {least} samples, this one in {most}"
    return f"only the {_BRANCHES[loading > unloading]} branch was driven: {how}"


def continuous_loops(recording: Recording, cycles: Cycles) -> Loops:
    """Average the samples of every branch of the used cycles in equal bins of pressure, as many as they fill."""
    lengths = [min(c.turn - c.first, c.last - c.turn) for c in cycles.used]
    bins = int(np.clip(np.median(lengths) / (2 * MIN_PER_BIN), MIN_BINS, _BINS)) if lengths else _BINS
    counters = [LossCounter.of(recording, sensor) for sensor in range(recording.n_sensors)]
    used, void, whole = [], [], []
    for cycle in cycles.used:
        reasons = [counter.of_windows([cycle.rows]).void(MAX_DAMAGED_CYCLE) for counter in counters]
        if all(reasons):
            void.append(f"cycle {cycle.number}: {reasons[0]}")
            continue
        void += [f"cycle {cycle.number} of s{i}: {reason}" for i, reason in enumerate(reasons, 1) if reason]
        used.append(cycle)
        whole.append([not reason for reason in reasons])
    numbers = tuple(cycle.number for cycle in used)
    shape = (2, len(used), bins)
    if not used:
        empty = np.full(shape, np.nan)
        signal = np.full((recording.n_sensors, *shape), np.nan)
        nowhere = (float("nan"), float("nan"))
        return Loops(np.full(bins, np.nan), empty, None, signal, np.zeros(shape, bool), (), tuple(void), nowhere, True)
    smooth = cycles.smooth_kpa
    low = float(np.median([min(smooth[c.first], smooth[c.turn]) for c in used]))
    high = float(np.median([max(smooth[c.first], smooth[c.turn]) for c in used]))
    margin = ENDS_SHARE * (high - low)
    between = (smooth > low + margin) & (smooth < high - margin)
    one_branch = tuple(branch_not_passed(int(between[c.unloading].sum()), int(between[c.loading].sum())) for c in used)
    if any(one_branch):  # the middle of a turn lies on the slow branch, before its end
        low, high = (float(np.median([extreme(smooth[c.rows]) for c in used])) for extreme in (np.min, np.max))
    bin_of = np.floor((smooth - low) / (high - low) * bins).astype(np.int64)
    cell = np.full(recording.n, -1, dtype=np.int64)
    for k, cycle in enumerate(used):
        for b, rows in enumerate((cycle.unloading, cycle.loading)):
            inside = np.clip(bin_of[rows], 0, bins - 1)
            cell[rows] = (b * len(used) + k) * bins + inside
    pressure, _ = _bin_means(cell, smooth, recording.pressure_usable, shape)
    signal, samples = np.moveaxis(
        np.stack([_bin_means(cell, recording.signal_mv[:, s], recording.usable[:, s], shape)
                  for s in range(recording.n_sensors)]), 1, 0
    )  # fmt: skip
    signal[np.broadcast_to(~np.asarray(whole).T[:, None, :, None], signal.shape)] = np.nan
    pressure, signal = _at_common_pressure(pressure, signal)
    centres = low + (np.arange(bins) + 0.5) * (high - low) / bins
    own = np.isfinite(pressure)
    return Loops(centres, pressure, None, signal, own, numbers, tuple(void), (low, high), True, one_branch, samples)


def _at_common_pressure(pressure: FloatArray, signal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return bins of all cycles at their mean pressures, the signals moved along their branch.

    A sample more or less at the edge of a bin moves the bin's mean pressure, which is no scatter of the signal.
    """
    mean = _mean_over_cycles(pressure)
    away, moved = pressure - mean[:, None], signal.copy()
    for b in range(2):
        for sensor in range(signal.shape[0]):
            branch = _mean_over_cycles(signal[sensor])[b]
            known = np.isfinite(branch) & np.isfinite(mean[b])
            if known.sum() > 1:
                moved[sensor, b][:, known] -= np.gradient(branch[known], mean[b, known]) * away[b][:, known]
    return np.where(np.isfinite(pressure), mean[:, None], np.nan), moved


def _mean_over_cycles(values: FloatArray) -> FloatArray:
    """Mean over the cycles [2, cycles, levels] -> [2, levels], NaN left out."""
    known = np.isfinite(values)
    count = known.sum(axis=1)
    return np.asarray(np.where(known, values, 0.0).sum(axis=1) / np.where(count > 0, count, np.nan))


_APART_KPA = 2.0  # between two levels


def cluster_levels(pressure_kpa: FloatArray) -> tuple[FloatArray, npt.NDArray[np.int64]]:
    """Return the levels held, [levels] ascending medians, and the number of each plateau's level, -1 for NaN."""
    known = np.flatnonzero(np.isfinite(pressure_kpa))
    order = known[np.argsort(pressure_kpa[known], kind="stable")]
    level_of = np.full(pressure_kpa.size, -1, dtype=np.int64)
    if not order.size:
        return np.empty(0), level_of
    level_of[order] = np.concatenate([[0], np.cumsum(np.diff(pressure_kpa[order]) > _APART_KPA)])
    count = int(level_of.max()) + 1
    return np.asarray([np.median(pressure_kpa[level_of == g]) for g in range(count)]), level_of


@dataclass(frozen=True, slots=True)
class LoopWidth:
    """How far the branches of loops lie apart, in the unit of the ordinate; NaN and `void` if they do not overlap.

    `per_cycle` [cycles]; `mean_loop`, of the loop averaged over cycles; `replicates` of it over resampled cycles;
    `grid`, `unloading`, `loading` : the mean loop. `shared` : the part of the whole abscissa that all branches cover.
    """

    per_cycle: FloatArray
    mean_loop: float
    replicates: FloatArray
    grid: FloatArray
    unloading: FloatArray
    loading: FloatArray
    void: str = ""
    shared: float = 1.0
    one_branch: bool = False


def width_of_loops(loops: Loops, abscissa: FloatArray, ordinate: FloatArray, weights: FloatArray) -> LoopWidth:
    """Measure as `loop_width`, of the cycles that drove both branches; void, with the reason, where none did."""
    both = np.asarray([not why for why in loops.one_branch], dtype=bool)
    if both.all():
        return loop_width(abscissa, ordinate, weights)
    found = loop_width(np.where(both[None, :, None], abscissa, np.nan), ordinate, weights)
    return found if both.any() else replace(found, void=loops.one_branch[0], one_branch=True)


def loop_width(abscissa: FloatArray, ordinate: FloatArray, weights: FloatArray) -> LoopWidth:
    """Measure max |loading - unloading| over the abscissa that the branches share.

    `abscissa` and `ordinate` are [2, cycles, levels], `weights` [resamples, cycles]. Branches are piecewise linear
    between their points: on the union of all points the maximum is exact.
    """
    cycles = abscissa.shape[1]
    known = np.isfinite(abscissa) & np.isfinite(ordinate)
    grid = _shared_grid(abscissa, known)
    if grid.size < 2:
        nothing = np.full(0, np.nan)
        reason = "the two branches share no stretch of the abscissa"
        return LoopWidth(np.full(cycles, np.nan), float("nan"), nothing, grid, nothing, nothing, reason)
    curves = np.full((2, cycles, grid.size), np.nan)
    per_cycle = np.full(cycles, np.nan)
    for k in range(cycles):
        if (known[:, k].sum(axis=1) < 2).any():
            continue
        points = [(abscissa[b, k, known[b, k]], ordinate[b, k, known[b, k]]) for b in (0, 1)]
        own = np.unique(np.concatenate([points[0][0], points[1][0]]))
        apart = interpolate(own, *points[1]) - interpolate(own, *points[0])
        per_cycle[k] = np.nanmax(np.abs(apart)) if np.isfinite(apart).any() else np.nan
        for b in (0, 1):
            curves[b, k] = interpolate(grid, *points[b])
    whole = np.isfinite(curves).all(axis=(0, 2))
    if not whole.any():
        return LoopWidth(
            per_cycle, float("nan"), np.full(0, np.nan), grid, curves[0, 0], curves[1, 0], "no cycle has both branches"
        )
    apart = curves[1, whole] - curves[0, whole]
    chosen = weights[:, whole]
    with np.errstate(invalid="ignore", divide="ignore"):
        replicates = np.abs(chosen @ apart / chosen.sum(axis=1, keepdims=True)).max(axis=1)
    means = curves[:, whole].mean(axis=1)
    shared = float((grid[-1] - grid[0]) / np.ptp(abscissa[known]))
    most = float(np.abs(means[1] - means[0]).max())
    return LoopWidth(per_cycle, most, replicates, grid, means[0], means[1], shared=shared)


def _shared_grid(abscissa: FloatArray, known: BoolArray) -> FloatArray:
    """Points of all branches inside the stretch that every whole branch covers."""
    lows, highs = [], []
    for b in (0, 1):
        for k in range(abscissa.shape[1]):
            if known[b, k].sum() >= 2:
                lows.append(abscissa[b, k, known[b, k]].min())
                highs.append(abscissa[b, k, known[b, k]].max())
    if not lows or max(lows) >= min(highs):
        return np.empty(0)
    points = np.unique(np.append(abscissa[known], [max(lows), min(highs)]))
    points = points[(points >= max(lows)) & (points <= min(highs))]
    return points if points.size <= 2000 else np.linspace(points[0], points[-1], 2000)


def end_levels(loops: Loops, sensor: int, weights: FloatArray | None = None) -> tuple[FloatArray, FloatArray, float]:
    """Return the signal at the lowest and at the highest pressure, mV, of each row of cycle weights [rows, cycles].

    Means over branches and cycles. If `ends_kpa` lie beyond the outermost levels (half a bin, in a continuous run) the
    parabola through the three outermost levels is followed to them; the third value is the distance, mV, of the span
    from that by straight lines.
    """
    known = np.isfinite(loops.signal_mv[sensor]).any(axis=(0, 1)) if loops.n_cycles else np.zeros(0, bool)
    rows = 1 if weights is None else weights.shape[0]
    if known.sum() < 2:
        return np.full(rows, np.nan), np.full(rows, np.nan), float("nan")
    weights = np.ones((1, loops.n_cycles)) if weights is None else weights
    by_cycle, p_by_cycle = (
        branch_mean(a[:, :, known]) for a in (loops.signal_mv[sensor], loops.pressure_kpa)
    )  # [cycles, levels]
    signal, pressure = _weighted_mean(by_cycle, weights), _weighted_mean(p_by_cycle, weights)
    ends, bent = [], []
    for step, end in ((1, loops.ends_kpa[0]), (-1, loops.ends_kpa[1])):
        first = 0 if step > 0 else -1
        slope = (signal[:, first] - signal[:, first + step]) / (pressure[:, first] - pressure[:, first + step])
        beyond, bend = (end - pressure[:, first]) * loops.binned, np.zeros(rows)
        if loops.binned and known.sum() > 2:
            y, p = signal[:, first + 2 * step], pressure[:, first + 2 * step]
            steeper = slope - (signal[:, first + step] - y) / (pressure[:, first + step] - p)
            bend = steeper / (pressure[:, first] - p) * beyond * (end - pressure[:, first + step])
        ends.append(signal[:, first] + slope * beyond + bend)
        bent.append(float(np.mean(bend)))
    return ends[0], ends[1], abs(bent[0]) + abs(bent[1])


def branch_mean(values: FloatArray) -> FloatArray:
    """Mean over the two branches [2, cycles, levels] -> [cycles, levels]; NaN only where both are."""
    count = np.isfinite(values).sum(axis=0)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.nansum(values, axis=0) / np.where(count, count, np.nan), dtype=np.float64)


def _weighted_mean(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Mean over cycles [cycles, levels] with weights [rows, cycles], NaN left out -> [rows, levels]."""
    known = np.isfinite(values)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(weights @ np.where(known, values, 0.0) / (weights @ known), dtype=np.float64)


def _bin_means(
    cell: npt.NDArray[np.int64], values: FloatArray, usable: BoolArray, shape: tuple[int, int, int]
) -> tuple[FloatArray, FloatArray]:
    """Return mean and number of the usable values of each cell, [2, cycles, levels]; NaN of too few."""
    size = int(np.prod(shape))
    inside = (cell >= 0) & usable & np.isfinite(values)
    counts = np.bincount(cell[inside], minlength=size)
    sums = np.bincount(cell[inside], weights=values[inside], minlength=size)
    means = np.full(size, np.nan)
    enough = counts >= MIN_PER_BIN
    means[enough] = sums[enough] / counts[enough]
    return means.reshape(shape), counts.reshape(shape).astype(np.float64)
