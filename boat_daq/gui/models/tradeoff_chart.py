"""Time against error of one method: the front, the default, the rule's choice, and the consumer's tolerance.

Rules: processor time across, error up, both logarithmic; lower left is better. Points are labelled with the number of
their row in the table; the default has a ring and the choice a square, each with a text.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg

from analysis.arrays import FloatArray
from boat_daq.gui import style
from boat_daq.gui.plotting.axes import LogAxis
from boat_daq.gui.plotting.plot import Plot, sensor_colour
from boat_daq.gui.plotting.plot_card import Columns, PlotCard
from boat_daq.gui.style import Theme
from boat_daq.viewmodels.common import tables
from boat_daq.viewmodels.common.formatting import duration_text
from boat_daq.viewmodels.models.tradeoff_report import FRONT, MethodChart, TradeoffPoint

MARGIN_DECADES = 0.25
LEAST_DECADES = 1.0  # so that timing noise looks small
LABEL_MARGIN = 0.08  # of the height, over the highest point
RING, SQUARE, MARK_WIDTH = 18, 26, 2
AT_RIGHT = 0.99
GAP = (math.nan, math.nan)  # between two strokes
NOTHING = "Press Measure to plot each setting: time across, error up."


class TradeoffCard(PlotCard):
    """The chart of one method."""

    def __init__(self) -> None:
        super().__init__("Time against error")
        item = pg.PlotItem(
            axisItems={"left": LogAxis("left"), "bottom": LogAxis("bottom", lambda s: duration_text(s, 1))},
            enableMenu=False,
        )
        self.view.addItem(item, row=0, col=0)
        item.getAxis("bottom").setHeight(style.AXIS_HEIGHT)
        self.plot = Plot(item, "Error", "", x_title="Processor time")
        self.plots.append(self.plot)
        self.spread = self.plot.curve("Spread of the repeats", lambda t: t.muted, gaps=True)
        self.front = self.plot.curve("Front", sensor_colour(1))
        self.chosen = self.plot.points("Chosen", lambda t: t.pressure, filled=False, symbol="s", size=SQUARE)
        self.default = self.plot.points("Default", sensor_colour(2), filled=False, size=RING)
        self.settings = self.plot.points("Settings", sensor_colour(1))
        self.notices = self.plot.line(lambda t: t.muted, label="noticeable above")
        self.sufficient = self.plot.line(lambda t: t.ok, label="sufficient below")
        for line, side in ((self.notices, 1), (self.sufficient, 0)):
            line.label.setPosition(AT_RIGHT)
            line.label.anchors = [(1, side), (1, side)]
        self.labels = self.plot.labels((-0.1, 1.1))
        self.shown: MethodChart | None = None

    def show_chart(self, chart: MethodChart | None) -> None:
        """Draw a method; None removes the plot."""
        self.shown = chart
        points = [p for p in chart.points if p.drawn] if chart is not None else []
        self.show_empty("" if points else NOTHING)
        if chart is None or not points:
            return
        self.heading.setText(chart.title)
        self.readout.setText("\u25cb default   \u25a1 chosen by the rule")
        self.plot.title, self.plot.unit = "Error", chart.unit
        self.plot.x_title = f"Processor time, {chart.per}"
        x = np.log10([p.seconds for p in points])
        y = np.log10([max(p.error, chart.floor) for p in points])
        at = {p.number: (float(a), float(b)) for p, a, b in zip(points, x, y, strict=True)}
        self.settings.set(x, y)
        for layer, mark in ((self.front, FRONT), (self.default, "default"), (self.chosen, "chosen")):
            layer.set(*_columns_of([at[p.number] for p in points if mark in p.marks]))
        self.spread.set(*spread_bars(points, chart.floor))
        self.notices.setValue(math.log10(chart.tolerance))
        self.sufficient.setValue(math.log10(chart.sufficient))
        self.labels.set([(*at[p.number], f"{p.number} {', '.join(p.uses)}".strip()) for p in points])
        self._frame(x, np.append(y, np.log10([chart.tolerance, chart.sufficient])))
        self.paint_theme(self.theme)

    def _frame(self, x: FloatArray, y: FloatArray) -> None:
        for values, show, above in ((x, self.plot.x_range, 0.0), (y, self.plot.y_range, LABEL_MARGIN)):
            low, high = float(values.min()), float(values.max())
            more = max(0.0, LEAST_DECADES - (high - low)) / 2 + MARGIN_DECADES * max(1.0, 0.3 * (high - low))
            show(low - more, high + more + above * (high - low))

    def paint_theme(self, theme: Theme) -> None:
        """Use the colours of `theme`."""
        super().paint_theme(theme)
        for layer in (self.default, self.chosen):
            layer.item.setPen(pg.mkPen(layer.colour(theme), width=MARK_WIDTH))

    def columns(self) -> Columns:
        """Return every setting of the method with its time, error and marks."""
        chart = self.shown
        if chart is None:
            return {}
        units = f"error ({chart.unit})", f"error spread ({chart.unit})"
        names = ("setting", "processor time (s)", "spread (s)", *units, "marks")
        rows = [(p.setting, p.seconds, p.spread_s, p.error, p.error_spread, ", ".join(p.marks)) for p in chart.points]
        return tables.by_column(names, rows)


def spread_bars(points: Sequence[TradeoffPoint], floor: float) -> tuple[FloatArray, FloatArray]:
    """Return crosses of the repeats' range about each point, as logarithms with NaN between the strokes.

    The range is greatest less smallest; half of it is drawn to either side, no further down than a tenth of the value.
    """
    rows: list[tuple[float, float]] = []
    for p in points:
        t, e = p.seconds, max(p.error, floor)
        (left, right), (low, high) = _about(t, p.spread_s), _about(e, p.error_spread)
        rows += [(left, e), (right, e), GAP, (t, low), (t, high), GAP]
    x, y = _columns_of(rows)
    return np.log10(x), np.log10(y)


def _about(value: float, spread: float) -> tuple[float, float]:
    half = spread / 2 if math.isfinite(spread) else 0.0
    return max(value - half, value / 10), value + half


def _columns_of(rows: Sequence[tuple[float, float]]) -> tuple[FloatArray, FloatArray]:
    table = np.array(rows, dtype=float).reshape(-1, 2)
    return table[:, 0], table[:, 1]
