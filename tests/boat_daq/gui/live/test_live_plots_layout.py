"""The layout of the live plots, chosen in their menu, and what the plots then show."""

from __future__ import annotations

import numpy as np
import pytest
from PySide6.QtWidgets import QMenu

from boat_daq.viewmodels.live.axis import framed
from boat_daq.viewmodels.live.layout import ELONGATION, PRESSURE, Layout
from boat_daq.workflows.live_conversion import LiveElongation
from tests.boat_daq.gui.windows import run_command, run_shortcut, shared_window

S1, S2 = "s1_mv", "s2_mv"


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    with shared_window(tmp_path_factory.mktemp("layout")) as window:
        yield window


@pytest.fixture
def live(shared):
    """A window with the usual layout."""
    run_command(shared, "Usual layout of the plots")
    shared.model.live.inverse = lambda mv: LiveElongation(
        (mv[:, 0] - 1638) / 40, np.full(len(mv), 0.1), np.zeros(len(mv), bool)
    )
    show(shared)
    return shared


def show(window) -> None:
    """Show the state and draw a frame."""
    window.refresh()
    window.draw()


def choose(window, row: int, text: str) -> None:
    """Choose an entry in the menu of a plot, counted from the top."""
    plots, menu = window.live.plots, QMenu()
    plots.add_plot_actions(menu, plots.rows[row], 0.0)
    next(action for action in menu.actions() if action.text() == text).trigger()
    show(window)


def test_quantity_is_hidden_and_shown_again(live):
    """A hidden one has no plot, and is offered in the menu of every other one."""
    plots = live.live.plots
    assert [plot.title for plot in plots.rows] == ["Sensor 1", "Sensor 2", "Elongation", "Pressure"]
    choose(live, 1, "Hide Sensor 2")
    assert [plot.title for plot in plots.rows] == ["Sensor 1", "Elongation", "Pressure"]
    choose(live, 2, "Show Sensor 2")
    assert [plot.title for plot in plots.rows] == ["Sensor 1", "Elongation", "Pressure", "Sensor 2"]
    run_shortcut(live, "Ctrl+Z")
    show(live)
    assert [plot.title for plot in plots.rows] == ["Sensor 1", "Elongation", "Pressure"]


def test_overlaid_pressure_is_at_the_height_of_its_own_axis(live):
    """On the plot of sensor 1 pressure has the right axis; a value is where that axis shows it."""
    plots = live.live.plots
    choose(live, 3, "Draw with sensor 1")
    plot = plots.rows[0]
    assert (plot.right._title, plots._shown[0].right, plot.right.isVisible()) == ("Pressure", (PRESSURE,), True)
    low, high = plot.right.range
    left_low, left_high = plot.item.getViewBox().viewRange()[1]
    item, middle = plots.curves[PRESSURE].item, (low + high) / 2
    assert item.mapToParent(0.0, low).y() == pytest.approx(left_low)
    assert item.mapToParent(0.0, middle).y() == pytest.approx((left_low + left_high) / 2)
    assert plots.rows[1].right.width() == plot.right.width()  # so that the same time is at the same place
    assert not plots.rows[1].right._title
    choose(live, 0, "Own plot: Pressure")
    assert plots.curves[PRESSURE].item.mapToParent(0.0, low).y() == pytest.approx(low)


def test_second_signal_on_an_axis_of_its_own(live):
    """Both signals in one plot, the second one at the right."""
    plots = live.live.plots
    choose(live, 1, "Draw with sensor 1")
    assert plots._shown[0].left == (S1, S2)
    choose(live, 0, "Own axis: Sensor 2")
    assert (plots._shown[0].left, plots._shown[0].right) == ((S1,), (S2,))
    assert plots.rows[0].right._title == "Sensor 2"
    for quantity, shown in ((S1, plots.rows[0].left.range), (S2, plots.rows[0].right.range)):
        own = plots.curves[quantity].y  # the second one kept the range of both
        assert list(shown) == pytest.approx(framed(own.min(), own.max()))


def test_cursors_and_markers_are_in_the_plot_at_the_top(live):
    """Letters of cursors and notes of markers, whichever plot that is."""
    plots = live.live.plots
    plots.place_cursor("a")
    live.model.live.markers.append((280.0, "tapped"))
    show(live)
    live.live._change_layout(Layout(((PRESSURE,), (S1,), (S2,), (ELONGATION,))))
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


def test_every_plot_hidden_says_so(live):
    """Nothing fails without a plot: frame, mouse, cursors."""
    plots = live.live.plots
    live.live._change_layout(Layout(hidden=(S1, S2, ELONGATION, PRESSURE)))
    show(live)
    assert plots.rows == []
    assert "hidden" in plots.empty_text.text()
    plots.place_cursor("b")
    plots.place_cursor("b")
    assert live.live.guard._covers == {}
