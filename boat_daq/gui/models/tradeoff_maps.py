"""The maps of where a method works: each outcome has a colour, a hatching and a letter."""

from __future__ import annotations

from functools import partial
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QBrush, QColor, QPainter

from boat_daq.gui import style
from boat_daq.gui.plotting.axes import fixed_plot, paint_axis
from boat_daq.gui.plotting.plot_card import Columns, PlotCard
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls
from boat_daq.viewmodels.common import tables
from boat_daq.viewmodels.models.failure_maps import OUTCOMES, AtlasModel, MapView

SIDES = ("bottom", "left")
HATCHING = {
    "works": Qt.BrushStyle.NoBrush,
    "degraded": Qt.BrushStyle.BDiagPattern,
    "refused": Qt.BrushStyle.DiagCrossPattern,
    "unwarned": Qt.BrushStyle.NoBrush,
}
CELL_GAP = 1.0  # pixels between cells
LETTER_LEAST = 12.0  # pixels: a smaller cell has no letter, only colour and hatching
_LABELS = (10, 7, 5, 4)  # along each of one, two, three, four maps beside each other
LEAST_HEIGHT = 300
_NO_LIMIT, EMPTY_HEIGHT = 16_777_215, 96
_WHAT_COMES = "\u201cMap\u201d tests this method over many synthetic cases: where it works, warns, or refuses."
POINT_AT = "Point at a cell to read its case and its result."


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
        self.legend = controls.label("", "small", wrap=True, name="Legend of the maps")
        self.legend.setTextFormat(Qt.TextFormat.RichText)
        self.sweep = controls.button(
            "Map", lambda: attempt(partial(model.toggle, self.method)), name="Map where it works"
        )
        self.bar.insertWidget(1, self.sweep)
        self.words = controls.label("", "small", name="The case under the mouse", wrap=True)
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
        most = _LABELS[min(len(maps), len(_LABELS)) - 1]
        for column, shown in enumerate(maps):
            self._add(column, shown, most)
        self.view.setVisible(bool(maps))
        self.legend.setVisible(bool(maps))
        no_map = self.model.no_map(method)
        self.words.setText(maps[0].summary if len(maps) == 1 else POINT_AT if maps else no_map or _WHAT_COMES)
        self.setMinimumHeight(LEAST_HEIGHT if maps else 0)
        self.setMaximumHeight(_NO_LIMIT if maps else EMPTY_HEIGHT)
        self.paint_theme(self.theme)

    def refresh(self) -> None:
        """Show the sweep under way."""
        controls.set_text(self.sweep, "Stop" if self.model.job is not None else "Map")
        controls.allow(self.sweep, self.model.no_map(self.method) if self.model.job is None else "")
        controls.set_text(self.readout, self.model.status(self.method))

    def _add(self, column: int, shown: MapView, most: int) -> None:
        item, cells = fixed_plot(), MapCells(shown)
        item.addItem(cells)
        self.view.addItem(item, row=0, col=column)
        item.setRange(cells.boundingRect(), padding=0)
        for side, axis, limit in zip(SIDES, shown.axes, (most, _LABELS[0]), strict=True):
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
