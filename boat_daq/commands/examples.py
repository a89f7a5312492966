"""`boat-daq examples` and `help tutorial`: recordings, notebook and tutorial that come with the program."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, present
from boat_daq.engine.installation import shipped
from protocol.base.errors import writing
from protocol.base.whole_file import written_whole


def examples(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder to copy them to.")] = Path("recordings"),
    as_json: JsonOption = False,
) -> None:
    """Copy example recordings of the virtual board and a notebook to a folder; a file that is there stays as it is.

    Example: boat-daq examples --out recordings
    """
    files = []
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
        for source in (*example_files(), *shipped("docs/tutorial/*.ipynb", "share/doc/boat-daq")):
            target = out / source.name
            if not target.exists():
                with written_whole(target) as part:
                    shutil.copyfile(source, part)
            files.append(target)
    present({"files": files}, *map(str, files), as_json=as_json)


def example_files() -> list[Path]:
    """Return the example recordings and the file that describes them; raises as `shipped`."""
    return shipped("recordings/*", "share/boat-daq")


def show_tutorial() -> None:
    """Print the tutorial of the terminal; the name of a linked page is left without its address."""
    from rich.console import Console
    from rich.markdown import Markdown

    page = shipped("docs/tutorial/terminal.md", "share/doc/boat-daq")[0].read_text(encoding="utf-8")
    Console().print(Markdown(re.sub(r"\[([^]]+)\]\([^)]+\)", r"\1", page)))
