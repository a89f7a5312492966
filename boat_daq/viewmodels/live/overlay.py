"""The last cycles, each from its own beginning, to be overlaid."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from analysis.arrays import FloatArray
from boat_daq.engine.plan import StepMark
from boat_daq.viewmodels.live.live_model import Ring, sensor_names

KEPT = 5
POINTS = 1200


@dataclass(frozen=True, slots=True)
class CycleTrace:
    """One cycle: time since its beginning and a signal a sensor."""

    number: int
    time_s: FloatArray
    signals: tuple[FloatArray, ...]


class OverlayModel:
    """The last `KEPT` cycles of the run.

    Parameters
    ----------
    ring : returns the current ring.
    steps : returns the steps of the run.
    time_of : converts board time (microseconds) to the ring's time; None where the ring does not hold it.
    """

    def __init__(
        self,
        ring: Callable[[], Ring | None],
        steps: Callable[[], tuple[StepMark, ...]],
        time_of: Callable[[int], float | None],
    ) -> None:
        self._ring, self._steps, self._time_of = ring, steps, time_of

    def cycles(self) -> list[CycleTrace]:
        """Return the traces, oldest first."""
        ring = self._ring()
        spans = self.spans()[-KEPT:]
        if ring is None or not spans:
            return []
        result = []
        for number, begin, end in spans:
            columns = ring.draw(begin, end, max_points=POINTS)
            signals = tuple(columns[name] for name in sensor_names(columns))
            result.append(CycleTrace(number, columns["time_s"] - begin, signals))
        return result

    def spans(self) -> list[tuple[int, float, float | None]]:
        """Return (cycle, begin, end) in the ring's time; the end of the current one is None."""
        spans: dict[int, tuple[float, float | None]] = {}
        for step in self._steps():
            begin = self._time_of(step.started_us)
            if step.cycle < 1 or begin is None:
                continue
            end = None if step.ended_us is None else self._time_of(step.ended_us)
            spans[step.cycle] = (spans.get(step.cycle, (begin, None))[0], end)
        return [(number, begin, end) for number, (begin, end) in sorted(spans.items())]
