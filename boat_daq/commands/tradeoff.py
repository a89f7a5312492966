"""`boat-daq tradeoff`: time against error of every method, measured on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from boat_daq.commands.console import JsonOption, emit_json, out, progress_bar, say

if TYPE_CHECKING:
    from analysis.tradeoff import Method


def tradeoff(
    methods: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[METHOD]...",
            help="tracer, ranking, full-fem, reduced-fem, posterior, inverse, segmentation, bootstrap, decimation; "
            "default all.",
        ),
    ] = None,
    folder: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where JSON, CSV and charts go.")] = Path(
        "tradeoff"
    ),
    quick: Annotated[bool, typer.Option("--quick", help="Fewer settings and repeats: about half a minute.")] = False,
    json: JsonOption = False,
) -> None:
    """Time against error of every method, measured on this machine, and the defaults that follow.

    Writes tradeoff.json, tradeoff.csv and a chart of each method as PNG and SVG. Example:

        boat-daq tradeoff inverse posterior --quick --out charts
    """
    from analysis.errors import RequestError
    from analysis.tradeoff import METHODS, measure_all, report_json, write_report

    live = _live_plot()
    known = METHODS | {live.name: live}
    _writable(folder)
    unknown = [name for name in methods or () if name not in known]
    if unknown:
        raise RequestError(f"there is no method '{unknown[0]}'", f"Choose among {', '.join(known)}.")
    chosen = [known[name] for name in dict.fromkeys(methods or known)]
    with progress_bar("measuring") as advance:
        results = measure_all(chosen, quick=quick, progress=advance)
    files = write_report(results, folder, quick=quick)
    if json:
        emit_json(report_json(results, quick=quick))
    else:
        for measured in results:
            out.print(f"{measured.method.title}: {measured.verdict}", highlight=False, markup=False, soft_wrap=True)
    say(f"{len(files)} files in {folder}")


def _live_plot() -> Method:
    """The live plot's method with what painting costs, where Qt is there to paint."""
    from analysis.tradeoff.decimation import HEIGHT_PX, WIDTH_PX
    from boat_daq.viewmodels.models.tradeoff_jobs import live_plot

    try:
        from boat_daq.gui.models.tradeoff_jobs import painter
    except ImportError:  # a computer without a screen may lack what Qt needs
        say("without Qt the live plot's points are fetched, not painted")
        return live_plot()
    return live_plot(painter(WIDTH_PX, HEIGHT_PX))


def _writable(folder: Path) -> None:
    """Make the folder before minutes are spent.

    Raises
    ------
    FileError : it cannot be made or written.
    """
    import tempfile

    from analysis.errors import FileError

    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise FileError(f"{folder} cannot be written: {error.strerror}", "Choose another --out.") from error
