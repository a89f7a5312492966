"""`boat-daq record`: refusals on the terminal and as JSON, and what they leave behind."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from boat_daq.engine.plan import built_in_plans
from boat_daq.engine.settings import Unit, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings
from boat_daq.workflows.run_session import SessionRequest, run_session
from protocol.base.errors import BoatDaqError, RequestError
from tests.boat_daq.commands.calls import program
from tests.boat_daq.engine.served_board import serve_in_thread

RECORDING = Path(__file__).resolve().parents[3] / "recordings" / "simulated_SA1_two_cycles.boat"


def test_refusal_with_json_is_an_object(tmp_path: Path) -> None:
    """Error, cause and remedy are on standard output and standard error; without --json standard output is empty."""
    arguments = ["record", "--port", tmp_path / "none", "--out", tmp_path / "run.boat"]
    for more in (["--json"], []):
        code, out, err = program(*arguments, *more)
        assert code == 1
        assert "there is no port" in err
        if more:
            printed = json.loads(out)
            assert printed["error"] == "DeviceError"
            assert printed["cause"] in err
            assert printed["remedy"] in err
        else:
            assert out == ""
    assert not (tmp_path / "run.boat").exists()


@pytest.mark.parametrize(
    ("options", "cause"),
    [
        (["--plan", "calibration", "--uncertainty", "0.08"], "needs --elongation or --camera"),
        (
            ["--plan", "repeatability", "--uncertainty", "0.08", "--camera", "0"],
            "applies to staircase plans; this one is continuous: it has no plateaus to read; set end_percent_fso",
        ),
        (["--plan", "step-test", "--uncertainty", "0.1"], "applies to staircase plans; this one is profile"),
        (["--uncertainty", "0.08", "--camera", "0"], "no plan is given"),
        (["--plan", "calibration", "--uncertainty", "0", "--camera", "0"], "an uncertainty of 0"),
        (["--plan", "calibration", "--uncertainty", "nan", "--camera", "0"], "give a number of mm above 0"),
    ],
)
def test_an_end_that_a_plan_cannot_have_is_refused(tmp_path: Path, options: list[str], cause: str) -> None:
    """Before the board is opened, and with the reason."""
    code, _, err = program("record", "--port", tmp_path / "none", "--out", tmp_path / "run.boat", *options)
    assert code != 0
    assert cause in " ".join(err.replace("│", " ").split())
    assert not (tmp_path / "run.boat").exists()


@pytest.mark.parametrize(
    "command",
    [
        ["record", "--plan", "calibration", "--uncertainty"],
        pytest.param(["demo", "--uncertainty"], marks=pytest.mark.nightly),
    ],
)
def test_a_wrong_end_is_refused_at_once(command: list[str]) -> None:
    """Without loading the analysis, which takes seconds, and before anything is opened."""
    words = [*command, "nan", *(["--port", "none"] if command[0] == "record" else [])]
    code = (
        "import sys; from tests.boat_daq.commands.calls import program; "
        f"ended = program(*{words!r}); assert ended.code != 0; print(ended.err); "
        "late = {'analysis.figures', 'boat_daq.engine.session.session', 'boat_daq.engine.simulator.server'}; "
        "assert not late & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert "an uncertainty of nan" in done.stdout


def test_a_run_that_ends_with_its_plan_states_what_it_reached(tmp_path: Path) -> None:
    """The last cycles are assessed too: too few for an interval, and no end at 0.5 % FSO."""
    own = tmp_path / "own.toml"
    own.write_text(replace(built_in_plans()["repeatability"], end_percent_fso=0.5).to_toml())
    plan = ["--plan", own, "--cycles", "2", "--ramp", "40"]
    with serve_in_thread(BoardSettings(speed=10.0)) as board:
        code, out, err = program("record", "--port", board.url, *plan, "--out", tmp_path / "run.boat", "--json")
    assert code == 0
    end = json.loads(out)["end_uncertainty"]
    assert (end["asked"], end["unit"], end["reached"]) == (0.5, "% FSO", False)
    assert "0.5 % FSO asked: not reached" in end["text"]
    assert err.count(end["text"]) == 1


def test_plan_outside_the_limits_leaves_no_recording(tmp_path: Path) -> None:
    """The limits are known before the first sample, so no file is created."""
    UnitLibrary().save(Unit("tender", min_kpa=-5.0, max_kpa=20.0))
    run = tmp_path / "run.boat"
    with serve_in_thread(BoardSettings(speed=5.0)) as board, pytest.raises(BoatDaqError, match="limit"):
        run_session(SessionRequest(board.url, run, built_in_plans()["calibration"], unit="tender"))
    assert list(tmp_path.iterdir()) == []


def test_refusal_while_recording_reports_the_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A pressed e-stop is known only from the first samples: the short recording is kept, and named."""
    run = tmp_path / "run.boat"
    pressed = BoardSettings(speed=5.0, faults=("estop@0:1000",))
    with serve_in_thread(pressed) as board, pytest.raises(RequestError, match="e-stop"):
        run_session(SessionRequest(board.url, run, built_in_plans()["calibration"]), notify=print)
    assert run.exists()
    assert f"{run} holds the samples until then" in capsys.readouterr().out
