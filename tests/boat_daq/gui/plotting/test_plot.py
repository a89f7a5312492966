"""One plot: what is painted is what was given."""

from __future__ import annotations

import gc

import numpy as np
import pyqtgraph as pg
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor

from boat_daq.gui import style
from boat_daq.gui.plotting.plot import PathItem, Plot, make_item, sensor_colour
from boat_daq.gui.plotting.plot_card import PlotCard


@pytest.fixture
def view(qtbot):
    view = pg.GraphicsLayoutWidget()
    qtbot.addWidget(view)
    view.resize(400, 300)
    view.show()
    qtbot.waitExposed(view)
    return view


def test_surface_fills_between_its_lines_only(view):
    """Truth: a point between the lines, one above, one below, looked up in the picture."""
    item = view.addPlot()
    item.setXRange(0, 10, padding=0)
    item.setYRange(-4, 4, padding=0)
    surface = PathItem()
    item.addItem(surface)
    surface.set_fill_colour(QColor(255, 0, 0))
    for count in (901, 101):  # in several parts, then in fewer: none is left of those before
        x = np.linspace(0.0, 10.0, count)
        shift = 2.0 if count > 101 else 0.0
        surface.fill_between(x, np.sin(x) - 1.0 + shift, np.sin(x) + 1.0 + shift)
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


def test_band_makes_no_garbage_per_point(view):
    """A frame used to make an object a point, and garbage collection took 130 ms every few frames."""
    plot = Plot(make_item(), "Elongation", "mm")
    view.addItem(plot.item)
    band = plot.band("Band", sensor_colour(1))
    x = np.arange(4000.0)
    before = gc.get_stats()[0]["collections"]
    for shift in range(20):
        band.fill(x, x + shift, x + shift + 1.0)
        view.viewport().repaint()
    assert gc.get_stats()[0]["collections"] - before < 20


def test_line_is_broken_at_missing_values(view):
    """Truth: the two halves are seen, the stretch between them is not, though it begins and ends on the line."""
    item = view.addPlot()
    item.setXRange(0, 10, padding=0)
    item.setYRange(-1, 1, padding=0)
    line = PathItem()
    item.addItem(line)
    line.set_line_colour("#ff0000", Qt.PenStyle.SolidLine, thin=True)
    x = np.linspace(0.0, 10.0, 101)
    line.draw_line(x, np.where((x > 4.0) & (x < 6.0), np.nan, 0.0), gaps=True)
    view.viewport().repaint()
    picture = view.grab().toImage()

    def red(at: float) -> bool:
        where = item.getViewBox().mapViewToScene(pg.Point(at, 0.0)).toPoint()
        return any(picture.pixelColor(where.x(), where.y() + dy) == QColor(255, 0, 0) for dy in (-1, 0, 1))

    assert [red(at) for at in (2.0, 3.9, 5.0, 6.1, 8.0)] == [True, True, False, True, True]


def test_ticks_are_the_multiples_of_one_step_with_both_ends():
    """0.3 / 0.1 is a hair less than 3: the tick at the end was lost."""
    ruler = make_item().getAxis("left")
    ((step, values),) = ruler.tickValues(0.0, 0.3, 500.0)
    assert step == pytest.approx(0.05)
    assert values == pytest.approx([0.0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3])
    ((_, inside),) = ruler.tickValues(0.001, 0.299, 500.0)
    assert inside == pytest.approx([0.05, 0.1, 0.15, 0.2, 0.25])


def test_grid_lines_are_at_the_ticks(view):
    """Truth: in an empty plot, pixels differ from the ground on the ticks' columns and rows, and not between them."""
    item = make_item()
    view.addItem(item)
    plot = Plot(item, "Signal", "mV", x_title="Time", x_unit="s")
    plot.paint(style.LIGHT)
    plot.x_range(-1070.0, -1000.0)
    plot.y_range(0.0, 7.0)
    plot.x_range(0.0, 70.0)  # scrolled to: the lines that were laid far off end before
    view.setBackground(style.LIGHT.surface)
    view.viewport().repaint()
    picture, box = view.grab().toImage(), item.getViewBox()

    def ground(x: float, y: float) -> bool:
        where = box.mapViewToScene(pg.Point(x, y)).toPoint()
        near = ((dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1))
        return all(picture.pixelColor(where.x() + dx, where.y() + dy) == QColor(style.LIGHT.surface) for dx, dy in near)

    assert not any(ground(x, 2.5) for x in (10.0, 20.0, 60.0))
    assert not any(ground(25.0, y) for y in (1.0, 3.0, 6.0))
    assert all(ground(x, 2.5) for x in (15.0, 25.0, 65.0))


def test_linked_plots_show_the_same_range(qtbot):
    """A frame sets all ranges itself; a wheel on one plot still moves the others."""
    card = PlotCard("time")
    for name in "abc":
        card.add(name, "mV")
    qtbot.addWidget(card)
    card.resize(600, 600)
    card.link_x()
    card.show()
    qtbot.waitExposed(card)
    for plot in card.plots:
        plot.scroll(10.0, 20.0)
    boxes = [plot.item.getViewBox() for plot in card.plots]
    assert [box.viewRange()[0] for box in boxes] == [[10.0, 20.0]] * 3
    boxes[0].setXRange(5.0, 8.0, padding=0)
    assert [box.viewRange()[0] for box in boxes] == [pytest.approx([5.0, 8.0])] * 3
