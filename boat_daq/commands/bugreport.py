"""`boat-daq bugreport`: what whoever looks for a fault needs, in one file."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, say


def bugreport(
    out: Annotated[Path | None, typer.Option(metavar="FILE.zip", help="A dated name when left out.")] = None,
    recording: Annotated[
        Path | None, typer.Option(metavar="RUN", help="Whose summary goes in; the last one when left out.")
    ] = None,
    personal: Annotated[bool, typer.Option("--personal", help="Leave names, notes and paths as they are.")] = False,
    as_json: JsonOption = False,
) -> None:
    """Pack log, settings, versions and the last recording in short (no data) into one ZIP file.

    Names of operators, notes, paths and the names of this computer and its user are taken out, unless --personal.

    Example: boat-daq bugreport --out bug.zip
    """
    from boat_daq.engine.bug_report import contents, write_bug_report

    path = out or Path(f"boat-daq_bug_{datetime.now().astimezone():%Y-%m-%d_%H%M%S}.zip")
    write_bug_report(path, personal=personal, recording=recording)
    names = contents(path)
    if as_json:
        emit_json({"file": path, "contents": names, "personal": personal})
        return
    told = "names, notes and paths are IN it" if personal else "names, notes and paths are taken out"
    say(f"wrote {path}: {', '.join(names)}; {told}. Look into it before you send it.")
