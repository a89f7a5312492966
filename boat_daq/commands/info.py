"""`boat-daq info`: a recording in short."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, out

if TYPE_CHECKING:
    from collections.abc import Iterator

    from boat_daq.engine.recording.summary import Summary


def info(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A recording (.boat).")],
    as_json: JsonOption = False,
) -> None:
    """Say who recorded a run, when, how long, at what rate, with which gaps, segments and cycles.

    Example: boat-daq info recordings/run.boat
    """
    from boat_daq.engine.recording.summary import summarise

    summary = summarise(run)
    if as_json:
        emit_json(summary)
        return
    for name, value in _lines(summary):
        plain = "".join(c if c.isprintable() else "?" for c in value)  # no name in a file steers the terminal
        out.print(f"{name:<12}{plain}", highlight=False, markup=False, soft_wrap=True)


def _lines(summary: Summary) -> Iterator[tuple[str, str]]:
    """Give the lines for a reader."""
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
        rate += f" came of {summary.rate_sampled_hz:.2f} Hz"
    yield (
        "samples",
        f"{summary.samples} in {summary.duration_s:.2f} s, {rate} (asked: {summary.rate_asked_hz or '-'} Hz)",
    )
    yield "lost", f"{summary.lost_samples} samples in {summary.gaps} gaps, {summary.damaged_frames} damaged frames"
    if summary.pressure_min_kpa is not None and summary.pressure_max_kpa is not None:
        yield "pressure", f"{summary.pressure_min_kpa:.1f} to {summary.pressure_max_kpa:.1f} kPa"
    for segment in summary.segments:
        paused = ", paused" if segment.paused else ""
        yield (
            f"segment {segment.number}",
            f"{segment.reason}: {segment.samples} samples, {segment.duration_s:.2f} s{paused}",
        )
    for broken in summary.breaks:
        away = "" if broken.break_s is None else f" for {broken.break_s:.0f} s"
        yield (
            "break",
            f"{broken.cause} after {broken.complete_cycles} complete cycles{away}; "
            f"went on at cycle {broken.first_cycle}, segment {broken.first_segment}, {broken.utc}",
        )
    yield "cycles", f"{summary.cycles.complete} complete, {summary.cycles.partial} partial, {summary.steps} steps"
    yield "readings", f"{summary.readings}; results: {summary.results}"
    layout = f"layout {summary.layout}"
    if summary.layout < SCHEMA_VERSION:
        layout += f" of {SCHEMA_VERSION}   (boat-daq upgrade brings it up to date)"
    yield "written by", f"boat-daq {summary.program_version}, {summary.size_bytes / 1e6:.1f} MB, {layout}"
