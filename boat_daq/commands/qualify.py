"""`boat-daq qualify`: the fault drills on this computer, and a report to sign."""

from __future__ import annotations

import shutil
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, notify_shortcomings, progress_bar
from protocol.base.errors import writing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from boat_daq.engine.qualification.drill_rig import DrillResult
    from boat_daq.engine.qualification.drills import Drill


def qualify(
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for the report, on the disk to test.")
    ] = Path(),
    only: Annotated[list[str] | None, typer.Option("--drill", help="Only this drill; may be repeated.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Run the fault drills with the virtual board on this computer, and write a dated report to sign.

    Each drill injects a fault (loss, flips, unplug, stall, leak, lamp, e-stop, kill, slow disk) and compares the
    recording with the board's true values; one drives it by SECoP. Takes one to two minutes; exits with code 1 if a
    criterion is not met. Everything is SIMULATED: program, computer, disk and port are tested, not the lab's board.

    Example: boat-daq qualify --out qualification
    """
    from boat_daq.commands.qualify_report import write_reports
    from boat_daq.engine.log import start_log
    from boat_daq.engine.qualification.drills import available, run_drill
    from boat_daq.engine.qualification.result import qualification

    start_log("qualify")
    notify_shortcomings()
    offered = available()
    drills = _chosen(offered, only)
    begun = datetime.now().astimezone()
    work = out / f"qualification_{begun:%Y-%m-%d_%H%M%S}"
    results = []
    with writing(work):
        work.mkdir(parents=True)
    try:
        with progress_bar("drills") as advance:
            for number, drill in enumerate(drills):
                results.append(run_drill(drill, work / drill.__name__))
                advance(number + 1, len(drills))
                notify(_line(results[-1]))
                if results[-1].passed:
                    shutil.rmtree(work / drill.__name__, ignore_errors=True)
    except KeyboardInterrupt:
        shutil.rmtree(work, ignore_errors=True)
        raise
    content = qualification(results, begun, whole=len(drills) == len(offered), folder=work)
    content["files"] = write_reports(content, work)
    if as_json:
        emit_json(content)
    notify(f"{content['verdict']} Report: {', '.join(str(path) for path in content['files'])}")
    if not content["passed"]:
        raise typer.Exit(1)


def _chosen(drills: Sequence[Drill], names: Sequence[str] | None) -> list[Drill]:
    known = {drill.__name__: drill for drill in drills}
    chosen = [name.replace("-", "_") for name in names or known]
    for name in chosen:
        if name not in known:
            raise typer.BadParameter(f"there is no drill {name!r}; there are {', '.join(known)}", param_hint="--drill")
    return [known[name] for name in chosen]


def _line(result: DrillResult) -> str:
    if result.passed:
        return f"{result.name}: passed, lost {result.lost} ({result.seconds:.0f} s)"
    unmet = "; ".join(f"{c.text}: {c.seen}" for c in result.criteria if not c.kept)
    return f"{result.name}: FAILED: {unmet}"
