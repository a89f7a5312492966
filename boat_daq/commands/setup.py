"""`boat-daq setup`, `bugreport` and `examples`: the program on this computer; and the text of `help tutorial`."""

from __future__ import annotations

import re
import shutil
import time
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, notify, present, progress_bar
from boat_daq.commands.options import one_of
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


_TEXTS = {"calibration": "the search for cycles", "rays": "the ray tracer", "shadow": "the finite elements"}


def setup(
    what: Annotated[
        str,
        typer.Argument(
            metavar="[compile|completion|sizes]", callback=one_of("compile", "completion", "sizes"), help="What to do."
        ),
    ] = "compile",
    as_json: JsonOption = False,
) -> None:
    """Compile the parts that are compiled at their first use, so that no first call waits: once for each version.

    With `completion` the shell completes commands, options, plans, units, formats and settings. With `sizes` each
    installed library is listed with its size and what needs it; a calibration without window, PDF and charts needs
    `calibration`, `compiled parts`, `link` and `commands`.

    Example: boat-daq setup completion
    """
    if what == "completion":
        from typer._completion_shared import install

        shell, path = install(prog_name="boat-daq", complete_var="_BOAT_DAQ_COMPLETE")
        content = {"shell": shell, "path": str(path)}
        present(content, f"completion of {shell} installed in {path}; start a new terminal", as_json=as_json)
        return
    if what == "sizes":
        _show_sizes(as_json=as_json)
        return
    from analysis.compile_all import compile_all
    from analysis.compiled import CACHE_FOLDER

    before = time.process_time()
    with progress_bar("compiling"):
        compiled = compile_all(notify=lambda step: notify(f"compiling {_TEXTS[step]}"))
    cpu_s, folder = time.process_time() - before, str(CACHE_FOLDER or "")
    text = f"compiled in {cpu_s:.0f} s of CPU time, kept in {folder}" if compiled else f"all is compiled, in {folder}"
    present({"compiled": compiled, "cpu_s": cpu_s, "folder": folder}, text, as_json=as_json)


def _show_sizes(*, as_json: bool) -> None:
    from boat_daq.engine.installation import installed_sizes

    sizes = installed_sizes()
    uses: dict[str, int] = {}
    for _, use, size in sizes:
        uses[use] = uses.get(use, 0) + size
    rows = [{"library": name, "use": use, "bytes": size} for name, use, size in sizes]
    lines = [f"{size / 1e6:7.1f} MB  {name:<24} {use}" for name, use, size in sizes if size >= 1e6]
    totals = [f"{size / 1e6:7.1f} MB  for {use}" for use, size in sorted(uses.items(), key=lambda row: -row[1])]
    present({"libraries": rows, "uses": uses}, *lines, "", *totals, as_json=as_json)
