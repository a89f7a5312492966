"""The whole program records from the firmware over a real port: the file has every sample that was sent."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from analysis import load_recording
from boat_daq.cli import app
from protocol.link.messages import BoardEvent, EventCode
from tests.firmware.board_pair import Messages, messages_of
from tests.firmware.firmware_build import compile_host

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are needed")

ROOT = Path(__file__).resolve().parents[2]
SHORT_PLAN = """
name = "short"
kind = "staircase"
cycles = 1
high_kpa = 10.0
low_kpa = -10.0
step_kpa = 20.0
ramp_kpa_per_s = 40.0
settling_s = 0.2
window_s = 0.3
min_dwell_s = 0.5
"""


@dataclass(frozen=True, slots=True)
class Session:
    """What the firmware sent, and the recording of it."""

    run: Path
    messages: Messages
    summary: dict[str, Any]


@pytest.fixture(scope="module")
def board_program(firmware_folder: Path) -> Path:
    """Return the program of the firmware on a pseudo-terminal."""
    return compile_host(firmware_folder, "pty_board", "host.c", "pty_board.c")


def program(*arguments: str) -> dict[str, Any]:
    """Run boat-daq with --json and return its object."""
    command = [sys.executable, "-m", "boat_daq", *arguments, "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    content: dict[str, Any] = json.loads(done.stdout)
    return content


def record(board_program: Path, folder: Path, speed: int, *plan: str) -> Session:
    """Record a plan from the firmware."""
    run, sent = folder / "run.boat", folder / "sent.bin"
    with subprocess.Popen([str(board_program), str(speed), str(sent)], stdout=subprocess.PIPE, text=True) as board:
        try:
            assert board.stdout is not None
            port = board.stdout.readline().strip()
            summary = program("record", "--port", port, *plan, "--out", str(run))
            assert board.poll() is None, "a sanitizer has ended the board"
        finally:
            board.kill()
    return Session(run, messages_of(sent.read_bytes()), summary)


def check(session: Session) -> None:
    """Check that the plan ended without a loss and that the file holds every sample as it was sent."""
    summary, samples = session.summary, session.messages.samples
    recording = load_recording(session.run)
    assert (summary["stop_reason"], summary["lost_samples"], summary["cycles"]["complete"]) == ("finished", 0, 1)
    assert [message.code for message in session.messages.others if isinstance(message, BoardEvent)] == [
        EventCode.BOOTED
    ]
    assert [sample.index for sample in samples] == list(range(recording.n))
    np.testing.assert_array_equal(np.round(recording.pressure_kpa * 1000), [s.pressure_pa for s in samples])
    np.testing.assert_array_equal(recording.lit, [s.lit for s in samples])
    np.testing.assert_array_equal(recording.dark, [s.dark for s in samples])
    np.testing.assert_array_equal(recording.state, [s.state for s in samples])
    verified = CliRunner().invoke(app, ["verify", str(session.run), "--json"])
    assert json.loads(verified.stdout)["identical"] is True


def test_short_plan_is_recorded_in_real_time(board_program: Path, tmp_path: Path) -> None:
    """At 1x: three plateaus regulated by the firmware's own loop, recorded, identical when derived again."""
    plan = tmp_path / "short.toml"
    plan.write_text(SHORT_PLAN, encoding="utf-8")
    check(record(board_program, tmp_path, 1, "--plan", str(plan)))


def test_calibration_is_recorded_at_50x(board_program: Path, tmp_path: Path) -> None:
    """The calibration plan's cycle of 19 plateaus at 50 times real time."""
    check(record(board_program, tmp_path, 50, "--plan", "calibration", "--cycles", "1"))
