"""`boat-daq batch`: a folder of runs in one table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, notify, present, progress_bar
from boat_daq.commands.options import AllowRemoteOption, FolderArgument, SeedOption

COLUMNS = ("run", "unit", "sensor", "cycles", "sensitivity_mv_per_mm", "snr_db", "error")


def batch(
    folder: FolderArgument,
    to: Annotated[Path | None, typer.Option("--out", metavar="FILE.csv", help="Also write the table.")] = None,
    seed: SeedOption = 0,
    mcmc: Annotated[bool, typer.Option("--mcmc", help="Sample the posteriors as well.")] = False,
    workers: Annotated[int | None, typer.Option(min=1, help="Number of processes; default one a core.")] = None,
    scheduler: Annotated[str | None, typer.Option(metavar="ADDRESS", help="Scheduler of a Dask cluster.")] = None,
    allow_remote: AllowRemoteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Analyse a folder of runs into one table, one row a sensor, on all cores or on a Dask cluster.

    Example: boat-daq batch recordings --out table.csv
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
        notify(f"wrote {to}")
    failed = int((table["error"] != "").sum()) if "error" in table else 0
    content = {"runs": table["run"].nunique(), "failed": failed, "rows": table.to_dict(orient="records")}
    present(content, table[[name for name in COLUMNS if name in table]].to_string(index=False), as_json=as_json)
    if failed:
        notify(f"{failed} runs could not be analysed; see the column error")
