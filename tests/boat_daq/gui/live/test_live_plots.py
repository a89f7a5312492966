"""The live plots: frames, cursors, markers."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPoint, QPointF, QRect, Qt
from PySide6.QtGui import QImage, QWheelEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QApplication,
)

from boat_daq.formatting import clock, number
from boat_daq.gui import style
from boat_daq.viewmodels.live import axis
from boat_daq.workflows.live_conversion import LiveElongation
from protocol.recording import sample_dtype
from tests.boat_daq.gui.recorded_session import filled_ring
from tests.boat_daq.gui.windows import run_command, run_shortcut
from tests.conftest import mostly_at_night


def test_titles_are_in_the_gutter_at_any_height(live):
    """Truth: the places on the screen. No title is on data, on another title or on a label of its axis."""
    plots, lines = live.live.plots, set()
    live.model.live.inverse = lambda mv: LiveElongation(
        (mv[:, 0] - 1638) / 40, np.full(len(mv), 0.1), np.zeros(len(mv), bool)
    )
    live.live.marker.show()
    for height in range(520, 1001, 80):  # where a title fits depends on the system's font
        live.resize(1280, height)
        QApplication.processEvents()
        live.refresh()
        live.draw()
        titles = [plot.left.label for plot in plots.rows]
        assert " ".join(titles[0].toPlainText().split()) == "Sensor 1 (mV)"
        places = [title.mapRectToScene(title.boundingRect()) for title in titles]
        assert not any(title.toPlainText().startswith("(") for title in titles)  # nothing but the unit
        assert not any(a.intersects(b) for a, b in pairwise(places))
        for plot, place in zip(plots.rows, places, strict=True):
            data = plot.item.getViewBox().sceneBoundingRect()
            widest = max(plot.left._label(t).size().width() for t in plot.left.tickStrings(*_ticks(plot.left)))
            assert place.right() + widest <= data.left()
        lines |= {title.toPlainText().count("\n") for title in titles}
    assert lines == {0, 1}


def _ticks(ruler):
    """Return values, scale and step of an axis's labels."""
    ((step, values),) = ruler.tickValues(*ruler.range, ruler.size().height())
    return values, 1.0, step


def test_low_window_shows_fewer_plots_and_a_choice(live):
    """Four plots of 20 px show nothing: some are shown, high enough, pressure always; the others are a choice away."""
    plots = live.live.plots
    live.resize(840, 500)
    plots.view.setFixedHeight(style.ROW_LOW * 2 + style.AXIS_HEIGHT)
    QApplication.processEvents()
    plots.arrange()
    live.draw()
    assert plots.first_row.isVisible()
    assert [plot.title for plot in plots.rows] == ["Sensor 1", "Pressure"]
    plots.first_row.setCurrentIndex(2)
    plots.first_row.activated.emit(2)
    assert [plot.title for plot in plots.rows] == ["Sensor 2", "Pressure"]
    plots.view.setFixedHeight(style.ROW_LOW)
    QApplication.processEvents()
    plots.arrange()
    assert [plot.title for plot in plots.rows] == ["Sensor 2", "Pressure"]
    assert plots.rows[-1].item.getAxis("bottom").labelText == "Time (min:s)"


def test_time_axis_shows_hours_from_one_hour_on(live):
    """The labels and the title agree: seconds, min:s, h:min:s."""
    plots, shown = live.live.plots, []
    for low, high in ((0.0, 4.0), (0.0, 60.0), (3000.0, 4000.0)):
        plots.x_range(low, high)
        ruler = plots.pressure.bottom
        shown.append((ruler.labelText, ruler.tickStrings([low], 1.0, axis.time_step(high - low))[0]))
    assert shown == [("Time (s)", "0.0"), ("Time (min:s)", "0:00"), ("Time (h:min:s)", "0:50:00")]


def test_marker_is_added_by_keys_and_shown(live):
    """M, a note, Enter: the marker is in the plot with its note, and is in the session."""
    run_shortcut(live, "Ctrl+M")
    QTest.keyClicks(live.live.note, "tapped")
    QTest.keyClick(live.live.note, Qt.Key.Key_Return)
    live.refresh()
    plot, line = live.live.plots._markers[0]
    assert (plot.title, line.label.format, live.model.session.calls[-1]) == ("Sensor 1", "tapped", "mark")
    assert line.value() == pytest.approx(299.99)
    live.model.session.live.ring = filled_ring(300.0)  # of another connection, on another clock
    live.refresh()
    assert not live.live.plots._markers


@pytest.mark.parametrize("height", mostly_at_night(500, 1000))
def test_labels_of_cursors_and_markers_are_not_cut(live, height):
    """On low plots and at both edges the letters of A and B and of notes lie inside their plot; braces are letters."""
    live.resize(840, height)
    live.live.sides.moveSplitter(300, 1)
    live.refresh()
    live.draw()
    plots, (low, high) = live.live.plots, live.model.live.span_s()
    plots.move_cursor("b", low + 20.0)
    plots.move_cursor("a", low + 20.1)
    live.model.live.markers += [
        (high - 0.01, "tube {touched}"),
        (low + 0.5, "a note that is much too long for its label"),
        (low + 31.0, "of more than half the width " * 2),
        (low - 1.0, "a line at the left of the plot"),
    ]
    live.refresh()
    live.draw()
    QApplication.processEvents()
    for plot, line in (*plots._cursors["a"], *plots._cursors["b"], *plots._markers):
        if plot is not plots.first:
            continue
        box = plot.item.getViewBox()
        words = line.label.mapRectToItem(box, line.label.boundingRect())
        visible_rect = box.boundingRect().adjusted(-1, -1, 1, 1)
        if line.value() < low:
            assert line.label.opacity() == 0.0  # half of its words were seen
            continue
        assert visible_rect.contains(words), (line.label.format, words, visible_rect)
    letters = [line.label for which in "ba" for plot, line in plots._cursors[which] if plot is plots.first]
    before, after = (label.mapRectToScene(label.boundingRect()) for label in letters)
    assert before.right() < after.left()  # they were on each other
    assert plots._markers[0][1].label.textItem.toPlainText() == "tube {touched}"
    assert plots._markers[1][1].label.textItem.toPlainText().endswith("\u2026")


def test_cursor_is_dragged_with_the_mouse(live):
    """A drag moves the cursor in every plot, and the figures with it."""
    live.refresh()
    live.draw()
    run_command(live, "Cursor A")
    run_command(live, "Cursor B")
    plots = live.live.plots
    plot, _ = plots._cursors["a"][0]
    before = plots.model.cursors_s["a"]
    view, box = plots.view, plot.item.getViewBox()

    def at(time_s: float) -> QPoint:
        low, high = box.viewRange()[1]
        return view.mapFromScene(box.mapViewToScene(QPointF(time_s, (low + high) / 2)))

    start, end = at(before), at(before + 5.0)
    QTest.mouseMove(view.viewport(), start)
    QTest.mousePress(view.viewport(), Qt.MouseButton.LeftButton, pos=start)
    for share in (0.3, 0.6, 1.0):
        QTest.mouseMove(view.viewport(), start + (end - start) * share)
        QTest.qWait(20)
    QTest.mouseRelease(view.viewport(), Qt.MouseButton.LeftButton, pos=end)
    assert plots.model.cursors_s["a"] == pytest.approx(before + 5.0, abs=0.3)
    assert {entry[1].value() for entry in plots._cursors["a"]} == {plots.model.cursors_s["a"]}
    live.refresh()
    assert live.live.spans.isVisible()


def test_values_at_the_mouse_are_shown_in_each_plot(live):
    """Over the plots each shows its value beside a line, the lowest one the time too; beside them none does."""
    live.model.live.inverse = lambda mv: LiveElongation(
        (mv[:, 0] - 1638) / 40, np.full(len(mv), 0.1), np.zeros(len(mv), bool)
    )
    live.model.live.markers += [(273.0, "valve opened"), (250.0, "far away")]
    live.refresh()
    live.draw()
    plots = live.live.plots
    box = plots.pressure.item.getViewBox()
    place = plots.view.mapFromScene(box.mapViewToScene(QPointF(272.0, sum(box.viewRange()[1]) / 2)))
    QTest.mouseMove(plots.view.viewport(), place)
    texts = [plots._hairs[plot].label.textItem.toPlainText() for plot in plots.rows]
    at = live.model.live.values_at(plots._hairs[plots.pressure].value())
    assert texts == [
        f"{number(at['s1_mv'], 1)} mV",
        f"{number(at['s2_mv'], 1)} mV",
        f"{number(at['elongation_mm'], 2, sign=True)} \u00b10.10 mm",
        f"{number(at['pressure_kpa'], 1, sign=True)} kPa   {clock(at['time_s'])}",
    ]
    assert at["time_s"] == pytest.approx(272.0, abs=0.2)
    notes = [line.label for _, line in plots._markers]
    assert [note.isVisible() for note in notes] == [False, True]  # "ed" of the first stood beside the value
    QApplication.sendEvent(plots.view.viewport(), QEvent(QEvent.Type.Leave))
    assert not any(hair.isVisible() for hair in plots._hairs.values())
    assert all(note.isVisible() for note in notes)
    QTest.mouseMove(plots.view.viewport(), place + QPoint(1, 0))
    assert plots._hairs[plots.pressure].isVisible()
    menu_of(live, plots.pressure, 272.0)  # after it the mouse is elsewhere: the values stood over the data
    assert not any(hair.isVisible() for hair in plots._hairs.values())


def test_cursors_show_statistics(live):
    """With A and B placed, the page shows mean, sd and slope between them."""
    live.draw()
    live.live.plots.place_cursor("a")
    live.live.plots.place_cursor("b")
    live.refresh()
    assert live.live.spans.isVisible()
    assert "slope per s" in live.live.spans.text()
    live.live.plots.place_cursor("a")
    live.refresh()
    assert not live.live.spans.isVisible()


def menu_of(live, plot, x: float) -> dict:
    """Return the actions of the menu that a right click on a plot opens, at a time."""
    box, plots = plot.item.getViewBox(), live.live.plots
    at = plots.view.mapFromScene(box.mapViewToScene(QPointF(x, sum(box.viewRange()[1]) / 2)))
    plots.view.customContextMenuRequested.emit(at)
    menu = QApplication.activePopupWidget()
    menu.close()
    return {action.text().partition(" (")[0]: action for action in menu.actions() if action.text()}


def test_right_click_places_cursors_hides_and_parts_plots(live):
    """Truth: the time under the mouse, and the plots that are left; each change of the layout can be undone."""
    live.refresh()
    live.draw()
    plots = live.live.plots
    menu_of(live, plots.pressure, 270.0)["Cursor A here"].trigger()
    actions = menu_of(live, plots.pressure, 280.0)
    actions["Cursor B here"].trigger()
    assert plots.model.cursors_s == pytest.approx({"a": 270.0, "b": 280.0}, abs=0.2)
    assert {"Copy picture", "Save CSV \u2026", "Autoscale", "Zoom to a box"} <= set(actions)
    menu_of(live, plots.pressure, 270.0)["Remove cursors"].trigger()
    assert plots.model.cursors_s == {}
    actions["Hide Pressure"].trigger()
    assert [plot.title for plot in plots.rows] == ["Sensor 1", "Sensor 2"]
    menu_of(live, plots.first, 270.0)["Show Pressure"].trigger()
    menu_of(live, plots.rows[1], 270.0)["Draw with sensor 1"].trigger()
    menu_of(live, plots.first, 270.0)["Own axis: Sensor 2"].trigger()
    assert (plots.first.title, plots.first.right._title) == ("Sensor 1", "Sensor 2")
    menu_of(live, plots.first, 270.0)["Own plot: Sensor 2"].trigger()
    assert [plot.title for plot in plots.rows] == ["Sensor 1", "Sensor 2", "Pressure"]


def _drag(view, begin, end):
    QTest.mouseMove(view.viewport(), begin)
    QTest.mousePress(view.viewport(), Qt.MouseButton.LeftButton, pos=begin)
    for share in (0.3, 0.7, 1.0):
        QTest.mouseMove(view.viewport(), begin + (end - begin) * share)
        QTest.qWait(20)
    QTest.mouseRelease(view.viewport(), Qt.MouseButton.LeftButton, pos=end)


def test_box_zooms_time_and_height_until_follow_or_a_double_click(live):
    """Truth: the corners of the box, in seconds and kilopascal; other plots keep their heights.

    Follow kept the height of the box: the newest values lay outside, and the plot was empty.
    """
    live.frame_timer.stop()
    live.refresh()
    live.draw()
    QApplication.processEvents()  # the plots get their heights
    live.draw()
    plots = live.live.plots
    box, heights = plots.pressure.item.getViewBox(), plots.first.item.getViewBox().viewRange()[1]
    corners = [plots.view.mapFromScene(box.mapViewToScene(QPointF(*at))) for at in ((260.0, 30.0), (280.0, -10.0))]
    QTest.mousePress(plots.view.viewport(), Qt.MouseButton.RightButton, pos=corners[0])  # its release goes to the menu
    plots._open_menu(corners[0])
    QApplication.activePopupWidget().close()
    for show_all in (box.autoscale_wanted.emit, live.live.follow.click):
        menu_of(live, plots.pressure, 270.0)["Zoom to a box"].trigger()
        corners = [plots.view.mapFromScene(box.mapViewToScene(QPointF(*at))) for at in ((260.0, 30.0), (280.0, -10.0))]
        _drag(plots.view, *corners)
        live.draw()
        assert live.model.live.span_s() == pytest.approx((260.0, 280.0), abs=0.3)
        assert box.viewRange()[1] == pytest.approx([-10.0, 30.0], abs=2.5)  # of about 1.1 kPa a pixel
        assert plots.first.item.getViewBox().viewRange()[1] == heights
        show_all()
        live.draw()
        assert live.model.live.following
        assert box.viewRange()[1][1] >= 50.0


def test_wheel_on_the_left_axis_zooms_in_height_and_follows_on(live):
    """The plot is scaled about the mouse, and the time goes on."""
    live.frame_timer.stop()
    live.refresh()
    live.draw()
    box = live.live.plots.pressure.item.getViewBox()
    low, high = box.viewRange()[1]
    ruler = live.live.plots.pressure.left
    view = live.live.plots.view
    middle = view.mapFromScene(ruler.sceneBoundingRect().center())
    on_screen = view.viewport().mapToGlobal(QPointF(middle))
    wheel = QWheelEvent(
        QPointF(middle), on_screen, QPoint(), QPoint(0, 120), Qt.MouseButton.NoButton,
        Qt.KeyboardModifier.NoModifier, Qt.ScrollPhase.NoScrollPhase, False,
    )  # fmt: skip
    QApplication.sendEvent(view.viewport(), wheel)
    live.draw()
    zoomed = box.viewRange()[1]
    assert low < zoomed[0] < zoomed[1] < high
    assert live.model.live.following


def test_panning_stops_following(live):
    """A pan with the mouse shows the past: following ends until it is requested again."""
    live.draw()
    box = live.live.plots.first.item.getViewBox()
    box.setXRange(100.0, 110.0, padding=0)
    box.sigRangeChangedManually.emit([True, True])
    assert not live.model.live.following
    assert live.model.live.span_s() == pytest.approx((100.0, 110.0))
    live.refresh()
    assert live.live.window_choice.currentText() == ""  # it was "1 min" beside ten seconds
    live.live.follow.click()
    live.refresh()
    assert live.live.window_choice.currentText() == "1 min"


def test_both_signals_on_one_axis(live):
    """The second signal goes into the first plot, and its own plot away; undo parts them."""
    live.draw()
    plots = live.live.plots
    rows = len(plots.rows)
    menu_of(live, plots.rows[1], 270.0)["Draw with sensor 1"].trigger()
    live.draw()
    assert len(plots.rows) == rows - 1
    assert plots.curves["s2_mv"] in plots.first.layers
    live.model.undo.undo()
    live.refresh()
    assert len(plots.rows) == rows


@pytest.mark.parametrize("window_s", [600.0, 10.0])  # the picture still fills; it moves
def test_appended_frame_equals_the_frame_drawn_whole(live, window_s):
    """On the screen samples added behind the lines' ends show the same pixels as a picture that is drawn whole."""
    ring, plots = live.model.session.live.ring, live.live.plots
    live.frame_timer.stop()
    live.calm_timer.stop()
    live.model.live.set_window(window_s)
    live.model.live.inverse = lambda mv: LiveElongation(mv[:, 0] / 400, np.ones(len(mv)), np.zeros(len(mv), bool))
    plots.show_limits(-30.0, 40.0)
    plots.arrange()

    def shown(*, whole):
        plots._whole_until_s = -math.inf if whole else math.inf  # however long a busy machine takes
        assert plots.draw()
        QApplication.processEvents()
        port = plots.view.viewport()
        picture = live.screen().grabWindow(live.winId()).copy(QRect(port.mapTo(live, QPoint(0, 0)), port.size()))
        image = picture.toImage().convertToFormat(QImage.Format.Format_RGB32)
        return np.frombuffer(image.constBits(), np.uint32).reshape(image.height(), -1).copy()

    shown(whole=True)
    still, drawn = shown(whole=True), plots.curves["s1_mv"].x
    for n in range(1, 31):
        sample = np.zeros(1, sample_dtype(2, "signal"))
        sample["time_us"] = sample["host_ns"] = round((drawn[-1] + 0.01 * n) * 1e6)
        sample["signal_mv"] = 1650.0, 1620.0
        ring.append(sample)
        continued = shown(whole=False)
    assert plots.curves["s1_mv"].x is drawn
    anew = shown(whole=True)
    assert plots.curves["s1_mv"].x is not drawn
    assert np.count_nonzero(continued != anew) < 0.2 * np.count_nonzero(still != anew)


def test_prediction_adds_no_empty_axes_and_names_its_dashed_line(live):
    """The differences are hidden until chosen: their axes were left in the view, blank and without a name."""
    live.refresh()
    live.draw()
    plots = live.live.plots

    def predicted(kpa):
        return np.column_stack([1650 + 2 * kpa] * 2), np.full((kpa.size, 2), 5.0)

    live.model.live.prediction = predicted
    live.refresh()
    plots._whole_until_s = -math.inf
    live.draw()
    assert set(plots.view.ci.items) == {plot.item for plot in plots.rows}
    assert [plot.title for plot in plots.rows] == ["Sensor 1", "Sensor 2", "Pressure"]
    assert plots.readout.text() == "\u2504 predicted, band 95 %"


def test_a_frozen_span_is_not_continued(live):
    """The line from its last sample to the newest one crossed the edge of a picture of the past."""
    plots = live.live.plots
    plots.model.frozen_s = (280.0, 299.5)  # half a second ago
    for _ in range(3):
        plots.draw()
    item = plots.curves["s1_mv"].item
    assert item._end is None or item._end.path().isEmpty()
    assert plots.curves["s1_mv"].x[-1] == pytest.approx(299.5, abs=0.1)
