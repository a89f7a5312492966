"""The trade-off page: the methods to measure, time against error of the shown one, the rule's choice, and its maps.

Rules of the chart: processor time across, error up, both logarithmic; lower left is better. Points are labelled with
the number of their row in the table; the default has a ring and the choice a square, each with a text. Each outcome of
a map has a colour, a hatching and a letter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF, QRectF, QSignalBlocker, Qt
from PySide6.QtGui import QBrush, QColor, QKeySequence, QPainter, QShortcut
from PySide6.QtWidgets import QListWidget, QListWidgetItem, QProgressBar, QVBoxLayout, QWidget

from analysis.arrays import FloatArray
from analysis.fidelity import LEVELS
from boat_daq.engine.snapshot import SessionSnapshot
from boat_daq.gui import style
from boat_daq.gui.models.tradeoff_jobs import measure_methods
from boat_daq.gui.plotting.axes import LogAxis, fixed_plot, paint_axis
from boat_daq.gui.plotting.plot import Plot, sensor_colour
from boat_daq.gui.plotting.plot_card import Columns, PlotCard
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls as widgets
from boat_daq.gui.widgets.data_table import DataTable
from boat_daq.gui.widgets.file_dialogs import ask_open, ask_save
from boat_daq.gui.widgets.layouts import ReflowingPage, Shares
from boat_daq.viewmodels.common import tables
from boat_daq.viewmodels.common.formatting import duration_text
from boat_daq.viewmodels.common.preferences import Precision
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.models.tradeoff import (
    ENTRIES,
    FRONT,
    METHODS,
    OUTCOMES,
    AtlasModel,
    MapView,
    MethodChart,
    TradeoffModel,
    TradeoffPoint,
    error_text,
)

MARGIN_DECADES = 0.25
LEAST_DECADES = 1.0  # so that timing noise looks small
LABEL_MARGIN = 0.08  # of the height, over the highest point
RING, SQUARE, MARK_WIDTH = 18, 26, 2
AT_LEFT = 0.01  # where settings are cheap and their errors above the lines
ONE_PLACE_DECADES = 0.05  # points nearer than this are labelled as one
KEY_DECADES = 0.05  # by which an arrow key moves the tolerance
GAP = (math.nan, math.nan)  # between two strokes
NOTHING = "Press Measure to plot each setting: time across, error up."
SIDES = ("bottom", "left")
HATCHING = {
    "works": Qt.BrushStyle.NoBrush,
    "degraded": Qt.BrushStyle.BDiagPattern,
    "refused": Qt.BrushStyle.DiagCrossPattern,
    "unwarned": Qt.BrushStyle.NoBrush,
}
CELL_GAP = 1.0  # pixels between cells
LETTER_LEAST = 12.0  # pixels: a smaller cell has no letter, only colour and hatching
LABELS = (10, 7, 5, 4)  # along each of one, two, three, four maps beside each other
LEAST_HEIGHT = 300
NO_LIMIT, EMPTY_HEIGHT = 16_777_215, 96
WHAT_COMES = "\u201cMap\u201d tests this method over many synthetic cases: where it works, warns, or refuses."
POINT_AT = "Point at a cell to read its case and its result."
PRECISIONS = {
    "draft": "Draft: fast, rough",
    "normal": "Normal (sufficient)",
    "reference": "Reference: slow, exact",
}
NOT_MEASURED = "Nothing is measured yet. Press Measure, or Open."
HEADINGS = ("No.", "Setting", "Time", "Error", "Mark")
MARKS = "\u25cb default   \u25a1 chosen by the rule   D used at Draft   R used at Reference"
NOTHING_YET = (
    "Press Measure to time every setting of this method on this computer and to compare its result with an independent "
    "reference."
)


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
        self.asked = self.plot.line(lambda t: t.accent, movable=True, label="your tolerance: drag")
        self.asked.setCursor(Qt.CursorShape.SizeVerCursor)
        self.asked.sigPositionChanged.connect(self._show_asked)
        self.asked.sigDragged.connect(self._keep_asked)
        for key, step in ((Qt.Key.Key_Up, KEY_DECADES), (Qt.Key.Key_Down, -KEY_DECADES)):
            moved = QShortcut(QKeySequence(key), self.view, context=Qt.ShortcutContext.WidgetWithChildrenShortcut)
            moved.activated.connect(partial(self._move_asked, step))
        self._kept: dict[str, float] = {}
        for line, side in ((self.asked, 0), (self.notices, 1), (self.sufficient, 0)):
            line.label.setPosition(AT_LEFT)
            line.label.anchors = [(0, side), (0, side)]
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
        self.plot.title, self.plot.unit = "Error", chart.unit
        self.plot.x_title = f"Processor time, {chart.per}"
        self.plot.label_x(self.plot.x_title, "")
        x = np.log10([p.seconds for p in points])
        y = np.log10([max(p.error, chart.floor) for p in points])
        at = {p.number: (float(a), float(b)) for p, a, b in zip(points, x, y, strict=True)}
        self.settings.set(x, y)
        for layer, mark in ((self.front, FRONT), (self.default, "default"), (self.chosen, "chosen")):
            marked = [at[p.number] for p in points if mark in p.marks]
            layer.set(*_columns_of(in_steps(marked) if layer is self.front else marked))
        self.spread.set(*spread_bars(points, chart.floor))
        self.notices.setValue(math.log10(chart.tolerance))
        self.sufficient.setValue(math.log10(chart.sufficient))
        self.labels.set(point_labels([(*at[p.number], f"{p.number} {', '.join(p.uses)}".strip()) for p in points]))
        self._frame(x, np.append(y, np.log10([chart.tolerance, chart.sufficient])))
        self.asked.setValue(self._kept.get(chart.name, math.log10(chart.tolerance)))
        self._show_asked()
        self.paint_theme(self.theme)

    def _show_asked(self, *_: object) -> None:
        """Show what the tolerance under the line costs."""
        if self.shown is not None:
            self.readout.setText(self.shown.asked_text(10.0 ** self.asked.value()))

    def _move_asked(self, decades: float) -> None:
        """Move the tolerance by so many powers of ten."""
        self.asked.setValue(self.asked.value() + decades)
        self._keep_asked()

    def _keep_asked(self, *_: object) -> None:
        """Remember the tolerance that was chosen for this method."""
        if self.shown is not None:
            self._kept[self.shown.name] = float(self.asked.value())

    def _frame(self, x: FloatArray, y: FloatArray) -> None:
        for values, show, above in ((x, self.plot.x_range, 0.0), (y, self.plot.y_range, LABEL_MARGIN)):
            low, high = float(values.min()), float(values.max())
            more = max(0.0, LEAST_DECADES - (high - low)) / 2 + MARGIN_DECADES * max(1.0, 0.3 * (high - low))
            ends = low - more, high + more + above * (high - low)
            show(*ends)
        self.asked.setBounds(ends)  # of the errors: it cannot be dragged out of sight

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


def point_labels(points: Sequence[tuple[float, float, str]]) -> list[tuple[float, float, str]]:
    """Return the labels (x, y, text) with those of points in one place joined: one over the other shows neither."""
    joined: list[tuple[float, float, str]] = []
    for x, y, text in points:
        near = [i for i, (a, b, _) in enumerate(joined) if max(abs(a - x), abs(b - y)) < ONE_PLACE_DECADES]
        if near:
            a, b, others = joined[near[0]]
            joined[near[0]] = (a, b, f"{others}, {text}")
        else:
            joined.append((x, y, text))
    return joined


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


class MapCells(pg.GraphicsObject):  # type: ignore[misc]
    """The cells of one map, each a unit square; hatching and letters keep their size on the screen."""

    def __init__(self, shown: MapView) -> None:
        super().__init__()
        self.shown = shown
        self.theme: Theme = style.LIGHT

    def boundingRect(self) -> QRectF:
        """Return the map's extent."""
        x, y = self.shown.axes
        return QRectF(0, 0, len(x.ticks), len(y.ticks))

    def paint(self, painter: QPainter, *_: object) -> None:
        """Draw every cell in pixels of the screen."""
        transform = painter.transform()
        painter.save()
        painter.resetTransform()
        painter.setFont(style.small_font())
        painter.setPen(Qt.PenStyle.NoPen)
        for row, cells in enumerate(self.shown.cells):
            for column, cell in enumerate(cells):
                box = transform.mapRect(QRectF(column, row, 1, 1)).adjusted(0, 0, -CELL_GAP, -CELL_GAP)
                self._cell(painter, box, cell.outcome)
        painter.restore()

    def _cell(self, painter: QPainter, box: QRectF, outcome: str) -> None:
        background, foreground = style.outcome_colours(self.theme)[outcome]
        painter.fillRect(box, QColor(background))
        painter.fillRect(box, QBrush(style.colour(foreground, style.HATCH_ALPHA), HATCHING[outcome]))
        if min(box.width(), box.height()) >= LETTER_LEAST:
            painter.setPen(QColor(foreground))
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter, OUTCOMES[outcome][0])
            painter.setPen(Qt.PenStyle.NoPen)


class AtlasCard(PlotCard):
    """The maps of the shown method, their legend, and the sweep that makes them."""

    def __init__(self, model: AtlasModel, attempt: Any) -> None:
        super().__init__("Where the method works")
        self.model, self.method = model, ""
        self.legend = widgets.label("", "small", wrap=True, name="Legend of the maps")
        self.legend.setTextFormat(Qt.TextFormat.RichText)
        self.sweep = widgets.button(
            "Map", lambda: attempt(partial(model.toggle, self.method)), name="Map where it works"
        )
        self.bar.insertWidget(1, self.sweep)
        self.words = widgets.label("", "small", name="The case under the mouse", wrap=True)
        self.inside.addWidget(self.legend)
        self.inside.addWidget(self.words)
        self.items: list[tuple[Any, MapCells]] = []
        self.view.scene().sigMouseMoved.connect(self._look)

    def show_method(self, method: str) -> None:
        """Draw the maps of a method."""
        self.method = method
        self.view.clear()
        self.items = []
        maps = self.model.maps.get(method, [])
        most = LABELS[min(len(maps), len(LABELS)) - 1]
        for column, shown in enumerate(maps):
            self._add(column, shown, most)
        self.view.setVisible(bool(maps))
        self.legend.setVisible(bool(maps))
        no_map = self.model.no_map(method)
        self.words.setText(maps[0].summary if len(maps) == 1 else POINT_AT if maps else no_map or WHAT_COMES)
        self.setMinimumHeight(LEAST_HEIGHT if maps else 0)
        self.setMaximumHeight(NO_LIMIT if maps else EMPTY_HEIGHT)
        self.paint_theme(self.theme)

    def refresh(self) -> None:
        """Show the sweep under way."""
        widgets.set_text(self.sweep, "Stop" if self.model.job is not None else "Map")
        widgets.allow(self.sweep, self.model.no_map(self.method) if self.model.job is None else "")
        widgets.set_text(self.readout, self.model.status(self.method))

    def _add(self, column: int, shown: MapView, most: int) -> None:
        item, cells = fixed_plot(), MapCells(shown)
        item.addItem(cells)
        self.view.addItem(item, row=0, col=column)
        item.setRange(cells.boundingRect(), padding=0)
        for side, axis, limit in zip(SIDES, shown.axes, (most, LABELS[0]), strict=True):
            step = -(-len(axis.ticks) // limit)
            item.getAxis(side).setTicks([[(i + 0.5, t) for i, t in enumerate(axis.ticks) if i % step == 0]])
        self.items.append((item, cells))

    def _look(self, at: QPointF) -> None:
        """Show the case under the mouse."""
        for item, cells in self.items:
            box = item.getViewBox()
            if box.sceneBoundingRect().contains(at):
                here = box.mapSceneToView(at)
                self.words.setText(cells.shown.cell_text(int(here.x()), int(here.y())))
                self.words.setToolTip(self.words.text())

    def columns(self) -> Columns:
        """Return every case of the maps with its outcome and error."""
        rows = [
            (m.title, x.title, x_tick, y.title, y_tick, cell.outcome, cell.error, m.unit, cell.message)
            for m in self.model.maps.get(self.method, [])
            for x, y in (m.axes,)
            for y_tick, row in zip(y.ticks, m.cells, strict=True)
            for x_tick, cell in zip(x.ticks, row, strict=True)
        ]
        names = ("map", "x is", "x", "y is", "y", "outcome", "error", "unit of the error", "message")
        return tables.by_column(names, rows)

    def paint_theme(self, theme: Theme) -> None:
        """Use the colours of `theme`."""
        super().paint_theme(theme)
        entries = ((style.outcome_colours(theme)[outcome], words) for outcome, words in OUTCOMES.items())
        self.legend.setText("  ".join(style.swatch(*colours, " ".join(words)) for colours, words in entries))
        for item, cells in self.items:
            cells.theme = theme
            cells.update()
            for side, axis in zip(SIDES, cells.shown.axes, strict=True):
                paint_axis(item, side, theme, axis.title)
            item.setTitle(cells.shown.title, color=theme.muted, size=f"{style.FONT_SMALL}px")


class MethodList(QListWidget):
    """The methods: ticked ones are measured, the selected one is shown."""

    def __init__(self, tradeoff: TradeoffModel) -> None:
        super().__init__()
        self.tradeoff = tradeoff
        self.setAccessibleName("Methods; ticked ones are measured, the selected one is shown")
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.addItems(list(ENTRIES))
        self.show_entries()
        self.itemChanged.connect(self._ticked)
        self.currentRowChanged.connect(lambda row: self.tradeoff.show(list(ENTRIES)[row]))

    def show_entries(self) -> None:
        """Show the current ticks, titles and verdicts."""
        with QSignalBlocker(self):
            for row, (name, title) in enumerate(ENTRIES.items()):
                item = self.item(row)
                item.setText(f"{title}\n{self.tradeoff.entry(name)}")
                if name in METHODS:
                    ticked = name in self.tradeoff.chosen
                    item.setCheckState(Qt.CheckState.Checked if ticked else Qt.CheckState.Unchecked)
            self.setCurrentRow(list(ENTRIES).index(self.tradeoff.shown))

    def _ticked(self, item: QListWidgetItem) -> None:
        self.tradeoff.choose(list(ENTRIES)[self.row(item)], item.checkState() is Qt.CheckState.Checked)


class SettingsTable(DataTable):
    """Every setting of a method, cheapest first."""

    def __init__(self) -> None:
        super().__init__("Settings of the method, cheapest first", HEADINGS, stretched=1, right=(0, 2, 3))
        self.explain({HEADINGS.index("Mark"): MARKS})
        self.verticalHeader().setDefaultSectionSize(style.CONTROL_HEIGHT - 2 * style.STEP)

    def show_chart(self, chart: MethodChart | None) -> None:
        """Show another method's settings."""
        points = chart.points if chart is not None else ()
        unit = chart.unit if chart is not None else ""
        rows = [(str(p.number), p.setting, duration_text(p.seconds), error_text(p.error), p.symbols) for p in points]
        tips = [
            f"{p.setting}: {duration_text(p.seconds)}, {p.repeats} repeats within {duration_text(p.spread_s)}; "
            f"error {error_text(p.error)} {unit}, within {error_text(p.error_spread)}"
            for p in points
        ]
        self.fill(rows, tips)


class TradeoffPage(ReflowingPage):
    """The trade-off page.

    Parameters
    ----------
    model : of the measurements.
    atlas : of the maps.
    precision : of the program's computations.
    services : of the window.
    """

    def __init__(self, model: TradeoffModel, atlas: AtlasModel, precision: Precision, services: Services) -> None:
        super().__init__()
        self.model, self.maps, self.precision, self.services = model, atlas, precision, services
        self._revision = (-1, -1)
        self.model.measurer = measure_methods
        self.methods = MethodList(model)
        self.first = self.methods
        self.chart, self.table = TradeoffCard(), SettingsTable()
        self.atlas = AtlasCard(atlas, services.notices.attempt)
        self.explanation = widgets.label(NOTHING_YET, "muted", wrap=True, name="The rule's choice")
        self.measured = widgets.label("", "small", wrap=True)
        widgets.page_layout(self).addLayout(widgets.row(self._side(), (self._right(), 1)))

    def _side(self) -> QWidget:
        extents = [("Quick, some minutes", True), ("Full, some 15 minutes", False)]
        self.kind = widgets.choice("Extent of the measurement", extents, self.model.set_quick)
        self.kind.setCurrentIndex(self.kind.findData(self.model.quick))
        levels = [(PRECISIONS[n], n) for n in LEVELS]
        tip = "Precision of optics, shadow, uncertainty and live plots; also in the Models menu"
        self.level = widgets.choice("Precision of the program", levels, self.precision.choose, tip=tip)
        attempt = self.services.notices.attempt
        self.start = widgets.button("Measure", partial(attempt, self.model.toggle), "primary")
        self.progress = QProgressBar()
        self.progress.setAccessibleName("Progress of the measurement")
        self.status = widgets.label("", "small", wrap=True)
        ask = partial(ask_open, self, self.services, "Open a measured trade-off", "json", self.model.load)
        self.open = widgets.button("Open \u2026", ask, name="Open a measured trade-off")
        ask = partial(ask_save, self, self.services, "tradeoff", "json csv", self.model.save)
        self.save = widgets.button("Save \u2026", ask, name="Save the trade-off as JSON or CSV")
        files, precision = widgets.row(self.open, self.save), widgets.label("Precision", "subtitle")
        run = (self.kind, self.start, self.progress, self.status, files)
        methods = widgets.label("Methods", "subtitle"), (self.methods, 1)
        frame, _ = widgets.card(*methods, *run, style.GAP, precision, self.level)
        frame.setFixedWidth(style.PANE_WIDTH_NARROW + 4 * style.STEP)
        return frame

    def _right(self) -> QVBoxLayout:
        self.table_card, _ = widgets.card((self.table, 1), self.explanation, self.measured)
        keep = self.services.preferences
        self.upper = Shares("settings", keep, (self.chart, 9), (self.table_card, 8), beside=True)
        self.rows, self.tall = (self.upper,), (self.chart, self.table_card)
        self.reflow()
        right = widgets.column((Shares("trade-off", keep, (self.upper, 3), (self.atlas, 2)), 1), spacing=style.GAP)
        right.addStretch(0)  # takes the rest where only the small card of the maps is shown
        return right

    def reflow(self) -> None:
        """Give chart and table their height where they are stacked."""
        super().reflow()
        self.upper.setMinimumHeight(2 * style.STACKED_HEIGHT + style.GAP if self.narrow else 0)

    def refresh(self, snapshot: SessionSnapshot) -> None:
        """Show the progress of the measurement; the rest where it has changed."""
        self.level.setCurrentIndex(self.level.findData(self.precision.level))
        job = self.model.job
        widgets.set_text(self.start, "Stop" if job is not None else "Measure")
        self.progress.setVisible(job is not None)
        if job is not None:
            self.progress.setRange(0, 0 if job.fraction is None else 1000)
            self.progress.setValue(job.permille)
        widgets.set_text(self.status, self.model.status())
        self.status.setVisible(bool(self.status.text()))
        self.atlas.refresh()
        revision = (self.model.revision, self.maps.revision)
        if revision == self._revision:
            return
        self._revision = revision
        chart = self.model.chart
        self.methods.show_entries()
        widgets.allow(self.save, "" if self.model.content is not None else NOT_MEASURED)
        self.chart.heading.setText(ENTRIES[self.model.shown])
        self.chart.readout.setText("" if chart else self.model.entry(self.model.shown))
        self.chart.show_chart(chart)
        self.table.show_chart(chart)
        self.atlas.show_method(self.model.shown)
        self.upper.setVisible(self.model.shown in METHODS)
        self.explanation.setText(chart.explanation if chart else NOTHING_YET)
        self.measured.setText(f"Measured: {chart.measured}" if chart else "")
