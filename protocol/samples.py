"""Samples in order: exact loss, dropped repeats, one unwrapped board clock, flags of the host.

Both kinds of link bring their samples here as arrays of `recording.sample_dtype` in order of arrival, `index` and
`time_us` as the board wrote them. Rules of this file (protocol/SPEC.md, "What the host makes of samples"):

- **Loss.** Differences of the index are taken modulo its wrap. A step of 1 + n forward is a gap of n, exactly: the
  checksum vouches that the board wrote that index. A step back is a repeat or out of order: dropped and counted.
- **A new stream** begins at index 0 after an answered START, or where the index begins again after a HELLO, a
  "booted" or an answered STOP. Its first sample with index n lost n. The first stream of all may have been running
  before us: its start is adopted, and counted as loss only if an answered START then shows that it was ours.
- **An index that went back for good** without any of these (a forward step that was never true, a restart of which no
  word arrived): 16 samples in a row, each index one above the other, while the clock runs on from the last sample
  kept. A repeat cannot look like that, its clock is old. They are kept, as a restart; nothing is lost to the wait.
- **Time** is unwrapped by the shortest way; over a gap so long that the clock may have wrapped in it, by the number of
  wraps that fits the sampling period best. A clock that runs backward is kept as it is and flagged.
- **Flags.** GAP_BEFORE, and IMPLAUSIBLE for values that no checksum excuses (`implausible`).
- All of this depends on the board's bytes alone, never on what was sent or on the host's clock, and not on the cutting
  into chunks: so the same bytes give the same samples, bit for bit, at any later time.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from protocol.link import BoardRestarted, Gap, LinkEvent, Samples
from protocol.recording import SampleFlag

WRAP = 1 << 32
NO_WRAP = 1 << 62
RESTART_RUN = 16  # late samples in a row that prove a new stream
PRESSURE_MAX_PA = 1_000_000.0  # ten times anything a soft actuator sees
PRESSURE_MIN_PA = -110_000.0  # below vacuum: no gauge pressure at all
DARK_EXCESS = 1 / 256  # of full scale: noise near zero light stays far below
_REMEMBERED = (
    "index", "raw_time", "time", "period", "unclaimed", "may_restart", "started", "lost_at_start",
)  # fmt: skip

Rows = np.ndarray[Any, np.dtype[np.void]]
Integers = np.ndarray[Any, np.dtype[np.int64]]


def implausible(rows: Rows, adc_bits: int) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Return which samples are absurd: kept, and left out of every figure.

    A pressure above 1 MPa, below vacuum or not a number; counts beyond the converter's; a dark reading more than
    1/256 of full scale above the lit one (less can be noise near zero light); a signal that is not a number.

    Parameters
    ----------
    rows : n samples, of either kind.
    adc_bits : of the board's converter, 1 to 16.

    Returns
    -------
    Booleans, shape (n,).
    """
    pressure = rows["pressure_pa"]
    absurd = ~((pressure >= PRESSURE_MIN_PA) & (pressure <= PRESSURE_MAX_PA))
    if rows.dtype.names is not None and "signal_mv" in rows.dtype.names:
        result: np.ndarray[Any, np.dtype[np.bool_]] = absurd | ~np.isfinite(rows["signal_mv"]).all(axis=1)
        return result
    lit, dark, full = rows["lit"], rows["dark"], 1 << adc_bits
    excess = dark > lit + np.uint32(full * DARK_EXCESS)
    absurd |= (excess | (lit >= full) | (dark >= full)).any(axis=1)
    return absurd


def _wrapped(difference: Any, wrap: int) -> Any:
    """Return a difference modulo `wrap` by the shortest way, in -wrap/2 .. wrap/2 - 1."""
    return (difference + wrap // 2) % wrap - wrap // 2


class SampleStream:
    """The accounts of one link's samples.

    Parameters
    ----------
    index_wrap, time_wrap_us : where the board's index and clock begin again at 0.
    """

    def __init__(self, *, index_wrap: int = WRAP, time_wrap_us: int = WRAP) -> None:
        self._index_wrap = index_wrap
        self._time_wrap = time_wrap_us
        self._index: int | None = None  # of the last sample kept
        self._raw_time = 0  # of the last sample kept, as the board wrote it
        self._time = 0  # the same, unwrapped
        self._period = 0  # between the last two neighbours, us
        self._unclaimed = 0  # first index of a stream that was running before we knew
        self._may_restart = False
        self._started = False  # a START was answered, its first sample is still to come
        self._held: list[Rows] = []  # late samples that may prove a restart
        self._lost_at_start = 0  # samples of a new stream before the first that came
        self.samples = 0
        self.lost = 0
        self._dropped = 0

    def state(self) -> dict[str, Any]:
        """Return what is remembered of the samples so far, without the counters, ready for JSON."""
        held = [row.tobytes().hex() for row in self._held]
        return {**{name: getattr(self, f"_{name}") for name in _REMEMBERED}, "held": held}

    def restore(self, state: dict[str, Any], dtype: np.dtype[np.void]) -> None:
        """Go on where another stream's `state` was taken; `dtype` is that of its samples."""
        for name in _REMEMBERED:
            setattr(self, f"_{name}", state[name])
        self._held = [np.frombuffer(bytes.fromhex(row), dtype) for row in state["held"]]

    @property
    def duplicates(self) -> int:
        """Samples repeated or out of order, not delivered."""
        return self._dropped + len(self._held)

    def stream_may_restart(self) -> None:
        """A HELLO, a "booted" or an answered STOP came: an index that goes back now begins a new stream."""
        self._may_restart = True
        self._drop_held()

    def stream_started(self) -> None:
        """A START was answered."""
        self.stream_may_restart()
        self._started = True

    def unwrapped_time(self, raw_time_us: int) -> int:
        """Return the time of an event on the samples' clock."""
        step: int = _wrapped(raw_time_us - self._raw_time, self._time_wrap)
        return raw_time_us if self._index is None or (self._may_restart and step < 0) else self._time + step

    def accept(self, rows: Rows) -> list[LinkEvent]:
        """Return the gaps and the samples to keep; `rows` (n >= 1, raw index and time) is changed in place."""
        index = rows["index"].astype(np.int64)
        events: list[LinkEvent] = []
        if self._index is None or self._may_restart:
            self._begin(int(index[0]), int(rows["time_us"][0]), events)
        assert self._index is not None
        steps = np.diff(index, prepend=self._index)
        if (steps == 1).all() and not self._held:
            kept = rows
        else:
            steps = _wrapped(steps, self._index_wrap)
            position = np.cumsum(steps)
            reached = np.maximum.accumulate(np.concatenate(([0], position)))
            late = position <= reached[:-1]
            if late.any() or self._held:
                restart = self._restart_in(rows, late)
                if restart is not None:
                    return events + self._split(rows, late, restart)
                rows, position, reached = rows[~late], position[~late], reached[:-1][~late]
                if not len(rows):
                    return events
            kept, steps = rows, position - reached
        self._unwrap(kept, steps)
        self._count(kept, steps, events)
        return events

    def _begin(self, index: int, raw_time: int, events: list[LinkEvent]) -> None:
        """Decide what the first sample after a START, a HELLO or nothing at all is: more of the stream, or a new."""
        known, started = self._index, self._started
        if known == index and raw_time == self._raw_time:
            return  # a repeat of the last one says nothing
        self._may_restart = self._started = False
        if known is not None and _wrapped(index - known, self._index_wrap) > 0:
            if started and self._unclaimed:  # the stream we found was ours: an answer to START came late
                self.lost += self._unclaimed
                events.append(Gap(self._unclaimed, self._unclaimed, self._time))
                self._unclaimed = 0
            return
        step = _wrapped(raw_time - self._raw_time, self._time_wrap)
        if known is None or step < 0:
            self._time = raw_time
            self._raw_time = raw_time
        self._index = index - 1
        ours = started or known is not None
        self._unclaimed, self._lost_at_start = (0, index) if ours else (index, 0)

    def _unwrap(self, rows: Rows, steps: Integers) -> None:
        """Turn the raw times of kept samples into the unwrapped clock."""
        raw = rows["time_us"].copy()
        elapsed = np.diff(raw, prepend=self._raw_time)
        if (elapsed < 0).any() or steps.max() > 1:
            elapsed = _wrapped(elapsed, self._time_wrap)
            for at in np.flatnonzero(steps > 1):
                neighbours = np.flatnonzero(steps[:at] == 1)
                period = int(elapsed[neighbours[-1]]) if len(neighbours) else self._period
                wraps = round((int(steps[at]) * period - int(elapsed[at])) / self._time_wrap)
                elapsed[at] += max(wraps, 0) * self._time_wrap
            rows["flags"][elapsed < 0] |= np.uint16(SampleFlag.IMPLAUSIBLE)
        rows["time_us"] = self._time + np.cumsum(elapsed)
        neighbours = np.flatnonzero(steps == 1)
        if len(neighbours):
            self._period = int(elapsed[neighbours[-1]])
        self._raw_time = int(raw[-1])
        self._time = int(rows["time_us"][-1])

    def _count(self, rows: Rows, steps: Integers, events: list[LinkEvent]) -> None:
        steps[0] += self._lost_at_start
        self._lost_at_start = 0
        for at in np.flatnonzero(steps > 1):
            lost = int(steps[at]) - 1
            self.lost += lost
            rows["flags"][at] |= SampleFlag.GAP_BEFORE
            events.append(Gap(lost, int(rows["index"][at]), int(rows["time_us"][at])))
        self.samples += len(rows)
        self._index = int(rows["index"][-1])
        rows.flags.writeable = False
        events.append(Samples(rows))

    def _restart_in(self, rows: Rows, late: np.ndarray[Any, np.dtype[np.bool_]]) -> int | None:
        """Hold the late samples back; return where the last of a run that proves a restart stands."""
        raw_kept = self._raw_time
        for at in range(len(rows)):
            row = rows[at : at + 1].copy()
            if not late[at]:
                self._drop_held()
                raw_kept = int(row["time_us"][0])
                continue
            before = self._held[-1] if self._held else None
            if before is not None and (int(row["index"][0]) - int(before["index"][0])) % self._index_wrap != 1:
                self._drop_held()
                before = None
            raw_before = raw_kept if before is None else int(before["time_us"][0])
            if _wrapped(int(row["time_us"][0]) - raw_before, self._time_wrap) > 0:
                self._held.append(row)
            else:
                self._drop_held()
                self._dropped += 1
            if len(self._held) == RESTART_RUN:
                return at
        return None

    def _drop_held(self) -> None:
        self._dropped += len(self._held)
        self._held = []

    def _split(self, rows: Rows, late: np.ndarray[Any, np.dtype[np.bool_]], restart: int) -> list[LinkEvent]:
        """Deliver what was before the restart, then begin again with the samples held back."""
        new = np.concatenate([*self._held, rows[restart + 1 :]])
        self._held = []
        before = rows[: restart + 1][~late[: restart + 1]].copy()
        events = self.accept(before) if len(before) else []
        events.append(BoardRestarted(None))
        self._index = int(new["index"][0]) - 1
        self._unclaimed = self._index + 1
        return events + self.accept(new)
