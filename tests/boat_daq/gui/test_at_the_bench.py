"""What a new user stumbled over on the way from the first start to a calibration, each mended and held here."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLineEdit, QMessageBox, QScrollBar

from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import Phase, Progress, ReadingRequest, RunEnding, SessionState
from boat_daq.gui.widgets.file_dialogs import ask_open, ask_save
from boat_daq.viewmodels.common.notices import Severity
from boat_daq.viewmodels.common.services import Panel
from boat_daq.viewmodels.results.analysis_view import FigureRow, FigureText
from protocol.recording import RunEnd
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.results.run_results import run_result
from tests.boat_daq.gui.results.test_runs_page import PATIENCE_MS, SAMPLE

RAMPING = Progress(4, 37, 1, 2, 0, (), "unloading", Phase.RAMPING, 20.0, 1.0, 20.0, 130.0)
ASKED = ReadingRequest(4, 1, "unloading", 20.0, 20.0)


@pytest.fixture
def running(live):
    """A window in a run that stops at its plateaus for readings, between two of them."""
    live.resize(1280, 800)
    live.model.sequence.arm()
    live.model.session.change(state=SessionState.RUNNING, progress=RAMPING)
    live.refresh()
    return live


def test_the_plots_do_not_move_when_a_plateau_asks(running, qtbot):
    """The question's line is there for the whole run: what comes next, then the question; the plots stay as high."""
    bar, plots = running.live.reading, running.live.plots
    qtbot.waitUntil(bar.isVisible, timeout=PATIENCE_MS)
    QApplication.processEvents()
    before = plots.size()
    assert (bar.question.text(), bar.field.isReadOnly()) == ("Next: +20 kPa, unloading, cycle 1", True)
    running.model.session.change(waiting_for_reading=ASKED)
    running.refresh()
    QApplication.processEvents()
    assert (bar.question.text(), bar.field.isReadOnly()) == ("Elongation at +20 kPa, unloading, cycle 1", False)
    assert plots.size() == before


def test_the_keyboard_comes_back_to_the_question(running, qtbot):
    """After a marker's note, and after a correction in the table, digits go to the plateau that waits."""
    live, field = running.live, running.live.reading.field
    running.model.session.marks = (
        StepMark(1, 1, "unloading", 30.0, 10.0, 0),
        StepMark(2, 1, "unloading", 20.0, 10.0, 1),
    )
    running.model.session.change(waiting_for_reading=ASKED)
    live.show_readings()
    running.refresh()
    live.ask_marker()
    QTest.keyClicks(live.note, "tapped")
    QTest.keyClick(live.note, Qt.Key.Key_Return)
    assert field.hasFocus()
    live.table.view.setFocus()
    live.table.model.setData(live.table.model.index(0, 3), "2.5")
    qtbot.waitUntil(field.hasFocus, timeout=PATIENCE_MS)


def test_what_is_typed_too_early_is_no_reading(running, qtbot):
    """Digits and Enter between two plateaus enter nothing; the focus is in the field when the question comes."""
    bar = running.live.reading
    running.model.session.change(waiting_for_reading=ASKED)
    running.refresh()
    bar.field.setFocus()
    running.model.session.change(waiting_for_reading=None)
    running.refresh()
    QTest.keyClicks(bar.field, "1.5")
    QTest.keyClick(bar.field, Qt.Key.Key_Return)
    assert (bar.field.text(), running.model.session.kept) == ("", [])
    assert not bar.skip.isEnabled()


def test_no_question_stands_in_a_run_that_asks_for_none(live):
    """A continuous plan has no plateau to read: its run keeps the room for the plots."""
    live.model.sequence.choose("repeatability")
    live.model.sequence.arm()
    live.model.session.change(state=SessionState.RUNNING, progress=RAMPING)
    live.refresh()
    assert not live.live.reading.isVisible()


def test_escape_closes_the_dialog_in_front_and_vents(live, qtbot):
    """A hand on the keyboard gets out of the connect panel; the key vents all the same, and again without a dialog."""
    live.model.services.show(Panel.CONNECT)
    live.connect_panel.activateWindow()
    qtbot.waitUntil(lambda: QApplication.activeWindow() is live.connect_panel, timeout=PATIENCE_MS)
    live.vent()
    assert not live.connect_panel.isVisible()
    live.activateWindow()
    qtbot.waitUntil(lambda: QApplication.activeWindow() is live, timeout=PATIENCE_MS)
    live.vent()
    assert live.isVisible()
    assert live.model.session.asked.count("vent") == 2


def test_tab_goes_on_from_every_field_of_the_connect_panel(live, qtbot):
    """The profile's field used to keep the key for itself: the virtual board was out of the keyboard's reach."""
    panel = live.connect_panel
    live.model.services.show(Panel.CONNECT)
    panel.activateWindow()
    qtbot.waitUntil(lambda: QApplication.activeWindow() is panel, timeout=PATIENCE_MS)
    seen = set()
    for _ in range(16):
        seen.add(panel.focusWidget())
        QTest.keyClick(panel.focusWidget(), Qt.Key.Key_Tab)
    assert {panel.profile, panel.connect_button, panel.virtual_button, panel.speed} <= seen
    assert panel.profile.toPlainText() == ""


def test_a_broken_run_resumed_or_begins_anew_by_two_buttons(live):
    """After an unplugged board the choice is in two words, the way on the marked one; else there is only Arm."""
    panel, arm = live.live.sequence, live.live.sequence.buttons["arm"]
    live.refresh()
    assert (arm.text(), arm.property("role"), panel.go_on.isVisible()) == ("Arm", "primary", False)
    live.model.session.change(recording=Path("SA1.boat"))
    live.model.run.resumption.first_cycle = 3
    live.refresh()
    assert (arm.text(), arm.property("role")) == ("Begin anew", "")
    assert (panel.go_on.text(), panel.go_on.isVisible()) == ("Go on at cycle 3", True)


def test_an_offer_can_be_dismissed(live):
    """The offer "The run is finished: Calibrate" stays until it is taken, or sent away with the mouse."""
    live.model.notices.say(Severity.INFORMATION, "an offer", action_text="Do it", action=lambda: None)
    live.refresh()
    assert live.strip.close_.isVisible()
    live.strip.close_.click()
    assert live.model.notices.current() is None
    live.model.notices.inform("a remark, which leaves by itself")
    live.refresh()
    assert not live.strip.close_.isVisible()


def test_the_last_run_of_an_earlier_start_is_analysed(live, monkeypatch):
    """After a new start "Analyse the last run" takes the recording that was written last."""
    folder = live.model.services.recordings
    folder.mkdir()
    for i, name in enumerate(("b.boat", "a.boat")):
        path = folder / name
        path.touch()
        os.utime(path, ns=(i, i))
    asked: list[Path] = []
    monkeypatch.setattr(live.model.calibration, "analyse", asked.append)
    live.model.calibration.analyse_current()
    assert asked == [folder / "a.boat"]


def test_titles_of_low_plots_stand_in_the_middle_of_their_axes(live, qtbot):
    """A title that has become short used to stay where the middle of the long one was."""
    plots = live.live.plots
    for height, words in ((620, "1, mV"), (1000, "Signal 1 (mV)")):
        live.resize(1280, height)
        QApplication.processEvents()
        live.draw()
        ruler = plots.first.item.getAxis("left")
        assert words in ruler.label.toPlainText()
        across = ruler.label.mapRectToItem(ruler, ruler.label.boundingRect())
        assert across.center().y() == pytest.approx(ruler.size().height() / 2, abs=2.0)


def test_the_pane_beside_the_plots_is_remembered(make, qtbot):
    """Plan, shadow or readings: the next start shows what stood there."""
    first = make(RecordedSession(connected(), filled_ring(5.0)))
    first.live.pane.setCurrentWidget(first.live.plan)
    first.close()
    again = make(RecordedSession(connected(), filled_ring(5.0)))
    assert again.live.pane.currentWidget() is again.live.plan


@pytest.mark.parametrize("key", [Qt.Key.Key_Space, Qt.Key.Key_Return, Qt.Key.Key_Enter])
def test_a_focused_button_is_pressed_by_space_and_enter(live, qtbot, key):
    """Space is a shortcut of the plots, and took itself from every button; without a button it holds the picture."""
    live.activateWindow()
    qtbot.waitUntil(lambda: QApplication.activeWindow() is live, timeout=PATIENCE_MS)
    live.live.sequence.buttons["arm"].setFocus()
    QTest.keyClick(live.windowHandle(), key)
    assert live.model.session.asked.count("arm") == 1
    assert live.model.live.following
    live.live.sequence.buttons["arm"].clearFocus()
    QTest.keyClick(live.windowHandle(), Qt.Key.Key_Space)
    assert (live.model.live.following, live.model.session.asked.count("arm")) == (False, 1)


def test_a_button_that_goes_takes_no_other_with_it(live, qtbot):
    """Start is pressed and gone: the focus is nowhere, not on Pause, where the next Space would vent."""
    live.activateWindow()
    qtbot.waitUntil(lambda: QApplication.activeWindow() is live, timeout=PATIENCE_MS)
    live.model.session.change(state=SessionState.ARMED)
    live.refresh()
    live.live.sequence.buttons["start"].setFocus()
    live.model.session.change(state=SessionState.RUNNING, progress=RAMPING)
    live.refresh()
    assert live.live.sequence.buttons["pause"].isVisible()
    assert QApplication.focusWidget() is None


def test_a_cleared_fault_does_not_stand_before_the_next_step(live):
    """The strip kept the fault after it was cleared, and hid the offer to calibrate behind it."""
    live.model.session.change(state=SessionState.FAULT)
    live.refresh()
    live.model.notices.say(Severity.FAULT, "the board did not answer")
    live.model.notices.inform("what comes next")
    assert live.model.notices.current().level is Severity.FAULT
    live.model.session.change(state=SessionState.IDLE)
    live.refresh()
    assert live.model.notices.current().cause == "what comes next"


def test_each_run_has_a_recording_of_its_own(live):
    """Armed again, the recording that holds a run is closed first; one that was only begun by hand goes on."""
    session = live.model.session
    session.change(recording=Path("SA1.boat"))
    live.refresh()
    live.model.run.press("arm")
    assert session.asked[-1:] == ["arm"]
    assert "stop_recording" not in session.asked
    session.marks = (StepMark(1, 0, "start", 50.0, 10.0, 0),)
    live.model.run.press("arm")
    assert session.asked[-2:] == ["stop_recording", "arm"]


@pytest.mark.nightly
@pytest.mark.parametrize("width", [853, 1280])
def test_no_table_of_figures_scrolls_sideways(whole, width):
    """At 150 % on 1280 x 800 the figures stood in a column of which only the names were to be seen."""
    cells = (FigureText("256.3", "definition"), FigureText("190.6", "definition"))
    rows = tuple(FigureRow(name, "mV/mm", cells) for name in ("Sensitivity", "Repeatability, worst") * 7)
    shown = dataclasses.replace(run_result(), figures=rows)
    whole.model.calibration.show(shown)
    whole.model.repeatability.show(shown)
    whole.resize(width, 533)
    for name in ("Calibrate", "Repeat"):
        whole.go(name)
        QApplication.processEvents()
        table = whole.pages[name].table
        assert table.isVisible()
        assert table.horizontalScrollBar().maximum() == 0
        assert whole.scrolls[name].horizontalScrollBar().maximum() == 0


@pytest.mark.nightly
@pytest.mark.parametrize("index", range(3))
def test_nothing_beside_the_plots_scrolls_sideways(live, qtbot, index):
    """Fields, units and words of the pane are whole at 150 % on 1280 x 800."""
    live.resize(853, 533)
    live.live.pane.setCurrentIndex(index)
    live.refresh()
    qtbot.waitUntil(lambda: live.scrolls["Live"].horizontalScrollBar().maximum() == 0, timeout=PATIENCE_MS)
    bars = [bar for bar in live.live.pane.findChildren(QScrollBar) if bar.orientation() is Qt.Orientation.Horizontal]
    assert [bar.maximum() for bar in bars if bar.isVisible()] == []


def test_the_list_of_runs_keeps_to_the_window(live, qtbot):
    """Its buttons used to push the page beyond the window at 150 % on 1280 x 800."""
    live.model.services.recordings.mkdir()
    shutil.copy(SAMPLE, live.model.services.recordings)
    live.resize(853, 533)
    live.go("Runs")

    def listed() -> bool:
        live.refresh()
        return live.pages["Runs"].list.rowCount() > 0

    qtbot.waitUntil(listed, timeout=PATIENCE_MS)
    live.pages["Runs"].list.selectRow(0)
    qtbot.waitUntil(lambda: live.scrolls["Runs"].horizontalScrollBar().maximum() == 0, timeout=PATIENCE_MS)
    assert live.pages["Runs"].buttons["report"].isVisible()


def test_a_method_that_is_not_measured_says_what_will_be_there(whole):
    """Its title used to float in the middle of an empty card."""
    chart = whole.pages["Trade-off"].chart
    whole.go("Trade-off")
    QApplication.processEvents()
    assert chart.empty_text.isVisible()
    assert chart.heading.geometry().bottom() < chart.height() / 4


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["Calibrate", "Repeat", "Runs"])
def test_an_empty_page_never_scrolls(empty, qtbot, name):
    """An empty Calibrate page used to ask for the height of the filled one behind it."""
    empty.resize(853, 533)
    empty.go(name)
    room = empty.scrolls[name]
    qtbot.waitUntil(lambda: room.verticalScrollBar().maximum() == 0, timeout=PATIENCE_MS)
    assert room.horizontalScrollBar().maximum() == 0
    assert empty.pages[name].stack.currentIndex() == 0


def test_a_run_that_is_started_elsewhere_is_shown_and_asks_from_everywhere(running):
    """F6 on the Calibrate page used to run unseen, and the plateau waited for a reading that nobody was asked for."""
    running.go("Runs")
    running.model.run.press("start")
    assert running.page == "Live"
    running.model.session.change(waiting_for_reading=ASKED)
    running.refresh()
    live = running.navigation.buttons["Live"]
    assert live.text() == "Live"
    running.go("Runs")
    running.refresh()
    assert live.text() != "Live"
    assert live.accessibleName() == "Live: a reading is asked for"
    running.go("Live")
    running.refresh()
    assert (live.text(), live.accessibleName()) == ("Live", "Live")


@pytest.mark.parametrize("state", [SessionState.FAULT, SessionState.ABORTED])
def test_a_run_that_broke_off_says_why_where_its_button_is(live, state):
    """The strip's message goes once the link is up again: "Fault" stood there without a reason."""
    live.model.session.change(state=state, run_ended=RunEnding(RunEnd.FAULT, "the board was unplugged"), progress=None)
    live.refresh()
    assert live.live.sequence.progress.text() == "the board was unplugged"
    live.model.session.change(state=SessionState.IDLE, run_ended=RunEnding(RunEnd.FINISHED))
    live.refresh()
    assert "plateaus" in live.live.sequence.progress.text()


def test_a_column_is_pasted_whatever_stands_beside_the_plots(live):
    """With the plan in the pane, Ctrl+Shift+V used to open the readings and paste nothing, without a word."""
    live.live.pane.setCurrentWidget(live.live.plan)
    QApplication.clipboard().setText("4.1\n3.4")
    live.live.paste_readings()
    assert "no plateau" in live.model.notices.current().cause
    live.live.pane.setCurrentWidget(live.live.plan)
    live.model.session.marks = tuple(
        StepMark(n, 1, "unloading", 50.0 - 10 * n, 10.0, n * 10**6, status="reached") for n in (1, 2, 3)
    )
    live.live.paste_readings()
    assert [(r.step_id, r.elongation_mm) for r in live.model.session.kept] == [(1, 4.1), (2, 3.4)]


def test_a_recording_under_way_keeps_its_place_in_the_list(live, qtbot):
    """The list went by the time a file was last written: lines changed places under the mouse every few seconds."""
    folder, runs = live.model.services.recordings, live.model.runs
    folder.mkdir()
    for name in ("a", "b"):
        shutil.copy(SAMPLE, folder / f"{name}.boat")
    with closing(sqlite3.connect(folder / "a.boat")) as db, db:
        later = json.dumps("2030-01-01T00:00:00+00:00")
        db.execute("UPDATE session SET value = ? WHERE key = 'started_utc'", (later,))

    def listed(written: str) -> list[str]:
        os.utime(folder / written, ns=(2**62, 2**62))
        os.utime(folder / {"a.boat": "b.boat", "b.boat": "a.boat"}[written], ns=(1, 1))
        runs.scan()
        qtbot.waitUntil(lambda: (runs.poll(), runs._future is None)[1], timeout=PATIENCE_MS)
        return [run.path.name for run in runs.runs]

    assert listed("a.boat") == listed("b.boat") == ["a.boat", "b.boat"]


def test_chosen_runs_stay_chosen_when_the_list_is_read_again(live, qtbot):
    """Two runs chosen to be compared; a recording under way renews the list every few seconds, and left one of them."""
    live.model.services.recordings.mkdir()
    for name in "abc":
        shutil.copy(SAMPLE, live.model.services.recordings / f"{name}.boat")
    live.go("Runs")
    page, runs = live.pages["Runs"], live.model.runs
    qtbot.waitUntil(lambda: (live.refresh(), page.list.rowCount())[1] == 3, timeout=PATIENCE_MS)
    page._choose([0, 1])
    chosen = [run.path.name for run in page.selected()]
    assert chosen == ["c.boat", "b.boat"]
    runs.runs = [runs.runs[2], runs.runs[0], runs.runs[1]]  # as if another order had come
    runs.revision += 1
    page.refresh(live.model.snapshot)
    assert sorted(run.path.name for run in page.selected()) == sorted(chosen)
    assert page.buttons["compare"].isEnabled()


def test_no_box_of_a_file_dialog_stands_between_hand_and_vent(live, qtbot, tmp_path):
    """A missing file and one that is there already were told by modal boxes: VENT could not be clicked behind them."""
    there, opened, saved = tmp_path / "there.csv", [], []
    there.write_text("kept")
    dialog = ask_open(live, live.model.services, "Open", "csv", opened.append)
    for path, title in ((tmp_path / "missing.csv", "no missing.csv"), (there, "")):
        dialog.findChild(QLineEdit).setText(str(path))
        dialog.accept()
        assert QApplication.activeModalWidget() is None
        assert title in dialog.windowTitle()
    assert opened == [there]
    dialog = ask_save(live, live.model.services, "plot", "csv", saved.append)
    dialog.findChild(QLineEdit).setText(str(there))
    dialog.accept()
    assert QApplication.activeModalWidget() is None
    assert (saved, "there already" in dialog.windowTitle()) == ([], True)
    dialog.accept()
    assert saved == [there]


def test_escape_vents_over_a_modal_box(live, qtbot):
    """No box of ours is modal; over one of Qt's own the key still vents."""
    box = QMessageBox(live)
    box.open()
    qtbot.waitUntil(lambda: QApplication.activeModalWidget() is box, timeout=PATIENCE_MS)
    live.window_keys.watch(box.windowHandle())
    QTest.keyClick(box.windowHandle(), Qt.Key.Key_Escape)
    assert "vent" in live.model.session.asked


def test_nothing_of_an_earlier_run_is_left_on_the_calibration_page(live):
    """A run without readings, opened after one with, was shown with the curves of the other."""
    live.go("Calibrate")
    page, model = live.pages["Calibrate"], live.model.calibration
    model.show(run_result())
    live.refresh()
    card = page.curves[0]
    assert card.loading.x.size and page.curves[0].columns()
    whole, none = run_result(), np.zeros(0)
    bare = dataclasses.replace(whole.sensors[0], x=none, y=none, content=None, void="none was read")
    model.show(dataclasses.replace(whole, sensors=(bare, bare)))
    live.refresh()
    assert not any(layer.x.size for shown in page.curves for plot in shown.plots for layer in plot.layers)
    assert page.missing.isVisible()
    assert not card.isVisible()
    model.show(run_result())
    live.refresh()
    model.result = None
    model.revision += 1
    live.refresh()
    assert not any(layer.x.size for layer in (*card.top.layers, *page.loops.plots[0].layers))
    assert page.table.rowCount() == 0
    assert live.grab().width() == live.width()  # it paints


@pytest.mark.parametrize(
    ("end", "words"), [(RunEnd.FINISHED, "the run is finished"), (RunEnd.STOPPED, "the run was stopped")]
)
def test_the_next_step_is_offered_in_the_run_s_own_words(running, end, words):
    """A run that was stopped with some plateaus read was called finished."""
    running.model.readings.put(4, 1.5, "typed")
    running.model.session.change(state=SessionState.IDLE, progress=None, run_ended=RunEnding(end))
    running.refresh()
    assert running.model.notices.current().cause == f"{words}, 1 plateau read"
