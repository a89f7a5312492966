"""Whole cycles for the shadow's monitor, and what it says of them.

Each complete cycle is taken from the ring once and boiled down on a helper thread; alarms come back as sentences. A
cycle that the ring no longer holds, or that no calibration converts, is left out.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.session import SessionSnapshot
from boat_daq.viewmodels.live import Ring, signals
from boat_daq.viewmodels.overlay import OverlayModel

if TYPE_CHECKING:
    from analysis.shadow.shadow import Shadow
    from boat_daq.viewmodels.conversion import Conversion

Array = NDArray[np.float64]
THINNED_TO = 4000  # samples of a cycle are enough for its figures
MISSING = object()


@dataclass(frozen=True, slots=True)
class CycleMark:
    """What one cycle was found to be: its mean deviation, and the monitor's own figures."""

    cycle: int
    deviation_mm: float
    gain: float


class ShadowMonitor:
    """Follows a run's cycles.

    Parameters
    ----------
    model : gives the shadow of the moment, or None.
    overlay : knows where each cycle lies in the ring.
    ring : gives the ring of the moment.
    """

    def __init__(
        self, model: Callable[[], Shadow | None], overlay: OverlayModel, ring: Callable[[], Ring | None]
    ) -> None:
        self._model, self._overlay, self._ring = model, overlay, ring
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="monitor")
        self._futures: list[Future[tuple[CycleMark, list[str]]]] = []
        self._monitor: Any = None
        self._taken: set[int] = set()
        self._run: object = MISSING
        self.marks: list[CycleMark] = []
        self.alarms: list[str] = []
        self.revision = 0

    def follow(self, snapshot: SessionSnapshot, conversion: Conversion | None) -> None:
        """Hand over the cycles that have ended since the last call; a new recording begins a new history."""
        if snapshot.recording is not None and snapshot.recording != self._run:
            self._run = snapshot.recording
            self._monitor, self._taken, self.marks, self.alarms = None, set(), [], []
            self.revision += 1
        shadow, progress = self._model(), snapshot.progress
        if shadow is None or conversion is None or progress is None:
            return
        ended = [span for span in self._overlay.spans() if span[0] < progress.cycle and span[2] is not None]
        for number, begin, end in ended:
            if number not in self._taken:
                self._taken.add(number)
                self._hand_over(shadow, conversion, number, begin, float(end or begin))

    def _hand_over(self, shadow: Shadow, conversion: Conversion, number: int, begin: float, end: float) -> None:
        ring = self._ring()
        if ring is None:
            return
        columns = ring.view(begin)
        inside = np.flatnonzero(columns["time_s"] <= end)
        inside = inside[:: max(1, inside.size // THINNED_TO)]
        cycle = {name: values[inside] for name, values in columns.items()}
        self._futures.append(self._pool.submit(self._boil_down, shadow, conversion, number, cycle))

    def _boil_down(
        self, shadow: Shadow, conversion: Conversion, number: int, cycle: dict[str, Array]
    ) -> tuple[CycleMark, list[str]]:
        # loaded here, on the helper thread, and not with the window
        from analysis.shadow.monitor import Monitor, cycle_figures, deviation_mm

        if self._monitor is None:
            self._monitor = Monitor(shadow.table)
        each = conversion.each(signals(cycle))
        figures = cycle_figures(shadow.table, cycle["time_s"], cycle["pressure_kpa"], each)
        apart = deviation_mm(shadow.table, cycle["pressure_kpa"], conversion(signals(cycle)).mm)
        alarms = [alarm.sentence for alarm in self._monitor.take(figures)]
        return CycleMark(number, float(np.nanmean(apart)), figures.gain), alarms

    def poll(self) -> list[str]:
        """Return the alarms that are new.

        Raises
        ------
        AnalysisError : a cycle could not be judged.
        """
        fresh: list[str] = []
        while self._futures and self._futures[0].done():
            mark, alarms = self._futures.pop(0).result()
            self.marks.append(mark)
            fresh += alarms
            self.revision += 1
        self.alarms += fresh
        return fresh

    def deviations(self) -> tuple[Array, Array]:
        """Return cycle numbers and their mean deviation from nominal, mm."""
        return np.array([float(m.cycle) for m in self.marks]), np.array([m.deviation_mm for m in self.marks])

    def close(self) -> None:
        """Let the thread end."""
        self._pool.shutdown(wait=False, cancel_futures=True)
