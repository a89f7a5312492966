"""One picture a method: what is paid for the next digit, which setting is the default, what its consumer notices.

Rules: time to the right, error upwards, both logarithmic; lower left is better. The default has a ring, the rule's
choice a square; the tolerance is a dashed line, and below the dotted one lies what the rule counts as good enough.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from analysis import style
from analysis.tradeoff.measure import MARGIN, Measured

DATA, DEFAULT, CHOSEN = style.SENSORS[0], style.SENSORS[1], style.PRESSURE
COLUMNS = 3


def method_chart(measured: Measured, where: str) -> Figure:
    """Draw one method; `where` names the machine and the date."""
    figure = Figure(figsize=(7.2, 4.8), layout="constrained")
    axes = figure.subplots()
    _draw(axes, measured, labels=True)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=4, fontsize=7.5)
    figure.supxlabel(f"{measured.method.reference}\n{where}", fontsize=6.5, color=style.SOFT)
    return figure


def overview_chart(results: Sequence[Measured], where: str) -> Figure:
    """Draw all methods, one small chart each."""
    rows = math.ceil(len(results) / COLUMNS)
    figure = Figure(figsize=(4.0 * COLUMNS, 3.1 * rows + 0.5), layout="constrained")
    grid = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for axes, measured in zip(grid, results, strict=False):
        _draw(axes, measured, labels=False)
    for axes in grid[len(results) :]:
        axes.set_axis_off()
    entries: dict[str, Any] = {}
    for axes in grid[: len(results)]:
        entries |= {name: handle for handle, name in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(list(entries.values()), list(entries), loc="outside upper center", ncols=len(entries))
    figure.supxlabel(where, fontsize=7, color=style.SOFT)
    return figure


def _draw(axes: Axes, measured: Measured, *, labels: bool) -> None:
    method = measured.method
    shown = [p for p in measured.points if math.isfinite(p.error)]
    smallest = min((p.error for p in shown if p.error > 0), default=method.tolerance)
    floor = min(smallest, method.tolerance / MARGIN) / 3  # where an error of zero is drawn
    at = {p.setting: (p.cpu_seconds, max(p.error, floor)) for p in shown}
    axes.axhline(method.tolerance, color=style.SOFT, ls="--", lw=1, label="what the consumer notices")
    axes.axhline(method.tolerance / MARGIN, color=style.SOFT, ls=":", lw=1, label="good enough")
    axes.plot(*zip(*at.values(), strict=True), "o", color=DATA, ms=5, label="setting")
    front = [at[name] for name in measured.front if name in at]
    axes.plot(*zip(*front, strict=True), "-", color=DATA, lw=1.2, label="front")
    if method.default in at:
        axes.plot(*at[method.default], "o", ms=12, mfc="none", mec=DEFAULT, mew=1.8, ls="", label="default")
    if measured.chosen in at:
        axes.plot(*at[measured.chosen], "s", ms=15, mfc="none", mec=CHOSEN, mew=1.5, ls="", label="chosen by the rule")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(0.24 if labels else 0.14, 0.14)
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        # a decade at least: noise of the clock looks as small as it is
        widen = max(1.0, 12.0 / (high / low)) ** 0.5
        axis.set_view_interval(low / widen, high * widen, ignore=True)
        axis.set_minor_formatter(NullFormatter())
    axes.set(title=method.title, xlabel=f"processor time {method.per}, s", ylabel=f"error, {method.unit}")
    if labels:
        for name, place in at.items():
            axes.annotate(name, place, xytext=(9, 4), textcoords="offset points", fontsize=7, color=style.INK)
