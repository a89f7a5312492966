"""What a second new user stumbled over: typing, undo, pasting, a refused plan, an early photograph, empty plots."""

from __future__ import annotations

import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from types import SimpleNamespace

import pytest
from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QPixmap
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import ReadingRequest, SessionState
from boat_daq.errors import OperatorError
from boat_daq.gui.palette import ALSO
from boat_daq.gui.style import THUMBNAIL
from boat_daq.viewmodels.results.runs import HEADINGS, read_run
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.results.test_runs_page import PATIENCE_MS, SAMPLE


def test_undo_takes_back_the_reading_while_its_field_has_the_focus(make, qtbot):
    """Ctrl+Z brought the last plateau's number into the next one's field, where Enter would have kept it."""
    session = RecordedSession(connected(), filled_ring(10.0))
    session.marks = tuple(StepMark(n, 1, "unloading", 50.0 - 10 * n, 10.0, n * 10**6) for n in (3, 4))
    session.change(waiting_for_reading=ReadingRequest(3, 1, "unloading", 20.0, 20.0), state=SessionState.RUNNING)
    window = make(session)
    window.refresh()
    field = window.live.reading.field
    field.setFocus()
    handle = window.windowHandle()
    window.window_keys.watch(handle)
    QTest.keyClicks(field, "9.9")
    QTest.keyClick(field, Qt.Key.Key_Return)
    session.change(waiting_for_reading=ReadingRequest(4, 1, "unloading", 10.0, 10.0))
    window.refresh()
    QTest.keyClick(handle, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert field.text() == ""
    assert [(r.step_id, r.elongation_mm) for r in session.kept] == [(3, 9.9), (3, None)]
    QTest.keyClicks(field, "12")
    QTest.keyClick(handle, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert (field.text(), len(session.kept)) == ("", 2)


def test_an_unchosen_paste_overwrites_nothing(make):
    """With no line chosen, two pasted rows went over the first two readings, out of sight."""
    session = RecordedSession(connected(), filled_ring(10.0))
    session.marks = tuple(StepMark(n, 1, "unloading", 50.0 - 10 * n, 10.0, n * 10**6) for n in (1, 2, 3, 4))
    window = make(session)
    window.model.readings.put(1, 4.0, "typed")
    window.live.show_readings()
    window.live.table.view.paste("2\tunloading\t30\t3,0\n2\tunloading\t20\t2,1")
    assert [(r.step_id, r.elongation_mm) for r in session.kept[1:]] == [(2, 3.0), (3, 2.1)]
    window.live.table.view.paste("1\n2")
    assert len(session.kept) == 3
    assert "plateaus follow" in window.model.notices.current().cause
    window.live.table.view.paste("4\n3\n2\n1")
    assert [r.elongation_mm for r in session.kept[3:]] == [4.0, 3.0, 2.0, 1.0]


def test_a_refused_plan_is_marked_and_not_armed(live):
    """A step of 20 kPa was refused in red, and Arm ran the old step of 10 kPa."""
    plan, model = live.live.plan, live.model.sequence
    plan.fields["step_kpa"].setText("20")
    plan.fields["step_kpa"].editingFinished.emit()
    assert plan.refused.text() == "Step must divide the span of 90 kPa evenly."
    live.model.run.press("arm")
    assert live.model.session.asked == []
    assert "Step must divide" in live.model.notices.current().cause
    plan.fields["cycles"].setText("2")
    plan.fields["cycles"].editingFinished.emit()
    plan.refresh(live.model.snapshot)
    assert (model.plan.cycles, plan.fields["step_kpa"].text(), plan.fields["step_kpa"].property("wrong")) == (
        2, "20", "true",
    )  # fmt: skip
    plan.fields["high_kpa"].setText("40")
    plan.fields["high_kpa"].editingFinished.emit()
    assert (model.plan.high_kpa, model.plan.step_kpa, model.refused) == (40.0, 20.0, {})
    live.model.run.press("arm")
    assert "arm" in live.model.session.asked


def test_a_photograph_read_before_its_plateau_waits_can_be_taken_then(make):
    """It said "Enter takes it" where nothing waited, and stayed shut when a plateau did."""
    session = RecordedSession(connected(), filled_ring(10.0))
    window = make(session)
    panel = window.live.photograph
    window.live.open_photograph()
    picture = QPixmap(200, 100)
    picture.fill()
    panel.view.set_picture(picture)
    for x in (20.0, 120.0, 150.0, 173.0):
        panel.view.clicked.emit(x, 50.0)
    assert "No plateau waits" in panel.instruction.text()
    session.change(waiting_for_reading=ReadingRequest(3, 1, "unloading", 20.0, 20.0), state=SessionState.RUNNING)
    window.refresh()
    assert panel.instruction.text().startswith("Enter takes it")
    assert panel.take.isEnabled()
    panel.close()


def test_the_list_of_runs_does_not_scroll_sideways_on_a_narrow_window(live, qtbot):
    """At 853 px (150 % on 1280) the last columns were out of sight."""
    live.model.services.recordings.mkdir()
    shutil.copy(SAMPLE, live.model.services.recordings / "SA1_2026-11-21_223500.boat")
    live.go("Runs")
    live.model.runs.scan()
    qtbot.waitUntil(lambda: (live.refresh(), live.pages["Runs"].list.rowCount())[1] == 1, timeout=PATIENCE_MS)
    for width, thumbnail in ((853, THUMBNAIL[0] // 2), (1280, THUMBNAIL[0])):
        live.resize(width, 500)
        QApplication.processEvents()
        table = live.pages["Runs"].list
        assert table.columnWidth(0) == thumbnail
        assert table.horizontalScrollBar().maximum() == 0
        assert table.columnWidth(len(HEADINGS) - 1) >= THUMBNAIL[0] // 4


def test_plots_of_the_optics_say_what_comes_before_they_have_it(live, monkeypatch):
    """Empty axes from 0 to 1 stood there, like data that are missing."""
    monkeypatch.setattr(live.model.optics, "choose", lambda *_: None)
    live.go("Optics")
    page = live.pages["Optics"]
    page.response.show_result(live.model.optics)
    for card in (page.scene, page.response, page.pareto):
        assert not card.view.isVisible()
        assert "here" in card.empty_text.text()
    page.response.show_empty("")
    assert page.response.view.isVisible()
    assert not page.response.empty_text.isVisible()


def test_a_slip_on_close_does_not_end_a_run(live):
    """Ctrl+Q beside Ctrl+1 stopped a run without a word; asked again at once, it is meant."""
    live.model.session.change(state=SessionState.RUNNING)
    live.refresh()
    live.leave()
    assert live.isVisible()
    assert live.model.notices.current().cause == "a run is under way"
    live.leave()
    assert not live.isVisible()


def test_without_a_run_the_window_closes_at_once(live):
    """Nothing is asked where nothing is lost."""
    live.leave()
    assert not live.isVisible()


def test_what_cannot_be_analysed_says_its_remedy_under_its_cause(live):
    """Both stood in one line, cut with an ellipsis before the remedy, over axes from 0 to 1."""
    live.go("Calibrate")
    model, page = live.model.calibration, live.pages["Calibrate"]
    model.failure = OperatorError("x.boat is not a recording", "Choose another one.")
    model.revision += 1
    page.refresh(live.model.snapshot)
    assert (page.verdict.text(), page.headline.text()) == ("\u25a0 x.boat is not a recording", "Choose another one.")
    assert all(card.empty_text.text() == "Nothing to show." for card in page.curves)


def test_the_palette_knows_ordinary_words(live):
    """ "quit" proposed to edit the plan, and "night", "marker", "begin" nothing at all."""
    palette = live.palette_
    assert set(ALSO) <= {command.text for command in live.commands.commands}
    live.model.session.change(state=SessionState.ARMED)
    live.refresh()
    for typed, meant in (
        ("quit", "Close the window"), ("exit", "Close the window"), ("night", "Dark"), ("start", "Start"),
        ("marker", "Mark this moment \u2026"), ("begin", "Start"), ("screenshot", "Copy the plot"),
        ("statistics", "Cursor A"), ("emergency", "Vent now"), ("compare", "Runs"), ("fit", "Calibrate"),
    ):  # fmt: skip
        palette._match(typed)
        assert palette.list.topLevelItem(0).text(0) == meant, typed


def test_a_remembered_window_fits_a_screen_that_became_smaller(live, monkeypatch):
    """Remembered at 100 %, opened at 150 %: VENT stood beyond the edge of the screen."""
    live.model.preferences.set("geometry", "remembered")
    live.resize(1280, 800)
    monkeypatch.setattr(live, "screen", lambda: SimpleNamespace(availableSize=lambda: QSize(1280, 800)))
    live.fit_screen()
    assert not live.isMaximized()
    monkeypatch.setattr(live, "screen", lambda: SimpleNamespace(availableSize=lambda: QSize(853, 533)))
    live.fit_screen()
    assert live.isMaximized()


@pytest.mark.nightly
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_polite_kill_closes_the_window(tmp_path, number):
    """SIGTERM raised KeyboardInterrupt inside a slot, where Qt lost it: the window went on."""
    home = {"HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path), "QT_QPA_PLATFORM": "offscreen"}
    command = [sys.executable, "-m", "boat_daq", "gui", "--board"]
    window = subprocess.Popen(command, cwd=tmp_path, env={**os.environ, **home})
    time.sleep(12)
    window.send_signal(number)
    assert window.wait(60) == 130


@pytest.mark.parametrize(
    ("status", "reason", "words"),
    [
        ("closed", "finished", "\u25cf complete"),
        ("closed", "stopped", "\u25a0 stopped"),
        ("closed", "aborted: the board is gone", "\u25b2 broken off"),
        ("recovered", "interrupted", "\u25cf recovered"),
    ],
)
def test_the_list_says_what_became_of_a_run(tmp_path, status, reason, words):
    """A run that was stopped, or whose board was unplugged, was listed as complete."""
    shutil.copy(SAMPLE, tmp_path / "a.boat")
    with closing(sqlite3.connect(tmp_path / "a.boat")) as db, db:
        for key, value in (("status", status), ("stop_reason", reason)):
            db.execute("UPDATE session SET value = ? WHERE key = ?", (json.dumps(value), key))
    assert read_run(tmp_path / "a.boat").cells[HEADINGS.index("State")] == words


def test_vent_is_whole_on_a_narrow_window(live):
    """At 853 px a simulated board's head was wider than the window, and VENT was cut."""
    live.resize(853, 500)
    live.refresh()
    QApplication.processEvents()
    header = live.header
    header.layout().activate()
    assert header.width() <= 853
    assert header.rect().contains(header.vent.geometry())
    assert not header.brand.isVisible()
    live.resize(1280, 800)
    QApplication.processEvents()
    assert header.brand.isVisible()
