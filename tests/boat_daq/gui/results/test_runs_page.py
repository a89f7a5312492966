"""The buttons of the Runs page, pressed: what they make is on the disk or on the page."""

from __future__ import annotations

import csv
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from PySide6.QtCore import QItemSelectionModel, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QFileDialog

from analysis import load_recording
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.test_manners import run_shortcut

SAMPLE = Path(__file__).parents[4] / "recordings" / "simulated_SA1_two_cycles.boat"
PATIENCE_MS = 120_000


@pytest.fixture
def runs(make, tmp_path, qtbot):
    """The Runs page over two recordings, both listed."""
    folder = tmp_path / "recordings"
    folder.mkdir()
    for name in ("first", "second"):
        shutil.copy(SAMPLE, folder / f"{name}.boat")
    window = make(RecordedSession(connected(), filled_ring(10.0)))
    window.go("Runs")
    page = window.pages["Runs"]
    qtbot.waitUntil(lambda: (window.refresh(), page.list.rowCount())[1] == 2, timeout=PATIENCE_MS)
    return window, page


def choose(page, *rows: int) -> None:
    """Choose these lines."""
    page.list.clearSelection()
    for row in rows:
        flags = QItemSelectionModel.SelectionFlag.Select | QItemSelectionModel.SelectionFlag.Rows
        page.list.selectionModel().select(page.list.model().index(row, 0), flags)


def save_as(window, target: Path) -> None:
    """Answer the dialog that asks for a name."""
    dialog = window.findChildren(QFileDialog)[-1]
    assert not dialog.isModal()
    dialog.fileSelected.emit(str(target))
    dialog.close()


def wait(window, qtbot, name: str) -> None:
    """Wait for a piece of work to end."""
    qtbot.waitUntil(lambda: (window.refresh(), window.model.jobs.get(name))[1] is None, timeout=PATIENCE_MS)
    window.refresh()


def forget_readings(path: Path) -> None:
    """Take the readings out: without a calibration a report is made in a tenth of the time."""
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("DELETE FROM reading")


def test_exports_and_report_are_made(runs, tmp_path, qtbot):
    """Export as CSV, as Parquet, and the report: each asks where, says when it is there, and has its content."""
    window, page = runs
    choose(page, 0)
    csv_action, parquet_action = page.buttons["export"].menu().actions()
    csv_action.trigger()
    save_as(window, tmp_path / "run.csv")
    wait(window, qtbot, "export")
    assert window.strip.text.text() == "Saved run.csv."
    with (tmp_path / "run.csv").open(encoding="utf-8-sig") as file:
        rows = sum(1 for row in csv.reader(file) if row and not row[0].startswith("#"))
    assert rows == load_recording(SAMPLE).n + 1
    parquet_action.trigger()
    save_as(window, tmp_path / "run.parquet")
    wait(window, qtbot, "export")
    assert (tmp_path / "run.parquet").read_bytes()[:4] == b"PAR1"
    forget_readings(window.model.runs.runs[0].path)
    page.buttons["report"].click()
    save_as(window, tmp_path / "run.html")
    wait(window, qtbot, "report")
    assert "SIMULATED" in (tmp_path / "run.html").read_text(encoding="utf-8")


@pytest.mark.nightly
def test_two_runs_are_compared(runs, qtbot):
    """Compare takes two lines, and shows each curve less the first one's."""
    window, page = runs
    choose(page, 0)
    assert not page.buttons["compare"].isEnabled()
    choose(page, 0, 1)
    assert page.buttons["compare"].isEnabled()
    assert not page.buttons["export"].isEnabled()
    page.buttons["compare"].click()
    wait(window, qtbot, "compare")
    assert page.compare_card.isVisible()
    assert page.compare_card.readout.text().count("first") == page.compare_card.readout.text().count("second") == 1
    assert abs(page.differences[0][1].y).max() < 1e-6


def test_replay_plays_in_real_time(runs):
    """Replay asks the session for the recording at the speed that was chosen, and shows the live page."""
    window, page = runs
    choose(page, 1)
    path, asked = page.selected()[0].path, []
    window.model.session.connect = lambda url, **more: asked.append(url)
    page.buttons["replay"].menu().actions()[2].trigger()
    assert asked == [f"replay:{path}@20"]
    assert window.page == "Live"


def test_the_page_s_key_leads_to_the_list_and_the_newest_run_is_chosen(runs):
    """After Ctrl+4 it took five Tabs to the list, where nothing was chosen and every button was grey."""
    window, page = runs
    assert [run.path for run in page.selected()] == [window.model.runs.runs[0].path]
    assert page.buttons["open"].isEnabled()
    window.go("Live")
    run_shortcut(window, "Ctrl+4")
    assert window.focusWidget() is page.list
    QTest.keyClick(page.list, Qt.Key.Key_Down)
    assert [run.path for run in page.selected()] == [window.model.runs.runs[1].path]
    page.list.clearSelection()
    window.model.runs.revision += 1
    window.refresh()
    assert page.selected() == []  # what a hand has put away stays away


def test_a_key_that_can_do_nothing_says_why(runs):
    """Its menu entry was grey without a word, and its key did nothing."""
    window, page = runs
    choose(page, 0)
    for go_to, said in (("Runs", "two to four"), ("Live", "Go to the Runs page")):
        window.go(go_to)
        run_shortcut(window, "Ctrl+Alt+M")
        notice = window.model.notices.current()
        assert "Compare the chosen runs" in notice.cause
        assert said in notice.remedy
        window.commands.refresh()
        entry = next(a for c, a in window.commands._actions if c.shortcut == "Ctrl+Alt+M")
        assert not entry.isEnabled()
        assert said in entry.toolTip()
        window.commands.wake()
