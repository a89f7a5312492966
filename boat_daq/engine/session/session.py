"""The session: the only way from a window or a command to the board.

Every method may be called from any thread. What takes time happens on threads of the session's own and is seen in
`snapshot()`; only `wait`, `stop_recording` and `close` wait for something, as documented there. What cannot be done
raises one of `protocol.base.errors` with its cause and remedy, and changes nothing.

Threads: the reading thread (`link.reader`) brings blocks and carries out what follows from them; the link supervisor's
thread opens ports, seeks a lost board and lets time pass; the recorder writes on its own. One lock guards controller
and journal: see `guarded_controller`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from boat_daq.engine.control.controller import MANUAL_RAMP_KPA_PER_S, Controller
from boat_daq.engine.control.elongation import Regulator
from boat_daq.engine.control.preflight import Check
from boat_daq.engine.installation import shortcomings
from boat_daq.engine.log import note
from boat_daq.engine.plan import Plan, StepMark, load_plan
from boat_daq.engine.recording.file import now_utc
from boat_daq.engine.recording.resumption import BrokenRun
from boat_daq.engine.session.active_recording import ActiveRecording
from boat_daq.engine.session.guarded_controller import GuardedController
from boat_daq.engine.session.health_log import HealthLog, health_line
from boat_daq.engine.session.journal import Journal
from boat_daq.engine.session.link_supervisor import LinkSupervisor
from boat_daq.engine.session.live_samples import LiveSamples
from boat_daq.engine.session.measured_blocks import MeasuredBlock, SampleQueue, blocks
from boat_daq.engine.session.unit_under_test import UnitUnderTest
from boat_daq.engine.settings import Settings, UnitLibrary, load_settings
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
from protocol.base.errors import DeviceError, RequestError
from protocol.recording import RunEnd

if TYPE_CHECKING:
    from boat_daq.engine.simulator.server import BoardInThread

VENTING_WAIT_S = 5.0
_POLL_S = 0.01
_NO_LINK = (LinkState.CLOSED, LinkState.FAILED)
_RUN_OVER = (SessionState.IDLE, SessionState.ABORTED, SessionState.FAULT)


class Session:
    """A link to one board, its recording and its run.

    `live`: samples as they come: the ring of the screen, sinks. `recording`: metadata of the recording in progress, and
    of closed ones. `unit_under_test`: stores a unit, whose limits then hold at once.
    """

    def __init__(self, settings: Settings | None = None, units: UnitLibrary | None = None) -> None:
        self.settings = load_settings() if settings is None else settings
        self.units = UnitLibrary() if units is None else units
        self._journal = Journal()
        self._control = GuardedController(self._journal, lambda command, feeds: self._link.send(command, feeds=feeds))
        self._lock, self._acting = self._control.lock, self._control.acting
        self.live = LiveSamples(self._control, self._journal, lambda: self._link.port)
        self.unit_under_test = UnitUnderTest(self.units, self._control, self._journal)
        self._link: LinkSupervisor = LinkSupervisor(
            lambda: self.settings,
            acting=self._acting,
            journal=self._journal,
            show=self.live.show,
            connected=self._remember_board,
            end_recording=self._end_recording,
        )
        self.recording = ActiveRecording(
            self._control,
            self._journal,
            self._link,
            lambda: self.settings,
            self.unit_under_test,
        )
        self._health_log = HealthLog(self._health_line)
        self.virtual_board: BoardInThread | None = None
        self._report_backups()
        self._report_shortcomings()

    # ---- from a script ---------------------------------------------------------------------------------------------

    @classmethod
    def open(cls, port: str, *, timeout_s: float = 8.0, settings: Settings | None = None, **options: Any) -> Session:
        """Connect to a board and wait for its samples: ``with Session.open(port) as session: ...``.

        Leaving the block vents, closes the recording and the port.
        """
        session = cls(settings)
        try:
            session.connect(port, **options)
            session.wait_connected(timeout_s)
        except BaseException:
            session.close()
            raise
        return session

    @classmethod
    def simulated(cls, unit: str = "SA1", *, speed: float = 20.0, seed: int = 0, **options: Any) -> Session:
        """Connect to a virtual board in this process, for notebooks and tests; all its data are marked SIMULATED.

        `speed`: board time over real time, 1 to 1000. `options`: those of `open`. `enter_simulated_readings(session)`
        then enters the elongations of its plateaus.
        """
        from boat_daq.engine.simulator.server import BoardInThread

        board = BoardInThread(unit, speed=speed, seed=seed)
        options.setdefault("metadata", {"unit": unit, "operator": "notebook"})
        try:
            session = cls.open(board.url, **options)
        except BaseException:
            board.close()
            raise
        session.virtual_board = board
        return session

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def samples(self, seconds: float | None = None, *, every_s: float = 0.05) -> Iterator[MeasuredBlock]:
        """Yield what the board sends from now on, block by block, until the link is closed.

        A script that is slow delays neither reader nor recording: see `MeasuredBlock.skipped`. `seconds`: board time;
        None for as long as the link is there. `every_s`: samples are collected for so long before they are yielded.
        """
        queue = SampleQueue(self.live.target_kpa, lambda: self.mv_per_count, self.live.other_channels)
        remove = self.live.add_sink(queue)

        def stream() -> Iterator[MeasuredBlock]:
            try:
                yield from blocks(queue, lambda: self._link.state not in _NO_LINK, seconds, every_s)
            finally:
                remove()

        return stream()

    def run(self, plan: Plan | str | Path, *, wait_for_reading: bool = False) -> RunEnding:
        """Run a plan to its end and return how it ended; vent where the script is interrupted.

        `plan`: a plan, the name of a built-in one, or its TOML file.
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

        `snapshot().link` becomes OPENING and then UP, or FAILED with `link_error`.

        Parameters
        ----------
        port : a device's path or name, or socket://HOST:PORT.
        profile : a text profile's path or TOML for a board that does not use the BOAT protocol.
        rate_hz : samples per second requested of the board; the setting's when None.
        unit : name of the unit under test (SA1 ..), whose limits then hold.
        record_to, metadata : begin this recording before the board's first sample; as `start_recording`. Where that
            fails, the link FAILED.
        resume_in : recording of a broken run to resume, instead of `record_to`; see `resume_recording`.
        """
        rate_hz = rate_hz or self.settings.rate_hz
        control = Controller(rate_hz=rate_hz, zero_tolerance_kpa=self.settings.zero_tolerance_kpa)
        stamp = self.units.stamp(unit) if unit else 0  # before the limits are read: a later change is seen
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
            self.recording.begin(path, metadata, resume_in)

        with self._lock:
            self._link.open(port, profile, greeted=None if path is None else greeted)
            self._control.controller, self.live.ring = control, None
            self._journal.new_clock()
            self.unit_under_test.mount(unit, stamp)
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
            time.sleep(_POLL_S)

    def wait_connected(self, timeout_s: float = 8.0) -> SessionSnapshot:
        """Block until the link is UP."""
        seen = self.wait(lambda s: s.link in (LinkState.UP, LinkState.FAILED, LinkState.CLOSED), timeout_s)
        if seen.link is LinkState.UP:
            return seen
        none = LinkError(f"no samples within {timeout_s:g} s", "check the board and its cable")
        cause, remedy, command = seen.link_error or none
        raise DeviceError(cause, remedy, command=command)

    def disconnect(self) -> None:
        """Vent, stop the stream, close the recording and the port. Returns at once; see `snapshot().link`."""
        self._link.close()

    def close(self) -> None:
        """Disconnect and end the threads; waits for them. The session is not used again."""
        self._link.end()
        self.recording.end(RunEnd.STOPPED)
        self._health_log.stop()
        if self.virtual_board is not None:
            self.virtual_board.close()

    # ---- the recording ---------------------------------------------------------------------------------------------

    def start_recording(self, path: Path, metadata: Mapping[str, Any] | None = None) -> None:
        """Record all that comes from now on into `path`; metadata: operator, unit, note."""
        self.recording.begin(path, metadata, None)

    def resume_recording(self, broken: BrokenRun, metadata: Mapping[str, Any] | None = None) -> None:
        """Resume the recording of a broken run, as a new segment.

        `resumption.prepare_resumption` reads the run. Its steps and readings are there again;
        `arm(broken.plan, resume=True)` then continues at its next whole cycle.
        """
        self.recording.begin(broken.path, metadata, broken)

    def stop_recording(self) -> Path | None:
        """Close the recording properly and return its path.

        A run in progress is stopped and vented first; waits for the disk, and up to 5 s for a unit to vent.
        """
        self.stop()
        self.wait(lambda s: s.state is not SessionState.FINISHING or s.link is not LinkState.UP, VENTING_WAIT_S)
        return self.recording.end(RunEnd.STOPPED)

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

        `resume`: continue the broken run of this recording at its next whole cycle instead of starting over.
        """
        self._control.arm(plan, wait_for_reading=wait_for_reading, resume=resume, regulator=regulator, hold=hold)

    def disarm(self) -> None:
        """Discard an armed plan."""
        with self._acting() as control:
            control.disarm()

    def start(self) -> None:
        """Run the armed plan after the pre-flight check."""
        self._control.start(self.recording.check_space())

    def preflight(self) -> list[Check]:
        """Return the lines of the check before the first pressure, good and bad."""
        space = self.recording.check_space()
        with self._lock:
            return [*self._control.controller.checks(), space]

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
        """End a run as finished, with the complete cycles that it has."""
        with self._acting() as control:
            control.finish_early(cause)

    def hold_at(self, plateaus: Collection[tuple[str, float]] | None) -> None:
        """Pass the plateaus of a staircase that a run needs no more; parameters as `Sequencer.hold_at`."""
        with self._acting() as control:
            control.sequencer.hold_at(plateaus)

    def stop_at_cycles(self, *, on: bool, first: int = 1) -> None:
        """Hold the last level of each cycle until `next_cycle`, as `Sequencer.stop_at_cycles`."""
        with self._acting() as control:
            control.sequencer.stop_at_cycles(on=on, first=first)

    def next_cycle(self, assessed: int | None = None) -> None:
        """Begin the next cycle of a run that holds for it, as `Sequencer.next_cycle`."""
        with self._acting() as control:
            control.sequencer.next_cycle(assessed)

    def taken(self) -> int:
        """Return how much was handed to the recording so far, for `written`."""
        recorder = self._journal.recorder
        return recorder.taken() if recorder is not None else 0

    def written(self, taken: int) -> bool:
        """Whether what was handed over until then is in the recording."""
        recorder = self._journal.recorder
        return recorder is None or recorder.committed(taken)

    def vent(self, cause: str | None = None) -> None:
        """Vent now, in any state, from any thread.

        Ends a run. The command leaves before anything is waited for. `cause`, by default the
        operator's, goes into the recording.
        """
        self._control.vent(cause)

    def clear_fault(self, by: str = "the operator") -> None:
        """Clear a latched fault whose cause is gone, here and on the board. `by` whom goes into the recording."""
        with self._acting() as control:
            control.clear_fault(by)

    def set_pressure(self, target_kpa: float, ramp_kpa_per_s: float | None = None) -> None:
        """Command a pressure manually, within limits, while no run is in progress."""
        with self._acting() as control:
            control.set_pressure(target_kpa, MANUAL_RAMP_KPA_PER_S if ramp_kpa_per_s is None else ramp_kpa_per_s)

    def control_elongation(self, mm: float, regulator: Regulator | None = None, *, hold: bool = False) -> None:
        """Control the elongation, while no run is in progress; a second call only moves the setpoint.

        A stop, a vent or a manual pressure ends it. The control itself ends it, and vents or holds, where sensors
        disagree, the elongation is unknown or does not follow, or the link is too slow. `regulator`: made for this unit
        from its calibration in force; None where it is controlled already.
        """
        with self._acting() as control:
            if regulator is not None and self.unit_under_test.name and regulator.unit != self.unit_under_test.name:
                cause = f"unit {self.unit_under_test.name} is mounted; the control is for unit {regulator.unit}"
                raise RequestError(cause, "identify the unit that is mounted")
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

        A second one for the same step corrects the first, which stays in the file; an elongation of None withdraws it.
        `source` is "typed", "csv", "photograph", "simulated" ...; `resolution_mm` is the setting's when None.
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

    def steps_on_screen(self) -> tuple[StepMark, ...]:
        """Return the steps so far whose times are on the clock of the samples in `live.ring`."""
        with self._lock:
            return tuple(mark for mark in self._journal.steps.values() if mark.number > self._journal.earlier)

    def resumed_after(self) -> int:
        """Return the number of the last step of the run that this recording resumes; 0 where it resumes none."""
        with self._lock:
            broken = self._journal.broken
            return max((mark.number for mark in broken.marks), default=0) if broken is not None else 0

    def readings(self) -> tuple[Reading, ...]:
        """Return all readings, corrections included, in order of entry. The last one for a step counts."""
        with self._lock:
            return tuple(self._journal.readings)

    # ---- the camera ------------------------------------------------------------------------------------------------

    def keep_camera(self, reading: CameraReading, about: Mapping[str, Any], rest_mm: float) -> None:
        """Show the reading of a camera's frame, and keep it where a recording runs.

        `about`: source, marks and scale, for the session's `camera`.
        """
        if (ring := self.live.ring) is not None:
            ring.add_camera(reading.host_ns, reading.elongation_mm, reading.u_mm, rest_mm)
        self.recording.keep_camera(reading, about)

    def warn_of_camera(self, cause: str, remedy: str = "") -> None:
        """Give a warning of the camera, and keep it with the recording."""
        with self._lock:
            self._journal.event("host", MessageKind.CAMERA, cause, time_us=self._control.controller.board.board_us)
            self._journal.tell(MessageKind.CAMERA, "warning", cause, remedy)

    def mark(self, note: str) -> None:
        """Put a marker with a note at the newest sample, into the recording."""
        with self._lock:
            self._journal.event("user", MessageKind.MARK, note, time_us=self._control.controller.board.board_us)
            self._journal.tell(MessageKind.MARK, "info", f"marked: {note}")

    # ---- what is shown ---------------------------------------------------------------------------------------------

    def snapshot(self) -> SessionSnapshot:
        """Return what is known now; never waits for I/O."""
        health = self._link.health_now()
        with self._lock:
            control, recorder, port = self._control.controller, self._journal.recorder, self._link.port
            latched, link = control.interlock.latched, self._link.state
            up = link is LinkState.UP
            recorded_us = control.sampled_us - self.recording.since_us
            return SessionSnapshot(
                state=control.sequencer.state,
                link=LinkState.SILENT if up and control.stream.silent else link,
                port=self._link.url,
                link_error=self._link.error,
                hello=control.hello,
                simulated=self._link.simulated(control.hello),
                can_command=up and control.board.can_command and not control.stream.silent,
                why_read_only=port.link.cannot_command_reason if port and up else "",
                health=health,
                speed=control.board.meter.speed,
                limits=control.interlock.limits,
                last=control.last,
                plan=control.sequencer.plan,
                progress=control.sequencer.progress(),
                waiting_for_reading=control.sequencer.waiting(),
                latched=latched.cause if latched else "",
                alarms=control.alarms,
                pressure_off=control.pressure_off,
                messages=tuple(self._journal.messages),
                run_ended=control.sequencer.ended,
                refused_first=control.refused_first,
                recording=recorder.path if recorder else None,
                recorded_s=recorded_us / 1e6 if recorder else 0.0,
                not_saving=recorder.failure if recorder else "",
                unit=self.unit_under_test.name,
                elongation=control.loop.state() if control.loop is not None else None,
            )

    def __repr__(self) -> str:
        now = self.snapshot()
        mark = " SIMULATED," if now.simulated else ""
        return f"<Session:{mark} {now.port or 'no port'}, link {now.link.value}, {now.state.value}>"

    @property
    def mv_per_count(self) -> float:
        """Millivolts of signal for one count of the board, known once it is connected."""
        return self._control.controller.mv_per_count

    def _health_line(self) -> str:
        self.unit_under_test.follow()
        with self._lock:
            recorder, state = self._journal.recorder, self._control.controller.sequencer.state
        return health_line(self._link.state, state, self._link.health_now(), recorder)

    # ---- inside ----------------------------------------------------------------------------------------------------

    def _remember_board(self, usb_serial: str) -> None:
        if self.unit_under_test.name and not self._link.simulated(self._control.controller.hello):
            self.unit_under_test.remember_board(usb_serial)

    def _end_recording(self, end: RunEnd) -> Path | None:
        return self.recording.end(end)

    def _report_backups(self) -> None:
        """Warn that a backup replaces a stored file."""
        with self._lock:
            for cause, remedy in take_warnings():
                self._journal.tell(MessageKind.BACKUP_USED, "warning", cause, remedy)

    def _report_shortcomings(self) -> None:
        """Name what is slower here than it could be."""
        for found in shortcomings():
            self._journal.tell(MessageKind.SLOW, "info", found.cause, found.remedy)
