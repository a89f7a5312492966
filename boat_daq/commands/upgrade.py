"""`boat-daq upgrade`: an older recording in today's layout, the file as it was kept beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, out


def upgrade(
    file: Annotated[Path, typer.Argument(metavar="FILE.boat", help="A recording of an older program.")],
    as_json: JsonOption = False,
) -> None:
    """Bring an older recording to today's layout; the file as it was stays beside it as a backup.

    Older recordings can be read as they are; only what adds to one of them needs this.

    Example: boat-daq upgrade recordings/run.boat
    """
    from boat_daq.engine.recording.upgrade import upgrade as upgrade_file

    done = upgrade_file(file)
    if as_json:
        emit_json(done)
    elif done.backup is None:
        out.print(
            f"{file} has layout {done.version} already; nothing to do", highlight=False, markup=False, soft_wrap=True
        )
    else:
        told = f"layout {done.version_before} became {done.version}; the file as it was is {done.backup}"
        out.print(told, highlight=False, markup=False, soft_wrap=True)
