"""`boat-daq queue`: several runs one after the other, with pauses and confirmations between."""

from __future__ import annotations

import dataclasses
import sys
import time
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, complete_cycles, emit_json, notify, progress_bar, show_table

if TYPE_CHECKING:
    from boat_daq.engine.run_queue import QueuedRun


def queue(
    file: Annotated[Path, typer.Argument(metavar="FILE.toml", help="The queue: tables [[run]] with plan and unit.")],
    port: Annotated[str, typer.Option(help="Serial port, pty or socket://HOST:PORT.")] = "",
    profile: Annotated[Path | None, typer.Option(help="Text profile (TOML) of other firmware.")] = None,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of the recordings.")] = Path(),
    preview: Annotated[bool, typer.Option("--preview", help="Print runs, times and file names, and exit.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Confirm every wait for the operator beforehand.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Run a queue: each run is recorded into a file of its own; a run that fails ends the queue, vented.

    A run has a plan, a unit, and where wanted cycles, pause_s, wait (what the operator confirms first), name (template
    of the file) and note.

    Example: boat-daq queue monday.toml --port /dev/ttyACM0 --out monday
    """
    from boat_daq.engine.run_queue import load_queue

    runs = load_queue(file)
    rows = [_row(run, file.parent, out) for run in runs]
    if preview:
        if as_json:
            emit_json({"runs": rows, "lasts_s": sum(row["lasts_s"] + row["pause_s"] for row in rows)})
        else:
            cells = ([str(row[key]) for key in ("plan", "unit", "lasts_s", "pause_s", "wait", "file")] for row in rows)
            show_table(("plan", "unit", "s", "pause, s", "wait for", "file"), cells, left=6)
        return
    if not port:
        raise typer.BadParameter("give --port, or --preview")
    if any(run.wait for run in runs) and not yes and not sys.stdin.isatty():
        raise typer.BadParameter("nobody can confirm the waits here: add --yes", param_hint="--yes")
    done, failure = [], ""
    out.mkdir(parents=True, exist_ok=True)
    for number, run in enumerate(runs, 1):
        _before(run, number, len(runs), ask=not yes)
        content, failure = _run(run, file.parent, port, profile, out)
        done.append(content)
        if failure:
            notify(f"run {number} failed: {failure}; the queue ends here")
            break
    if as_json:
        emit_json({"runs": done, "planned": len(runs), "failure": failure})
    if failure:
        raise typer.Exit(1)


def _row(run: QueuedRun, folder: Path, out: Path) -> dict[str, Any]:
    plan = run.loaded(folder)
    path = _path(run, plan.name, out)
    return {**dataclasses.asdict(run), "plan": plan.name, "lasts_s": round(plan.duration_s), "file": str(path)}


def _path(run: QueuedRun, plan: str, out: Path) -> Path:
    from boat_daq.engine.file_names import named
    from boat_daq.engine.settings import load_settings

    settings = load_settings()
    template = run.name or settings.file_name or "{unit}_{plan}_{number}"
    return named(template, out, datetime.now().astimezone(), unit=run.unit, plan=plan, operator=settings.operator)


def _before(run: QueuedRun, number: int, of: int, *, ask: bool) -> None:
    """Pause and wait for the operator, as a run states."""
    notify(f"run {number} of {of}: {run.plan}{f', unit {run.unit}' if run.unit else ''}")
    begun = time.monotonic()
    if run.pause_s:
        with progress_bar("pause") as advance:
            while (passed := time.monotonic() - begun) < run.pause_s:
                advance(passed, run.pause_s)
                time.sleep(min(0.2, run.pause_s))
    if run.wait and ask:
        typer.confirm(f"{run.wait}. Continue?", default=True, abort=True, err=True)


def _run(run: QueuedRun, folder: Path, port: str, profile: Path | None, out: Path) -> tuple[dict[str, Any], str]:
    """Record one run; return what was recorded, and why it failed."""
    from boat_daq.workflows.run_session import SessionRequest, run_session

    plan = run.loaded(folder)
    request = SessionRequest(
        port=port,
        path=_path(run, plan.name, out),
        plan=plan,
        profile=str(profile) if profile else None,
        unit=run.unit,
        metadata={"unit": run.unit, "note": run.note},
    )
    summary, failure, _ = run_session(request, notify=notify, progress_bar=progress_bar)
    cycles = summary.cycles.complete
    notify(f"{summary.path}: {summary.samples} samples, {complete_cycles(cycles)}, {summary.lost_samples} lost")
    head = {"file": str(summary.path), "plan": plan.name, "unit": run.unit, "samples": summary.samples}
    return {**head, "complete_cycles": cycles, "lost_samples": summary.lost_samples, "failure": failure}, failure
