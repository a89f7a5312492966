"""`boat-daq atlas`: where each method breaks down, swept and drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, out, progress_bar, say


def atlas(
    methods: Annotated[
        list[str] | None, typer.Argument(metavar="[METHOD]...", help="Methods, or single maps; default all.")
    ] = None,
    folder: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where JSON and maps go.")] = Path("atlas"),
    json: JsonOption = False,
) -> None:
    """Where each method works, works with a warning, or refuses: maps of two parameters each.

    At each point of a map the method is called as a user would, and compared with a truth of its own. A number that
    is wrong without warning is a bug; the command then ends with code 1. Writes atlas.json and a picture of each method
    as PNG and SVG. Example:

        boat-daq atlas fit inverse --out maps
    """
    from analysis.atlas.methods import chosen_studies
    from analysis.atlas.report import atlas_json, write_atlas
    from analysis.atlas.sweep import CellOutcome, sweep_all
    from analysis.errors import AnalysisError

    studies = chosen_studies(methods or ())
    with progress_bar("sweeping") as advance:
        maps = sweep_all(studies, advance)
    files = write_atlas(maps, folder)
    if json:
        emit_json(atlas_json(maps))
    else:
        for drawn in maps:
            out.print(drawn.verdict, highlight=False, markup=False, soft_wrap=True)
    say(f"{len(files)} files in {folder}")
    wrong = [(drawn, cell) for drawn in maps for cell in drawn.found(CellOutcome.WRONG_UNWARNED)]
    if wrong:
        drawn, cell = wrong[0]
        raise AnalysisError(
            f"{len(wrong)} points are wrong without warning, the first in {drawn.study.name}: {drawn.study.x.title} "
            f"{cell.x:g}, {drawn.study.y.title} {cell.y:g}",
            "This is a bug of the method: please report it with atlas.json.",
        )
