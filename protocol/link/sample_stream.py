"""Samples in order: exact loss, dropped repeats, one unwrapped board clock, flags of the host (protocol/SPEC.md).

Both kinds of link pass arrays of `recording.sample_dtype` in order of arrival, `index` and `time_us` as sent. Rules:

- **Loss.** Index differences are taken modulo the wrap. A step of 1 + n is a gap of exactly n: the checksum guarantees
  that the board wrote that index. A step back is a repeat or out of order: dropped and counted.
- **A new stream** begins at index 0 after an answered START, or where the index begins again after a HELLO, a "booted"
  or an answered STOP; a first index n lost n. The very first stream may be older than this link: its start is adopted,
  and counted as loss only if a later answered START shows that this link began it.
- **A restart without these** (messages lost, or a false forward step): 16 samples in a row, each index one above the
  last, while the clock continues from the last sample kept. Repeats differ by their old clock. The 16 are kept.
- **Time** is unwrapped by the smallest step; over a gap that may hold wraps, by the number that fits the sampling
  period best. A clock that goes back begins a segment once two samples show it; one alone is kept and flagged.
- Only the board's bytes count, not commands, the host's clock or chunks: the same bytes give the same samples.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from protocol.base.arrays import BoolArray, IntArray
from protocol.link.events import BoardRestarted, ClockWentBack, LinkEvent, SampleGap, Samples
from protocol.recording import SampleFlag

WRAP = 1 << 32
NO_WRAP = 1 << 62
RESTART_RUN = 16  # late samples in a row that prove a new stream
WRAP_TOLERANCE_US = 2_000_000  # between the index and a clock that wrapped; more is a clock that was set
PRESSURE_MAX_PA = 1_000_000.0  # ten times what a soft actuator is driven with
PRESSURE_MIN_PA = -110_000.0  # below vacuum: no gauge pressure at all
DARK_EXCESS = 1 / 256  # of full scale: noise near zero signal is far smaller
_REMEMBERED = (
    "order", "number", "raw_time", "time", "period", "unclaimed", "may_restart", "started", "lost_at_start",
    "no_neighbour",
)  # fmt: skip

Rows = np.ndarray[Any, np.dtype[np.void]]


def implausible(rows: Rows, adc_bits: int) -> BoolArray:
    """Return which samples [n] are impossible: kept, and left out of every figure; `adc_bits` is 1 to 16.

    A pressure above 1 MPa, below vacuum or not a number; counts beyond the converter's; a dark reading more than 1/256
    of full scale above the lit one (less can be noise near zero signal); a signal that is not a number.
    """
    pressure = rows["pressure_pa"]
    absurd = ~((pressure >= PRESSURE_MIN_PA) & (pressure <= PRESSURE_MAX_PA))
    if rows.dtype.names is not None and "signal_mv" in rows.dtype.names:
        result: BoolArray = absurd | ~np.isfinite(rows["signal_mv"]).all(axis=1)
        return result
    lit, dark, full = rows["lit"], rows["dark"], 1 << adc_bits
    excess = dark > lit + np.uint32(full * DARK_EXCESS)
    absurd |= np.logical_or.reduce(excess | (np.maximum(lit, dark) >= full), axis=1)
    return absurd


def _wrapped(difference: Any, wrap: int) -> Any:
    """Return a difference modulo `wrap`, in -wrap/2 .. wrap/2 - 1."""
    return (difference + wrap // 2) % wrap - wrap // 2


def _differences(values: IntArray, before: int) -> IntArray:
    """Return each value minus the one before it (`np.diff` with `prepend` is slow on short arrays)."""
    differences = np.empty_like(values)
    differences[0] = values[0] - before
    np.subtract(values[1:], values[:-1], out=differences[1:])
    return differences


def _positions(steps: IntArray, wrap: int) -> tuple[IntArray, IntArray]:
    """Return the positions of rows from the last one kept, and the farthest before each, from their steps."""
    position = np.cumsum(steps)
    reached = np.maximum.accumulate(np.concatenate(([0], position)))[:-1]
    if (np.abs(position - reached) >= wrap // 2).any():  # late rows wrapped: the smallest step is from the farthest
        at = farthest = 0
        for n, step in enumerate(steps.tolist()):
            at = farthest + _wrapped(at + step - farthest, wrap)
            position[n], reached[n] = at, farthest
            farthest = max(farthest, at)
    return position, reached


class SampleStream:
    """Order, losses and unwrapped time of one link's samples.

    `index_wrap`, `time_wrap_us`: value at which index and clock restart at 0; None for a device without an index: its
    samples are ordered by time and numbered on arrival, and losses cannot be detected. `announces_restart`: False for a
    device without HELLO: a run of late samples then is a restart whatever their clock.
    """

    def __init__(
        self, *, index_wrap: int | None = WRAP, time_wrap_us: int = WRAP, announces_restart: bool = True
    ) -> None:
        self._indexed = index_wrap is not None
        self._order_wrap = time_wrap_us if index_wrap is None else index_wrap
        self._time_wrap = time_wrap_us
        self._announces_restart = announces_restart
        self._order: int | None = None  # index of the last sample kept, or its raw time where there is no index
        self._number = 0  # of the next sample, where there is no index
        self._raw_time = 0  # of the last sample kept, as the board wrote it
        self._time = 0  # the same, unwrapped
        self._period = 0  # between the last two neighbours, us
        self._unclaimed = 0  # first index of a stream that began before this link
        self._may_restart = False
        self._started = False  # a START was answered, its first sample is pending
        self._held: list[Rows] = []  # late samples that may prove a restart
        self._doubtful: tuple[Rows, int] | None = None  # newest sample, its index step: its clock may have gone back
        self._before: tuple[int, int] | None = None  # raw time of the sample before the last, and index steps since
        self._no_neighbour = True  # the next sample begins a stream: the time before it is not a sampling period
        self._lost_at_start = 0  # samples of a new stream before the first that arrived
        self.samples = 0
        self.lost = 0
        self._dropped = 0

    def state(self) -> dict[str, Any]:
        """Return the memory of the samples so far, without the counters, ready for JSON."""
        held = [row.tobytes().hex() for row in self._held]
        doubtful = None if self._doubtful is None else (self._doubtful[0].tobytes().hex(), self._doubtful[1])
        remembered = {name: getattr(self, f"_{name}") for name in _REMEMBERED}
        return {**remembered, "held": held, "doubtful": doubtful, "before": self._before}

    def restore(self, state: dict[str, Any], dtype: np.dtype[np.void]) -> None:
        """Continue from the `state` of another stream; `dtype` is that of its samples."""
        for name in _REMEMBERED:
            setattr(self, f"_{name}", state[name])
        self._held = [np.frombuffer(bytes.fromhex(row), dtype) for row in state["held"]]
        if state.get("doubtful"):  # both are missing from older recordings
            row, step = state["doubtful"]
            self._doubtful = np.frombuffer(bytes.fromhex(row), dtype), step
        if state.get("before"):
            self._before = state["before"][0], state["before"][1]

    @property
    def counters(self) -> dict[str, int]:
        """The counters under their names in `LinkStatistics`; duplicates are repeated or out of order, dropped."""
        return {"samples": self.samples, "lost": self.lost, "duplicates": self._dropped + len(self._held)}

    def stream_may_restart(self) -> None:
        """Note a HELLO, a "booted" or an answered STOP: an index that goes back now begins a new stream."""
        self._may_restart = True
        self._drop_held()

    def stream_started(self) -> None:
        """Note an answered START."""
        self.stream_may_restart()
        self._started = True

    def unwrapped_time(self, raw_time_us: int) -> int:
        """Return the time of an event on the samples' clock."""
        step: int = _wrapped(raw_time_us - self._raw_time, self._time_wrap)
        return raw_time_us if self._order is None or (self._may_restart and step < 0) else self._time + step

    def accept(self, rows: Rows) -> list[LinkEvent]:
        """Return the gaps and the samples to keep; `rows` (raw index and time) is changed in place."""
        events: list[LinkEvent] = []
        if self._may_restart and len(rows):
            self._end_doubt(events)
        if self._order is None or self._may_restart:
            rows = self._without_repeats(rows)
            if len(rows):
                self._begin(rows, events)
        if not len(rows):
            return events
        assert self._order is not None
        steps = _differences(self._orders(rows), self._order)
        if not (steps == 1).all() or self._held:
            position, reached = _positions(_wrapped(steps, self._order_wrap), self._order_wrap)
            late = position < reached + self._indexed
            if late.any() or self._held:
                restart = self._restart_in(rows, late)
                if restart is not None:
                    return events + self._split(rows, late, restart)
                rows, position, reached = rows[~late], position[~late], reached[~late]
                if not len(rows):
                    return events
            steps = position - reached
        if not self._indexed:
            self._order = int(rows["time_us"][-1])
            rows["index"] = np.arange(self._number, self._number + len(rows))
            self._number += len(rows)
            steps = np.ones(len(rows), np.int64)
        self._deliver(rows, steps, events)
        return events

    def _orders(self, rows: Rows) -> IntArray:
        return rows["index" if self._indexed else "time_us"].astype(np.int64)

    def _without_repeats(self, rows: Rows) -> Rows:
        """Drop repeats of the last sample kept: they do not begin a new stream."""
        if self._order is None:
            return rows
        repeats = (self._orders(rows) == self._order) & (rows["time_us"] == self._raw_time)
        leading = len(rows) if repeats.all() else int(repeats.argmin())
        self._dropped += leading
        return rows[leading:]

    def _begin(self, rows: Rows, events: list[LinkEvent]) -> None:
        """Decide whether the first sample after a START, a HELLO or at the very beginning starts a new stream."""
        known, started, order = self._order, self._started, int(self._orders(rows)[0])
        self._may_restart = self._started = False
        if known is not None and _wrapped(order - known, self._order_wrap) > 0:
            if started and self._unclaimed:  # this link began the stream: the answer to START came late
                self.lost += self._unclaimed
                events.append(SampleGap(self._unclaimed, self._unclaimed, self._time))
                self._unclaimed = 0
            return
        self._new_stream(rows)
        if self._indexed:
            ours = started or known is not None
            self._unclaimed, self._lost_at_start = (0, order) if ours else (order, 0)

    def _new_stream(self, rows: Rows) -> None:
        """Expect the first of `rows` next; the clock continues unless it began again too."""
        raw_time = int(rows["time_us"][0])
        if self._order is None or _wrapped(raw_time - self._raw_time, self._time_wrap) < 0:
            self._time = self._raw_time = raw_time
        self._order = int(self._orders(rows)[0]) - 1
        self._number = 0
        self._new_clock()

    def _new_clock(self) -> None:
        self._period, self._no_neighbour, self._before = 0, True, None

    def _deliver(self, rows: Rows, steps: IntArray, events: list[LinkEvent], *, last: bool = False) -> None:
        """Unwrap and count samples to keep; a new clock begins where it went back. `last`: nothing more can show it."""
        if self._doubtful is not None:
            (row, step), self._doubtful = self._doubtful, None
            rows, steps = np.concatenate([row, rows]), np.concatenate(([step], steps))
        while len(rows):
            neighbours = steps == 1
            neighbours[0] &= not self._no_neighbour
            elapsed, back = self._elapsed(rows, steps, neighbours, last=last)
            if back:
                self._unwrap(rows[:back], steps[:back], neighbours[:back], elapsed[:back])
                self._count(rows[:back], steps[:back], events)
            if back + 1 >= len(rows):
                if back < len(rows):
                    self._doubtful = rows[back:].copy(), int(steps[back])
                    self._order = int(rows["index"][back])
                return
            by_us = int(-elapsed[back] if elapsed[back] < 0 else self._raw_time - rows["time_us"][back])
            events.append(ClockWentBack(by_us + int(steps[back]) * max(self._period, 0)))
            self._time, self._raw_time = self._time - by_us, int(rows["time_us"][back])
            self._new_clock()
            rows, steps = rows[back:], steps[back:]

    def _end_doubt(self, events: list[LinkEvent]) -> None:
        """Deliver the newest sample: nothing that follows shows that its clock went back."""
        if self._doubtful is not None:
            (row, step), self._doubtful = self._doubtful, None
            self._deliver(row.copy(), np.array([step]), events, last=True)

    def _elapsed(self, rows: Rows, steps: IntArray, neighbours: BoolArray, *, last: bool) -> tuple[IntArray, int]:
        """Return the board time before each sample, and the first sample whose clock has, or may have, gone back."""
        raw = rows["time_us"]
        elapsed = _differences(raw, self._raw_time)
        if elapsed.min() >= 0 and elapsed.max() < self._time_wrap // 2 and neighbours.all():
            return elapsed, len(rows)
        fell = elapsed < 0
        elapsed = _wrapped(elapsed, self._time_wrap)
        at = np.maximum.accumulate(np.where(neighbours, np.arange(len(rows)), -1))
        periods = np.where(at >= 0, elapsed[at], self._period).astype(np.float64)
        gaps = np.flatnonzero(steps > 1)
        wraps = np.rint((steps[gaps] * periods[gaps] - elapsed[gaps]) / self._time_wrap)
        elapsed[gaps] += np.maximum(wraps, 0).astype(np.int64) * self._time_wrap
        if self._indexed and not last:
            before = np.concatenate(([self._period], periods[:-1]))  # known before each sample
            expected = steps * before
            strange = fell & (before > 0) & (np.abs(elapsed - expected) > np.maximum(WRAP_TOLERANCE_US, expected / 2))
            for back in np.flatnonzero((elapsed < 0) | strange).tolist():
                if self._goes_back(raw, steps, back, float(before[back])):
                    return elapsed, back
        return elapsed, len(rows)

    def _goes_back(self, raw: IntArray, steps: IntArray, at: int, period: float) -> bool:
        """Return whether the clock goes back at a sample: not for one sample alone, nor after one that was ahead.

        True for the newest sample if only the next one can tell.
        """
        here, step = int(raw[at]), int(steps[at])
        previous = int(raw[at - 1]) if at else self._raw_time
        if at + 1 < len(raw) and self._continues(previous, int(raw[at + 1]), (step + int(steps[at + 1])) * period):
            return False
        before = self._before
        if at:
            before = (int(raw[at - 2]) if at > 1 else self._raw_time), int(steps[at - 1])
        return before is None or not self._continues(before[0], here, (before[1] + step) * period)

    def _continues(self, raw_before: int, raw: int, expected: float) -> bool:
        """Return whether a raw time follows another, over a wrap only as long after it as the index says."""
        elapsed = _wrapped(raw - raw_before, self._time_wrap)
        elapsed += max(round((expected - elapsed) / self._time_wrap), 0) * self._time_wrap
        if raw >= raw_before or expected <= 0:
            return bool(elapsed >= 0)
        return bool(elapsed >= 0 and abs(elapsed - expected) <= max(WRAP_TOLERANCE_US, expected / 2))

    def _unwrap(self, rows: Rows, steps: IntArray, neighbours: BoolArray, elapsed: IntArray) -> None:
        """Turn the raw times of kept samples into the unwrapped clock."""
        raw = rows["time_us"].copy()
        self._no_neighbour = False
        if elapsed.min() < 0:
            rows["flags"][elapsed < 0] |= np.uint16(SampleFlag.IMPLAUSIBLE)
        rows["time_us"] = self._time + np.cumsum(elapsed)
        if neighbours.any():
            self._period = int(elapsed[len(rows) - 1 - int(neighbours[::-1].argmax())])
        self._before = (int(raw[-2]) if len(raw) > 1 else self._raw_time), int(steps[-1])
        self._raw_time = int(raw[-1])
        self._time = int(rows["time_us"][-1])

    def _count(self, rows: Rows, steps: IntArray, events: list[LinkEvent]) -> None:
        steps[0] += self._lost_at_start
        self._lost_at_start = 0
        gaps = np.flatnonzero(steps > 1)
        if len(gaps):
            rows["flags"][gaps] |= np.uint16(SampleFlag.GAP_BEFORE)
            lost = (steps[gaps] - 1).tolist()
            self.lost += sum(lost)
            events += map(SampleGap, lost, rows["index"][gaps].tolist(), rows["time_us"][gaps].tolist())
        self.samples += len(rows)
        if self._indexed:
            self._order = int(rows["index"][-1])
        rows.flags.writeable = False
        events.append(Samples(rows))

    def _restart_in(self, rows: Rows, late: BoolArray) -> int | None:
        """Hold the late samples back; return the row of the last of a run that proves a restart."""
        raw_kept = self._raw_time if self._doubtful is None else int(self._doubtful[0]["time_us"][0])
        for at in np.flatnonzero(late):
            row = rows[at : at + 1].copy()
            if at and not late[at - 1]:
                self._drop_held()
                raw_kept = int(rows["time_us"][at - 1])
            if self._held and not self._follows(self._held[-1], row):
                self._drop_held()
            clock_continues = _wrapped(int(row["time_us"][0]) - raw_kept, self._time_wrap) > 0
            if clock_continues or not self._announces_restart:
                self._held.append(row)
            else:
                self._drop_held()
                self._dropped += 1
            if len(self._held) == RESTART_RUN:
                return int(at)
        if not late[-1]:
            self._drop_held()
        return None

    def _follows(self, before: Rows, row: Rows) -> bool:
        """Return whether a sample directly follows another."""
        later: bool = _wrapped(int(row["time_us"][0]) - int(before["time_us"][0]), self._time_wrap) > 0
        step = int(row["index"][0]) - int(before["index"][0])
        return later and (not self._indexed or step % self._order_wrap == 1)

    def _drop_held(self) -> None:
        self._dropped += len(self._held)
        self._held = []

    def _split(self, rows: Rows, late: BoolArray, restart: int) -> list[LinkEvent]:
        """Deliver the samples before the restart, then begin again with those held back."""
        new = np.concatenate([*self._held, rows[restart + 1 :]])
        self._held = []
        events = self.accept(rows[: restart + 1][~late[: restart + 1]])
        self._end_doubt(events)
        events.append(BoardRestarted(None))
        self._new_stream(new)
        self._unclaimed = int(new["index"][0]) if self._indexed else 0
        return events + self.accept(new)
