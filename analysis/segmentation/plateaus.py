"""Plateaus of a staircase, from measured pressure.

An edge is where the means of two adjoining windows differ by more than noise and tolerance allow; a plateau is a
stretch between edges that stays within tolerance of its own median. Several window lengths are tried and the one that
explains most of the run is kept, so that fast and slow ramps, short and long holds need no setting. A plateau's value
is the mean of its settled part, its standard error corrected for autocorrelation; above a limit of lost and left-out
samples it is void. The sequencer's steps name a plateau and split a hold that two steps share; they never make one.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from analysis.data.recording import Recording
from analysis.segmentation.cycles import TOLERANCE_KPA, Cycles
from analysis.segmentation.losses import LossCounter, Losses
from analysis.statistics import mean, standard_error
from protocol.base.arrays import FloatArray, IntArray
from protocol.base.units import Quantity, UnitText

_SETTLING_S = 0.5
SETTLING_OF_HOLD = 0.3  # share of a hold that a proposed settling time takes at most
_SHORT_SETTLINGS_S = (0.01, 0.02, 0.05, 0.1, 0.2)  # proposed where holds are shorter
_MAX_DAMAGED = 0.20  # share of a window's samples that may be lost or left out
_MIN_SAMPLES = 5
NEAR_TARGET_KPA = 3.0  # a hold farther from a step's target is not that step's
_WINDOWS_S = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4)
NEAR_SHARE, MIN_NEAR = 0.05, 0.6  # of the span; share of a hold's rows that are so near its level
MIN_COVERED = 0.15  # share of the run in which a staircase holds its pressure
MIN_PASSED = 0.3  # share of its holds that lie between a lower and a higher one
MIN_DISTINCT = 0.6  # of the holds found must differ from pieces of a ramp
BY_NOISE = 4.0  # standard errors that noise may move the ends of a hold apart
MIN_LEVELS = 3  # fewer distinct levels are turning points of a continuous run


@dataclass(frozen=True, slots=True)
class PlateauSettings:
    """What counts as settled: within `tolerance_kpa` for `settling_s`; void above `max_damaged` lost or left out."""

    tolerance_kpa: float = TOLERANCE_KPA
    settling_s: float = _SETTLING_S
    max_damaged: float = _MAX_DAMAGED


@dataclass(frozen=True, slots=True)
class Plateau:
    """One hold. Values are of its settled part; per sensor where a tuple.

    `cycle` is 0 outside the complete cycles; `branch` is "unloading", "loading", "start" (the extreme that opens the
    first cycle) or "" outside; `void` is why the plateau carries no figure, or ""; `damaged` that of each sensor, whose
    values are then NaN and its count 0.
    """

    number: int
    cycle: int
    branch: str
    first: int
    settled_first: int
    last: int
    start_s: float
    end_s: float
    pressure_kpa: float
    pressure_se_kpa: float
    signal_mv: tuple[float, ...]
    signal_se_mv: tuple[float, ...]
    signal_sd_mv: tuple[float, ...]
    n: tuple[int, ...]
    lost: int
    left_out: int
    step: int | None = None
    void: str = ""
    damaged: tuple[str, ...] = ()
    losses: tuple[Losses, ...] = ()

    @property
    def place(self) -> str:
        """Where it is: pressure, branch, cycle; what is not known is left out."""
        pressure = UnitText(Quantity(self.pressure_kpa, "kPa", "+.0f")) if np.isfinite(self.pressure_kpa) else ""
        branch = {"start": "opening"}.get(self.branch, self.branch)
        cycle = f"cycle {self.cycle}" if self.cycle and self.branch != "start" else ""
        return UnitText(", ").joined(part for part in (pressure, branch, cycle) if part)


def find_plateaus(recording: Recording, cycles: Cycles, settings: PlateauSettings | None = None) -> tuple[Plateau, ...]:
    """Find the holds of a staircase; an empty tuple for a continuous run."""
    settings = settings or PlateauSettings()
    if recording.n < 20 or cycles.span_kpa <= 2 * settings.tolerance_kpa:
        return ()
    holds = _best_holds(recording, cycles, settings)
    if sum(last - first + 1 for first, last in holds) < MIN_COVERED * recording.n:
        return ()
    holds = [part for hold in holds for part in _split_at_breaks(hold, recording)]
    levels = [float(np.median(cycles.smooth_kpa[a : b + 1])) for a, b in holds]
    apart = 2 * settings.tolerance_kpa
    if _distinct(np.asarray(levels), apart) < MIN_LEVELS or _passed_through(levels, apart) < MIN_PASSED:
        return ()
    counters = tuple(LossCounter.of(recording, sensor) for sensor in range(recording.n_sensors))
    plateaus = [
        _measure(recording, settings, number, hold, level, cycles, counters)
        for number, (hold, level) in enumerate(zip(holds, levels, strict=True), 1)
    ]
    return _with_branches(_one_for_each_step(tuple(_with_step(p, recording) for p in plateaus)), cycles)


def plateau_table(plateaus: tuple[Plateau, ...]) -> pd.DataFrame:
    """Return the plateaus as a frame, one row each, sensors numbered from 1 in the column names."""
    rows: list[dict[str, Any]] = []
    for p in plateaus:
        row: dict[str, Any] = {
            "plateau": p.number, "cycle": p.cycle, "branch": p.branch, "start_s": p.start_s, "end_s": p.end_s,
            "pressure_kpa": p.pressure_kpa, "pressure_se_kpa": p.pressure_se_kpa, "lost": p.lost,
            "left_out": p.left_out, "step": p.step, "void": p.void,
        }  # fmt: skip
        for i, (y, se, sd, n) in enumerate(zip(p.signal_mv, p.signal_se_mv, p.signal_sd_mv, p.n, strict=True), 1):
            row |= {f"s{i}_mv": y, f"s{i}_se_mv": se, f"s{i}_sd_mv": sd, f"s{i}_n": n}
        rows.append(row)
    return pd.DataFrame(rows)


def shorter_settling_s(plateaus: tuple[Plateau, ...], settings: PlateauSettings) -> float:
    """Return a settling time that most holds are long enough for, s; 0 where they have it, or none would do."""
    held_s = [p.end_s - p.start_s for p in plateaus]
    short = [p for p in plateaus if p.void and max(p.n, default=0) < _MIN_SAMPLES and not p.lost and not p.left_out]
    if not held_s or 2 * len(short) <= len(plateaus):
        return 0.0
    fitting = [
        s for s in _SHORT_SETTLINGS_S if s <= SETTLING_OF_HOLD * float(np.median(held_s)) and s < settings.settling_s
    ]
    return max(fitting, default=0.0)


def _best_holds(recording: Recording, cycles: Cycles, settings: PlateauSettings) -> list[tuple[int, int]]:
    rows = np.arange(recording.n)
    good = recording.pressure_usable
    pressure = recording.pressure_kpa if good.all() else np.interp(rows, rows[good], recording.pressure_kpa[good])
    sums = np.concatenate([[0.0], np.cumsum(pressure - pressure.mean())])
    speed = _usual_speed(cycles, recording.n)
    found = []
    for seconds in _WINDOWS_S:
        window = max(3, round(seconds / recording.interval_s))
        if 4 * window > recording.n:
            break
        holds = _holds(sums, window, cycles.noise_kpa, settings.tolerance_kpa, recording.interval_s)
        holds = [hold for hold in holds if _is_still(hold, cycles, settings.tolerance_kpa)]
        distinct = [hold for hold in holds if _differs_from_a_ramp(hold, speed, cycles.noise_kpa)]
        # under noise a window too short finds pieces of ramps: it is not used
        found.append(distinct if len(distinct) >= MIN_DISTINCT * len(holds) else [])
    covered = [sum(last - first + 1 for first, last in holds) for holds in found]
    # a short window takes pieces of slow ramps into its holds, a long one cuts holds off: the count decides
    enough = [holds for holds, length in zip(found, covered, strict=True) if length >= 0.6 * max(covered)]
    return max(enough, key=len, default=[])


def _is_still(hold: tuple[int, int], cycles: Cycles, tolerance: float) -> bool:
    """True where the pressure itself is near its median: the means of a window as long as a cycle are constant too."""
    inside = cycles.smooth_kpa[hold[0] : hold[1] + 1]
    near = np.abs(inside - np.median(inside)) <= max(tolerance, NEAR_SHARE * cycles.span_kpa)
    return bool(near.mean() >= MIN_NEAR)


def _usual_speed(cycles: Cycles, n: int) -> float:
    """How fast the pressure goes from extreme to extreme, kPa a sample; over the run where it has no cycle."""
    rows = sum(c.last - c.first for c in cycles.complete)
    return 2.0 * cycles.span_kpa * len(cycles.complete) / rows if rows else cycles.span_kpa / n


def _differs_from_a_ramp(hold: tuple[int, int], speed: float, noise: float) -> bool:
    """True where a ramp at the run's usual speed would have shown over the noise: else a noisy ramp looks like this."""
    count = hold[1] - hold[0] + 1
    return count * speed > 2.0 * BY_NOISE * noise * float(np.sqrt(2.0 / max(count // 3, 1)))


def _holds(sums: FloatArray, window: int, noise: float, tolerance: float, interval_s: float) -> list[tuple[int, int]]:
    """Stretches between edges that stay within tolerance of their median, rows (first, last)."""
    n = sums.size - 1
    means = (sums[window:] - sums[:-window]) / window  # means[i] covers rows i..i+window-1
    step = means[window:] - means[: n - 2 * window + 1]  # step[i] compares both sides of row i+window
    noise_mean = noise / np.sqrt(window)
    flat = np.abs(step) < max(tolerance, 5.0 * np.sqrt(2.0) * noise_mean)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flat.view(np.int8), [0]])))
    found = []
    shortest = max(_MIN_SAMPLES, round(0.3 / interval_s))
    for first, last in zip(edges[::2] + window, edges[1::2] + window - 1, strict=True):
        # the windows reach over the edge at either end: inside them the hold continues
        first = 0 if first == window else first
        last = n - 1 if last == n - window else last
        if last - first + 1 < shortest:
            continue
        inside = means[first : max(last - window + 2, first + 1)]
        level = np.median(inside)
        within = np.abs(inside - level) <= tolerance + 3.5 * noise_mean
        if within.mean() >= 0.9 and not _ramps(inside, interval_s, noise, tolerance):
            found.append((int(first), int(last)))
    return found


def _ramps(means: FloatArray, interval_s: float, noise: float, tolerance: float) -> bool:
    """True where the hold is a piece of a ramp: it moves by more than its noise and the tolerance (a second) allow."""
    count = means.size
    if count < 6:
        return False
    third = count // 3
    moved = abs(float(means[-third:].mean() - means[:third].mean())) * count / (count - third)
    by_noise = BY_NOISE * noise * np.sqrt(2.0 / third)
    return bool(moved > tolerance * min(1.5, count * interval_s) + by_noise)


def _split_at_breaks(hold: tuple[int, int], recording: Recording) -> list[tuple[int, int]]:
    """Split a hold where a segment ends, and where two steps of the sequencer hold one level, one after the other."""
    first, last = hold
    cuts: list[int] = (first + 1 + np.flatnonzero(np.diff(recording.segment[first : last + 1]))).tolist()
    targets_kpa = recording.steps["target_kpa"].to_numpy(dtype=float)
    same_level = np.abs(np.diff(targets_kpa, prepend=np.nan)) <= 2 * TOLERANCE_KPA
    starts = np.searchsorted(recording.time_s, recording.steps["started_s"].to_numpy(dtype=float)[same_level])
    margin = max(_MIN_SAMPLES, round(_SETTLING_S / recording.interval_s))
    cuts += [int(s) for s in starts if first + margin < s < last - margin]
    edges = [first, *sorted(set(cuts)), last + 1]
    return [(a, b - 1) for a, b in itertools.pairwise(edges) if b - a >= _MIN_SAMPLES]


def _distinct(levels: FloatArray, apart: float) -> int:
    return 0 if not levels.size else 1 + int((np.diff(np.sort(levels)) > apart).sum())


def _passed_through(levels: list[float], apart: float) -> float:
    """Share of the holds that the pressure passed on its way up or down; the turns of a wave are none of these."""
    steps = np.diff(np.asarray(levels))
    steps = steps[np.abs(steps) > apart]
    return float((steps[1:] * steps[:-1] > 0).mean()) if steps.size > 1 else 0.0


def _measure(
    recording: Recording,
    settings: PlateauSettings,
    number: int,
    hold: tuple[int, int],
    level: float,
    cycles: Cycles,
    counters: tuple[LossCounter, ...],
) -> Plateau:
    first, last = hold
    near = np.abs(cycles.smooth_kpa[first : last + 1] - level) <= settings.tolerance_kpa + 0.5 * cycles.noise_kpa
    away = np.flatnonzero(~near[: near.size // 2])
    arrived = first + (int(away[-1]) + 1 if away.size else 0)
    settled = int(np.searchsorted(recording.time_s, recording.time_s[arrived] + settings.settling_s))
    if cycles.noise_kpa > settings.tolerance_kpa:
        last -= (last - first + 1) // 10  # under such noise the end of the hold is known no better
    else:
        last = _before_the_ramp(cycles.smooth_kpa[first : last + 1], settings.tolerance_kpa) + first
    rows = slice(min(settled, last + 1), last + 1)
    pressure = recording.pressure_kpa[rows][recording.pressure_usable[rows]]
    signals = [recording.signal_mv[rows, s][recording.usable[rows, s]] for s in range(recording.n_sensors)]
    losses = tuple(counter.of_windows([rows]) for counter in counters)
    damaged = tuple(_void_reason(s.size, loss, settings) for s, loss in zip(signals, losses, strict=True))
    signals = [np.empty(0) if reason else s for s, reason in zip(signals, damaged, strict=True)]
    lost = max((loss.lost + loss.crc_failed for loss in losses), default=0)
    left_out = max((loss.damaged for loss in losses), default=0) - lost
    return Plateau(
        number, 0, "", first, rows.start, last, float(recording.time_s[first]), float(recording.time_s[last]),
        mean(pressure), standard_error(pressure), tuple(mean(s) for s in signals),
        tuple(standard_error(s) for s in signals),
        tuple(float(s.std(ddof=1)) if s.size > 1 else float("nan") for s in signals),
        tuple(s.size for s in signals), lost, left_out, void=damaged[0] if all(damaged) else "", damaged=damaged,
        losses=losses,
    )  # fmt: skip


def _before_the_ramp(smooth_kpa: FloatArray, tolerance: float) -> int:
    """The last row of a hold that is not yet on its way to the next one."""
    count = smooth_kpa.size
    middle = smooth_kpa[count // 4 : max(3 * count // 4, count // 4 + 1)]
    near = np.abs(smooth_kpa - np.median(middle)) <= 0.25 * tolerance + 3.0 * float(middle.std())
    rows = np.flatnonzero(near)
    return int(rows[-1]) if rows.size else count - 1


def _void_reason(usable: int, losses: Losses, settings: PlateauSettings) -> str:
    if usable < _MIN_SAMPLES:
        return f"only {usable} usable samples after settling" if usable else "no usable samples after settling"
    return losses.void(settings.max_damaged)


def _with_step(plateau: Plateau, recording: Recording) -> Plateau:
    """Attach the sequencer's step that this hold overlaps most, among those that were to hold this pressure."""
    if recording.steps.empty:
        return plateau
    targets, starts, ends = (
        recording.steps[name].to_numpy(dtype=float) for name in ("target_kpa", "started_s", "ended_s")
    )
    ends = np.where(np.isfinite(ends), ends, recording.time_s[-1])
    overlap = np.minimum(plateau.end_s, ends) - np.maximum(plateau.start_s, starts)
    overlap[~(np.abs(targets - plateau.pressure_kpa) <= NEAR_TARGET_KPA)] = -np.inf
    at = int(np.argmax(overlap))
    # a step ends with its hold: of two that touch, the later one only ramps here
    return replace(plateau, step=int(recording.steps["id"].iloc[at])) if overlap[at] > 0 else plateau


def _one_for_each_step(plateaus: tuple[Plateau, ...]) -> tuple[Plateau, ...]:
    """Keep the longest stretch of each step: a step is held once, any other hold in it belongs to its ramp."""
    longest: dict[int, Plateau] = {}
    for p in plateaus:
        if p.step is not None and (p.step not in longest or max(p.n) > max(longest[p.step].n)):
            longest[p.step] = p
    kept = [p for p in plateaus if p.step is None or longest[p.step] is p]
    return tuple(replace(p, number=number) for number, p in enumerate(kept, 1))


def _with_branches(plateaus: tuple[Plateau, ...], cycles: Cycles) -> tuple[Plateau, ...]:
    """Name cycle and branch: an extreme ends the branch that leads to it; the very first opens cycle 1 as "start"."""
    named = list(plateaus)
    for cycle in cycles.complete:
        ways = ("unloading", "loading") if cycle.falls_first else ("loading", "unloading")
        for i, p in enumerate(named):
            if p.cycle or p.branch:
                continue
            if p.first <= cycle.first:
                if p.last >= cycle.first:
                    named[i] = replace(p, cycle=cycle.number, branch="start")
            elif p.first <= cycle.turn:
                named[i] = replace(p, cycle=cycle.number, branch=ways[0])
            elif p.first <= cycle.last:
                named[i] = replace(p, cycle=cycle.number, branch=ways[1])
    return tuple(named)


def branch_members(plateaus: tuple[Plateau, ...], cycle: int) -> tuple[IntArray, IntArray]:
    """Return the positions of the plateaus of a cycle's unloading and loading branch, each with both extremes."""
    inside = [i for i, p in enumerate(plateaus) if p.cycle == cycle]
    if not inside:
        empty = np.empty(0, dtype=np.int64)
        return empty, empty
    opening = [] if plateaus[inside[0]].branch == "start" or inside[0] == 0 else [inside[0] - 1]
    chain = [*opening, *inside]
    names = [plateaus[i].branch for i in inside]
    first_way = next((b for b in names if b in ("unloading", "loading")), "unloading")
    turn = max((k for k, i in enumerate(chain) if plateaus[i].branch == first_way), default=0)
    first, second = np.asarray(chain[: turn + 1]), np.asarray(chain[turn:])
    return (first, second) if first_way == "unloading" else (second, first)
