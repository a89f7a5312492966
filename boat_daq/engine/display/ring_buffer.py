"""The last hour in memory, as columns for the screen.

A sink of fixed memory: the reading thread writes, any other thread copies, and none waits. `draw` returns the extremes
of any span in at most a few thousand points, however long the session is.

Minima and maxima of a long record at several widths, kept up as it grows, so that any span is drawn at once.

Level 0 is the record itself; an entry of level j holds first time, last time, minimum and maximum of every column over
4**j samples. A span is drawn from the finest level that reaches back far enough and has few enough entries in it; the
newest samples, not yet enough for an entry there, come from the levels below. No peak is lost at any width. NaN is no
value: an entry is NaN only if all its samples are.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections import deque

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.link.block import Block
from boat_daq.engine.sample_columns import channel_values, columns
from protocol.link.events import Samples
from protocol.link.sample_stream import PRESSURE_MAX_PA, PRESSURE_MIN_PA
from protocol.recording import ExtraChannel, SampleFlag

Columns2D = NDArray[np.float64]  # [column, entry]; column 0 never falls

FACTOR = 4
_LEVELS = 8  # 4**8 samples an entry: 8,192 of them are two months at 100 Hz
CAPACITY_MIN = 8_192


class ColumnRing:
    """The last entries of some columns, written by one thread, copied without a lock.

    The writer publishes how far it is about to write before it writes, and how far it has written afterwards. A reader
    copies, compares again, and drops what may have been overwritten meanwhile: always the oldest. Entries are counted
    from the first ever, so an index stays right while the ring turns.
    """

    def __init__(self, columns: int, capacity: int) -> None:
        self._data: Columns2D = np.empty((columns, capacity))
        self._capacity = capacity
        self._about_to = 0
        self.end = 0  # one behind the newest entry

    @property
    def oldest(self) -> int:
        """Index of the oldest entry that is still there."""
        return max(0, self._about_to - self._capacity)

    def append(self, entries: Columns2D) -> None:
        """Add entries, shape [columns, n]."""
        self._about_to = self.end + entries.shape[1]
        kept = entries[:, -self._capacity :]
        start = (self._about_to - kept.shape[1]) % self._capacity
        first = min(kept.shape[1], self._capacity - start)
        self._data[:, start : start + first] = kept[:, :first]
        self._data[:, : kept.shape[1] - first] = kept[:, first:]
        self.end = self._about_to

    def copy(self, start: int, stop: int) -> Columns2D:
        """Return entries `start` to `stop` as far as they are there, [columns, m]."""
        start, stop = max(start, self.oldest), min(stop, self.end)
        if stop <= start:
            return np.empty((len(self._data), 0))
        low, high = start % self._capacity, (stop - 1) % self._capacity + 1
        if low < high:
            copied = self._data[:, low:high].copy()
        else:
            copied = np.concatenate([self._data[:, low:], self._data[:, :high]], axis=1)
        return copied[:, max(0, self.oldest - start) :]

    def find(self, value: float, *, after: bool = False) -> int:
        """Return the first entry whose column 0 is not below `value` (`after`: above it)."""
        bisect = bisect_right if after else bisect_left
        return bisect(range(self.end), value, self.oldest, key=lambda at: float(self._data[0, at % self._capacity]))


class MinMaxPyramid:
    """Takes entries of [time, value, ...] and draws spans of them."""

    def __init__(self, columns: int, capacity: int) -> None:
        self.base = ColumnRing(columns, capacity)
        sizes = [max(CAPACITY_MIN, capacity // FACTOR**level) for level in range(1, _LEVELS + 1)]
        self._levels = [self.base, *(ColumnRing(2 * columns, size) for size in sizes)]
        self._carry = [np.empty((2 * columns, 0)) for _ in sizes]

    def append(self, entries: Columns2D) -> None:
        """Add entries [columns, n], n >= 1; times never fall."""
        self.base.append(entries)
        rows = np.repeat(entries, 2, axis=0)  # a sample is its own first and last time, minimum and maximum
        for at, level in enumerate(self._levels[1:]):
            rows = np.concatenate([self._carry[at], rows], axis=1)
            whole = rows.shape[1] - rows.shape[1] % FACTOR
            self._carry[at] = rows[:, whole:]
            if not whole:
                return
            rows = _fold(rows[:, :whole])
            level.append(rows)

    def draw(self, from_s: float, to_s: float, max_points: int) -> Columns2D:
        """Return a span as [columns, m], m <= `max_points`.

        Samples, or minima and maxima of stretches in turn; `max_points` is at least 64.
        """
        points_left = max_points - 6 * _LEVELS  # of which the entry that begins before the span takes two
        for at, level in enumerate(self._levels):
            start, stop = level.find(from_s), level.find(to_s, after=True)
            reaches_back = start > level.oldest or level.oldest == 0
            points = stop - start if at == 0 else 2 * (stop - start + 1)
            if reaches_back and points <= points_left:
                return self._draw_from(at, start if at == 0 else max(level.oldest, start - 1), to_s)
        return self._draw_from(_LEVELS, max(start, stop - points_left // 2), to_s)

    def _draw_from(self, at: int, start: int, to_s: float) -> Columns2D:
        """Return a level from an entry on, then what finer levels have behind its newest."""
        parts = []
        for level in reversed(self._levels[: at + 1]):
            stop = level.find(to_s, after=True)
            entries = level.copy(start, stop)
            parts.append(entries if level is self.base else _points(entries))
            start = max(start, stop) * FACTOR
        return np.concatenate(parts, axis=1)


def fold_columns(points: Columns2D, column_s: float) -> Columns2D:
    """Return points by columns of pixels, the extremes of each at its first and last time, [columns, m].

    The columns are anchored in time, so a picture that scrolls does not flicker.
    """
    if not points.shape[1]:
        return points
    column = np.floor(points[0] / column_s)
    first = np.concatenate([[0], np.flatnonzero(np.diff(column)) + 1])
    if points.shape[1] <= 2 * first.size:
        return points
    last = np.append(first[1:], points.shape[1]) - 1
    lowest, highest = np.fmin.reduceat(points, first, axis=1), np.fmax.reduceat(points, first, axis=1)
    lowest[0], highest[0] = points[0, first], points[0, last]
    return _in_order(lowest, highest)


def _in_order(lowest: Columns2D, highest: Columns2D) -> Columns2D:
    """Return extremes of stretches as points in the order of time: where values fall, the maximum comes first."""
    falls = np.zeros(lowest.shape, dtype=bool)
    if lowest.shape[1] > 3:
        falls[:, 1:-1] = highest[:, 2:] < lowest[:, :-2]
        falls[:, 0], falls[:, -2:] = falls[:, 1], falls[:, -3:-2]  # the newest may still change
    pairs = [np.where(falls, highest, lowest), np.where(falls, lowest, highest)]
    return np.stack(pairs, axis=2).reshape(len(lowest), -1)


def _fold(rows: Columns2D) -> Columns2D:
    """Return every four entries as one."""
    groups = rows.reshape(len(rows), -1, FACTOR)
    folded = np.empty(groups.shape[:2])
    folded[0], folded[1] = groups[0, :, 0], groups[1, :, -1]
    folded[2::2] = np.fmin.reduce(groups[2::2], axis=2)
    folded[3::2] = np.fmax.reduce(groups[3::2], axis=2)
    return folded


def _points(entries: Columns2D) -> Columns2D:
    """Return entries as points: their extremes at their first and last time."""
    return _in_order(entries[0::2], entries[1::2])


DEFAULT_CAPACITY = 360_000  # an hour at 100 Hz
LATER_US = 1_000_000
JUMP_S, PACE_MOST, SETTLED_S = 2.0, 100.0, 1.0  # see `RingBuffer._jumps`
CAMERA_CAPACITY = 108_000  # an hour at 30 frames/s
CAMERA_GAP_S, CAMERA_GAP = 0.2, 3.5  # no elongation is interpolated over a longer time, and over more intervals
_CAMERA = ExtraChannel("camera", "mm")
CAMERA_U = "camera_u_mm"
ARRIVALS_KEPT = 64  # blocks, of which the least delayed relates the host's clock to the board's
_IMPLAUSIBLE = int(SampleFlag.IMPLAUSIBLE)
_UNKNOWN = int(SampleFlag.PRESSURE_INVALID)
_NOT_SHOWN = _IMPLAUSIBLE | _UNKNOWN


class CameraTrace:
    """The elongations of a camera's frames in the screen's time; written by one thread, read by any other."""

    def __init__(self) -> None:
        self._frames = ColumnRing(3, CAMERA_CAPACITY)  # time, elongation, standard uncertainty
        self._last_s = -math.inf
        self.rest_mm = 0.0  # from which they count

    def append(self, time_s: float, elongation_mm: float, u_mm: float) -> None:
        """Add a frame; NaN where it gives no elongation."""
        self._last_s = max(time_s, self._last_s)
        self._frames.append(np.array([[self._last_s], [elongation_mm], [u_mm]]))

    def at(self, time_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return elongation and standard uncertainty at times that never fall, NaN where no frames are near."""
        unknown = np.full(time_s.size, math.nan)
        if not time_s.size or self._frames.end < 2:
            return unknown, unknown
        first, last = self._frames.find(float(time_s[0])) - 1, self._frames.find(float(time_s[-1]), after=True) + 1
        t, mm, u = self._frames.copy(first, last)
        if t.size < 2:
            return unknown, unknown
        steps = np.diff(t)
        after = np.clip(np.searchsorted(t, time_s), 1, t.size - 1)
        far = steps[after - 1] > max(CAMERA_GAP_S, CAMERA_GAP * float(np.median(steps)))
        known = ~far & (time_s >= t[0]) & (time_s <= t[-1])
        mm, u = (np.where(known, np.interp(time_s, t, y), math.nan) for y in (mm - self.rest_mm, u))
        return mm, u


class RingBuffer:
    """The newest samples. Columns: time_s, pressure_kpa, target_kpa, s1_mv, s2_mv .., then those of `others`.

    With a camera there are also camera_mm and camera_u_mm, interpolated between its frames. `time_s` is board time, 0
    at the first sample, continued by host time where the board's clock restarts or jumps. Implausible values are NaN.

    `mv_per_count`: vref_mv / 2**adc_bits; unused where the samples carry signals in mV. `others`: extra channels of the
    samples; each is kept under its `column`, in its own unit.
    """

    def __init__(
        self,
        n_sensors: int,
        *,
        mv_per_count: float,
        others: tuple[ExtraChannel, ...] = (),
        capacity: int = DEFAULT_CAPACITY,
    ) -> None:
        self.others = others
        self.target_kpa = math.nan  # stored with the samples that are appended
        self.newest_s, self.step_s = math.nan, math.inf  # time of the newest sample; mean interval in a block
        self._signals = slice(3, 3 + n_sensors)
        sensors = (f"s{n}_mv" for n in range(1, n_sensors + 1))
        self.names = ("time_s", "pressure_kpa", "target_kpa", *sensors, *(channel.column for channel in self.others))
        self._mv_per_count = mv_per_count
        self._pyramid = MinMaxPyramid(len(self.names), capacity)
        self._offset_us: int | None = None
        self._last_us = 0  # of the board, newest sample
        self._last_ns = 0  # of the host, the same
        self._since = (0, 0)  # of board and host, at the first sample of this clock
        self._delays_ns: deque[int] = deque(maxlen=ARRIVALS_KEPT)  # host time less screen time of the blocks
        self._camera: CameraTrace | None = None

    def __len__(self) -> int:
        """Return how many samples are kept one by one."""
        return self._pyramid.base.end - self._pyramid.base.oldest

    def __call__(self, block: Block) -> None:
        """Take the samples of a block."""
        for event in block.events:
            if isinstance(event, Samples) and len(event.array):
                self.append(event.array)

    def append(self, samples: NDArray[np.void]) -> None:
        """Take samples of `protocol.recording.sample_dtype`."""
        block = columns(samples, self._mv_per_count)
        time_us, flags = block.time_us, samples["flags"]
        entries = np.empty((len(self.names), len(samples)))
        entries[0] = (np.maximum.accumulate(time_us) + self._offset(time_us, samples["host_ns"])) * 1e-6
        entries[1] = block.pressure_kpa
        entries[2] = self.target_kpa
        entries[self._signals] = block.signal_mv.T
        if self.others:
            entries[self._signals.stop :] = list(channel_values(samples, self.others).values())
        if int(np.bitwise_or.reduce(flags)) & _NOT_SHOWN:
            pa = samples["pressure_pa"]  # that of a sample with an impossible signal is known
            known = (flags & _UNKNOWN == 0) & (pa >= PRESSURE_MIN_PA) & (pa <= PRESSURE_MAX_PA)
            entries[1, ~known] = np.nan
            entries[self._signals, (flags & _IMPLAUSIBLE) != 0] = np.nan
        self._pyramid.append(entries)
        if len(samples) > 1:
            self.step_s = float(entries[0, -1] - entries[0, 0]) / (len(samples) - 1)
        self.newest_s = float(entries[0, -1])

    @property
    def channels(self) -> tuple[ExtraChannel, ...]:
        """The columns beyond pressures and signals: those of `others`, then the camera's elongation."""
        return (*self.others, *([_CAMERA] if self._camera is not None else []))

    def add_camera(self, host_ns: int, elongation_mm: float | None, u_mm: float | None, rest_mm: float) -> None:
        """Take a frame of a camera, on the camera's thread. `elongation_mm`, `u_mm`: None where it gives none."""
        if not self._delays_ns:
            return
        if self._camera is None:
            self._camera = CameraTrace()
        self._camera.rest_mm = rest_mm
        values = (math.nan if value is None else value for value in (elongation_mm, u_mm))
        self._camera.append((host_ns - min(tuple(self._delays_ns))) * 1e-9, *values)

    def view(self, since_s: float | None = None, *, last: int | None = None) -> dict[str, NDArray[np.float64]]:
        """Return copies of the columns, sample by sample. All that is kept, from `since_s` on, or the `last` n."""
        base = self._pyramid.base
        start = base.oldest if since_s is None else base.find(since_s)
        if last is not None:
            start = max(start, base.end - last)
        return self._named(base.copy(start, base.end))

    def draw(
        self,
        from_s: float | None = None,
        to_s: float | None = None,
        *,
        max_points: int = 4000,
        column_s: float | None = None,
    ) -> dict[str, NDArray[np.float64]]:
        """Return the columns of a span, thinned to extremes.

        `from_s`, `to_s` are of the screen's time, None for all there is; `column_s` is the width of a column of pixels.
        """
        low = -math.inf if from_s is None else from_s
        high = math.inf if to_s is None else to_s
        points = self._pyramid.draw(low, high, max(64, max_points))
        return self._named(points if column_s is None else fold_columns(points, column_s))

    def time_of(self, board_us: int) -> float | None:
        """Return the screen's time of an instant of board time.

        None before the first sample, or from an earlier clock: more than a second after the newest sample.
        """
        if self._offset_us is None or board_us > self._last_us + LATER_US:
            return None
        return (board_us + self._offset_us) * 1e-6

    def _named(self, entries: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        columns = dict(zip(self.names, entries, strict=True))
        if self._camera is not None:
            columns[_CAMERA.column], columns[CAMERA_U] = self._camera.at(columns["time_s"])
        return columns

    def _offset(self, time_us: NDArray[np.int64], host_ns: NDArray[np.int64]) -> int:
        """Return what is added to board time so that the screen's time continues."""
        if self._offset_us is None:
            self._offset_us = -int(time_us[0])
            self._since = int(time_us[0]), int(host_ns[0])
        elif time_us[0] < self._last_us or self._jumps(int(time_us[0]), int(host_ns[0])):  # another clock
            passed_us = max(0, (int(host_ns[0]) - self._last_ns) // 1000)
            self._offset_us += self._last_us + passed_us - int(time_us[0])
            self._delays_ns.clear()
            self._since = int(time_us[0]), int(host_ns[0])
        self._last_us, self._last_ns = int(time_us.max()), int(host_ns[-1])
        self._delays_ns.append(self._last_ns - 1000 * (self._last_us + self._offset_us))
        return self._offset_us

    def _jumps(self, time_us: int, host_ns: int) -> bool:
        """Return whether the board's clock is ahead of what the host's allows: a board that restarted at any time.

        A virtual board may run faster than real time: its pace is measured once the clock is `SETTLED_S` old.
        """
        since_us, since_ns = self._since
        known_s = (self._last_ns - since_ns) * 1e-9
        pace = max(1.0, (self._last_us - since_us) * 1e-6 / known_s) if known_s >= SETTLED_S else PACE_MOST
        return (time_us - self._last_us) * 1e-6 > JUMP_S + 2.0 * pace * max(0, host_ns - self._last_ns) * 1e-9
