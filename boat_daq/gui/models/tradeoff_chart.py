"""The chart of one method: time against error of its settings, the front and the default.

Processor time is across and error up, both logarithmic; lower left is better. Points have the number of their row in
the table; the default has a ring and the rule's choice a square.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pyqtgraph as pg

from boat_daq.gui.plotting.axes import LogAxis
from boat_daq.gui.plotting.plot import Plot, PlotBox, sensor_colour
from boat_daq.gui.plotting.plot_card import Columns, PlotCard
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls
from boat_daq.viewmodels.common import tables
from boat_daq.viewmodels.models.tradeoff import CHOICE, ENTRIES, FRONT, MethodChart, TradeoffPoint
from protocol.base.arrays import FloatArray

MARGIN_DECADES = 0.25
LEAST_DECADES = 1.0  # so that timing noise looks small
_RING, SQUARE, MARK_WIDTH = 18, 26, 2
LABEL_SHARE = 0.99  # of the width, where a text about a line ends: the settings there are few
NUMBER_ANCHOR = (-0.15, 1.0)  # right of the point and above it
_GAP = (math.nan, math.nan)  # between two strokes
_KEY = f"Lower: more exact; further left: faster   steps: least error for the time   ○ default   □ {CHOICE}"
_EXPLANATION = "A point for each setting, numbered as in the table; time of the processor, bars: range over the repeats"
NOT_MEASURED = "This method was not measured."
Places = Sequence[tuple[float, float]]


def log_card(card: PlotCard, title: str, unit: str, x_title: str) -> Plot:
    """Add a plot with logarithmic axes to a card: error up, processor time in s across."""
    axes = {"left": LogAxis("left"), "bottom": LogAxis("bottom")}
    item = pg.PlotItem(viewBox=PlotBox(), axisItems=axes, enableMenu=False)
    card.view.addItem(item, row=0, col=0)
    item.setMouseEnabled(False, False)  # what is shown is all there is
    plot = Plot(item, title, unit, x_title=x_title, x_unit="s")
    card.plots.append(plot)
    return plot


def limit_lines(plot: Plot) -> tuple[pg.InfiniteLine, pg.InfiniteLine]:
    """Add the lines of the noticeable and of the accepted error."""
    noticed = plot.line(lambda t: t.muted, label="noticeable above")
    accepted = plot.line(lambda t: t.ok, label="accepted below")
    for line, corner in ((noticed, (1, 1)), (accepted, (1, 0))):  # above the upper line, below the lower one
        line.label.anchors = [corner, corner]
        line.label.setPosition(LABEL_SHARE)
    return noticed, accepted


def framed(values: FloatArray) -> tuple[float, float]:
    """Return a range around logarithms, at least `LEAST_DECADES` and the margins."""
    low, high = float(values.min()), float(values.max())
    margin = max(0.0, LEAST_DECADES - (high - low)) / 2 + MARGIN_DECADES * max(1.0, 0.3 * (high - low))
    return low - margin, high + margin


class TradeoffCard(PlotCard):
    """The chart of one method."""

    def __init__(self) -> None:
        super().__init__("Time against error", _EXPLANATION)
        self.plot = log_card(self, "Error", "", "Processor time")
        self.spread = self.plot.curve("Spread of the repeats", lambda t: t.muted, gaps=True)
        self.front = self.plot.curve("Front", sensor_colour(1))
        self.chosen = self.plot.points("Chosen", lambda t: t.pressure, filled=False, symbol="s", size=SQUARE)
        self.default = self.plot.points("Default", sensor_colour(2), filled=False, size=_RING)
        self.settings = self.plot.points("Settings", sensor_colour(1))
        self.notices, self.sufficient = limit_lines(self.plot)
        self.numbers = self.plot.labels(NUMBER_ANCHOR)
        self.key = controls.label(_KEY, "small", wrap=True, name="Key of the chart")
        self.inside.addWidget(self.key)
        self.shown: MethodChart | None = None

    def show_chart(self, chart: MethodChart | None) -> None:
        """Draw a method; None removes the plot."""
        self.shown = chart
        points = [p for p in chart.points if p.drawn] if chart is not None else []
        self.show_empty("" if points else NOT_MEASURED)
        self.key.setVisible(bool(points))
        if chart is None or not points:
            return
        self.heading.setText(ENTRIES.get(chart.name, chart.name))
        self.plot.unit, self.plot.x_title = chart.unit, f"Processor time for {chart.per}"
        self.plot.label_x(self.plot.x_title, self.plot.x_unit)
        x = np.log10([p.seconds for p in points])
        y = np.log10([max(p.error, chart.floor) for p in points])
        at = {p.number: (float(a), float(b)) for p, a, b in zip(points, x, y, strict=True)}
        self.settings.set(x, y)
        for layer, mark in ((self.front, FRONT), (self.default, "default"), (self.chosen, "chosen")):
            marked = [at[p.number] for p in points if mark in p.marks]
            layer.set(*_columns_of(in_steps(marked) if layer is self.front else marked))
        self.spread.set(*spread_bars(points, chart.floor))
        limits = np.log10([chart.tolerance, chart.tolerance / chart.margin])
        for line, value in zip((self.notices, self.sufficient), limits, strict=True):
            line.setValue(float(value))
        self.plot.x_range(*framed(x))
        self.plot.y_range(*framed(np.append(y, limits)))
        self.numbers.set([(*place, str(number)) for number, place in at.items()])
        self.paint_theme(self.theme)

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


def in_steps(front: Places) -> Places:
    """Return a front, cheapest first, with a corner before each next point: no setting is on a line between two."""
    corners = [(after[0], before[1]) for before, after in pairwise(front)]
    return [place for pair in zip(front, corners, strict=False) for place in pair] + list(front[-1:])


def spread_bars(points: Sequence[TradeoffPoint], floor: float) -> tuple[FloatArray, FloatArray]:
    """Return crosses of the repeats' range about each point, as logarithms with NaN between the strokes.

    The range is greatest less smallest; half of it is drawn to either side, no further down than a tenth of the value.
    """
    rows: list[tuple[float, float]] = []
    for p in points:
        t, e = p.seconds, max(p.error, floor)
        (left, right), (low, high) = _about(t, p.spread_s), _about(e, p.error_spread)
        rows += [(left, e), (right, e), _GAP, (t, low), (t, high), _GAP]
    x, y = _columns_of(rows)
    return np.log10(x), np.log10(y)


def _about(value: float, spread: float) -> tuple[float, float]:
    half = spread / 2 if math.isfinite(spread) else 0.0
    return max(value - half, value / 10), value + half


def _columns_of(rows: Places) -> tuple[FloatArray, FloatArray]:
    table = np.array(rows, dtype=float).reshape(-1, 2)
    return table[:, 0], table[:, 1]
