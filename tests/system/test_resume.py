"""A run broken by SIGKILL or an unplugged board is resumed in its own recording, over a real pseudo-terminal."""

from __future__ import annotations

import dataclasses
import json
import os
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis import analyse, load_recording
from analysis.segmentation.cycles import find_cycles
from boat_daq.commands.record import record
from boat_daq.commands.recordings import info
from boat_daq.engine.plan import built_in_plans
from boat_daq.engine.recording.resumption import prepare_resumption, read_broken_run
from boat_daq.engine.recording.summary import summarise
from boat_daq.engine.recording.verify import verify_recording
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.engine.simulator.server import BoardSettings, ServedBoard, serve
from protocol.base.errors import BoatDaqError, DeviceError, RequestError
from protocol.recording import open_recording
from tests.boat_daq.engine.served_board import serve_in_thread
from tests.conftest import reached

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")

ROOT = Path(__file__).resolve().parents[2]
CYCLES = 8
RUN = ["--plan", "repeatability", "--cycles", str(CYCLES), "--ramp", "40"]
SPEED = 15.0
CHUNKS = "SELECT id, host_ns, direction, raw FROM chunk ORDER BY id"


def reached_cycles(path: Path) -> int:
    """Return the number of complete cycles in the file, as any reader sees it while it is written."""
    if not path.exists() or not path.stat().st_size:
        return 0
    try:
        with closing(sqlite3.connect(f"{path.as_uri()}?mode=ro", uri=True)) as db:
            sql = "SELECT count(*) FROM step WHERE status = 'reached' AND branch = 'loading' AND target_kpa = 50"
            return int(db.execute(sql).fetchone()[0])
    except sqlite3.Error:
        return 0


def started_run(board: ServedBoard, run: Path) -> subprocess.Popen[str]:
    """Record until two cycles are complete and the third has begun."""
    command = [
        sys.executable,
        "-m",
        "boat_daq",
        "record",
        "--port",
        board.url,
        "--unit",
        "SA1",
        *RUN,
        "--out",
        str(run),
    ]
    process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while reached_cycles(run) < 2 and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.02)
    if reached_cycles(run) < 2 or process.poll() is not None:
        process.kill()
        raise AssertionError(f"the run had not begun: {process.communicate(timeout=30)[1]}")
    return process


def rows(path: Path, sql: str) -> list[tuple[Any, ...]]:
    with closing(open_recording(path)) as db:
        return db.execute(sql).fetchall()


def resume(run: Path, port: str, capsys: pytest.CaptureFixture[str], **options: Any) -> dict[str, Any]:
    """Run `record --resume --json` and return its object."""
    capsys.readouterr()
    record(port=port, resume=run, as_json=True, **options)
    content: dict[str, Any] = json.loads(capsys.readouterr().out)
    return content


def test_killed_run_is_resumed_with_all_its_cycles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All cycles are there, earlier rows are unchanged byte for byte, the whole is identical to its bytes;
    the break is reported by record, by info and in the file. Another unit or plan, and a finished run, are refused.
    """
    run = tmp_path / "run.boat"
    with serve(BoardSettings(speed=SPEED)) as board:
        process = started_run(board, run)
        process.kill()
        process.communicate(timeout=30)
        before, steps_before = rows(run, CHUNKS), rows(run, "SELECT * FROM step ORDER BY id")
        wrong: tuple[tuple[dict[str, Any], str], ...] = (
            ({"unit": "SA2"}, "was recorded with unit SA1, not SA2"),
            ({"cycles": 9}, "cycles 8, not 9"),
            ({"plan": "calibration"}, "has name repeatability, not calibration"),
        )
        for options, cause in wrong:
            with pytest.raises(BoatDaqError, match=cause):
                record(port=board.url, resume=run, **options)
        assert rows(run, CHUNKS) == before
        content = resume(run, board.url, capsys)
    (broken,) = content["breaks"]
    assert (content["status"], content["stop_reason"]) == ("closed", "finished")
    assert content["cycles"]["complete"] == CYCLES
    assert broken["cause"] == "interrupted"
    assert broken["complete_cycles"] + content["cycles"]["partial"] + 1 == broken["first_cycle"]
    assert rows(run, CHUNKS)[: len(before)] == before
    assert rows(run, "SELECT * FROM step ORDER BY id")[: len(steps_before)] == steps_before
    numbers = [n for (n,) in rows(run, "SELECT id FROM step ORDER BY id")]
    assert numbers == list(range(1, len(numbers) + 1))
    assert verify_recording(run).difference == ""
    info(run)
    assert f"interrupted after {broken['complete_cycles']} complete cycle" in capsys.readouterr().out
    with pytest.raises(RequestError, match=f"has all its {CYCLES} cycles"):
        record(port="/dev/none", resume=run)
    recording = load_recording(run)
    assert np.all(np.diff(recording.time_s) > 0)
    assert len(find_cycles(recording).used) == CYCLES


@pytest.mark.nightly
def test_unplugged_run_is_resumed_at_the_same_board_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A lost board ends the run with a failure that names the command to resume; another board is refused by its
    identity, and the file stays as it is. The board that is back has restarted its clock, and its second sensor reads
    20 mV more: the analysis reports the difference and does not pool.
    """
    run = tmp_path / "run.boat"
    with serve(BoardSettings(speed=SPEED)) as board:
        process = started_run(board, run)
    _, messages = process.communicate(timeout=60)
    assert process.returncode == 1
    assert f"record --resume {run}" in messages
    content = run.read_bytes()
    with (
        serve_in_thread(BoardSettings(speed=SPEED, unit="SA2")) as other,
        pytest.raises(DeviceError, match="board SIMULATED-SA1"),
    ):
        record(port=other.url, resume=run)
    assert run.read_bytes() == content
    with serve_in_thread(BoardSettings(speed=SPEED, faults=("sensor_disagreement@0:20",))) as board:
        content = resume(run, board.url, capsys, note="plugged in again")
    assert content["cycles"]["complete"] == CYCLES
    assert content["breaks"][0]["cause"].startswith("aborted")
    assert content["breaks"][0]["note"] == "plugged in again"
    assert verify_recording(run).difference == ""
    figures = analyse(run, mcmc=False).to_json()
    (found,) = figures["breaks"]
    assert (found["verdict"], found["pooled"]) == ("differs", False)
    changed = {(c["sensor"], c["quantity"]) for c in found["comparisons"] if c["significant"]}
    assert ("s2", "level") in changed
    assert len(figures["parts"]) == 2


def test_finished_run_cannot_be_resumed() -> None:
    """It is refused with the reason, before any port is opened."""
    with pytest.raises(RequestError, match="all its 2 cycles"):
        read_broken_run(ROOT / "recordings" / "simulated_SA1_two_cycles.boat")


def test_run_is_resumed_in_a_connected_session(tmp_path: Path) -> None:
    """`resume_recording` while samples arrive: earlier steps are there, another plan and a run from the start are
    refused, and the run is armed at its next whole cycle.
    """
    run = tmp_path / "run.boat"
    plan = dataclasses.replace(built_in_plans()["repeatability"], cycles=CYCLES, ramp_kpa_per_s=40.0)
    with serve_in_thread(BoardSettings(speed=SPEED)) as board:
        session = Session(Settings(), UnitLibrary(tmp_path))
        session.connect(board.url, record_to=run)
        session.wait_connected()
        session.arm(plan)
        session.start()
        reached(session, lambda s: s.progress is not None and s.progress.cycle == 2, 30)
        session.stop_recording()
        broken = prepare_resumption(run)
        session.resume_recording(broken)
        assert [step.number for step in session.steps()] == [mark.number for mark in broken.marks]
        with pytest.raises(RequestError, match="cycles 8, not 9"):
            session.arm(dataclasses.replace(plan, cycles=9), resume=True)
        with pytest.raises(RequestError, match="holds an interrupted run"):
            session.arm(plan)
        session.arm(plan, resume=True)
        session.start()
        seen = reached(session, lambda s: s.progress is not None and s.progress.cycle == broken.first_cycle, 30)
        session.close()
    assert seen.progress is not None
    assert seen.progress.complete_cycles == broken.complete_cycles
    assert [found.first_cycle for found in summarise(run).breaks] == [broken.first_cycle]
    assert verify_recording(run).difference == ""
