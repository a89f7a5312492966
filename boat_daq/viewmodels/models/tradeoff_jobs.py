"""What the trade-off page has measured for it, in a process of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from analysis.tradeoff import METHODS, Method, measure
from analysis.tradeoff.report import report_json
from boat_daq.viewmodels.models.tradeoff_decimation import DECIMATION

Progress = Callable[[float, float], None]


def measure_methods(
    names: Sequence[str], quick: bool, live_plot: Method = DECIMATION, *, progress: Progress | None = None
) -> dict[str, Any]:
    """Measure methods one after the other; return what `boat-daq tradeoff --json` prints.

    Parameters
    ----------
    names : of methods, as the command takes them.
    quick : fewer settings and repeats.
    live_plot : the method of the live plot; by default without its painting, which is the window's.
    """
    known = METHODS | {live_plot.name: live_plot}
    results = []
    for done, name in enumerate(names):

        def within(part: float, parts: float, before: int = done) -> None:
            if progress is not None:
                progress(before + part / parts, len(names))

        results.append(measure(known[name], quick=quick, progress=within))
    return report_json(results, quick=quick)
