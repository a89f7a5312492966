"""The maps of a method beside each other: works, degraded, refused, each told by colour, hatching and letter."""

from __future__ import annotations

from functools import partial
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QBrush, QColor, QPainter
from PySide6.QtWidgets import QVBoxLayout

from boat_daq.gui import style
from boat_daq.gui.plotting.axes import paint_axis
from boat_daq.gui.plotting.plot_card import Columns, PlotCard
from boat_daq.gui.style import Theme
from boat_daq.gui.widgets import controls as widgets
from boat_daq.viewmodels.models.atlas import LEGEND, LETTERS, OUTCOMES, AtlasModel, MapShown

HATCHING = {
    "works": Qt.BrushStyle.NoBrush,
    "degraded": Qt.BrushStyle.BDiagPattern,
    "refused": Qt.BrushStyle.DiagCrossPattern,
    "quiet wrong": Qt.BrushStyle.NoBrush,
}
GAP = 1.0  # pixels between places
LETTER_ROOM = 12.0  # a place smaller than this has no letter, only its colour and hatching
LABELS = (10, 7, 5, 4)  # along each of one, two, three, four maps beside each other
LEAST_HEIGHT = 300
NO_MAP = MapShown("", "", "", "", 0.0, "", "", (), (), ())
NO_LIMIT, EMPTY_HEIGHT = 16_777_215, 96
WHAT_COMES = "Map it tries this method in many made-up places: where it works, answers with a warning, or refuses."
POINT_AT = "Point at a place to read what was asked and what was answered."


class Places(pg.GraphicsObject):  # type: ignore[misc]
    """The places of one map, each a unit square; hatching and letters keep their size on the screen."""

    def __init__(self) -> None:
        super().__init__()
        self.shown: MapShown = NO_MAP
        self.theme: Theme = style.LIGHT

    def show_map(self, shown: MapShown) -> None:
        """Draw another map."""
        self.prepareGeometryChange()
        self.shown = shown
        self.update()

    def boundingRect(self) -> QRectF:
        """Return the map's extent."""
        return QRectF(0, 0, len(self.shown.x_ticks), len(self.shown.y_ticks))

    def paint(self, painter: QPainter, *_: object) -> None:
        """Draw every place in the screen's own pixels."""
        way = painter.transform()
        painter.save()
        painter.resetTransform()
        painter.setFont(style.small_font())
        painter.setPen(Qt.PenStyle.NoPen)
        for row, places in enumerate(self.shown.places):
            for column, place in enumerate(places):
                box = way.mapRect(QRectF(column, row, 1, 1)).adjusted(0, 0, -GAP, -GAP)
                self._place(painter, box, place.outcome)
        painter.restore()

    def _place(self, painter: QPainter, box: QRectF, outcome: str) -> None:
        ground, ink = style.outcome_colours(self.theme)[outcome]
        painter.fillRect(box, QColor(ground))
        if HATCHING[outcome] is not Qt.BrushStyle.NoBrush:
            painter.fillRect(box, QBrush(style.colour(ink, style.HATCH_ALPHA), HATCHING[outcome]))
        if min(box.width(), box.height()) >= LETTER_ROOM and LETTERS[outcome]:
            painter.setPen(QColor(ink))
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter, LETTERS[outcome])
            painter.setPen(Qt.PenStyle.NoPen)


def _empty_map() -> tuple[Any, Places]:
    """Return a plot that shows a map and cannot be moved."""
    item = pg.PlotItem(enableMenu=False)
    item.hideButtons()
    item.setMouseEnabled(False, False)
    places = Places()
    item.addItem(places)
    return item, places


class AtlasCard(PlotCard):
    """The maps of the method that is looked at, their legend, and the sweep that makes them."""

    def __init__(self, model: AtlasModel, attempt: Any) -> None:
        super().__init__("Where it works, and where it fails")
        self.model, self.method = model, ""
        self.legend = [widgets.label(words, "small") for words in LEGEND.values()]
        self.sweep = widgets.button("Map it", partial(attempt, self._toggle), name="Map where this method works")
        self.bar.insertWidget(1, self.sweep)
        self.words = widgets.label("", "small", name="The place under the mouse", wrap=True)
        foot = widgets.row(*self.legend, None, spacing=style.PAGE_MARGIN)
        layout = self.layout()
        assert isinstance(layout, QVBoxLayout)
        layout.addLayout(foot)
        layout.addWidget(self.words)
        self.items: list[tuple[Any, Places]] = []  # those that are shown
        self._made: list[tuple[Any, Places]] = []  # kept for the next method
        self.view.scene().sigMouseMoved.connect(self._look)

    def _toggle(self) -> None:
        self.model.toggle(self.method)

    def show_method(self, method: str) -> None:
        """Draw the maps of a method."""
        self.method = method
        for item, _ in self.items:
            self.view.removeItem(item)
        self.items = []
        maps = self.model.maps.get(method, [])
        most = LABELS[min(len(maps), len(LABELS)) - 1]
        for column, shown in enumerate(maps):
            self._add(column, shown, most)
        self.view.setVisible(bool(maps))
        for label in self.legend:
            label.setVisible(bool(maps))
        self.words.setText(maps[0].summary if len(maps) == 1 else POINT_AT if maps else WHAT_COMES)
        self.setMinimumHeight(LEAST_HEIGHT if maps else 0)
        self.setMaximumHeight(NO_LIMIT if maps else EMPTY_HEIGHT)
        self.paint_theme(self.theme)

    def refresh(self) -> None:
        """Show the sweep under way."""
        widgets.set_text(self.sweep, "Stop" if self.model.work is not None else "Map it")
        widgets.set_text(self.readout, self.model.status(self.method))

    def _add(self, column: int, shown: MapShown, most: int) -> None:
        while column >= len(self._made):
            self._made.append(_empty_map())
        item, places = self._made[column]
        places.show_map(shown)
        self.view.addItem(item, row=0, col=column)
        item.setRange(xRange=(0, len(shown.x_ticks)), yRange=(0, len(shown.y_ticks)), padding=0)
        for side, ticks, room in (("bottom", shown.x_ticks, most), ("left", shown.y_ticks, LABELS[0])):
            step = -(-len(ticks) // room)
            item.getAxis(side).setTicks([[(i + 0.5, t) for i, t in enumerate(ticks) if i % step == 0]])
        self.items.append((item, places))

    def _look(self, at: QPointF) -> None:
        """Say what is under the mouse."""
        for item, places in self.items:
            box = item.getViewBox()
            if box.sceneBoundingRect().contains(at):
                here = box.mapSceneToView(at)
                self.words.setText(places.shown.words(int(here.x()), int(here.y())))
                self.words.setToolTip(self.words.text())

    def columns(self) -> Columns:
        """Return every place of the maps with its outcome and error."""
        rows = [
            (m.title, m.x_title, m.x_ticks[i], m.y_title, m.y_ticks[k], place.outcome, place.error, m.unit, place.said)
            for m in self.model.maps.get(self.method, [])
            for k, row in enumerate(m.places)
            for i, place in enumerate(row)
        ]
        names = ("map", "x is", "x", "y is", "y", "outcome", "error", "unit of the error", "said")
        return {name: [row[i] for row in rows] for i, name in enumerate(names)} if rows else {}

    def paint_theme(self, theme: Theme) -> None:
        """Take the colours of `theme`."""
        super().paint_theme(theme)
        for outcome, label in zip(OUTCOMES, self.legend, strict=True):
            ground, ink = style.outcome_colours(theme)[outcome]
            label.setStyleSheet(style.swatch(ground, ink))
        for item, places in self.items:
            places.theme = theme
            places.update()
            for side, words in (("bottom", places.shown.x_title), ("left", places.shown.y_title)):
                paint_axis(item, side, theme, words)
            item.setTitle(places.shown.title, color=theme.muted, size=f"{style.FONT_SMALL}px")
