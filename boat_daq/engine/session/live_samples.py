"""The samples of a session as they come: for the screen in a ring, for others through sinks."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from boat_daq.engine.display.ring_buffer import RingBuffer
from boat_daq.engine.link.block import Block
from boat_daq.engine.link.opening import OpenPort
from boat_daq.engine.session.guarded_controller import GuardedController
from boat_daq.engine.session.journal import Journal
from protocol.link.events import Samples
from protocol.recording import ExtraChannel

SampleSink: TypeAlias = Callable[[np.ndarray[Any, Any]], None]


class LiveSamples:
    """Passes on what the reading thread brings.

    `ring`: for the screen; none until the first sample, another one after `Session.connect`.
    """

    def __init__(self, control: GuardedController, journal: Journal, port: Callable[[], OpenPort | None]) -> None:
        self.ring: RingBuffer | None = None
        self._sinks: tuple[SampleSink, ...] = ()
        self._control, self._journal, self._port = control, journal, port

    def show(self, block: Block) -> None:
        """Pass a block's samples to ring and sinks, on the reading thread, without the lock."""
        arrays = [event.array for event in block.events if isinstance(event, Samples) and len(event.array)]
        if not arrays:
            return
        ring = self.ring
        if ring is None:
            port = self._port()
            link = port.link if port else None
            assert link is not None and link.n_sensors is not None  # known from the board before its first sample
            ring = self.ring = RingBuffer(
                link.n_sensors,
                mv_per_count=self._control.controller.mv_per_count,
                others=link.channels,
            )
        ring.target_kpa = self.target_kpa()
        ring(block)
        for sink in self._sinks:
            for array in arrays:
                sink(array)

    def target_kpa(self) -> float:
        """Return the pressure that is commanded now, NaN for none."""
        target_kpa = self._control.controller.target_kpa
        return math.nan if target_kpa is None else target_kpa

    def other_channels(self) -> tuple[ExtraChannel, ...]:
        """Return the extra channels of the samples that come now."""
        ring = self.ring  # another thread may take it away
        return ring.others if ring is not None else ()

    def add_sink(self, sink: SampleSink) -> Callable[[], None]:
        """Pass every block of samples to `sink` on the reading thread; return the function that removes it."""
        with self._control.lock:
            self._sinks = (*self._sinks, sink)

        def remove() -> None:
            with self._control.lock:
                self._sinks = tuple(other for other in self._sinks if other is not sink)

        return remove
