"""Cycles from measured pressure.

The pressure is freed of spikes, drop-outs and noise; a reversal of at least half of its span, taken from robust
extremes, is an extreme, so that amplitudes may grow or shrink. A cycle runs from the extreme that the run starts with,
through the other, back. An incomplete first or last cycle and one across a segment boundary are named and left out;
smaller excursions are listed. The sequencer's marks are compared, and used only for a run that ended before its second
branch. Nothing here looks at a signal.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from scipy import ndimage

from analysis.compiled import compiled
from analysis.data.recording import Recording
from analysis.statistics import white_noise_sd
from protocol.base.arrays import BoolArray, FloatArray

TOLERANCE_KPA = 1.0  # a pressure that stays within it of one level is held
SWING_SHARE = 0.5  # a reversal of at least this share of the span is an extreme
_LOW = 0.25  # what is this far from an extreme has left it
EXTREME_SHARE = 0.02  # rows this near to an extreme belong to it
TRUNCATED_SHARE = 0.10  # an end extreme this much short of its neighbour was cut off
_VENTED_KPA = 3.0  # a run that begins or ends this near to zero (or 5 % of its span) was vented there, not cut off
LEAD = 0.4  # of the branches' time a kPa: the way from or to the vented state is a ramp, a branch has holds
EXCURSION_SHARE = 0.10  # smaller reversals are not listed
DROP_OUT_SHARE, _MAX_DROP_OUT = 0.25, 50  # of the span in one sample, and back within so many
MAX_DROPPED_SHARE = 0.05
MAX_WINDOW = 401  # samples of the noise filter


@dataclass(frozen=True, slots=True)
class Cycle:
    """One complete cycle: rows `first`..`last`, the other extreme at row `turn`; `falls_first` from high pressure."""

    number: int
    first: int
    turn: int
    last: int
    falls_first: bool
    lost: int = 0
    left_out: str = ""

    @property
    def unloading(self) -> slice:
        """Rows of the branch on which pressure falls."""
        return slice(self.first, self.turn + 1) if self.falls_first else slice(self.turn, self.last + 1)

    @property
    def loading(self) -> slice:
        """Rows of the branch on which pressure rises."""
        return slice(self.turn, self.last + 1) if self.falls_first else slice(self.first, self.turn + 1)

    @property
    def rows(self) -> slice:
        return slice(self.first, self.last + 1)


@dataclass(frozen=True, slots=True)
class Excursion:
    """A stretch that is no complete cycle: rows, pressures it ran between, and why it is left out."""

    first: int
    last: int
    low_kpa: float
    high_kpa: float
    reason: str


@dataclass(frozen=True, slots=True)
class Cycles:
    """The cycles found in the pressure; some of `complete` are left out for a stated reason (`left_out`).

    `excursions` are reversals too small to be a cycle; `smooth_kpa` [n] is the pressure used, `noise_kpa` the sd of
    what was removed; `void` says why nothing was driven, or "".
    """

    complete: tuple[Cycle, ...]
    partial: tuple[Excursion, ...]
    excursions: tuple[Excursion, ...]
    smooth_kpa: FloatArray
    noise_kpa: float
    span_kpa: float
    void: str = ""

    @property
    def used(self) -> tuple[Cycle, ...]:
        return tuple(cycle for cycle in self.complete if not cycle.left_out)

    def as_json(self) -> dict[str, int]:
        """Return the counts that `analyze --json` reports."""
        return {
            "complete": len(self.used),
            "partial": len(self.partial) + len(self.complete) - len(self.used),
            "with_gap": sum(cycle.lost > 0 for cycle in self.complete),
        }


def smooth_pressure(pressure_kpa: FloatArray, usable: BoolArray) -> tuple[FloatArray, float]:
    """Return the pressure [n] without faults, spikes and noise above 1 % of the span, and the sd of that noise."""
    rows = np.arange(pressure_kpa.size)
    good = np.asarray(usable, dtype=bool)
    if not good.any():
        return np.zeros_like(pressure_kpa), 0.0
    whole = _bridged(pressure_kpa, good)
    noise = white_noise_sd(whole)
    middle = ndimage.median_filter(whole, 5, mode="nearest")
    span = float(np.ptp(np.percentile(middle, [0.5, 99.5])))
    dropped = _drop_outs(whole, max(DROP_OUT_SHARE * span, 8.0 * noise))
    if dropped.any():
        whole = np.interp(rows, rows[~dropped], whole[~dropped])
        middle = ndimage.median_filter(whole, 5, mode="nearest")
    # only spikes are replaced (Hampel): a plain median would round off the turns of a fast cycle
    quiet = np.where(np.abs(whole - middle) > max(6.0 * noise, 0.03 * span), middle, whole)
    window = 1 if span <= 0 else int(np.ceil((noise / (0.01 * span)) ** 2))
    window = min(window | 1, MAX_WINDOW, max(1, (whole.size // 20) | 1))
    return (ndimage.uniform_filter1d(quiet, window, mode="nearest") if window > 1 else quiet), noise


def pressure_drop_outs(pressure_kpa: FloatArray, usable: BoolArray) -> BoolArray:
    """Rows [n] at which the pressure had dropped out, as `smooth_pressure` takes them out."""
    good = np.asarray(usable, dtype=bool)
    if not good.any():
        return np.zeros_like(good)
    whole = _bridged(pressure_kpa, good)
    found = _drop_outs(whole, _jump(whole))
    found &= good
    return found


def _bridged(pressure_kpa: FloatArray, good: BoolArray) -> FloatArray:
    rows = np.arange(pressure_kpa.size)
    return pressure_kpa if good.all() else np.interp(rows, rows[good], pressure_kpa[good])


def _jump(whole_kpa: FloatArray) -> float:
    """The least jump of a drop-out: a share of the span, and well above the noise."""
    span = float(np.ptp(np.percentile(ndimage.median_filter(whole_kpa, 5, mode="nearest"), [0.5, 99.5])))
    return max(DROP_OUT_SHARE * span, 8.0 * white_noise_sd(whole_kpa))


def _drop_outs(pressure_kpa: FloatArray, jump_kpa: float) -> BoolArray:
    """Rows between a jump and the jump back, few samples later: a loose wire does that, a pump does not."""
    found = np.zeros(pressure_kpa.size, dtype=bool)
    steps = np.diff(pressure_kpa)
    jumps = np.flatnonzero(np.abs(steps) > jump_kpa) if jump_kpa > 0 else np.empty(0, dtype=np.int64)
    for out, back in itertools.pairwise(jumps.tolist()):
        returns = abs(steps[out] + steps[back]) < 0.3 * abs(steps[out])
        if returns and back - out <= _MAX_DROP_OUT and not found[out]:
            found[out + 1 : back + 1] = True
    # what fills more of the run than faults do is its plan: a square wave, seldom sampled
    return found if found.mean() <= MAX_DROPPED_SHARE else np.zeros_like(found)


def find_cycles(recording: Recording, tolerance_kpa: float = TOLERANCE_KPA) -> Cycles:
    """Find the cycles of a run in its measured pressure; a level is held within `tolerance_kpa`."""
    smooth, noise = smooth_pressure(recording.pressure_kpa, recording.pressure_usable)
    low, high = (float(v) for v in np.percentile(smooth, [0.5, 99.5]))
    span = high - low
    if smooth.size < 8 or span <= max(6.0 * noise / np.sqrt(5), 2.0 * tolerance_kpa):
        return Cycles((), (), (), smooth, noise, max(span, 0.0), _not_driven(span, noise, tolerance_kpa))
    complete, partial = _assemble(smooth, recording.time_s, _groups(smooth, span), span)
    complete = tuple(_marked(cycle, recording, smooth, span) for cycle in complete)
    return Cycles(complete, partial, _small_excursions(smooth, span, noise), smooth, noise, span)


def _not_driven(span: float, noise: float, tolerance_kpa: float) -> str:
    within = f"the pressure moved by {max(span, 0.0):.2g} kPa in all"
    if span > 2.0 * tolerance_kpa:
        return f"{within}, no more than its noise of {noise:.2g} kPa makes: nothing was driven"
    return f"{within}, no more than a held pressure may (±{tolerance_kpa:g} kPa): nothing was driven"


@dataclass(frozen=True, slots=True)
class _Group:
    """One extreme: +1 high or -1 low, the middle of the rows at it, its pressure, and whether the run ends in it."""

    sign: int
    row: int
    level: float
    edge: bool


def _groups(smooth: FloatArray, span: float) -> list[_Group]:
    """The run's extremes: reversals of at least half the span, and what the run starts and ends with."""
    rows = turning_points(smooth, SWING_SHARE * span)
    if rows.size < 2:
        return []
    signs = np.where(np.diff(smooth[rows], append=smooth[rows[-2]]) < 0, 1, -1)
    found = []
    for k, (row, sign) in enumerate(zip(rows.tolist(), signs.tolist(), strict=True)):
        first = 0 if k == 0 else int(rows[k - 1])
        last = smooth.size - 1 if k == rows.size - 1 else int(rows[k + 1])
        # the middle of the rows at the extreme: right on a tie, on a hold and on a noisy peak alike
        at = first + np.flatnonzero(sign * smooth[first : last + 1] >= sign * smooth[row] - EXTREME_SHARE * span)
        found.append(_Group(sign, int(at[at.size // 2]), float(smooth[row]), k in (0, rows.size - 1)))
    return found


@compiled
def turning_points(values: Any, threshold: float) -> Any:  # pragma: no cover - compiled
    """Rows where the values turn by more than `threshold`, begun by the first extreme and ended by the last."""
    rows = []
    low, high, direction = 0, 0, 0
    for row in range(values.size):
        value = values[row]
        if value < values[low]:
            low = row
        if value > values[high]:
            high = row
        if direction <= 0 and value - values[low] > threshold:
            rows.append(low)
            direction, high = 1, row
        elif direction >= 0 and values[high] - value > threshold:
            rows.append(high)
            direction, low = -1, row
        if direction > 0:
            low = row if value < values[low] or row == high else low
        elif direction < 0:
            high = row if value > values[high] or row == low else high
    if direction != 0:
        rows.append(high if direction > 0 else low)
    return np.array(rows, dtype=np.int64)


def _assemble(
    smooth: FloatArray, time_s: FloatArray, groups: list[_Group], span: float
) -> tuple[tuple[Cycle, ...], tuple[Excursion, ...]]:
    """Chain the extremes to cycles; what hangs over is partial, or the way from and to the vented state."""
    partial: list[Excursion] = []
    paces_s = _paces(smooth, time_s, groups)
    begin, end = int(_is_lead(paces_s)), len(groups) - int(_is_lead(paces_s[::-1]))
    cut_off = False
    if end == len(groups) and end > begin + 1 and _falls_short(groups[::-1], span):
        end -= 1
        cut_off = not _is_vented(_edge(smooth[::-1]), span)
    if not begin and _falls_short(groups, span):
        # the run starts on its way to groups[1], inside a branch that came from the other kind of extreme
        begin = 1
        if not _is_vented(_edge(smooth), span):
            # as many cycles either way: then the run ends at the kind of extreme that its cycles start from
            begin += not cut_off and (end - begin) % 2 == 0
            reason = "the first cycle is incomplete: the run starts inside it"
            partial.append(_stretch(smooth, 0, groups[begin].row, reason))
    cycles: list[Cycle] = []
    at = begin
    while at + 2 < end:
        a, b, c = groups[at : at + 3]
        cycles.append(Cycle(len(cycles) + 1, a.row, b.row, c.row, a.sign > 0))
        at += 2
    if at < len(groups):
        edge = _edge(smooth[::-1])
        away = end == len(groups) and abs(edge - groups[at].level) > _LOW * span and not _is_vented(edge, span)
        if at + 1 < end or away or cut_off:
            reason = "the last cycle is incomplete: the run ends inside it"
            partial.append(_stretch(smooth, groups[at].row, smooth.size - 1, reason))
    return tuple(cycles), tuple(partial)


def _paces(smooth: FloatArray, time_s: FloatArray, groups: list[_Group]) -> list[float]:
    """Return the time a kPa from each extreme to the next, s/kPa, over the inner eight tenths of the way."""
    found = []
    for before, after in itertools.pairwise(groups):
        share = (smooth[before.row : after.row + 1] - before.level) / (after.level - before.level)
        arrived = int(np.argmax(share > 0.9))
        left = np.flatnonzero(share[:arrived] < 0.1)
        first = int(left[-1]) if left.size else 0
        found.append(float(time_s[before.row + arrived] - time_s[before.row + first]) / abs(after.level - before.level))
    return found


def _is_lead(paces_s: list[float]) -> bool:
    """True if the first stretch is a ramp from the vented state: far quicker than the branches the same way.

    A branch has holds. If the second stretch is as quick, both are a quick cycle. One branch the other way serves if
    there is no other the same way.
    """
    if len(paces_s) < 3:
        return False
    usual = float(np.median(paces_s[2::2]))
    return paces_s[0] < LEAD * usual and not paces_s[1] < LEAD * usual


def _falls_short(groups: list[_Group], span: float) -> bool:
    """True if the first extreme was cut off: short of its neighbour of the same kind.

    A run whose amplitude grows or shrinks starts or ends short too, but its other extremes then continue the trend. If
    there are no others to tell, the cycle that closes is preferred.
    """
    if len(groups) < 3:
        return False
    short = groups[0].sign * (groups[2].level - groups[0].level)
    if short <= TRUNCATED_SHARE * span:
        return False
    if len(groups) < 5:
        return len(groups) == 4 or short > _LOW * span
    trend = groups[0].sign * (groups[4].level - groups[2].level)
    return trend < 0.5 * short


def _edge(smooth: FloatArray) -> float:
    """Return the pressure at the first sample, from the line through the first ones: a ramp leaves it at once."""
    rows = np.arange(max(3, min(50, smooth.size // 1000)), dtype=np.float64)
    return float(np.polyfit(rows, smooth[: rows.size], 1)[1])


def _is_vented(pressure_kpa: float, span: float) -> bool:
    return abs(pressure_kpa) < max(_VENTED_KPA, 0.05 * span)


def _stretch(smooth: FloatArray, first: int, last: int, reason: str) -> Excursion:
    part = smooth[first : last + 1]
    return Excursion(first, last, float(part.min()), float(part.max()), reason)


def _marked(cycle: Cycle, recording: Recording, smooth: FloatArray, span: float) -> Cycle:
    lost = sum(gap.lost for gap in recording.gaps if cycle.first <= gap.row < cycle.last)
    left, arrived = _between_extremes(cycle, smooth, span)
    broken = recording.segment[left] != recording.segment[arrived]
    why = "interrupted by a pause or a restart of the board" if broken else ""
    if _ended_before_a_cycle(recording.steps):
        why = "the run ended before its first cycle was complete"
    return replace(cycle, lost=lost, left_out=why)


def _between_extremes(cycle: Cycle, smooth: FloatArray, span: float) -> tuple[int, int]:
    """Return the rows at which a cycle leaves its first extreme and comes to its last one: a pause there is outside."""
    near = min(EXTREME_SHARE * span + TOLERANCE_KPA, _LOW * span)
    inside = smooth[cycle.rows]
    left = np.flatnonzero(np.abs(inside - inside[0]) > near)
    coming = np.flatnonzero(np.abs(inside - inside[-1]) > near)
    if not left.size or not coming.size:
        return cycle.first, cycle.last
    return cycle.first + int(left[0]) - 1, cycle.first + int(coming[-1]) + 1


def _ended_before_a_cycle(steps: pd.DataFrame) -> bool:
    """Return whether the sequencer ran, but began no second branch: to the opening plateau and back is no cycle."""
    inside = steps[steps["branch"].isin(["unloading", "loading"])]
    return bool(len(steps)) and not bool((inside.groupby("cycle")["branch"].nunique() > 1).any())


def _small_excursions(smooth: FloatArray, span: float, noise: float) -> tuple[Excursion, ...]:
    """List reversals of 10 to 50 % of the span, smallest first removed, as rainflow counting does (ASTM E1049)."""
    step = max(1, smooth.size // 20_000)
    coarse = smooth[::step]
    rows = turning_points(coarse, max(EXCURSION_SHARE * span, 4.0 * noise / np.sqrt(5))).tolist()
    found: list[Excursion] = []
    while len(rows) > 3:
        swings = np.abs(np.diff(coarse[rows]))[1:-1]  # the first and last swing are the run's lead-in and lead-out
        at = int(np.argmin(swings)) + 1
        if swings[at - 1] >= SWING_SHARE * span:
            break
        a, b = rows[at], rows[at + 1]
        pair = sorted((float(coarse[a]), float(coarse[b])))
        found.append(Excursion(a * step, b * step, pair[0], pair[1], "too small to be a cycle"))
        del rows[at : at + 2]
    return tuple(sorted(found, key=lambda e: e.first))


def disagreements_with_marks(cycles: Cycles, recording: Recording) -> tuple[str, ...]:
    """Return a text for each disagreement of the cycles with the sequencer's marks.

    A mark agrees if the cycle's two extremes lie inside the marked one, to within a tenth of its length.
    """
    marked = _marked_cycles(recording.steps)
    if marked is None or recording.n < 2:
        return ()
    # a cycle that a pause or a restart interrupted is none by the marks either
    found = [(recording.time_s[c.first], recording.time_s[c.turn], recording.time_s[c.last]) for c in cycles.used]
    if len(found) != len(marked):
        return (f"the pressure shows {len(found)} complete cycles, the sequencer marked {len(marked)}",)
    found_apart = []
    for number, ((start, turn, _), (begin, end)) in enumerate(zip(found, marked, strict=True), 1):
        slack = 0.1 * (end - begin)
        if not (begin - slack - _hold(recording, begin) <= start and begin <= turn <= end):
            found_apart.append(f"cycle {number} was marked {begin:.1f} to {end:.1f} s, found from {start:.1f} s on")
    return tuple(found_apart)


def _hold(recording: Recording, begin_s: float) -> float:
    """Length of the step before `begin_s`: a cycle may start anywhere in the hold at its starting extreme."""
    before = recording.steps[recording.steps["ended_s"] <= begin_s + 1e-6]
    return float((before["ended_s"] - before["started_s"]).iloc[-1]) if len(before) else 0.0


def _marked_cycles(steps: pd.DataFrame) -> list[tuple[float, float]] | None:
    """Start and end (s) of the cycles that the sequencer finished, or None where there are no marks."""
    inside = steps[steps["branch"].isin(["unloading", "loading"])]
    if inside.empty:
        return None
    spans = []
    full = int(inside.groupby("cycle").size().max())
    for _, rows in inside.groupby("cycle"):
        if len(rows) == full and rows["status"].eq("reached").all() and rows["ended_s"].notna().all():
            spans.append((float(rows["started_s"].min()), float(rows["ended_s"].max())))
    return spans
