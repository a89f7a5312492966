"""One session without a window: connect, record, run a plan or only record, and end with the pressure vented.

Used by `record` and `demo`. The session decides and acts; this module waits, shows progress and prints messages.
"""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from analysis.stopping.requirement import UNITS, check_asked
from boat_daq.commands.console import Advance, notify, progress_bar
from boat_daq.engine.control.elongation import Regulator
from boat_daq.engine.log import start_log
from boat_daq.engine.plan import Plan
from boat_daq.engine.recording.resumption import BrokenRun
from boat_daq.engine.recording.summary import Summary, summarise
from boat_daq.engine.session.camera_channel import FAULT_TEXTS, REST_S, CameraChannel
from boat_daq.engine.session.session import Session
from boat_daq.engine.session.shared_vent import SharedVent
from boat_daq.engine.settings import home, load_settings
from boat_daq.engine.snapshot import LinkState, LinkWarningCode, MessageKind, SessionSnapshot, SessionState
from boat_daq.viewmodels.live.enough_cycles import EndUncertainty, EnoughCycles
from protocol.base.errors import BoatDaqError, DeviceError
from protocol.recording import BoardState, DerivedChannel

POLL_S = 0.1
LASTING_S = 6.0  # a rate is that of the last 5 s; a start or a single loss within them is no lasting warning
CLEARING_S = 3.0
VENTING_S = 20.0
MARKS_S = 10.0  # longest wait for the marks in the picture
ENDED = (SessionState.IDLE, SessionState.ABORTED, SessionState.FAULT)


@dataclass(frozen=True, slots=True)
class SessionRequest:
    """Source, destination and plan of a recording.

    Attributes
    ----------
    port, profile, rate_hz, unit : as `Session.connect`.
    plan : the pressure sequence; None only records.
    duration_s : without a plan, seconds of board time to record; None until Ctrl-C.
    broken : the run to resume, in its own recording `path`; None begins one.
    allow_remote : whether a TCP port may be on another computer, even against the settings.
    derived : derived channels in place of the stored ones; None for those.
    max_u_mm : of a plan in millimetres, the uncertainty (k = 2) of the elongation that ends the control.
    uncertainty : at which the plan has enough cycles, mm of U or % FSO as in `EnoughCycles`; None runs all of them.
    """

    port: str
    path: Path
    plan: Plan | None = None
    profile: str | None = None
    rate_hz: int | None = None
    unit: str = ""
    duration_s: float | None = None
    metadata: Mapping[str, Any] = field(default_factory=dict)
    broken: BrokenRun | None = None
    allow_remote: bool = False
    derived: tuple[DerivedChannel, ...] | None = None
    hold: bool = False
    max_u_mm: float | None = None
    uncertainty: float | None = None


def run_session(
    request: SessionRequest,
    after_run: Callable[[Session], object] | None = None,
    open_camera: Callable[[Session], CameraChannel] | None = None,
) -> tuple[Summary, str]:
    """Run one session to its end; return a summary of the recording, and why the run failed (empty if it did not).

    Parameters and errors are those of `run_assessed_session`.
    """
    summary, failure, _ = run_assessed_session(request, after_run, open_camera)
    return summary, failure


def run_assessed_session(
    request: SessionRequest,
    after_run: Callable[[Session], object] | None = None,
    open_camera: Callable[[Session], CameraChannel] | None = None,
) -> tuple[Summary, str, EndUncertainty | None]:
    """Run one session as `run_session`; return also the uncertainty at its end, None where none was asked for.

    Parameters
    ----------
    after_run : called when the plan has ended and the recording is still open, to enter readings; with an uncertainty
        also after each of its cycles.
    open_camera : opens the camera that reads the elongation; None without one.

    Raises
    ------
    RequestError : the uncertainty is no length above 0.
    DeviceError, RequestError, StorageError : nothing could be recorded. A run that fails midway is not an error
        here: the recording holds the samples until then.
    """
    unit = UNITS.get(request.plan.kind, "mm") if request.plan is not None else "mm"
    if request.uncertainty is not None:
        check_asked(request.uncertainty, unit)
    start_log("record")
    camera: CameraChannel | None = None
    enough: EnoughCycles | None = None
    settings = load_settings()
    session = Session(dataclasses.replace(settings, allow_remote=settings.allow_remote or request.allow_remote))
    shared = SharedVent(session.vent, lambda: request.unit or request.path.name, home("config"))
    try:
        seen = _connect(session, request)
        if open_camera is not None:
            camera = open_camera(session)
            _wait_for_marks(camera)
        if request.plan is None:
            listen(session, request.duration_s)
        else:
            shown = clear_latched_fault(session, seen)
            vent_residual_pressure(session)
            enough = EnoughCycles(session, partial(after_run or (lambda _: None), session), notify)
            enough.ask(request.uncertainty, unit)
            with contextlib.closing(enough):
                run_plan(session, request, enough, shown=shown)
        if after_run is not None:
            after_run(session)
        if camera is not None:
            _finish(camera)
        failure = why_failed(session.snapshot(), request.plan)
    except BoatDaqError:
        if session.snapshot().recording is not None:
            notify(f"{request.path} holds the samples until then")
        raise
    finally:
        if camera is not None:
            camera.close()
        shared.close()
        session.close()
        for message in session.snapshot().messages:
            if message.kind is MessageKind.PLUGIN:
                notify(f"warning: {message.cause}; {message.remedy}")
    at_end = None
    if enough is not None and request.plan is not None:
        at_end = enough.at_end(request.path, request.plan)
    if at_end is not None and enough is not None and enough.ended_by is None:  # else it was reported in the run
        notify(at_end.text)
    return summarise(request.path), failure, at_end


def _connect(session: Session, request: SessionRequest) -> SessionSnapshot:
    """Connect and begin the recording of a request, and return the session once samples come.

    Raises
    ------
    DeviceError, RequestError, StorageError : as `Session.connect` and `Session.wait_connected`.
    """
    if request.derived is not None:
        session.set_derived(request.derived)
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


def _finish(camera: CameraChannel) -> None:
    """Wait for the readings of the last plateaus, and print how many frames gave an elongation."""
    camera.finish()
    state = camera.state
    notify(f"camera: {state.frames} frames, {state.valid} with an elongation, {state.dropped} missing")


def _wait_for_marks(channel: CameraChannel) -> None:
    """Wait until the camera gives an elongation, for longer than rest is measured.

    Raises
    ------
    DeviceError, DataError : why it gives none.
    """
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
        time.sleep(POLL_S)
    notify(
        f"camera: {channel.state.rate_hz or 0:.0f} frames/s, {1e3 * (channel.about['mm_per_px'] or 0):.1f} µm a pixel"
    )


def clear_latched_fault(session: Session, seen: SessionSnapshot) -> int:
    """Clear a fault that the board latched before this session, where its cause is gone.

    Returns
    -------
    Number of the newest message that this covers.

    Raises
    ------
    RequestError : the cause persists.
    """
    if not seen.latched:
        return 0
    session.clear_fault("this program before its run: its cause was gone")
    notify(f"warning: {seen.latched}; the fault is cleared")
    # the next sample confirms it, and only then can a plan be armed
    session.wait(lambda s: not s.latched and (s.last is None or s.last.state is not BoardState.FAULT), CLEARING_S)
    return seen.messages[-1].number if seen.messages else 0


def vent_residual_pressure(session: Session) -> None:
    """Vent a unit that a previous session left under pressure."""
    last = session.snapshot().last
    if last is None or last.state not in (BoardState.RAMPING, BoardState.HOLDING):
        return
    notify(f"warning: the unit was under pressure ({last.pressure_kpa:.1f} kPa); it is vented before the run")
    session.vent()
    session.wait(lambda _: all(check.ok for check in session.preflight() if check.name == "zero"), VENTING_S)


def run_plan(session: Session, request: SessionRequest, enough: EnoughCycles, *, shown: int = 0) -> None:
    """Arm and start the plan of a request, and wait until it has ended.

    Parameters
    ----------
    shown : messages up to that number need not be printed.
    enough : may end the run before its last cycle.
    """
    plan = request.plan
    assert plan is not None
    regulator = session_regulator(session, request) if plan.controls_elongation else None
    session.arm(plan, resume=request.broken is not None, regulator=regulator, hold=request.hold)
    session.start()
    for seen, advance in _snapshots(session, plan.name, shown):
        if seen.progress is not None:
            advance(seen.progress.elapsed_s, max(seen.progress.elapsed_s + seen.progress.time_left_s, 1e-9))
        enough.follow(seen)
        if seen.state in ENDED or seen.link in (LinkState.LOST, LinkState.FAILED, LinkState.CLOSED):
            return


def session_regulator(session: Session, request: SessionRequest) -> Regulator:
    """Return the regulator of the unit that is mounted.

    Raises
    ------
    RequestError, BoatDaqError : it has no accepted calibration, or is not identified.
    """
    from analysis.elongation_control.controller import Bounds
    from boat_daq.workflows.unit_control import regulator_of

    units = session.units.of(simulated=session.snapshot().simulated)
    bounds = Bounds() if request.max_u_mm is None else Bounds(u_mm=request.max_u_mm)
    return regulator_of(units, request.unit, step_mv=session.mv_per_count, bounds=bounds)


def listen(session: Session, duration_s: float | None) -> None:
    """Record until `duration_s` of board time, or until the port is gone."""
    begun = session.snapshot().recorded_s
    for seen, advance in _snapshots(session, "recording"):
        elapsed = seen.recorded_s - begun
        if duration_s is not None:
            advance(min(elapsed, duration_s), duration_s)
        if seen.link in (LinkState.FAILED, LinkState.CLOSED) or (duration_s is not None and elapsed >= duration_s):
            return


def _snapshots(session: Session, label: str, shown: int = 0) -> Iterator[tuple[SessionSnapshot, Advance]]:
    """Yield the session's state again and again with a progress bar, and print its new messages."""
    print_new = MessagePrinter(shown)
    with progress_bar(label) as advance:
        while True:
            seen = session.snapshot()
            print_new(seen)
            yield seen, advance
            time.sleep(POLL_S)


class MessagePrinter:
    """Prints a session's warnings and errors after number `shown`, and each lasting warning of the link once."""

    def __init__(self, shown: int = 0) -> None:
        self._shown = shown
        self._since: dict[LinkWarningCode, float] = {}  # since when, s of board time
        self._printed: set[LinkWarningCode] = set()

    def __call__(self, seen: SessionSnapshot) -> None:
        """Print what is new."""
        for message in seen.messages:
            if message.number > self._shown and message.level != "info":
                notify(f"{message.level}: {message.cause}")
                remedy = ": ".join(filter(None, (message.remedy, message.command)))
                if remedy:
                    notify(f"  try: {remedy}")
        self._shown = max([self._shown, *(message.number for message in seen.messages)])
        warnings = {w.code: w.text for w in (seen.health.warnings if seen.health is not None else ())}
        warnings.pop(LinkWarningCode.SILENT, None)  # has a message of its own
        self._since = {code: self._since.get(code, seen.recorded_s) for code in warnings}
        for code, since in self._since.items():
            if seen.recorded_s - since >= LASTING_S and code not in self._printed:
                notify(f"warning: {warnings[code]}")
                self._printed.add(code)


def why_failed(seen: SessionSnapshot, plan: Plan | None) -> str:
    """Return why the run did not end as planned; empty if it did."""
    if seen.link in (LinkState.LOST, LinkState.FAILED):
        return seen.link_error.cause if seen.link_error else seen.latched or "the link was lost"
    if plan is not None and seen.state in (SessionState.ABORTED, SessionState.FAULT):
        return seen.latched or (seen.run_ended.text if seen.run_ended else str(seen.state))
    return ""
