"""`boat-daq recover`, `upgrade`, `verify`, `info` and `metadata`: one recording as a file."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from boat_daq.commands.console import (
    JsonOption,
    complete_cycles,
    emit_json,
    notify_shortcomings,
    present,
    progress_bar,
    show,
)
from boat_daq.commands.options import RecordingArgument, SetOption, values_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from boat_daq.engine.recording.summary import Summary
    from boat_daq.engine.recording.verify import StoredResult, Verification


def recover(
    file: Annotated[Path, typer.Argument(metavar="FILE.boat", help="A recording that was not closed, or is damaged.")],
    as_json: JsonOption = False,
) -> None:
    """Close the recording of a killed session, or copy what is readable of a damaged file into a new one.

    A damaged file itself is never changed.

    Example: boat-daq recover recordings/run.boat
    """
    from boat_daq.engine.recording.recovery import recover as recover_file

    with progress_bar("checking") as progress:
        recovery = recover_file(file, progress=progress)
    results = {
        "recovered": "recovered: the recording was interrupted and is now closed",
        "salvaged": f"damaged: the readable part is in {recovery.path}",
        "closed": "the recording was closed properly; nothing to do",
    }
    result = results.get(recovery.status, f"the recording is {recovery.status}; nothing to do")
    text = f"{result} ({recovery.samples} samples, {recovery.chunks} chunks)"
    lines = [*(f"  {line}" for line in recovery.damaged), *(f"  missing: {line}" for line in recovery.missing.lines())]
    if recovery.log in ("unproven", "absent") and recovery.missing_pages is None:
        both = f"{file.name}-wal and {file.name}-shm"
        lines.append(f"  {both} are not both present: copy them with the unclosed {file.name}, and recover that")
    lines += [f"  kept unchanged: {path}" for path in recovery.kept]
    present(recovery, text, *lines, as_json=as_json)


def upgrade(
    file: Annotated[Path, typer.Argument(metavar="FILE.boat", help="A recording of an older program.")],
    as_json: JsonOption = False,
) -> None:
    """Bring an older recording to the present layout; the original file is kept as a backup beside it.

    Older recordings can be read without it; it is needed only before adding to one.

    Example: boat-daq upgrade recordings/run.boat
    """
    from boat_daq.engine.recording.upgrade import upgrade as upgrade_file

    done = upgrade_file(file)
    text = f"upgraded from layout {done.version_before} to {done.version}; the original is {done.backup}"
    if done.backup is None:
        text = f"{file} has layout {done.version} already; nothing to do"
    present(done, text, as_json=as_json)


IMPORTED = "import:"  # scheme of the port of a recording imported from a CSV


def verify(run: RecordingArgument, as_json: JsonOption = False) -> None:
    """Check a run against its raw bytes, from samples to figures, and print `identical` or the first difference.

    Example: boat-daq verify recordings/run.boat
    """
    from boat_daq.engine.recording.summary import summarise
    from boat_daq.engine.recording.verify import verify_recording

    with progress_bar("verifying") as progress:
        if (summarise(run).port or "").startswith(IMPORTED):
            verdict = verify_import(run)
        else:
            from analysis.figures.stored_results import code_state

            verdict = verify_recording(run, reanalyse=reanalyse, code=code_state(), progress=progress)
    missing = tuple(f"  missing: {line}" for line in verdict.missing.lines())
    identical = "what was saved is identical" if missing else "identical"
    present(verdict, identical if verdict.identical else f"different: {verdict.difference}", *missing, as_json=as_json)
    if not verdict.identical:
        raise typer.Exit(1)


def reanalyse(run: Path, stored: StoredResult) -> dict[str, Any] | None:
    """Return a stored analysis computed anew; None for other kinds, and for those that used other files."""
    from analysis.figures.stored_results import reproduce

    return reproduce(run, stored.parameters) if stored.kind == "analysis" else None


def verify_import(run: Path) -> Verification:
    """Return the comparison of an imported recording with a new import of its stored CSV."""
    import time

    from analysis.data.boat_writer import first_difference
    from boat_daq.engine.recording.summary import summarise
    from boat_daq.engine.recording.verify import Verification
    from boat_daq.workflows.run_files import import_capture

    begun = time.perf_counter()
    difference = first_difference(run, import_capture)
    return Verification(not difference, difference, summarise(run).samples, 0, 0, time.perf_counter() - begun)


def info(run: RecordingArgument, as_json: JsonOption = False) -> None:
    """Summarise a run: operator, unit, time, duration, rate, gaps, segments and cycles.

    Example: boat-daq info recordings/run.boat
    """
    from analysis.numbers import finite
    from boat_daq.engine.installation import shortcomings
    from boat_daq.engine.recording.summary import summarise

    summary = summarise(run)
    # no text of a file controls the terminal
    lines = (f"{name:<11} " + "".join(c if c.isprintable() else "?" for c in value) for name, value in _lines(summary))
    content = {**finite(summary), "shortcomings": [finite(found) for found in shortcomings()]}
    present(content, *lines, as_json=as_json)
    notify_shortcomings()


def _lines(summary: Summary) -> Iterator[tuple[str, str]]:
    from protocol.recording import SCHEMA_VERSION

    yield "recording", f"{summary.path}{'   SIMULATED' if summary.simulated else ''}"
    status = summary.status if summary.stop_reason is None else f"{summary.status}, {summary.stop_reason}"
    yield "status", status + ("   (boat-daq recover closes it)" if summary.status == "interrupted" else "")
    yield "operator", summary.operator or "-"
    yield "unit", f"{summary.unit or '-'} on board {summary.board_id or '-'} at {summary.port or '-'}"
    yield from ((name.lower(), text) for name, text in summary.metadata.lines() if name != "Operator")
    yield "started", summary.started_utc or "-"
    yield "ended", summary.ended_utc or "-"
    rate = "-" if summary.rate_hz is None else f"{summary.rate_hz:.2f} Hz"
    if summary.lost_samples and summary.rate_sampled_hz is not None:
        rate += f" received of {summary.rate_sampled_hz:.2f} Hz"
    requested = f"requested: {summary.rate_asked_hz:g} Hz" if summary.rate_asked_hz else "requested: -"
    yield "samples", f"{summary.samples} in {summary.duration_s:.2f} s, {rate} ({requested})"
    if summary.channels:
        yield "channels", ", ".join(channel.quantity for channel in summary.channels)
    least = "" if summary.missing.exact else "at least "
    gaps = f"{summary.lost_samples} samples in {summary.gaps} gaps"
    yield "lost", f"{least}{gaps}, {summary.damaged_frames} damaged frames"
    yield from (("missing", line) for line in summary.missing.lines())
    if summary.pressure_min_kpa is not None and summary.pressure_max_kpa is not None:
        yield "pressure", f"{summary.pressure_min_kpa:.1f} to {summary.pressure_max_kpa:.1f} kPa"
    for segment in summary.segments:
        extent = f"{segment.samples} samples, {segment.duration_s:.2f} s{', paused' if segment.paused else ''}"
        yield f"segment {segment.number}", f"{segment.reason}: {extent}"
    for broken in summary.breaks:
        duration = "" if broken.break_s is None else f" for {broken.break_s:.0f} s"
        ended = f"{broken.cause} after {complete_cycles(broken.complete_cycles)}{duration}"
        resumed = f"resumed at cycle {broken.first_cycle}, segment {broken.first_segment}, {broken.utc}"
        yield "break", f"{ended}; {resumed}"
    counts = f"{summary.cycles.complete} complete, {summary.cycles.partial} partial, {summary.steps} steps"
    yield "cycles", counts if summary.steps or summary.cycles.complete else "not marked; boat-daq analyze finds them"
    yield "readings", f"{summary.readings}; results: {summary.results}"
    layout = f"layout {summary.layout}"
    if summary.layout < SCHEMA_VERSION:
        layout += f" of {SCHEMA_VERSION}   (boat-daq upgrade brings it up to date)"
    yield "written by", f"boat-daq {summary.program_version}, {summary.size_bytes / 1e6:.1f} MB, {layout}"


def metadata(
    run: RecordingArgument,
    values: SetOption = None,
    marker: Annotated[
        tuple[float, str] | None,
        typer.Option("--add-marker", metavar="SECONDS TEXT", help="Add a marker at a time from the first sample."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show the metadata and markers of a recording, or change them; the unit's next recording inherits them.

    Keys: operator, customer, item, serial_number, note, ambient_temperature_c, ambient_humidity_percent; any other key
    names a field of your own. Earlier values stay in the file. During a recording only the program that
    records can change them.

    Example: boat-daq metadata SA1.boat --set customer="Soft Robotics Lab" --set serial_number=0042
    """
    from boat_daq.engine.recording.metadata_entry import read_metadata, remember, state_metadata
    from boat_daq.engine.recording.summary import summarise
    from boat_daq.engine.settings import UnitLibrary
    from boat_daq.workflows.run_files import add_marker, markers_of

    stated = read_metadata(run)
    if values:
        stated = stated.changed(values_of(values))
        state_metadata(run, stated)
        summary = summarise(run)
        remember(UnitLibrary(simulated=summary.simulated), summary.unit or "", stated)
    if marker is not None:
        add_marker(run, *marker)
    marks = markers_of(run)
    if as_json:
        emit_json({**asdict(stated), "markers": [{"time_s": time_s, "text": text} for time_s, text in marks]})
        return
    for label, text in stated.lines() or (("metadata", "none stated"),):
        show(f"{label.lower():<20} " + "".join(c if c.isprintable() else " " for c in text))
    for time_s, text in marks:
        show(f"marker at {time_s:>8.2f} s " + "".join(c if c.isprintable() else " " for c in text))
