"""`boat-daq info`: the summary of a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING

from boat_daq.commands.console import JsonOption, present
from boat_daq.commands.options import RecordingArgument

if TYPE_CHECKING:
    from collections.abc import Iterator

    from boat_daq.engine.recording.summary import Summary


def info(run: RecordingArgument, as_json: JsonOption = False) -> None:
    """Summarise a run: operator, unit, time, duration, rate, gaps, segments and cycles.

    Example: boat-daq info recordings/run.boat
    """
    from boat_daq.engine.recording.summary import summarise

    summary = summarise(run)
    # no text of a file controls the terminal
    lines = (f"{name:<12}" + "".join(c if c.isprintable() else "?" for c in value) for name, value in _lines(summary))
    present(summary, *lines, as_json=as_json)


def _lines(summary: Summary) -> Iterator[tuple[str, str]]:
    """Yield the name and the text of each line."""
    from protocol.recording import SCHEMA_VERSION

    yield "recording", f"{summary.path}{'   SIMULATED' if summary.simulated else ''}"
    status = summary.status if summary.stop_reason is None else f"{summary.status}, {summary.stop_reason}"
    yield "status", status + ("   (boat-daq recover closes it)" if summary.status == "interrupted" else "")
    yield "operator", summary.operator or "-"
    yield "unit", f"{summary.unit or '-'} on board {summary.board_id or '-'} at {summary.port or '-'}"
    if summary.note:
        yield "note", summary.note
    yield "started", summary.started_utc
    yield "ended", summary.ended_utc or "-"
    rate = "-" if summary.rate_hz is None else f"{summary.rate_hz:.2f} Hz"
    if summary.lost_samples and summary.rate_sampled_hz is not None:
        rate += f" received of {summary.rate_sampled_hz:.2f} Hz"
    requested = f"requested: {summary.rate_asked_hz or '-'} Hz"
    yield "samples", f"{summary.samples} in {summary.duration_s:.2f} s, {rate} ({requested})"
    yield "lost", f"{summary.lost_samples} samples in {summary.gaps} gaps, {summary.damaged_frames} damaged frames"
    if summary.pressure_min_kpa is not None and summary.pressure_max_kpa is not None:
        yield "pressure", f"{summary.pressure_min_kpa:.1f} to {summary.pressure_max_kpa:.1f} kPa"
    for segment in summary.segments:
        extent = f"{segment.samples} samples, {segment.duration_s:.2f} s{', paused' if segment.paused else ''}"
        yield f"segment {segment.number}", f"{segment.reason}: {extent}"
    for broken in summary.breaks:
        duration = "" if broken.break_s is None else f" for {broken.break_s:.0f} s"
        yield (
            "break",
            f"{broken.cause} after {broken.complete_cycles} complete cycles{duration}; "
            f"resumed at cycle {broken.first_cycle}, segment {broken.first_segment}, {broken.utc}",
        )
    yield "cycles", f"{summary.cycles.complete} complete, {summary.cycles.partial} partial, {summary.steps} steps"
    yield "readings", f"{summary.readings}; results: {summary.results}"
    layout = f"layout {summary.layout}"
    if summary.layout < SCHEMA_VERSION:
        layout += f" of {SCHEMA_VERSION}   (boat-daq upgrade brings it up to date)"
    yield "written by", f"boat-daq {summary.program_version}, {summary.size_bytes / 1e6:.1f} MB, {layout}"
