"""A ring of columns in fixed memory, written by one thread and copied by any other without a lock.

The writer publishes how far it is about to write before it writes, and how far it has written afterwards. A reader
copies, compares again, and drops what may have been overwritten meanwhile: always the oldest. Entries are counted from
the first ever, so an index stays right while the ring turns.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right

import numpy as np
from numpy.typing import NDArray

Columns2D = NDArray[np.float64]  # [column, entry]; column 0 never falls


class ColumnRing:
    """The last `capacity` entries of `columns` columns."""

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
        """Return the index of the first entry whose column 0 is not below `value` (`after`: is above it)."""
        bisect = bisect_right if after else bisect_left
        return bisect(range(self.end), value, self.oldest, key=lambda at: float(self._data[0, at % self._capacity]))
