"""One session without a window: what is said of a fault that stands, that was left behind, and of a lost link."""

from __future__ import annotations

import dataclasses
import os
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import serial

from boat_daq.commands.run_session import (
    MessagePrinter,
    SessionRequest,
    clear_latched_fault,
    run_session,
    why_failed,
)
from boat_daq.engine.plan import built_in_plans
from boat_daq.engine.session.session import Session
from boat_daq.engine.simulator.server import BoardSettings, serve
from boat_daq.engine.snapshot import LinkState, SessionSnapshot, SessionState
from boat_daq.errors import OperatorError
from protocol import Connection, Identify, SetLimits, SetPressure, Start
from protocol.recording import BoardState

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")

PLAN = dataclasses.replace(built_in_plans()["repeatability"], cycles=1, ramp_kpa_per_s=40.0)


@pytest.mark.fault(20, how="e-stop pressed before the run", times=1)
def test_a_pressed_e_stop_is_never_called_cleared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Pressed before the run: refused for it, and nothing says that the fault is gone."""
    pressed = BoardSettings(speed=5.0, faults=("estop@0:1000",))
    with serve(pressed) as board, pytest.raises(OperatorError, match="e-stop is pressed"):
        run_session(SessionRequest(board.url, tmp_path / "run.boat", PLAN))
    assert "is cleared" not in capsys.readouterr().err


def test_a_fault_left_behind_is_said_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Latched before anyone came, its cause gone: one warning before the run, which then ends well; no error."""
    with serve(BoardSettings(speed=5.0, faults=("estop@1:1",))) as board:
        time.sleep(1.0)  # pressed and released before anyone came; the board keeps its fault
        _, failure = run_session(SessionRequest(board.url, tmp_path / "run.boat", PLAN))
    told = capsys.readouterr().err
    assert failure == ""
    assert told.count("latched a fault") == 1
    assert "error:" not in told


@pytest.mark.fault(9, how="`slow_rate` of 62 Hz, `record` in a terminal", times=1)
def test_a_doubt_about_the_link_is_said_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """62 Hz come where 100 were asked for: said on the terminal, once."""
    with serve(BoardSettings(speed=5.0, faults=("slow_rate@0:62",))) as board:
        run_session(SessionRequest(board.url, tmp_path / "run.boat", duration_s=10.0))
    assert capsys.readouterr().err.count("100 were asked for") == 1


@pytest.mark.fault(8, how="a link in doubt of the board's clock, told in a terminal", times=1)
def test_a_doubt_is_told_again_only_if_another(capsys: pytest.CaptureFixture[str]) -> None:
    """New numbers are the same doubt, a drift is another; silence is the session's to tell; what passes is none."""
    print_new = MessagePrinter()
    looks = (
        (0.0, ("no data for 2 s", "3 samples lost", "102.7 samples/s come, 100 were asked for")),
        (5.0, ("no data for 7 s", "3 samples lost")),
        (6.0, ("no data for 8 s", "17 samples lost", "99.1 samples/s come, 100 were asked for")),
        (7.0, ("18 samples lost", "the board's clock is 0.9 % fast")),
        (13.0, ("18 samples lost", "the board's clock is 0.8 % fast")),
        (14.0, ("the board's clock is 0.8 % fast",)),
    )
    for recorded_s, warnings in looks:
        health = SimpleNamespace(warnings=warnings)
        print_new(SessionSnapshot(SessionState.IDLE, LinkState.UP, recorded_s=recorded_s, health=health))
    told = capsys.readouterr().err.splitlines()
    assert told == ["warning: 17 samples lost", "warning: the board's clock is 0.8 % fast"]


def test_a_cleared_fault_is_waited_for_in_the_samples(tmp_path: Path) -> None:
    """The next sample after CLEAR_FAULT comes late: a plan armed before it would be refused for a unit not vented."""
    with serve(BoardSettings(faults=("estop@0.2:0.2",))) as board:
        time.sleep(0.6)
        session = Session()
        try:
            session.connect(board.url, rate_hz=2, record_to=tmp_path / "run.boat")
            clear_latched_fault(session, session.wait_connected())
            last = session.snapshot().last
            assert last is not None
            assert last.state is BoardState.VENTED
        finally:
            session.close()


def test_a_lost_link_is_reported_with_its_cause() -> None:
    """Under pressure the latch says why; "the link was lost" is no cause."""
    gone = "/dev/ttyX is gone"
    seen = SessionSnapshot(SessionState.FAULT, LinkState.LOST, latched=gone)
    assert why_failed(seen, PLAN) == gone


def test_a_unit_left_under_pressure_is_vented_and_then_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The host died a moment ago and the board's watchdog has not struck: said, vented, and the run goes as asked."""
    with serve(BoardSettings(speed=5.0)) as board:
        port = serial.Serial(board.url, timeout=0.1)
        link = Connection()
        for command in (Identify(), SetLimits(-40_000, 50_000), Start(100), SetPressure(30_000, 0)):
            port.write(link.send(command, time.monotonic_ns()))
            time.sleep(0.2)
        port.close()
        _, failure = run_session(SessionRequest(board.url, tmp_path / "run.boat", PLAN))
    assert failure == ""
    assert "was under pressure" in capsys.readouterr().err
