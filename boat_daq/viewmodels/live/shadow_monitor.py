"""Whole cycles for the monitor of the shadow, and its alarms.

Each complete cycle is taken from the ring once and reduced to figures on a helper thread. A cycle that the ring no
longer holds, or that no calibration converts, is left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.arrays import FloatArray
from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.viewmodels.common.formatting import MINUS, THIN, count, duration, number
from boat_daq.viewmodels.common.jobs import Background
from boat_daq.viewmodels.live.live_model import OverlayModel, signals

if TYPE_CHECKING:
    from analysis.shadow.model.frames import Shadow
    from analysis.shadow.monitoring.monitor import Alarm, CycleFigures
    from boat_daq.viewmodels.live.conversion import Conversion

THINNED_TO = 4000  # samples suffice for the figures of a cycle
FIRST_CYCLES = 5
MISSING = object()


@dataclass(frozen=True, slots=True)
class CycleMark:
    """One cycle: its begin (s of the ring), its mean deviation, the figures of the monitor."""

    cycle: int
    begin_s: float
    deviation_mm: float
    figures: CycleFigures


@dataclass(frozen=True, slots=True)
class Series:
    """A figure of every cycle as the page draws it; `value` reads it from a mark, `smallest` is the least span drawn.

    `change` is for a figure with a level from hysteresis alone: its change from the first cycles is drawn.
    """

    title: str
    axis: str
    unit: str
    smallest: float
    value: Callable[[CycleMark], float]
    change: bool = False


SERIES = {
    "deviation": Series("Deviation from nominal", "Deviation", "mm", 0.1, lambda m: m.deviation_mm),
    "gain": Series("Elongation, share of nominal", "Share", "%", 2.0, lambda m: 100.0 * m.figures.gain),
    "loss": Series("Leak, change", "Leak", "%/min", 10.0, lambda m: m.figures.loss_percent_per_min, change=True),
    "difference": Series("Sensor 1 \u2212 sensor 2", "Difference", "mm", 0.1, lambda m: m.figures.difference_mm),
}


class ShadowMonitor:
    """Follows the cycles of a run.

    Parameters
    ----------
    model : returns the shadow, or None.
    overlay : has the current ring and locates each cycle in it.
    """

    def __init__(self, model: Callable[[], Shadow | None], overlay: OverlayModel) -> None:
        self._model, self._overlay = model, overlay
        self._reducing: Background[tuple[CycleMark, list[Alarm], dict[str, float]]] = Background("monitor")
        self._monitor: Any = None
        self._taken: set[int] = set()
        self._run: object = MISSING
        self.marks: list[CycleMark] = []
        self.alarms: list[Alarm] = []
        self._sight: dict[str, float] = {}  # least lasting shift of each figure that would raise an alarm
        self._reported = 0
        self.revision = 0

    def follow(self, snapshot: SessionSnapshot, conversion: Conversion | None) -> None:
        """Submit the cycles that have ended since the last call; a new recording begins a new history."""
        if snapshot.recording is not None and snapshot.recording != self._run:
            self._run = snapshot.recording
            self._monitor, self._taken, self.marks, self.alarms, self._reported = None, set(), [], [], 0
            self._sight = {}
            self.revision += 1
        shadow, progress, ring = self._model(), snapshot.progress, self._overlay.ring()
        if shadow is None or conversion is None or progress is None or ring is None:
            return
        for cycle, begin, end in self._overlay.spans():
            if cycle < progress.cycle and end is not None and cycle not in self._taken:
                self._taken.add(cycle)
                columns = ring.view(begin)
                inside = np.flatnonzero(columns["time_s"] <= end)
                inside = inside[:: max(1, inside.size // THINNED_TO)]
                thinned = {name: values[inside] for name, values in columns.items()}
                self._reducing.call(self._reduce, shadow, conversion, cycle, thinned)

    def _reduce(
        self, shadow: Shadow, conversion: Conversion, number: int, cycle: dict[str, FloatArray]
    ) -> tuple[CycleMark, list[Alarm], dict[str, float]]:
        # imported on the helper thread, not with the window
        from analysis.shadow.monitoring.monitor import Monitor, deviation_mm

        if self._monitor is None:
            self._monitor = Monitor(shadow.table)
        each = conversion.each(signals(cycle))
        figures = self._monitor.figures(cycle["time_s"], cycle["pressure_kpa"], each)
        apart = deviation_mm(shadow.table, cycle["pressure_kpa"], conversion(signals(cycle)).mm)
        known = apart[np.isfinite(apart)]
        deviation = float(known.mean()) if known.size else np.nan
        mark = CycleMark(number, float(cycle["time_s"][0]), deviation, figures)
        return mark, self._monitor.take(figures), self._monitor.smallest_shift()

    def poll(self) -> list[str]:
        """Return the new alarms as sentences.

        Raises
        ------
        AnalysisError : a cycle could not be reduced; it is left out, and the next call continues after it.
        """
        reported = self._reported
        while (reduced := self._reducing.take()) is not None:
            mark, alarms, self._sight = reduced
            self.marks.append(mark)
            self.alarms += alarms
            self.revision += 1
        self._reported = len(self.alarms)
        return [alarm.sentence for alarm in self.alarms[reported:]]

    def series(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return cycle numbers and a figure of each, by its key in `SERIES`; NaN where the cycle has none."""
        figure = SERIES[name]
        values = np.array([figure.value(m) for m in self.marks])
        first = values[:FIRST_CYCLES][np.isfinite(values[:FIRST_CYCLES])]
        if figure.change and first.size:
            values = values - np.median(first)
        return np.array([float(m.cycle) for m in self.marks]), values

    def alarm_cycles(self) -> list[int]:
        """Return the cycles in which an alarm was found."""
        return [self._mark(alarm.cycle).cycle for alarm in self.alarms]

    def verdict(self) -> str:
        """Return the result in a line: alarms, or the least change that would be found, with the false alarm rate."""
        if self.alarms:
            return f"{count(len(self.alarms), 'alarm')} in {count(len(self.marks), 'cycle')}"
        rate = "expected false alarms: 1 per 1" + THIN + "000 healthy cycles"
        if not self.marks:
            return f"none; {rate}"
        return f"\u25cf none in {count(len(self.marks), 'cycle')}; {self.sight()}; {rate}"

    def sight(self) -> str:
        """Return the least leak and softening that would be found now, as text."""
        loss, gain = self._sight.get("loss", np.inf), 100.0 * self._sight.get("gain", np.inf)
        sizes = (("a leak", loss, "%/min"), ("softening", gain, "%"))
        known = [f"{what} from {number(size, 1)} {unit}" for what, size, unit in sizes if np.isfinite(size)]
        blind = [what for what, size, _ in sizes if not np.isfinite(size)]
        parts = [f"would find {' and '.join(known)}"] * bool(known)
        return ", ".join(parts + [f"too few cycles yet to find {' or '.join(blind)}"] * bool(blind))

    def rows(self) -> list[tuple[str, ...]]:
        """Return the alarms as text, the newest first: what, since when, found when, how sure, by which figure."""
        return [self._row(alarm) for alarm in reversed(self.alarms)]

    def _row(self, alarm: Alarm) -> tuple[str, ...]:
        since, found = self._mark(alarm.since_cycle), self._mark(alarm.cycle)
        may = f", may follow from {' and '.join(alarm.may_follow_from)}" if alarm.may_follow_from else ""
        size = f"{100 * alarm.shift:+.1f} %" if alarm.unit == "" else f"{alarm.shift:+.3g} {alarm.unit}"
        later = found.cycle - since.cycle
        return (
            alarm.fault.capitalize(),
            f"cycle {since.cycle}, {duration(since.begin_s)}",
            f"cycle {found.cycle}, {later} later" if later else f"cycle {found.cycle}, immediately",
            f"{number(min(alarm.healthy_cycles, 1e9), 0)} cycles{'' if alarm.independent else ' or fewer'}",
            f"{alarm.figure} {size}{may}".replace("-", MINUS),
        )

    def _mark(self, place: int) -> CycleMark:
        """Return the mark of the monitor's own count of cycles, from 1, without those left out."""
        return self.marks[min(max(place, 1), len(self.marks)) - 1]

    def close(self) -> None:
        """End the helper thread."""
        self._reducing.close()
