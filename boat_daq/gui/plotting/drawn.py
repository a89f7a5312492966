"""What a plot draws of the data: one path in the plot's units, painted by Qt alone.

No Python runs while it is painted: a curve of pyqtgraph is asked for its bounds and painted through Python, and its
fills are joined point by point, thousands of objects a frame. Its outline under the mouse is its bounding rectangle: a
stroked outline of a thousand points would be made for each move of the mouse.
"""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QBrush, QColor, QPainterPath, QPen
from PySide6.QtWidgets import QGraphicsPathItem

from analysis.arrays import FloatArray

COSMETIC = 0.0  # a pen's width that is one pixel at any zoom, and asks for no room around the path


class Drawn(QGraphicsPathItem):
    """A line or a surface."""

    _end: Drawn | None = None  # what was added to the line since it was drawn

    def draw_line(self, x: FloatArray, y: FloatArray, *, gaps: bool) -> None:
        """Draw `y` over `x` (same length); where `gaps`, what is not finite breaks the line."""
        self.setPath(pg.functions.arrayToQPath(x, y, "finite" if gaps else "all", gaps))
        if self._end is not None:
            self._end.setPath(QPainterPath())

    def go_on(self, x: FloatArray, y: FloatArray, *, gaps: bool) -> None:
        """Add to the line what came behind its end: only there is anything painted anew."""
        if self._end is None:
            self._end = Drawn(self)
            self._end.setPen(self.pen())
        self._end.draw_line(x, y, gaps=gaps)

    def fill_between(self, x: FloatArray, low: FloatArray, high: FloatArray) -> None:
        """Fill between `low` and `high` over `x`, which never falls (same length, finite)."""
        path = pg.functions.arrayToQPath(np.concatenate([x, x[::-1]]), np.concatenate([low, high[::-1]]))
        path.setFillRule(Qt.FillRule.WindingFill)
        self.setPath(path)

    def ink_line(self, colour: str, style: Qt.PenStyle) -> None:
        """Take a colour and a style as a line."""
        for line in (self, self._end):
            if line is not None:
                line.setPen(QPen(QColor(colour), COSMETIC, style))

    def ink_surface(self, colour: QColor) -> None:
        """Take a colour as a surface, without an outline."""
        self.setPen(QPen(Qt.PenStyle.NoPen))
        self.setBrush(QBrush(colour))

    def shape(self) -> QPainterPath:
        """Return the room that the mouse finds it in."""
        room = QPainterPath()
        room.addRect(self.path().controlPointRect())
        return room
