"""The run: a state machine, samples in, actions out. No clock, no thread, no port of its own.

    idle --arm--> armed --start--> running --(last step)--> finishing --(vented)--> idle
                            ^          |  stop ------------>    ^
                     resume |          v pause                  | stop
                            +------- paused --------------------+
    abort, from any state: aborted (the operator's vent, a step that timed out) or fault (a latch that must be cleared)

Rules. It runs on board time. It requests pressures with `GoTo` and never commands one: the interlock does. Every exit
from running requests a vent, and a run has exactly one `RunEnding`. A pause vents, so that no unit is touched under
pressure: the present cycle is left out, and the run resumes with the next number from the opening plateau, until it has
as many complete cycles as the plan. Numbers of steps and cycles are never used twice."""

from __future__ import annotations

import dataclasses
import statistics
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from boat_daq.engine.control.plateau_dwell import StepWatch
from boat_daq.engine.control.segment_watch import SegmentWatch
from boat_daq.engine.plan import Plan, PlannedStep, StepMark
from boat_daq.engine.sample_columns import Columns
from boat_daq.engine.snapshot import MessageKind, Phase, Progress, ReadingRequest, RunEnding, SessionState
from protocol.base.errors import RequestError
from protocol.base.units import Quantity, UnitText
from protocol.recording import RunEnd


@dataclass(frozen=True, slots=True)
class GoTo:
    """Request a pressure; `streamed` where the next follows within `STREAM_US`."""

    target_kpa: float
    ramp_kpa_per_s: float
    streamed: bool = False


@dataclass(frozen=True, slots=True)
class VentNow:
    """Request a vent."""


@dataclass(frozen=True, slots=True)
class StepChanged:
    """A step began (`new`), or more is known of it."""

    mark: StepMark
    new: bool


@dataclass(frozen=True, slots=True)
class SegmentBreak:
    """The recording's next segment begins here."""

    reason: str
    paused: bool


@dataclass(frozen=True, slots=True)
class ControlEvent:
    """An event for the recording; with a level, a message for the operator too."""

    kind: MessageKind
    text: str
    level: str = ""
    remedy: str = ""
    value: float | None = None


Action: TypeAlias = GoTo | VentNow | StepChanged | SegmentBreak | ControlEvent | RunEnding  # which comes once a run


VENTED_KPA = 2.0  # a unit this close to 0 for VENTED_S counts as vented
VENTED_S = 0.5
VENT_TIMEOUT_S = 60.0
ASSESSMENT_S = 1800.0  # board time that a level is held for an assessment at most
STREAM_US = 50_000  # between two pressures of a sine
PACE_STEPS = 40  # the last steps, from which the time left is estimated
READING_S = 10.0  # of a reading by hand, until enough were timed
FIRST_READINGS = 3  # fewer are filled up with READING_S, so that one long wait is no habit


_RUN = (SessionState.RUNNING, SessionState.PAUSED)


class Sequencer:
    """Runs one plan at a time."""

    def __init__(self) -> None:
        self.state = SessionState.IDLE
        self.plan: Plan | None = None
        self.marks: list[StepMark] = []
        self.incomplete_cycles: tuple[int, ...] = ()
        self.complete_cycles = 0
        self.cycle = 0
        self.ended: RunEnding | None = None  # the last run; None before the first ends, and during the next
        self._first_cycle = 1
        self._wait_for_reading = False
        self._held: frozenset[tuple[str, float]] | None = None
        self._stops_from: int | None = None  # complete cycles from which each end of a cycle is held
        self._assessed_since_us: int | None = None  # the end of a cycle that awaits its assessment
        self._queue: deque[PlannedStep] = deque()
        self._step: PlannedStep | None = None
        self._watch: StepWatch | SegmentWatch | None = None
        self._streamed_us = 0
        self._time_us = self._started_us = 0
        self._pressure_kpa = self._from_kpa = 0.0
        self._paces: deque[float] = deque(maxlen=PACE_STEPS)  # of the last steps, taken over planned time, waits apart
        self._waits_s: deque[float] = deque(maxlen=PACE_STEPS)  # of the last plateaus, for their readings
        self._low_since_us: int | None = None
        self._actions: list[Action] = []

    def take(self) -> list[Action]:
        """Return the actions since the last call, in order."""
        actions, self._actions = self._actions, []
        return actions

    @property
    def _planned(self) -> Plan:
        """The plan of a run."""
        assert self.plan is not None
        return self.plan

    # ---- the operator ----------------------------------------------------------------------------------------------

    def arm(self, plan: Plan, *, wait_for_reading: bool = False, resume_at: tuple[int, int] = (1, 0)) -> None:
        """Make `plan` ready.

        `resume_at`: first cycle and complete cycles where a broken run resumes (`resume_point`).
        """
        self._require("arm", SessionState.IDLE, SessionState.ARMED, SessionState.ABORTED)
        self.state, self.plan = SessionState.ARMED, plan
        self._wait_for_reading, self.cycle, self.incomplete_cycles = wait_for_reading, 0, ()
        self._first_cycle, self.complete_cycles = resume_at
        self._held, self._stops_from, self._assessed_since_us = None, None, None

    def disarm(self) -> None:
        """Discard an armed plan; nothing happens in any other state."""
        if self.state is SessionState.ARMED:
            self.state = SessionState.IDLE

    def start(self) -> None:
        """Begin with the opening plateau."""
        self._require("start", SessionState.ARMED)
        self.state, self.cycle = SessionState.RUNNING, self._first_cycle - 1
        self._started_us = self._time_us
        self._paces.clear()
        self._waits_s.clear()
        self.ended = None
        self._report(MessageKind.RUN_STARTED, f"{self._planned.name}: {self._planned.cycles} cycles")
        self._open()

    def pause(self) -> None:
        self._require("pause", SessionState.RUNNING)
        self._break_step()
        self.state = SessionState.PAUSED
        self._actions += [VentNow(), SegmentBreak("paused", paused=True)]
        self._report(MessageKind.PAUSED, "paused by the operator", "info")

    def resume(self) -> None:
        """Resume with the next whole cycle, from the opening plateau."""
        self._require("resume", SessionState.PAUSED)
        self.state = SessionState.RUNNING
        self._actions.append(SegmentBreak("resumed", paused=False))
        self._report(MessageKind.RESUMED, "resumed by the operator", "info")
        self._open()

    def stop(self) -> None:
        """End the run, or discard an armed plan; nothing happens in any other state."""
        self.disarm()
        if self.state in _RUN:
            self._break_step()
            self._finish(RunEnd.STOPPED)

    def finish_early(self, cause: str) -> None:
        """End a run as finished after its last complete cycle; the present one is left out."""
        self._require("finish", *_RUN)
        if not self.complete_cycles:
            raise RequestError("no cycle is complete", "wait for the end of the first cycle, or stop the run")
        self._break_step()
        self._report(MessageKind.ENOUGH_CYCLES, cause, "info")
        self._finish(RunEnd.FINISHED)

    def hold_at(self, plateaus: Collection[tuple[str, float]] | None) -> None:
        """Pass the plateaus of a staircase that are not needed, from the next step on; both ends are held always.

        `plateaus`: branch and pressure, kPa, of those to hold, each within half a step of its plateau; None holds all.
        """
        self._held = None if plateaus is None else frozenset(plateaus)
        self._queue = deque(self._as_held(step) for step in self._queue)

    def stop_at_cycles(self, *, on: bool, first: int = 1) -> None:
        """Hold the last level of each cycle from `first` on until `next_cycle`; off releases a held one.

        That of a continuous plan is where it turns; a profile holds none.
        """
        self._stops_from = first if on and self.plan is not None and self.plan.kind != "profile" else None
        if not on:
            self.next_cycle()

    def next_cycle(self, assessed: int | None = None) -> None:
        """Begin the next cycle where the run holds for it; with `assessed`, only after no more complete cycles."""
        if self._assessed_since_us is not None and (assessed is None or self.complete_cycles <= assessed):
            self._assessed_since_us = None
            self._begin_cycle()

    def _begin_cycle(self) -> None:
        self.cycle += 1
        self._queue.extend(self._cycle_steps(self.cycle))
        self._begin()

    def _as_held(self, step: PlannedStep) -> PlannedStep:
        plan = self._planned
        if plan.kind != "staircase" or not step.cycle:
            return step
        near = (
            branch == step.branch and abs(level - step.target_kpa) < plan.step_kpa / 2
            for branch, level in self._held or ()
        )
        held = self._held is None or step.target_kpa in plan.extremes_kpa or any(near)
        return dataclasses.replace(step, plateau=held, passed=not held)

    def _cycle_steps(self, cycle: int) -> tuple[PlannedStep, ...]:
        return tuple(self._as_held(step) for step in self._planned.cycle_steps(cycle))

    def abort(self, cause: str, state: SessionState) -> None:
        """Enter ABORTED or FAULT from any state; only a run has an ending."""
        if self.state in _RUN:
            self._break_step()
            self._end(RunEnding(RunEnd.FAULT if state is SessionState.FAULT else RunEnd.ABORTED, cause))
        elif self.state is SessionState.FINISHING:
            if self.marks[-1].ended_us is None:
                self._mark_end("aborted")
            self._actions.append(VentNow())
        elif state is SessionState.ABORTED:
            self.disarm()
            return
        self.state = state

    def cleared(self) -> None:
        """Leave FAULT: the latch is cleared."""
        if self.state is SessionState.FAULT:
            self.state = SessionState.IDLE

    def reading_given(self, number: int) -> None:
        """End the wait for a step's reading: it is given, or skipped."""
        if self._watch is not None and self.marks and self.marks[-1].number == number:
            self._watch.reading_awaited = False

    # ---- the board -------------------------------------------------------------------------------------------------

    def commanded(self) -> None:
        """Take the board's acknowledgement of the last pressure."""
        if self._watch is not None:
            self._watch.commanded(self._time_us, self._from_kpa)

    def feed(self, block: Columns) -> None:
        if not len(block):
            return
        self._time_us = int(block.time_us[-1])
        known = block.pressure_kpa[block.pressure_known]
        self._pressure_kpa = float(known[-1]) if len(known) else self._pressure_kpa
        if self.state is SessionState.RUNNING and self._watch is not None:
            self._follow(self._watch, block)
        elif self._assessed_since_us is not None:
            if self._time_us - self._assessed_since_us > ASSESSMENT_S * 1e6:
                self.next_cycle()
        elif self.state is SessionState.FINISHING:
            self._follow_vent(block)

    def _follow(self, watch: StepWatch | SegmentWatch, block: Columns) -> None:
        watch.feed(block)
        self._stream(watch)
        mark = self.marks[-1]
        now = dataclasses.replace(
            mark,
            arrived_us=watch.arrived_us,
            settled_us=watch.settled_us,
            ended_us=watch.ended_us,
            status=watch.outcome or "running",
            detail=watch.detail() if watch.outcome else mark.detail,
        )
        if now != mark:
            self._change(now)
        if watch.outcome == "reached":
            self._reached(now)
        elif watch.outcome == "timeout":
            self._timed_out(now)

    def _stream(self, watch: StepWatch | SegmentWatch) -> None:
        """Request the next pressure of a sine."""
        sine = isinstance(watch, SegmentWatch) and watch.segment.kind == "sine"
        if not sine or self._planned.controls_elongation or self._time_us - self._streamed_us < STREAM_US:
            return
        assert isinstance(watch, SegmentWatch)
        self._streamed_us = self._time_us
        value_kpa, rate, _ = watch.setpoint(self._time_us + STREAM_US)
        self._actions.append(GoTo(value_kpa, max(abs(rate), 1.0), streamed=True))

    def setpoint_mm(self, time_us: int) -> tuple[float, float, float] | None:
        """Return elongation, rate and acceleration that the run wants at a board time; None where it wants none."""
        if self.plan is None or not self.plan.controls_elongation or not isinstance(self._watch, SegmentWatch):
            return None
        return self._watch.setpoint(time_us)

    def _reached(self, mark: StepMark) -> None:
        """Go to the next step, the next cycle, or the end."""
        if not mark.detail.get("steady", True):
            late = f" was not steady after {self._planned.max_dwell_s:g} s"
            text = UnitText("the plateau at ", _plateau_name(mark), late)
            self._report(MessageKind.NOT_STEADY, text, "warning", "its drift is recorded with the step")
        if mark.detail.get("reading_timed_out"):
            self._report(MessageKind.READING_MISSING, UnitText("no reading at ", _plateau_name(mark)), "warning")
        if not self._queue and mark.cycle:
            self.complete_cycles += 1
        if not self._queue and self.complete_cycles >= self._planned.cycles:
            self._finish(RunEnd.FINISHED)
            return
        if self._queue:
            self._begin()
        elif mark.cycle and self._stops_from is not None and self.complete_cycles >= self._stops_from:
            self._watch, self._step, self._assessed_since_us = None, None, self._time_us
        else:
            self._begin_cycle()

    def _timed_out(self, mark: StepMark) -> None:
        asked, reached = Quantity(mark.target_kpa, "kPa"), Quantity(self._pressure_kpa, "kPa", ".1f")
        text = UnitText(asked, " was not reached in time: ", reached)
        self._leave_cycle_out()
        self._watch = None
        remedy = "check for a leak, and that the pump runs; for a slow pump choose a slower ramp"
        self._report(MessageKind.STEP_TIMEOUT, text, "error", remedy)
        self.abort(text, SessionState.ABORTED)

    def _follow_vent(self, block: Columns) -> None:
        """Wait until the pressure has been near 0 for a while."""
        high = np.flatnonzero(~(np.abs(block.pressure_kpa) <= VENTED_KPA))
        if len(high):
            self._low_since_us = None
        rest = block.time_us[int(high[-1]) + 1 :] if len(high) else block.time_us
        if self._low_since_us is None and len(rest):
            self._low_since_us = int(rest[0])
        if self._low_since_us is not None and self._time_us - self._low_since_us >= VENTED_S * 1e6:
            self._mark_end("reached")
            self.state = SessionState.IDLE
        elif self._time_us - self.marks[-1].started_us > VENT_TIMEOUT_S * 1e6:
            self._mark_end("timeout")
            now = Quantity(self._pressure_kpa, "kPa", ".1f")
            text = UnitText("the pressure does not fall: ", now, " after the vent")
            self._report(MessageKind.VENT_TIMEOUT, text, "error", "keep clear of the unit and open its valve manually")
            self.abort(text, SessionState.ABORTED)

    # ---- steps -----------------------------------------------------------------------------------------------------

    def _open(self) -> None:
        self._queue = deque([self._planned.opening])
        self._begin()

    def _begin(self) -> None:
        """Begin the next step of the queue."""
        step = self._step = self._queue.popleft()
        self._from_kpa = self._pressure_kpa
        watch = StepWatch if step.segment is None else SegmentWatch
        self._watch = watch(self._planned, step, started_us=self._time_us, wait_for_reading=self._wait_for_reading)
        elongation = self._planned.controls_elongation
        self._new_mark(step.cycle, step.branch, self._pressure_kpa if elongation else step.target_kpa)
        if elongation or (step.segment is not None and step.segment.kind == "sine"):
            return
        ramp = step.segment.rate_per_s if step.segment is not None else 0.0
        self._actions.append(GoTo(step.target_kpa, ramp or self._planned.ramp_kpa_per_s))

    def _new_mark(self, cycle: int, branch: str, target_kpa: float) -> None:
        ramp = self.plan.ramp_kpa_per_s if self.plan and branch != "end" else 0.0
        number = self.marks[-1].number + 1 if self.marks else 1
        self.marks.append(StepMark(number, cycle, branch, target_kpa, ramp, self._time_us))
        self._actions.append(StepChanged(self.marks[-1], new=True))

    def _change(self, mark: StepMark) -> None:
        if mark.status == "reached" and self._step is not None and self._watch is not None:
            self._learn(mark, self._step, self._watch)
        self.marks[-1] = mark
        self._actions.append(StepChanged(mark, new=False))

    def _learn(self, mark: StepMark, step: PlannedStep, watch: StepWatch | SegmentWatch) -> None:
        """Keep the pace of a step, and how long it waited for its reading."""
        assert mark.ended_us is not None
        planned_s = 0.0 if step.passed else self._duration_s(step, self._from_kpa)
        waited_s = watch.waited_s(mark.ended_us)
        if planned_s > 0:
            self._paces.append(((mark.ended_us - mark.started_us) / 1e6 - waited_s) / planned_s)
        if self._wait_for_reading and step.plateau:
            self._waits_s.append(waited_s)

    def _break_step(self) -> None:
        """Abort the present step; its cycle does not count."""
        if self._watch is not None:
            detail = self._watch.detail()
            self._change(dataclasses.replace(self.marks[-1], ended_us=self._time_us, status="aborted", detail=detail))
            self._leave_cycle_out()
        self._watch = self._step = self._assessed_since_us = None
        self._queue.clear()

    def _leave_cycle_out(self) -> None:
        if self.marks[-1].cycle:
            self.incomplete_cycles += (self.marks[-1].cycle,)

    def _finish(self, end: RunEnd) -> None:
        """Vent, and mark the vent as the "end" step."""
        self._watch = self._step = self._low_since_us = None
        self.state = SessionState.FINISHING
        self._end(RunEnding(end))
        self._new_mark(0, "end", 0.0)

    def _end(self, ending: RunEnding) -> None:
        """Vent, and report once how the run ended."""
        self.ended = ending
        self._actions += [VentNow(), ending]

    def _mark_end(self, status: str) -> None:
        self._change(dataclasses.replace(self.marks[-1], ended_us=self._time_us, status=status))

    def _require(self, what: str, *states: SessionState) -> None:
        if self.state not in states:
            remedy = "clear the fault first" if self.state is SessionState.FAULT else ""
            raise RequestError(f"cannot {what} in state {self.state}", remedy)

    def _report(self, kind: MessageKind, text: str, level: str = "", remedy: str = "") -> None:
        self._actions.append(ControlEvent(kind, text, level, remedy))

    # ---- what is shown ---------------------------------------------------------------------------------------------

    def waiting(self) -> ReadingRequest | None:
        """Return the plateau that waits for its reading."""
        if self._watch is None or self._watch.phase is not Phase.WAITING_FOR_READING:
            return None
        mark = self.marks[-1]
        left_s = max(0.0, self._planned.reading_timeout_s - self._watch.waited_s(self._time_us))
        return ReadingRequest(mark.number, mark.cycle, mark.branch, mark.target_kpa, self._pressure_kpa, left_s)

    def progress(self) -> Progress | None:
        """Return how far the run is; None outside a run."""
        if self.plan is None or not self.marks or self.state not in (*_RUN, SessionState.FINISHING):
            return None
        mark = self.marks[-1]
        left_s, steps_left = self._left()
        return Progress(
            step=mark.number,
            steps=mark.number + steps_left,
            cycle=self.cycle,
            cycles=self.cycle + self._cycles_left(),
            complete_cycles=self.complete_cycles,
            incomplete_cycles=self.incomplete_cycles,
            branch=mark.branch,
            phase=self._watch.phase
            if self._watch
            else (Phase.VENTING if self._assessed_since_us is None else Phase.ASSESSING),
            target_kpa=mark.target_kpa,
            step_time_s=(self._time_us - mark.started_us) / 1e6,
            elapsed_s=(self._time_us - self._started_us) / 1e6,
            time_left_s=left_s,
            target_mm=self._step.target_kpa if self._step and self.plan.controls_elongation else None,
        )

    def _cycles_left(self) -> int:
        """Return how many cycles have yet to begin."""
        begun = bool(self._step and self._step.cycle)
        return max(0, self._planned.cycles - self.complete_cycles - begun)

    def _left(self) -> tuple[float, int]:
        """Estimate seconds and number of steps left.

        That is the plan's own time in the median pace of the last steps, and the median wait for a reading at each
        plateau that will wait for one. A plateau that waits takes nothing off the steps behind it.
        """
        if self.state is SessionState.FINISHING:
            return 0.0, 0
        pace = statistics.median(self._paces) if self._paces else 1.0
        steps_now = [*([self._step] if self._step else []), *self._queue]
        path = [self._from_kpa, *(step.target_kpa for step in steps_now)]
        each_s = [pace * self._duration_s(step, before) for step, before in zip(steps_now, path, strict=False)]
        cycles = self._cycles_left()
        steps = len(self._queue) + cycles * len(self._planned.targets_kpa)
        steps += self.state is SessionState.PAUSED  # the opening plateau, again
        plan_s = self._step_left_s(each_s[0] if each_s else 0.0) + sum(each_s[1:])
        return plan_s + pace * cycles * self._cycle_duration_s() + self._readings_left_s(cycles), steps

    def _cycle_duration_s(self) -> float:
        """Estimate the time of a later cycle."""
        if self._held is None:
            return self._planned.cycle_duration_s
        steps = self._cycle_steps(1)
        path = [self._planned.high_kpa, *(step.target_kpa for step in steps)]
        return sum(self._duration_s(step, before) for step, before in zip(steps, path, strict=False))

    def _duration_s(self, step: PlannedStep, from_kpa: float) -> float:
        """Estimate the time of a step that begins at a pressure."""
        if step.segment is not None:
            return step.segment.duration_s(step.start)
        if step.passed:
            return abs(step.target_kpa - from_kpa) / self._planned.ramp_kpa_per_s
        return self._planned.step_duration_s(from_kpa, step.target_kpa)

    def _step_left_s(self, planned_s: float) -> float:
        """Estimate the seconds left of the present step, without its wait for a reading."""
        if self._watch is None:
            return planned_s
        gone_s = (self._time_us - self.marks[-1].started_us) / 1e6 - self._watch.waited_s(self._time_us)
        return max(0.0, planned_s - gone_s)

    def _readings_left_s(self, cycles: int) -> float:
        """Estimate the seconds left for readings, with so many cycles yet to begin."""
        if self.plan is None or not self._wait_for_reading:
            return 0.0
        each_s = statistics.median([*self._waits_s, *[READING_S] * (FIRST_READINGS - len(self._waits_s))])
        behind = sum(s.plateau for s in self._queue) + cycles * sum(s.plateau for s in self._cycle_steps(1))
        watch = self._watch
        now_s = max(0.0, each_s - watch.waited_s(self._time_us)) if watch and watch.reading_awaited else 0.0
        return now_s + behind * each_s


def _plateau_name(mark: StepMark) -> UnitText:
    """Return what an operator calls a plateau, e.g. "+50 kPa, cycle 3"."""
    target = Quantity(mark.target_kpa, "kPa", "+g")
    return UnitText(target, f", cycle {mark.cycle}" if mark.cycle else ", first plateau")
