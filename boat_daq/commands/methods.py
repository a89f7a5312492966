"""`boat-daq tradeoff`, time against error of every method on this computer, and `atlas`, where each method fails."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, notify, present, progress_bar
from protocol.base.errors import writing


def tradeoff(
    methods: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[METHOD]...",
            help="tracer, ranking, full-fem, reduced-fem, posterior, inverse, segmentation, bootstrap, tracking; "
            "whole jobs: calibration, report, sweep; default all.",
        ),
    ] = None,
    folder: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for JSON, CSV and charts.")] = Path(
        "tradeoff"
    ),
    quick: Annotated[bool, typer.Option("--quick", help="Fewer settings and repeats, some minutes.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Measure time against error of every method on this computer, and the defaults that follow.

    Writes tradeoff.json, tradeoff.csv and a chart of each method as PNG and SVG.

    Example: boat-daq tradeoff inverse posterior --quick --out charts
    """
    from analysis.studies.harness import chosen
    from analysis.studies.tradeoff.charts import report_json, write_report
    from analysis.studies.tradeoff.measure import measure_all
    from boat_daq.workflows.measured_methods import tradeoff_methods

    known = tradeoff_methods()
    wanted = chosen(list(known.values()), methods or (), lambda method: (method.name,))
    if "tracking" not in known:
        notify("OpenCV is not installed: the camera's tracker is not measured")
    with writing(folder):  # before minutes are spent
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    with progress_bar("measuring") as advance:
        results = measure_all(wanted, quick=quick, progress=advance)
    files = write_report(results, folder, quick=quick)
    lines = (f"{measured.method.title}: {measured.verdict}" for measured in results)
    present(report_json(results, quick=quick), *lines, as_json=as_json)
    notify(f"{len(files)} files in {folder}")


def atlas(
    methods: Annotated[
        list[str] | None, typer.Argument(metavar="[METHOD]...", help="Methods, or single maps; default all.")
    ] = None,
    folder: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for the JSON and the maps.")] = Path(
        "atlas"
    ),
    as_json: JsonOption = False,
) -> None:
    """Map where each method works, works with a warning, or refuses, over two parameters at a time.

    Each cell of a map runs the method on synthetic data and compares the result with its true value. A wrong result
    without a warning is a bug; the command then exits with code 1. Writes atlas.json, and the maps as PNG and SVG.

    Example: boat-daq atlas fit inverse --out maps
    """
    from analysis.studies.failure_maps.maps import atlas_json, chosen_studies, write_atlas
    from analysis.studies.failure_maps.sweep import CellOutcome, sweep_all
    from protocol.base.errors import BoatDaqError

    chosen = chosen_studies(methods or ())
    with progress_bar("sweeping") as advance:
        maps = sweep_all(chosen, advance)
    files = write_atlas(maps, folder)
    present(atlas_json(maps), *(drawn.verdict for drawn in maps), as_json=as_json)
    notify(f"{len(files)} files in {folder}")
    wrong = [(drawn, cell) for drawn in maps for cell in drawn.found(CellOutcome.WRONG_UNWARNED)]
    if wrong:
        drawn, cell = wrong[0]
        raise BoatDaqError(
            f"{len(wrong)} results are wrong without a warning, the first in {drawn.study.name}: "
            f"{drawn.study.x.title} {cell.x:g}, {drawn.study.y.title} {cell.y:g}",
            "This is a bug of the method: please report it with atlas.json.",
        )
