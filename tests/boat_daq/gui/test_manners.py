"""Manners, held over all there is: every command, every plot, every control, the keyboard alone, the errors."""

from __future__ import annotations

import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QEvent, QPoint, QPointF, Qt
from PySide6.QtGui import QAction, QGuiApplication, QImage, QMouseEvent, QPainter, QPixmap
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractItemView,
    QAbstractSlider,
    QApplication,
    QFileDialog,
    QLabel,
    QPlainTextEdit,
    QProgressBar,
    QSpinBox,
    QWidget,
)

from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import ReadingRequest, SessionState
from boat_daq.gui import style
from boat_daq.gui.palette import shown
from boat_daq.viewmodels.common.jobs import Job
from boat_daq.viewmodels.common.notices import Severity
from boat_daq.viewmodels.common.services import Page, Panel
from boat_daq.viewmodels.live.live_model import HEADINGS_SHORT, LiveElongation, Marker
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring


def test_every_action_is_in_a_menu_the_palette_and_the_sheet(whole):
    """Walk all actions of the menu bar: each is a command with a key, and the sheet names it with its key."""
    actions = [
        action for menu in whole.menuBar().actions() for action in menu.menu().actions() if not action.isSeparator()
    ]
    commands = whole.commands.commands
    assert [a.text() for a in actions] == [c.text for m in menus(whole) for c in commands if c.menu == m]
    assert [a.text() for a in actions if a.shortcut().isEmpty()] == []
    assert {a for a in whole.findChildren(QAction) if a.shortcut().toString() and a not in actions} == set()
    whole.show_keys()
    said = {label.text() for label in whole.keys.findChildren(QLabel)}
    assert {c.text for c in commands} | {shown(c) for c in commands} <= said


def menus(window):
    return [action.text().removeprefix("&") for action in window.menuBar().actions()]


def test_every_button_of_the_calibration_and_the_runs_is_a_command(whole):
    """What a button of these pages does, a key does: as many commands as deeds."""
    texts = {c.text for c in whole.commands.commands if c.menu == "Runs"}
    assert len(texts) == 5 + len(whole.pages["Runs"].buttons) + 1  # exports are two kinds behind one button


@pytest.mark.parametrize("keys", ["Esc", "Ctrl+2"])
def test_a_key_closes_the_palette_and_does_its_deed(live, keys):
    """Esc vented, and left the palette standing; so did the key of a page."""
    live.show_palette()
    assert live.palette_.isVisible()
    run_shortcut(live, keys)
    assert not live.palette_.isVisible()
    assert (live.page, live.model.session.asked) == (("Live", ["vent"]) if keys == "Esc" else ("Calibrate", []))


def test_commands_say_when_they_cannot(live):
    """A command that has nothing to do is greyed and does nothing when its key is pressed."""
    live.commands.refresh()
    greyed = {c.text for c, a in live.commands._actions if not a.isEnabled()}
    assert {"Accept the calibration", "Compare the chosen runs", "Go on without a reading", "Undo"} <= greyed
    assert {"Vent now", "Connect …", "Calibrate with the last run"} & greyed == set()
    live.commands.wake()


def test_everything_that_shows_or_takes_has_a_name(whole):
    """Tables, sliders, bars and text fields too: a screen reader can name each."""
    kinds = (QAbstractItemView, QAbstractSlider, QPlainTextEdit, QProgressBar, QSpinBox)
    nameless = [
        f"{type(w).__name__} in {type(w.parent()).__name__}"
        for w in whole.findChildren(QWidget)
        if isinstance(w, kinds)
        and not w.accessibleName()
        and not w.objectName().startswith("qt_")
        and type(w).__name__ not in ("QScrollBar", "QHeaderView", "QComboBoxListView", "QListView")
    ]
    assert nameless == []


def test_the_keyboard_reaches_every_button_of_the_live_page(live):
    """Tab goes round all that can be pressed or typed into, and VENT is among it."""
    live.refresh()
    live.activateWindow()
    live.live.pane.setCurrentWidget(live.live.plan)
    live.live.hold.setFocus()
    reached: list[QWidget] = []
    for _ in range(200):
        widget = QApplication.focusWidget() or live.focusWidget()
        if widget in reached:
            break
        reached.append(widget)
        live.focusNextChild()
    wanted = [live.header.vent, live.header.link, live.live.window_choice, *live.live.plan.fields.values()]
    wanted += [live.navigation.buttons["Live"], *(b for b in live.live.sequence.buttons.values() if b.isVisible())]
    assert [w.accessibleName() for w in wanted if w not in reached] == []
    assert [w for w in reached if not (w.accessibleName() or getattr(w, "text", str)())] == []
    live.navigation.buttons["Live"].setFocus()
    for name in Page[1:]:  # the pages are one stop of Tab; the arrows go on from there
        QTest.keyClick(QApplication.focusWidget() or live.focusWidget(), Qt.Key.Key_Down)
        assert live.page == name


def test_a_session_by_keys_alone(make):
    """Arm, start, reading, skip, undo, page and pause, each by its key; no mouse."""
    session = RecordedSession(connected(), filled_ring(10.0))
    session.marks = (StepMark(3, 1, "unloading", 30.0, 10.0, 0), StepMark(4, 1, "unloading", 20.0, 10.0, 1))
    window = make(session)
    window.refresh()
    press = lambda keys: run_shortcut(window, keys)  # noqa: E731
    press("F5")
    assert session.asked[-1] == "arm"
    session.change(state=SessionState.ARMED)
    window.refresh()
    press("F6")
    assert session.asked[-2:] == ["start_recording", "start"]
    session.change(state=SessionState.RUNNING, waiting_for_reading=ReadingRequest(3, 1, "unloading", 30.0, 30.0))
    window.refresh()
    QTest.keyClicks(window.live.reading.field, "2.31")
    QTest.keyClick(window.live.reading.field, Qt.Key.Key_Return)
    assert session.kept[-1].elongation_mm == 2.31
    press("Ctrl+Z")
    assert session.kept[-1].elongation_mm is None
    press("Ctrl+Shift+Z")
    assert session.kept[-1].elongation_mm == 2.31
    session.change(waiting_for_reading=ReadingRequest(4, 1, "unloading", 20.0, 20.0))
    window.refresh()
    press("Ctrl+Shift+N")
    assert session.asked[-1] == "skip_reading"
    press("F7")
    assert session.asked[-1] == "pause"
    press("Ctrl+2")
    assert window.page == "Calibrate"
    press("Esc")
    assert session.asked[-1] == "vent"


def run_shortcut(window, keys: str) -> None:
    """Do what the action with these keys does, where it may be done."""
    next(a for c, a in window.commands._actions if c.shortcut == keys).trigger()


def test_an_error_has_cause_remedy_details_and_a_copy(live):
    """What is not ours is shown with its cause; details at a click; all of it goes to the clipboard."""

    def wrong() -> None:
        raise ZeroDivisionError("nothing to divide by")

    live.model.notices.attempt(wrong)
    live.refresh()
    assert "Nothing to divide by" in live.strip.text.text()
    live.strip.more.click()
    assert "ZeroDivisionError" in live.strip.details.toPlainText()
    live.strip.copy.click()
    assert "ZeroDivisionError" in QGuiApplication.clipboard().text()
    run_shortcut(live, "Ctrl+D")
    assert live.strip.text.text() == ""


def test_a_proposal_is_taken_by_a_key(live):
    """What the strip offers is done by Ctrl+J, once."""
    done = []
    live.model.notices.say(Severity.WARNING, "x", "y", action_text="Do", action=lambda: done.append(1))
    live.refresh()
    run_shortcut(live, "Ctrl+J")
    live.refresh()
    run_shortcut(live, "Ctrl+J")
    assert done == [1]


def pause(seconds):
    """Wait."""
    time.sleep(seconds)


def test_work_has_a_bar_and_a_cancel(live):
    """While a helper computes there is a bar; the key for cancel ends it."""
    job = live.model.jobs.start("long", Job("Waiting", pause, 60), lambda job: None)
    live.refresh()
    assert live.strip.bar.isVisible()
    assert live.strip.work.text() == "Waiting"
    run_shortcut(live, "Ctrl+.")
    live.refresh()
    assert job.state.value == "cancelled"
    assert not live.strip.bar.isVisible()


def test_markers_by_keys_are_seen_and_kept(live):
    """M, a note, Enter: the marker stands in the plot with its note, and is in the session."""
    run_shortcut(live, "M")
    QTest.keyClicks(live.live.note, "tapped")
    QTest.keyClick(live.live.note, Qt.Key.Key_Return)
    live.refresh()
    plot, line = live.live.plots._markers[0]
    assert (plot.title, line.label.format, live.model.session.asked[-1]) == ("Signal 1", "tapped", "mark")
    assert line.value() == pytest.approx(299.99)


@pytest.mark.parametrize("height", [500, 1000])
def test_words_of_cursors_and_markers_are_whole(live, height):
    """On low plots and at both edges the letters of A and B and of notes lie inside their plot; braces are letters."""
    live.resize(840, height)
    live.refresh()
    live.draw()
    plots, (low, high) = live.live.plots, live.model.live.span_s()
    plots.place_cursor("a")
    plots.place_cursor("b")
    live.model.live.markers += [
        Marker(high - 0.01, "tube {touched}"),
        Marker(low + 0.5, "a note that goes on and on, much too long"),
    ]
    live.refresh()
    live.draw()
    QApplication.processEvents()
    for plot, line in (*plots._cursors["a"], *plots._cursors["b"], *plots._markers):
        if plot is not plots.first:
            continue
        box = plot.item.getViewBox()
        words = line.label.mapRectToItem(box, line.label.boundingRect())
        room = box.boundingRect().adjusted(-1, -1, 1, 1)
        assert room.contains(words), (line.label.format, words, room)
    assert plots._markers[0][1].label.textItem.toPlainText() == "tube {touched}"
    assert plots._markers[1][1].label.textItem.toPlainText().endswith("\u2026")


def test_a_small_window_has_room_for_the_statistics(live):
    """Between the cursors at 853 x 533: every figure stands beside the plots, whole, and nothing is pushed out."""
    live.resize(853, 533)
    live.model.live.inverse = lambda mv: LiveElongation(
        (mv[:, 0] - 1638) / 40, np.full(len(mv), 0.1), np.zeros(len(mv), bool)
    )
    page = live.live
    before = page.pane.currentWidget()
    for which in "ab":
        page.plots.place_cursor(which)
    live.refresh()
    QApplication.processEvents()
    assert page.between.isVisible()
    assert not page.spans.isVisible()
    assert page.between.sizeHint().width() <= page.between.width()
    assert page.between.sizeHint().height() <= page.between.height()
    assert all(f">{words}<" in page.between.text() for words in (*HEADINGS_SHORT, "1, mV", "2, mV", "mm", "kPa"))
    room = live.scrolls["Live"]
    assert (room.horizontalScrollBar().maximum(), room.verticalScrollBar().maximum()) == (0, 0)
    page.plots.place_cursor("a")
    live.refresh()
    assert page.pane.currentWidget() is before


def test_a_cursor_is_dragged_with_the_mouse(live):
    """A drag moves the cursor in every plot, and the figures with it."""
    live.refresh()
    live.draw()
    run_shortcut(live, "A")
    run_shortcut(live, "B")
    plots = live.live.plots
    plot, _ = plots._cursors["a"][0]
    before = plots.model.cursor_a
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
    assert plots.model.cursor_a == pytest.approx(before + 5.0, abs=0.3)
    assert {entry[1].value() for entry in plots._cursors["a"]} == {plots.model.cursor_a}
    live.refresh()
    assert live.live.spans.isVisible()


def test_a_photograph_is_read_with_clicks(make, tmp_path):
    """A pasted picture, two clicks 10 mm apart, one at rest and one now, on the picture itself."""
    session = RecordedSession(connected(), filled_ring(10.0))
    session.change(waiting_for_reading=ReadingRequest(3, 1, "unloading", 30.0, 30.0))
    window = make(session)
    window.refresh()
    run_shortcut(window, "Ctrl+P")
    panel = window.live.photograph
    picture = QPixmap(400, 200)
    picture.fill()
    QGuiApplication.clipboard().setPixmap(picture)
    panel.paste()
    for x in (40, 240, 300, 346):
        spot = panel.view.mapFromScene(float(x), 100.0)
        QTest.mouseClick(panel.view.viewport(), Qt.MouseButton.LeftButton, pos=spot)
    panel.take.click()
    assert session.kept[-1].source == "photograph"
    assert session.kept[-1].elongation_mm == pytest.approx(2.3, abs=0.06)


def test_every_line_of_the_grid_is_seen_and_the_picture_moves(live):
    """A hundred lines of 2 px in a picture three times as wide as its place: all are there; the right button drags."""
    live.live.open_photograph()
    panel = live.live.photograph
    assert panel.width() >= 0.89 * live.width()
    picture = QImage(1600, 400, QImage.Format.Format_RGB32)
    picture.fill(Qt.GlobalColor.white)
    painter = QPainter(picture)
    for x in range(8, 1600, 16):
        painter.fillRect(x, 0, 2, 400, Qt.GlobalColor.black)
    painter.end()
    panel.resize(700, 400)
    QApplication.processEvents()
    QGuiApplication.clipboard().setPixmap(QPixmap.fromImage(picture))
    panel.paste()
    seen = panel.view.grab().toImage()
    row = np.array([seen.pixelColor(x, seen.height() // 2).lightness() for x in range(4, seen.width() - 4)])
    dark = row < 240
    assert np.count_nonzero(dark[1:] & ~dark[:-1]) == 100
    panel.view.scale(4, 4)
    bar, place = panel.view.horizontalScrollBar(), panel.view.viewport()
    before = bar.value()
    QTest.mousePress(place, Qt.MouseButton.RightButton, pos=QPoint(200, 100))
    move(place, QPoint(150, 100))
    QTest.mouseRelease(place, Qt.MouseButton.RightButton, pos=QPoint(150, 100))
    assert bar.value() == before + 50
    assert panel.state.clicks == ()


def move(widget, at: QPoint) -> None:
    """Move the mouse with the right button held, which QTest cannot."""
    event = QMouseEvent(
        QEvent.Type.MouseMove, QPointF(at), widget.mapToGlobal(QPointF(at)), Qt.MouseButton.NoButton,
        Qt.MouseButton.RightButton, Qt.KeyboardModifier.NoModifier,
    )  # fmt: skip
    QApplication.sendEvent(widget, event)


def test_an_rx8_line_is_pasted(empty, qtbot):
    """A line of Bridge Control Panel goes in where a profile goes, and the port is opened with it."""
    panel = empty.connect_panel
    empty.show_place(Panel.CONNECT)
    line = "RX8 [h=43] @1T @0T @1P @0P @1S1 @0S1 @1S2 @0S2 @0Aux [t=00]"
    QGuiApplication.clipboard().setText(line)
    panel.profile.setFocus()
    panel.profile.paste()
    assert panel.profile.toPlainText() == line
    panel.port.setEditText("/dev/ttyACM9")
    panel.connect_button.click()
    assert "connect" in empty.model.session.asked
    assert empty.model.preferences.get("profile") == line


def test_a_refused_line_stays_in_the_panel_with_its_reason(empty):
    """The panel closed over a line without a pressure, and a fault in the strip did not say how to write one."""
    panel = empty.connect_panel
    for pasted, says in (
        ("RX8 [h=43] @1S1 @0S1 @1S2 @0S2 [t=00]", "@1P @0P"),
        ("/nowhere/profile.toml", "cannot be read"),
        ('kind = "lines"\nname = "x"', "device"),
    ):
        empty.show_place(Panel.CONNECT)
        panel.port.setEditText("/dev/ttyACM9")
        panel.profile.setPlainText(pasted)
        panel.connect_button.click()
        assert panel.isVisible()
        assert says in panel.refused.text()
        assert empty.model.session.asked == []
    empty.show_place(Panel.CONNECT)
    assert not panel.refused.isVisible()
    panel.profile.setPlainText("")
    panel.connect_button.click()
    assert empty.model.session.asked == ["connect"]
    assert empty.model.notices.current() is None  # mended, it is not complained of any more


def test_a_bug_report_is_packed_without_names(live, tmp_path, qtbot):
    """The menu's action asks where, packs in the background, and says so."""
    run_shortcut(live, "Ctrl+Shift+F1")
    dialog = next(d for d in live.findChildren(QFileDialog))
    path = tmp_path / "report.zip"
    dialog.fileSelected.emit(str(path))
    qtbot.waitUntil(lambda: (live.refresh(), live.model.jobs.get("bug report"))[1] is None, timeout=60_000)
    live.refresh()
    assert "versions.json" in zipfile.ZipFile(path).namelist()
    assert live.strip.text.text().startswith("Saved report.zip, without names")


@pytest.mark.parametrize(("size", "theme"), [((960, 540), style.LIGHT), ((853, 533), style.DARK)])
def test_a_much_enlarged_screen_keeps_what_matters_in_sight(make, size, theme):
    """At 200 % on 1920 x 1080, or 150 % on 1280 x 800: VENT, the question, its field and the pressure's target."""
    session = RecordedSession(connected(), filled_ring(60.0))
    session.change(state=SessionState.RUNNING, waiting_for_reading=ReadingRequest(3, 1, "unloading", 30.0, 30.0))
    window = make(session)
    window.set_theme(theme)
    window.resize(*size)
    QTest.qWait(50)
    window.refresh()
    window.draw()
    QTest.qWait(50)
    bar = window.live.reading
    for widget in (window.header.vent, bar.question, bar.field, bar.skip, window.live.figures["kpa"]):
        corner = widget.mapTo(window, widget.rect().bottomRight())
        assert widget.isVisible()
        assert window.rect().contains(corner), widget.accessibleName()
        assert widget.visibleRegion().boundingRect().size() == widget.size(), widget.accessibleName()
    assert window.live.figures["kpa"].note.text() == "→ +30.0"
    assert isinstance(window.grab().toImage(), QImage)


def test_borders_stay_where_they_were_put(make):
    """A border moved by hand is there again at the next start."""
    first = make(RecordedSession(connected(), filled_ring(10.0)))
    first.live.sides.moveSplitter(first.live.sides.width() - 360, 1)
    width = first.live.sides.sizes()[1]
    first.close()
    second = make(RecordedSession(connected(), filled_ring(10.0)))
    assert second.live.sides.sizes()[1] == width != style.PANE_WIDTH


def test_the_sample_recordings_readings_are_edited_from_the_runs_page(make, tmp_path, qtbot):
    """Choose the recording, open its readings, type another value, undo it; the file keeps both."""
    import shutil

    from boat_daq.viewmodels.results.closed_run import ClosedRun

    sample = Path(__file__).parents[3] / "recordings" / "simulated_SA1_two_cycles.boat"
    (tmp_path / "recordings").mkdir()
    path = Path(shutil.copy(sample, tmp_path / "recordings" / "older.boat"))
    window = make(RecordedSession(connected(), filled_ring(10.0)))
    window.go("Runs")
    page = window.pages["Runs"]
    qtbot.waitUntil(lambda: (window.refresh(), page.list.rowCount())[1] == 1, timeout=20_000)
    page.list.selectRow(0)
    run_shortcut(window, "Ctrl+Alt+E")
    before = ClosedRun(path).readings()
    model = page.readings.table.model
    model.setData(model.index(2, 3), "1.25")
    assert ClosedRun(path).readings()[-1].elongation_mm == 1.25
    run_shortcut(window, "Ctrl+Z")
    assert ClosedRun(path).readings()[-1].elongation_mm == pytest.approx(float(before[2].elongation_mm))
    assert len(ClosedRun(path).readings()) == len(before) + 2
    page.readings.close()
    window.refresh()
    assert page.readings is None


def test_waiting_for_readings_can_be_undone(live):
    """The check box is a change like any other: undo brings it back, in the model and in the form."""
    live.live.pane.setCurrentWidget(live.live.plan)
    live.refresh()
    box = live.live.plan.ask_readings
    box.click()
    assert live.model.sequence.wait_for_reading is False
    live.model.undo.undo()
    live.refresh()
    assert (live.model.sequence.wait_for_reading, box.isChecked()) == (True, True)
    live.model.undo.redo()
    live.refresh()
    assert (live.model.sequence.wait_for_reading, box.isChecked()) == (False, False)
