"""`boat-daq batch`: a folder of runs into one table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, out, progress_bar, say


def batch(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Holds .boat or .csv runs; NAME.elongation.csv beside.")
    ],
    to: Annotated[Path | None, typer.Option("--out", metavar="FILE.csv", help="The table.")] = None,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    mcmc: Annotated[bool, typer.Option("--mcmc", help="Sample the posteriors as well.")] = False,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; one for each core by default.")] = None,
    scheduler: Annotated[str | None, typer.Option(metavar="ADDRESS", help="Of a Dask cluster.")] = None,
    allow_remote: Annotated[bool, typer.Option("--allow-remote", help="Let --scheduler leave this machine.")] = False,
    json: JsonOption = False,
) -> None:
    """A folder of runs into one table, one row a sensor, over all cores or on a Dask cluster.

    Example:

        boat-daq batch recordings --out table.csv
    """
    from analysis.figures.batch import batch as run_batch
    from analysis.figures.batch import write_table

    with progress_bar("Analysing") as advance:
        table = run_batch(
            folder,
            seed=seed,
            mcmc=mcmc,
            workers=workers,
            scheduler=scheduler,
            allow_remote=allow_remote,
            progress=advance,
        )
    if to is not None:
        write_table(table, to)
        say(f"wrote {to}")
    failed = int((table["error"] != "").sum()) if "error" in table else 0
    if json:
        emit_json({"runs": table["run"].nunique(), "failed": failed, "rows": table.to_dict(orient="records")})
    else:
        shown = [
            c for c in ("run", "unit", "sensor", "cycles", "sensitivity_mv_per_mm", "snr_db", "error") if c in table
        ]
        out.print(table[shown].to_string(index=False), markup=False, highlight=False)
    if failed:
        say(f"{failed} runs could not be analysed; their reasons stand in the column error")
