"""The shadow of the run: the current state of the actuator with its deviation, and the monitor of whole cycles.

Rules: a frame uses the reduced model only; a state outside its table is reported, never solved for. Without a
calibration the nominal actuator at this pressure is drawn, and labelled so. Lengths in mm, x across, z upwards from the
fixed base. Each complete cycle is reduced to figures once, on a helper thread.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from analysis.published import LOOP_HALF_WIDTH_MM
from analysis.shadow.model.held import Place, can_be_unstable, place_of
from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.formatting import THIN, count, duration, in_units, number
from boat_daq.viewmodels.live.live_model import LiveModel, OverlayModel, signals
from boat_daq.workflows.jobs import Background, JobRunner
from protocol.base.arrays import FloatArray
from protocol.base.units import MINUS, NOTHING, ShownUnits

if TYPE_CHECKING:
    from analysis.shadow.model.frames import Shadow, ShadowState
    from analysis.shadow.model.reduced import ReducedModel
    from analysis.shadow.monitoring.monitor import Alarm, CycleFigures
    from boat_daq.workflows.live_conversion import Conversion


THINNED_TO = 4000  # samples suffice for the figures of a cycle
LEAST_SAMPLES = 10  # of a cycle
FIRST_CYCLES = 5
_MISSING = object()
COLOUR_LEVELS = 24  # of colour
SCALES = {"displacement": (4.0, "mm", 1.0), "strain": (20.0, "%", 100.0)}  # full scale, unit, factor
_LENGTH_MM, RADIUS_MM = 75.0, 25.0
PRESSURES_KPA = (-45.0, 55.0)
TRACE_S, _TRACE_POINTS = 60.0, 1200
SEEN_KPA, SEEN_MM = 0.1, 0.02  # visible steps of pressure and elongation
COMPILING = ("missing code", "compiled code")  # jobs that end before the model is loaded


@dataclass(frozen=True, slots=True)
class ShadowPicture:
    """One picture of the pane.

    Attributes
    ----------
    rest : [k, 2] closed outline (x, z) mm at rest.
    corners : [quads, 4, 2] deformed elements, both halves; levels : [quads] colour steps from 0.
    guides : [2, k, 2]; tracked : [14, 2].
    nominal_mm, measured_mm : elongations; NaN where unknown.
    """

    rest: FloatArray
    corners: FloatArray
    levels: NDArray[np.int64]
    guides: FloatArray
    tracked: FloatArray
    nominal_mm: float
    measured_mm: float


BEYOND_KPA = 1.0
"""The interlock allows a little more vacuum than the table holds."""


@dataclass(frozen=True, slots=True)
class Moment:
    """The current measurement: pressure (kPa), elongation and U (k = 2, mm); NaN where unknown.

    `disagree` marks two sensors that contradict each other, `loading` a calibration that is not loaded yet.
    """

    pressure: float = math.nan
    measured: float = math.nan
    expanded: float = math.nan
    calibrated: bool = False
    disagree: bool = False
    loading: bool = False

    @property
    def visible(self) -> tuple[object, ...]:
        """Return the values in visible steps: two moments with the same ones draw the same picture."""
        return _step(self.pressure, SEEN_KPA), _step(self.measured, SEEN_MM)


REST_OUTLINE = np.array([[-RADIUS_MM, 0.0], [RADIUS_MM, 0.0], [RADIUS_MM, _LENGTH_MM], [-RADIUS_MM, _LENGTH_MM]])
NOTHING_DRAWN = (np.zeros((0, 4, 2)), np.zeros(0, np.int64), np.zeros((0, 0, 2)), np.zeros((0, 2)))


class ShadowLive:
    def __init__(self, live: LiveModel, jobs: JobRunner) -> None:
        self._live, self._jobs = live, jobs
        self._loading: Background[ReducedModel | tuple[Shadow, frozenset[Place]]] = Background("shadow")
        self._wanted, self._begun = False, False
        self._table: ReducedModel | None = None
        self.model: Shadow | None = None
        self.quantity = "displacement"
        self._last: tuple[tuple[object, ...], ShadowPicture] | None = None
        self._unstable: frozenset[Place] = frozenset()

    def prepare(self) -> None:
        """Load the table on a helper thread; let `poll` load the model there, once the jobs that compile have ended."""
        if not self._wanted:
            self._wanted = True
            self._loading.call(_load_table)

    @property
    def error_mm(self) -> float:
        """Return the greatest error of a tracked point over the held-out states of the table; NaN while it loads."""
        return math.nan if (table := self._nominal_table) is None else float(table.errors_mm[-1])

    @property
    def calibrated(self) -> bool:
        """Whether the unit of the board has a calibration, which may still be loading."""
        return self._live.inverse is not None or self._live.loading

    def poll(self) -> None:
        if self._wanted and not self._begun and not any(map(self._jobs.get, COMPILING)):
            self._begun = True
            self._loading.call(_load)
        loaded = self._loading.take()
        if isinstance(loaded, tuple):
            self.model, self._unstable = loaded
        elif loaded is not None:
            self._table = loaded

    def close(self) -> None:
        self._loading.close()

    def nominal_at(self, pressure_kpa: float) -> tuple[float, float] | None:
        """Return nominal elongation and half of its band at a pressure, mm; None while the table loads."""
        if (table := self._nominal_table) is None:
            return None
        mm, half = self._nominal(table, np.array([pressure_kpa]))
        return float(mm[0]), float(half[0])

    def nominal_curve(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray] | None:
        """Return pressures (kPa), nominal elongation and the ends of its band (mm); None while the table loads."""
        if (table := self._nominal_table) is None:
            return None
        pressure = np.linspace(*PRESSURES_KPA, 91)
        mm, half = self._nominal(table, pressure)
        keep = np.isfinite(mm) & np.isfinite(half)
        return pressure[keep], mm[keep], (mm - half)[keep], (mm + half)[keep]

    @property
    def _nominal_table(self) -> ReducedModel | None:
        return self._table if self.model is None else self.model.table

    @staticmethod
    def _nominal(table: ReducedModel, pressure_kpa: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return nominal elongation and half of its band, mm: two sd of the modulus and the loop of the actuator.

        The model is elastic: an actuator within two sd lies on a loop about its curve, by its history.
        """
        mm, sd = table.nominal_elongation(pressure_kpa)
        return mm, 2.0 * sd + LOOP_HALF_WIDTH_MM

    def trace(self) -> tuple[FloatArray, FloatArray]:
        """Return pressure (kPa) and measured elongation (mm) of the last minute."""
        ring, inverse = self._live.ring(), self._live.inverse
        if ring is None or inverse is None or not self._live.has_data():
            return np.zeros(0), np.zeros(0)
        columns = ring.view(self._live.now_s() - TRACE_S)
        pressure, mm = columns["pressure_kpa"], inverse(signals(columns)).mm
        # block means: the extremes that time plots draw are not simultaneous
        size = max(1, mm.size // _TRACE_POINTS)
        whole = mm.size // size * size
        return pressure[:whole].reshape(-1, size).mean(axis=1), mm[:whole].reshape(-1, size).mean(axis=1)

    def now(self) -> Moment:
        inverse, means = self._live.inverse, self._live.means()
        if not means:
            return Moment(calibrated=inverse is not None)
        pressure = means["pressure_kpa"]
        if inverse is None:
            return Moment(pressure, loading=self._live.loading)
        found = inverse(signals(means))
        return Moment(pressure, float(found.mm[0]), float(found.expanded_mm[0]), True, bool(found.disagree[0]))

    def picture(self) -> ShadowPicture:
        """Return the current picture; the same object until a visible change."""
        now = self.now()
        key = (*now.visible, id(self.model), self.quantity)
        if self._last is None or self._last[0] != key:
            self._last = (key, self._draw(now))
        return self._last[1]

    def _draw(self, now: Moment) -> ShadowPicture:
        place = self._place(now)
        if place is None or self.model is None:
            return ShadowPicture(REST_OUTLINE, *NOTHING_DRAWN, math.nan, now.measured)
        state = self.model.state(pressure_kpa=place[0], elongation_mm=place[1])
        return ShadowPicture(
            REST_OUTLINE,
            *self._elements(state),
            state.centrelines_mm,
            state.tracked_points_mm.reshape(-1, 2),
            state.nominal_elongation_mm,
            now.measured,
        )

    def _place(self, now: Moment) -> tuple[float, float] | None:
        """Return pressure (kPa) and elongation (mm) of the state drawn; None outside the table, or without a model.

        Just beyond its last pressure the state there is drawn.
        """
        if self.model is None:
            return None
        if not math.isfinite(now.pressure):
            return 0.0, 0.0
        low, high = self.model.table.pressure_range_kpa.tolist()
        kpa = min(max(now.pressure, low), high)
        if abs(kpa - now.pressure) > BEYOND_KPA:
            return None
        pressure = np.array(kpa)
        mm = now.measured if math.isfinite(now.measured) else float(self.model.table.nominal_elongation(pressure)[0])
        return (kpa, mm) if self.model.table.holds(pressure, np.array(mm)) else None

    def _elements(self, state: ShadowState) -> tuple[FloatArray, NDArray[np.int64]]:
        assert self.model is not None
        quads = self.model.topology.quads[:, :4]
        half = state.nodes_mm[quads]
        full, _, factor = SCALES[self.quantity]
        nodal = state.displacement_mm if self.quantity == "displacement" else state.strain
        values = nodal[quads].mean(axis=1) * factor
        levels = np.clip((values / full * COLOUR_LEVELS).astype(np.int64), 0, COLOUR_LEVELS - 1)
        return np.concatenate([half, half * [-1.0, 1.0]]), np.concatenate([levels, levels])

    def lines(self) -> tuple[tuple[str, str, str], ...]:
        """Return (name, value, state) of the current figures, which follow every change, unlike the picture."""
        now = self.now()
        place, lines = self._place(now), list(_measured_lines(now, self._live.units))
        if self.model is None:
            return (*lines, ("Model", "preparing \u2026" if self._wanted else NOTHING, ""))
        if place is None:
            text = f"\u25b2 not drawn: outside the reduced model ({self.model.table.rectangle})"
            return (*lines, ("Model", text.replace("-", MINUS), "warning"))
        if math.isfinite(now.pressure) and place[0] != now.pressure:
            text = f"\u25b2 drawn at {place[0]:.1f} kPa, the model's last state"
            return (*lines, ("Model", text.replace("-", MINUS), "warning"))
        (nominal,), (half,) = (value.tolist() for value in self._nominal(self.model.table, np.array([place[0]])))
        lines.append(("Model", in_units(self._live.units, "mm", nominal, 2, band=half), ""))
        deviation = now.measured - nominal
        if math.isfinite(deviation):
            band = LOOP_HALF_WIDTH_MM + math.hypot(half - LOOP_HALF_WIDTH_MM, now.expanded)
            inside = abs(deviation) <= band
            level, mark = ("ok", "\u25cf inside the band") if inside else ("warning", "\u25b2 outside the band")
            if math.isnan(band):
                level, mark = "", "U not known: not judged"
            lines.append(("Deviation", in_units(self._live.units, "mm", deviation, 2, band=band), level))
            lines.append(("", mark, level))
        if can_be_unstable(place[0], place[1] - nominal) and place_of(*place) in self._unstable:
            lines.append(("Stability", "\u25b2 in equilibrium, but not stable", "warning"))
        if now.disagree:
            lines.append(("Sensors", "\u25b2 contradict each other", "warning"))
        return tuple(lines)


def _load_table() -> ReducedModel:
    """Load what needs no machine code: the first reading of a first start is checked against it."""
    from analysis.shadow.model.table import load_table

    return load_table()


def _load() -> tuple[Shadow, frozenset[Place]]:
    """Load the model and its unstable held states, and compute one frame, which loads the machine code."""
    from analysis.shadow.model.frames import Shadow
    from analysis.shadow.model.table import default_unstable

    shadow = Shadow()
    shadow.state(pressure_kpa=20.0, elongation_mm=1.0)
    return shadow, default_unstable()


def _step(value: float, step: float) -> int | None:
    """Return the number of the step that `value` is on; None where it is unknown."""
    return round(value / step) if math.isfinite(value) else None


def _measured_lines(now: Moment, units: ShownUnits) -> tuple[tuple[str, str, str], ...]:
    if not math.isfinite(now.pressure):
        return (("Measured", "no data: drawn at rest", ""),)
    text, state = "no calibration: model shown", ""
    if math.isfinite(now.measured):
        text = in_units(units, "mm", now.measured, 2, band=now.expanded)
    elif now.loading:
        text = "loading the calibration \u2026"
    elif now.calibrated:
        text, state = "\u25b2 outside the calibration", "warning"
    return (("Measured", text, state), ("Pressure", in_units(units, "kPa", now.pressure, 1), ""))


@dataclass(frozen=True, slots=True)
class CycleMark:
    """One cycle: its begin (s of the ring), its mean deviation, the figures of the monitor."""

    cycle: int
    begin_s: float
    deviation_mm: float
    figures: CycleFigures


@dataclass(frozen=True, slots=True)
class Series:
    """A figure of every cycle: `value` reads it, `smallest` is the least span drawn, `change` draws its change."""

    title: str
    axis: str
    unit: str
    smallest: float
    value: Callable[[CycleMark], float]
    change: bool = False


SERIES = {
    "deviation": Series("Deviation from the model", "Deviation", "mm", 0.1, lambda m: m.deviation_mm),
    "gain": Series("Elongation, share of the model's", "Share", "%", 2.0, lambda m: 100.0 * m.figures.gain),
    "loss": Series("Leak, change", "Leak", "%/min", 10.0, lambda m: m.figures.loss_percent_per_min, change=True),
    "difference": Series("Sensor 1 \u2212 sensor 2", "Difference", "mm", 0.1, lambda m: m.figures.difference_mm),
}


class ShadowMonitor:
    """Follows the cycles of a run."""

    def __init__(self, model: Callable[[], Shadow | None], overlay: OverlayModel) -> None:
        self._model, self._overlay = model, overlay
        self._reducing: Background[tuple[CycleMark, list[Alarm], dict[str, float]]] = Background("monitor")
        self._monitor: Any = None
        self._taken: set[int] = set()
        self._run: object = _MISSING
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
                if inside.size < LEAST_SAMPLES:  # the ring no longer holds it, as after a resumption
                    continue
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
        return [self._mark(alarm.cycle).cycle for alarm in self.alarms]

    def verdict(self) -> str:
        """Return the result in a line: alarms, or the least change that would be found, with the false alarm rate."""
        if self.alarms:
            return f"{count(len(self.alarms), 'alarm')} in {count(len(self.marks), 'cycle')}"
        rate = "expected false alarms: 1 per 1" + THIN + "000 healthy cycles"
        if not self.marks:
            return f"no cycle yet; {rate}"
        return f"\u25cf none in {count(len(self.marks), 'cycle')}; {self.sight()}; {rate}"

    def sight(self) -> str:
        """Return the least leak and softening that would be found now, as text."""
        loss, gain = self._sight.get("loss", np.inf), 100.0 * self._sight.get("gain", np.inf)
        sizes = (("a leak", loss, "%/min"), ("softening", gain, "%"))
        known = [f"{what} from {number(size, 1)} {unit}" for what, size, unit in sizes if np.isfinite(size)]
        blind = [what for what, size, _ in sizes if not np.isfinite(size)]
        parts = [f"would detect {' and '.join(known)}"] * bool(known)
        return ", ".join(parts + [f"too few cycles yet to detect {' or '.join(blind)}"] * bool(blind))

    def rows(self) -> list[tuple[str, ...]]:
        """Return the alarms as text, the newest first: what, since when, found when, how sure, by which figure."""
        return [self._row(alarm) for alarm in reversed(self.alarms)]

    def _row(self, alarm: Alarm) -> tuple[str, ...]:
        since, found = self._mark(alarm.since_cycle), self._mark(alarm.cycle)
        may = f", may follow from {' and '.join(alarm.may_follow_from)}" if alarm.may_follow_from else ""
        size = f"{100 * alarm.shift:+z.1f} %" if alarm.unit == "" else f"{alarm.shift:+.3g} {alarm.unit}"
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
        self._reducing.close()
