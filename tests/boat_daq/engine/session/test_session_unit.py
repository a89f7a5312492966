"""The limits of the unit under test follow its file."""

from __future__ import annotations

import os

import pytest

from boat_daq.engine.plan import load_plan
from boat_daq.engine.session import health_log
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, Unit, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings
from boat_daq.engine.snapshot import MessageKind, SessionState
from tests.boat_daq.engine.served_board import serve_in_thread
from tests.conftest import reached

PATIENCE_S = 20.0


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
def test_limits_changed_by_another_program_hold_at_once(monkeypatch, tmp_path):
    """An armed plan is disarmed; a file that is refused leaves the limits as they were, with a warning."""
    monkeypatch.setattr(health_log, "EVERY_S", 0.05)
    units = UnitLibrary(tmp_path)
    session = Session(Settings(), units)
    with serve_in_thread(BoardSettings()) as board:
        session.connect(board.url, unit="SA1")
        session.wait_connected()
        session.arm(load_plan("calibration"))
        units.save(Unit("SA1", min_kpa=-25.0))
        seen = reached(session, lambda s: s.limits.min_kpa == -25.0, PATIENCE_S)
        assert (seen.limits.min_kpa, seen.limits.min_source, seen.state) == (-25.0, "unit", SessionState.IDLE)
        (tmp_path / "SA1.toml").write_text("min_kpa = -10 kPa\n")
        seen = reached(session, lambda s: any(m.level == "warning" for m in s.messages), PATIENCE_S)
        told = [(m.level, m.cause) for m in seen.messages if m.kind is MessageKind.UNIT_LIMITS]
        assert [level for level, _ in told] == ["info", "warning"]
        assert told[0][1] == "the limits of unit SA1 are now -25 to 50 kPa"
        assert seen.limits.min_kpa == -25.0
        session.close()
