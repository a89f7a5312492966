"""The one door between a window or a command and the board.

Every method may be called from any thread. What takes time happens on threads of the session's own and is seen in
`snapshot()`; only `wait`, `stop_recording` and `close` wait for something, as they say. What cannot be done as asked
raises one of `boat_daq.errors` with its cause and remedy, and changes nothing.

Threads: the reading thread (`acquisition`) brings blocks and carries out what follows from them; the keeper's thread
(`keeper`) opens ports, looks for a lost board and lets time pass; the recorder writes on its own. `core` joins them
under one lock; `vent()` writes to the port before it asks for that lock.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from boat_daq.engine.control.controller import MANUAL_RAMP_KPA_PER_S, Controller
from boat_daq.engine.control.preflight import Check
from boat_daq.engine.display.ring_buffer import RingBuffer
from boat_daq.engine.log import note
from boat_daq.engine.plan import Plan, StepMark, resume_point
from boat_daq.engine.recording.resumption import BrokenRun
from boat_daq.engine.session.active_recording import Recordings
from boat_daq.engine.session.core import Core, SampleSink
from boat_daq.engine.session.health_log import HealthLog, Vitals
from boat_daq.engine.session.journal import now_utc
from boat_daq.engine.session.link_supervisor import LinkSupervisor
from boat_daq.engine.settings import Settings, UnitLibrary, load_settings, take_remarks
from boat_daq.engine.snapshot import LinkState, MessageKind, Reading, SessionSnapshot, SessionState
from boat_daq.errors import DeviceError, OperatorError
from protocol.link.messages import Vent
from protocol.recording import RunEnd

VENTING_WAIT_S = 5.0
POLL_S = 0.01


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
        self._core = Core()
        self._recordings = Recordings(self._core, self.settings, self.units)
        self._keeper = LinkSupervisor(self._core, self.settings, end_recording=self._recordings.end)
        self._health_log = HealthLog(self._vitals)
        self._tell_remarks()
        self._goes_on: tuple[int, int] | None = None  # first cycle and complete cycles of an armed run that goes on

    @property
    def ring(self) -> RingBuffer | None:
        """Samples for the screen; None until a board has answered, another one after a new `connect`."""
        return self._core.ring

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
        go_on_in: BrokenRun | None = None,
        for_plan: Plan | None = None,
    ) -> None:
        """Open `port` (a path, a name, socket://HOST:PORT, replay:FILE[@SPEED]) and look for a board there.

        Returns at once. `snapshot().link` becomes OPENING and then UP, or FAILED with `link_error`: no such port, busy,
        no permission, silent for 2.5 s, not a BOAT board, another protocol version.

        Parameters
        ----------
        profile : a text profile's path or TOML for a board that does not speak the BOAT protocol.
        rate_hz : samples per second asked of the board; the setting's when None.
        unit : name of the unit on the bench (SA1 ..), whose limits then hold.
        record_to, metadata : begin this recording before the board's first sample; as `start_recording`. Where that
            fails, the link FAILED.
        go_on_in : in place of `record_to`, go on in the recording of a broken run; as `resume_recording`.
        for_plan : with either, a plan outside the limits is refused before the recording is touched.

        Raises
        ------
        OperatorError : connected already, or no usable name of a unit.
        """
        control = Controller(
            rate_hz=rate_hz or self.settings.rate_hz, zero_tolerance_kpa=self.settings.zero_tolerance_kpa
        )
        if unit:
            limits = self.units.load(unit)
            control.interlock.set_limits("unit", (limits.min_kpa, limits.max_kpa))
        self._tell_remarks()
        self._recordings.unit = unit
        path = go_on_in.path if go_on_in is not None else record_to

        def greeted() -> None:
            assert path is not None
            if for_plan is not None:
                with self._core.acting() as board:
                    board.readiness.require_plan(for_plan)
            self._recordings.begin(path, metadata, go_on_in, port=port)

        self._keeper.open(port, profile, control, greeted=greeted if path is not None else None)
        note("info", f"connecting to {port}, profile {'none' if profile is None else 'given'}, {control.rate_hz} Hz")
        self._health_log.start()

    def wait(self, condition: Callable[[SessionSnapshot], bool], timeout_s: float | None = None) -> SessionSnapshot:
        """Block the caller (a command, never a window) until `condition(snapshot)` holds or the time is over."""
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            seen = self.snapshot()
            if condition(seen) or (deadline is not None and time.monotonic() >= deadline):
                return seen
            time.sleep(POLL_S)

    def wait_connected(self, timeout_s: float = 8.0) -> SessionSnapshot:
        """Block until the link is UP, or was: a short replay is at its end before anyone looks.

        Raises
        ------
        DeviceError : the link FAILED, cause and remedy are those of `link_error`; or the time is over.
        """
        seen = self.wait(lambda s: s.link in (LinkState.UP, LinkState.FAILED, LinkState.CLOSED), timeout_s)
        if seen.link is LinkState.UP or (seen.link is LinkState.CLOSED and seen.last is not None):
            return seen
        cause, remedy = seen.link_error or (f"no samples came within {timeout_s:g} s", "check the board and its cable")
        raise DeviceError(cause, remedy)

    def disconnect(self) -> None:
        """Vent, stop the stream, close the recording and the port. Returns at once; see `snapshot().link`."""
        self._keeper.close()

    def close(self) -> None:
        """Disconnect and end the threads; waits for them. The session is not used again."""
        self._keeper.end()
        self._recordings.end(RunEnd.STOPPED)
        self._health_log.stop()

    def _tell_remarks(self) -> None:
        """Say aloud that a backup stands in for a stored file."""
        for cause, remedy in take_remarks():
            self._core.tell(MessageKind.BACKUP_USED, "warning", cause, remedy)

    def _vitals(self) -> Vitals:
        core = self._core
        health = core.health.snapshot() if core.health is not None else None
        with core.lock:
            recorder, state = core.journal.recorder, core.control.sequencer.state
            path = recorder.path if recorder else None
            return Vitals(self._keeper.state, state, health, recorder.queued if recorder else 0, path)

    # ---- the recording ---------------------------------------------------------------------------------------------

    def start_recording(self, path: Path, metadata: Mapping[str, Any] | None = None) -> None:
        """Record all that comes from now on into `path`; metadata: operator, unit, note.

        Raises
        ------
        StorageError : the folder cannot be written.
        OperatorError : a recording runs already, a run goes on, the name cannot be used, or nothing is connected.
        """
        self._recordings.begin(path, metadata, None, port=self._keeper.url)

    def resume_recording(self, broken: BrokenRun, metadata: Mapping[str, Any] | None = None) -> None:
        """Go on in the recording of a broken run (`resumption.prepare_resumption`), as a new segment.

        Its steps and readings are there again; `arm(broken.plan, go_on=True)` then continues at its next whole cycle.

        Parameters
        ----------
        metadata : operator and note of the part that begins.

        Raises
        ------
        OperatorError : another board, unit or rate; or as `start_recording`. StorageError : it cannot be written.
        """
        self._recordings.begin(broken.path, metadata, broken, port=self._keeper.url)

    def stop_recording(self) -> Path | None:
        """Close the recording properly and return its path; a run that still goes is stopped and vented first.

        Waits for the disk, and up to 5 s for a unit to vent.

        Raises
        ------
        StorageError : the disk does not take the rest; what is written stays.
        """
        self.stop()
        self.wait(lambda s: s.state is not SessionState.FINISHING or s.link is not LinkState.UP, VENTING_WAIT_S)
        return self._recordings.end(RunEnd.STOPPED)

    # ---- the run ---------------------------------------------------------------------------------------------------

    def arm(self, plan: Plan, *, wait_for_reading: bool = False, go_on: bool = False) -> None:
        """Check `plan` against every limit and make it ready; nothing moves yet.

        Parameters
        ----------
        wait_for_reading : hold each plateau until its reading is given (or skipped, or the plan's timeout).
        go_on : continue the broken run of this recording at its next whole cycle instead of beginning anew.

        Raises
        ------
        OperatorError : outside limits, a fault is latched, a run goes on, the link cannot command; in the recording of
            a broken run, another plan than its own, or beginning anew.
        """
        with self._core.acting() as control:
            recorder, broken = self._core.journal.recorder, self._core.journal.broken
            if recorder is not None and broken is not None:
                broken.check_plan(plan)
                if not go_on:
                    raise OperatorError(f"{broken.path.name} goes on with its broken run", "or begin a new recording")
            first, complete = resume_point(plan, control.sequencer.marks) if go_on else (1, 0)
            if complete >= plan.cycles:
                raise OperatorError("the run has all its cycles", "begin a new one")
            control.arm(plan, wait_for_reading=wait_for_reading, first_cycle=first, complete_cycles=complete)
            self._goes_on = (first, complete) if go_on else None
            if recorder is not None and not go_on:
                limits = control.interlock.limits
                assert limits is not None
                recorder.update_meta(
                    plan=dataclasses.asdict(plan), limits_pa=[1000 * limits.min_kpa, 1000 * limits.max_kpa]
                )

    def disarm(self) -> None:
        """Put an armed plan away."""
        with self._core.acting() as control:
            control.disarm()

    def start(self) -> None:
        """Run the armed plan after the pre-flight check.

        Raises
        ------
        OperatorError : what the pre-flight found: link, limits, e-stop, zero of the pressure sensor, disk space.
        """
        space = self._recordings.check_space()
        with self._core.acting() as control:
            control.start([space])
            journal, goes_on, self._goes_on = self._core.journal, self._goes_on, None
            if goes_on is not None and journal.recorder is not None:
                first, complete = goes_on
                cause = journal.ended.text if journal.ended else str(RunEnd.INTERRUPTED)
                journal.recorder.run_goes_on(cause, first_cycle=first, complete_cycles=complete)

    def preflight(self) -> list[Check]:
        """Return the lines of the check before the first pressure, good and bad."""
        space = self._recordings.check_space()
        with self._core.lock:
            return [*self._core.control.preflight(), space]

    def pause(self) -> None:
        """Vent and wait; the cycle under way is left out of the figures."""
        with self._core.acting() as control:
            control.pause()

    def resume(self) -> None:
        """Go on at the next whole cycle."""
        with self._core.acting() as control:
            control.resume()

    def stop(self) -> None:
        """End the run: vent, one stop record. A second call changes nothing."""
        with self._core.acting() as control:
            control.stop()

    def vent(self) -> None:
        """Vent now, in any state, from any thread; ends a run. The command leaves before anything is waited for."""
        core = self._core
        before = core.pressures
        sent = core.send_now(Vent())
        with core.acting() as control:
            # A pressure that was on its way at that instant may have left behind the vent: then once more.
            control.vent(sent=sent and before == core.pressures and before % 2 == 0)

    def clear_fault(self, by: str = "the operator") -> None:
        """Forget a latched fault whose cause is gone, here and on the board; `by` whom goes into the recording.

        Raises
        ------
        OperatorError : the cause stands.
        """
        with self._core.acting() as control:
            control.clear_fault(by)

    def set_pressure(self, target_kpa: float, ramp_kpa_per_s: float | None = None) -> None:
        """Command a pressure by hand, within limits, while no run goes on.

        Raises
        ------
        OperatorError : outside limits, latched, a run goes on, or the pre-flight check fails.
        """
        with self._core.acting() as control:
            control.set_pressure(target_kpa, MANUAL_RAMP_KPA_PER_S if ramp_kpa_per_s is None else ramp_kpa_per_s)

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
        """Keep a reading for a plateau; a second one for the same step corrects the first, which stays in the file.

        Parameters
        ----------
        elongation_mm : None withdraws the reading.
        source : "typed", "csv", "photograph", "simulated" ...
        resolution_mm : of the grid; the setting's when None.

        Raises
        ------
        OperatorError : no such plateau, or not a finite length.
        """
        resolution = self.settings.resolution_mm if resolution_mm is None else resolution_mm
        reading = Reading(step_id, elongation_mm, resolution, source, now_utc(), reader, note)
        with self._core.acting() as control:
            self._core.journal.add_reading(reading)
            control.sequencer.reading_given(step_id)
        return reading

    def skip_reading(self) -> None:
        """Let the waiting plateau go on without a reading."""
        with self._core.acting() as control:
            waiting = control.sequencer.waiting()
            if waiting is not None:
                control.sequencer.reading_given(waiting.step_id)

    def steps(self) -> tuple[StepMark, ...]:
        """Return the recording's steps so far, the current one last."""
        with self._core.lock:
            return tuple(self._core.journal.steps.values())

    def readings(self) -> tuple[Reading, ...]:
        """Return all readings, corrections included, in order of entry; the last one for a step counts."""
        with self._core.lock:
            return tuple(self._core.journal.readings)

    def mark(self, note: str) -> None:
        """Put a marker with a note at the newest sample, into the recording."""
        with self._core.lock:
            self._core.journal.event("user", "mark", note, time_us=self._core.control.dialogue.board_us)
            self._core.journal.tell(MessageKind.MARK, "info", f"marked: {note}", host_ns=time.monotonic_ns())

    # ---- what is shown ---------------------------------------------------------------------------------------------

    def snapshot(self) -> SessionSnapshot:
        """Return what is known now; never waits for I/O."""
        core, keeper = self._core, self._keeper
        health = core.health.snapshot() if core.health is not None else None
        with core.lock:
            control, recorder, port = core.control, core.journal.recorder, core.port
            latched, link = control.interlock.latched, keeper.state
            up = link is LinkState.UP
            since_us = max(self._recordings.since_us, control.first_us)
            return SessionSnapshot(
                state=control.sequencer.state,
                link=LinkState.SILENT if up and control.stream.silent else link,
                port=keeper.url,
                link_error=keeper.error,
                hello=control.hello,
                simulated=core.simulated,
                can_command=up and control.dialogue.can_command,
                why_read_only=port.why_read_only if port and up else "",
                health=health,
                speed=control.dialogue.meter.speed,
                heartbeat_ms=control.dialogue.feeder.armed_ms,
                limits=control.interlock.limits,
                last=control.last,
                plan=control.sequencer.plan,
                progress=control.sequencer.progress(),
                waiting_for_reading=control.sequencer.waiting(),
                latched=latched.cause if latched else "",
                alarms=tuple(f"sensor {n} does not move" for n in control.flat_line.frozen),
                messages=tuple(core.journal.messages),
                run_ended=control.sequencer.ended,
                recording=recorder.path if recorder else None,
                recorded_s=(control.dialogue.board_us - since_us) / 1e6 if recorder else 0.0,
                unit=self._recordings.unit,
            )

    def add_sink(self, sink: SampleSink) -> Callable[[], None]:
        """Hand every block of samples to `sink` on the reading thread; returns the function that takes it away."""
        with self._core.lock:
            self._core.sinks = (*self._core.sinks, sink)

        def remove() -> None:
            with self._core.lock:
                self._core.sinks = tuple(other for other in self._core.sinks if other is not sink)

        return remove
