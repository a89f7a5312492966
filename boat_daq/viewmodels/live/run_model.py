"""The run on the bench: the buttons of its sequence, its recording, its readings and markers, and offers after it.

The program reads a simulated unit's grid on request. After a run it offers to calibrate with its readings, or to resume
it at its next whole cycle; a resumed run is only armed, pressure waits for Start.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

from boat_daq.engine.control.sequencer import VENTED_KPA
from boat_daq.engine.file_names import check_file_name, named
from boat_daq.engine.plan import Plan, built_in_plans, resume_point
from boat_daq.engine.recording.resumption import BrokenRun
from boat_daq.engine.session.session import Session
from boat_daq.engine.snapshot import LinkState, SessionSnapshot, SessionState
from boat_daq.formatting import count
from boat_daq.viewmodels.common.notices import Notice, Severity
from boat_daq.viewmodels.common.services import Page, Services, Tab
from boat_daq.viewmodels.live.connection import ENDED, ConnectionModel
from boat_daq.viewmodels.live.end_at import EndAt, EndReport, uncertainty_text
from boat_daq.viewmodels.live.live_model import LiveModel
from boat_daq.viewmodels.live.readings import ReadingsModel, place
from boat_daq.viewmodels.live.sequence import AT_REST, SequenceModel, is_unknown
from boat_daq.workflows.end_at_uncertainty import EnoughCycles
from protocol.base.errors import BoatDaqError, RequestError
from protocol.base.units import NOTHING, as_text
from protocol.recording import RunEnd

ReadInterrupted = Callable[[Path, Callable[[BrokenRun], None]], None]
TRIAL_SPEED = 20.0  # of the virtual board over real time
TRIAL_CYCLES = 3  # the fewest that give an uncertainty
ENDED_RUN = (*AT_REST, SessionState.FAULT)


class CalibrationOffer:
    def __init__(
        self, readings: ReadingsModel, analyse: Callable[[], None], prepare: Callable[[], None], services: Services
    ) -> None:
        self._readings, self._analyse, self.prepare, self._services = readings, analyse, prepare, services
        self._state = SessionState.IDLE
        self._offer: Notice | None = None

    @property
    def open(self) -> bool:
        """Return whether the run that has ended was read and can be calibrated with."""
        return self._offer is not None

    def take(self) -> None:
        """Analyse the run that has ended, on its page."""
        self._services.show(Tab.CALIBRATION)
        self._analyse()

    def follow(self, snapshot: SessionSnapshot, *, analysing: bool) -> None:
        """Make the offer when a run has ended; withdraw it when it is taken or the next run begins."""
        before, self._state = self._state, snapshot.state
        notices = self._services.notices
        if before is SessionState.FAULT and snapshot.state is not SessionState.FAULT:
            notices.dismiss_all(Severity.FAULT)  # cleared: they would hide what comes next
        if analysing or snapshot.state is SessionState.RUNNING:
            notices.dismiss(self._offer)
            self._offer = None
        ended = snapshot.state is SessionState.IDLE and before in (SessionState.RUNNING, SessionState.FINISHING)
        if not ended:
            return
        stopped = snapshot.run_ended is not None and snapshot.run_ended.end is RunEnd.STOPPED
        cause = f"the run {'was stopped' if stopped else 'is finished'}"
        read = sum(r.elongation_mm is not None for r in self._readings.latest().values())
        if read:
            cause, offer = f"{cause}, {count(read, 'plateau')} read", ("Calibrate", self.take)
            self._offer = notices.add(Severity.INFORMATION, cause, "Press Calibrate to fit the curve.", action=offer)
        else:
            notices.add(Severity.INFORMATION, cause)


class ResumeRun:
    """Offers to resume an interrupted run after every vent, and arms it."""

    def __init__(self, session: Session, sequence: SequenceModel, read: ReadInterrupted, services: Services) -> None:
        self._session, self._sequence, self._read, self._services = session, sequence, read, services
        self._offer: Notice | None = None
        self._reopened: Path | None = None  # the recording in which a run of another session resumes
        self._armed = False  # the rest of a run, not a whole plan
        self.first_cycle = 0  # where the interrupted run resumes, offered or armed; 0 without one

    def resume(self, path: Path) -> None:
        snapshot = self._session.snapshot()
        if snapshot.link is not LinkState.UP:
            raise RequestError("no board is connected", "Connect the board of this run, then resume it.")
        if snapshot.recording is not None:
            raise RequestError(f"{snapshot.recording.name} is being recorded", "Close that recording first.")

        def ready(broken: BrokenRun) -> None:
            def arm() -> None:
                self._session.resume_recording(broken, {"operator": ""})
                self._reopened = broken.path
                self._arm(broken.plan, broken.first_cycle)

            done = f"{broken.path.name} resumes at cycle {broken.first_cycle}: press Start"
            self._services.notices.attempt(arm, done=done)

        self._read(path, ready)

    def follow(self, snapshot: SessionSnapshot) -> None:
        """Offer to resume while an interrupted run is recorded and the board is connected."""
        if snapshot.state is SessionState.RUNNING:
            self._reopened = None
        armed = self._armed = snapshot.state is SessionState.ARMED and self._armed
        first, complete = (self.first_cycle, 0) if armed else self._resume_point(snapshot)
        self.first_cycle = first
        if armed or not first:
            self._services.notices.dismiss(self._offer)
            self._offer = None
        elif self._offer is None:
            done = f"after {count(complete, 'whole cycle')}" if complete else "before its first cycle was complete"
            cause = f"the run was interrupted {done}"
            remedy = f"Resume at cycle {first} in the same recording, or start over in a new one."
            offer = ("Resume", self.arm)
            self._offer = self._services.notices.add(Severity.INFORMATION, cause, remedy, action=offer)

    def _resume_point(self, snapshot: SessionSnapshot) -> tuple[int, int]:
        """Return (first cycle, complete cycles) of an interrupted run that can resume now; (0, 0) without one."""
        plan, ended, recording = snapshot.plan, snapshot.run_ended, snapshot.recording
        at_rest = snapshot.state in AT_REST and snapshot.link is LinkState.UP
        broken = recording == self._reopened or (ended is not None and ended.aborted)
        if plan is None or recording is None or not (at_rest and broken):
            return 0, 0
        steps = list(self._session.steps())
        first, complete = resume_point(plan, steps)
        if plan.cycles == 1 and recording != self._reopened:  # to start over is the same
            return 0, 0
        return (first, complete) if steps and complete < plan.cycles else (0, 0)

    def arm(self) -> None:
        plan = self._session.snapshot().plan
        if plan is not None and self.first_cycle:
            self._arm(plan, self.first_cycle)

    def _arm(self, plan: Plan, first_cycle: int) -> None:
        self._sequence.take(plan)
        self._sequence.arm(resume=True)
        self.first_cycle, self._armed = first_cycle, True
        self._services.show(Page.MEASURE)


class QuickTrial:
    """A short calibration plan on the virtual board, read from its grid, and its calibration."""

    def __init__(self, run: RunModel) -> None:
        self._run = run
        self.active = self._begun = False

    def start(self) -> None:
        """Start a fast virtual board; `follow` does the rest."""
        self._run.connection.start_virtual_board(speed=TRIAL_SPEED)
        self.active, self._begun = True, False
        self._run.calibration.prepare()

    def possible(self) -> bool:
        """Return whether no board is connected."""
        return self._run.snapshot.link in ENDED and not self._run.connection.starting

    def follow(self, snapshot: SessionSnapshot) -> None:
        """Begin the run once the board sends samples, and calibrate with it; a run that was stopped ends the trial."""
        run = self._run
        if not self.active:
            return
        if self._begun and run.calibration.open:
            self._end()
            run.calibration.take()
            run.calibration.prepare()  # for its report
        elif snapshot.state in ENDED_RUN if self._begun else self.possible():  # the board did not start, or was removed
            self._end()
        elif not self._begun and snapshot.link is LinkState.UP and snapshot.last is not None:
            self.active = False  # where it cannot begin
            run.begin(replace(built_in_plans()["calibration"], cycles=TRIAL_CYCLES))
            self.active = self._begun = run.read_all = True

    def _end(self) -> None:
        self.active = self._run.read_all = False


@dataclass(slots=True)
class RunModel:
    """State of the run and the actions of the operator; `read_all` reads every plateau of a simulated unit."""

    session: Session
    connection: ConnectionModel
    live: LiveModel
    sequence: SequenceModel
    readings: ReadingsModel
    resumption: ResumeRun
    calibration: CalibrationOffer
    services: Services
    read_all: bool = False
    _own: Path | None = None  # the recording that was begun for its run
    trial: QuickTrial = field(init=False)
    enough: EnoughCycles = field(init=False)
    end_at: EndAt = field(init=False)
    end_report: EndReport = field(init=False)

    def __post_init__(self) -> None:
        self.trial = QuickTrial(self)
        self.enough = EnoughCycles(self.session)
        self.end_at = EndAt(self.enough, self.sequence, self.services)
        self.end_report = EndReport(self.enough, self.services.notices)

    @property
    def snapshot(self) -> SessionSnapshot:
        return self.session.snapshot()

    def press(self, button: str) -> None:
        """Press a button of the sequence; start begins a recording first, a new one for each run."""
        self.services.notices.attempt(lambda: self._press(button))

    def _press(self, button: str) -> None:
        snapshot = self.snapshot
        recording = snapshot.recording
        if button == "start" and recording is None:
            self._own = self.record()
        if button == "arm" and recording is not None and self.session.steps() and not snapshot.not_saving:
            self.session.stop_recording()
        try:
            self.sequence.press(button)
        except BoatDaqError:
            if button == "start" and recording is None:  # refused: nothing runs that its recording could hold
                self._discard()
            raise
        if button == "start":
            self.services.show(Page.MEASURE)  # which asks for the readings

    def _discard(self) -> None:
        """Delete the recording that was begun for a run that was refused; what is armed or held stays so."""
        self.session.recording.end(RunEnd.STOPPED)
        if self._own is not None:
            self._own.unlink(missing_ok=True)
        self._own = None

    def begin(self, plan: Plan) -> None:
        """Arm and start a plan that waits for each reading, in a recording of its own."""
        if self.snapshot.recording is not None:
            self.session.stop_recording()
        self.sequence.arm(plan)
        self._press("start")

    def follow(self, snapshot: SessionSnapshot) -> None:
        """Read the grid where every plateau is read from it, and continue a quick trial."""
        if snapshot.refused_first and snapshot.recording is not None and snapshot.recording == self._own:
            self._discard()
            self.services.notices.inform("nothing was measured: the recording of this run was deleted")
        if self.read_all and snapshot.waiting_for_reading is not None:
            self.read_simulated(snapshot.waiting_for_reading.step_id)
        self.trial.follow(snapshot)
        self.enough.follow(snapshot)
        self.end_report.follow(snapshot)

    def pressure_text(self, snapshot: SessionSnapshot) -> str:
        """Return the pressure while the unit is under it, in a run, or where it is unknown; empty at rest."""
        last = snapshot.last
        if not is_unknown(snapshot):
            if last is None or snapshot.link is not LinkState.UP:
                return ""
            if not snapshot.under_way and abs(last.pressure_kpa) < VENTED_KPA and not snapshot.commanded:
                return ""
            if (text := self.live.headline(snapshot).pressure) != NOTHING:
                return f"{text} {as_text(self.live.units.shown('kPa').symbol)}"
        return "pressure unknown"

    def uncertainty_text(self, snapshot: SessionSnapshot) -> str:
        """Return the uncertainty of the run, or what the last one had reached; "" where none was asked for."""
        text = uncertainty_text(self.enough, snapshot) or self.end_report.text
        return text[:1].upper() + text[1:]

    def interrupted_text(self, snapshot: SessionSnapshot) -> str:
        """Return how far a run came that was interrupted; empty for any other."""
        ended, steps = snapshot.run_ended, [step for step in self.session.steps() if step.branch != "end"]
        if snapshot.state not in (SessionState.FAULT, SessionState.ABORTED) or ended is None or not ended.aborted:
            return ""
        read = self.readings.summary(snapshot) if self.readings.latest() else ""
        at = f"at {place(steps[-1], self.readings.units)}" if steps else ""
        return ", ".join(filter(None, (f"Run interrupted {at}".rstrip(), read)))

    def may_read_grid(self) -> bool:
        """Return whether a plateau of this window's virtual board waits for its reading."""
        return self.snapshot.waiting_for_reading is not None and self.connection.board is not None

    def read_grid(self) -> None:
        """Enter what the grid shows at the plateau that waits."""
        waiting = self.snapshot.waiting_for_reading
        if waiting is not None:
            self.read_simulated(waiting.step_id)

    def toggle_read_all(self) -> None:
        self.read_all = not self.read_all

    def may_resume(self) -> bool:
        return "resume" in self.sequence.allowed(self.snapshot) or bool(self.resumption.first_cycle)

    def resume(self) -> None:
        if "resume" in self.sequence.allowed(self.snapshot):
            self.press("resume")
        else:
            self.services.notices.attempt(self.resumption.arm)

    def record(self) -> Path:
        """Start a recording named after unit and time; return its path."""
        folder, unit = self.services.recordings, self.connection.unit
        folder.mkdir(parents=True, exist_ok=True)
        path = self.next_recording()
        self.session.start_recording(path, {"unit": unit})
        return path

    def next_recording(self) -> Path:
        settings = self.session.settings
        if self.connection.unit:
            check_file_name(self.connection.unit)
        template = settings.file_name or "{unit}_{date}_{time}"
        values = {"unit": self.connection.unit, "operator": settings.operator, "plan": self.sequence.plan.name}
        return named(template, self.services.recordings, datetime.now(UTC).astimezone(), **values)

    def toggle_recording(self) -> None:
        notices, snapshot = self.services.notices, self.snapshot
        if snapshot.recording is None:
            notices.attempt(self.record, done=f"Recording into {self.services.recordings}")
        elif snapshot.under_way:
            remedy = "Stop it before closing the recording."
            notices.add(Severity.WARNING, "a run is in progress", remedy, refusal=True)
        else:
            done = f"Recording closed: {snapshot.recording.name} in {snapshot.recording.parent}"
            notices.attempt(self.session.stop_recording, done=done)

    def mark(self, note: str) -> None:
        now_s = self.live.now_s()
        if self.services.notices.attempt(lambda: self.session.mark(note)) and not math.isnan(now_s):
            self.live.markers.append((now_s, note))

    def read_simulated(self, step_id: int) -> None:
        """Enter what the simulated unit's grid shows, to the nearest half millimetre."""
        x = self.connection.simulated_mm()
        if x is not None:
            self.services.notices.attempt(lambda: self.readings.put(step_id, x, "simulated"))

    def skip_reading(self) -> None:
        self.services.notices.attempt(self.session.skip_reading)

    def reading_points(self) -> list[tuple[float, float]]:
        """Return the ring's time (s) and the elongation (mm) of each plateau that was read and is in the ring."""
        read = {key: r.elongation_mm for key, r in self.readings.latest().items() if r.elongation_mm is not None}
        return [
            (time_s, read[step.number])
            for step in self.session.steps_on_screen()
            if step.number in read and (time_s := self.live.time_of(step.settled_us or step.started_us)) is not None
        ]
