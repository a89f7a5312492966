"""`boat-daq atlas`: where each method fails, over two parameters at a time."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, notify, present, progress_bar


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
    without a warning is a bug; the command then exits with code 1. Writes atlas.json, and each method's maps as PNG and
    SVG.

    Example: boat-daq atlas fit inverse --out maps
    """
    from analysis.atlas.methods import chosen_studies
    from analysis.atlas.report import atlas_json, write_atlas
    from analysis.atlas.sweep import CellOutcome, sweep_all
    from analysis.errors import AnalysisError

    studies = chosen_studies(methods or ())
    with progress_bar("sweeping") as advance:
        maps = sweep_all(studies, advance)
    files = write_atlas(maps, folder)
    present(atlas_json(maps), *(drawn.verdict for drawn in maps), as_json=as_json)
    notify(f"{len(files)} files in {folder}")
    wrong = [(drawn, cell) for drawn in maps for cell in drawn.found(CellOutcome.WRONG_UNWARNED)]
    if wrong:
        drawn, cell = wrong[0]
        raise AnalysisError(
            f"{len(wrong)} results are wrong without a warning, the first in {drawn.study.name}: "
            f"{drawn.study.x.title} {cell.x:g}, {drawn.study.y.title} {cell.y:g}",
            "This is a bug of the method: please report it with atlas.json.",
        )
