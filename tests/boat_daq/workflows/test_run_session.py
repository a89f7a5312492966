"""One session without a window: messages on latched faults, link warnings and a lost link."""

from __future__ import annotations

import dataclasses
import os
import time
from pathlib import Path
from typing import Any

import pytest
import serial

from boat_daq.engine.plan import built_in_plans
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings
from boat_daq.engine.snapshot import (
    LinkState,
    SessionSnapshot,
    SessionState,
)
from boat_daq.workflows.run_session import (
    SessionRequest,
    clear_latched_fault,
    run_session,
    why_failed,
)
from boat_daq.workflows.unit_control import identify_unit
from protocol import Connection, Identify, SetLimits, SetPressure, Start
from protocol.base.errors import DeviceError, RequestError
from protocol.recording import BoardState
from tests.boat_daq.commands.calls import program
from tests.boat_daq.engine.served_board import serve_in_thread
from tests.boat_daq.workflows.test_unit_control import accept, swings_run
from tests.conftest import mostly_at_night

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")

PLAN = dataclasses.replace(built_in_plans()["repeatability"], cycles=1, ramp_kpa_per_s=40.0)


@pytest.mark.fault(20, how="e-stop pressed before the run", times=1)
def test_pressed_e_stop_is_not_reported_as_cleared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With the e-stop pressed before the run it is refused, and no message reports a cleared fault."""
    pressed = BoardSettings(speed=5.0, faults=("estop@0:1000",))
    with serve_in_thread(pressed) as board, pytest.raises(RequestError, match="e-stop is pressed"):
        run_session(SessionRequest(board.url, tmp_path / "run.boat", PLAN), notify=print)
    assert "is cleared" not in capsys.readouterr().out


def test_a_refused_first_pressure_leaves_no_recording(tmp_path: Path) -> None:
    """A file with nothing in it stayed; of a later refusal the recording is kept."""
    runs = (tmp_path / "first", tmp_path / "later")
    for folder, at in zip(runs, ("0", "2"), strict=True):
        folder.mkdir()
        settings = BoardSettings(speed=5.0, faults=(f"ack_refused@{at}:3",))
        with serve_in_thread(settings) as board:
            request = SessionRequest(board.url, folder / "run.boat", PLAN)
            if at == "0":
                with pytest.raises(DeviceError, match="refused SET_PRESSURE"):
                    run_session(request, notify=print)
            else:
                assert "refused SET_PRESSURE" in run_session(request, notify=print).failure
    assert [[file.name for file in folder.iterdir()] for folder in runs] == [[], ["run.boat"]]


def test_previous_fault_is_reported_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A fault latched before the session, its cause gone, is one warning; the run then ends without an error."""
    with serve_in_thread(BoardSettings(speed=5.0, faults=("estop@1:1",))) as board:
        time.sleep(1.0)  # pressed and released before the session; the fault remains latched
        _, failure, _ = run_session(SessionRequest(board.url, tmp_path / "run.boat", PLAN), notify=print)
    messages = capsys.readouterr().out
    assert failure == ""
    assert messages.count("latched a fault") == 1
    assert "error:" not in messages


@pytest.mark.fault(9, how="`slow_rate` of 62 Hz, `record` in a terminal", times=1)
def test_lasting_link_warning_is_printed_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """62 Hz in place of the requested 100 are reported once."""
    with serve_in_thread(BoardSettings(speed=5.0, faults=("slow_rate@0:62",))) as board:
        run_session(SessionRequest(board.url, tmp_path / "run.boat", duration_s=10.0), notify=print)
    assert capsys.readouterr().out.count("samples/s") == 1


def test_cleared_fault_is_confirmed_by_a_sample(tmp_path: Path) -> None:
    """A plan armed before the next sample after CLEAR_FAULT would be refused for a unit that is not vented."""
    with serve_in_thread(BoardSettings(faults=("estop@0.2:0.2",))) as board:
        time.sleep(0.6)
        session = Session()
        try:
            session.connect(board.url, rate_hz=2, record_to=tmp_path / "run.boat")
            clear_latched_fault(session, session.wait_connected(), print)
            last = session.snapshot().last
            assert last is not None
            assert last.state is BoardState.VENTED
        finally:
            session.close()


def test_lost_link_is_reported_with_its_cause() -> None:
    """Under pressure the cause is that of the latched fault."""
    gone = "/dev/ttyX is gone"
    seen = SessionSnapshot(SessionState.FAULT, LinkState.LOST, latched=gone)
    assert why_failed(seen, PLAN) == gone


def test_residual_pressure_is_vented_before_the_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Pressure left by a killed host is reported and vented before the run, which ends normally."""
    with serve_in_thread(BoardSettings(speed=5.0)) as board:
        port = serial.Serial(board.url, timeout=0.1)
        link = Connection()
        for command in (Identify(), SetLimits(-40_000, 50_000), Start(100), SetPressure(30_000, 0)):
            port.write(link.send(command, time.monotonic_ns()))
            time.sleep(0.2)
        port.close()
        _, failure, _ = run_session(SessionRequest(board.url, tmp_path / "run.boat", PLAN), notify=print)
    assert failure == ""
    assert "was under pressure" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("settings", "cause"),
    mostly_at_night(
        ({"faults": ("sensor_disagreement@0:300",)}, "the sensors disagree"),
        ({"unit": "SA1x3"}, "3 sensors"),
        ({"speed": 30.0}, "times real time"),
        ({"faults": ("estop@0:1000",)}, "e-stop"),
        ({"faults": ("pressure_invalid@0:1000",)}, "pressure sensor"),
        ({"faults": ("silent@0.1:0",)}, "the board "),
        ({"faults": ("ack_refused@0:3",)}, "refused SET_PRESSURE"),
    ),
)
def test_a_refused_hold_leaves_no_file(
    settings: dict[str, Any], cause: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever refuses it once the board is connected, and its cause is printed."""
    monkeypatch.setenv("BOAT_DAQ_HOME", str(tmp_path / "home"))
    units = UnitLibrary().of(simulated=True)
    accept(units)
    identify_unit(swings_run(), units)
    (tmp_path / "runs").mkdir()
    with serve_in_thread(BoardSettings(**{"port": "127.0.0.1:0"} | settings)) as board:
        words = ("--port", board.url, "--unit", "SA1", "--mm", "1.5", "--seconds", "1")
        code, _, err = program("twin", "hold", *words, "--out", tmp_path / "runs" / "hold.boat")
    assert code == 1
    assert cause in err
    assert list((tmp_path / "runs").iterdir()) == []
