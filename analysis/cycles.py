"""Cycles from measured pressure.

Strategy: the pressure is freed of single spikes and of noise, its span is taken from robust extremes, and two
thresholds at 25 and 75 % of it (a Schmitt trigger) give the strokes: noise, ties on the end levels and small
excursions cannot make one. A cycle runs from the extreme that the run starts with, through the other, back.

Rules: an incomplete first or last cycle is named and left out, never completed; a cycle across a segment boundary (a
pause, a reset) is left out; one with a hole is marked; excursions that reach no threshold are listed. The sequencer's
marks are compared, never used. Nothing here looks at a signal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy import ndimage

from analysis.recording import BoolArray, FloatArray, IntArray, Recording
from analysis.statistics import white_noise_sd

LOW, HIGH = 0.25, 0.75  # thresholds, share of the span
EXTREME_SHARE = 0.02  # rows this near to an extreme belong to it
TRUNCATED_SHARE = 0.10  # an end extreme this much short of its neighbour was cut off
VENTED_KPA = 3.0  # a run that begins or ends this near to zero was vented there, not cut off
EXCURSION_SHARE = 0.10  # smaller reversals are not listed
MAX_WINDOW = 401  # samples of the noise filter


@dataclass(frozen=True, slots=True)
class Cycle:
    """One complete cycle: rows `first`..`last`, the other extreme at row `turn`.

    `falls_first` is True where it starts at high pressure: then first..turn is the unloading branch, the way from
    elongation to compression, and turn..last the loading branch; else the other way round.
    """

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
        """All rows of the cycle."""
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
    """All that the pressure says about cycles.

    Attributes
    ----------
    complete : cycles that enter the figures, and those left out for a stated reason (`left_out` not empty).
    partial : the incomplete first and last cycle, where there is one.
    excursions : reversals too small to be a cycle.
    smooth_kpa : [n] the pressure used, free of spikes and noise.
    noise_kpa : sd of the white noise found on the pressure.
    span_kpa : distance of the extremes.
    upstrokes, downstrokes : crossings of both thresholds.
    up_rows, down_rows : where they end.
    """

    complete: tuple[Cycle, ...]
    partial: tuple[Excursion, ...]
    excursions: tuple[Excursion, ...]
    smooth_kpa: FloatArray
    noise_kpa: float
    span_kpa: float
    up_rows: IntArray
    down_rows: IntArray

    @property
    def used(self) -> tuple[Cycle, ...]:
        """The complete cycles that enter the figures."""
        return tuple(cycle for cycle in self.complete if not cycle.left_out)

    @property
    def upstrokes(self) -> int:
        """Number of rises through both thresholds."""
        return int(self.up_rows.size)

    @property
    def downstrokes(self) -> int:
        """Number of falls through both thresholds."""
        return int(self.down_rows.size)

    def as_json(self) -> dict[str, int]:
        """Return the counts that `analyze --json` reports."""
        return {
            "complete": len(self.used),
            "partial": len(self.partial) + len(self.complete) - len(self.used),
            "with_gap": sum(cycle.lost > 0 for cycle in self.complete),
        }


def smooth_pressure(pressure_kpa: FloatArray, usable: BoolArray) -> tuple[FloatArray, float]:
    """Free a pressure of what is not usable, of single spikes and of noise.

    Returns
    -------
    [n] smoothed pressure, and the sd of the white noise that was on it. The running mean is as short as brings the
    noise below 1 % of the span.
    """
    rows = np.arange(pressure_kpa.size)
    good = np.asarray(usable, dtype=bool)
    if not good.any():
        return np.zeros_like(pressure_kpa), 0.0
    whole = pressure_kpa if good.all() else np.interp(rows, rows[good], pressure_kpa[good])
    noise = white_noise_sd(whole)
    quiet = ndimage.median_filter(whole, 5, mode="nearest")
    span = float(np.ptp(np.percentile(quiet, [0.5, 99.5])))
    window = 1 if span <= 0 else int(np.ceil((noise / (0.01 * span)) ** 2))
    window = min(window | 1, MAX_WINDOW, max(1, (whole.size // 20) | 1))
    return (ndimage.uniform_filter1d(quiet, window, mode="nearest") if window > 1 else quiet), noise


def find_cycles(recording: Recording) -> Cycles:
    """Find the cycles of a run in its measured pressure.

    Returns
    -------
    Cycles; empty, never an error, where the pressure did not move or the run is too short.
    """
    smooth, noise = smooth_pressure(recording.pressure_kpa, recording.pressure_usable)
    low, high = (float(v) for v in np.percentile(smooth, [0.5, 99.5]))
    span = high - low
    if smooth.size < 8 or span <= max(6.0 * noise / np.sqrt(5), 1e-9):
        none = np.empty(0, dtype=np.int64)
        return Cycles((), (), (), smooth, noise, max(span, 0.0), none, none)
    groups = _extreme_groups(smooth, low + LOW * span, low + HIGH * span)
    up, down = _strokes(groups)
    extremes = [_extreme_row(smooth, group, span) for group in groups]
    complete, partial = _assemble(smooth, groups, extremes, span)
    complete = tuple(_marked(cycle, recording) for cycle in complete)
    return Cycles(complete, partial, _small_excursions(smooth, span, noise), smooth, noise, span, up, down)


@dataclass(frozen=True, slots=True)
class _Group:
    """A visit to the upper (+1) or lower (-1) quarter of the span: rows first..last."""

    sign: int
    first: int
    last: int


def _extreme_groups(smooth: FloatArray, low: float, high: float) -> list[_Group]:
    zone = (smooth > high).astype(np.int8) - (smooth < low).astype(np.int8)
    rows = np.flatnonzero(zone)
    if not rows.size:
        return []
    changes = np.flatnonzero(np.diff(zone[rows]))
    firsts = np.concatenate([[0], changes + 1])
    lasts = np.concatenate([changes, [rows.size - 1]])
    return [_Group(int(zone[rows[a]]), int(rows[a]), int(rows[b])) for a, b in zip(firsts, lasts, strict=True)]


def _strokes(groups: list[_Group]) -> tuple[IntArray, IntArray]:
    up = [g.first for g in groups[1:] if g.sign > 0]
    down = [g.first for g in groups[1:] if g.sign < 0]
    return np.asarray(up, dtype=np.int64), np.asarray(down, dtype=np.int64)


def _extreme_row(smooth: FloatArray, group: _Group, span: float) -> int:
    """Return the middle row of those at the extreme: right on a tie, on a hold and on a noisy peak alike."""
    visit = group.sign * smooth[group.first : group.last + 1]
    rows = np.flatnonzero(visit >= visit.max() - EXTREME_SHARE * span)
    return group.first + int(rows[rows.size // 2])


def _assemble(
    smooth: FloatArray, groups: list[_Group], extremes: list[int], span: float
) -> tuple[tuple[Cycle, ...], tuple[Excursion, ...]]:
    if len(groups) < 2:
        return (), ()
    begin = 1 if _starts_inside_a_branch(smooth, groups, span) or _cut_off(smooth, groups, extremes, span, 0) else 0
    # the cut-off extreme belongs to a branch whose cycle ends at the next extreme of the run's starting kind
    if begin and not _starts_inside_a_branch(smooth, groups, span):
        begin = min(2, len(groups) - 1)
    usable = len(groups) - (1 if _cut_off(smooth, groups, extremes, span, len(groups) - 1) else 0)
    cycles: list[Cycle] = []
    at = begin
    while at + 2 < usable:
        falls = groups[at].sign > 0
        cycles.append(Cycle(len(cycles) + 1, extremes[at], extremes[at + 1], extremes[at + 2], falls))
        at += 2
    partial: list[Excursion] = []
    if begin:
        partial.append(_stretch(smooth, 0, extremes[begin], "the first cycle is incomplete: the run starts inside it"))
    vented = abs(float(smooth[-1])) < VENTED_KPA
    away = abs(float(smooth[-1]) - float(smooth[extremes[at]])) > LOW * span
    if at + 1 < len(groups) or (away and not vented):
        partial.append(
            _stretch(smooth, extremes[at], smooth.size - 1, "the last cycle is incomplete: the run ends inside it")
        )
    return tuple(cycles), tuple(partial)


def _starts_inside_a_branch(smooth: FloatArray, groups: list[_Group], span: float) -> bool:
    """True where the run starts between the extremes, and not vented: then it starts in the middle of a branch."""
    away = abs(float(smooth[0]) - float(smooth[groups[0].first])) > 0.05 * span
    return away and abs(float(smooth[0])) > VENTED_KPA and groups[0].first > 0


def _cut_off(smooth: FloatArray, groups: list[_Group], extremes: list[int], span: float, at: int) -> bool:
    """True where the run begins or ends on its way to (or from) an extreme that it would have reached."""
    neighbour = at + 2 if at == 0 else at - 2
    edge = 0 if at == 0 else smooth.size - 1
    if not 0 <= neighbour < len(groups):
        return False
    visit = slice(groups[at].first, groups[at].last + 1)
    reached = float((groups[at].sign * smooth[visit]).max())
    short = groups[at].sign * float(smooth[extremes[neighbour]]) - reached > TRUNCATED_SHARE * span
    return short and abs(groups[at].sign * float(smooth[edge]) - reached) < EXTREME_SHARE * span


def _stretch(smooth: FloatArray, first: int, last: int, reason: str) -> Excursion:
    part = smooth[first : last + 1]
    return Excursion(first, last, float(part.min()), float(part.max()), reason)


def _marked(cycle: Cycle, recording: Recording) -> Cycle:
    lost = sum(gap.lost for gap in recording.gaps if cycle.first <= gap.row < cycle.last)
    broken = recording.segment[cycle.first] != recording.segment[cycle.last]
    return replace(cycle, lost=lost, left_out="interrupted by a pause or a restart of the board" if broken else "")


def _small_excursions(smooth: FloatArray, span: float, noise: float) -> tuple[Excursion, ...]:
    """List reversals of 10 to 50 % of the span, smallest first removed, as rainflow counting does (ASTM E1049)."""
    step = max(1, smooth.size // 20_000)
    coarse = smooth[::step]
    rows = _turning_points(coarse, max(EXCURSION_SHARE * span, 4.0 * noise / np.sqrt(5)))
    found: list[Excursion] = []
    while len(rows) > 3:
        swings = np.abs(np.diff(coarse[rows]))[1:-1]  # the first and last swing are the run's lead-in and lead-out
        at = int(np.argmin(swings)) + 1
        if swings[at - 1] >= 0.5 * span:
            break
        a, b = rows[at], rows[at + 1]
        pair = sorted((float(coarse[a]), float(coarse[b])))
        found.append(Excursion(a * step, b * step, pair[0], pair[1], "too small to be a cycle"))
        del rows[at : at + 2]
    return tuple(sorted(found, key=lambda e: e.first))


def _turning_points(values: FloatArray, threshold: float) -> list[int]:
    """Rows where the values turn by more than `threshold`, with the first and the last row."""
    rows = [0]
    direction, best = 0, 0
    for row, value in enumerate(values.tolist()):
        if direction == 0:
            if abs(value - values[0]) > threshold:
                direction, best = (1 if value > values[0] else -1), row
        elif direction * (value - values[best]) > 0:
            best = row
        elif direction * (values[best] - value) > threshold:
            rows.append(best)
            direction, best = -direction, row
    rows.append(best if direction else values.size - 1)
    return rows


def disagreements_with_marks(cycles: Cycles, recording: Recording) -> tuple[str, ...]:
    """Compare the cycles with the sequencer's marks; one sentence for each disagreement, none where they agree.

    A mark agrees where the found cycle's two extremes lie inside the marked one, to within a tenth of its length.
    """
    marked = _marked_cycles(recording.steps)
    if marked is None or recording.n < 2:
        return ()
    found = [(recording.time_s[c.first], recording.time_s[c.turn], recording.time_s[c.last]) for c in cycles.complete]
    if len(found) != len(marked):
        return (f"the pressure shows {len(found)} complete cycles, the sequencer marked {len(marked)}",)
    said = []
    for number, ((start, turn, _), (begin, end)) in enumerate(zip(found, marked, strict=True), 1):
        slack = 0.1 * (end - begin)
        if not (begin - slack - _hold(recording, begin) <= start and begin <= turn <= end):
            said.append(f"cycle {number} was marked {begin:.1f} to {end:.1f} s, found from {start:.1f} s on")
    return tuple(said)


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
