"""The buttons and the menu of the page Recordings, used: what they make is on the disk or on the page."""

from __future__ import annotations

import csv
import dataclasses
import itertools
import json
import os
import shutil
import sqlite3
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QItemSelectionModel, Qt
from PySide6.QtGui import QColor, QDesktopServices
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QFileDialog

from analysis import load_recording
from boat_daq.gui.results import runs_page
from boat_daq.gui.style import DARK, LIGHT, THUMBNAIL
from boat_daq.gui.widgets.text_dialog import TextDialog
from boat_daq.viewmodels.live.axis import number_labels
from boat_daq.viewmodels.results import runs as runs_model
from boat_daq.viewmodels.results.run_entry import MOST_COMPARED, RUN_HEADINGS, read_run
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import NARROW, PATIENCE_MS, SAMPLE, run_command, run_shortcut
from tests.boat_daq.viewmodels.helpers import DirectJob


@pytest.fixture
def runs(make, tmp_path, qtbot):
    """The page Recordings over two recordings, both listed."""
    folder = tmp_path / "recordings"
    folder.mkdir()
    for name in ("first", "second"):
        shutil.copy(SAMPLE, folder / f"{name}.boat")
    window = make(RecordedSession(connected(), filled_ring(10.0)))
    run_shortcut(window, "Ctrl+3")
    page = window.pages["Recordings"]
    qtbot.waitUntil(lambda: (window.refresh(), page.list.rowCount())[1] == 2, timeout=PATIENCE_MS)
    return window, page


def choose(page, *rows: int) -> None:
    """Choose these lines."""
    page.list.clearSelection()
    for row in rows:
        flags = QItemSelectionModel.SelectionFlag.Select | QItemSelectionModel.SelectionFlag.Rows
        page.list.selectionModel().select(page.list.model().index(row, 0), flags)


def save_as(window, target: Path) -> None:
    """Answer the dialog that requests a name."""
    dialog = window.findChildren(QFileDialog)[-1]
    assert not dialog.isModal()
    dialog.fileSelected.emit(str(target))
    dialog.close()


def wait(window, qtbot, name: str) -> list[int]:
    """Wait for a piece of work to end; return the values that its bar showed, thousandths."""
    shown = []

    def ended() -> bool:
        time.sleep(0.05)  # to refresh without a pause takes a whole core from the work
        window.refresh()
        if window.strip.bar.maximum() and window.strip.bar.value() not in shown[-1:]:
            shown.append(window.strip.bar.value())
        return window.model.jobs.get(name) is None

    qtbot.waitUntil(ended, timeout=PATIENCE_MS)
    window.refresh()
    return shown


def forget_readings(path: Path) -> None:
    """Take the readings out: without a calibration a report is made in a tenth of the time."""
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("DELETE FROM reading")


def test_export_is_made(runs, tmp_path, qtbot):
    """Export as CSV requests a place and has its content."""
    window, page = runs
    choose(page, 0)
    page.list.customContextMenuRequested.emit(page.list.visualItemRect(page.list.item(0, 0)).center())
    menu = QApplication.activePopupWidget()
    menu.close()
    assert QApplication.activePopupWidget() is None  # a second one was under it
    assert {"Rename \u2026", "Copy rows", "Save CSV \u2026"} <= {action.text() for action in menu.actions()}
    csv_action, *_ = page.buttons["export"].menu().actions()
    csv_action.trigger()
    save_as(window, tmp_path / "run.csv")
    wait(window, qtbot, f"export {tmp_path / 'run.csv'}")
    assert window.strip.text.text() == "Saved run.csv."
    with (tmp_path / "run.csv").open(encoding="utf-8-sig") as file:
        rows = sum(1 for row in csv.reader(file) if row and not row[0].startswith("#"))
    assert rows == load_recording(SAMPLE).n + 1


@pytest.mark.nightly
def test_report_is_made(runs, tmp_path, qtbot):
    """It requests a place and has its content; its bar moves."""
    window, page = runs
    choose(page, 0)
    forget_readings(window.model.runs.runs[0].path)
    page.buttons["report"].click()
    save_as(window, tmp_path / "run.html")
    shown = wait(window, qtbot, f"report {tmp_path / 'run.html'}")
    assert len(shown) >= 3  # the parts of the report among them
    assert shown == sorted(shown)
    assert "SIMULATED" in (tmp_path / "run.html").read_text(encoding="utf-8")


@pytest.mark.nightly
def test_two_runs_are_compared(runs, qtbot):
    """Compare takes two lines, and shows each curve less the first one's."""
    window, page = runs
    choose(page, 0)
    assert not page.offers("compare")
    choose(page, 0, 1)
    assert page.offers("compare")
    assert not page.buttons["export"].isEnabled()
    page.press("compare")
    wait(window, qtbot, "compare")
    assert page.compare_card.isVisible()
    assert page.compare_card.readout.text().count("first") == page.compare_card.readout.text().count("second") == 1
    assert abs(page.differences[0][1].y).max() < 1e-6


def test_every_sensor_is_compared(live, monkeypatch, qtbot):
    """One plot a sensor, however many the runs before had; a small page scrolls down to them."""
    live.resize(853, 600)
    live.go("Recordings")
    page, line = live.pages["Recordings"], (np.array([0.0, 1.0]), np.array([0.0, 2.0]))
    qtbot.waitUntil(lambda: (live.refresh(), page.model.listed)[1], timeout=PATIENCE_MS)  # else later
    for sensors in (4, 1, 3):
        monkeypatch.setattr(page.model, "comparison_lines", lambda n=sensors: ([[line, line]] * n, "1: a   2: b"))
        page._show_comparison()
        shown = [plot.title for plot in page.compare_card.plots if plot.item in page.compare_card.view.ci.items]
        assert shown == [f"Sensor {n}" for n in range(1, sensors + 1)]
        assert [row[1].x.size for row in page.differences] == [2] * sensors + [0] * (4 - sensors)
    x = np.linspace(0.0, 1.0, 5)
    crossing = number_labels([(x, 0.0 * x), (x, x - 0.75), (x[:0], x[:0])])
    assert crossing == [(0.0, 0.0, "1"), (0.0, -0.75, "2")]  # at the end where they are farthest apart
    alike = number_labels([(x, x), (x, x)])
    assert alike[0][0] < alike[1][0]
    for theme in (LIGHT, DARK):
        looks = [(QColor(colour(theme)).hslHue(), line) for colour, line in runs_page.RUN_LINES]
        hues, lines = zip(*looks, strict=True)
        assert min(abs(a - b) for a, b in itertools.combinations(hues, 2)) > 20
        assert len(set(lines)) == len(lines) == MOST_COMPARED
    page.stack.setCurrentIndex(1)
    page._show_comparison()
    qtbot.waitUntil(lambda: live.scrolls["Recordings"].verticalScrollBar().value() > 0, timeout=PATIENCE_MS)


def test_page_key_focuses_the_list_with_the_newest_run_chosen(runs):
    """After the key of the page it took five Tabs to the list, where nothing was chosen and every button was grey."""
    window, page = runs
    assert window.focusWidget() is page.list  # it was loading when the key was pressed
    assert [run.path for run in page.selected()] == [window.model.runs.runs[0].path]
    assert page.buttons["open"].isEnabled()
    window.go("Measure")
    run_shortcut(window, "Ctrl+3")
    assert window.focusWidget() is page.list
    QTest.keyClick(page.list, Qt.Key.Key_Down)
    assert [run.path for run in page.selected()] == [window.model.runs.runs[1].path]
    page.list.clearSelection()
    window.model.runs.revision += 1
    window.refresh()
    assert page.selected() == []  # what the operator deselected stays deselected


def test_unavailable_command_reports_its_reason(runs):
    """Before, its menu entry was grey without a reason, and its key did nothing."""
    window, page = runs
    choose(page, 0)
    for go_to, remedy in (("Recordings", "two to four"), ("Measure", "Go to the page Recordings")):
        window.go(go_to)
        run_command(window, "Compare the selected runs")
        notice = window.model.notices.current()
        assert "Compare the selected runs" in notice.cause
        assert remedy in notice.remedy
        window.commands.refresh()
        entry = next(a for c, a in window.commands.actions.items() if c.text == "Compare the selected runs")
        assert not entry.isEnabled()
        assert remedy in entry.toolTip()


def test_list_fits_the_window(live, qtbot):
    """Its buttons used to push the page beyond the window at 150 % on 1280 x 800."""
    live.model.services.recordings.mkdir()
    shutil.copy(SAMPLE, live.model.services.recordings)
    live.resize(853, 533)
    live.go("Recordings")

    def listed() -> bool:
        live.refresh()
        return live.pages["Recordings"].list.rowCount() > 0

    qtbot.waitUntil(listed, timeout=PATIENCE_MS)
    qtbot.waitUntil(lambda: live.scrolls["Recordings"].horizontalScrollBar().maximum() == 0, timeout=PATIENCE_MS)
    assert live.pages["Recordings"].buttons["report"].isVisible()


def test_open_recording_keeps_its_place(live, qtbot):
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


def test_selection_survives_a_new_list(live, qtbot):
    """Two runs chosen to be compared; a recording under way renews the list every few seconds, and left one of them."""
    live.model.services.recordings.mkdir()
    for name in "abc":
        shutil.copy(SAMPLE, live.model.services.recordings / f"{name}.boat")
    live.go("Recordings")
    page, runs = live.pages["Recordings"], live.model.runs
    qtbot.waitUntil(lambda: (live.refresh(), page.list.rowCount())[1] == 3, timeout=PATIENCE_MS)
    page._choose([0, 1])
    chosen = [run.path.name for run in page.selected()]
    assert chosen == ["c.boat", "b.boat"]
    runs.runs = [runs.runs[2], runs.runs[0], runs.runs[1]]  # as if another order had come
    runs.revision += 1
    page.refresh(live.model.snapshot)
    assert sorted(run.path.name for run in page.selected()) == sorted(chosen)
    assert page.offers("compare")
    control = Qt.Key.Key_Control, Qt.KeyboardModifier.ControlModifier
    QTest.keyPress(page, *control)  # Qt's `selectRow` would toggle now
    assert QApplication.keyboardModifiers() == Qt.KeyboardModifier.ControlModifier
    runs.revision += 1
    page.refresh(live.model.snapshot)
    QTest.keyRelease(page, control[0])
    assert sorted(run.path.name for run in page.selected()) == sorted(chosen)


def test_narrow_list_does_not_scroll_sideways(live, qtbot):
    """At 853 px (150 % on 1280) the last columns were out of sight."""
    live.model.services.recordings.mkdir()
    shutil.copy(SAMPLE, live.model.services.recordings / "SA1_2026-11-21_223500.boat")
    live.go("Recordings")
    live.model.runs.scan()
    qtbot.waitUntil(lambda: (live.refresh(), live.pages["Recordings"].list.rowCount())[1] == 1, timeout=PATIENCE_MS)
    for width, thumbnail in ((853, THUMBNAIL[0] // 2), (1280, THUMBNAIL[0])):
        live.resize(width, 500)
        QApplication.processEvents()
        table = live.pages["Recordings"].list
        assert table.columnWidth(0) == thumbnail
        assert table.horizontalScrollBar().maximum() == 0
        assert table.columnWidth(len(RUN_HEADINGS) - 1) >= THUMBNAIL[0] // 4


@pytest.mark.parametrize(
    ("status", "reason", "words"),
    [
        ("closed", "finished", "\u25cf finished"),
        ("closed", "stopped", "\u25a0 stopped early"),
        ("closed", "aborted: the board is gone", "\u25b2 aborted"),
        ("recovered", "interrupted", "\u25cf recovered"),
    ],
)
def test_list_shows_how_each_run_ended(tmp_path, status, reason, words):
    """A run that was stopped, or whose board was unplugged, was listed as finished."""
    shutil.copy(SAMPLE, tmp_path / "a.boat")
    with closing(sqlite3.connect(tmp_path / "a.boat")) as db, db:
        for key, value in (("status", status), ("stop_reason", reason)):
            db.execute("UPDATE session SET value = ? WHERE key = ?", (json.dumps(value), key))
    assert read_run(tmp_path / "a.boat").cells[RUN_HEADINGS.index("State")] == words


def listed(window, names):
    """The page Recordings over made-up runs: their worst case, without a folder that is read."""
    run = read_run(SAMPLE)
    broken = dataclasses.replace(run.summary, status="interrupted", stop_reason=None, run_end=None, steps=3)
    damaged = dataclasses.replace(run, summary=None, problem="/a/long/way/to/x.boat cannot be read: it is malformed")
    made = [dataclasses.replace(run, path=run.path.with_name(name)) for name in names]
    window.model.runs.runs = [dataclasses.replace(made[0], summary=broken), damaged, *made[1:]]
    window.model.runs.scan = lambda: None
    window.model.runs.revision += 1
    window.go("Recordings")
    QApplication.processEvents()
    return window.pages["Recordings"]


def test_narrow_list_reports_the_columns_left_out(live):
    """A damaged file's reason pushed the names out of sight at any width; two more buttons the whole page at 853."""
    for width in (NARROW, 960, 1280):
        live.resize(width, 533)
        page = listed(live, [f"20261121-22153{n}_SA1.boat" for n in range(3)])
        choose(page, 0)
        QApplication.processEvents()
        table = page.list
        assert live.scrolls["Recordings"].horizontalScrollBar().maximum() == 0
        assert table.horizontalScrollBar().maximum() == 0
        assert table.columnWidth(RUN_HEADINGS.index("File")) >= table.fontMetrics().horizontalAdvance(
            "20261121-221530_SA1.boat"
        )
        assert table.isColumnHidden(RUN_HEADINGS.index("Readings")) is (width < 1000)
        assert all(page.offers(key) for key in ("resume", "recover"))
        assert "37 readings" in page.details.text()
        choose(page, 1)
        assert "malformed" in page.details.text()


def test_search_lists_what_matches(runs, monkeypatch):
    """By any words of line or tooltip; what is no longer listed is no longer chosen, nor acted on."""
    window, page = runs
    files = RUN_HEADINGS.index("File")

    def listed() -> list[str]:
        return sorted(page.list.item(row, files).text() for row in range(page.list.rowCount()))

    choose(page, 0, 1)
    QTest.keyClicks(page.search, "sa1 FIRST")
    assert listed() == ["first.boat"]
    assert [run.path.name for run in page.selected()] == ["first.boat"]
    QTest.keyClicks(page.search, "x")
    assert (listed(), page.selected()) == ([], [])
    assert not page.offers("open")
    page.clear.click()
    assert not page.clear.isVisible()
    assert listed() == ["first.boat", "second.boat"]
    opened: list[str] = []
    monkeypatch.setattr(QDesktopServices, "openUrl", lambda url: opened.append(url.toLocalFile()) or True)
    page.folder.click()
    assert opened == [str(window.model.services.recordings)]


def test_rename_and_note_are_undone(runs, qtbot):
    """Both by their panels; the line keeps its choice, the search finds the note; undo restores name and note."""
    window, page = runs
    choose(page, 1)
    page.press("note")
    dialog = window.findChild(TextDialog)
    assert not dialog.isModal()
    QTest.keyClicks(dialog.field, "tube replaced")
    dialog.button.click()

    def shown() -> tuple[str, str]:
        return page.selected()[0].path.name, page.selected()[0].note

    def until(wanted: tuple[str, str]) -> None:
        qtbot.waitUntil(lambda: (window.refresh(), shown())[1] == wanted, timeout=PATIENCE_MS)

    until(("first.boat", "tube replaced"))
    assert "tube replaced" in page.details.text()
    assert page.selected()[0].matches("TUBE")
    page.press("marker")
    dialog = window.findChildren(TextDialog)[-1]
    dialog.field.setText("tube")
    dialog.button.click()
    assert dialog.isVisible()  # no time: what was typed stays
    assert "is not a time" in window.model.notices.current().cause
    page.press("rename")
    dialog = window.findChildren(TextDialog)[-1]
    dialog.field.setText("second")
    dialog.button.click()
    assert dialog.isVisible()  # the name is in use: what was typed stays
    assert "exists already" in window.model.notices.current().cause
    dialog.field.setText("after the tube")
    dialog.button.click()
    until(("after the tube.boat", "tube replaced"))
    run_shortcut(window, "Ctrl+Z")
    until(("first.boat", "tube replaced"))
    run_shortcut(window, "Ctrl+Z")
    until(("first.boat", read_run(SAMPLE).note))


def test_damaged_recording_is_recovered_by_the_menu(live, qtbot, monkeypatch):
    """It is listed with its cause, and the menu saves what can be read into another file, which is then chosen."""
    folder = live.model.services.recordings
    folder.mkdir()
    path = Path(shutil.copy(SAMPLE, folder / "torn.boat"))
    content = bytearray(path.read_bytes())
    content[8192:30000] = bytes(30000 - 8192)
    path.write_bytes(content)
    entry = read_run(path)
    monkeypatch.setattr(runs_model, "Job", DirectJob)
    live.go("Recordings")
    page = live.pages["Recordings"]
    qtbot.waitUntil(lambda: (live.refresh(), page.list.rowCount())[1] == 1, timeout=PATIENCE_MS)
    assert (entry.summary, entry.damaged, page.offers("recover")) == (None, True, True)
    assert entry.problem in page.details.text()
    page.press("recover")
    qtbot.waitUntil(lambda: (live.refresh(), page.list.rowCount())[1] == 2, timeout=PATIENCE_MS)
    assert [(run.path.name, run.closed) for run in page.selected()] == [("torn.salvaged.boat", True)]
    assert "without what cannot be read" in live.model.notices.history[-1].cause
