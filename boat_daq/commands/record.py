"""`boat-daq record`: one session without a window, from the port to a closed recording."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from analysis.stopping.requirement import check_asked
from boat_daq.commands.console import JsonOption, complete_cycles, emit_json, notify, progress_bar
from boat_daq.commands.options import PortOption, ProfileOption, UncertaintyOption
from boat_daq.engine.file_names import named, path_in

if TYPE_CHECKING:
    from boat_daq.engine.plan import Plan
    from boat_daq.engine.recording.resumption import BrokenRun
    from boat_daq.engine.recording.summary import Summary
    from boat_daq.engine.session.camera_channel import CameraChannel
    from boat_daq.engine.session.session import Session
    from boat_daq.workflows.run_session import SessionRequest


OutOption = Annotated[Path | None, typer.Option(help="Recording to write, or a template: '{unit}_{plan}_{number}'.")]
CameraOption = Annotated[
    str | None,
    typer.Option(
        metavar="SOURCE|FILE.toml",
        help="Camera that reads the elongation: a number, http://, rtsp://, or a file with source, mark_mm, "
        "u_mark_mm, lens and video.",
    ),
]
ResumeOption = Annotated[
    Path | None, typer.Option(metavar="FILE.boat", help="Resume the interrupted run of this recording.")
]


def record(
    port: PortOption,
    profile: ProfileOption = None,
    plan: Annotated[str | None, typer.Option(help="calibration, repeatability, step-test, ... or a TOML file.")] = None,
    cycles: Annotated[int | None, typer.Option(help="Cycles, in place of the plan's.", min=1)] = None,
    dwell: Annotated[float | None, typer.Option(help="Shortest hold, s, in place of the plan's.", min=0)] = None,
    ramp: Annotated[float | None, typer.Option(help="Ramp, kPa/s, in place of the plan's.", min=0.01)] = None,
    elongation: Annotated[Path | None, typer.Option(help="CSV of readings: pressure_kpa,elongation_mm.")] = None,
    uncertainty: UncertaintyOption = None,
    out: OutOption = None,
    operator: Annotated[str, typer.Option(help="Name of the operator.")] = "",
    unit: Annotated[str, typer.Option(help="Name of the unit: SA1 ...")] = "",
    note: Annotated[str, typer.Option(help="Note to store in the recording.")] = "",
    duration: Annotated[float | None, typer.Option(help="Without a plan: seconds to record.", min=0)] = None,
    camera: CameraOption = None,
    resume: ResumeOption = None,
    as_json: JsonOption = False,
) -> None:
    """Record a session: with a plan its pressure sequence is run, without one the samples are only recorded.

    Ctrl-C vents, closes the recording properly and exits 130. A run that was interrupted, by a crash or an unplugged
    board, is resumed in its own recording at its next whole cycle with --resume; board, unit and plan must be the same.

    Example: boat-daq record --port /dev/ttyACM0 --plan calibration --unit SA1 --out SA1.boat
    """
    if uncertainty is not None:
        check_asked(uncertainty, "mm")
    from boat_daq.workflows.run_session import SessionRequest, run_session

    if resume is not None and (out is not None or duration is not None):
        raise typer.BadParameter("--resume continues its own recording: omit --out and --duration")
    values = {"cycles": cycles, "dwell_s": dwell, "ramp_kpa_per_s": ramp}
    changes = {name: value for name, value in values.items() if value is not None}
    begun = None if resume is not None else chosen_plan(plan, changes)
    if resume is None:
        _check_kind(begun, uncertainty)
    if uncertainty is not None and elongation is None and camera is None:
        raise typer.BadParameter("needs --elongation or --camera", param_hint="--uncertainty")
    request = SessionRequest(
        port=port,
        path=resume or _path(out, unit, plan or "", operator),
        plan=begun,
        profile=str(profile) if profile else None,
        unit=unit,
        duration_s=duration,
        metadata={"operator": operator, "unit": unit, "note": note},
        uncertainty=uncertainty,
    )
    if resume is not None:
        request = request.resuming(broken_run(resume, plan, changes, unit=unit))
        _check_kind(request.plan, uncertainty)
    enter = None if elongation is None else _entry(elongation, request, growing=uncertainty is not None)
    open_camera = None if camera is None else _camera_opener(camera, request.unit)
    summary, failure, at_end = run_session(request, enter, open_camera, notify=notify, progress_bar=progress_bar)
    if as_json:
        ended = {"failed": bool(failure), "failure": failure}
        emit_json({**dataclasses.asdict(summary), **ended, "end_uncertainty": at_end and dataclasses.asdict(at_end)})
    _report(summary, failure, request)


def _camera_opener(camera: str, unit: str) -> Callable[[Session], CameraChannel]:
    """Return what opens the camera; one that cannot be is refused now, before the board is opened."""
    from boat_daq.workflows.camera_tracking import camera_choice, open_channel

    choice = camera_choice(camera, unit)
    choice.tracker()
    return partial(open_channel, choice=choice)


def _check_kind(plan: Plan | None, uncertainty: float | None) -> None:
    """Refuse U as the end of a plan that has none."""
    if uncertainty is None or (plan is not None and plan.kind == "staircase"):
        return
    what = "no plan is given" if plan is None else f"this one is {plan.kind}"
    if plan is not None and plan.kind == "continuous":
        what += ": it has no plateaus to read; set end_percent_fso in its file"
    raise typer.BadParameter(f"applies to staircase plans; {what}", param_hint="--uncertainty")


def _entry(file: Path, request: SessionRequest, *, growing: bool) -> Callable[[Session], None]:
    """Return the function that enters the readings of the plateaus reached.

    With `growing` the file grows while the plan is run. RequestError: as `check_against_plan`, where a run begins.
    """
    from boat_daq.engine.session.reading_sources import check_against_plan, enter_readings, readings_so_far
    from protocol.recording.elongation_file import read_elongation_rows

    plan, readings = request.plan, read_elongation_rows(file)
    if plan is not None and request.broken is None and not growing:
        check_against_plan(readings, plan)

    def enter(session: Session) -> None:
        rows = readings
        if growing and plan is not None:
            rows = readings_so_far(read_elongation_rows(file), plan, session.steps())
        enter_readings(session, rows)

    return enter


def _report(summary: Summary, failure: str, request: SessionRequest) -> None:
    """Print what was recorded; of a run that failed how to resume it, and exit with 1."""
    notify(
        f"{summary.path}: {summary.samples} samples in {summary.duration_s:.1f} s, {summary.lost_samples} lost, "
        f"{complete_cycles(summary.cycles.complete)}, {summary.readings} readings; "
        f"{summary.stop_reason or 'not closed'}"
    )
    if failure:
        notify("the run did not end as planned (see above); the recording holds everything until then")
    if failure and request.plan is not None and summary.steps:
        notify(f"  to resume it at its next whole cycle: boat-daq record --resume {summary.path} --port {request.port}")
    if failure:
        raise typer.Exit(1)


def broken_run(path: Path, plan: str | None, changes: dict[str, Any], *, unit: str) -> BrokenRun:
    """Return the interrupted run of a recording, closed properly.

    RequestError: another unit or plan is given, or there is nothing to resume. StorageError: the file is damaged.
    """
    from boat_daq.engine.plan import load_plan
    from boat_daq.engine.recording.resumption import prepare_resumption, read_broken_run
    from protocol.base.errors import RequestError

    broken = read_broken_run(path)
    if unit and unit != broken.unit:
        cause = f"{path.name} was recorded with unit {broken.unit or 'not named'}, not {unit}"
        raise RequestError(cause, "mount that unit, or begin a new recording")
    if plan is not None or changes:
        broken.check_plan((broken.plan if plan is None else load_plan(plan)).changed(**changes))
    with progress_bar("checking") as progress:
        broken = prepare_resumption(path, progress=progress)
    whole = complete_cycles(broken.complete_cycles)
    notify(f"{path.name}: {broken.cause} after {whole}; resuming at cycle {broken.first_cycle}")
    return broken


def chosen_plan(name: str | None, changes: dict[str, Any]) -> Plan | None:
    """Return the plan of that name with the values that replace its own; None without a name."""
    from boat_daq.engine.plan import load_plan
    from protocol.base.errors import ChoiceError

    if name is None and changes:
        raise ChoiceError("--cycles, --dwell and --ramp need a plan", "add --plan NAME")
    return load_plan(name).changed(**changes) if name is not None else None


def _path(out: Path | None, unit: str, plan: str, operator: str) -> Path:
    """Return the file to record into: as given, by a template (of the settings without `out`), or a dated name."""
    from boat_daq.engine.settings import load_settings

    template = out.name if out is not None else load_settings().file_name
    if "{" not in template:
        return out or dated_name(unit)
    values = {"unit": unit, "plan": Path(plan).stem, "operator": operator}
    return named(template, out.parent if out is not None else Path(), datetime.now().astimezone(), **values)


def dated_name(unit: str) -> Path:
    """Return a name in this folder, of date, time and unit."""
    stamp = datetime.now().astimezone().strftime("%Y-%m-%d_%H%M%S")
    return path_in(Path(), f"{stamp}_{unit}.boat" if unit else f"{stamp}.boat")
