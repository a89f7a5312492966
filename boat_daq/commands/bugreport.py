"""`boat-daq bugreport`: log, settings and versions in one file."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify


def bugreport(
    out: Annotated[Path | None, typer.Option(metavar="FILE.zip", help="File to write; default a dated name.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Pack log, settings, versions and a summary of the last recording (no data) into one ZIP file.

    Names of operators, notes, paths and the names of this computer and its user are removed.

    Example: boat-daq bugreport --out bug.zip
    """
    from boat_daq.engine.bug_report import contents, write_bug_report
    from boat_daq.engine.installation import address_of

    path = out or Path(f"boat-daq_bug_{datetime.now().astimezone():%Y-%m-%d_%H%M%S}.zip")
    write_bug_report(path)
    names = contents(path)
    if as_json:
        emit_json({"file": path, "contents": names, "personal": False})
        return
    notify(f"wrote {path}: {', '.join(names)}; names, notes and paths are removed. Check it before you send it.")
    if address := address_of("Issues"):
        notify(f"report the fault at {address}")
