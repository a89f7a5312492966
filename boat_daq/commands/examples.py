"""`boat-daq examples`: the example recordings that come with the program."""

from __future__ import annotations

import shutil
from importlib import metadata
from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, present
from boat_daq.own_packages import ROOT
from protocol.base.errors import RequestError, writing
from protocol.base.whole_file import written_whole

INSTALLED = "share/boat-daq/recordings/*"  # in the environment; beside the sources in a checkout and a bundle


def examples(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to copy them to.")] = Path("recordings"),
    as_json: JsonOption = False,
) -> None:
    """Copy the example recordings of the virtual board to a folder; a file that is there already stays as it is.

    Example: boat-daq examples --out recordings
    """
    files = []
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
        for source in example_files():
            target = out / source.name
            if not target.exists():
                with written_whole(target) as part:
                    shutil.copyfile(source, part)
            files.append(target)
    present({"files": files}, *map(str, files), as_json=as_json)


def example_files() -> list[Path]:
    """Return the example recordings and the file that describes them.

    Raises
    ------
    RequestError : they are not installed.
    """
    beside = sorted((ROOT / "recordings").glob("*"))
    if beside:
        return beside
    listed = metadata.files("boat-daq") or []
    found = sorted(Path(str(file.locate())).resolve() for file in listed if file.match(INSTALLED))
    if not found:
        raise RequestError("the example recordings are not installed", "Install the program again.")
    return found
