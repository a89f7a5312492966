"""The panel that describes a board: from what it prints to a profile in the connection panel."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from protocol.text.profile import load_profile
from tests.boat_daq.gui.windows import run_command
from tests.protocol.text.firmwares import OUTPUTS, PACKETS


@pytest.fixture
def panel(empty, tmp_path):
    """The panel on columns without a heading."""
    path = tmp_path / "printed.txt"
    path.write_bytes(OUTPUTS["Arduino plotter without labels"])
    run_command(empty, "Describe a board …")
    panel = empty.profile_panel
    assert panel.isVisible()
    panel._opened(path)
    return panel


def test_profile_is_made_from_what_is_printed_and_used(empty, panel):
    """The guess is corrected, limits and commands are stated, and the connection panel gets the profile."""
    assert "3 columns, separated by tab" in panel.summary.text()
    assert [box.currentText() for box in panel.meanings] == ["Pressure", "Sensor 1", "Sensor 2"]
    assert panel.table.rowCount() == 4
    panel.meanings[2].setEditText("temperature")
    panel.meanings[2].lineEdit().editingFinished.emit()
    panel.units[2].setEditText("degC")
    panel.units[2].lineEdit().editingFinished.emit()
    assert panel.table.horizontalHeaderItem(3).text() == "Temperature (degC)"
    for key, text in (("low_kpa", "-40"), ("high_kpa", "50")):
        panel.device[key].setText(text)
        panel.device[key].editingFinished.emit()
    QTest.keyClicks(panel.commands["vent"], "V\\n")
    assert panel.dry["vent"].text() == "V\\n"
    QTest.keyClicks(panel.commands["set_pressure"], "P{kpa:.1f}")
    assert panel.dry["set_pressure"].text() == "P-40.0"
    panel.name.setText("Rig 3")
    QTest.mouseClick(panel.use_button, Qt.MouseButton.LeftButton)
    assert not panel.isVisible()
    assert empty.connect_panel.isVisible()
    made = load_profile(empty.connect_panel.profile.toPlainText())
    assert (made.name, made.limits_pa, made.channels[0].unit) == ("Rig 3", (-40_000, 50_000), "degC")
    assert made.cannot_command_reason == ""


def test_incomplete_profile_cannot_be_used(panel):
    """Without a pressure the buttons are grey, and the reason is shown."""
    panel.meanings[0].setCurrentIndex(panel.meanings[0].findData("_"))
    panel.meanings[0].activated.emit(panel.meanings[0].currentIndex())
    assert "no field is the pressure" in panel.remark.text()
    assert not panel.use_button.isEnabled()
    assert "pressure" in panel.use_button.accessibleDescription()


def test_packets_show_their_format(panel, tmp_path):
    """Bytes are shown as hexadecimal with the RX8 format, which can be changed."""
    path = tmp_path / "packets.bin"
    path.write_bytes(PACKETS)
    panel._opened(path)
    assert panel.rx8.isVisible()
    panel.rx8.setText("RX8 [h=43] @1P @0P @1S1 @0S1 x x")
    panel.rx8.returnPressed.emit()
    assert [box.currentText() for box in panel.meanings] == ["Pressure", "Sensor 1"]
    assert panel.table.rowCount() == 4
