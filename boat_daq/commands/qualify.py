"""`boat-daq qualify`: the fault drills on this computer, and the report that an operator signs."""

from __future__ import annotations

import shutil
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, progress_bar

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analysis.reports.document import Report, Section
    from boat_daq.engine.qualification.drills import Drill
    from boat_daq.engine.qualification.test_rig import DrillResult


def qualify(
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for the report; its disk is tried.")
    ] = Path(),
    only: Annotated[list[str] | None, typer.Option("--drill", help="Only this drill; may be repeated.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Run the fault drills against the virtual board on this computer, and write a dated report to sign.

    Each drill injects a fault (loss, flips, unplug, stall, leak, lamp, e-stop, kill, slow disk) and holds what the
    program saw against the board's own truth. It takes one to two minutes; exit code 1 where a criterion is not kept.
    Everything is SIMULATED: program, computer, disk and port are tried, not the lab's board.

    Example: boat-daq qualify --out qualification
    """
    from boat_daq.engine.log import start_log
    from boat_daq.engine.qualification.drills import available, run_drill

    start_log("qualify")
    drills = chosen(available(), only)
    begun = datetime.now().astimezone()
    work = out / f"qualification_{begun:%Y-%m-%d_%H%M%S}"
    outcomes = []
    make_folder(work)
    try:
        with progress_bar("drills") as advance:
            for number, drill in enumerate(drills):
                outcomes.append(run_drill(drill, work / drill.__name__))
                advance(number + 1, len(drills))
                notify(_line(outcomes[-1]))
                if outcomes[-1].passed:
                    shutil.rmtree(work / drill.__name__, ignore_errors=True)
    except KeyboardInterrupt:
        shutil.rmtree(work, ignore_errors=True)
        raise
    content = result(outcomes, begun, whole=len(drills) == len(available()), folder=work)
    content["files"] = write_reports(content, outcomes, work)
    if as_json:
        emit_json(content)
    notify(f"{content['verdict']} Report: {', '.join(str(path) for path in content['files'])}")
    if not content["passed"]:
        raise typer.Exit(1)


def chosen(drills: Sequence[Drill], names: Sequence[str] | None) -> list[Drill]:
    """Return the drills of these names; all when there are none."""
    known = {drill.__name__: drill for drill in drills}
    wrong = [name for name in names or () if name.replace("-", "_") not in known]
    if wrong:
        raise typer.BadParameter(f"there is no drill {wrong[0]!r}; there are {', '.join(known)}", param_hint="--drill")
    return [known[name.replace("-", "_")] for name in names] if names else list(drills)


def make_folder(folder: Path) -> None:
    """Make the folder of one qualification."""
    from boat_daq.errors import StorageError

    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise StorageError(f"{folder} cannot be made: {error.strerror}", "choose another folder with --out") from None


def result(outcomes: Sequence[DrillResult], begun: datetime, *, whole: bool, folder: Path = Path()) -> dict[str, Any]:
    """Return the object of `qualify --json`, its files apart."""
    from boat_daq.engine.qualification.installation import disk, machine, program, versions

    failed = [outcome.name for outcome in outcomes if not outcome.passed]
    passed = not failed and bool(outcomes)
    if failed:
        verdict = f"FAILED: {', '.join(failed)}. Do not trust this installation before the cause is found."
    elif whole:
        verdict = f"PASSED: all {len(outcomes)} drills."
    else:
        asked = ", ".join(outcome.name for outcome in outcomes)
        verdict = f"Passed what was asked for ({asked or 'nothing'}): this is no whole qualification."
    return {
        "simulated": True,
        "passed": passed,
        "whole": whole,
        "verdict": verdict,
        "begun": begun.isoformat(timespec="seconds"),
        "seconds": sum(outcome.seconds for outcome in outcomes),
        "program": program(),
        "machine": machine(),
        "disk": disk(folder),
        "versions": versions(),
        "drills": [drill_json(outcome) for outcome in outcomes],
    }


def drill_json(outcome: DrillResult) -> dict[str, Any]:
    """Return one drill as `qualify --json` gives it."""
    return {
        "name": outcome.name,
        "injected": outcome.injected,
        "passed": outcome.passed,
        "criteria": [{"text": c.text, "seen": c.seen, "kept": c.kept} for c in outcome.criteria],
        "lost": outcome.lost,
        "counts": outcome.counts,
        "seconds": outcome.seconds,
        "rate_hz": outcome.rate_hz,
        "boards": [
            {"port": port_kind(b.port), "speed": b.speed, "unit": b.unit, "seed": b.seed, "faults": list(b.faults)}
            for b in outcome.boards
        ],
    }


def port_kind(port: str) -> str:
    """Return in words what kind of port a board was served on."""
    return "pseudo-terminal" if port == "pty" else f"TCP on {port.partition(':')[0]}"


def write_reports(content: dict[str, Any], outcomes: Sequence[DrillResult], folder: Path) -> list[Path]:
    """Write the report as HTML, PDF and JSON into the folder."""
    import json

    from analysis.reports.html import write_html
    from analysis.reports.pdf import write_pdf
    from boat_daq.commands.console import plain

    report = build(content, outcomes)
    paths = [folder / f"qualification{suffix}" for suffix in (".html", ".pdf", ".json")]
    write_html(report, paths[0])
    write_pdf(report, paths[1])
    paths[2].write_text(json.dumps(plain(content), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return paths


def build(content: dict[str, Any], outcomes: Sequence[DrillResult]) -> Report:
    """Return the report: verdict, where to sign, what was tried on what, and each drill's criteria."""
    from analysis.reports.document import Report, ReportTable, Section

    short = ReportTable(
        ("Drill", "Result", "Lost", "Injected"),
        tuple((o.name, "passed" if o.passed else "FAILED", o.lost, o.injected) for o in outcomes),
        "What was injected into the virtual board, what the recording lacks, and whether every criterion was kept.",
        numeric=False,
    )
    blank = ("", "", "", "")
    sign = (
        "I have read this report. It tries program, computer, disk and port on a virtual board; it says nothing of the "
        "lab's board, its sensors or its plumbing.",
        ReportTable(
            ("", "Name", "Date", "Signature"), (_signature("Operator"), blank, _signature("Checked by")), numeric=False
        ),
    )
    versions = ReportTable(("Program or library", "Version"), tuple(content["versions"].items()), numeric=False)
    known = content["program"]
    return Report(
        "Qualification of the installation",
        f"{content['machine']['name']}, {content['begun'][:10]}",
        True,
        content["verdict"],
        (
            ("Begun", content["begun"]),
            ("Took", f"{content['seconds']:.0f} s for {len(outcomes)} drills"),
            *installation_facts(content),
            ("Boards", "; ".join(dict.fromkeys(filter(None, map(board_line, content["drills"])))) or "none"),
        ),
        (
            Section("Signature", sign),
            Section("Drills", (short,)),
            *(drill_section(o, drill) for o, drill in zip(outcomes, content["drills"], strict=True)),
            Section("Versions", (versions, f"SHA-256 over the program's {known['files']} files: {known['sha256']}")),
        ),
        f"boat-daq {content['versions']['boat-daq']}, qualification of {content['begun'][:10]}",
    )


def _signature(who: str) -> tuple[str, str, str, str]:
    return who, "_" * 24, "_" * 12, "_" * 28


def installation_facts(content: dict[str, Any]) -> tuple[tuple[str, str], ...]:
    """Return the lines that say what was qualified: program, computer and disk."""
    program, machine, disk = content["program"], content["machine"], content["disk"]
    return (
        ("Program", f"boat-daq {program['version']}, files {program['sha256'][:16]}, in {program['folder']}"),
        ("Computer", f"{machine['name']}: {machine['processor']}, {machine['memory']}"),
        ("System", f"{machine['system']}, Python {content['versions']['Python']}"),
        ("Folder", f"{disk['folder']}"),
        (
            "Disk",
            f"{disk['file_system']} on {disk['device']}, {disk['free_gb']:g} of {disk['size_gb']:g} GB free",
        ),
    )


def board_line(drill: dict[str, Any]) -> str:
    """Return port, speed, rate, unit and seed of a drill's board; empty where it had none."""
    if not drill["boards"]:
        return ""
    board, rate_hz = drill["boards"][0], drill["rate_hz"]
    rate = "rate not known" if rate_hz is None else f"{rate_hz:g} Hz"
    return f"{board['port']}, {board['speed']:g}x real time, {rate}, {board['unit']}, seed {board['seed']}"


def drill_section(outcome: DrillResult, drill: dict[str, Any]) -> Section:
    """Return one drill's criteria with what was seen, its board and its counts."""
    from analysis.reports.document import ReportTable, Section

    counts = "; ".join(f"{name.replace('_', ' ')} {value:g}" for name, value in outcome.counts.items())
    faults = "; ".join(f"{', '.join(board['faults']) or 'no fault of the board'}" for board in drill["boards"])
    told = ". ".join(filter(None, (board_line(drill), f"Faults: {faults}" if faults else "", counts)))
    rows = tuple((c.text, c.seen, "yes" if c.kept else "NO") for c in outcome.criteria)
    table = ReportTable(("Criterion", "Seen", "Kept"), rows, told, numeric=False)
    return Section(f"{outcome.name}: {'passed' if outcome.passed else 'FAILED'}", (table,))


def _line(outcome: DrillResult) -> str:
    """Return what is said of a drill as soon as it is over."""
    if outcome.passed:
        return f"{outcome.name}: passed, lost {outcome.lost} ({outcome.seconds:.0f} s)"
    broken = "; ".join(f"{c.text}: {c.seen}" for c in outcome.criteria if not c.kept)
    return f"{outcome.name}: FAILED: {broken}"
