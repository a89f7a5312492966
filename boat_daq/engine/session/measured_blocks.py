"""Samples for a consumer outside the program, a script or an outlet: taken on its own thread, never on the reader's.

A queue of fixed size lies between. The reading thread only appends to it; a consumer that is too slow loses the oldest
samples, is told how many, and delays nobody.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.sample_columns import channel_values, columns
from protocol.recording import ExtraChannel

if TYPE_CHECKING:
    import pandas as pd

HALF_US = 0.5e-6
CAPACITY = 1_200_000  # samples: two minutes at 10 kHz, about 50 MB


@dataclass(frozen=True, slots=True, repr=False)
class MeasuredBlock:
    """Consecutive samples, one row each (n), in the units of the recording."""

    index: NDArray[np.uint32]  # [n] sampling instants, counted from the start of the stream; a gap is loss
    time_s: NDArray[np.float64]  # [n] board time
    host_ns: NDArray[np.int64]  # [n] host's monotonic clock at the arrival
    pressure_kpa: NDArray[np.float64]  # [n] gauge
    target_kpa: NDArray[np.float64]  # [n] commanded, NaN while nothing is
    signal_mv: NDArray[np.float64]  # [n, sensors]
    state: NDArray[np.uint8]  # [n], see `protocol.recording`, as `flags`
    flags: NDArray[np.uint16]
    others: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)  # [n] each, by column, in its unit
    skipped: int = 0  # before this block, not taken in time by the script. They are recorded

    def __repr__(self) -> str:
        if not len(self):
            return f"<MeasuredBlock: no samples, {self.skipped} skipped>"
        span = f"{self.time_s[0]:.3f} s to {self.time_s[-1]:.3f} s, {self.pressure_kpa[-1]:.2f} kPa"
        signals = ", ".join(f"{mv:.1f}" for mv in self.signal_mv[-1])
        return f"<MeasuredBlock: {len(self)} samples, {span}, {signals} mV, {self.skipped} skipped>"

    @classmethod
    def of(
        cls,
        samples: NDArray[np.void],
        target_kpa: NDArray[np.float64],
        mv_per_count: float,
        others: tuple[ExtraChannel, ...],
        skipped: int,
    ) -> MeasuredBlock:
        """Return samples of `protocol.recording.sample_dtype` in the lab's units.

        `mv_per_count` is unused where the samples carry signals.
        """
        block = columns(samples, mv_per_count)
        time_s = block.time_us.astype(np.float64) * 1e-6
        given = (block.pressure_kpa, target_kpa, block.signal_mv, block.state, block.flags)
        values = channel_values(samples, others)
        return cls(samples["index"], time_s, samples["host_ns"], *given, values, skipped)

    def __len__(self) -> int:
        return len(self.time_s)

    def first(self, n: int) -> MeasuredBlock:
        arrays = {name: getattr(self, name)[:n] for name in _ARRAYS}
        others = {name: values[:n] for name, values in self.others.items()}
        return MeasuredBlock(**arrays, others=others, skipped=self.skipped)

    def to_frame(self) -> pd.DataFrame:
        """Return the samples as a pandas frame, in the columns of an exported CSV."""
        import pandas as pd

        signals = {f"s{i + 1}_mv": signal for i, signal in enumerate(self.signal_mv.T)}
        head = {name: getattr(self, name) for name in ("index", "time_s", "pressure_kpa", "target_kpa")}
        return pd.DataFrame({**head, **signals, "state": self.state, "flags": self.flags, **self.others})


_ARRAYS = [each.name for each in fields(MeasuredBlock) if each.name not in ("others", "skipped")]


class SampleQueue:
    """A sink of `Session.live` that another thread empties.

    `target_kpa`, `mv_per_count` and `others` return those of the session now. Beyond `capacity` samples the oldest are
    discarded, and counted.
    """

    def __init__(
        self,
        target_kpa: Callable[[], float],
        mv_per_count: Callable[[], float],
        others: Callable[[], tuple[ExtraChannel, ...]] = tuple,
        capacity: int = CAPACITY,
    ) -> None:
        self._target_kpa, self._mv_per_count, self._others = target_kpa, mv_per_count, others
        self._capacity = capacity
        self._waiting: deque[tuple[NDArray[np.void], float, tuple[ExtraChannel, ...]]] = deque()
        self._size = self._skipped = 0
        self._lock = threading.Lock()

    def __call__(self, samples: NDArray[np.void]) -> None:
        """Append samples; called on the reading thread."""
        with self._lock:
            self._waiting.append((samples, self._target_kpa(), self._others()))
            self._size += len(samples)
            while self._size > self._capacity and len(self._waiting) > 1:
                dropped = self._waiting.popleft()[0]
                self._size -= len(dropped)
                self._skipped += len(dropped)

    def take(self) -> MeasuredBlock | None:
        """Return all that waits as one block; None where nothing does.

        Samples of another board, or with other channels, are left for the next call.
        """
        with self._lock:
            if not self._waiting:
                return None
            taken = [self._waiting.popleft()]
            dtype, others = taken[0][0].dtype, taken[0][2]
            while self._waiting and self._waiting[0][0].dtype == dtype and self._waiting[0][2] == others:
                taken.append(self._waiting.popleft())
            self._size -= sum(len(samples) for samples, _, _ in taken)
            skipped, self._skipped = self._skipped, 0
        target = np.repeat([kpa for _, kpa, _ in taken], [len(samples) for samples, _, _ in taken])
        samples = np.concatenate([part for part, _, _ in taken])
        return MeasuredBlock.of(samples, target, self._mv_per_count(), others, skipped)


def blocks(
    queue: SampleQueue, running: Callable[[], bool], seconds: float | None, every_s: float
) -> Iterator[MeasuredBlock]:
    """Yield the blocks of a queue.

    `seconds` of board time, None for as long as `running`; the queue is looked at `every_s`.
    """
    until_s = math.inf if seconds is None else None
    while True:
        more = running()
        block = queue.take()
        if block is not None:
            if until_s is None:
                until_s = block.time_s[0] + (seconds or 0.0)
            wanted = int(np.searchsorted(block.time_s, until_s - HALF_US))
            if wanted:
                yield block.first(wanted)
            if wanted < len(block):
                return
        elif not more:
            return
        time.sleep(every_s)
