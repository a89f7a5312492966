"""The last hour in memory, as columns for the screen.

A sink of fixed memory: the reading thread writes, any other thread copies, and none waits. `draw` returns the extremes
of any span in at most a few thousand points, however long the session is.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.display.min_max_pyramid import MinMaxPyramid, fold_columns
from boat_daq.engine.link.reader import Block
from boat_daq.engine.sample_columns import columns
from protocol.link.events import Samples
from protocol.recording import SampleFlag

DEFAULT_CAPACITY = 360_000  # an hour at 100 Hz
LATER_US = 1_000_000
_IMPLAUSIBLE = int(SampleFlag.IMPLAUSIBLE)
_NOT_SHOWN = _IMPLAUSIBLE | int(SampleFlag.PRESSURE_INVALID)


class RingBuffer:
    """The newest samples. Columns: time_s, pressure_kpa, target_kpa, s1_mv, s2_mv ..

    `time_s` is for the screen: board time, 0 at the first sample, and continued where the board's clock restarts
    by the host time that passed. What the host found implausible is NaN here; the recording has it.

    Parameters
    ----------
    n_sensors : 1 to 4.
    mv_per_count : vref_mv / 2**adc_bits; unused where the samples carry signals in mV.
    capacity : samples kept one by one; thinned ones go back much further.

    Attributes
    ----------
    target_kpa : the present target pressure, NaN for none; stored with the samples that are appended.
    """

    def __init__(self, n_sensors: int, *, mv_per_count: float, capacity: int = DEFAULT_CAPACITY) -> None:
        self.target_kpa = math.nan
        self.names = ("time_s", "pressure_kpa", "target_kpa", *(f"s{n}_mv" for n in range(1, n_sensors + 1)))
        self._mv_per_count = mv_per_count
        self._pyramid = MinMaxPyramid(len(self.names), capacity)
        self._offset_us: int | None = None
        self._last_us = 0  # of the board, newest sample
        self._last_ns = 0  # of the host, the same

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
        entries[3:] = block.signal_mv.T
        if int(np.bitwise_or.reduce(flags)) & _NOT_SHOWN:
            entries[1, (flags & _NOT_SHOWN) != 0] = np.nan
            entries[3:, (flags & _IMPLAUSIBLE) != 0] = np.nan
        self._pyramid.append(entries)

    def view(self, since_s: float | None = None, *, last: int | None = None) -> dict[str, NDArray[np.float64]]:
        """Return copies of the columns, sample by sample.

        All that is kept, from `since_s` on, or the `last` n.
        """
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

        Parameters
        ----------
        from_s, to_s : the span in the screen's time; None for all there is.
        max_points : at least 64.
        column_s : width of a column of pixels; the extremes are then those of each such column.
        """
        low = -math.inf if from_s is None else from_s
        high = math.inf if to_s is None else to_s
        points = self._pyramid.draw(low, high, max(64, max_points))
        return self._named(points if column_s is None else fold_columns(points, column_s))

    def time_of(self, board_us: int) -> float | None:
        """Return the screen's time of an instant of board time.

        None before the first sample, or from an earlier clock.

        An instant is of an earlier clock where it lies more than a second after the newest sample.
        """
        if self._offset_us is None or board_us > self._last_us + LATER_US:
            return None
        return (board_us + self._offset_us) * 1e-6

    def _named(self, entries: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
        return dict(zip(self.names, entries, strict=True))

    def _offset(self, time_us: NDArray[np.int64], host_ns: NDArray[np.int64]) -> int:
        """Return what is added to board time so that the screen's time continues."""
        if self._offset_us is None:
            self._offset_us = -int(time_us[0])
        elif time_us[0] < self._last_us:  # the board's clock restarted
            passed_us = max(0, (int(host_ns[0]) - self._last_ns) // 1000)
            self._offset_us += self._last_us + passed_us - int(time_us[0])
        self._last_us, self._last_ns = int(time_us.max()), int(host_ns[-1])
        return self._offset_us
