"""Drawings set onto a canvas with fixed margins, in inches; PDF and HTML use the same ones."""

from __future__ import annotations

import io

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure as Canvas

from analysis import figure_style as style
from analysis.reports.document import ReportDrawing
from analysis.reports.drawings import finished

AXES_TOP, AXES_BOTTOM, AXES_RIGHT = 0.26, 0.42, 0.12
BETWEEN = 0.1  # stacked axes


def set_drawing(canvas: Canvas, drawing: ReportDrawing, x: float, y: float, width: float) -> None:
    """Draw with the upper left corner at x, y from the canvas's: side by side, or stacked on one abscissa.

    Parameters
    ----------
    canvas : to draw onto.
    drawing : to set.
    x, y : of its upper left corner from that of the canvas, inches.
    width : inches.
    """
    page_width, page_height = canvas.get_size_inches()
    first: Axes | None = None
    for draw, (left, top, wide, high) in zip(drawing.draw, _boxes(drawing, x, y, width), strict=True):
        box = (left / page_width, 1 - (top + high) / page_height, wide / page_width, high / page_height)
        stacked = bool(drawing.ratios)
        ax = canvas.add_axes(box, sharex=first if stacked else None)
        draw(ax)
        finished(ax)
        if stacked and draw is not drawing.draw[-1]:
            ax.tick_params(labelbottom=False)
            ax.set_xlabel("")
        first = first or ax


def _boxes(drawing: ReportDrawing, x: float, y: float, width: float) -> list[tuple[float, float, float, float]]:
    """Left, top, width, height of each drawing's axes."""
    count, top = len(drawing.draw), y + AXES_TOP
    if not drawing.ratios:
        cell, high = width / count, drawing.height - AXES_TOP - AXES_BOTTOM
        return [(x + at * cell + drawing.left, top, cell - drawing.left - AXES_RIGHT, high) for at in range(count)]
    shares = np.asarray(drawing.ratios) / sum(drawing.ratios)
    usable = drawing.height - AXES_TOP - AXES_BOTTOM - BETWEEN * (count - 1)
    wide = width - drawing.left - AXES_RIGHT
    return [
        (x + drawing.left, top + usable * float(shares[:at].sum()) + BETWEEN * at, wide, usable * float(shares[at]))
        for at in range(count)
    ]


def as_svg(drawing: ReportDrawing, width: float) -> str:
    """Return the SVG element alone."""
    with mpl.rc_context(style.RC):
        canvas = Canvas(figsize=(width, drawing.height))
        FigureCanvasSVG(canvas)
        set_drawing(canvas, drawing, 0.0, 0.0, width)
        text = io.StringIO()
        canvas.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    svg = text.getvalue()
    return svg[svg.index("<svg") :]
