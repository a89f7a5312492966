"""The report of a measurement: JSON as the surface has it, a CSV of all points, charts as PNG and SVG.

Rules: the JSON has all that the charts show; an error that is infinite (the method failed) is null in it. In a chart
time is to the right, error upwards, both logarithmic; lower left is better. Bars are the range of the repeats. The
default has a ring, the rule's choice a square; the tolerance is a dashed line, and the rule accepts settings below the
dotted one. A setting without result is a cross at the top; an error of zero is on the lower edge.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, FuncFormatter, LogLocator, NullFormatter

from analysis import figure_style as style
from analysis.fidelity import LEVELS, MARGINS
from analysis.studies.harness import Picture, machine, write_json, write_pictures
from analysis.studies.tradeoff.measure import MARGIN, TIE, CostPoint, Measured, part_of_tolerance
from protocol.base.whole_file import written_whole

DATA, _DEFAULT, CHOSEN, _REFUSED = style.SENSOR_COLOURS[0], style.SENSOR_COLOURS[1], style.PRESSURE_COLOUR, style.SOFT
DOT_PT, CROSS_PT, RING_PT, SQUARE_PT = 5.0, 6.0, 12.0, 16.0
OVERVIEW_DPI = 88
_FRONT = "front: least error for the time"
_CHOICE = f"the rule's choice: cheapest accepted,\nor the default within {TIE:g} times its time"
Place = tuple[float, float]
_FEW_DECADES = 2.0
DECADES_BELOW = 4.5  # errors further below the tolerance are drawn on the lower edge


def method_chart(measured: Measured, where: str) -> Figure:
    """Draw one method; `where` names the machine and the date."""
    figure = Figure(figsize=(8.6, 5.0), layout="constrained")
    axes = figure.subplots()
    at = _draw(axes, measured, margin=0.24)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=3, fontsize=7.5)
    kind = "independent" if measured.method.independent else "not independent"
    text = f"reference ({kind}): {measured.method.reference}\nconsumer: {measured.method.consumer}\n"
    text += where if measured.default_is_chosen else f"{measured.verdict}\n{where}"
    figure.supxlabel(text, fontsize=6.5, color=style.SOFT)
    _number(axes, measured, at)
    return figure


_TIMES = {1e-6: "1 µs", 1e-3: "1 ms", 0.1: "0.1 s\na blink", 1.0: "1 s", 60.0: "1 min"}
_MOST_SHOWN, _PAPER = 100.0, "250 rays"


def overview_chart(results: Sequence[Measured], where: str) -> Figure:
    """Draw all methods in one plane: time on this computer, and error over the tolerance of its use.

    Each method is the front of its settings. Its default is numbered.
    """
    figure = Figure(figsize=(12.0, 6.0), layout="constrained")
    axes = figure.subplots()
    axes.axhline(1.0, color=style.INK, lw=1.2)
    axes.text(1.0, 1.1, "tolerance ", transform=axes.get_yaxis_transform(), ha="right", fontsize=9)
    lowest, names = 10.0**-DECADES_BELOW, list[str]()
    for number, measured in enumerate(sorted(results, key=_default_s), 1):
        colour, method = style.SENSOR_COLOURS[number % len(style.SENSOR_COLOURS)], measured.method
        points = {p.setting: p for p in measured.points if math.isfinite(p.error)}
        at = {k: (p.cpu_seconds, max(p.error / method.tolerance, lowest)) for k, p in points.items()}
        front = [at[name] for name in measured.front if name in at]
        if front:
            axes.plot(*zip(*front, strict=True), "-", color=colour, lw=0.9, alpha=0.7, drawstyle="steps-post")
        if method.default in at:
            axes.plot(*at[method.default], "o", color=colour, ms=15)
            axes.annotate(str(number), at[method.default], color="white", fontsize=8, ha="center", va="center_baseline")
            names.append(f"{number}  {method.title}: {method.default}, for {method.per}")
        if method.default.endswith("rays") and method.default != _PAPER and _PAPER in at:
            axes.plot(*at[_PAPER], "o", mfc="none", mec=colour, ms=9)
            axes.annotate(f"{number}: {_PAPER}", at[_PAPER], xytext=(8, 4), textcoords="offset points", fontsize=8)
    axes.set(xscale="log", yscale="log", ylim=(lowest / 2.0, _MOST_SHOWN))
    axes.set(xlabel="processor time of one call", ylabel="error / tolerance of its use")
    axes.set_xticks(list(_TIMES), list(_TIMES.values()))
    axes.xaxis.set_minor_formatter(NullFormatter())
    names += [
        "",
        f"rings: the paper's {_PAPER}, as",
        "optics sweep takes by default",
        f"below {lowest:.0e}: drawn there",
    ]
    axes.text(1.02, 1.0, "\n".join(names), transform=axes.transAxes, fontsize=8, va="top", linespacing=1.5)
    axes.set_title("Numbered: the program's defaults. Lines: quicker and more exact settings", fontsize=10)
    figure.supxlabel(where, fontsize=7, color=style.SOFT)
    return figure


def _default_s(measured: Measured) -> float:
    return next((p.cpu_seconds for p in measured.points if p.setting == measured.method.default), math.inf)


def _draw(axes: Axes, measured: Measured, *, margin: float) -> dict[str, Place]:
    """Draw the settings with a margin at both sides, a share of the width; return where each is."""
    method, points = measured.method, {p.setting: p for p in measured.points}
    answered = {name: p for name, p in points.items() if math.isfinite(p.error)}
    smallest = min((p.error for p in answered.values() if p.error > 0), default=method.tolerance)
    floor = max(min(smallest, method.tolerance / MARGIN) / 3, method.tolerance / 10**DECADES_BELOW)
    at = {name: (p.cpu_seconds, max(p.error, floor)) for name, p in answered.items()}
    top = 3.0 * max([method.tolerance, *(y for _, y in at.values())])
    axes.axhline(method.tolerance, color=style.SOFT, ls="--", lw=1, label="tolerance")
    axes.axhline(
        method.tolerance / MARGIN, color=style.SOFT, ls=":", lw=1, label=f"accepted below: {part_of_tolerance(MARGIN)}"
    )
    for name, (x, y) in at.items():
        _bars(axes, points[name], x, y, floor)
    if at:
        axes.plot(*zip(*at.values(), strict=True), "o", color=DATA, ms=DOT_PT, ls="", label="setting")
    refused = {name: (p.cpu_seconds, top) for name, p in points.items() if name not in answered}
    if refused:
        axes.plot(*zip(*refused.values(), strict=True), "x", color=_REFUSED, ms=CROSS_PT, ls="", label="no result")
    front = [at[name] for name in measured.front if name in at]
    # in steps: no setting is on a straight line between two
    axes.plot(
        *zip(*front, strict=True),
        "-",
        color=DATA,
        lw=1.2,
        drawstyle="steps-post",
        label=_FRONT,
    )
    if method.default in at:
        axes.plot(*at[method.default], "o", ms=RING_PT, mfc="none", mec=_DEFAULT, mew=1.8, ls="", label="default")
    if measured.chosen in at:
        axes.plot(*at[measured.chosen], "s", ms=SQUARE_PT, mfc="none", mec=CHOSEN, mew=1.5, ls="", label=_CHOICE)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(margin, 0.14)
    for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        # a decade at least, so that noise of the clock is not magnified
        widen = max(1.0, 12.0 / (high / low)) ** 0.5
        axis.set_view_interval(low / widen, high * widen, ignore=True)
        _number_ticks(axis, FuncFormatter(_seconds) if axis is axes.xaxis else None)
    axes.set(title=method.title, xlabel=f"processor time for {method.per}", ylabel=f"error, {method.unit}")
    return at | refused


def _seconds(value: float, _: object) -> str:
    """Return a time with its unit, long ones in seconds."""
    return f"{value:g} s" if value >= 1.0 else EngFormatter(unit="s")(value)


def _number_ticks(axis: Axis, time: FuncFormatter | None) -> None:
    """Number the decades; where fewer than `_FEW_DECADES` are shown, 2 and 5 times them too: two ticks make a scale."""
    low, high = sorted(axis.get_view_interval())
    if high / low < 10.0**_FEW_DECADES:
        axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        axis.set_minor_formatter(time or "{x:g}")
        axis.set_major_formatter(time or "{x:g}")
        return
    axis.set_minor_formatter(NullFormatter())
    if time is not None:
        axis.set_major_formatter(time)


def _bars(axes: Axes, point: CostPoint, x: float, y: float, floor: float) -> None:
    """Draw the range of the repeats, half of it to each side."""
    half_x, half_y = min(point.cpu_spread / 2, 0.9 * x), min(point.error_spread / 2, 0.9 * y)
    if y <= floor:
        half_y = 0.0
    axes.errorbar(x, y, xerr=half_x, yerr=half_y or None, fmt="none", ecolor=DATA, elinewidth=0.7, alpha=0.5)


def _number(axes: Axes, measured: Measured, at: Mapping[str, Place]) -> None:
    """Number the settings, and list their names beside the chart; those in use also have their levels."""
    default = measured.method.default
    levels: dict[str, str] = {name: level for level, name in measured.method.in_code.items() if name != default}
    if default.endswith("rays") and default != _PAPER:
        levels[_PAPER] = "the paper's, and of optics sweep"
    names = []
    for number, (name, place) in enumerate(at.items(), 1):
        axes.annotate(str(number), place, xytext=(4, 4), textcoords="offset points", fontsize=6.5, color=style.INK)
        names.append(f"{number}  {name}" + (f" ({levels[name]})" if name in levels else ""))
    axes.text(1.02, 1.0, "\n".join(names), transform=axes.transAxes, fontsize=6.5, color=style.INK, va="top")


MAY_BE_INFINITE = ("error", "error_spread")
TIMING = (
    "seconds: median by the clock of a call, spread: greatest less smallest; cpu_seconds: median processor time, which "
    "front and choice compare, cpu_spread likewise; error: root mean square over the repeats; first_seconds: the first "
    "call, which prepares and compiles and is in no median"
)


def report_json(results: Sequence[Measured], *, quick: bool) -> dict[str, Any]:
    """Return what `tradeoff --json` prints."""
    return {
        "machine": machine(),
        "quick": quick,
        "timing": TIMING,
        "margin": MARGIN,
        "margins": MARGINS,
        "methods": [_method_json(m) for m in results],
    }


def _method_json(measured: Measured) -> dict[str, Any]:
    method = measured.method
    return {
        "name": method.name,
        "title": method.title,
        "reference": f"{method.reference}; {'independent' if method.independent else 'not independent'}",
        **{name: getattr(method, name) for name in ("independent", "consumer", "tolerance", "unit", "per")},
        "points": [_point_json(p) for p in measured.points],
        "front": list(measured.front),
        "default": method.default,
        "chosen": measured.chosen,
        "default_is_chosen": measured.default_is_chosen,
        "fidelity": {k: {"chosen": measured.levels[k], "in_code": method.in_code[k]} for k in LEVELS},
        "verdict": measured.verdict,
    }


def _point_json(point: CostPoint) -> dict[str, Any]:
    row = asdict(point)
    return row | {name: row[name] if math.isfinite(row[name]) else None for name in MAY_BE_INFINITE}


def write_report(results: Sequence[Measured], folder: Path, *, quick: bool) -> list[Path]:
    """Write tradeoff.json, tradeoff.csv and the charts; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    content = report_json(results, quick=quick)
    files = [folder / "tradeoff.json", folder / "tradeoff.csv"]
    write_json(content, files[0])
    _write_csv(content, files[1])
    where = "{processor}, {cores} cores, Python {python}, {date_utc}".format(**content["machine"])
    pictures = [Picture(m.method.name, partial(method_chart, m, where)) for m in results]
    pictures.append(Picture("overview", partial(overview_chart, results, where), OVERVIEW_DPI))
    return files + write_pictures(pictures, folder)


def _write_csv(content: dict[str, Any], path: Path) -> None:
    with written_whole(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        columns = [column.name for column in fields(CostPoint)]
        table.writerow(["method", *columns, "unit", "tolerance", "on_front", "default", "chosen"])
        for method in content["methods"]:
            for point in method["points"]:
                name = point["setting"]
                marks = (name in method["front"], name == method["default"], name == method["chosen"])
                row = [point[c] for c in columns]
                table.writerow([method["name"], *row, method["unit"], method["tolerance"], *map(int, marks)])
