"""The ports of the connect panel: other instruments receive nothing."""

from __future__ import annotations

from types import SimpleNamespace

from boat_daq.engine.link import opening
from boat_daq.engine.link.opening import PortIdentity
from boat_daq.engine.link.ports import PortInfo
from boat_daq.engine.settings import Unit, UnitLibrary
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.live import connection
from boat_daq.viewmodels.live.connection import ConnectionModel
from tests.boat_daq.gui.recorded_session import idle


def test_panel_queries_only_boards_used_before(monkeypatch, tmp_path):
    """The board of a unit is listed first and queried; the other instrument's port is listed and not opened."""
    units, opened = UnitLibrary(tmp_path / "units"), []
    units.save(Unit("SA7", usb_serial="PSOC-7"))
    hello = SimpleNamespace(board_id="PSOC-7A")

    def identify(port: str, description: str) -> PortIdentity:
        opened.append(port)
        return PortIdentity(port, description, hello, "")

    found = [PortInfo("/dev/ttyACM0", "thermometer", "T-1"), PortInfo("/dev/ttyACM1", "KitProg", "PSOC-7")]
    for module in (opening, connection):
        monkeypatch.setattr(module, "list_ports", lambda: found)
    monkeypatch.setattr(opening, "identify_port", identify)
    model = ConnectionModel(SimpleNamespace(snapshot=idle), Preferences(tmp_path), units)
    try:
        assert model.ports()[1] == ("/dev/ttyACM1   KitProg", "/dev/ttyACM1")
        model.query_boards()
        while not model.take_answers():
            pass
        assert opened == ["/dev/ttyACM1"]
        assert model.ports()[0] == ("/dev/ttyACM1   \u25cf BOAT board PSOC-7A of SA7", "/dev/ttyACM1")
        assert (model.unit_at("/dev/ttyACM1"), model.unit_at("/dev/ttyACM0")) == ("SA7", "")
    finally:
        model.close()
