"""`boat-daq setup`: what is compiled at its first use, compiled now; and the completion of the shell."""

from __future__ import annotations

import time
from typing import Annotated

import typer

from boat_daq.commands.console import JsonOption, notify, present, progress_bar
from boat_daq.commands.options import one_of

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
