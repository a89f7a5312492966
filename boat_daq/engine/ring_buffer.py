"""The last hour in memory, as columns: what the screen and the sequencer look at."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.blocks import Block


class RingBuffer:
    """A sink of fixed memory. Columns: time_s, pressure_kpa, target_kpa, s1_mv, s2_mv ..

    `time_s` is for the screen: board time, continued over segments, from 0 at the first sample. `target_kpa` is what
    the sequencer last set in the attribute of that name.
    """

    target_kpa: float

    def __init__(self, n_sensors: int, *, mv_per_count: float | None, capacity: int = 360_000) -> None:
        raise NotImplementedError

    def __call__(self, block: Block) -> None:
        """Take the samples of a block."""

    def view(self, since_s: float | None = None, *, last: int | None = None) -> dict[str, NDArray[np.float64]]:
        """Return copies of the columns, all, from `since_s` on, or the `last` n."""
        raise NotImplementedError

    def draw(
        self, from_s: float | None = None, to_s: float | None = None, *, max_points: int = 4000
    ) -> dict[str, NDArray[np.float64]]:
        """Return the columns of a span, thinned to extremes so that no column has more than `max_points`."""
        raise NotImplementedError
