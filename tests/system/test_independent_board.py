"""The whole program against a board that shares no code with it: over a real port, into a file and out again."""

from __future__ import annotations

import csv
import json
import sqlite3
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis import load_recording
from tests.boat_daq.commands.calls import call
from tests.system.independent_board import CUBICS

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are needed")

ROOT = Path(__file__).resolve().parents[2]
BOARD = Path(__file__).with_name("independent_board.py")
SENT = np.dtype(
    [
        ("index", "<u4"),
        ("time_us", "<u4"),
        ("pressure_pa", "<i4"),
        ("state", "u1"),
        ("flags", "u1"),
        ("lit_dark", "<u2", (2, 2)),
    ]
)
SLOW_PLAN = """
name = "short"
kind = "staircase"
cycles = 1
high_kpa = 20.0
low_kpa = -20.0
step_kpa = 20.0
ramp_kpa_per_s = 40.0
settling_s = 0.3
window_s = 0.4
min_dwell_s = 0.8
"""


@dataclass(frozen=True)
class Session:
    """What a board sent, and the recording of it."""

    run: Path
    sent: np.ndarray[Any, Any]
    truth: np.ndarray[Any, Any]
    summary: dict[str, Any]


def record(folder: Path, board: Sequence[str], plan: Sequence[str]) -> Session:
    """Start a board, record a plan from it, and stop it."""
    sent, truth, run = folder / "sent.bin", folder / "truth.csv", folder / "run.boat"
    command = [sys.executable, str(BOARD), "--sent", str(sent), "--truth", str(truth), *board]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            port = process.stdout.readline().strip()
            program = [sys.executable, "-m", "boat_daq", "record", "--port", port, *plan, "--out", str(run), "--json"]
            done = subprocess.run(program, capture_output=True, text=True, timeout=120, cwd=ROOT, check=False)
        finally:
            process.kill()
    assert done.returncode == 0, done.stderr
    return Session(run, np.fromfile(sent, SENT), np.loadtxt(truth, delimiter=",", ndmin=2), json.loads(done.stdout))


@pytest.fixture(scope="module", params=["rising", pytest.param("falling", marks=pytest.mark.nightly)])
def fast(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Session]]:
    """A calibration of two cycles at 50 times real time."""
    board = ["--speed", "50", "--polarity", request.param]
    plan = ["--plan", "calibration", "--cycles", "2"]
    yield request.param, record(tmp_path_factory.mktemp(request.param), board, plan)


def check_every_sample(session: Session) -> None:
    """Compare what was sent with what is in the file, field by field."""
    recording = load_recording(session.run)
    sent = session.sent
    assert session.summary["lost_samples"] == 0
    assert recording.n == sent.size
    np.testing.assert_array_equal(np.round(recording.pressure_kpa * 1000), sent["pressure_pa"])
    np.testing.assert_array_equal(recording.lit, sent["lit_dark"][:, :, 0])
    np.testing.assert_array_equal(recording.dark, sent["lit_dark"][:, :, 1])
    np.testing.assert_array_equal(recording.state, sent["state"])
    assert call("verify", session.run)["identical"] is True


def test_every_sample_sent_at_50x_is_in_the_file(fast: tuple[str, Session]) -> None:
    """Every sample between START and STOP is recorded, unchanged, and derives again from the raw bytes."""
    check_every_sample(fast[1])


@pytest.mark.nightly
def test_every_sample_sent_at_1x_is_in_the_file(tmp_path: Path) -> None:
    """The same in real time, with a plan from a file."""
    plan = tmp_path / "short.toml"
    plan.write_text(SLOW_PLAN)
    session = record(tmp_path, ["--speed", "1"], ["--plan", str(plan)])
    assert session.summary["stop_reason"] == "finished"
    check_every_sample(session)


def write_readings(session: Session, path: Path) -> None:
    """Write the board's own elongation at each plateau, in the order of the run."""
    with closing(sqlite3.connect(session.run)) as db, db:
        query = "SELECT target_kpa, settled_us, ended_us FROM step WHERE branch != 'end' ORDER BY id"
        steps = db.execute(query).fetchall()
    time_us, x_mm = session.truth.T
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["pressure_kpa", "elongation_mm"])
        for target_kpa, settled_us, ended_us in steps:
            writer.writerow([target_kpa, x_mm[(time_us >= settled_us) & (time_us <= ended_us)].mean()])


def test_falling_calibrates_as_well_as_rising(fast: tuple[str, Session], tmp_path: Path) -> None:
    """The fit finds the board's own cubics: b0 within 1 mV, sensitivity within 1 %, R2 above 0.999."""
    polarity, session = fast
    readings = tmp_path / "readings.csv"
    write_readings(session, readings)
    arguments = ["--elongation", readings, "--x-resolution", "0", "--no-mcmc"]
    content = call("analyze", session.run, *arguments)
    assert content["cycles"]["complete"] == 2
    assert content["simulated"] is False
    for sensor, cubic in zip(content["sensors"], CUBICS[polarity], strict=True):
        fit = sensor["calibration"]
        low, high = fit["range"]
        ends = np.polynomial.polynomial.polyval([low, high], cubic)
        assert fit["coefficients"][0] == pytest.approx(cubic[0], abs=1.0)
        assert sensor["sensitivity_mv_per_mm"] == pytest.approx(abs(ends[1] - ends[0]) / (high - low), rel=0.01)
        assert fit["r2"] > 0.999
        assert fit["monotone"] is True
