"""`boat-daq export`: the samples as CSV or Parquet."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, progress_bar, say


def export(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="A .boat file, or a CSV that `import` understands.")],
    format: Annotated[str, typer.Option(help="csv or parquet.")],
    to: Annotated[Path, typer.Option("--out", metavar="PATH", help="The file to write.")],
    json: JsonOption = False,
) -> None:
    """The samples of a run as CSV, with a JSON sidecar, or as Parquet.

    Example:

        boat-daq export run.boat --format csv --out run.csv
    """
    from analysis import load_recording
    from analysis.data.export import export as write

    if format not in ("csv", "parquet"):
        raise typer.BadParameter("give csv or parquet", param_hint="--format")
    recording = load_recording(run)
    with progress_bar("Exporting") as advance:
        files = write(recording, to, "csv" if format == "csv" else "parquet", progress=advance)
    if json:
        emit_json({"files": files, "samples": recording.n, "simulated": recording.simulated})
    else:
        for file in files:
            say(f"wrote {file}")
