"""The axis of every plot: ticks at 1-2-5 or clock divisions, a minus that is a minus, the grid behind the data.

pyqtgraph's own axis makes pens, points and boxes anew for each range and plays them from a picture: half of what a
scrolling frame cost. Here lines and labels are drawn straight, and what a label looks like is kept. The lower axis is
drawn in each frame of a picture that scrolls, and draws the whole grid; the left one is its labels alone, kept as
pixels. The grid is opaque: translucent lines cost three times as much.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import QLineF, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QFont, QPainter, QPen, QStaticText

from boat_daq.viewmodels.live import axis

MOST_LABELS = 500  # kept at a time
ROOM = 0.8  # of a label's height that it takes beside others, as pyqtgraph has it
ON_TICK = 1e-9  # of a step


@dataclass(slots=True)
class Look:
    """Pens, font and labels as they are drawn until the theme changes."""

    line: QPen
    tick: QPen
    text: QPen
    font: QFont | None
    labels: dict[str, QStaticText] = field(default_factory=dict)

    def label(self, text: str) -> QStaticText:
        """Return a label, laid out."""
        if text not in self.labels:
            if len(self.labels) >= MOST_LABELS:
                self.labels.clear()
            made = QStaticText(text)
            made.setTextFormat(Qt.TextFormat.PlainText)
            if self.font is not None:
                made.prepare(font=self.font)
            self.labels[text] = made
        return self.labels[text]


class TickAxis(pg.AxisItem):  # type: ignore[misc]
    """A left or lower axis; the lower one shows numbers, whole numbers, or a time."""

    ground = QColor("white")  # what the plot stands on
    _look: Look | None = None
    _around: tuple[object, QRectF] | None = None
    _across: TickAxis | None = None
    _drawn_by: TickAxis | None = None

    def __init__(self, orientation: str, *, time: bool = False, whole: bool = False) -> None:
        super().__init__(orientation)
        self.time, self.whole = time, whole
        self.enableAutoSIPrefix(False)
        self.setStyle(tickLength=-4, autoExpandTextSpace=False, hideOverlappingLabels=True)

    def tickSpacing(self, minVal: float, maxVal: float, size: float) -> list[tuple[float, float]]:
        """Return the one level of ticks."""
        span = maxVal - minVal
        if self.whole:
            return [(max(1.0, axis.tick_step(span)), 0.0)]
        return [(axis.time_step(span) if self.time else axis.tick_step(span, size), 0.0)]

    def tickValues(self, minVal: float, maxVal: float, size: float) -> list[tuple[float, list[float]]]:
        """Return the multiples of the one spacing in the range, its ends included."""
        step = self.tickSpacing(minVal, maxVal, size)[0][0]
        first, last = math.ceil(minVal / step - ON_TICK), math.floor(maxVal / step + ON_TICK)
        return [(step, [n * step for n in range(first, last + 1)])]

    def tickStrings(self, values: list[float], scale: float, spacing: float) -> list[str]:
        """Return the labels of `values`."""
        if self.time:
            return [axis.clock(value, spacing) for value in values]
        return [str(text).replace("-", "\u2212") for text in super().tickStrings(values, scale, spacing)]

    def draw_grid_of(self, other: TickAxis) -> None:
        """Draw the grid of the axis across, too."""
        self._across, other._drawn_by = other, self

    def setRange(self, mn: float, mx: float) -> None:
        """Take a range; the grid follows, whoever draws it."""
        super().setRange(mn, mx)
        if self._drawn_by is not None:
            self._drawn_by.update()

    def boundingRect(self) -> QRectF:
        """Return the room of the axis, and of the grid that it draws; worked out once for each arrangement."""
        view = None if self._drawn_by is not None else self.linkedView()
        arrangement = (self.geometry(), None if view is None else view.geometry())
        if self._around is None or self._around[0] != arrangement:
            room = self._room()
            self._around = (arrangement, room if view is None else room | self._field())
        return QRectF(self._around[1])

    def paint(self, painter: QPainter, option: Any, widget: Any) -> None:
        """Draw line, grid and labels."""
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)
        room = self._room()
        self._draw_line(painter, room)
        step, values, places = self._ticks()
        if self._drawn_by is None:
            field_ = self._field()
            left, bottom = field_.left(), field_.bottom()
            self._draw_grid(
                painter, [QLineF(left + x, field_.top(), left + x, room.top()) for x in places], room.width()
            )
            if self._across is not None:
                heights = self._across._ticks()[2]
                lines = [QLineF(left, bottom - y, field_.right(), bottom - y) for y in heights]
                self._draw_grid(painter, lines, field_.height())
        if self.style["showValues"]:
            self._draw_labels(painter, room, places, self.tickStrings(values, 1.0, step))

    def _room(self) -> QRectF:
        room: QRectF = self.mapRectFromParent(self.geometry())
        return room

    def _field(self) -> QRectF:
        """Return the room of the data."""
        view = self.linkedView()
        room: QRectF = self._room() if view is None else view.mapRectToItem(self, view.rect())
        return room

    def _ticks(self) -> tuple[float, list[float], list[float]]:
        """Return the step, the ticks' values, and how far along the axis each is, in pixels."""
        room, (low, high) = self._room(), self.range
        length = room.height() if self.orientation == "left" else room.width()
        if length <= 0 or high <= low:
            return 1.0, [], []
        ((step, values),) = self.tickValues(low, high, length)
        return step, values, [(value - low) / (high - low) * length for value in values]

    def _draw_line(self, painter: QPainter, room: QRectF) -> None:
        painter.setPen(self._looks().line)
        if self.orientation == "left":
            painter.drawLine(QLineF(room.right() - 1, room.top() - 1, room.right() - 1, room.bottom() + 1))
        else:
            painter.drawLine(QLineF(room.left() - 1, room.top() + 1, room.right() + 1, room.top() + 1))

    def _draw_grid(self, painter: QPainter, lines: list[QLineF], length: float) -> None:
        """Draw lines of the grid; a dense one is faint."""
        share = min(1.0, 0.05 * length / (len(lines) + 1))
        ink, ground = self._looks().tick.color(), self.ground
        pairs = ((ink.red(), ground.red()), (ink.green(), ground.green()), (ink.blue(), ground.blue()))
        mixed = (round(there + (here - there) * share) for here, there in pairs)
        painter.setPen(QPen(QColor(*mixed), 0))
        painter.drawLines(lines)

    def _draw_labels(self, painter: QPainter, room: QRectF, places: list[float], words: list[str]) -> None:
        """Write the labels that have their whole room inside the axis."""
        look, around = self._looks(), self.boundingRect()
        across, along = (float(offset) for offset in self.style["tickTextOffset"])
        if look.font is not None:
            painter.setFont(look.font)
        painter.setPen(look.text)
        for place, text in zip(places, words, strict=True):
            label = look.label(text)
            width, height = label.size().width(), label.size().height()
            if self.orientation == "left":
                x, y = room.right() - across - width, room.bottom() - place - height / 2
                inside = around.top() <= y + (1 - ROOM) / 2 * height and y + (1 + ROOM) / 2 * height <= around.bottom()
            else:
                x, y = room.left() + place - width / 2, room.top() + along
                inside = around.left() <= x and x + width <= around.right()
            if inside:
                painter.drawStaticText(QPointF(x, y), label)

    def _looks(self) -> Look:
        if self._look is None:
            self._look = Look(self.pen(), self.tickPen(), self.textPen(), self.style["tickFont"])
        return self._look

    def setPen(self, *args: Any, **kwargs: Any) -> None:
        """Take a pen for the line along the axis."""
        self._look = None
        super().setPen(*args, **kwargs)

    def setTickPen(self, *args: Any, **kwargs: Any) -> None:
        """Take a pen for the grid."""
        self._look = None
        super().setTickPen(*args, **kwargs)

    def setTextPen(self, *args: Any, **kwargs: Any) -> None:
        """Take a pen for the labels."""
        self._look = None
        super().setTextPen(*args, **kwargs)

    def setStyle(self, **kwargs: Any) -> None:
        """Take what pyqtgraph knows of an axis's style."""
        self._look = None
        super().setStyle(**kwargs)
