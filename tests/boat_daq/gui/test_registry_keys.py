"""Keys that the window handles before its shortcuts: VENT, Esc, Space, Enter, undo."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QMessageBox

from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import ReadingRequest, SessionState
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import PATIENCE_MS, choose


@pytest.mark.parametrize("key", [Qt.Key.Key_Return, Qt.Key.Key_Enter])
def test_focused_button_is_pressed_by_enter(live, qtbot, key):
    """Enter presses a button everywhere; on the live page Space is the key of the plots."""
    live.activateWindow()
    qtbot.waitUntil(lambda: QApplication.activeWindow() is live, timeout=PATIENCE_MS)
    arm = live.live.sequence.buttons["arm"]
    choose(live, arm)
    QTest.keyClick(live.windowHandle(), key)
    assert (live.model.session.calls, live.model.live.following) == (["arm"], True)


def test_vent_key_vents_over_a_modal_box(live, qtbot):
    """No box of the program is modal; over one of Qt's own F4 still vents, and Esc only closes the box."""
    box = QMessageBox(live)
    box.open()
    qtbot.waitUntil(lambda: QApplication.activeModalWidget() is box, timeout=PATIENCE_MS)
    live.window_keys.watch(box.windowHandle())
    QTest.keyClick(box.windowHandle(), Qt.Key.Key_F4)
    assert live.model.session.calls == ["vent"]
    QTest.keyClick(box.windowHandle(), Qt.Key.Key_Escape)
    assert (live.model.session.calls, box.isVisible()) == (["vent"], False)


def test_undo_reverses_the_reading_while_its_field_has_focus(make, qtbot):
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
    QTest.keyClick(handle, Qt.Key.Key_Space)  # it was typed into the field, which has the focus all run long
    assert (field.text(), window.model.live.following) == ("", False)
