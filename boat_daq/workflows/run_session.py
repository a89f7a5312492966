"""One session without a window: connect, record, run a plan or only record, and end with the pressure vented.

Used by `record`, `twin hold` and `demo`. The session decides and acts; this module waits, and reports progress
and messages.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from analysis.progress import Progress
from boat_daq.engine.control.elongation import Regulator
from boat_daq.engine.log import start_log
from boat_daq.engine.plan import Plan
from boat_daq.engine.recording.resumption import BrokenRun
from boat_daq.engine.recording.summary import Summary, summarise
from boat_daq.engine.session.camera_channel import FAULT_TEXTS, REST_S, CameraChannel
from boat_daq.engine.session.session import Session
from boat_daq.engine.session.shared_vent import SharedVent
from boat_daq.engine.settings import home
from boat_daq.engine.snapshot import LinkState, SessionSnapshot, SessionState
from boat_daq.workflows.end_at_uncertainty import EndUncertainty, EnoughCycles
from boat_daq.workflows.session_messages import MessagePrinter, Notify
from boat_daq.workflows.unit_control import regulator_of
from protocol.base.errors import BoatDaqError, DeviceError
from protocol.recording import BoardState

_POLL_S = 0.1
SILENT_S = 2.0  # that a board may be silent at the end of a recording of a stated duration
CLEARING_S = 3.0
_VENTING_S = 20.0
MARKS_S = 10.0  # longest wait for the marks in the picture
_ENDED = (SessionState.IDLE, SessionState.ABORTED, SessionState.FAULT)

ProgressBar = Callable[[str], AbstractContextManager[Progress]]  # of a label


@dataclass(frozen=True, slots=True)
class SessionRequest:
    """Source, destination and plan of a recording.

    Attributes
    ----------
    max_u_mm : uncertainty (k = 2) of the elongation that ends the control of a plan in millimetres.
    uncertainty : U of an elongation, mm, at which the cycles of a staircase are enough; None runs all.
    """

    port: str
    path: Path
    plan: Plan | None = None  # the pressure sequence; None only records
    profile: str | None = None
    rate_hz: int | None = None
    unit: str = ""
    duration_s: float | None = None  # without a plan, seconds of board time to record; None until Ctrl-C
    metadata: Mapping[str, Any] = field(default_factory=dict)
    broken: BrokenRun | None = None
    hold: bool = False
    max_u_mm: float | None = None
    uncertainty: float | None = None

    def resuming(self, broken: BrokenRun) -> SessionRequest:
        """Return the request for resuming a run: as it was begun, except for what is given."""
        return replace(
            self,
            plan=broken.plan,
            broken=broken,
            profile=self.profile or broken.meta["profile"],
            rate_hz=self.rate_hz or broken.meta["rate_hz"],
            unit=broken.unit,
            metadata={**self.metadata, "unit": broken.unit},
        )


class SessionOutcome(NamedTuple):
    """Summary of the recording, why the run failed (empty if it did not), and its uncertainty where one was asked."""

    summary: Summary
    failure: str
    at_end: EndUncertainty | None


def _silent(_: str) -> AbstractContextManager[Progress]:
    return contextlib.nullcontext(lambda _done, _total: None)


def run_session(
    request: SessionRequest,
    after_run: Callable[[Session], object] | None = None,
    open_camera: Callable[[Session], CameraChannel] | None = None,
    *,
    notify: Notify = lambda _: None,
    progress_bar: ProgressBar = _silent,
) -> SessionOutcome:
    """Run one session to its end. A refused first pressure, or refused control in millimetres, leaves no recording.

    Parameters
    ----------
    after_run : called when the plan has ended and the recording is still open, to enter readings; with an uncertainty
        also after each of its cycles.
    open_camera : opens the camera that reads the elongation; None without one.
    notify : takes each message, a line of text.
    """
    start_log("record")
    camera: CameraChannel | None = None
    enough: EnoughCycles | None = None
    refused = False
    session = Session()
    shared = SharedVent(session.vent, lambda: request.unit or request.path.name, home("config"))
    try:
        seen = _connect(session, request, notify)
        if open_camera is not None:
            camera = open_camera(session)
            _wait_for_marks(camera, notify)
        if request.plan is None:
            _listen(session, request.duration_s, notify, progress_bar)
        else:
            shown = clear_latched_fault(session, seen, notify)
            vent_residual_pressure(session, notify)
            enough = EnoughCycles(session, partial(after_run or (lambda _: None), session), notify)
            enough.ask(request.uncertainty, "mm")
            with contextlib.closing(enough):
                _arm(session, request, request.plan)
                _follow(session, request.plan, enough, MessagePrinter(notify, shown), progress_bar)
        if after_run is not None:
            after_run(session)
        if camera is not None:
            _finish(camera, notify)
        failure = why_failed(session.snapshot(), request.plan)
    except BoatDaqError:
        refused = _may_go(session, request)
        if not refused and session.snapshot().recorded_s > 0:
            notify(f"{request.path} holds the samples until then")
        raise
    finally:
        if camera is not None:
            camera.close()
        shared.close()
        session.close()
        if refused:
            request.path.unlink(missing_ok=True)
    at_end = enough.at_end(request.path, request.plan) if enough is not None and request.plan is not None else None
    if at_end is not None and enough is not None and enough.ended_by is None:  # else it was reported in the run
        notify(at_end.text)
    return SessionOutcome(summarise(request.path), failure, at_end)


def _connect(session: Session, request: SessionRequest, notify: Notify) -> SessionSnapshot:
    """Connect and begin the recording of a request, and return the session once samples come."""
    session.connect(
        request.port,
        request.profile,
        rate_hz=request.rate_hz,
        unit=request.unit,
        record_to=request.path,
        metadata=request.metadata,
        resume_in=request.broken,
        for_plan=request.plan,
    )
    seen = session.wait_connected()
    if seen.simulated:
        notify("SIMULATED: this is the virtual board")
    return seen


def _finish(camera: CameraChannel, notify: Notify) -> None:
    """Wait for the readings of the last plateaus, and print how many frames gave an elongation."""
    camera.finish()
    state = camera.state
    notify(f"camera: {state.frames} frames, {state.valid} with an elongation, {state.dropped} missing")


def _wait_for_marks(channel: CameraChannel, notify: Notify) -> None:
    """Wait until the camera gives an elongation, for longer than rest is measured."""
    deadline = time.monotonic() + MARKS_S
    first_valid: float | None = None
    while first_valid is None or time.monotonic() < first_valid + 1.2 * REST_S:
        state = channel.state
        if state.error is not None:
            raise state.error
        if first_valid is None and state.valid:
            first_valid = time.monotonic()
        if time.monotonic() > deadline:
            fault = state.reading.fault if state.reading is not None else ""
            cause, remedy = FAULT_TEXTS.get(fault, ("it gives no picture", "check its cable"))
            raise DeviceError(f"the camera gives no elongation: {cause}", remedy)
        time.sleep(_POLL_S)
    notify(
        f"camera: {channel.state.rate_hz or 0:.0f} frames/s, {1e3 * (channel.about['mm_per_px'] or 0):.1f} µm a pixel"
    )


def clear_latched_fault(session: Session, seen: SessionSnapshot, notify: Notify) -> int:
    """Clear a fault latched before this session, where its cause is gone; return the newest message it covers."""
    if not seen.latched:
        return 0
    session.clear_fault("this program before its run: its cause was gone")
    notify(f"warning: {seen.latched}; the fault is cleared")
    # the next sample confirms it, and only then can a plan be armed
    session.wait(lambda s: not s.latched and (s.last is None or s.last.state is not BoardState.FAULT), CLEARING_S)
    return seen.messages[-1].number if seen.messages else 0


def vent_residual_pressure(session: Session, notify: Notify) -> None:
    last = session.snapshot().last
    if last is None or last.state not in (BoardState.RAMPING, BoardState.HOLDING):
        return
    notify(f"warning: the unit was under pressure ({last.pressure_kpa:.1f} kPa); it is vented before the run")
    session.vent()
    session.wait(lambda _: all(check.ok for check in session.preflight() if check.name == "zero"), _VENTING_S)


def _arm(session: Session, request: SessionRequest, plan: Plan) -> None:
    """Arm and start the plan of a request, with the regulator of its unit where it controls the elongation."""
    regulator: Regulator | None = None
    if plan.controls_elongation:
        units = session.units.of(simulated=session.snapshot().simulated)
        regulator = regulator_of(units, request.unit, step_mv=session.mv_per_count, max_u_mm=request.max_u_mm)
    session.arm(plan, resume=request.broken is not None, regulator=regulator, hold=request.hold)
    session.start()


def _follow(
    session: Session, plan: Plan, enough: EnoughCycles, print_new: MessagePrinter, progress_bar: ProgressBar
) -> None:
    """Wait until the plan has ended, by its last cycle or because `enough` ends it."""
    with progress_bar(plan.name) as advance:
        for seen in _snapshots(session, print_new):
            if seen.progress is not None:
                advance(seen.progress.elapsed_s, max(seen.progress.elapsed_s + seen.progress.time_left_s, 1e-9))
            enough.follow(seen)
            if seen.state in _ENDED or seen.link in (LinkState.LOST, LinkState.FAILED, LinkState.CLOSED):
                break
    if _was_refused(session, plan):
        told = [message for message in seen.messages if message.level == "error"]
        cause, remedy = (told[-1].cause, told[-1].remedy) if told else ("it was vented before it began", "")
        raise DeviceError(f"the elongation was not controlled: {cause}" if plan.controls_elongation else cause, remedy)


def _was_refused(session: Session, plan: Plan) -> bool:
    return session.snapshot().refused_first or (plan.controls_elongation and not session.steps())


def _may_go(session: Session, request: SessionRequest) -> bool:
    """Return whether the recording of a refused run is this session's own, and holds nothing that was measured."""
    seen, plan = session.snapshot(), request.plan
    own = request.broken is None and seen.recording == request.path
    return own and plan is not None and _was_refused(session, plan)


def _listen(session: Session, duration_s: float | None, notify: Notify, progress_bar: ProgressBar) -> None:
    """Record until `duration_s` of board time, or of this computer's where the board restarts or is silent.

    It also ends where the port is gone.
    """
    begun, started_s, reached = session.snapshot().recorded_s, time.monotonic(), 0.0
    late_s = SILENT_S
    with progress_bar("recording") as advance:
        for seen in _snapshots(session, MessagePrinter(notify)):
            elapsed = seen.recorded_s - begun
            late_s, reached = (0.0 if elapsed < reached else late_s), max(elapsed, reached)
            if seen.link in (LinkState.FAILED, LinkState.CLOSED):
                return
            if duration_s is None:
                continue
            advance(min(reached, duration_s), duration_s)
            if elapsed >= duration_s or time.monotonic() - started_s >= duration_s + late_s:
                return


def _snapshots(session: Session, print_new: MessagePrinter) -> Iterator[SessionSnapshot]:
    """Yield the session's state again and again, once its new messages are reported."""
    while True:
        seen = session.snapshot()
        print_new(seen)
        yield seen
        time.sleep(_POLL_S)


def why_failed(seen: SessionSnapshot, plan: Plan | None) -> str:
    """Return why the run did not end as planned; empty if it did."""
    if seen.link in (LinkState.LOST, LinkState.FAILED):
        return seen.link_error.cause if seen.link_error else seen.latched or "the link was lost"
    if plan is not None and seen.state in (SessionState.ABORTED, SessionState.FAULT):
        return seen.latched or (seen.run_ended.text if seen.run_ended else str(seen.state))
    return ""
