"""A line or a filled surface of a plot: one path in the plot's units, painted by Qt alone.

No Python runs while it is painted: pyqtgraph paints a curve through Python and joins its fills point by point,
thousands of objects a frame. The shape under the mouse is the bounding rectangle: a stroked outline of a thousand
points would be made for each move of the mouse.
"""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QBrush, QColor, QPainterPath, QPen
from PySide6.QtWidgets import QGraphicsPathItem

from analysis.arrays import FloatArray

COSMETIC = 0.0  # a pen of this width is one pixel at any zoom and adds nothing to the bounds


class PathItem(QGraphicsPathItem):
    """A line or a surface."""

    _end: PathItem | None = None  # what was added to the line since it was drawn

    def draw_line(self, x: FloatArray, y: FloatArray, *, gaps: bool) -> None:
        """Draw `y` over `x` (same length); with `gaps`, a value that is not finite breaks the line."""
        self.setPath(pg.functions.arrayToQPath(x, y, "finite" if gaps else "all", gaps))
        if self._end is not None:
            self._end.setPath(QPainterPath())

    def extend_line(self, x: FloatArray, y: FloatArray, *, gaps: bool) -> None:
        """Continue the line behind its end; only the new part is repainted."""
        if self._end is None:
            self._end = PathItem(self)
            self._end.setPen(self.pen())
        self._end.draw_line(x, y, gaps=gaps)

    def fill_between(self, x: FloatArray, low: FloatArray, high: FloatArray) -> None:
        """Fill between `low` and `high` over `x`, which never falls (same length, finite)."""
        path = pg.functions.arrayToQPath(np.concatenate([x, x[::-1]]), np.concatenate([low, high[::-1]]))
        path.setFillRule(Qt.FillRule.WindingFill)
        self.setPath(path)

    def set_line_colour(self, colour: str, style: Qt.PenStyle) -> None:
        """Set colour and style of a line."""
        for line in (self, self._end):
            if line is not None:
                line.setPen(QPen(QColor(colour), COSMETIC, style))

    def set_fill_colour(self, colour: QColor) -> None:
        """Set the colour of a surface, without an outline."""
        self.setPen(QPen(Qt.PenStyle.NoPen))
        self.setBrush(QBrush(colour))

    def shape(self) -> QPainterPath:
        """Return the bounding rectangle."""
        bounds = QPainterPath()
        bounds.addRect(self.path().controlPointRect())
        return bounds
