"""The connect panel: fields, refusals, a pasted profile."""

from __future__ import annotations

from dataclasses import replace

from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QApplication,
)

from boat_daq.engine.snapshot import LinkState
from boat_daq.viewmodels.common.services import Panel
from tests.boat_daq.gui.windows import PATIENCE_MS


def test_tab_leaves_every_field(live, qtbot):
    """The profile's field used to consume the key: the keyboard did not reach the virtual board."""
    panel = live.connect_panel
    live.model.services.show(Panel.CONNECT)
    panel.activateWindow()
    qtbot.waitUntil(lambda: QApplication.activeWindow() is panel, timeout=PATIENCE_MS)
    seen = []
    for _ in range(16):
        seen.append(panel.focusWidget())
        QTest.keyClick(panel.focusWidget(), Qt.Key.Key_Tab)
    assert {panel.profile, panel.connect_button, panel.virtual_button, panel.speed} <= set(seen)
    texts = [widget.accessibleName() for widget in seen]  # as they are read: Rescan followed the profile
    assert texts[:5] == ["Port", "Rescan", panel.unit.accessibleName(), panel.profile.accessibleName(), "Open \u2026"]
    assert panel.profile.toPlainText() == ""


def test_rx8_line_is_pasted(empty, qtbot):
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
    assert "connect" in empty.model.session.calls
    assert empty.model.preferences.get("profile") == line


def test_refused_profile_stays_with_its_cause(empty):
    """Before, the panel closed over a line without a pressure, and the strip did not show how to write one."""
    panel = empty.connect_panel
    for pasted, cause in (
        ("RX8 [h=43] @1S1 @0S1 @1S2 @0S2 [t=00]", "@1P @0P"),
        ("/nowhere/profile.toml", "cannot be read"),
        ('kind = "lines"\nname = "x"', "device"),
    ):
        empty.show_place(Panel.CONNECT)
        panel.port.setEditText("/dev/ttyACM9")
        panel.profile.setPlainText(pasted)
        panel.connect_button.click()
        assert panel.isVisible()
        assert cause in panel.refused.text()
        assert empty.model.session.calls == []
    empty.show_place(Panel.CONNECT)
    assert not panel.refused.isVisible()
    panel.profile.setPlainText("")
    panel.connect_button.click()
    assert empty.model.session.calls == ["connect"]
    assert empty.model.notices.current() is None  # corrected: the warning is gone


def test_profile_field_keeps_its_height(live):
    """Before, the style sheet's least height overrode its own, and a panel with a warning squeezed it to one line."""
    live.connect_panel.open_fresh()
    live.connect_panel.none.setVisible(True)
    QApplication.processEvents()
    assert live.connect_panel.profile.height() >= 3 * live.connect_panel.profile.fontMetrics().lineSpacing()
    snapshot = live.model.snapshot
    live.connect_panel.refresh(replace(snapshot, link=LinkState.LOST, port="/dev/ttyACM7"))
    assert "/dev/ttyACM7 was disconnected" in live.connect_panel.identity.text()
    live.connect_panel.refresh(snapshot)
    assert "new one" in live.connect_panel.identity.text()
    live.connect_panel.close()


def test_virtual_board_has_the_chosen_number_of_sensors(live, monkeypatch):
    """Two sensors keep the unit's name; another number is its ending."""
    panel, started = live.connect_panel, []
    monkeypatch.setattr(panel.connection, "start_virtual_board", lambda unit, speed: started.append(unit))
    for text in ("2 sensors", "1 sensor", "4 sensors"):
        panel.sensors.setCurrentText(text)
        panel.start_virtual()
    assert started == ["SA1", "SA1x1", "SA1x4"]


def test_selected_port_stays_when_its_board_has_answered(empty, monkeypatch):
    """Its description changed under the selection, and its old text was then opened as a port; its unit is proposed."""
    panel, connection = empty.connect_panel, empty.connect_panel.connection
    listed = [("/dev/ttyACM0   KitProg", "/dev/ttyACM0"), ("/dev/ttyACM1   scale", "/dev/ttyACM1")]
    monkeypatch.setattr(connection, "ports", lambda: listed)
    monkeypatch.setattr(connection, "unit_at", lambda port: "SA7" if port == "/dev/ttyACM0" else "")
    panel.open_fresh()
    panel.port.setCurrentIndex(0)
    listed[0] = ("/dev/ttyACM0   \u25cf BOAT board 7 of SA7", "/dev/ttyACM0")
    panel.list_ports()
    assert panel.port.currentText() == listed[0][0]
    panel.port.activated.emit(0)
    assert panel.unit.text() == "SA7"
    opened = []
    monkeypatch.setattr(connection, "connect", lambda port, profile: opened.append(port))
    panel.connect_board()
    assert opened == ["/dev/ttyACM0"]
    assert connection.bench_unit == "SA7"
