"""The session: the only way from a window or a command to the board.

Every method may be called from any thread. What takes time happens on threads of the session's own and is seen in
`snapshot()`; only `wait`, `stop_recording` and `close` wait for something, as documented there. What cannot be done
raises one of `boat_daq.errors` with its cause and remedy, and changes nothing.

Threads: the reading thread (`link.reader`) brings blocks and carries out what follows from them; the link supervisor's
thread opens ports, seeks a lost board and lets time pass; the recorder writes on its own. Controller and journal are
joined under one lock, under which nothing is waited for but a write to the port, 250 ms at the longest; effects are
carried out in the controller's order. `vent()` writes to the port before it takes that lock.
"""

from __future__ import annotations

import dataclasses
import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self, TypeAlias

import numpy as np

from boat_daq.engine.control.board_commands import Check, Send
from boat_daq.engine.control.controller import MANUAL_RAMP_KPA_PER_S, Controller
from boat_daq.engine.control.elongation import Regulator
from boat_daq.engine.derived_store import load_derived
from boat_daq.engine.display.ring_buffer import RingBuffer
from boat_daq.engine.installation import shortcomings
from boat_daq.engine.link.reader import Block
from boat_daq.engine.log import note
from boat_daq.engine.plan import Plan, StepMark, load_plan, resume_point
from boat_daq.engine.plugins import Hooks
from boat_daq.engine.recording.file import now_utc
from boat_daq.engine.recording.resumption import BrokenRun
from boat_daq.engine.sample_columns import units_of
from boat_daq.engine.session.active_recording import ActiveRecording
from boat_daq.engine.session.journal import HealthLog, Journal, health_line
from boat_daq.engine.session.link_supervisor import LinkSupervisor
from boat_daq.engine.session.measured_blocks import MeasuredBlock, SampleQueue, blocks
from boat_daq.engine.settings import Settings, Unit, UnitLibrary, load_settings
from boat_daq.engine.snapshot import (
    CameraReading,
    LinkError,
    LinkState,
    MessageKind,
    Reading,
    RunEnding,
    SessionSnapshot,
    SessionState,
)
from boat_daq.engine.stored_file import take_warnings
from boat_daq.errors import BoatDaqError, DeviceError, OperatorError, StorageError
from protocol.errors import RecordingError
from protocol.link.events import Samples
from protocol.link.messages import SetPressure, Vent
from protocol.recording import DerivedChannel, DerivedColumns, Metadata, RunEnd

VENTING_WAIT_S = 5.0
POLL_S = 0.01
_NO_LINK = (LinkState.CLOSED, LinkState.FAILED)
_RUN_OVER = (SessionState.IDLE, SessionState.ABORTED, SessionState.FAULT)
_RUN_OVER_OR_ARMED = (*_RUN_OVER, SessionState.ARMED)

SampleSink: TypeAlias = Callable[[np.ndarray[Any, Any]], None]


class Session:
    """A link to one board, its recording and its run.

    Parameters
    ----------
    settings : rate, tolerances, folders; the stored ones when None.
    units : where the units' limits are kept; the stored library when None.
    """

    def __init__(self, settings: Settings | None = None, units: UnitLibrary | None = None) -> None:
        self.settings = load_settings() if settings is None else settings
        self.units = UnitLibrary() if units is None else units
        self._lock = threading.RLock()
        self._control = Controller()
        self._journal = Journal()
        self.ring: RingBuffer | None = None  # for the screen: none until the first sample, another one after `connect`
        self._sinks: tuple[SampleSink, ...] = ()
        self.derived: tuple[DerivedChannel, ...] = ()
        self._filmed: object = None  # the recorder that knows of the camera, and what it knows
        self._about_camera: dict[str, Any] = {}
        self._pressures = 0  # odd while a pressure is being sent: see `vent`
        self._resumes_at: tuple[int, int] | None = None  # first cycle and complete cycles of an armed resumption
        self._link = LinkSupervisor(
            lambda: self.settings,
            acting=self._acting,
            journal=self._journal,
            show=self._show,
            connected=self._remember_board,
            end_recording=self._end_recording,
        )
        self._recording = ActiveRecording(
            self._acting, self._journal, self._link, lambda: self.settings, self.units, self.derived_columns
        )
        self._unit_stamp = 0  # of the file whose limits hold
        self._health_log = HealthLog(self._health_line)
        self._hooks = Hooks(self._plugin_failed)
        self._journal.warned = self._warned
        self._report_backups()
        self._report_shortcomings()
        self._load_derived()

    # ---- from a script ---------------------------------------------------------------------------------------------

    @classmethod
    def open(cls, port: str, *, timeout_s: float = 8.0, settings: Settings | None = None, **options: Any) -> Session:
        """Connect to a board and wait for its samples: ``with Session.open(port) as session: ...``.

        Leaving the block vents, closes the recording and the port.

        Parameters
        ----------
        port, options : as `connect`.
        timeout_s : longest wait.
        settings : the stored ones when None.

        Raises
        ------
        DeviceError, OperatorError, StorageError : as `connect` and `wait_connected`.
        """
        session = cls(settings)
        try:
            session.connect(port, **options)
            session.wait_connected(timeout_s)
        except BaseException:
            session.close()
            raise
        return session

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def samples(self, seconds: float | None = None, *, every_s: float = 0.05) -> Iterator[MeasuredBlock]:
        """Yield what the board sends from now on, block by block, until the link is closed.

        A script that is slow delays neither reader nor recording: see `MeasuredBlock.skipped`.

        Parameters
        ----------
        seconds : of board time; None for as long as the link is there.
        every_s : samples are collected for so long before they are yielded.
        """
        queue = SampleQueue(self.target_kpa, lambda: self.mv_per_count)
        remove = self.add_sink(queue)

        def stream() -> Iterator[MeasuredBlock]:
            try:
                yield from blocks(queue, lambda: self._link.state not in _NO_LINK, seconds, every_s)
            finally:
                remove()

        return stream()

    def run(self, plan: Plan | str | Path, *, wait_for_reading: bool = False) -> RunEnding:
        """Run a plan to its end and return how it ended; vent where the script is interrupted.

        Parameters
        ----------
        plan : a plan, the name of a built-in one, or its TOML file.
        wait_for_reading : as `arm`.

        Raises
        ------
        OperatorError : as `arm` and `start`. DeviceError : the link was lost; the board vents by itself.
        """
        self.arm(plan if isinstance(plan, Plan) else load_plan(str(plan)), wait_for_reading=wait_for_reading)
        try:
            self.start()
            seen = self.wait(lambda s: s.state in _RUN_OVER or s.link in (*_NO_LINK, LinkState.LOST))
        except BaseException:
            self.vent()
            raise
        if seen.run_ended is None:
            raise DeviceError(seen.latched or "the link was lost during the run", "see the messages of the session")
        return seen.run_ended

    # ---- the link --------------------------------------------------------------------------------------------------

    def connect(
        self,
        port: str,
        profile: str | None = None,
        *,
        rate_hz: int | None = None,
        unit: str = "",
        record_to: Path | None = None,
        metadata: Mapping[str, Any] | None = None,
        resume_in: BrokenRun | None = None,
        for_plan: Plan | None = None,
    ) -> None:
        """Open a port and identify the board there; return at once.

        `snapshot().link` becomes OPENING and then UP, or FAILED with `link_error`: no such port, busy, no permission,
        silent for 2.5 s, not a BOAT board, another protocol version.

        Parameters
        ----------
        port : a device's path or name, socket://HOST:PORT, replay:FILE[@SPEED].
        profile : a text profile's path or TOML for a board that does not use the BOAT protocol.
        rate_hz : samples per second requested of the board; the setting's when None.
        unit : name of the unit under test (SA1 ..), whose limits then hold.
        record_to, metadata : begin this recording before the board's first sample; as `start_recording`. Where that
            fails, the link FAILED.
        resume_in : in place of `record_to`, resume the recording of a broken run; as `resume_recording`.
        for_plan : with either, a plan outside the limits is refused before the recording is touched.

        Raises
        ------
        OperatorError : connected already, or not a usable name of a unit.
        """
        rate_hz = rate_hz or self.settings.rate_hz
        control = Controller(rate_hz=rate_hz, zero_tolerance_kpa=self.settings.zero_tolerance_kpa)
        stamp = self.units.stamp(unit) if unit else 0
        if unit:
            limits = self.units.load(unit)
            control.interlock.set_limits("unit", (limits.min_kpa, limits.max_kpa))
        self._report_backups()
        path = record_to if resume_in is None else resume_in.path

        def greeted() -> None:
            assert path is not None
            if for_plan is not None:
                with self._acting() as board:
                    board.preflight.require_plan(for_plan)
            self._recording.begin(path, metadata, resume_in)

        with self._lock:
            self._link.open(port, profile, greeted=None if path is None else greeted)
            self._control, self.ring, self._recording.unit = control, None, unit
            self._unit_stamp = stamp
            control.hold_samples = path is not None
        given = "none" if profile is None else "given"
        note("info", f"connecting to {port}, profile {given}, {control.stream.rate_hz} Hz")
        self._health_log.start()

    def wait(self, condition: Callable[[SessionSnapshot], bool], timeout_s: float | None = None) -> SessionSnapshot:
        """Block a command, never a window, until the condition holds or the time is over."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            seen = self.snapshot()
            if condition(seen) or (deadline is not None and time.monotonic() >= deadline):
                return seen
            time.sleep(POLL_S)

    def wait_connected(self, timeout_s: float = 8.0) -> SessionSnapshot:
        """Block until the link is UP, or was.

        A short replay is over before the first look.

        Raises
        ------
        DeviceError : the link FAILED, cause and remedy are those of `link_error`; or the time is over.
        """
        seen = self.wait(lambda s: s.link in (LinkState.UP, LinkState.FAILED, LinkState.CLOSED), timeout_s)
        if seen.link is LinkState.UP or (seen.link is LinkState.CLOSED and seen.last is not None):
            return seen
        none = LinkError(f"no samples within {timeout_s:g} s", "check the board and its cable")
        cause, remedy, command = seen.link_error or none
        raise DeviceError(cause, remedy, command=command)

    def store_unit(self, unit: Unit) -> None:
        """Store a unit; the limits of the one under test hold at once, and an armed plan is disarmed.

        Raises
        ------
        OperatorError : a run is in progress with it, or as `UnitLibrary.save`. StorageError : as there.
        """
        before = self.units.load(unit.name)
        limits, old = ((u.min_kpa, u.max_kpa) for u in (unit, before))
        under_test = unit.name == self._recording.unit
        if under_test:
            with self._acting() as control:
                control.use_unit_limits(limits)
        try:
            self.units.save(unit)
        except BoatDaqError:
            if under_test:
                with self._acting() as control:
                    control.use_unit_limits(old)
            raise

    def _follow_unit(self) -> None:
        """Take the limits of the unit under test where another program has changed its file; in a run, after it."""
        unit, before = self._recording.unit, self._unit_stamp
        stamp = self.units.stamp(unit) if unit else before
        if stamp == before:
            return
        with self._acting() as control:
            if control.sequencer.state not in _RUN_OVER_OR_ARMED:
                return
        self._unit_stamp = stamp
        try:
            stored = self.units.load(unit)
            with self._acting() as control:
                if control.use_unit_limits((stored.min_kpa, stored.max_kpa)):
                    text = f"the limits of unit {unit} are now {stored.min_kpa:g} to {stored.max_kpa:g} kPa"
                    self._journal.tell(MessageKind.UNIT_LIMITS, "info", text, "arm the plan again where one was armed")
        except OperatorError as error:
            with self._lock:
                self._journal.tell(MessageKind.UNIT_LIMITS, "warning", error.cause, error.remedy)

    def disconnect(self) -> None:
        """Vent, stop the stream, close the recording and the port.

        Returns at once; see `snapshot().link`.
        """
        self._link.close()

    def close(self) -> None:
        """Disconnect and end the threads; waits for them. The session is not used again."""
        self._link.end()
        self._end_recording(RunEnd.STOPPED)
        self._health_log.stop()
        self._hooks.close()

    # ---- the recording ---------------------------------------------------------------------------------------------

    def start_recording(self, path: Path, metadata: Mapping[str, Any] | None = None) -> None:
        """Record all that comes from now on into `path`; metadata: operator, unit, note.

        Raises
        ------
        StorageError : the folder cannot be written.
        OperatorError : a recording or a run is in progress, the name cannot be used, or nothing is connected.
        """
        self._recording.begin(path, metadata, None)

    def resume_recording(self, broken: BrokenRun, metadata: Mapping[str, Any] | None = None) -> None:
        """Resume the recording of a broken run, as a new segment.

        `resumption.prepare_resumption` reads the run. Its steps and readings are there again;
        `arm(broken.plan, resume=True)` then continues at its next whole cycle.

        Parameters
        ----------
        broken : the run.
        metadata : operator and note of the part that begins.

        Raises
        ------
        OperatorError : another board, unit or rate; or as `start_recording`. StorageError : it cannot be written.
        """
        self._recording.begin(broken.path, metadata, broken)

    def metadata(self, path: Path) -> Metadata:
        """Return the metadata of a recording, in progress or closed.

        Raises
        ------
        RecordingError : it cannot be read.
        """
        return self._recording.metadata(path)

    def state_metadata(self, path: Path, metadata: Metadata) -> None:
        """State metadata of a recording, in progress or closed; the newest count.

        Raises
        ------
        RecordingError : not a recording. StorageError : it cannot be written.
        """
        self._recording.state(path, metadata)

    def stop_recording(self) -> Path | None:
        """Close the recording properly and return its path.

        A run in progress is stopped and vented first.

        Waits for the disk, and up to 5 s for a unit to vent.

        Raises
        ------
        StorageError : the disk does not take the rest; what is written stays.
        """
        self.stop()
        self.wait(lambda s: s.state is not SessionState.FINISHING or s.link is not LinkState.UP, VENTING_WAIT_S)
        return self._end_recording(RunEnd.STOPPED)

    # ---- the run ---------------------------------------------------------------------------------------------------

    def arm(
        self,
        plan: Plan,
        *,
        wait_for_reading: bool = False,
        resume: bool = False,
        regulator: Regulator | None = None,
        hold: bool = False,
    ) -> None:
        """Check a plan against every limit and make it ready; nothing moves yet.

        Parameters
        ----------
        plan : what to run.
        regulator, hold : of a plan in millimetres, as `control_elongation`.
        wait_for_reading : hold each plateau until its reading is given (or skipped, or the plan's timeout).
        resume : continue the broken run of this recording at its next whole cycle instead of starting over.

        Raises
        ------
        OperatorError : outside limits, a fault is latched, a run is in progress, the link cannot command; in the
            recording of a broken run, another plan than its own, or starting over.
        """
        with self._acting() as control:
            recorder, broken = self._journal.recorder, self._journal.broken
            if recorder is not None and broken is not None:
                broken.check_plan(plan)
                if not resume:
                    cause = f"{broken.path.name} holds an interrupted run, which can only be resumed there"
                    raise OperatorError(cause, "resume it, or begin a new recording")
            resume_at = resume_point(plan, control.sequencer.marks) if resume else (1, 0)
            if resume_at[1] >= plan.cycles:
                raise OperatorError("the run has all its cycles", "begin a new one")
            control.arm(
                plan, wait_for_reading=wait_for_reading, resume_at=resume_at, regulator=regulator, hold=hold
            )  # fmt: skip
            self._resumes_at = resume_at if resume else None
            if recorder is not None and not resume:
                limits = control.interlock.limits
                assert limits is not None
                recorder.update_meta(plan=dataclasses.asdict(plan), limits_pa=limits.pascals)

    def disarm(self) -> None:
        """Discard an armed plan."""
        with self._acting() as control:
            control.disarm()

    def start(self) -> None:
        """Run the armed plan after the pre-flight check.

        Raises
        ------
        OperatorError : what the pre-flight found: link, limits, e-stop, zero of the pressure sensor, disk space.
        """
        space = self._recording.check_space()
        with self._acting() as control:
            control.start([space])
            resumes_at, self._resumes_at = self._resumes_at, None
            if resumes_at is not None and self._journal.recorder is not None:
                first, complete = resumes_at
                cause = self._journal.ended.text if self._journal.ended else str(RunEnd.INTERRUPTED)
                self._journal.recorder.run_resumed(cause, first_cycle=first, complete_cycles=complete)

    def preflight(self) -> list[Check]:
        """Return the lines of the check before the first pressure, good and bad."""
        space = self._recording.check_space()
        with self._lock:
            return [*self._control.checks(), space]

    def pause(self) -> None:
        """Vent and wait; the present cycle is left out of the figures."""
        with self._acting() as control:
            control.pause()

    def resume(self) -> None:
        """Resume a paused run at the next whole cycle."""
        with self._acting() as control:
            control.resume()

    def stop(self) -> None:
        """End the run: vent, one stop record. A second call changes nothing."""
        with self._acting() as control:
            control.stop()

    def finish_early(self, cause: str) -> None:
        """End a run as finished, with the complete cycles that it has.

        Parameters
        ----------
        cause : why they are enough; recorded with the run.

        Raises
        ------
        OperatorError : no run is in progress, or no cycle is complete.
        """
        with self._acting() as control:
            control.finish_early(cause)

    def vent(self) -> None:
        """Vent now, in any state, from any thread.

        Ends a run. The command leaves before anything is waited for.
        """
        before = self._pressures
        sent = self._link.send(Vent())
        with self._acting() as control:
            # A pressure that was being sent at that instant may have left behind the vent: then vent once more.
            control.vent(sent=sent and before == self._pressures and before % 2 == 0)

    def clear_fault(self, by: str = "the operator") -> None:
        """Clear a latched fault whose cause is gone, here and on the board.

        `by` whom goes into the recording.

        Raises
        ------
        OperatorError : the cause is still present.
        """
        with self._acting() as control:
            control.clear_fault(by)

    def set_pressure(self, target_kpa: float, ramp_kpa_per_s: float | None = None) -> None:
        """Command a pressure manually, within limits, while no run is in progress.

        Raises
        ------
        OperatorError : outside limits, latched, a run is in progress, or the pre-flight check fails.
        """
        with self._acting() as control:
            control.set_pressure(target_kpa, MANUAL_RAMP_KPA_PER_S if ramp_kpa_per_s is None else ramp_kpa_per_s)

    def control_elongation(self, mm: float, regulator: Regulator | None = None, *, hold: bool = False) -> None:
        """Control the elongation, while no run is in progress; a second call only moves the setpoint.

        A stop, a vent or a manual pressure ends it. The control itself ends it, and vents or holds, where sensors
        disagree, the elongation is unknown or does not follow, or the link is too slow.

        Parameters
        ----------
        mm : the setpoint, within the calibrated range.
        regulator : made for this unit from its calibration in force; None where it is controlled already.
        hold : keep the last pressure where the control ends by itself, in place of venting.

        Raises
        ------
        OperatorError : no regulator, latched, a run is in progress, the board is too fast, or the pre-flight fails.
        AnalysisError : outside the calibrated range.
        """
        with self._acting() as control:
            if regulator is not None and self._recording.unit and regulator.unit != self._recording.unit:
                cause = f"unit {self._recording.unit} is mounted; the control is for unit {regulator.unit}"
                raise OperatorError(cause, "identify the unit that is mounted")
            control.control_elongation(mm, regulator, hold=hold)

    # ---- readings --------------------------------------------------------------------------------------------------

    def add_reading(
        self,
        step_id: int,
        elongation_mm: float | None,
        source: str,
        *,
        resolution_mm: float | None = None,
        reader: str = "",
        note: str = "",
    ) -> Reading:
        """Keep a reading for a plateau.

        A second one for the same step corrects the first, which stays in the file.

        Parameters
        ----------
        step_id : the plateau's step.
        elongation_mm : None withdraws the reading.
        source : "typed", "csv", "photograph", "simulated" ...
        resolution_mm : of the grid; the setting's when None.
        reader, note : who read it, and a remark for people.

        Raises
        ------
        OperatorError : no such plateau, or not a finite length.
        """
        resolution = self.settings.resolution_mm if resolution_mm is None else resolution_mm
        reading = Reading(step_id, elongation_mm, resolution, source, now_utc(), reader, note)
        with self._acting() as control:
            self._journal.add_reading(reading)
            control.sequencer.reading_given(step_id)
        return reading

    def skip_reading(self) -> None:
        """Let the waiting plateau end without a reading."""
        with self._acting() as control:
            waiting = control.sequencer.waiting()
            if waiting is not None:
                control.sequencer.reading_given(waiting.step_id)

    def steps(self) -> tuple[StepMark, ...]:
        """Return the recording's steps so far, the current one last."""
        with self._lock:
            return tuple(self._journal.steps.values())

    def readings(self) -> tuple[Reading, ...]:
        """Return all readings, corrections included, in order of entry.

        The last one for a step counts.
        """
        with self._lock:
            return tuple(self._journal.readings)

    # ---- the camera ------------------------------------------------------------------------------------------------

    def keep_camera(self, reading: CameraReading, about: Mapping[str, Any]) -> None:
        """Keep the reading of a camera's frame, where a recording runs.

        Parameters
        ----------
        reading : of the frame.
        about : source, marks and scale, for the session's `camera`.
        """
        with self._lock:
            recorder = self._journal.recorder
            if recorder is None:
                return
            if recorder is not self._filmed or about != self._about_camera:
                self._filmed, self._about_camera = recorder, dict(about)
                recorder.update_meta(camera=self._about_camera)
            recorder.camera(reading)

    def warn_of_camera(self, cause: str, remedy: str = "") -> None:
        """Give a warning of the camera, and keep it with the recording."""
        with self._lock:
            self._journal.event("host", MessageKind.CAMERA, cause, time_us=self._control.board.board_us)
            self._journal.tell(MessageKind.CAMERA, "warning", cause, remedy)

    def mark(self, note: str) -> None:
        """Put a marker with a note at the newest sample, into the recording."""
        with self._lock:
            self._journal.event("user", MessageKind.MARK, note, time_us=self._control.board.board_us)
            self._journal.tell(MessageKind.MARK, "info", f"marked: {note}")

    # ---- what is shown ---------------------------------------------------------------------------------------------

    def snapshot(self) -> SessionSnapshot:
        """Return what is known now; never waits for I/O."""
        health = self._link.health_now()
        with self._lock:
            control, recorder, port = self._control, self._journal.recorder, self._link.port
            latched, link = control.interlock.latched, self._link.state
            up = link is LinkState.UP
            since_us = max(self._recording.since_us, control.first_us)
            return SessionSnapshot(
                state=control.sequencer.state,
                link=LinkState.SILENT if up and control.stream.silent else link,
                port=self._link.url,
                link_error=self._link.error,
                hello=control.hello,
                simulated=self._link.simulated(control.hello),
                can_command=up and control.board.can_command,
                why_read_only=port.why_read_only if port and up else "",
                health=health,
                speed=control.board.meter.speed,
                limits=control.interlock.limits,
                last=control.last,
                plan=control.sequencer.plan,
                progress=control.sequencer.progress(),
                waiting_for_reading=control.sequencer.waiting(),
                latched=latched.cause if latched else "",
                alarms=tuple(f"the signal of sensor {n} is constant" for n in control.flat_line.frozen),
                messages=tuple(self._journal.messages),
                run_ended=control.sequencer.ended,
                recording=recorder.path if recorder else None,
                recorded_s=(control.board.board_us - since_us) / 1e6 if recorder else 0.0,
                unit=self._recording.unit,
                elongation=control.loop.state() if control.loop is not None else None,
            )

    def add_sink(self, sink: SampleSink) -> Callable[[], None]:
        """Pass every block of samples to `sink` on the reading thread.

        Return the function that removes it.
        """
        with self._lock:
            self._sinks = (*self._sinks, sink)

        def remove() -> None:
            with self._lock:
                self._sinks = tuple(other for other in self._sinks if other is not sink)

        return remove

    def target_kpa(self) -> float:
        """Return the pressure that is commanded now, NaN for none."""
        return _kpa(self._control.target_kpa)

    def set_derived(self, channels: Sequence[DerivedChannel]) -> None:
        """Use other derived channels from now on; the plots begin anew.

        Raises
        ------
        OperatorError : a recording is in progress: it states those of its beginning.
        RecordingError : one is refused.
        """
        with self._lock:
            if self._journal.recorder is not None:
                cause = "a recording in progress has the derived channels of its beginning"
                raise OperatorError(cause, "stop the recording first")
            port = self._link.port
            if port is not None and port.link.n_sensors:
                DerivedColumns.of(channels, units_of(port.link))
            self.derived, self.ring = tuple(channels), None

    def derived_columns(self) -> DerivedColumns:
        """Return the derived channels that the board's samples allow; a warning names each of the others."""
        port = self._link.port
        if not self.derived or port is None or not port.link.n_sensors:
            return DerivedColumns()
        units, good = units_of(port.link), list[DerivedChannel]()
        for channel in self.derived:
            try:
                DerivedColumns.of([*good, channel], units)
            except RecordingError as error:
                with self._lock:
                    if all(told.cause != error.cause for told in self._journal.messages):
                        self._journal.tell(MessageKind.DERIVED, "warning", error.cause, error.remedy)
            else:
                good.append(channel)
        return DerivedColumns.of(good, units)

    @property
    def mv_per_count(self) -> float:
        """Millivolts of signal for one count of the board, known once it is connected."""
        return self._control.mv_per_count

    def _show(self, block: Block) -> None:
        """Pass a block's samples to ring and sinks, on the reading thread, without the lock."""
        arrays = [event.array for event in block.events if isinstance(event, Samples) and len(event.array)]
        if not arrays:
            return
        control = self._control
        if self.ring is None:
            link = self._link.port.link if self._link.port else None
            assert link is not None and link.n_sensors is not None  # known from the board before its first sample
            self.ring = RingBuffer(
                link.n_sensors,
                mv_per_count=control.mv_per_count,
                channels=link.channels,
                derived=self.derived_columns(),
            )
        self.ring.target_kpa = self.target_kpa()
        self.ring(block)
        for sink in self._sinks:
            for array in arrays:
                sink(array)

    def _health_line(self) -> str:
        self._recording.take_request()
        self._follow_unit()
        with self._lock:
            recorder, state = self._journal.recorder, self._control.sequencer.state
        return health_line(self._link.state, state, self._link.health_now(), recorder)

    # ---- inside ----------------------------------------------------------------------------------------------------

    @contextmanager
    def _acting(self) -> Iterator[Controller]:
        """Give the controller under the lock, and carry out its effects, even on an error."""
        with self._lock:
            self._control.board.now_ns = time.monotonic_ns()
            try:
                yield self._control
            finally:
                self._carry_out()

    def _carry_out(self) -> None:
        """Send and keep the controller's effects, in its order."""
        board_us = self._control.board.board_us
        for effect in self._control.take():
            if not isinstance(effect, Send):
                self._journal.take(effect, time_us=board_us)
            elif isinstance(effect.command, SetPressure):
                self._pressures += 1
                self._link.send(effect.command)
                self._pressures += 1
            else:
                self._link.send(effect.command, feeds=effect.feeds)

    def _remember_board(self, usb_serial: str) -> None:
        """Store the USB serial number of a real board with its unit, by which it is found again."""
        unit = self._recording.unit
        if not unit or self._link.simulated(self._control.hello):
            return
        try:
            stored = self.units.load(unit)
            if stored.usb_serial != usb_serial:
                self.units.save(dataclasses.replace(stored, usb_serial=usb_serial))
        except (OperatorError, StorageError) as error:
            with self._lock:
                cause = f"the board's USB serial number is not stored with unit {unit}: {error.cause}"
                self._journal.tell(MessageKind.STORAGE, "warning", cause, error.remedy)

    def _end_recording(self, end: RunEnd) -> Path | None:
        path = self._recording.end(end)
        if path is not None:
            self._hooks.emit("recording_closed", run=str(path))
        return path

    def _warned(self, kind: MessageKind, cause: str, remedy: str) -> None:
        self._hooks.emit("warning_raised", kind=str(kind), cause=cause, remedy=remedy)

    def _plugin_failed(self, cause: str, remedy: str) -> None:
        with self._lock:
            self._journal.tell(MessageKind.PLUGIN, "warning", cause, remedy)

    def _report_backups(self) -> None:
        """Warn that a backup replaces a stored file."""
        with self._lock:
            for cause, remedy in take_warnings():
                self._journal.tell(MessageKind.BACKUP_USED, "warning", cause, remedy)

    def _load_derived(self) -> None:
        """Take the stored derived channels; a file that is refused is named in a warning."""
        try:
            self.derived = load_derived()
        except (OperatorError, RecordingError) as error:
            self._journal.tell(MessageKind.DERIVED, "warning", error.cause, error.remedy)

    def _report_shortcomings(self) -> None:
        """Name what is slower here than it could be."""
        for found in shortcomings():
            self._journal.tell(MessageKind.SLOW, "info", found.cause, found.remedy)


def _kpa(target_kpa: float | None) -> float:
    """Return the commanded pressure, NaN for none."""
    return math.nan if target_kpa is None else target_kpa
