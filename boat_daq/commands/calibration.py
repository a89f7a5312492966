"""`boat-daq calibration`: the calibration of a run as data and as code."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, progress_bar, writing
from boat_daq.commands.options import (
    DegreeOption,
    LeaveOutOption,
    MapOption,
    RateOption,
    RunArgument,
    TypeBOption,
    one_of,
)
from protocol.whole_file import write_whole

if TYPE_CHECKING:
    from analysis.artefact.calibration_file import CalibrationFile

FORMATS = ("json", "c", "h", "matlab", "csv")


def calibration(
    run: RunArgument,
    format: Annotated[
        str, typer.Option(callback=one_of(*FORMATS), help="json, c (or h: a C99 header), matlab (Octave too) or csv.")
    ],
    to: Annotated[
        Path | None, typer.Option("--out", metavar="PATH", help="File to write; default standard output.")
    ] = None,
    elongation: Annotated[Path | None, typer.Option(help="CSV of elongation readings, one row a plateau.")] = None,
    mapping: MapOption = None,
    rate: RateOption = None,
    degree: DegreeOption = "3",
    type_b: TypeBOption = None,
    leave_out: LeaveOutOption = False,
    table_error: Annotated[
        float | None,
        typer.Option(
            "--table-error",
            metavar="MM",
            help="Bound on the error of a table: csv 0.001 by default; c becomes a table in single precision.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write the calibration of a run as data or as code: signals in mV in, elongation and its uncertainty out.

    json is what `convert` reads: coefficients, covariance, ranges and U over x. c is a header without a library for a
    microcontroller, matlab a function boat_elongation.m, csv a table.

    Example: boat-daq calibration SA1.boat --format c --out boat_calibration.h
    """
    if table_error is not None and format in ("json", "matlab"):
        raise typer.BadParameter("is of csv and c only", param_hint="--table-error")
    if to is None and as_json and format != "json":
        raise typer.BadParameter("needs --out, or --format json", param_hint="--json")
    from analysis import Options, analyse, load_recording
    from analysis.artefact.calibration_file import CalibrationFile
    from analysis.calibration.curve_choice import degree_of
    from boat_daq.commands.importing import column_map
    from boat_daq.viewmodels.common.reference import stated_contributions

    with progress_bar("Analysing") as advance:
        recording = load_recording(run, columns=column_map(mapping) or None, rate_hz=rate)
        stated = stated_contributions(recording, type_b)
        options = Options(degree_of(degree), mcmc=False, leave_out=leave_out, type_b=stated)
        found = CalibrationFile.of(analyse(recording, elongation, options=options, progress=advance))
    text = written(found, format, table_error)
    for remark in found.remarks:
        notify(f"note: {remark}")
    if to is None:
        typer.echo(text, nl=False)
        return
    with writing(to):
        write_whole(to, text)
    if as_json:
        head = {"file": to, "format": format, "simulated": found.head["simulated"], "unit": found.head["unit"]}
        emit_json(head | {"sensors": len(found.sensors), "void": found.void, "notes": found.remarks})
    else:
        notify(f"wrote {to}: {found.title}")


def written(found: CalibrationFile, format: str, table_error_mm: float | None = None) -> str:
    """Return a calibration in a format.

    Parameters
    ----------
    found : the calibration. format : one of `FORMATS`.
    table_error_mm : bound on the error of a table; None for none in C, and the usual one in CSV.

    Raises
    ------
    AnalysisError : it gives no elongation, or no table keeps to the bound.
    """
    if format == "json":
        return found.text()
    if format == "matlab":
        from analysis.artefact.matlab import matlab_function

        return matlab_function(found)
    from analysis.artefact.signal_table import USUAL_ERROR_MM, table_csv

    if format == "csv":
        return table_csv(found, table_error_mm or USUAL_ERROR_MM)
    from analysis.artefact.c_header import c_header

    return c_header(found, table_error_mm)
