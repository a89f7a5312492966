"""The Settings page without Qt: values with undo, limits that hold at once, safe mode, import and export."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from boat_daq.engine.plan import load_plan
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, StoredCalibration, Unit, UnitLibrary, load_settings, save_settings
from boat_daq.engine.simulator.server import BoardSettings
from boat_daq.engine.snapshot import SessionState
from boat_daq.viewmodels.common.services import UndoHistory
from boat_daq.viewmodels.settings_model import PROGRAM, SettingsModel
from protocol.base.errors import RequestError
from tests.boat_daq.engine.served_board import serve_in_thread
from tests.conftest import reached


@pytest.fixture
def model(tmp_path: Path) -> Iterator[SettingsModel]:
    units = UnitLibrary(tmp_path / "units")
    session = Session(Settings(), units)
    yield SettingsModel(session, units, tmp_path, UndoHistory())
    session.close()


def test_values_are_stored_used_and_undone(model, tmp_path):
    """The session uses a setting from then on; undo stores the old one; the changes are listed, newest first."""
    model.enter(PROGRAM, {"rate_hz": "1000"})
    model.enter(PROGRAM, {"rate_hz": "1000"})  # as stored: no second step
    assert load_settings(tmp_path).rate_hz == model._session.settings.rate_hz == 1000
    model.reset(PROGRAM)
    assert model.shown(PROGRAM).texts["rate_hz"] == "100"
    assert [change.text for change in model._undo.done] == ["Sampling rate 1000", "Sampling rate 100"]  # of the message
    model._undo.undo()
    assert load_settings(tmp_path).rate_hz == model._session.settings.rate_hz == 1000
    model._undo.undo()
    assert load_settings(tmp_path) == Settings()
    assert [(c.before, c.after) for c in model.shown(PROGRAM).changes][:2] == [("1000", "100"), ("100", "1000")]
    assert not model._undo.done
    with pytest.raises(RequestError, match="'baud' must be 300"):
        model.enter(PROGRAM, {"baud": "1"})


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
def test_plan_below_a_limit_entered_while_connected_is_refused(model):
    """A unit that buckles at -25 kPa: the plan to -40 kPa, armed before, is disarmed, and refused from then on."""
    session, plan = model._session, load_plan("calibration")
    with serve_in_thread(BoardSettings()) as board:
        session.connect(board.url, unit="SA1")
        session.wait_connected()
        session.arm(plan)
        model.enter("SA1", {"min_kpa": "-25"})
        assert session.snapshot().state is SessionState.IDLE
        with pytest.raises(RequestError, match=r"-40 kPa is below the unit's limit of -25 kPa"):
            session.arm(plan)
        model._undo.undo()
        session.arm(plan)
        session.start()
        reached(session, lambda s: s.state is SessionState.RUNNING, 5.0)
        with pytest.raises(RequestError, match="a run is in progress"):
            model.enter("SA1", {"min_kpa": "-25"})
        assert model.shown("SA1").texts["min_kpa"] == "-40"
        session.close()


def test_refused_settings_are_kept_until_others_are_stored(model, tmp_path):
    """In safe mode the defaults are shown; what is stored then leaves the file beside, and the backup as it was."""
    for rate_hz in (200, 300):
        save_settings(Settings(rate_hz=rate_hz), tmp_path)
    path = tmp_path / "settings.toml"
    path.write_text("rate_hz = 'fast'\n")
    with pytest.raises(RequestError) as refused:
        load_settings(tmp_path)
    model.refused = refused.value
    assert model.shown(PROGRAM).texts["rate_hz"] == "100" and model.shown(PROGRAM).changes == ()
    assert path.read_text() == "rate_hz = 'fast'\n"
    model.enter(PROGRAM, {"operator": "Ada"})
    assert model.refused is None
    assert load_settings(tmp_path) == Settings(operator="Ada")
    assert path.with_name("settings.toml.refused").read_text() == "rate_hz = 'fast'\n"
    assert "rate_hz = 200" in path.with_name("settings.toml.bak").read_text()


def test_a_unit_and_settings_are_exported_and_imported(model, tmp_path):
    """An imported unit's values are undone; its calibrations stay. One that is refused names its key."""
    model.add_unit("SA7")
    with pytest.raises(RequestError, match="already"):
        model.add_unit("SA7")
    model.enter("SA7", {"min_kpa": "-25"})
    model.export("SA7", tmp_path / "SA7.toml")
    model.export(PROGRAM, tmp_path / "settings-of-the-rig.toml")
    model.enter("SA7", {"min_kpa": "-10"})
    assert model.import_(tmp_path / "SA7.toml") == "SA7"
    assert model.shown("SA7").texts["min_kpa"] == "-25"
    model._undo.undo()
    assert model.shown("SA7").texts["min_kpa"] == "-10"
    model.enter(PROGRAM, {"operator": "Ada"})
    assert model.import_(tmp_path / "settings-of-the-rig.toml") == PROGRAM
    assert load_settings(tmp_path).operator == ""
    (tmp_path / "bad.toml").write_text("min_kpa = -10\n")
    with pytest.raises(RequestError, match="'name' is missing"):
        model.import_(tmp_path / "bad.toml")
    assert model.subjects("SA1") == [("This program", PROGRAM), ("Unit SA1", "SA1"), ("Unit SA7", "SA7")]
    model._units.add_calibration("SA9", {"b0": 1.5, "simulated": False}, recording="run.boat")
    assert [(c.key, c.after) for c in model.shown("SA9").changes] == [("Calibration", "run.boat")]
    assert "Unit SA9" in dict(model.subjects(""))
    model.metadata("SA9").state({"customer": "A & Co"})
    changed = {change.key: change.after for change in model.shown("SA9").changes}
    assert changed["metadata.customer"] == "A & Co"


def test_calibrations_of_both_libraries_are_named(model):
    """The header said "calibrated" of the simulated unit, the page "0 calibrations" of the real one."""
    simulated = model._units.of(simulated=True)
    simulated.save(Unit("SA1", history=(StoredCalibration("2026-11-26T10:00:00+00:00", True, {}),)))
    assert model.shown("SA1").calibrations.splitlines() == [
        "Real unit: 0 calibrations, none in force",
        "Simulated unit: 1 calibration, in force since 2026-11-26",
    ]
