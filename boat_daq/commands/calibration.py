"""`boat-daq calibration` and `convert`: the calibration of a run as data and as code, and signals converted by it."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TextIO

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, progress_bar
from boat_daq.commands.options import (
    DegreeOption,
    LeaveOutOption,
    MapOption,
    RateOption,
    ReadingsOption,
    RunArgument,
    one_of,
)
from protocol.base.errors import writing

if TYPE_CHECKING:
    import pandas as pd

    from analysis.calibration_export.calibration_file import CalibrationFile

_ROWS_AT_ONCE = 100_000
_FORMATS = ("json", "c", "h", "matlab", "csv")


FormatOption = Annotated[
    str, typer.Option(callback=one_of(*_FORMATS), help="json, c (or h: a C99 header), matlab (Octave too) or csv.")
]
ToOption = Annotated[Path | None, typer.Option("--out", metavar="PATH", help="File to write; default standard output.")]
TableErrorOption = Annotated[
    float | None,
    typer.Option(
        "--table-error",
        metavar="MM",
        help="Bound on the error of a table: csv 0.001 by default; c becomes a table in single precision.",
    ),
]


def calibration(
    run: RunArgument,
    format: FormatOption,
    to: ToOption = None,
    elongation: ReadingsOption = None,
    degree: DegreeOption = "3",
    leave_out: LeaveOutOption = False,
    table_error: TableErrorOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write the calibration of a run as data or as code: signals in, elongation and its uncertainty out.

    json is what `convert` reads: coefficients, covariance, ranges and U over x. c is a header without a library for a
    microcontroller, matlab a function boat_elongation.m, csv a table.

    Example: boat-daq calibration SA1.boat --format c --out boat_calibration.h
    """
    if table_error is not None and format in ("json", "matlab"):
        raise typer.BadParameter("applies to csv and c only", param_hint="--table-error")
    if to is None and as_json and format != "json":
        raise typer.BadParameter("needs --out, or --format json", param_hint="--json")
    from analysis import Options, analyse, load_recording
    from analysis.calibration.curve_choice import degree_of
    from analysis.calibration_export.calibration_file import CalibrationFile
    from analysis.calibration_export.forms import calibration_text, write_calibration
    from analysis.calibration_export.verdict import verdict_of
    from boat_daq.workflows.calibration_in_force import stated_contributions

    with progress_bar("Analysing") as advance:
        recording = load_recording(run)
        stated = stated_contributions(recording)
        options = Options(degree_of(degree), mcmc=False, leave_out=leave_out, type_b=stated)
        analysis = analyse(recording, elongation, options=options, progress=advance)
        found = CalibrationFile.of_run(analysis)
    form = "c" if format == "h" else format
    if to is None:
        text = calibration_text(found, form, table_error)
    else:
        write_calibration(found, to, form, table_error)
    check = verdict_of(analysis).check_text
    for remark in (*([f"not to be used yet: {check}"] if check else []), *found.remarks):
        notify(f"note: {remark}")
    if to is None:
        typer.echo(text, nl=False)
        return
    if as_json:
        head = {"file": to, "format": format, "simulated": found.head["simulated"], "unit": found.head["unit"]}
        emit_json(head | {"sensors": len(found.sensors), "void": found.void, "notes": found.remarks})
    else:
        notify(f"wrote {to}: {found.title}")


def convert(
    file: Annotated[
        Path | None, typer.Argument(metavar="[FILE.csv|RUN]", help="Signals: a recording, or a CSV of signals.")
    ] = None,
    calibration_file: Annotated[
        Path, typer.Option("--calibration", metavar="FILE.json", help="File written by `calibration --format json`.")
    ] = ...,  # type: ignore[assignment]  # typer's mark of an option without a default
    port: Annotated[str | None, typer.Option(help="Convert live from this port, as `record` names it.")] = None,
    profile: Annotated[str | None, typer.Option(help="Text profile of a board that is not a BOAT board.")] = None,
    rate: RateOption = None,
    mapping: MapOption = None,
    duration: Annotated[float | None, typer.Option(min=0, help="Live: seconds to convert; else until Ctrl-C.")] = None,
    to: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.csv", help="File to write; default standard output.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Convert signals to elongation: time_s, s1_mv .., elongation_mm, u_mm (U, k = 2) and valid, as CSV.

    A CSV needs a time (or --rate) and the signals; pressure is not needed. Live, no pressure is commanded and nothing
    is recorded; each block of samples is written at once.

    Example: boat-daq convert run.boat --calibration SA1.json --out elongation.csv
    """
    if (file is None) == (port is None):
        raise typer.BadParameter("give one file, or --port PORT")
    if as_json and to is None:
        raise typer.BadParameter("needs --out: standard output is the CSV", param_hint="--json")
    from analysis.calibration_export.calibration_file import read_calibration
    from analysis.calibration_export.conversion import heading

    found = read_calibration(calibration_file)
    found.reader()
    for remark in found.remarks:
        notify(f"note: {remark}")
    if file is not None:
        parts = _converted_file(file, found, mapping, rate)
    else:
        from boat_daq.workflows.live_conversion import converted_samples

        rate_hz = int(rate) if rate else None
        parts = converted_samples(found, str(port), profile, rate_hz, duration, notify=notify)
    samples = valid = 0
    with contextlib.closing(parts), _output(to) as out:
        for part in parts:
            if not samples:
                out.writelines(f"{line}\n" for line in heading(found))
            part.to_csv(out, index=False, header=not samples, lineterminator="\n")
            out.flush()
            samples, valid = samples + len(part), valid + int(part["valid"].sum())
    if as_json:
        emit_json({"file": to, "samples": samples, "valid": valid, "simulated": found.head["simulated"]})
    else:
        notify(f"{samples} samples, {valid} with a valid elongation; {found.title}")


@contextlib.contextmanager
def _output(to: Path | None) -> Iterator[TextIO]:
    """Give the stream to write to: a file that appears whole, or standard output, which its reader may close."""
    if to is None:
        try:
            yield sys.stdout
        except BrokenPipeError:
            sys.stdout = None  # nothing is flushed into it at the end
        return
    from protocol.base.whole_file import written_whole

    with writing(to), written_whole(to) as part, part.open("w", encoding="utf-8", newline="") as stream:
        yield stream


def _converted_file(
    file: Path, found: CalibrationFile, mapping: list[str] | None, rate_hz: float | None
) -> Generator[pd.DataFrame, None, None]:
    """Yield the converted rows of a recording or a CSV."""
    from analysis.calibration_export.conversion import convert_recording, converted_rows, other_unit
    from analysis.data.boat_file import is_boat_file
    from analysis.data.load import load_recording
    from boat_daq.commands.importing import column_map

    is_boat = file.is_file() and is_boat_file(file)
    options: dict[str, Any] = {} if is_boat else {"signals_only": True}
    recording = load_recording(file, columns=column_map(mapping) or None, rate_hz=rate_hz, **options)
    for warning in other_unit(found, recording.unit):
        notify(warning)
    converted = convert_recording(recording, found)
    rows = converted_rows(recording.time_s, recording.signal_mv, converted, recording.signal_unit)
    for first in range(0, len(rows), _ROWS_AT_ONCE):
        yield rows.iloc[first : first + _ROWS_AT_ONCE]
