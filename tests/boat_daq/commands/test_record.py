"""`boat-daq record` where it says no: to its reader, to another program, and about the file."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from boat_daq.cli import main
from boat_daq.commands.run_session import SessionRequest, run_session
from boat_daq.engine.plan import built_in_plans
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, Unit, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings, serve
from boat_daq.errors import BoatDaqError, OperatorError

RECORDING = Path(__file__).resolve().parents[3] / "recordings" / "simulated_SA1_two_cycles.boat"


def test_a_refusal_under_json_is_an_object(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Error, cause and remedy on standard output, the same words on standard error, exit 1; without --json nothing
    is on standard output.
    """
    monkeypatch.setattr("boat_daq.cli.Interruption", lambda: None)
    arguments = ["boat-daq", "record", "--port", str(tmp_path / "none"), "--out", str(tmp_path / "run.boat")]
    for more in (["--json"], []):
        monkeypatch.setattr(sys, "argv", [*arguments, *more])
        with pytest.raises(SystemExit) as left:
            main()
        assert left.value.code == 1
        out, err = capsys.readouterr()
        assert "there is no port" in err
        if more:
            told = json.loads(out)
            assert told["error"] == "DeviceError"
            assert told["cause"] in err
            assert told["remedy"] in err
        else:
            assert out == ""
    assert not (tmp_path / "run.boat").exists()


def test_a_plan_outside_the_limits_leaves_no_recording(tmp_path: Path) -> None:
    """The limits are known before the first sample: nothing is created, and the name is free for the next try."""
    UnitLibrary().save(Unit("tender", min_kpa=-5.0, max_kpa=20.0))
    run = tmp_path / "run.boat"
    with serve(BoardSettings(speed=5.0), in_thread=True) as board, pytest.raises(BoatDaqError, match="limit"):
        run_session(SessionRequest(board.url, run, built_in_plans()["calibration"], unit="tender"))
    assert list(tmp_path.iterdir()) == []


def test_a_refusal_once_recording_says_what_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A pressed e-stop is seen by the first samples only: the short recording stays, and that is said."""
    run = tmp_path / "run.boat"
    pressed = BoardSettings(speed=5.0, faults=("estop@0:1000",))
    with serve(pressed, in_thread=True) as board, pytest.raises(OperatorError, match="e-stop"):
        run_session(SessionRequest(board.url, run, built_in_plans()["calibration"]))
    assert run.exists()
    assert f"{run} holds the samples until then" in capsys.readouterr().err


def test_a_link_that_only_listens_says_why(tmp_path: Path) -> None:
    """A replay cannot be commanded; the words are the link's own."""
    session = Session(Settings(), UnitLibrary(tmp_path))
    session.connect(f"replay:{RECORDING}@5")
    session.wait_connected()
    with pytest.raises(OperatorError, match="read only: a replay takes no commands"):
        session.arm(built_in_plans()["calibration"])
    session.close()
