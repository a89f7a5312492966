"""`boat-daq record`: one session without a window, from the port to a closed recording."""

from __future__ import annotations

import dataclasses
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer

from boat_daq.commands.console import JsonOption, emit_json, progress_bar, say

if TYPE_CHECKING:
    from boat_daq.commands.run_session import SessionRequest
    from boat_daq.engine.plan import Plan
    from boat_daq.engine.recording.resumption import BrokenRun
    from boat_daq.engine.recording.summary import Summary


class Changes(TypedDict):
    """What a call puts in place of a plan's own values."""

    cycles: int | None
    dwell_s: float | None
    ramp_kpa_per_s: float | None


class Given(TypedDict):
    """What a call says of the session, whether its recording begins or goes on (`SessionRequest`)."""

    port: str
    profile: str | None
    rate_hz: int | None
    unit: str
    metadata: dict[str, str]
    allow_remote: bool


def record(
    port: Annotated[str, typer.Option(help="Serial port, pty, socket://HOST:PORT or replay:FILE[@SPEED].")],
    profile: Annotated[Path | None, typer.Option(help="Text profile (TOML) of another firmware.")] = None,
    plan: Annotated[str | None, typer.Option(help="calibration, repeatability, or a plan's TOML file.")] = None,
    cycles: Annotated[int | None, typer.Option(help="Cycles, in place of the plan's.", min=1)] = None,
    dwell: Annotated[float | None, typer.Option(help="Shortest hold, s, in place of the plan's.", min=0)] = None,
    ramp: Annotated[float | None, typer.Option(help="Ramp, kPa/s, in place of the plan's.", min=0.01)] = None,
    elongation: Annotated[Path | None, typer.Option(help="CSV of readings: pressure_kpa,elongation_mm.")] = None,
    out: Annotated[Path | None, typer.Option(help="Recording to write; a dated name when left out.")] = None,
    operator: Annotated[str, typer.Option(help="Who records.")] = "",
    unit: Annotated[str, typer.Option(help="The unit on the bench: SA1 ...")] = "",
    note: Annotated[str, typer.Option(help="A line to remember.")] = "",
    rate: Annotated[int | None, typer.Option(help="Samples per second; the setting's when left out.", min=1)] = None,
    duration: Annotated[float | None, typer.Option(help="Without a plan: seconds to record.", min=0)] = None,
    resume: Annotated[
        Path | None, typer.Option(metavar="FILE.boat", help="Go on with the broken run of this recording.")
    ] = None,
    allow_remote: Annotated[
        bool, typer.Option("--allow-remote", help="Let socket://HOST:PORT leave this machine.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Record a session: with a plan the pressure sequence is run, without one it only listens.

    Ctrl-C vents, closes the recording properly and exits 130. A run that was broken, by a crash or an unplugged board,
    goes on in its own recording at its next whole cycle with --resume; board, unit and plan must be the same.

    Example: boat-daq record --port /dev/ttyACM0 --plan calibration --unit SA1 --out SA1.boat
    """
    from boat_daq.commands.run_session import run_session
    from boat_daq.engine.session.readings import check_against_plan, enter_readings, read_elongation_csv

    if resume is not None and (out is not None or duration is not None):
        raise typer.BadParameter("--resume goes on in its own recording: leave --out and --duration out")
    changes: Changes = {"cycles": cycles, "dwell_s": dwell, "ramp_kpa_per_s": ramp}
    readings = read_elongation_csv(elongation) if elongation is not None else None
    given: Given = {
        "port": port,
        "profile": str(profile) if profile else None,
        "rate_hz": rate,
        "unit": unit,
        "metadata": {"operator": operator, "unit": unit, "note": note},
        "allow_remote": allow_remote,
    }
    if resume is not None:
        request = resumed(take_up(resume, plan, changes, unit=unit), given)
    else:
        request = begun(choose_plan(plan, **changes), out, duration, given)
        if readings is not None and request.plan is not None:
            check_against_plan(readings, request.plan)
    summary, failure = run_session(
        request, (lambda session: enter_readings(session, readings)) if readings is not None else None
    )
    if as_json:
        emit_json({**dataclasses.asdict(summary), "failed": bool(failure), "failure": failure})
    tell(summary, failure, request)
    if failure:
        raise typer.Exit(1)


def begun(plan: Plan | None, out: Path | None, duration_s: float | None, given: Given) -> SessionRequest:
    """Return the request for a new recording."""
    from boat_daq.commands.run_session import SessionRequest

    path = out if out is not None else dated_name(given["unit"])
    return SessionRequest(path=path, plan=plan, duration_s=duration_s, **given)


def resumed(broken: BrokenRun, given: Given) -> SessionRequest:
    """Return the request for a run that goes on in its own recording, as it was begun where nothing else is given."""
    from boat_daq.commands.run_session import SessionRequest

    own: Given = {
        **given,
        "profile": given["profile"] or broken.meta["profile"],
        "rate_hz": given["rate_hz"] if given["rate_hz"] is not None else broken.meta["rate_hz"],
        "unit": broken.unit,
        "metadata": {**given["metadata"], "unit": broken.unit},
    }
    return SessionRequest(path=broken.path, plan=broken.plan, broken=broken, **own)


def tell(summary: Summary, failure: str, request: SessionRequest) -> None:
    """Say what was recorded, and how a run that broke goes on."""
    say(
        f"{summary.path}: {summary.samples} samples in {summary.duration_s:.1f} s, {summary.lost_samples} lost, "
        f"{summary.cycles.complete} complete cycles, {summary.readings} readings; {summary.stop_reason or 'not closed'}"
    )
    if failure:
        say("the run did not end as planned (see above); the recording holds everything until then")
    if failure and request.plan is not None and summary.steps:
        say(f"  to go on at its next whole cycle: boat-daq record --resume {summary.path} --port {request.port}")


def take_up(path: Path, plan: str | None, changes: Changes, *, unit: str) -> BrokenRun:
    """Return the broken run of a recording, closed properly; what is named beside it must be the recording's own.

    Raises
    ------
    OperatorError : another unit or plan, or there is nothing to go on with. StorageError, RecordingError : the file.
    """
    from boat_daq.engine.plan import load_plan
    from boat_daq.engine.recording.resumption import prepare_resumption, read_broken_run
    from boat_daq.errors import OperatorError

    broken = read_broken_run(path)
    if unit and unit != broken.unit:
        raise OperatorError(
            f"{path.name} was recorded with unit {broken.unit or 'not named'}, not {unit}",
            "a broken run goes on with its own unit: put that on the bench, or begin a new recording",
        )
    if plan is not None or any(value is not None for value in changes.values()):
        broken.check_plan(change_plan(broken.plan if plan is None else load_plan(plan), **changes))
    with progress_bar("checking") as advance:
        broken = prepare_resumption(path, progress=advance)
    say(
        f"{path.name}: {broken.cause} after {broken.complete_cycles} complete cycles; "
        f"goes on at cycle {broken.first_cycle}"
    )
    return broken


def choose_plan(
    name: str | None, *, cycles: int | None, dwell_s: float | None, ramp_kpa_per_s: float | None
) -> Plan | None:
    """Return the plan of that name with the values put in place of its own."""
    from boat_daq.engine.plan import load_plan
    from boat_daq.errors import OperatorError

    if name is not None:
        return change_plan(load_plan(name), cycles=cycles, dwell_s=dwell_s, ramp_kpa_per_s=ramp_kpa_per_s)
    if (cycles, dwell_s, ramp_kpa_per_s) != (None, None, None):
        raise OperatorError("--cycles, --dwell and --ramp change a plan, and there is none", "add --plan NAME")
    return None


def change_plan(plan: Plan, *, cycles: int | None, dwell_s: float | None, ramp_kpa_per_s: float | None) -> Plan:
    """Return the plan with the values that are given put in place of its own."""
    if cycles is not None:
        plan = dataclasses.replace(plan, cycles=cycles)
    if ramp_kpa_per_s is not None:
        plan = dataclasses.replace(plan, ramp_kpa_per_s=ramp_kpa_per_s)
    return plan if dwell_s is None else plan.with_dwell(dwell_s)


def dated_name(unit: str) -> Path:
    """Return a name in the working folder: date, time and unit."""
    from boat_daq.engine.file_names import path_in

    stamp = datetime.now().astimezone().strftime("%Y-%m-%d_%H%M%S")
    return path_in(Path(), f"{stamp}_{unit}.boat" if unit else f"{stamp}.boat")
