"""The figures of a report, each drawn onto axes that are passed in, and set onto a canvas, for HTML and PDF alike.

A drawing evaluates curves on its own grid and thins a trace, and computes nothing else; colours and sizes come from
`analysis.figure_style`; filled points are loading, open ones unloading. Margins are fixed, in inches.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import AutoLocator, MaxNLocator

from analysis import figure_style as style
from analysis.calibration.curve_choice import curve_name
from analysis.figures.figure import SENSOR_FIGURES
from analysis.figures.pipeline import Analysis
from analysis.reports.document import ReportDrawing
from analysis.reports.text_metrics import families, printable
from protocol.base.arrays import FloatArray

DRAWN_POINTS = 201
TRACE_POINTS = 3000


def finished(ax: Axes) -> None:
    """Give drawn axes what all have in common: ticks at 1, 2 and 5, and a text where there is nothing to draw."""
    for axis in (ax.xaxis, ax.yaxis):
        if isinstance(axis.get_major_locator(), AutoLocator):
            axis.set_major_locator(MaxNLocator(nbins="auto", steps=[1, 2, 5, 10]))
    if not np.isfinite(ax.dataLim.bounds).all():  # nothing drawn, or nothing but NaN and a zero line
        ax.set(xticks=[], yticks=[])
        legend = ax.get_legend()
        if legend is not None:
            legend.remove()
        ax.text(0.5, 0.5, "undefined, see the text", transform=ax.transAxes, ha="center", color=style.SOFT)


def over_cycles(ax: Axes, ylabel: str, title: str) -> None:
    """Give axes over whole numbers of cycles their titles."""
    ax.xaxis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10]))
    ax.set(xlabel="cycle", ylabel=ylabel, title=title)


def signed(value: float) -> str:
    return f"{round(value) or 0:+d}".replace("-", "\u2212") if round(value) else "0"


def calibration_curve(analysis: Analysis, sensor: int, ax: Axes) -> None:
    """Draw points and fitted curve."""
    calibration = analysis.sensors[sensor].calibration
    assert calibration is not None
    grid = np.linspace(*calibration.x_range, DRAWN_POINTS)
    ax.plot(grid, calibration.predict(grid), color=style.sensor_colour(sensor), label=curve_name(calibration.curve))
    _branch_points(ax, analysis, sensor, calibration.x, calibration.y)
    ax.set(xlabel="elongation, mm", ylabel="signal, mV", title=f"Sensor {sensor + 1}")
    ax.legend()


def residuals(analysis: Analysis, sensor: int, ax: Axes) -> None:
    """Draw the residuals over elongation, with the 95 % bands, which are too narrow for the axes of the curve."""
    one = analysis.sensors[sensor]
    calibration = one.calibration
    assert calibration is not None
    grid = np.linspace(*calibration.x_range, DRAWN_POINTS)
    fitted, reading = calibration.predict(grid), calibration.band(grid, 0.95, new_reading=True)
    curve = one.posterior.curve_band(grid) if one.posterior else calibration.band(grid, 0.95)
    for (low, high), alpha, named in (
        (reading, 0.12, "new reading, 95 %"),
        (curve, 2 * style.BAND_ALPHA, "curve, 95 %"),
    ):
        ax.fill_between(
            grid, low - fitted, high - fitted, color=style.sensor_colour(sensor), alpha=alpha, linewidth=0, label=named
        )
    ax.axhline(0.0, color=style.SOFT, linewidth=0.7)
    _branch_points(ax, analysis, sensor, calibration.x, calibration.residuals, named=False)
    ax.set(xlabel="elongation, mm", ylabel="residual, mV", title=f"Sensor {sensor + 1}: residuals")
    ax.legend()


def loop_difference(analysis: Analysis, limit_percent: float | None, ax: Axes) -> None:
    """Loading minus unloading of the mean loops over pressure, % FSO, all sensors, with the limit of hysteresis."""
    for i, sensor in enumerate(analysis.sensors):
        width, fso = sensor.system_loop, sensor.figures["fso_mv"].value
        if not width.void and fso > 0:
            apart = 100.0 / fso * (width.loading - width.unloading)
            ax.plot(width.grid, apart, color=style.sensor_colour(i), label=f"sensor {i + 1}")
    ax.axhline(0.0, color=style.SOFT, linewidth=0.7)
    if limit_percent is not None:
        for side, named in ((-1.0, f"limit, {limit_percent:g} % FSO"), (1.0, None)):
            ax.axhline(side * limit_percent, color=style.WARNING, linewidth=0.9, linestyle="--", label=named)
    ax.set(xlabel="pressure, kPa", ylabel="hysteresis, % FSO", title="Loading − unloading of the mean loop")
    legend(ax)


def actuator_loop(analysis: Analysis, ax: Axes) -> None:
    loops = analysis.loops
    assert loops.elongation_mm is not None
    for b, fill in ((0, style.PAPER_COLOUR), (1, style.ELONGATION_COLOUR)):
        for k in range(loops.n_cycles):
            label = ("unloading", "loading")[b] if k == 0 else None
            p, x = loops.pressure_kpa[b, k], loops.elongation_mm[b, k]
            ax.plot(p, x, color=style.ELONGATION_COLOUR, lw=0.6, marker="o", mfc=fill, mew=0.6, label=label)
    ax.set(xlabel="pressure, kPa", ylabel="elongation, mm", title="Actuator: elongation over pressure")
    legend(ax, loc="upper left")


def drift_of_levels(analysis: Analysis, sensor: int, ax: Axes) -> None:
    """Draw the displacement of each pressure level from its mean, over cycles, % FSO."""
    loops, moved = analysis.loops, analysis.sensors[sensor].by_cycle.level_displacement_percent_fso
    chosen = np.unique(np.linspace(0, loops.level_kpa.size - 1, 5).round().astype(int))
    colours = mpl.colormaps["viridis"](np.linspace(0.32, 0.84, chosen.size))  # its ends are lost on one of the grounds
    for g, colour in zip(chosen, colours, strict=True):
        if np.isfinite(moved[:, g]).any():
            ax.plot(loops.numbers, moved[:, g], color=colour, lw=0.9, label=f"{signed(loops.level_kpa[g])} kPa")
    over_cycles(ax, "from its mean, % FSO", f"Sensor {sensor + 1}: drift of the levels")
    legend(ax, ncols=2, loc="best")


def per_cycle_figure(analysis: Analysis, name: str, label: str, title: str, ax: Axes) -> None:
    """Draw one field `name` of `FiguresByCycle` of all sensors, warm-up cycles shaded."""
    warm = max((sensor.by_cycle.warm_up for sensor in analysis.sensors), default=0)
    for i, sensor in enumerate(analysis.sensors):
        values, colour = getattr(sensor.by_cycle, name), style.sensor_colour(i)
        named = f"sensor {i + 1}" if np.isfinite(values).any() else None
        ax.plot(sensor.by_cycle.numbers, values, "o-", color=colour, ms=2, lw=0.7, label=named)
    if warm:
        named = f"warm-up: {warm} cycle{'s' if warm > 1 else ''}"
        ax.axvspan(0.5, warm + 0.5, color=style.LINE, alpha=0.5, linewidth=0, label=named)
    over_cycles(ax, label, title)
    legend(ax)


def distribution(analysis: Analysis, sensor: int, ax: Axes) -> None:
    """Draw the spread over cycles at each pressure: quartiles and whiskers to the extremes, % FSO from the mean."""
    loops, moved = analysis.loops, analysis.sensors[sensor].by_cycle.branch_displacement_percent_fso
    step, line = max(1, -(-loops.level_kpa.size // 10)), {"color": style.SOFT, "lw": 0.6}
    for b, shift, fill in ((0, -0.18, style.PAPER_COLOUR), (1, 0.18, style.sensor_colour(sensor))):
        levels = [level[np.isfinite(level)] for level in moved[b, :, ::step].T]
        boxes = {k + shift: level for k, level in enumerate(levels) if level.size > 1}
        if boxes:
            box = {"facecolor": fill, "edgecolor": style.sensor_colour(sensor), "alpha": 0.8, "lw": 0.6}
            look: Any = {"boxprops": box, "medianprops": {"color": style.INK, "lw": 0.8}, "whiskerprops": line}
            how: Any = {"patch_artist": True, "manage_ticks": False, "widths": 0.28, "whis": (0, 100)}
            ax.boxplot(list(boxes.values()), positions=list(boxes), capprops=line, **look, **how)
    names = [signed(p) for p in loops.level_kpa[::step]]
    every = 1 + (len(names) > 6)  # as many names as do not touch
    ax.set_xticks(range(0, len(names), every), names[::every])
    ax.set(
        xlabel="pressure, kPa (open unloading, filled loading)", ylabel="from its mean, % FSO",
        title=f"Sensor {sensor + 1}: spread over {loops.n_cycles} cycles",
    )  # fmt: skip


def side_by_side(analyses: Sequence[Analysis], name: str, ax: Axes) -> None:
    """Draw one figure of every run with its interval, runs of one unit next to one another, a colour a sensor."""
    order = sorted(range(len(analyses)), key=lambda i: (analyses[i].recording.unit, i))
    for i in range(max(len(a.sensors) for a in analyses)):
        for place, run in enumerate(order):
            figure = analyses[run].sensors[i].figures.get(name) if i < len(analyses[run].sensors) else None
            if figure is None or not np.isfinite(figure.value):
                continue
            reach = np.abs([[figure.value - figure.low], [figure.high - figure.value]])
            ax.errorbar(
                place + 0.12 * (2 * i - 1), figure.value, yerr=reach if np.isfinite(reach).all() else None, fmt="o",
                color=style.sensor_colour(i), capsize=2, label=f"sensor {i + 1}" if place == 0 else None,
            )  # fmt: skip
    names = [_label(analyses[run].recording.unit, run + 1, len(order)) for run in order]
    ax.set_xticks(range(len(order)), names, fontfamily=list(families("".join(names))), parse_math=False)
    ax.set_xlim(-0.6, len(order) - 0.4)
    ax.set(xlabel="unit and number of the run", ylabel=f"{SENSOR_FIGURES[name].phrase}, {SENSOR_FIGURES[name].unit}")
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.15 * (high - low))  # space for the legend
    legend(ax, loc="upper left", ncols=4)


def uncertainty_over_x(u_elongation: Sequence[FloatArray], ax: Axes) -> None:
    """Draw U of an elongation over the calibrated range, of each sensor [points, 2] x and U, mm; NaN where unknown."""
    for i, u in enumerate(u_elongation):
        named = f"sensor {i + 1}" if u.size else None
        ax.plot(u[:, 0], u[:, 1], color=style.sensor_colour(i), label=named)
    ax.set_ylim(bottom=0.0)
    ax.set(xlabel="elongation, mm", ylabel="U, mm", title="Expanded uncertainty, k = 2")
    legend(ax)


def trace(analysis: Analysis, ax: Axes) -> None:
    """Pressure over time, thinned to its extremes, broken at gaps, complete cycles shaded in turn."""
    recording = analysis.recording
    edges = [0, *(gap.row + 1 for gap in recording.gaps), recording.n]
    pieces = [
        envelope(recording.time_s[i:j], recording.pressure_kpa[i:j], max(2, TRACE_POINTS // 2 * (j - i) // recording.n))
        for i, j in pairwise(edges)
    ]
    time, low, high = (np.concatenate([np.append(piece[k], np.nan) for piece in pieces]) for k in range(3))
    ax.fill_between(time, low, high, color=style.PRESSURE_COLOUR, linewidth=0.6, edgecolor=style.PRESSURE_COLOUR)
    shaded_cycles = ("", " (complete cycle shaded)", " (every second complete cycle shaded)")[
        min(len(analysis.cycles.used), 2)
    ]
    shaded = ((analysis.cycles.used[::2], style.LINE, 0.35), (analysis.cycles.partial, style.WARNING, 0.15))
    for stretches, colour, alpha in shaded:
        for stretch in stretches:
            ax.axvspan(*recording.time_s[[stretch.first, stretch.last]], color=colour, alpha=alpha, linewidth=0)
    for time_s, _ in recording.meta.get("markers", ()):
        ax.axvline(time_s, color=style.INK, linewidth=0.7, linestyle=":")
    ax.set(xlabel="time, s", ylabel="pressure, kPa", title=f"The run{shaded_cycles}")
    ax.margins(x=0)


def envelope(time: FloatArray, values: FloatArray, buckets: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return time, lowest and highest value of `buckets` stretches: millions of points drawn with few, no peak lost."""
    size = max(1, -(-values.size // buckets))
    starts = np.arange(0, values.size, size)
    known = np.isfinite(values)
    low = np.minimum.reduceat(np.where(known, values, np.inf), starts)
    high = np.maximum.reduceat(np.where(known, values, -np.inf), starts)
    good = np.isfinite(low) & np.isfinite(high)
    return time[starts][good], low[good], high[good]


def _label(unit: str, number: int, among: int) -> str:
    """Unit and number of a run, as long as its share of the axis lets it be."""
    letters = max(3, 36 // among - 3)
    short = printable(unit if len(unit) <= letters else unit[: letters - 1] + "…")
    return f"{short} #{number}" if short and among <= 8 else f"#{number}"


def legend(ax: Axes, **placed: Any) -> None:
    """Draw a legend where there is anything to name: a void figure draws no line."""
    if ax.get_legend_handles_labels()[0]:
        ax.legend(**placed)


def _branch_points(
    ax: Axes, analysis: Analysis, sensor: int, x: FloatArray, y: FloatArray, *, named: bool = True
) -> None:
    """Filled points for loading, open ones for unloading."""
    places = analysis.sensors[sensor].point_plateau.astype(int)
    loading = np.asarray([analysis.plateaus[i].branch == "loading" for i in places])
    colour = style.sensor_colour(sensor)
    for chosen, fill, label in ((loading, colour, "loading"), (~loading, style.PAPER_COLOUR, "unloading")):
        ax.plot(x[chosen], y[chosen], "o", color=colour, mfc=fill, mew=0.7, ms=3.2, label=label if named else None)


AXES_TOP, AXES_BOTTOM, AXES_RIGHT = 0.26, 0.42, 0.12
LEFT = 0.72  # wide enough for ticks like −0.015
LEGEND_ROW, LEGEND_ENTRY = 0.15, 1.08  # height of a row of a legend, width of an entry
LEGEND_KEY, LEGEND_LETTER = 0.34, 0.062  # width of a key with its space, of a letter


def set_drawing(canvas: Canvas, drawing: ReportDrawing, x: float, y: float, width: float) -> None:
    """Draw side by side, with the upper left corner at x, y from the canvas's."""
    page_width, page_height = canvas.get_size_inches()
    share, high = width / len(drawing.draw), drawing.height - AXES_TOP - AXES_BOTTOM
    wide = share - LEFT - AXES_RIGHT
    for at, draw in enumerate(drawing.draw):
        left, bottom = x + at * share + LEFT, y + AXES_TOP + high
        ax = canvas.add_axes((left / page_width, 1 - bottom / page_height, wide / page_width, high / page_height))
        draw(ax)
        finished(ax)
        _lift_legend(ax, wide, page_height)


def _lift_legend(ax: Axes, wide: float, page_height: float) -> None:
    """Set a legend between the title and the axes, which give up its height: it covers no data, whatever they are."""
    legend = ax.get_legend()
    if legend is None:
        return
    handles, names = ax.get_legend_handles_labels()
    legend.remove()
    fits = sum(LEGEND_KEY + LEGEND_LETTER * len(name) for name in names) <= wide
    columns = len(names) if fits else max(1, min(len(names), int(wide / LEGEND_ENTRY)))
    rows = -(-len(names) // columns)
    strip = rows * LEGEND_ROW + 0.04
    box = ax.get_position()
    ax.set_position((box.x0, box.y0, box.width, box.height - strip / page_height))
    ax.legend(
        handles, names, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=columns, frameon=False, borderaxespad=0.15,
        borderpad=0.0, columnspacing=1.2, handlelength=1.6, handletextpad=0.5, labelspacing=0.25,
    )  # fmt: skip
    ax.set_title(ax.get_title(loc="left"), loc="left", pad=72.0 * strip + 4.0)


def as_svg(drawing: ReportDrawing, width: float, *, text: bool = False) -> tuple[str, str]:
    """Return the SVG element alone, and its title and axes in words.

    `text` keeps text as text, for a page whose fonts are known; otherwise it becomes outlines.
    """
    with mpl.rc_context({**style.RC, "svg.fonttype": "none" if text else "path"}):
        canvas = Canvas(figsize=(width, drawing.height))
        FigureCanvasSVG(canvas)
        set_drawing(canvas, drawing, 0.0, 0.0, width)
        written = io.StringIO()
        canvas.savefig(written, format="svg", metadata={"Date": None, "Creator": None})
    svg = written.getvalue()
    return svg[svg.index("<svg") :], _described(canvas)


def _described(canvas: Canvas) -> str:
    """Title and axes of each drawing, as in `Sensor 1: signal, mV over elongation, mm`."""
    shown = [ax for ax in canvas.axes if ax.get_ylabel()]
    below = shown[-1].get_xlabel() if shown else ""
    named = ((ax.get_title(loc="left") or ax.get_title(), ax.get_ylabel(), ax.get_xlabel() or below) for ax in shown)
    return "; ".join(f"{title + ': ' if title else ''}{y} over {x}" for title, y, x in named)
