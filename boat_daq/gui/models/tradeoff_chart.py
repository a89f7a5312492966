"""The chart of one method: time against error of its settings, the front, the default, a tolerance that is dragged.

Rules: processor time across, error up, both logarithmic; lower left is better. Points are labelled with the number of
their row in the table; the default has a ring and the rule's choice a square, each with a text. The line of acceptance
moves with the tolerance: the rule of the defaults is the only one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import pairwise

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QKeySequence, QShortcut

from analysis.studies.tradeoff.measure import MARGIN
from boat_daq.formatting import duration_text
from boat_daq.gui import style
from boat_daq.gui.plotting.axes import LogAxis
from boat_daq.gui.plotting.placed_labels import PlacedLabels, PointLabel
from boat_daq.gui.plotting.plot import Plot, sensor_colour
from boat_daq.gui.plotting.plot_card import Columns, PlotCard
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls as widgets
from boat_daq.viewmodels.common import tables
from boat_daq.viewmodels.models.tradeoff import (
    CHOICE,
    ENTRIES,
    FRONT,
    MethodChart,
    TradeoffModel,
    TradeoffPoint,
)
from protocol.base.arrays import FloatArray

MARGIN_DECADES = 0.25
LEAST_DECADES = 1.0  # so that timing noise looks small
LABEL_MARGIN = 0.06  # of the height, over the highest point and under the lowest
RING, SQUARE, MARK_WIDTH = 18, 26, 2
ONE_PLACE_DECADES = 0.02  # points nearer than this are labelled as one
SAME_DECADES = 0.005  # lines nearer than this are one
KEY_DECADES = 0.05  # by which an arrow key moves the tolerance
GAP = (math.nan, math.nan)  # between two strokes
NOTHING = "Press Measure to plot each setting: time across, error up."
KEY = (
    "Lower: more exact; further left: faster. Blue steps: front, the least error for the time.  "
    f"\u25cb default  \u25a1 {CHOICE}"
)
EXPLANATION = (
    "Each point is a setting of the method, numbered as in the table. Time is processor time on the computer that is "
    "named below the table; bars are the range over the repeats. Drag the line of your tolerance, or focus the chart "
    "and press the arrow keys: above the chart is the setting that the rule chooses for it, and its time."
)


def log_card(card: PlotCard, title: str, unit: str, x_title: str) -> Plot:
    """Add a plot with logarithmic axes to a card: error up, processor time across."""
    item = pg.PlotItem(
        axisItems={"left": LogAxis("left"), "bottom": LogAxis("bottom", lambda s: duration_text(s, 1))},
        enableMenu=False,
    )
    card.view.addItem(item, row=0, col=0)
    item.getAxis("bottom").setHeight(style.AXIS_HEIGHT)
    item.setMouseEnabled(False, False)  # what is shown is all there is
    plot = Plot(item, title, unit, x_title=x_title)
    card.plots.append(plot)
    return plot


def accepted_text(margin: float) -> str:
    """Return the label of the line below which the rule accepts a setting."""
    return "accepted below: half" if margin == MARGIN else f"accepted below: 1/{margin:g}"


def framed(values: FloatArray, more: float = 0.0) -> tuple[float, float]:
    """Return a range around logarithms, at least `LEAST_DECADES` and the margins.

    `more` is a share at both ends, for labels and rings.
    """
    low, high = float(values.min()), float(values.max())
    margin = max(0.0, LEAST_DECADES - (high - low)) / 2 + MARGIN_DECADES * max(1.0, 0.3 * (high - low))
    margin += more * (high - low)
    return low - margin, high + margin


class TradeoffCard(PlotCard):
    """The chart of one method."""

    def __init__(self, model: TradeoffModel) -> None:
        super().__init__("Time against error", EXPLANATION)
        self.model = model
        self.plot = log_card(self, "Error", "", "Processor time")
        self.spread = self.plot.curve("Spread of the repeats", lambda t: t.muted, gaps=True)
        self.front = self.plot.curve("Front", sensor_colour(1))
        self.chosen = self.plot.points("Chosen", lambda t: t.pressure, filled=False, symbol="s", size=SQUARE)
        self.default = self.plot.points("Default", sensor_colour(2), filled=False, size=RING)
        self.settings = self.plot.points("Settings", sensor_colour(1))
        self.notices = self.plot.line(lambda t: t.muted, label="noticeable above")
        self.sufficient = self.plot.line(lambda t: t.ok, label=accepted_text(MARGIN))
        self.asked = self.plot.line(lambda t: t.accent, movable=True, label="your tolerance: drag")
        self.asked.setCursor(Qt.CursorShape.SizeVerCursor)
        self.labels = PlacedLabels(
            self.plot,
            ((self.settings, style.POINT_SIZE), (self.default, RING), (self.chosen, SQUARE)),
            (self.front, self.spread),
            (self.asked, self.sufficient, self.notices),
        )
        self.asked.sigPositionChanged.connect(self._show_asked)
        self.asked.sigDragged.connect(self._keep_asked)
        for key, step in ((Qt.Key.Key_Up, KEY_DECADES), (Qt.Key.Key_Down, -KEY_DECADES)):
            moved = QShortcut(QKeySequence(key), self.view, context=Qt.ShortcutContext.WidgetWithChildrenShortcut)
            moved.activated.connect(partial(self._move_asked, step))
        tip = "Moves your tolerance back to the error that is noticeable"
        self.back = widgets.button("Reset", self._reset_asked, "quiet", name="Reset the tolerance", tip=tip)
        kept = self.back.sizePolicy()
        kept.setRetainSizeWhenHidden(True)  # the chart does not move under the line that is dragged
        self.back.setSizePolicy(kept)
        self.key = widgets.label(KEY, "small", wrap=True, name="Key of the chart")
        self.inside.addLayout(widgets.row((self.key, 1), self.back))
        self.shown: MethodChart | None = None

    def show_chart(self, chart: MethodChart | None) -> None:
        """Draw a method; None removes the plot."""
        self.shown = chart
        points = [p for p in chart.points if p.drawn] if chart is not None else []
        self.show_empty("" if points else NOTHING)
        self.key.setVisible(bool(points))
        self.back.hide()
        if chart is None or not points:
            return
        self.heading.setText(ENTRIES.get(chart.name, chart.name))
        self.plot.title, self.plot.unit = "Error", chart.unit
        self.plot.x_title = f"Processor time for {chart.per}"
        self.plot.label_x(self.plot.x_title, "")
        x = np.log10([p.seconds for p in points])
        y = np.log10([max(p.error, chart.floor) for p in points])
        at = {p.number: (float(a), float(b)) for p, a, b in zip(points, x, y, strict=True)}
        self.settings.set(x, y)
        for layer, mark in ((self.front, FRONT), (self.default, "default"), (self.chosen, "chosen")):
            marked = [at[p.number] for p in points if mark in p.marks]
            layer.set(*_columns_of(in_steps(marked) if layer is self.front else marked))
        self.spread.set(*spread_bars(points, chart.floor))
        self._frame(x, np.append(y, np.log10([chart.tolerance, chart.tolerance / chart.margin])))
        self.notices.setValue(math.log10(chart.tolerance))
        self.asked.setValue(math.log10(self.model.tolerance(chart)))
        self._show_asked()
        self.paint_theme(self.theme)
        self.labels.set(point_labels(points, at))

    def _show_asked(self, *_: object) -> None:
        """Show what the tolerance under the line costs."""
        if self.shown is None:
            return
        value = self.asked.value()
        moved = bool(abs(value - self.notices.value()) > SAME_DECADES)
        self.back.setVisible(moved)
        self.sufficient.label.setFormat(accepted_text(self.shown.margin))
        self.sufficient.setValue(value - math.log10(self.shown.margin))
        self.readout.setText(self.shown.asked_text(10.0**value))

    def _move_asked(self, decades: float) -> None:
        """Move the tolerance by so many powers of ten."""
        self.asked.setValue(self.asked.value() + decades)
        self._keep_asked()

    def _reset_asked(self) -> None:
        self.asked.setValue(self.notices.value())
        self._keep_asked()

    def _keep_asked(self, *_: object) -> None:
        """Remember the tolerance that was chosen for this method."""
        if self.shown is not None:
            self.model.ask(self.shown, 10.0 ** float(self.asked.value()))

    def _frame(self, x: FloatArray, y: FloatArray) -> None:
        self.plot.x_range(*framed(x))
        ends = framed(y, LABEL_MARGIN)
        self.plot.y_range(*ends)
        self.asked.setBounds(ends)  # it cannot be dragged out of sight

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


def point_labels(points: Sequence[TradeoffPoint], at: dict[int, tuple[float, float]]) -> list[PointLabel]:
    """Return the labels of settings, those with a use first, then the front; those in one place share a label.

    Parameters
    ----------
    points : the settings that are drawn.
    at : logarithms of time and error, by number.
    """
    placed: list[tuple[float, float, list[str], float]] = []
    for p in sorted(points, key=lambda p: (not p.uses, FRONT not in p.marks, p.number)):
        x, y = at[p.number]
        clear = {"chosen": SQUARE, "default": RING}
        width = max([style.POINT_SIZE, *(clear.get(use, 0) for use in p.uses)])
        text = f"{p.number} {p.uses_text}".strip()
        near = [texts for a, b, texts, _ in placed if max(abs(a - x), abs(b - y)) < ONE_PLACE_DECADES]
        if near:
            near[0].append(text)
        else:
            placed.append((x, y, [text], width / 2 + 1))
    return [PointLabel(x, y, ", ".join(texts), clear) for x, y, texts, clear in placed]


def in_steps(front: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
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
        rows += [(left, e), (right, e), GAP, (t, low), (t, high), GAP]
    x, y = _columns_of(rows)
    return np.log10(x), np.log10(y)


def _about(value: float, spread: float) -> tuple[float, float]:
    half = spread / 2 if math.isfinite(spread) else 0.0
    return max(value - half, value / 10), value + half


def _columns_of(rows: Sequence[tuple[float, float]]) -> tuple[FloatArray, FloatArray]:
    table = np.array(rows, dtype=float).reshape(-1, 2)
    return table[:, 0], table[:, 1]
