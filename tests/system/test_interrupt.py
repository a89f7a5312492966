"""Ending a run early: SIGINT, SIGTERM and a closed terminal vent and close.

SIGKILL leaves a vented board and a recoverable file.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from boat_daq.engine.simulator.server import BoardSettings, ServedBoard, serve
from tests.boat_daq.commands.calls import call, program

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are needed")

ROOT = Path(__file__).resolve().parents[2]
PRESSED_KPA = 5.0


@pytest.fixture
def board(tmp_path: Path) -> Iterator[ServedBoard]:
    """A virtual board at 10 times real time that writes its truth."""
    with serve(BoardSettings(speed=10.0, truth=str(tmp_path / "truth.csv"))) as served:
        yield served


def truth(folder: Path) -> np.ndarray[Any, Any]:
    """Return the board's own pressure, kPa, at each of its samples so far."""
    lines = (folder / "truth.csv").read_text().splitlines()[2:-1]
    return np.array([float(line.split(",")[3]) for line in lines])


def recording(board: ServedBoard, folder: Path) -> list[str]:
    options = ["--port", board.url, "--plan", "calibration", "--out", str(folder / "run.boat")]
    return [sys.executable, "-m", "boat_daq", "record", *options]


def start_under_pressure(board: ServedBoard, folder: Path) -> subprocess.Popen[str]:
    """Start a calibration and wait until the unit is under pressure."""
    process = subprocess.Popen(recording(board, folder), cwd=ROOT, stderr=subprocess.PIPE, text=True)
    return under_pressure(process, folder)


def under_pressure(process: subprocess.Popen[str], folder: Path) -> subprocess.Popen[str]:
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        pressure = truth(folder)
        if pressure.size and pressure[-1] > PRESSED_KPA:
            return process
        time.sleep(0.05)
    process.kill()
    raise AssertionError("the unit was never pressurised")


@pytest.mark.parametrize("number", [pytest.param(signal.SIGINT, marks=pytest.mark.nightly), signal.SIGTERM])
def test_signal_vents_and_closes(number: int, board: ServedBoard, tmp_path: Path) -> None:
    """Exit 130, the unit vented, one closed file, identical to its bytes."""
    process = start_under_pressure(board, tmp_path)
    process.send_signal(number)
    process.communicate(timeout=60)
    check_ended(process, tmp_path)


ON_TERMINAL = """
import fcntl, os, signal, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
if sys.argv[1] == "nohup":
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    for descriptor in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)
os.execv(sys.argv[2], sys.argv[2:])
"""


@pytest.mark.fault(61, how="a terminal closed while `record` holds a pressure", times=1)
@pytest.mark.parametrize("how", ["heeded", pytest.param("nohup", marks=pytest.mark.nightly)])
def test_closed_terminal_vents_and_closes(board: ServedBoard, tmp_path: Path, how: str) -> None:
    """SIGHUP ended the program at once; as under nohup, it records on."""
    ours, theirs = os.openpty()
    command = [sys.executable, "-c", ON_TERMINAL, how, *recording(board, tmp_path)]
    process = subprocess.Popen(
        command, cwd=ROOT, stdin=theirs, stdout=theirs, stderr=theirs, start_new_session=True, text=True
    )
    os.close(theirs)
    under_pressure(process, tmp_path)
    os.close(ours)  # what closing a terminal's window does
    if how == "nohup":
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(5)
        process.terminate()
    process.wait(60)
    check_ended(process, tmp_path)


def check_ended(process: subprocess.Popen[str], tmp_path: Path) -> None:
    """Exit 130, the unit vented, one closed file, identical to its bytes."""
    assert process.returncode == 130
    assert abs(truth(tmp_path)[-1]) < 1.0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.boat", "truth.csv"]
    assert call("info", tmp_path / "run.boat")["status"] == "closed"
    assert program("verify", tmp_path / "run.boat").code == 0


@pytest.mark.fault(18, 30, how="`record` killed with -9 under pressure on a pseudo-terminal", times=1)
def test_killed_host_leaves_a_vented_board_and_a_recoverable_file(board: ServedBoard, tmp_path: Path) -> None:
    """The board vents by its own watchdog; the file is interrupted, recovers and verifies."""
    process = start_under_pressure(board, tmp_path)
    process.kill()
    process.communicate(timeout=60)
    run = tmp_path / "run.boat"
    assert call("info", run)["status"] == "interrupted"
    time.sleep(1.6)  # 16 s of board time: its watchdog of 5 s, and the return to zero
    assert abs(truth(tmp_path)[-1]) < 1.0
    for command in ("recover", "verify"):
        done = program(command, run)
        assert done.code == 0, done.err
    after = call("info", run)
    assert after["status"] == "recovered"
    assert after["samples"] > 0
    next_run = ["record", "--port", board.url, "--plan", "repeatability", "--cycles", "1", "--ramp", "40"]
    done = program(*next_run, "--out", tmp_path / "next.boat")
    assert done.code == 0, done.err
    assert "vented" in done.err
