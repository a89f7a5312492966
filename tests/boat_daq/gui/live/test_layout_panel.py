"""The panel for the layout of the live plots, and what the plots then show."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QPushButton

from boat_daq.viewmodels.live.layout import ELONGATION, PRESSURE
from boat_daq.workflows.live_conversion import LiveElongation
from tests.boat_daq.gui.windows import run_command, run_shortcut, shared_window

S1, S2 = "s1_mv", "s2_mv"


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    with shared_window(tmp_path_factory.mktemp("layout")) as window:
        yield window


@pytest.fixture
def live(shared):
    """A window with the usual layout and the panel open."""
    shared.live.layouts.use(type(shared.live.layouts.current)())
    shared.model.live.inverse = lambda mv: LiveElongation(
        (mv[:, 0] - 1638) / 40, np.full(len(mv), 0.1), np.zeros(len(mv), bool)
    )
    run_command(shared, "Layout of the plots …")
    show(shared)
    return shared


def show(window) -> None:
    """Show the state and draw a frame."""
    window.refresh()
    window.draw()


def choose(window, box, data) -> None:
    """Choose an entry as the operator does."""
    box.setCurrentIndex(box.findData(data))
    box.activated.emit(box.currentIndex())
    show(window)


def test_quantity_is_hidden_and_shown_again(live):
    """A hidden one has no plot, and keeps its row in the panel."""
    panel, plots = live.live.layout_panel, live.live.plots
    assert [plot.title for plot in plots.rows] == ["Sensor 1", "Sensor 2", "Elongation", "Pressure"]
    choose(live, panel.places[S2], "hidden")
    assert [plot.title for plot in plots.rows] == ["Sensor 1", "Elongation", "Pressure"]
    choose(live, panel.places[S2], "")
    assert [plot.title for plot in plots.rows] == ["Sensor 1", "Elongation", "Pressure", "Sensor 2"]
    run_shortcut(live, "Ctrl+Z")
    show(live)
    assert [plot.title for plot in plots.rows] == ["Sensor 1", "Elongation", "Pressure"]


def test_overlaid_pressure_is_at_the_height_of_its_own_axis(live):
    """On the plot of sensor 1 pressure has the right axis; a value is where that axis shows it."""
    panel, plots = live.live.layout_panel, live.live.plots
    choose(live, panel.places[PRESSURE], S1)
    plot = plots.rows[0]
    assert (plot.right._title, plots._shown[0].right, plot.right.isVisible()) == ("Pressure", (PRESSURE,), True)
    low, high = plot.right.range
    left_low, left_high = plot.item.getViewBox().viewRange()[1]
    item, middle = plots.curves[PRESSURE].item, (low + high) / 2
    assert item.mapToParent(0.0, low).y() == pytest.approx(left_low)
    assert item.mapToParent(0.0, middle).y() == pytest.approx((left_low + left_high) / 2)
    assert plots.rows[1].right.width() == plot.right.width()  # so that the same time is at the same place
    assert not plots.rows[1].right._title
    choose(live, panel.sides[PRESSURE], False)  # another unit stays on an axis of its own
    assert plots._shown[0].right == (PRESSURE,)
    choose(live, panel.places[PRESSURE], "")
    assert plots.curves[PRESSURE].item.mapToParent(0.0, low).y() == pytest.approx(low)


def test_second_signal_on_an_axis_of_its_own(live):
    """Both signals in one plot, the second one at the right."""
    panel, plots = live.live.layout_panel, live.live.plots
    choose(live, panel.places[S2], S1)
    assert plots._shown[0].left == (S1, S2)
    choose(live, panel.sides[S2], True)
    assert (plots._shown[0].left, plots._shown[0].right) == ((S1,), (S2,))
    assert plots.rows[0].right._title == "Sensor 2"


def test_plot_is_moved_with_its_cursors_and_markers(live):
    """Letters of cursors and notes of markers are in the plot at the top, whichever that is."""
    panel, plots = live.live.layout_panel, live.live.plots
    plots.place_cursor("a")
    live.model.live.markers.append((280.0, "tapped"))
    for _ in range(3):
        up = next(b for b in panel.findChildren(QPushButton) if b.accessibleName() == "Move Pressure up")
        QTest.mouseClick(up, Qt.MouseButton.LeftButton)
        show(live)
    assert plots.rows[0] is plots.pressure
    assert plots._markers[0][0] is plots.pressure
    assert [line.label.format for plot, line in plots._cursors["a"] if plot is plots.pressure] == ["A"]
    plots.place_cursor("a")


def test_pan_in_any_plot_stops_following(live):
    """The picture used to jump back unless the plot of sensor 1 was moved."""
    box = live.live.plots.pressure.item.getViewBox()
    box.setXRange(100.0, 110.0, padding=0)
    box.sigRangeChangedManually.emit([True, True])
    assert live.model.live.span_s() == pytest.approx((100.0, 110.0))
    live.model.live.set_window(60.0)


def test_signals_are_drawn_against_pressure_and_elongation(live):
    """A plot for each signal and quantity beside those over time; each point is one of the recording."""
    panel, curves = live.live.layout_panel, live.live.curves
    panel.against[PRESSURE].click()
    show(live)
    assert curves.isVisible()
    assert [(plot.title, plot.x_title) for plot, _ in curves.sets.values()] == [
        ("Sensor 1", "Pressure"),
        ("Sensor 2", "Pressure"),
    ]
    _, drawn = next(iter(curves.sets.values()))
    x, y = drawn[S1].x, drawn[S1].y
    assert 500 < x.size <= 2000
    columns = live.model.live.ring().view(live.model.live.span_s()[0])
    order = np.argsort(columns["pressure_kpa"])
    expected = np.interp(x, columns["pressure_kpa"][order], columns[S1][order])
    assert np.abs(y - expected).max() < 0.1 * np.ptp(columns[S1])
    panel.against[ELONGATION].click()
    panel.against[PRESSURE].click()
    show(live)
    assert [plot.x_title for plot in curves.plots if plot.item in curves.view.ci.items] == ["Elongation"] * 2
    live.model.live.inverse = None
    show(live)
    assert "calibration" in curves.empty_text.text()


def test_every_plot_hidden_says_so(live):
    """Nothing fails without a plot: frame, mouse, cursors."""
    panel, plots = live.live.layout_panel, live.live.plots
    for quantity in (S1, S2, ELONGATION, PRESSURE):
        choose(live, panel.places[quantity], "hidden")
    assert plots.rows == []
    assert "hidden" in plots.empty_text.text()
    plots.place_cursor("b")
    plots.place_cursor("b")
    assert live.live.guard._covers == {}
