"""`boat-daq recover`: close the recording of a killed session."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, present, progress_bar


def recover(
    file: Annotated[Path, typer.Argument(metavar="FILE.boat", help="A recording that was not closed, or is damaged.")],
    as_json: JsonOption = False,
) -> None:
    """Close the recording of a killed session, or copy what is readable of a damaged file into a new one.

    A damaged file itself is never changed.

    Example: boat-daq recover recordings/run.boat
    """
    from boat_daq.engine.recording.recovery import recover as recover_file

    with progress_bar("checking") as progress:
        recovery = recover_file(file, progress=progress)
    results = {
        "recovered": "recovered: the recording was interrupted and is now closed",
        "salvaged": f"damaged: the readable part is in {recovery.path}",
        "closed": "the recording was closed properly; nothing to do",
    }
    result = results.get(recovery.status, f"the recording is {recovery.status}; nothing to do")
    text = f"{result} ({recovery.samples} samples, {recovery.chunks} chunks)"
    present(recovery, text, *(f"  {line}" for line in recovery.damaged), as_json=as_json)
