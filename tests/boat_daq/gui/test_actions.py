"""Every command: in a menu, the palette and the shortcut sheet, by its key, or with a reason why not."""

from __future__ import annotations

import zipfile
from collections import Counter
from types import SimpleNamespace

import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QKeySequence
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QFileDialog,
)

from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import (
    LinkState,
    ReadingRequest,
    SessionState,
)
from boat_daq.gui.results.metadata_form import MetadataForm
from protocol.recording import Metadata
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import run_command, run_shortcut


def test_unavailable_command_is_greyed_and_says_why(live):
    """A command that has nothing to do is greyed; why is shown on hover, and where the palette or its key runs it."""
    silent = []
    for link in (LinkState.UP, LinkState.CLOSED):
        live.model.session.change(link=link)
        live.refresh()
        live.commands.refresh()
        greyed = {c.text: c.why() for c, a in live.commands.actions.items() if not a.isEnabled()}
        silent += [(link, text) for text, why in greyed.items() if not why]
        assert {
            "Accept the calibration",
            "Compare the selected runs",
            "Skip this reading",
            "Undo",
            "Analyse the last run",
        } <= greyed.keys()
        assert {"Vent now", "Connect …"} & greyed.keys() == set()
    assert silent == []


def test_start_may_follow_arm_at_once(make):
    """Start was refused until the window had seen the session again."""
    session = RecordedSession(connected(), filled_ring(10.0))
    window = make(session)
    window.refresh()
    session.change(state=SessionState.ARMED)
    run_shortcut(window, "F6")
    assert session.calls[-1] == "start"


def test_a_session_by_keys_alone(make):
    """Arm, start, reading, skip, undo, page and pause, each by its key; no mouse."""
    session = RecordedSession(connected(), filled_ring(10.0))
    session.marks = (StepMark(3, 1, "unloading", 30.0, 10.0, 0), StepMark(4, 1, "unloading", 20.0, 10.0, 1))
    window = make(session)
    window.refresh()
    press = lambda keys: run_shortcut(window, keys)  # noqa: E731
    press("F5")
    assert session.calls[-1] == "arm"
    session.change(state=SessionState.ARMED)
    window.refresh()
    press("F6")
    assert session.calls[-2:] == ["start_recording", "start"]
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
    run_command(window, "Skip this reading")
    assert session.calls[-1] == "skip_reading"
    press("F7")
    assert session.calls[-1] == "pause"
    press("Ctrl+2")
    assert window.place == "Calibration"
    press("Esc")
    assert session.calls[-1] == "vent"


@pytest.mark.nightly
def test_bug_report_is_packed_without_names(live, tmp_path, qtbot):
    """The menu's action requests a place, packs in the background, and reports it."""
    run_command(live, "Save a bug report …")
    dialog = next(d for d in live.findChildren(QFileDialog))
    path = tmp_path / "report.zip"
    dialog.fileSelected.emit(str(path))
    qtbot.waitUntil(lambda: (live.refresh(), live.model.jobs.get(f"bug report {path}"))[1] is None, timeout=60_000)
    live.refresh()
    assert "versions.json" in zipfile.ZipFile(path).namelist()
    assert live.strip.text.text().startswith("Saved report.zip, without names")


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


def test_no_two_commands_share_keys_and_few_have_some(live):
    """Keys are for what a session needs every time; the palette finds the rest."""
    keys = [QKeySequence(c.shortcut).toString() for c in live.commands.actions if c.shortcut]
    assert [key for key, n in Counter(keys).items() if n > 1] == []
    entries = [action for menu in live.menuBar().actions() for action in menu.menu().actions() if action.text()]
    assert (len(keys) <= 25, len(entries) <= 46) == (True, True), (len(keys), len(entries))
    for name in ("dark", "light"):
        live.choose_theme(name)
        live.commands.refresh()
        assert [a.text().split()[0].lower() for a in live.commands.actions.values() if "\u2713" in a.text()] == [name]


def test_metadata_are_stated_of_the_recording_in_progress(live, tmp_path):
    """Without one, those of the unit's next recordings; while one is made, its own, undoably."""
    session, stated = live.model.session, {}
    path = tmp_path / "run.boat"
    run_command(live, "Metadata …")
    form = live.findChild(MetadataForm)
    assert form.windowTitle() == "Metadata of SA1"
    form.close()
    form.deleteLater()
    session.recording = SimpleNamespace(metadata=lambda of: stated.get(of, Metadata()), state=stated.__setitem__)
    session.change(recording=path)
    live.refresh()
    run_command(live, "Metadata …")
    form = live.findChildren(MetadataForm)[-1]
    assert form.windowTitle() == "Metadata of run.boat"
    form.fields["customer"].setText("A & Co")
    form.fields["ambient_temperature_c"].setText("21,5")
    QTest.keyClick(form.fields["customer"], Qt.Key.Key_Return)
    assert (stated[path].customer, stated[path].ambient_temperature_c) == ("A & Co", 21.5)
    live.model.undo.undo()
    assert stated[path] == Metadata()
