"""`boat-daq upgrade`: bring an older recording to the present layout."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, present


def upgrade(
    file: Annotated[Path, typer.Argument(metavar="FILE.boat", help="A recording of an older program.")],
    as_json: JsonOption = False,
) -> None:
    """Bring an older recording to the present layout; the original file is kept as a backup beside it.

    Older recordings can be read without it; it is needed only before adding to one.

    Example: boat-daq upgrade recordings/run.boat
    """
    from boat_daq.engine.recording.upgrade import upgrade as upgrade_file

    done = upgrade_file(file)
    text = f"upgraded from layout {done.version_before} to {done.version}; the original is {done.backup}"
    if done.backup is None:
        text = f"{file} has layout {done.version} already; nothing to do"
    present(done, text, as_json=as_json)
