"""`boat-daq recover`: close what a killed session left."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, out, progress_bar


def recover(
    file: Annotated[Path, typer.Argument(metavar="FILE.boat", help="A recording that was not closed, or is damaged.")],
    as_json: JsonOption = False,
) -> None:
    """Close what a killed session left, or save what is readable of a damaged file into a new one.

    A damaged file itself is never changed.

    Example: boat-daq recover recordings/run.boat
    """
    from boat_daq.engine.recording.recovery import recover as recover_file

    with progress_bar("checking") as progress:
        recovery = recover_file(file, progress=progress)
    if as_json:
        emit_json(recovery)
        return
    words = {
        "recovered": "recovered: it was interrupted and is now closed",
        "salvaged": f"damaged: what can be read is in {recovery.path}",
        "closed": "was closed properly; nothing to do",
    }
    told = words.get(recovery.status, f"is {recovery.status}; nothing to do")
    out.print(f"{told} ({recovery.samples} samples, {recovery.chunks} chunks)", highlight=False, markup=False)
    for line in recovery.damaged:
        out.print(f"  {line}", highlight=False, markup=False)
