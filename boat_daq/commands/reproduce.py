"""`boat-daq reproduce`: what of the paper this program computes again, beside the paper's own figures."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, notify, present, progress_bar, writing
from boat_daq.commands.optics import curves_of

app = typer.Typer(no_args_is_help=True, help="Reproduce the paper: optics.")


@app.command()
def optics(
    fans: Annotated[int, typer.Option(min=1, help="Turns of the fan with the paper's 250 rays.")] = 3,
    rays: Annotated[int, typer.Option(min=251, help="Rays of the converged sweeps.")] = 1_000,
    every: Annotated[
        bool, typer.Option("--all", help="Turns and converged sweeps of every reading; default those with one change.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="Folder for outcomes and their table; a stopped call is resumed from it.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Rank the paper's optical design under every credible reading of what the paper leaves open.

    Readings are the place of the cavities, the guide's thickness, the states and the emission: 48 combinations, each
    swept over the paper's 648 designs in 15 states.

    Example: boat-daq reproduce optics --out optics
    """
    from analysis.optics.scene.curves import default_curves, parametric_curves
    from analysis.optics.sweep.readings import readings_json, readings_table, readings_text, reproduce
    from protocol.whole_file import write_whole

    if out is not None:
        with writing(out):
            out.mkdir(parents=True, exist_ok=True)
    wider = curves_of(Path("paper"))
    curves = {"-40 to +50 kPa": default_curves(), "-50 to +50 kPa": wider, "formula": parametric_curves()}
    with progress_bar("readings") as advance:
        outcomes = reproduce(curves, fans=fans, rays=rays, alike=every, folder=out, progress=advance)
    if out is not None:
        table = out / "optics.md"
        with writing(table):
            write_whole(table, readings_table(outcomes))
        notify(f"wrote {table}")
    present(readings_json(outcomes), readings_text(outcomes), as_json=as_json)
