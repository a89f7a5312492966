"""The whole window without Qt: the session, the pages' models, and what they share.

Rules: parents know children, children never reach up or sideways. The window asks `tick()` from its one timer; nothing
is pushed into it, so threads meet Qt nowhere else. What the user does goes through `notices.attempt`, so that no error
ends the window.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from analysis.fidelity import LEVELS as FIDELITY_LEVELS
from analysis.fidelity import fidelity
from boat_daq.engine.file_names import path_in
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import StoredCalibration, UnitLibrary
from boat_daq.engine.snapshot import LinkState, MessageKind, SessionSnapshot, SessionState
from boat_daq.errors import OperatorError
from boat_daq.viewmodels.common.changes import Change, Changes, History
from boat_daq.viewmodels.common.formatting import count
from boat_daq.viewmodels.common.notices import Level, Notice, Notices
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.common.work import Bench, Work
from boat_daq.viewmodels.live.connection import ConnectionModel
from boat_daq.viewmodels.live.conversion import Conversion, Preparation
from boat_daq.viewmodels.live.live import LiveModel, Marker
from boat_daq.viewmodels.live.overlay import OverlayModel
from boat_daq.viewmodels.live.readings import ReadingsModel
from boat_daq.viewmodels.live.sequence import SequenceModel
from boat_daq.viewmodels.live.shadow_live import ShadowLive
from boat_daq.viewmodels.live.shadow_monitor import ShadowMonitor
from boat_daq.viewmodels.models.atlas import AtlasModel
from boat_daq.viewmodels.models.optics import OpticsModel
from boat_daq.viewmodels.models.tradeoff import TradeoffModel
from boat_daq.viewmodels.results.calibration import CalibrationModel
from boat_daq.viewmodels.results.repeatability import RepeatabilityModel
from boat_daq.viewmodels.results.runs import RunsModel
from boat_daq.viewmodels.resume_run import GoingOn
from protocol.recording import RunEnd

FIDELITIES = FIDELITY_LEVELS
DEFAULT_LEVEL = "normal"
PAGES = ("Live", "Calibrate", "Repeat", "Runs", "Optics", "Shadow", "Trade-off")
DOWN = (LinkState.OPENING, LinkState.FAILED, LinkState.SILENT, LinkState.LOST)
LEVELS = {"info": Level.INFORMATION, "warning": Level.WARNING, "error": Level.FAULT}


class Redirect(Changes):
    """Changes that go to whatever history the window has put here."""

    def __init__(self) -> None:
        self.to: Changes = History()

    def push(self, change: Change) -> None:
        """Hand the change on."""
        self.to.push(change)


class Desk:
    """The window's state.

    Parameters
    ----------
    session : the one door to the board.
    folder : settings and units.
    recordings : where recordings go.
    units : the units and their calibrations; the stored ones when None.
    """

    def __init__(self, session: Session, folder: Path, recordings: Path, units: UnitLibrary | None = None) -> None:
        self.session = session
        self.folder, self.recordings = folder, recordings
        self.notices = Notices()
        self.preferences = Preferences(folder, lambda cause, remedy: self.notices.say(Level.WARNING, cause, remedy))
        self.bench = Bench()
        self.changes = Redirect()
        self.connection = ConnectionModel(session, self.preferences)
        self.live = LiveModel(lambda: session.ring)
        self.overlay = OverlayModel(lambda: session.ring, session.steps, self.picture_time)
        self.shadow = ShadowLive(lambda: session.ring, lambda: self.live.inverse, self.bench)
        self.sequence = SequenceModel(session, self.changes)
        self.sequence.remember_in(self.preferences)
        self.readings = ReadingsModel(session, self.changes)
        self.units = units or UnitLibrary()
        self.calibration = CalibrationModel(session, self.units, self.bench, self.changes)
        self.repeatability = RepeatabilityModel(self.bench)
        self.runs = RunsModel(recordings, self.units, self.bench)
        self.optics = OpticsModel(self.bench)
        self.tradeoff = TradeoffModel(self.bench, folder, self.preferences)
        self.atlas = AtlasModel(self.bench, folder)
        self._take_fidelity()
        self.preparation = Preparation()
        self.conversion: Conversion | None = None
        self.monitor = ShadowMonitor(lambda: self.shadow.model, self.overlay, lambda: session.ring)
        self.going_on = GoingOn(session, self.sequence, self.runs, self.notices, lambda: self.request("Live"))
        self._inverse_of: StoredCalibration | None = None
        self.request: Callable[[str], None] = lambda what: None
        self._unit_shown = ("", 0)  # its name, and which of its calibrations
        self._state_before = SessionState.IDLE
        self._offer: Notice | None = None
        self._link_notices: list[Notice] = []  # they leave by themselves once the link is up again
        self.snapshot = session.snapshot()
        self._last_message = max((m.number for m in self.snapshot.messages), default=0)

    @property
    def fidelity(self) -> str:
        """How fine the window computes: a name of `analysis.fidelity.LEVELS`, remembered."""
        level = self.preferences.get("fidelity", DEFAULT_LEVEL)
        return level if level in FIDELITIES else DEFAULT_LEVEL

    def set_fidelity(self, level: str) -> None:
        """Compute as finely as `level` from now on; what is shown stays until it is asked for again."""
        self.preferences.set("fidelity", level)
        self._take_fidelity()

    def _take_fidelity(self) -> None:
        chosen = fidelity(self.fidelity)
        self.live.points_a_column = chosen.points_a_column
        self.optics.set_fidelity(chosen)
        self.shadow.set_fidelity(chosen.level)
        self.calibration.set_fidelity(chosen)
        self.repeatability.set_fidelity(chosen)

    def tick(self) -> SessionSnapshot:
        """Take a snapshot and what background work has brought; say what is new in the strip."""
        self.snapshot = self.session.snapshot()
        self.notices.attempt(self.connection.tick)
        self.bench.poll()
        self.runs.poll()
        self.shadow.poll()
        self._watch()
        if self.connected():
            self.shadow.prepare()
        self.repeatability.follow(self.snapshot)
        self._tell_runs()
        self._offer_calibration()
        self.going_on.watch(self.snapshot)
        self.notices.attempt(self._follow_calibration)
        for message in self.snapshot.messages:
            if message.number > self._last_message:
                self._last_message = message.number
                over = message.kind is MessageKind.SILENT and self.connected()  # data come again: only a remark now
                level = Level.INFORMATION if over else LEVELS.get(message.level, Level.WARNING)
                notice = self.notices.say(level, message.cause, "" if over else message.remedy)
                if self.snapshot.link in DOWN:
                    self._link_notices.append(notice)
        if self._link_notices and self.connected():
            for notice in self._link_notices:
                self.notices.dismiss(notice)
            self._link_notices.clear()
        return self.snapshot

    def _tell_runs(self) -> None:
        """Say what became of exports, reports and recoveries."""
        while self.runs.done:
            self.notices.inform(self.runs.done.pop(0))
        while self.runs.failures:
            cause, remedy, details = self.runs.failures.pop(0)
            self.notices.say(Level.WARNING, cause, remedy, details=details)

    def offer_recovery(self) -> None:
        """Say at the start what a killed session left, and offer to close it properly."""
        for path in self.runs.interrupted():
            self.notices.say(
                Level.WARNING,
                f"{path.name} was not closed: its session was killed",
                "Nothing that was recorded is lost; recovering closes the file properly.",
                action_text="Recover",
                action=partial(self.runs.recover, path),
            )

    def replay(self, path: Path, speed: float) -> None:
        """Play a recording as if it came from a board."""

        def deed() -> None:
            self.session.connect(f"replay:{path}@{speed:g}", unit=self.connection.unit)
            self.request("Live")

        self.notices.attempt(deed)

    def resume(self, path: Path) -> None:
        """Make a broken run ready to go on in its own recording; it begins when Start is pressed.

        Raises
        ------
        OperatorError : as `GoingOn.resume`.
        """
        self.going_on.resume(path, self.snapshot, self.readings.reader)

    def save_bug_report(self, path: Path) -> None:
        """Pack log, settings, versions and the recording's summary, without names and notes, in the background."""
        work = Work("Packing the bug report", "boat_daq.engine.bug_report:write_bug_report", path)
        done = f"Saved {path.name}, without names and notes. Look at it before you send it"
        self.bench.start("bug report", work, lambda work: self.runs.finished(work, done))

    def choose_repeatability(self) -> None:
        """Take the plan of many cycles and show it."""
        self.sequence.choose("repeatability")
        self.request("plan")

    def analysed_path(self, page: str) -> Path | None:
        """Return the recording behind what a page shows."""
        if page == "Repeat" and self.repeatability.result is not None:
            return Path(self.repeatability.result.path)
        return self.calibration.last_path

    def _offer_calibration(self) -> None:
        """Say what comes next when a run with readings has ended."""
        state, before = self.snapshot.state, self._state_before
        self._state_before = state
        if before is SessionState.FAULT and state is not SessionState.FAULT:
            self.notices.dismiss_all(Level.FAULT)  # cleared, they would stand before what comes next
        ended = state is SessionState.IDLE and before in (SessionState.RUNNING, SessionState.FINISHING)
        if self._offer is not None and (self.calibration.working or state is SessionState.RUNNING):
            self.notices.dismiss(self._offer)
            self._offer = None
        read = sum(r.elongation_mm is not None for r in self.readings.latest().values()) if ended else 0
        if read:
            stopped = self.snapshot.run_ended is not None and self.snapshot.run_ended.end is RunEnd.STOPPED
            self._offer = self.notices.say(
                Level.INFORMATION,
                f"the run {'was stopped' if stopped else 'is finished'}, {count(read, 'plateau')} read",
                "Next: fit and look at it.",
                action_text="Calibrate",
                action=self.calibrate_now,
            )

    @property
    def offers_calibration(self) -> bool:
        """Whether the run that has ended was read and waits to be calibrated with."""
        return self._offer is not None

    def calibrate_now(self) -> None:
        """Analyse the run that has ended, on its page."""
        self.request("Calibrate")
        self.calibration.analyse_current()

    def _watch(self) -> None:
        """Hand whole cycles to the monitor; say what it finds."""
        self.monitor.follow(self.snapshot, self.conversion)
        self.notices.attempt(self._tell_alarms)

    def _tell_alarms(self) -> None:
        for sentence in self.monitor.poll():
            self.notices.say(Level.WARNING, sentence, "Check tubing, zero and the actuator before the next run.")

    def _follow_calibration(self) -> None:
        """Use the calibration in force of the unit on the bench."""
        name, revision = self.unit_name, self.calibration.units_revision
        if (name, revision) != self._unit_shown:
            self._unit_shown = (name, revision)
            stored = self.units.load(name).calibration if name else None
            self.use_calibration(stored)
        ready = self.preparation.poll()
        if ready is not None:
            self.live.inverse = self.conversion = ready

    @property
    def unit_name(self) -> str:
        """Return the unit on the bench."""
        return self.snapshot.unit or self.connection.unit

    def use_calibration(self, stored: StoredCalibration | None) -> None:
        """Show elongation by this calibration from now on; by none where there is none."""
        self._inverse_of = stored
        self.live.inverse = self.conversion = None
        if stored is not None:
            self.preparation.ask(stored.content)

    def analyse_current(self) -> None:
        """Close the recording that runs, and analyse it or the last one, of an earlier start too."""
        if self.calibration.last_path is None and self.snapshot.recording is None:
            self.calibration.last_path = self.runs.newest()
        self.notices.attempt(self.calibration.analyse_current)

    def accept_calibration(self, *, anyway: bool = False) -> None:
        """Store the calibration with its unit and use it live; a poor one only `anyway`, else that is offered."""
        poor = self.calibration.poor()
        if poor and not anyway:
            self.notices.say(
                Level.WARNING,
                f"this calibration is poor. {'. '.join(poor)}",
                "Look at its readings, or accept it as it is.",
                action_text="Accept anyway",
                action=partial(self.accept_calibration, anyway=True),
            )
            return
        self.notices.attempt(
            lambda: self.calibration.accept(self.readings.reader),
            done=f"Calibration accepted{' though poor' if poor else ''}; the elongation is shown on the Live page",
        )

    def vent(self) -> None:
        """Vent now, whatever else goes on."""
        self.session.vent()

    def ask_connect(self) -> None:
        """Show the ways to connect."""
        self.request("connect")

    def show_unit(self) -> None:
        """Show the unit and its calibrations."""
        self.request("unit")

    def unit_text(self, snapshot: SessionSnapshot) -> str:
        """Return unit and calibration in a line."""
        stored = self._inverse_of
        words = f"calibrated {stored.utc[:10]}" if stored is not None else "not calibrated"
        words += ", poor" if stored is not None and stored.content.get("poor") else ""
        return f"{self.unit_name}  \u00b7  {words}"

    def picture_time(self, time_us: int) -> float | None:
        """Return the ring's time of an instant of board time, or None where the ring no longer holds it."""
        ring = self.session.ring
        return ring.time_of(time_us) if ring is not None else None

    def reading_points(self) -> tuple[list[float], list[float]]:
        """Return the ring's time and the elongation (mm) of every plateau that was read and is still in the ring."""
        read = {key: r.elongation_mm for key, r in self.readings.latest().items() if r.elongation_mm is not None}
        marks = [
            (self.picture_time(s.settled_us or s.started_us), read[s.number])
            for s in self.session.steps()
            if s.number in read
        ]
        kept = [(at, mm) for at, mm in marks if at is not None]
        return [at for at, _ in kept], [mm for _, mm in kept]

    def title(self) -> str:
        """Return the window's title; a simulated board is said there too."""
        parts = ["boat-daq"]
        if self.snapshot.simulated:
            parts.append("SIMULATED")
        if self.snapshot.recording is not None:
            parts.append(self.snapshot.recording.name)
        return " \u2013 ".join(parts)

    def start_virtual_board(self, unit: str = "SA1", speed: float = 1.0) -> None:
        """Start a virtual board and connect to it."""
        self.notices.attempt(lambda: self.connection.start_virtual_board(unit, speed))

    def disconnect(self) -> None:
        """Vent and close the link."""
        self.notices.attempt(self.connection.disconnect)

    def connected(self) -> bool:
        """Whether data come."""
        return self.snapshot.link is LinkState.UP

    def press(self, button: str) -> None:
        """Press a button of the sequence; a start records first, so that no run is ever lost.

        Each run has a recording of its own: one that holds a run already is closed before the plan is armed again.
        """

        def deed() -> None:
            if button == "start" and self.snapshot.recording is None:
                self.record()
            if button == "arm" and self.snapshot.recording is not None and self.session.steps():
                self.session.stop_recording()
            self.sequence.press(button)
            if button == "start":
                self.request("Live")  # there it is watched, and asks for its readings

        self.notices.attempt(deed)

    def set_pressure(self, target: str, ramp: str) -> None:
        """Command a pressure by hand, as typed."""

        def deed() -> None:
            try:
                self.sequence.set_pressure(target, ramp)
            except ValueError:
                raise OperatorError(
                    f"{target!r} kPa at {ramp!r} kPa/s are not two numbers", "Type e.g. 20 and 5."
                ) from None

        self.notices.attempt(deed)

    def can_read_simulated(self) -> bool:
        """Whether there is a simulated grid to read."""
        return self.connection.simulated_mm() is not None

    def read_simulated(self, step_id: int) -> None:
        """Read the simulated unit's grid as an eye would: to the nearest half millimetre of its division."""
        x = self.connection.simulated_mm()
        if x is not None:
            self.notices.attempt(lambda: self.readings.put(step_id, x, "simulated"))

    def record(self) -> Path:
        """Start a recording under a name of unit and time; returns its path.

        Raises
        ------
        BoatDaqError : the folder cannot be written, or nothing is connected.
        """
        self.recordings.mkdir(parents=True, exist_ok=True)
        stamp = datetime.now(UTC).astimezone().strftime("%Y-%m-%d_%H%M%S")
        path = path_in(self.recordings, f"{self.connection.unit}_{stamp}.boat")
        self.session.start_recording(path, {"unit": self.connection.unit, "operator": self.readings.reader})
        return path

    def toggle_recording(self) -> None:
        """Start a recording, or close the one that runs."""
        if self.snapshot.recording is None:
            self.notices.attempt(self.record, done="Recording")
        elif self.snapshot.state in (SessionState.RUNNING, SessionState.PAUSED, SessionState.FINISHING):
            self.notices.say(
                Level.WARNING, "a sequence runs", "Stop the sequence first; its recording goes on until then."
            )
        else:
            self.notices.attempt(self.session.stop_recording, done="Recording closed")

    def mark(self, note: str) -> None:
        """Put a marker with a note at the newest sample."""
        now = self.live.now_s()
        if self.notices.attempt(lambda: self.session.mark(note)) and not math.isnan(now):
            self.live.markers.append(Marker(now, note))

    def close(self) -> None:
        """Vent, close the recording and the link, end the work under way."""
        self.bench.close()
        self.preparation.close()
        self.runs.close()
        self.shadow.close()
        self.monitor.close()
        self.session.close()
        self.connection.close()
