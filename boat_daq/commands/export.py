"""`boat-daq export`: the samples as CSV or Parquet."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, progress_bar
from boat_daq.commands.options import RunArgument, one_of


def export(
    run: RunArgument,
    format: Annotated[str, typer.Option(callback=one_of("csv", "parquet"), help="csv or parquet.")],
    to: Annotated[Path, typer.Option("--out", metavar="PATH", help="File to write.")],
    as_json: JsonOption = False,
) -> None:
    """Write the samples of a run as CSV, with a JSON file of metadata, or as Parquet.

    Example: boat-daq export run.boat --format csv --out run.csv
    """
    from analysis import load_recording
    from analysis.data.export import export as write

    recording = load_recording(run)
    with progress_bar("Exporting") as advance:
        files = write(recording, to, "csv" if format == "csv" else "parquet", progress=advance)
    if as_json:
        emit_json({"files": files, "samples": recording.n, "simulated": recording.simulated})
    else:
        for file in files:
            notify(f"wrote {file}")
