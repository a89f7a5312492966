"""The trade-off's measurement with the live plot painted as the window paints it, in a helper process."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtGui import QColor, QImage, QPainter, QPen, QTransform

from boat_daq.gui import style
from boat_daq.workflows import measured_methods
from protocol.base.arrays import FloatArray


def measure_methods(*, progress: Callable[[float, float], None] | None = None) -> dict[str, Any]:
    """Measure as `workflows.measured_methods.measure_methods`; a curve of the live plot is painted too."""
    from analysis.studies.tradeoff.decimation import HEIGHT_PX, WIDTH_PX

    return measured_methods.measure_methods(painter(WIDTH_PX, HEIGHT_PX), progress=progress)


def painter(width: int, height: int) -> Callable[[FloatArray], None]:
    """Return what paints points [2, n] into an image of `width` x `height` pixels."""
    image = QImage(width, height, QImage.Format.Format_RGB32)
    pen = QPen(QColor(style.LIGHT.sensors[0]))
    pen.setCosmetic(True)

    def paint(points: FloatArray) -> None:
        image.fill(QColor(style.LIGHT.surface))
        low, span = points.min(axis=1), np.ptp(points, axis=1)
        brush = QPainter(image)
        scale = QTransform.fromTranslate(-low[0], -low[1]) * QTransform.fromScale(width / span[0], height / span[1])
        brush.setTransform(scale)
        brush.setPen(pen)
        brush.drawPath(pg.arrayToQPath(points[0], points[1], finiteCheck=False))
        brush.end()

    return paint
