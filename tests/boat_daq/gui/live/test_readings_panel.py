"""The reading bar and the table of readings."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QApplication,
)

from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import (
    ReadingRequest,
    SessionState,
)
from protocol.base.units import STORED_UNITS, ShownUnits
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import ASKED, PATIENCE_MS, RAMPING, Grid, run_command, run_shortcut
from tests.boat_daq.viewmodels.live.test_readings import plateaus


def test_reading_bar_keeps_its_place_during_a_run(running, qtbot):
    """The question's line is there for the whole run: what comes next, then the question; the plots stay as high."""
    bar, plots = running.live.reading, running.live.plots
    qtbot.waitUntil(bar.isVisible, timeout=PATIENCE_MS)
    QApplication.processEvents()
    before = plots.size()
    assert (bar.question.text(), bar.field.isReadOnly()) == ("Next: +20 kPa, unloading, cycle 1", True)
    running.model.session.change(waiting_for_reading=ASKED)
    running.refresh()
    QApplication.processEvents()
    assert (bar.question.text(), bar.field.isReadOnly()) == ("At +20 kPa, unloading, cycle 1", False)
    assert plots.size() == before
    whole = bar.question.sizeHint().width()
    assert bar.question.fitting(whole) == bar.question.text()
    assert bar.question.fitting(whole - 5) == "At +20 kPa, unloading"


def test_keyboard_returns_to_the_reading_field(running, qtbot):
    """After a marker's note, and after a correction in the table, digits go to the plateau that waits."""
    live, field = running.live, running.live.reading.field
    running.model.session.marks = (
        StepMark(1, 1, "unloading", 30.0, 10.0, 0),
        StepMark(2, 1, "unloading", 20.0, 10.0, 1),
    )
    running.model.session.change(waiting_for_reading=ASKED)
    view = live.show_readings().view
    for width in (853, 1280):  # the columns take the whole table, their heads stand apart
        running.resize(width, 600)
        QApplication.processEvents()
        header = view.horizontalHeader()
        assert header.length() == view.viewport().width()
        assert header.sectionSizeHint(0) - header.fontMetrics().horizontalAdvance("Cycle") >= 8
    running.refresh()
    live.ask_marker()
    QTest.keyClicks(live.note, "ta")
    at_plateau(running, LATER)  # it took the focus, and the rest of the note went to the reading
    QTest.keyClicks(running.focusWidget(), "pped")
    assert (live.note.text(), field.text()) == ("tapped", "")
    QTest.keyClick(live.note, Qt.Key.Key_Return)
    assert field.hasFocus()
    live.ask_marker()
    QTest.keyClicks(live.note, "5")
    live.note.editingFinished.emit()  # what is taken keeps no focus
    at_plateau(running, ASKED)
    assert field.hasFocus()
    live.close_marker()
    running.menuBar().setFocus()
    running.escape()  # nothing had the focus then
    assert field.hasFocus()
    live.table.view.setFocus()
    live.table.model.setData(live.table.model.index(0, 3), "2.5")
    qtbot.waitUntil(field.hasFocus, timeout=PATIENCE_MS)


def test_text_typed_before_the_plateau_is_no_reading(running, qtbot):
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


def test_run_without_readings_shows_no_reading_bar(live):
    """A continuous plan has no plateau to read: its run keeps the space for the plots."""
    live.model.sequence.choose("repeatability")
    live.model.sequence.arm()
    live.model.session.change(state=SessionState.RUNNING, progress=RAMPING)
    live.refresh()
    assert not live.live.reading.isVisible()


def test_column_is_pasted_whatever_tab_is_shown(live):
    """With the plan in the pane, the command used to open the readings and paste nothing, without a message."""
    live.live.pane.setCurrentWidget(live.live.plan)
    QApplication.clipboard().setText("4.1\n3.4")
    live.live.show_readings().paste()
    assert "no plateau" in live.model.notices.current().cause
    live.live.pane.setCurrentWidget(live.live.plan)
    live.model.session.marks = tuple(
        StepMark(n, 1, "unloading", 50.0 - 10 * n, 10.0, n * 10**6, status="reached") for n in (1, 2, 3)
    )
    live.live.show_readings().paste()
    assert [(r.step_id, r.elongation_mm) for r in live.model.session.kept] == [(1, 4.1), (2, 3.4)]


def test_paste_without_selection_overwrites_nothing(make):
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
    assert "were pasted for 1 plateau" in window.model.notices.current().cause
    window.live.table.view.paste("4\n3\n2\n1")
    assert [r.elongation_mm for r in session.kept[3:]] == [4.0, 3.0, 2.0, 1.0]


def test_typed_reading_is_undone_and_redone(make):
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


def test_text_that_is_no_length_is_refused_in_its_field(make):
    """A wrong reading is not kept, its field is marked, and the strip shows the expected form."""
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


def test_column_of_a_spreadsheet_is_pasted(make):
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


LATER = ReadingRequest(5, 1, "unloading", 10.0, 10.0, 600.0)


def at_plateau(running, waiting):
    """Let the run wait at a plateau."""
    marks = {m.number: m for m in running.model.session.marks}
    marks[waiting.step_id] = StepMark(waiting.step_id, 1, waiting.branch, waiting.target_kpa, 10.0, waiting.step_id)
    running.model.session.marks = tuple(marks.values())
    running.model.session.change(waiting_for_reading=waiting)
    running.refresh()


def test_half_typed_reading_does_not_land_on_the_next_plateau(running):
    """The wait had ended without a sign, and the rest of the digits and Enter went to the plateau after it."""
    bar, session = running.live.reading, running.model.session
    at_plateau(running, ASKED)
    QTest.keyClicks(bar.field, "1.5")
    at_plateau(running, LATER)
    offer = running.model.notices.current()
    session.change(recording=Path("other.boat"))  # the file of the run is closed: nothing can be entered there
    running.refresh()
    assert running.model.notices.current() is not offer
    session.change(recording=None)
    at_plateau(running, ASKED)
    QTest.keyClicks(bar.field, "1.5")
    at_plateau(running, LATER)
    assert (bar.field.text(), session.kept) == ("", [])
    notice = running.model.notices.current()
    assert notice.cause == '"1.5" was typed at +20 kPa, unloading, cycle 1, but not entered before the run continued'
    running.strip.refresh()
    running.strip.apply()
    assert [(r.step_id, r.elongation_mm) for r in session.kept] == [(4, 1.5)]
    QTest.keyClicks(bar.field, "0.7")
    QTest.keyClick(bar.field, Qt.Key.Key_Return)
    assert [(r.step_id, r.elongation_mm) for r in session.kept[1:]] == [(5, 0.7)]
    at_plateau(running, ASKED)
    assert running.model.notices.current() is None  # what was entered is not reported


def test_wait_for_a_reading_counts_down(running):
    """After 600 s of board time the run continued unannounced."""
    left = running.live.reading.left
    seen = []
    for seconds in (600.0, 59.0):
        at_plateau(running, dataclasses.replace(LATER, time_left_s=seconds))
        seen.append((left.text(), left.property("state") or "", left.width()))
    assert [s[:2] for s in seen] == [("skipped in 10:00", ""), ("skipped in 0:59", "warning")]
    assert seen[0][2] == seen[1][2]
    running.model.session.change(waiting_for_reading=None)
    running.refresh()
    assert left.text() == ""


def test_implausible_reading_is_warned_of_beside_its_field(running):
    """Before Enter, also to a screen reader; Enter asks first, another text or a second Enter decides."""
    running.model.readings._nominal = lambda kpa: (0.07 * kpa, 0.55)
    bar = running.live.reading
    at_plateau(running, ASKED)
    QTest.keyClicks(bar.field, "3.9.1")
    QTest.keyClick(bar.field, Qt.Key.Key_Return)
    assert running.model.notices.current().cause == "'3.9.1' is not a length"
    QTest.keyClicks(bar.field, "1")  # in its place
    assert bar.question.property("state") == ""
    QTest.keyClicks(bar.field, "4")
    model = "Model +1.4 \u00b10.6 mm"  # its own band, as in the pane of the shadow; the grid's is added to it
    assert bar.question.text() == f"\u25b2 At +20 kPa, unloading\n14? {model}"
    assert bar.question.property("state") == "warning"
    assert "Model" in bar.field.accessibleDescription()
    running.refresh()
    assert "Model" in bar.question.text()
    QTest.keyClick(bar.field, Qt.Key.Key_Return)
    running.refresh()
    assert running.model.session.kept == []
    assert bar.question.text() == f"\u25b2 At +20 kPa, unloading\nKeep 14? {model}"
    assert bar.unit.text() == "mm, Enter again"
    assert "\u2026" not in bar.question.fitting(bar.question.width())
    bar.fold(narrow=True, low=True)  # the words beside the field were cut
    running.refresh()
    assert bar.question.text() == f"\u25b2 At +20 kPa, unloading: Keep 14? {model}, Enter again"
    assert bar.unit.text() == "mm"
    QTest.keyClicks(bar.field, "14")  # in its place
    QTest.keyClick(bar.field, Qt.Key.Key_Return)
    assert running.model.session.kept == []
    QTest.keyClick(bar.field, Qt.Key.Key_Return)
    assert running.model.session.kept[-1].elongation_mm == 14.0
    assert running.model.notices.current() is None  # the refusal is over
    assert (bar.question.property("state"), bar.field.accessibleDescription()) == ("", "")
    at_plateau(running, LATER)
    assert bar.question.text() == "At +10 kPa, unloading, cycle 1: type, press Enter"
    session, table = running.model.session, running.live.show_readings()
    session.marks = (*session.marks[:-1], dataclasses.replace(session.marks[-1], status="aborted"))
    for width, sign in ((853, "\u25b2 1"), (1280, "1")):  # without the column of the remarks, which is in the tooltip
        running.resize(width, 600)
        QApplication.processEvents()
        running.refresh()
        assert table.model.index(len(table.model.rows) - 1, 0).data() == sign


def test_implausible_reading_of_the_table_is_asked_for_again(running):
    """A far one typed into the table was taken at once; a correct one, and the same again, are taken."""
    running.model.readings._nominal = lambda kpa: (0.07 * kpa, 0.55)
    session = running.model.session
    at_plateau(running, ASKED)
    table = running.live.show_readings().model
    at = table.index(len(table.rows) - 1, 3)
    for text in ("14", "1.5", "15"):
        table.setData(at, text)
    assert [reading.elongation_mm for reading in session.kept] == [1.5]
    assert running.model.notices.current().cause == "15? Model +1.4 \u00b10.6 mm, at +20 kPa, unloading, cycle 1"
    running.refresh()
    assert (table.data(at, Qt.ItemDataRole.EditRole), table.rows[at.row()].cells[4]) == ("15", "15: not entered")
    table.setData(at, "15")
    assert [reading.elongation_mm for reading in session.kept] == [1.5, 15.0]
    running.refresh()
    table.setData(at, table.rows[at.row()].cells[3])  # nothing is changed
    assert len(session.kept) == 2


def test_reading_is_typed_and_shown_in_the_chosen_units(running):
    """Truth: 1 cm = 10 mm, 1 kPa = 10 mbar; the question, the field, the table and undo agree."""
    bar, model = running.live.reading, running.model
    model.unit_choice.choose(ShownUnits.of("mbar,cm"))
    at_plateau(running, ASKED)
    assert bar.question.text() == "At +200 mbar, unloading, cycle 1"
    assert bar.unit.text() == "cm, press Enter"
    QTest.keyClicks(bar.field, "0.14")
    QTest.keyClick(bar.field, Qt.Key.Key_Return)
    assert model.session.kept[-1].elongation_mm == pytest.approx(1.4)
    model.session.marks = plateaus(1)[:5]
    row = model.readings.rows(model.snapshot)[3]
    assert (row.cells[2], row.cells[3], model.readings.headings[2:4]) == ("+200", "0.140", ("mbar", "cm"))
    model.undo.undo()
    assert model.notices.current().cause.startswith("Undone: reading +0.140 cm")
    model.unit_choice.choose(STORED_UNITS)


def test_grid_of_the_virtual_board_is_read_by_one_key(running):
    """F2 enters it, and the bar shows the value taken; Shift+F2 reads every plateau; a real board has no such grid."""
    bar, session = running.live.reading, running.model.session
    at_plateau(running, ASKED)
    run_shortcut(running, "F2")
    assert (session.kept, bar.simulated.isVisible(), bar.all.isVisible()) == ([], False, False)
    running.model.connection.board = Grid(2.5)
    running.refresh()
    assert (bar.simulated.isVisible(), bar.all.isVisible(), bar.photo.isVisible()) == (True, True, False)
    QApplication.processEvents()
    scroll = running.scrolls[running.place]
    assert running.live.width() <= scroll.width()  # long words would push the pane aside
    assert bar.lines.minimumSize().width() <= bar.width()
    run_shortcut(running, "F2")
    assert [(r.step_id, r.elongation_mm, r.source) for r in session.kept] == [(4, 2.5, "simulated")]
    session.change(waiting_for_reading=None)
    running.refresh()
    assert (bar.question.text()[:5], bar.left.text()) == ("Next:", "+2.50 taken")
    run_command(running, "Simulate the reading at every plateau")
    at_plateau(running, dataclasses.replace(ASKED, step_id=5))
    assert bar.all.isChecked()
    assert [r.step_id for r in session.kept] == [4, 5]
