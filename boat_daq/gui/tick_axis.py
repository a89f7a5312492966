"""The axis of every plot: ticks at 1-2-5 or clock divisions, a minus that is a minus, the grid behind the data.

pyqtgraph's own axis makes pens, points and boxes anew for each range and plays them from a picture: half of what a
scrolling frame cost. Here lines and labels are drawn straight, and what a label looks like is kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import QLineF, QPointF, QRectF, Qt
from PySide6.QtGui import QFont, QPainter, QPen, QStaticText

from boat_daq.viewmodels import axis

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

    _look: Look | None = None
    _around: tuple[object, QRectF] | None = None

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

    def boundingRect(self) -> QRectF:
        """Return the room of the axis and of its grid; worked out once for each arrangement."""
        view = self.linkedView()
        arrangement = (self.geometry(), None if view is None else view.geometry(), self.grid)
        if self._around is None or self._around[0] != arrangement:
            self._around = (arrangement, super().boundingRect())
        return QRectF(self._around[1])

    def paint(self, painter: QPainter, option: Any, widget: Any) -> None:
        """Draw line, grid and labels."""
        if self._tickLevels is not None or self.grid is False:
            super().paint(painter, option, widget)
            return
        room = self.mapRectFromParent(self.geometry())
        length = room.height() if self.orientation == "left" else room.width()
        low, high = self.range
        if length <= 0 or high <= low:
            return
        ((step, values),) = self.tickValues(low, high, length)
        places = [(value - low) / (high - low) * length for value in values]
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)
        self._lines(painter, room, places)
        if self.style["showValues"]:
            self._labels(painter, room, places, self.tickStrings(values, 1.0, step))

    def _lines(self, painter: QPainter, room: QRectF, places: list[float]) -> None:
        """Draw the line along the axis and the grid; dense grids are faint."""
        view, look = self.linkedView(), self._looks()
        field_ = room if view is None else view.mapRectToItem(self, view.boundingRect())
        painter.setPen(look.line)
        colour = look.tick.color()
        if self.orientation == "left":
            at, bottom = room.right() - 1, room.bottom()
            painter.drawLine(QLineF(at, room.top() - 1, at, bottom + 1))
            lines = [QLineF(field_.right(), bottom - y, room.right(), bottom - y) for y in places]
            density = 0.05 * room.height() / (len(places) + 1)
        else:
            at, left = room.top() + 1, room.left()
            painter.drawLine(QLineF(left - 1, at, room.right() + 1, at))
            lines = [QLineF(left + x, field_.top(), left + x, room.top()) for x in places]
            density = 0.05 * room.width() / (len(places) + 1)
        colour.setAlpha(int(self.grid * min(1.0, density)))
        tick = QPen(look.tick)
        tick.setColor(colour)
        painter.setPen(tick)
        painter.drawLines(lines)

    def _labels(self, painter: QPainter, room: QRectF, places: list[float], words: list[str]) -> None:
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
