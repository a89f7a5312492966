"""The sequence: the plan in a form, its staircase, and the buttons allowed in each state of the session.

Rules: a plan is checked as it is typed, by the rules of `Plan`; a refusal names the field and the reason. The buttons
are one table over the states.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from boat_daq.engine.control.elongation import Regulator
from boat_daq.engine.control.sequencer import READING_S, VENTED_KPA
from boat_daq.engine.control.watchdog import FAST, LONGEST_MS, REAL_TIME_MS
from boat_daq.engine.plan import Plan, built_in_plans, plan_from_toml
from boat_daq.engine.session.session import Session
from boat_daq.engine.snapshot import Limits, LinkState, Phase, SessionSnapshot, SessionState
from boat_daq.engine.toml_values import BadValue, read_text
from boat_daq.formatting import as_shown, count, duration, in_units, stored_number, target
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.common.services import Change, UndoHistory
from boat_daq.viewmodels.live.connection import ENDED
from protocol.base.arrays import FloatArray
from protocol.base.errors import BoatDaqError, RequestError
from protocol.base.units import MINUS, STORED_UNITS, ShownUnits, as_text
from protocol.base.whole_file import write_whole
from protocol.recording import SampleFlag


@dataclass(frozen=True, slots=True)
class Entry:
    """One field of the plan's form."""

    key: str
    label: str
    unit: str
    help: str


_WHOLE = ("cycles",)  # entries that are whole numbers
PLAN_ENTRIES = (
    Entry("cycles", "Cycles", "", "Complete cycles, each from the highest pressure to the lowest and back."),
    Entry("high_kpa", "Highest", "kPa", "Pressure at which every cycle begins and ends."),
    Entry("low_kpa", "Lowest", "kPa", "Pressure at which every cycle reverses."),
    Entry("step_kpa", "Step", "kPa", "Distance between the plateaus of a staircase."),
    Entry("ramp_kpa_per_s", "Ramp", "kPa/s", "Rate of change of pressure towards a target."),
    Entry("min_dwell_s", "Shortest hold", "s", "Minimum duration of a plateau."),
    Entry("max_dwell_s", "Longest hold", "s", "A plateau that is not steady after this time is marked."),
    Entry("tolerance_kpa", "Tolerance", "kPa", "Distance from the target at which the pressure counts as reached."),
    Entry("settling_s", "Settling", "s", "Time after reaching the target that is left out of the mean."),
)

S = SessionState
STATE_TEXTS = {  # shape, text, buttons
    S.IDLE: ("\u25cb", "Idle", ("arm",)),
    S.ARMED: ("\u25d4", "Armed", ("start", "disarm")),
    S.RUNNING: ("\u25b6", "Running", ("pause", "stop")),
    S.PAUSED: ("\u2016", "Paused", ("resume", "stop")),
    S.FINISHING: ("\u25d1", "Finishing", ()),
    S.ABORTED: ("\u25a0", "Stopped early", ("arm",)),
    S.FAULT: ("\u25a0", "Fault", ("clear",)),
}
AT_REST = (S.IDLE, S.ABORTED)
_RESTING = (S.IDLE, S.ARMED, S.ABORTED, S.FAULT, S.PAUSED)  # nothing is commanded, unless by hand
_FREE = (S.IDLE, S.ARMED)  # a pressure may stay
_LOST = "Link lost, pressure unknown"
UNKNOWN = {
    LinkState.LOST: _LOST, LinkState.OPENING: _LOST, LinkState.SILENT: "No data, pressure unknown",
    LinkState.CLOSED: "Disconnected, pressure unknown",
}  # fmt: skip
REACHED_MM = 0.01  # of the shaped setpoint from the target
NEAR_MM = 0.15  # of the measured elongation, where its U is less
HELD = (S.ARMED, S.RUNNING, S.PAUSED, S.FINISHING)  # the session has a plan
PHASE_WORDS = {
    Phase.RAMPING: "ramping to", Phase.SETTLING: "settling at", Phase.DWELLING: "holding", Phase.VENTING: "venting to",
    Phase.WAITING_FOR_READING: "waiting for the reading at", Phase.ASSESSING: "computing U at",
}  # fmt: skip
BRANCH_WORDS = {"start": "first plateau", "unloading": "unloading", "loading": "loading", "end": "end"}


@lru_cache(maxsize=4)
def staircase(plan: Plan) -> tuple[FloatArray, FloatArray]:
    """Return time (s) and pressure (kPa) of a plan at the ends of ramps and steps; of a plan in mm the elongation."""
    if plan.kind == "profile":
        return _profile(plan)
    time_s, pressure = [0.0], [0.0]
    for step in plan.steps:
        begin, before = time_s[-1], pressure[-1]
        whole = plan.step_duration_s(before, step.target_kpa)
        ramp = min(abs(step.target_kpa - before) / plan.ramp_kpa_per_s, whole)
        time_s += [begin + ramp, begin + whole]
        pressure += [step.target_kpa, step.target_kpa]
    return np.array(time_s), np.array(pressure)


def _profile(plan: Plan) -> tuple[FloatArray, FloatArray]:
    begins, values, times = step_begins(plan), [0.0], [0.0]
    for begin, step in zip(begins, plan.steps, strict=False):
        assert step.segment is not None
        moving, whole = step.segment.moving_s(step.start), step.segment.duration_s(step.start)
        points = round(16 * step.segment.periods) + 2
        at = [*np.linspace(0.0, moving, points).tolist(), whole]
        times += [float(begin) + t for t in at]
        values += [step.segment.at(t, step.start)[0] for t in at]
    return np.array(times), np.array(values)


@lru_cache(maxsize=4)
def step_begins(plan: Plan) -> FloatArray:
    """Return the estimated begin of each step of a plan, and the end of the last, s."""
    if plan.kind != "profile":
        return staircase(plan)[0][::2]
    durations = [step.segment.duration_s(step.start) for step in plan.steps if step.segment is not None]
    return np.concatenate([[0.0], np.cumsum(durations)])


@dataclass(frozen=True, slots=True)
class StaircaseDrawing:
    """A staircase in the unit square, y upwards: line, done part as a polygon, limits and zero as heights."""

    line: tuple[tuple[float, float], ...]
    done: tuple[tuple[float, float], ...]
    limits: tuple[float, ...]
    zero: float


def drawing(plan: Plan, done_to_s: float, limits_kpa: tuple[float, float] | None) -> StaircaseDrawing:
    """Return the staircase in the unit square, its first `done_to_s` seconds as a polygon that ends with "now"."""
    empty = _undone(plan, limits_kpa)
    if done_to_s <= 0:
        return empty
    x = done_to_s / (float(staircase(plan)[0][-1]) or 1.0)
    across, heights = zip(*empty.line, strict=True)
    done = (*(point for point in empty.line if point[0] < x), (x, float(np.interp(x, across, heights))))
    return replace(empty, done=((0.0, empty.zero), *done, (x, empty.zero)))


@lru_cache(maxsize=4)
def _undone(plan: Plan, limits_kpa: tuple[float, float] | None) -> StaircaseDrawing:
    """Return the staircase in the unit square, nothing done; cached while the plan is the same."""
    (time_s, pressure_kpa), edges = staircase(plan), limits_kpa or ()
    margin = 0.3 if plan.controls_elongation else 4.0  # mm or kPa
    low = min(float(pressure_kpa.min()), 0.0, *edges) - margin
    high = max(float(pressure_kpa.max()), 0.0, *edges) + margin
    across = time_s / (float(time_s[-1]) or 1.0)
    line = tuple(zip(across.tolist(), ((pressure_kpa - low) / (high - low)).tolist(), strict=True))
    return StaircaseDrawing(line, (), tuple((edge - low) / (high - low) for edge in edges), -low / (high - low))


@lru_cache(maxsize=4)
def _extent(plan: Plan) -> tuple[int, float]:
    """Return number of plateaus and duration (s) of a plan; cached, since a hundred cycles have thousands of steps."""
    return sum(step.plateau for step in plan.steps), plan.duration_s


class SequenceModel:
    """The plan and the current run; the plan is kept in the preferences unless it is invalid."""

    def __init__(
        self,
        session: Session,
        undo: UndoHistory,
        preferences: Preferences,
        regulator: Callable[[], Regulator | None] = lambda: None,
    ) -> None:
        self._regulator, self.hold = regulator, False  # whether a stop of the control holds the pressure
        self.session, self._undo, self._preferences = session, undo, preferences
        self.plans = dict(built_in_plans())
        self.plan = self.plans["calibration"]
        with suppress(BoatDaqError):
            self.plan = plan_from_toml(preferences.get("plan", self.plan.to_toml()), "the stored plan")
        self.plans.setdefault(self.plan.name, self.plan)
        self.wait_for_reading = preferences.get("wait_for_reading", True)
        self.refused: dict[str, str] = {}  # field -> why its last entry is invalid
        self._typed: dict[str, int | float] = {}  # invalid alone; tried again with the next entry
        self.revision = 0
        self.units = STORED_UNITS  # in which the plan is shown and typed
        self._needs_readings = False

    def _store(self) -> None:
        self.revision += 1
        self._preferences.set("plan", self.plan.to_toml())
        self._preferences.set("wait_for_reading", self.wait_for_reading)

    @staticmethod
    def _estimate(plan: Plan, *, waits: bool, short: bool = False) -> str:
        plateaus, lasts_s = _extent(plan)
        size = f"{count(plateaus, 'plateau')}, " if plateaus else ""
        if not (waits and plateaus):
            return f"{size}about {duration(lasts_s)}"
        run, whole = (
            f"{s:.0f} s" if s < 60 else f"{s / 60:.0f} min" for s in (lasts_s, lasts_s + plateaus * READING_S)
        )
        return f"{size}about {whole}" if short else f"{size}{run} + your readings, about {whole}"

    def in_force(self, snapshot: SessionSnapshot) -> Plan:
        """Return the plan that is armed or running, else the chosen one."""
        held = snapshot.state in HELD and snapshot.plan is not None
        return snapshot.plan if held and snapshot.plan is not None else self.plan

    def waits_in_force(self, snapshot: SessionSnapshot) -> bool:
        return self.wait_for_reading if self.in_force(snapshot) == self.plan else self._needs_readings

    def estimate(self, snapshot: SessionSnapshot) -> str:
        return self._estimate(self.in_force(snapshot), waits=self.waits_in_force(snapshot))

    def lines(self, snapshot: SessionSnapshot) -> list[str]:
        """Return name, plateaus and time of the plan that is drawn, then shorter texts."""
        if self.refused and snapshot.state not in HELD:
            return ["the plan has an invalid entry"]
        plan, whole = self.in_force(snapshot), self.estimate(snapshot)
        short = self._estimate(plan, waits=self.waits_in_force(snapshot), short=True)
        return [f"{plan.name}: {whole}", whole, short]

    def drawing(self, snapshot: SessionSnapshot) -> StaircaseDrawing:
        """Return the plan that is armed, runs or would run next, with limits and the done part."""
        limits, plan = snapshot.limits, self.in_force(snapshot)
        shown = limits is not None and not plan.controls_elongation
        done = done_s(plan, snapshot) if plan == snapshot.plan else 0.0
        return drawing(plan, done, (limits.min_kpa, limits.max_kpa) if limits and shown else None)

    def columns(self, snapshot: SessionSnapshot) -> dict[str, FloatArray]:
        """Return the ends of ramps and steps of the plan that is drawn."""
        plan = self.in_force(snapshot)
        time_s, values = staircase(plan)
        return {"time_s": time_s, "elongation_mm" if plan.controls_elongation else "pressure_kpa": values}

    def choose(self, name: str) -> None:
        self.take(self.plans[name])

    def require_readings(self, wanted: bool) -> None:
        """Wait for a reading at each plateau, or not."""
        if wanted != self.wait_for_reading:
            text = "waiting for readings" if wanted else "running without readings"
            self._undo.push(Change(text, lambda: self._wait(wanted), lambda: self._wait(not wanted)))

    def _wait(self, wanted: bool) -> None:
        self.wait_for_reading = wanted
        self._store()

    def take(self, plan: Plan, text: str = "") -> None:
        """Select a plan, e.g. that of a run that resumes; `text` completes "Undo ..."."""
        before, text = self.plan, text or f"choice of plan {plan.name}"
        self._undo.push(Change(text, lambda: self._take(plan), lambda: self._take(before)))

    def open(self, path: Path) -> None:
        plan = plan_from_toml(read_text(path), path.name)
        self.plans[plan.name] = plan
        self.take(plan)

    def save(self, path: Path) -> None:
        write_whole(path, self.plan.to_toml())

    def edit(self, key: str, text: str) -> str:
        """Set one field from text; return why it is invalid, or "". The next entry tries an invalid one again."""
        entry = next(e for e in PLAN_ENTRIES if e.key == key)
        shown = text == self.value(key)  # rounded, not typed
        try:
            value = getattr(self.plan, key) if shown else stored_number(text, self.units, entry.unit or "1")
        except ValueError:
            return self._refuse(key, f"{entry.label}: {text!r} is not a number, such as {self.value(key)}")
        if key in _WHOLE and value != int(value):
            return self._refuse(key, f"{entry.label}: a whole number is required, such as {self.value(key)}")
        self.refused.pop(key, None)
        self._typed.pop(key, None)
        if value == getattr(self.plan, key):
            return ""
        number_typed = int(value) if key in _WHOLE else value
        alone = {key: number_typed}
        for changed in (self._typed | alone, alone):
            try:
                plan = replace(self.plan, **changed)
            except BadValue as error:
                why = ". ".join(
                    map(_in_terms_of_form, (f"'{error.key}' {as_shown(error.why, self.units)}", error.remedy))
                ).strip()
            else:
                left = {k: v for k, v in self._typed.items() if k not in changed}
                reasons = {k: why for k, why in self.refused.items() if k not in changed}
                self.take(plan, f"{entry.label} of the plan")
                self._typed, self.refused = left, reasons
                return ""
        self._typed[key] = number_typed
        return self._refuse(key, why)

    def _refuse(self, key: str, why: str) -> str:
        self.refused[key] = why
        return why

    def value(self, key: str, plan: Plan | None = None) -> str:
        """Return a field of the chosen plan, or of another one, as text."""
        entry = next(e for e in PLAN_ENTRIES if e.key == key)
        return f"{self.units.shown(entry.unit or '1').value(getattr(plan or self.plan, key)):g}".replace("-", MINUS)

    def unit(self, stored: str) -> str:
        return as_text(self.units.shown(stored).symbol)

    def _take(self, plan: Plan) -> None:
        self.plan = plan
        if plan.kind == "profile":
            self.plans[plan.name] = plan
        self.refused, self._typed = {}, {}
        self._store()

    def allowed(self, snapshot: SessionSnapshot) -> tuple[str, ...]:
        return STATE_TEXTS[snapshot.state][2] if snapshot.can_command else ()

    def needs_readings(self, snapshot: SessionSnapshot) -> bool:
        return self._needs_readings and snapshot.state in (SessionState.RUNNING, SessionState.PAUSED)

    def why_not_arm(self, snapshot: SessionSnapshot) -> str:
        """Return why the shown plan cannot be armed; empty where it can."""
        if snapshot.not_saving:
            return "Nothing is saved at present: see the message."
        return "Correct the marked fields of the plan first." if self.refused else ""

    def why_not_set(self, snapshot: SessionSnapshot) -> str:
        """Return in few words why no pressure and no elongation can be set by hand; empty where they can."""
        if not snapshot.can_command:
            unheard = "Connect a board first." if snapshot.link in ENDED else "No data arrive."
            return "The link is read only." if snapshot.why_read_only else unheard
        if snapshot.state is SessionState.FAULT:
            return "Clear the fault first."
        if snapshot.state is SessionState.ARMED:
            return "Disarm first."
        return "" if "arm" in self.allowed(snapshot) else "Not during a run."

    def press(self, button: str) -> None:
        s = self.session
        actions: dict[str, Callable[[], object]] = {
            "arm": self.arm, "start": s.start, "disarm": s.disarm, "pause": s.pause, "resume": s.resume,
            "stop": s.stop, "clear": s.clear_fault,
        }  # fmt: skip
        actions[button]()

    def arm(self, plan: Plan | None = None, *, resume: bool = False) -> None:
        """Arm the chosen plan, or another one that waits for each reading; `resume` begins at the next whole cycle."""
        if plan is None and self.refused:
            cause = f"the plan is invalid: {next(iter(self.refused.values()))}"
            raise RequestError(cause, "Correct the marked fields of the plan, then arm.")
        waits = (self.wait_for_reading and self.plan.kind != "continuous") if plan is None else True
        chosen = plan or self.plan
        regulator = self._regulator() if chosen.controls_elongation else None
        self.session.arm(chosen, wait_for_reading=waits, resume=resume, regulator=regulator, hold=self.hold)
        self._needs_readings = waits

    def converted(self, text: str, before: ShownUnits, stored: str) -> str:
        """Return a number that was typed in other units in those shown now; any other text as it is."""
        try:
            return f"{self.units.shown(stored).value(stored_number(text, before, stored)):.4g}"
        except ValueError:
            return text

    def set_pressure(self, text: str, ramp: str) -> None:
        try:
            target_kpa = stored_number(text, self.units, "kPa")
            ramp_kpa_per_s = stored_number(ramp, self.units, "kPa/s")
        except ValueError:
            cause = f"{text!r} {self.unit('kPa')} at {ramp!r} {self.unit('kPa/s')} are not two numbers"
            raise RequestError(cause, "Type numbers, such as 20 and 5.") from None
        self.session.set_pressure(target_kpa, ramp_kpa_per_s)

    def set_elongation(self, text: str) -> None:
        """Control the elongation: close the loop, or move its setpoint."""
        try:
            mm = stored_number(text, self.units, "mm")
        except ValueError:
            raise RequestError(f"{text!r} {self.unit('mm')} is not a number", "Type a number, such as 1.5.") from None
        controlled = self.session.snapshot().elongation is not None
        self.session.control_elongation(mm, None if controlled else self._regulator(), hold=self.hold)


def why_no_command(snapshot: SessionSnapshot) -> str:
    """Return why no board can be recorded or commanded."""
    if snapshot.why_read_only:
        return f"This link is read only: {snapshot.why_read_only}."
    return "Connect a board first." if snapshot.link in ENDED else "No data arrive from the board."


def elongation_text(snapshot: SessionSnapshot, units: ShownUnits = STORED_UNITS) -> str:
    """Return the control of the elongation in a line; empty while it is not controlled."""
    found = snapshot.elongation
    if found is None:
        return ""
    known = not math.isnan(found.elongation_mm)
    measured = in_units(units, "mm", found.elongation_mm, 2) if known else "not known"
    parts = [f"Setpoint {in_units(units, 'mm', found.setpoint_mm, 2)}, measured {measured}"]
    if found.saturated:
        parts.append("pressure at its limit or ramp")
    parts += [f"sensor {sensor} lost" for sensor in found.lost]
    return ", ".join(parts)


def _in_terms_of_form(text: str) -> str:
    """Return an error of the plan with the labels of the form for its keys, as a sentence."""
    for entry in PLAN_ENTRIES:
        text = text.replace(f"'{entry.key}'", entry.label).replace(entry.key, entry.label)
    text = text.replace("'window_s'", "the steadiness window").replace("window_s", "the steadiness window")
    return text[:1].upper() + text[1:]


def holding_text(snapshot: SessionSnapshot, units: ShownUnits = STORED_UNITS) -> str:
    """Return what is held without a run, an elongation or a pressure; empty where nothing is commanded."""
    last, loop = snapshot.last, snapshot.elongation
    if snapshot.state not in AT_REST or snapshot.link is not LinkState.UP or last is None:
        return ""
    off = snapshot.pressure_off
    if loop is not None:
        there = abs(loop.setpoint_mm - loop.target_mm) < REACHED_MM
        off = there and not abs(loop.elongation_mm - loop.target_mm) <= max(loop.u_mm, NEAR_MM)  # or not known
        goal = in_units(units, "mm", loop.target_mm, 2)
        goal += "" if off else f" at {target(last.pressure_kpa, units)}"
    elif snapshot.commanded:
        there = abs(last.pressure_kpa - last.target_kpa) < VENTED_KPA
        goal = target(last.target_kpa, units)
    else:
        return ""
    return f"\u25b2 Not at {goal}" if off else f"\u25cf {'Holding' if there else 'Moving to'} {goal}"


def is_unknown(snapshot: SessionSnapshot) -> bool:
    """Return whether a link that gave samples gives none; one that was closed on a vented unit left it so."""
    last, link = snapshot.last, snapshot.link
    if link is LinkState.CLOSED:
        return last is not None and not abs(last.pressure_kpa) < VENTED_KPA
    return link in UNKNOWN and (link is not LinkState.OPENING or last is not None)


def state_text(snapshot: SessionSnapshot, units: ShownUnits = STORED_UNITS) -> str:
    """Return the run's state with its shape, e.g. `Running`, as far as it is known."""
    shape, text, _ = STATE_TEXTS[snapshot.state]
    if is_unknown(snapshot):
        return f"\u25a0 {UNKNOWN[snapshot.link]}"
    if held := holding_text(snapshot, units):
        return held
    if snapshot.last is not None and snapshot.link is LinkState.UP and snapshot.state in _RESTING:
        kpa = snapshot.last.pressure_kpa  # a board that has restarted reports vented before its unit is
        if math.isnan(kpa):
            text += ", pressure unknown"
        elif abs(kpa) >= VENTED_KPA and (snapshot.pressure_off or snapshot.state in _FREE or not snapshot.can_command):
            text += f", at {in_units(units, 'kPa', kpa, 1)}"
        elif snapshot.state not in _FREE:
            text += ", vented" if abs(kpa) < VENTED_KPA else ", venting"
    return f"{shape} {text}"


def _promise(snapshot: SessionSnapshot, units: ShownUnits) -> str:
    """Return what vents a board that sends nothing, as its last sample knew."""
    last = snapshot.last
    if last is not None and snapshot.link is LinkState.CLOSED:
        return f"its last pressure was {in_units(units, 'kPa', last.pressure_kpa, 1)}"
    if last is None or not last.flags & SampleFlag.WATCHDOG_ARMED:
        return "no watchdog was armed: the unit may be under pressure"
    wait_s = (LONGEST_MS if snapshot.speed > FAST else REAL_TIME_MS) / 1000
    if snapshot.health is not None and snapshot.health.silent_s > wait_s:
        return "the board should have vented by its watchdog"
    return f"the board vents by its watchdog within {wait_s:.0f} s"


def progress_text(snapshot: SessionSnapshot, leave_out: int = 0, units: ShownUnits = STORED_UNITS) -> str:
    """Return cycle, step and time left in a line; `leave_out` 1 leaves out the phase, 2 the step too."""
    progress = snapshot.progress
    ended = snapshot.run_ended
    if is_unknown(snapshot):
        return _promise(snapshot, units)
    if snapshot.state is SessionState.FAULT and snapshot.latched:
        return as_shown(snapshot.latched, units)  # of a held pressure, too, which no run was
    over = snapshot.state in (SessionState.FAULT, SessionState.ABORTED) and not holding_text(snapshot)
    if over and ended is not None and ended.aborted:
        return as_shown(ended.cause, units)
    if snapshot.why_read_only:
        return f"read only: {snapshot.why_read_only}"
    if snapshot.state is SessionState.ARMED and snapshot.last is not None and snapshot.commanded:
        return f"{target(snapshot.last.target_kpa, units)} is held: press VENT before Start"
    if progress is None:
        held = elongation_text(snapshot, units)
        return held[:1].lower() + held[1:]
    left = f"{duration(progress.time_left_s)} left"
    if snapshot.state is SessionState.PAUSED:
        broken, again = "first plateau interrupted", "will be repeated"
        if progress.cycle:
            broken, again = f"cycle {progress.cycle} interrupted", f"will be repeated as cycle {progress.cycle + 1}"
        return "   ".join(((broken, left, again), (broken, left), (broken,))[leave_out])
    where, step, broken_cycles = "first plateau", "", len(progress.incomplete_cycles)
    if progress.cycle and progress.branch != "start":
        where = f"cycle {progress.cycle} of {progress.cycles}"
        where += f", {broken_cycles} repeated" if broken_cycles else ""
        vented = progress.branch == "end"  # the last mark of a run
        word = "plateau" if snapshot.plan is not None and snapshot.plan.kind == "staircase" else "step"
        step = f"{word} {progress.step - vented} of {progress.steps - vented}"
    phase = PHASE_WORDS.get(progress.phase, progress.phase.value)
    mm = progress.target_mm
    goal = target(progress.target_kpa, units) if mm is None else in_units(units, "mm", mm, 2)
    parts = ((where, step, left, f"{phase} {goal}"), (where, step, left), (where, left))
    return "   ".join(filter(None, parts[leave_out]))


def done_s(plan: Plan, snapshot: SessionSnapshot) -> float:
    """Return how far the run is on the staircase's own time."""
    progress = snapshot.progress
    if progress is None or not progress.step:
        return 0.0
    edges = step_begins(plan)
    to_come = progress.steps - progress.step  # of a run with repeated cycles the steps before have no place in the plan
    if snapshot.state is SessionState.PAUSED:
        return float(edges[max(edges.size - to_come, 0)]) if progress.complete_cycles else 0.0
    at = progress.step if snapshot.state is SessionState.FINISHING else edges.size - 1 - to_come
    i = min(max(at, 1), edges.size - 1) - 1
    return float(min(edges[i] + progress.step_time_s, edges[i + 1]))


def limits_text(limits: Limits | None, units: ShownUnits = STORED_UNITS) -> tuple[str, str]:
    """Return the range of pressure, and whose limits these are."""
    if limits is None:
        return "", ""
    high = target(limits.max_kpa, units)
    low = target(limits.min_kpa, units).removesuffix(high[high.index(" ") :])
    whose = " and ".join(dict.fromkeys((limits.min_source, limits.max_source)))
    return f"Limits {low} to {high}", f"Limits of the {whose}"
