"""Minima and maxima of a long record at several widths, kept up as it grows, so that any span is drawn at once.

Level 0 is the record itself; an entry of level j holds first time, last time, minimum and maximum of every column over
4**j samples. A span is drawn from the finest level that reaches back far enough and has few enough entries in it; the
newest samples, not yet enough for an entry there, come from the levels below. No peak is lost at any width. NaN is no
value: an entry is NaN only if all its samples are.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right

import numpy as np
from numpy.typing import NDArray

Columns2D = NDArray[np.float64]  # [column, entry]; column 0 never falls

FACTOR = 4
LEVELS = 8  # 4**8 samples an entry: 8,192 of them are two months at 100 Hz
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
        n = entries.shape[1]
        self._about_to = self.end + n
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
    """Takes entries of [time, value, ...] and draws spans of them.

    Parameters
    ----------
    columns : of an entry, the time among them.
    capacity : entries of level 0.
    """

    def __init__(self, columns: int, capacity: int) -> None:
        self.base = ColumnRing(columns, capacity)
        sizes = [max(CAPACITY_MIN, capacity // FACTOR**level) for level in range(1, LEVELS + 1)]
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

        Samples, or minima and maxima of stretches in turn.

        Parameters
        ----------
        from_s, to_s : the span, both ends included; infinite for all there is.
        max_points : at least 64, of which the newest stretches take up to 48.
        """
        points_left = max_points - 6 * LEVELS  # of which the entry that begins before the span takes two
        for at, level in enumerate(self._levels):
            start, stop = level.find(from_s), level.find(to_s, after=True)
            reaches_back = start > level.oldest or level.oldest == 0
            points = stop - start if at == 0 else 2 * (stop - start + 1)
            if reaches_back and points <= points_left:
                return self._draw_from(at, start if at == 0 else max(level.oldest, start - 1), to_s)
        return self._draw_from(LEVELS, max(start, stop - points_left // 2), to_s)

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
    """Return points by columns of pixels.

    Minima at each column's first time, maxima at its last, [columns, m].

    The columns are anchored in time, so a picture that scrolls does not flicker. Points that are no more than two a
    column come back as they are. What is painted this way covers the same pixels as all of the points would, the next
    column of pixels aside; `boat-daq tradeoff decimation` measures it.

    Parameters
    ----------
    points : [columns, n], time first and never falling.
    column_s : width of a column of pixels, s.
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
    return np.stack([lowest, highest], axis=2).reshape(len(points), -1)


def _fold(rows: Columns2D) -> Columns2D:
    """Return every four entries as one."""
    groups = rows.reshape(len(rows), -1, FACTOR)
    folded = np.empty(groups.shape[:2])
    folded[0], folded[1] = groups[0, :, 0], groups[1, :, -1]
    folded[2::2] = np.fmin.reduce(groups[2::2], axis=2)
    folded[3::2] = np.fmax.reduce(groups[3::2], axis=2)
    return folded


def _points(entries: Columns2D) -> Columns2D:
    """Return entries as points: first time with the minima, last time with the maxima."""
    return np.stack([entries[0::2], entries[1::2]], axis=2).reshape(len(entries) // 2, -1)
