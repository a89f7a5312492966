"""One plot: what is painted is what was given."""

from __future__ import annotations

import gc

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtGui import QColor

from boat_daq.gui.plot import Plot, Surface, sensor_ink


@pytest.fixture
def view(qtbot):
    view = pg.GraphicsLayoutWidget()
    qtbot.addWidget(view)
    view.resize(400, 300)
    view.show()
    qtbot.waitExposed(view)
    return view


def test_a_surface_fills_what_lies_between_its_lines_and_nothing_else(view):
    """Truth: a point between the lines, one above, one below, looked up in the picture."""
    item = view.addPlot()
    item.setXRange(0, 10, padding=0)
    item.setYRange(-4, 4, padding=0)
    surface = Surface()
    item.addItem(surface)
    surface.set_brush(QColor(255, 0, 0))
    x = np.linspace(0.0, 10.0, 101)
    surface.set_data(x, np.sin(x) - 1.0, np.sin(x) + 1.0)
    view.viewport().repaint()
    picture = view.grab().toImage()

    def red(at: float, height: float) -> bool:
        where = item.getViewBox().mapViewToScene(pg.Point(at, height)).toPoint()
        return picture.pixelColor(where) == QColor(255, 0, 0)

    for at in (1.5, 4.0, 7.3):
        middle = float(np.sin(at))
        assert red(at, middle)
        assert red(at, middle + 0.8)
        assert not red(at, middle + 1.3)
        assert not red(at, middle - 1.3)


def test_a_band_of_thousands_of_points_leaves_no_work_for_the_collector(view):
    """A frame used to make an object a point, and the collector stood still for 130 ms every few frames."""
    plot = Plot(view.addPlot(), "Elongation", "mm")
    band = plot.band("Band", sensor_ink(1))
    x = np.arange(4000.0)
    before = gc.get_stats()[0]["collections"]
    for shift in range(20):
        band.set(x, x + shift, x + shift + 1.0)
        view.viewport().repaint()
    assert gc.get_stats()[0]["collections"] - before < 20
