"""Paints a curve as the live plot does, into memory, so that the trade-off can count what painting costs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtGui import QColor, QImage, QPainter, QPen, QTransform

from boat_daq.gui import style


def painter(width: int, height: int) -> Callable[[NDArray[np.float64]], None]:
    """Return what paints points [2, n] over the whole of a picture of `width` x `height` pixels."""
    image = QImage(width, height, QImage.Format.Format_RGB32)
    pen = QPen(QColor(style.LIGHT.sensors[0]))
    pen.setCosmetic(True)

    def paint(points: NDArray[np.float64]) -> None:
        image.fill(QColor(style.LIGHT.surface))
        low, span = points.min(axis=1), np.ptp(points, axis=1)
        brush = QPainter(image)
        scale = QTransform.fromTranslate(-low[0], -low[1]) * QTransform.fromScale(width / span[0], height / span[1])
        brush.setTransform(scale)
        brush.setPen(pen)
        brush.drawPath(pg.arrayToQPath(points[0], points[1], finiteCheck=False))
        brush.end()

    return paint
