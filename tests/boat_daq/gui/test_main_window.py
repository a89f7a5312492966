"""The window's manners: pages, keys, names, undo, themes, nothing modal."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication, QKeySequence, QPixmap
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractSpinBox,
    QComboBox,
    QDialog,
    QFileDialog,
    QLineEdit,
    QWidget,
)

from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import LinkState, Message, MessageKind, ReadingRequest, SessionState
from boat_daq.errors import OperatorError
from boat_daq.gui import style
from boat_daq.viewmodels.common.services import Page, Panel
from protocol.recording import sample_dtype
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring


def test_first_start_shows_the_three_steps(empty):
    """Without a sample the live page says what to do, and the virtual board is one of the ways."""
    empty.refresh()
    assert empty.live.first_steps.isVisible()
    assert empty.live.first_steps.virtual.text() == "Start the virtual board"


def test_data_replace_the_first_steps(live):
    """With samples the plots stand where the steps stood, and hold the newest sample."""
    live.refresh()
    live.draw()
    assert live.live.plots.isVisible()
    assert live.live.plots.s1.x[-1] == pytest.approx(299.99)


def test_every_page_opens(whole):
    """Each page of the navigation can be gone to and refreshed."""
    for name in Page:
        whole.go(name)
        whole.refresh()
        assert whole.page == name
        assert whole.navigation.buttons[name].isChecked()


def test_every_command_has_its_own_keys(live):
    """No command is without a shortcut, and no two share one."""
    keys = [QKeySequence(c.shortcut).toString() for c in live.commands.commands]
    assert all(keys)
    assert [key for key, n in Counter(keys).items() if n > 1] == []


def test_every_control_has_an_accessible_name(whole):
    """A screen reader can name every button, field and choice."""
    nameless = [
        f"{type(widget).__name__} {widget.toolTip()} in {widget.parent()}"
        for widget in whole.findChildren(QWidget)
        if isinstance(widget, QAbstractButton | QLineEdit | QComboBox)
        and not isinstance(widget.parent(), QAbstractSpinBox)
        and not (widget.accessibleName() or (isinstance(widget, QAbstractButton) and widget.text()))
        and not widget.objectName().startswith("qt_")
    ]
    assert nameless == []


def test_no_dialog_is_modal(live):
    """No panel of the window stops the rest of it."""
    live.show_keys()
    live.live.open_photograph()
    live.show_place(Panel.CONNECT)
    assert [dialog for dialog in live.findChildren(QDialog) if dialog.isModal()] == []


def test_vent_acts_on_the_press(live):
    """The red button vents when it is pressed, not when it is let go."""
    QTest.mousePress(live.header.vent, Qt.MouseButton.LeftButton)
    assert live.model.session.asked == ["vent"]


def test_a_warning_stands_with_cause_and_remedy(make):
    """A message of the session comes to the strip and stays until it is dismissed."""
    session = RecordedSession(connected(), filled_ring(10.0))
    window = make(session)
    session.change(
        messages=(Message(1, MessageKind.LINK_LOST, "error", "the port is gone", "Plug the board in again."),)
    )
    window.refresh()
    assert window.strip.text.text() == "The port is gone. Plug the board in again."
    assert window.strip.property("level") == "fault"
    window.strip.close_.click()
    assert window.strip.text.text() == ""


def test_typed_readings_can_be_undone_and_redone(make):
    """Enter keeps a reading and undo brings back what was there, as a newer entry."""
    session = RecordedSession(connected(), filled_ring(10.0))
    session.marks = (StepMark(3, 1, "unloading", 30.0, 10.0, 0),)
    session.change(waiting_for_reading=ReadingRequest(3, 1, "unloading", 30.0, 30.0), state=SessionState.RUNNING)
    window = make(session)
    window.refresh()
    bar = window.live.reading
    assert bar.isVisible()
    QTest.keyClicks(bar.field, "2,31")
    QTest.keyClick(bar.field, Qt.Key.Key_Return)
    assert session.kept[-1].elongation_mm == 2.31
    window.model.undo.undo()
    assert session.kept[-1].elongation_mm is None
    window.model.undo.redo()
    assert session.kept[-1].elongation_mm == 2.31


def test_what_is_no_length_is_refused_where_it_was_typed(make):
    """A wrong reading is not kept, its field is marked, and the strip says what to type."""
    session = RecordedSession(connected(), filled_ring(10.0))
    session.change(waiting_for_reading=ReadingRequest(3, 1, "unloading", 30.0, 30.0))
    window = make(session)
    window.refresh()
    QTest.keyClicks(window.live.reading.field, "2..3")
    window.live.reading.enter()
    window.refresh()
    assert session.kept == []
    assert window.live.reading.field.property("wrong") == "true"
    assert "is not a length" in window.strip.text.text()


def test_a_refused_plan_says_which_field(live):
    """A step that does not divide the span is refused in the form, and the plan stays."""
    live.live.pane.setCurrentWidget(live.live.plan)
    field = live.live.plan.fields["step_kpa"]
    field.setText("7")
    field.editingFinished.emit()
    assert "divide the span" in live.live.plan.refused.text()
    assert live.model.sequence.plan.step_kpa == 10.0


def test_an_edit_of_the_plan_can_be_undone(live):
    """The number of cycles goes back with undo, in the model and in the form."""
    live.live.pane.setCurrentWidget(live.live.plan)
    field = live.live.plan.fields["cycles"]
    field.setText("2")
    field.editingFinished.emit()
    assert live.model.sequence.plan.cycles == 2
    live.model.undo.undo()
    live.refresh()
    assert live.model.sequence.plan.cycles == 5
    assert field.text() == "5"


def test_the_palette_finds_and_does(live):
    """Typing a few letters finds a command, Enter does it."""
    live.show_palette()
    QTest.keyClicks(live.palette_.field, "repeat")
    QTest.keyClick(live.palette_.field, Qt.Key.Key_Return)
    assert live.page == "Repeat"


def test_cursors_give_statistics(live):
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


def test_holding_stops_the_picture_not_the_data(live):
    """A held picture keeps its range while the ring goes on."""
    live.live.toggle_hold()
    before = live.model.live.span_s()
    ring = filled_ring(400.0)
    live.model.session.ring = ring
    assert live.model.live.span_s() == before
    live.live.toggle_hold()
    assert live.model.live.span_s()[1] == pytest.approx(399.99)


def test_the_mouse_moves_the_picture_off_following(live):
    """A pan with the mouse is a look at the past: following ends until it is asked for again."""
    live.draw()
    box = live.live.plots.first.item.getViewBox()
    box.setXRange(100.0, 110.0, padding=0)
    box.sigRangeChangedManually.emit([True, True])
    assert not live.model.live.following
    assert live.model.live.span_s() == pytest.approx((100.0, 110.0))


def test_every_plot_saves(live, tmp_path):
    """The live plots save as picture, vectors and undecimated numbers."""
    live.refresh()
    live.draw()
    for suffix, head in (("png", b"\x89PNG"), ("svg", b"<?xml"), ("csv", b"time_s,pressure_kpa")):
        path = tmp_path / f"plot.{suffix}"
        live.live.plots.save(path)
        assert path.read_bytes().startswith(head)
    times = [float(row.split(",")[0]) for row in (tmp_path / "plot.csv").read_text().splitlines()[1:]]
    assert len(times) == round((times[-1] - times[0]) * 100) + 1  # every sample at 100 Hz
    column_s = 60.0 / live.live.plots.width()  # the picture ends at a whole column of pixels
    assert 60.0 - 2 * column_s <= times[-1] - times[0] <= 60.0


def test_the_window_remembers(make, tmp_path):
    """Page, length of the picture and theme are there again at the next start."""
    first = make(RecordedSession(connected(), filled_ring(10.0)))
    first.go("Runs")
    first.live.set_window(300.0)
    first.choose_theme("dark")
    first.close()
    second = make(RecordedSession(connected(), filled_ring(10.0)))
    assert second.page == "Runs"
    assert second.model.live.window_s == 300.0
    assert second.theme is style.DARK


def test_themes_repaint_without_an_error(whole):
    """Light and dark can be changed at any time, with every page open."""
    for name in Page:
        whole.go(name)
    whole.set_theme(style.DARK)
    assert whole.styleSheet() == style.style_sheet(style.DARK)
    assert whole.live.plots.theme is style.DARK
    whole.set_theme(style.LIGHT)
    assert whole.live.plots.theme is style.LIGHT


@pytest.mark.fault(54, how="the window on the virtual board", times=1)
def test_simulated_is_said(live):
    """A simulated board is named in the head and in the title."""
    live.refresh()
    assert live.header.simulated.isVisible()
    assert "SIMULATED" in live.windowTitle()


def test_buttons_follow_the_state(make):
    """Only what may be pressed is shown: arm while idle, pause and stop while running."""
    session = RecordedSession(connected(), filled_ring(10.0))
    window = make(session)
    shown = lambda: {key for key, b in window.live.sequence.buttons.items() if b.isVisible()}  # noqa: E731
    window.refresh()
    assert shown() == {"arm"}
    session.change(state=SessionState.RUNNING)
    window.refresh()
    assert shown() == {"pause", "stop"}
    session.shown = dataclasses.replace(session.shown, can_command=False)
    window.refresh()
    assert shown() == set()


def test_a_photograph_gives_a_reading(make, tmp_path):
    """Load a picture, four clicks, and the tip's way is kept as a reading from a photograph."""
    session = RecordedSession(connected(), filled_ring(10.0))
    session.change(waiting_for_reading=ReadingRequest(3, 1, "unloading", 30.0, 30.0))
    window = make(session)
    panel = window.live.photograph
    panel.show()
    picture = QPixmap(200, 100)
    picture.fill()
    picture.save(str(tmp_path / "grid.png"))
    panel.load(tmp_path / "grid.png")
    for x in (20.0, 120.0, 150.0, 173.0):
        panel.view.clicked.emit(x, 50.0)
    assert panel.value.text() == "+2.30 mm"
    panel.take.click()
    assert (session.kept[-1].elongation_mm, session.kept[-1].source) == (2.3, "photograph")
    assert session.kept[-1].resolution_mm < 1.0
    with pytest.raises(OperatorError, match="no picture"):
        panel.load(tmp_path / "nothing.png")


def test_the_end_of_a_run_offers_the_next_step(make):
    """A finished run with readings is said, with the way to its calibration; the offer waits."""
    session = RecordedSession(connected(), filled_ring(10.0))
    session.marks = (StepMark(3, 1, "unloading", 30.0, 10.0, 0),)
    session.change(state=SessionState.RUNNING)
    window = make(session)
    window.refresh()
    session.add_reading(3, 2.0, "typed")
    session.change(state=SessionState.IDLE)
    window.refresh()
    assert window.strip.text.text() == "The run is finished, 1 plateau read. Next: fit and look at it."
    window.strip.act.click()
    assert window.page == "Calibrate"
    window.refresh()
    assert "Nothing has been recorded yet" in window.strip.text.text()


def test_a_file_dialog_does_not_stop_the_window(live, tmp_path):
    """Saving asks beside the window, not over it; the folder is remembered; what was saved is said."""
    live.refresh()
    live.draw()
    live.save_plot(live.live.plots, "csv")
    dialog = next(d for d in live.findChildren(QFileDialog))
    assert not dialog.isModal()
    dialog.fileSelected.emit(str(tmp_path / "shown.csv"))
    live.refresh()
    assert (tmp_path / "shown.csv").stat().st_size > 1000
    assert live.model.preferences.get("folder") == str(tmp_path)
    assert live.strip.text.text() == "Saved shown.csv."


def test_the_last_cycles_lie_over_each_other(make):
    """O shows the cycles of the run from their beginnings, and O again the plots."""
    session = RecordedSession(connected(), filled_ring(120.0))
    session.marks = tuple(
        StepMark(i, i, "unloading", 0.0, 10.0, int(36e6 * i), ended_us=int(36e6 * (i + 1))) for i in (1, 2)
    )
    window = make(session)
    window.live.toggle_overlay()
    window.refresh()
    assert window.live.overlay.isVisible()
    assert window.live.overlay.readout.text() == "2 of the last 5 cycles"
    assert window.live.overlay.curves[0][-1].x.size > 100
    window.live.toggle_overlay()
    window.refresh()
    assert window.live.plots.isVisible()


def test_both_signals_on_one_axis(live):
    """T puts the second signal into the first plot and takes its own plot away; T again parts them."""
    live.draw()
    rows = len(live.live.plots.rows)
    live.live.toggle_together()
    live.draw()
    assert len(live.live.plots.rows) == rows - 1
    assert live.live.plots.s2_with.x.size > 100
    live.live.toggle_together()
    assert len(live.live.plots.rows) == rows


def test_a_table_pastes_from_a_spreadsheet(make):
    """Ctrl+V in the table enters the clipboard's column from the selected plateau on."""
    session = RecordedSession(connected(), filled_ring(10.0))
    session.marks = tuple(StepMark(i, 1, "unloading", 50.0 - 10 * i, 10.0, i) for i in range(1, 5))
    window = make(session)
    window.live.show_readings()
    window.refresh()
    window.live.table.view.selectRow(1)
    QGuiApplication.clipboard().setText("3.0\n2.5\n")
    QTest.keyClick(window.live.table.view, Qt.Key.Key_V, Qt.KeyboardModifier.ControlModifier)
    assert [(r.step_id, r.elongation_mm) for r in session.kept] == [(2, 3.0), (3, 2.5)]
    window.refresh()
    assert window.live.table.count.text() == "2 of 4 plateaus read"


def test_a_silence_that_is_over_is_only_a_remark(make):
    """Data that stopped for a moment and come again leave no warning that waits to be dismissed."""
    session = RecordedSession(connected(), filled_ring(10.0))
    window = make(session)
    session.change(messages=(Message(1, MessageKind.SILENT, "warning", "no data for 1 s", "Check the cable."),))
    window.refresh()
    assert window.strip.text.text() == "No data for 1 s."
    assert window.strip.property("level") == "information"


def test_no_figure_is_shown_of_a_board_that_is_away(make):
    """What was measured before the link went is not shown as what is: dashes until data come again."""
    session = RecordedSession(connected(), filled_ring(10.0))
    window = make(session)
    window.refresh()
    assert window.live.figures["kpa"].value.text() != "\u2013"
    session.change(link=LinkState.LOST)
    window.refresh()
    assert {figure.value.text() for figure in window.live.figures.values()} == {"\u2013"}


def test_what_was_said_of_a_lost_link_leaves_when_it_is_back(make):
    """A message said while the link was down does not stand over a link that is well."""
    session = RecordedSession(connected(), filled_ring(10.0))
    window = make(session)
    session.change(
        link=LinkState.SILENT,
        messages=(Message(1, MessageKind.SILENT, "warning", "no data for 1 s", "Check the cable."),),
    )
    window.refresh()
    assert window.strip.text.text() == "No data for 1 s. Check the cable."
    assert "no data" in window.header.link.text()
    session.change(link=LinkState.UP)
    window.refresh()
    assert window.strip.text.text() == ""


def test_a_picture_that_goes_on_is_the_picture_drawn_whole(live):
    """Samples added behind the lines' ends show the same pixels as a picture that is drawn anew with them."""
    ring, plots = live.model.session.ring, live.live.plots
    live.frame_timer.stop()
    live.calm_timer.stop()
    newest_s, shown = float(ring.view(last=1)["time_s"][0]), []
    assert plots.draw()
    whole = plots.last
    shown.append(plots.view.grab().toImage())
    for n in range(1, 4):
        sample = np.zeros(1, sample_dtype(2, "signal"))
        sample["time_us"] = sample["host_ns"] = round((newest_s + 0.003 * n) * 1e6)
        sample["signal_mv"] = 1650.0, 1620.0
        ring.append(sample)
    assert plots.draw()
    assert plots.last is whole
    shown.append(plots.view.grab().toImage())
    plots._whole_until_s = -math.inf
    assert plots.draw()
    assert plots.last is not whole
    shown.append(plots.view.grab().toImage())
    still, gone_on, anew = (np.frombuffer(image.constBits(), np.uint32).reshape(image.height(), -1) for image in shown)
    assert 1 <= len(np.unique(np.nonzero(still != gone_on)[1])) <= 2
    assert len(np.unique(np.nonzero(gone_on != anew)[1])) <= 2
    assert np.count_nonzero(gone_on != anew) < np.count_nonzero(still != anew)
