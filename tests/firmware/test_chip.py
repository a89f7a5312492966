"""The firmware on an emulated chip, at the program's port: found, recorded, regulated."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from analysis import load_recording
from boat_daq.engine.link.opening import identify_port
from boat_daq.engine.settings import Settings, save_settings
from protocol.link.messages import AckStatus, Heartbeat, SetPressure, Start, Stop
from protocol.recording import BoardState
from tests.firmware.emulated_chip import ChipHost, compile_board, emulated, needs_chip

pytestmark = needs_chip

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the program of the board."""
    return compile_board(tmp_path_factory.mktemp("chip"))


def test_chip_is_identified_and_regulates(program: Path) -> None:
    """`identify_port` knows it; at 1 kHz no index is missing while the pressure goes to 5 kPa."""
    with emulated(program) as chip:
        found = identify_port(chip.url)
        assert found.hello is not None
        assert found.hello.board_id == "SIMULATED-M3"
        with closing(ChipHost(chip)) as host:
            for command in (Heartbeat(5000), Start(1000), SetPressure(5_000, 40_000)):
                assert getattr(host.command(command), "status", None) == AckStatus.DONE
            host.until(lambda _: bool(host.kept_samples) and host.kept_samples[-1].state == BoardState.HOLDING)
            host.command(Stop())
            samples = host.kept_samples
    assert [sample.index for sample in samples] == list(range(len(samples)))
    assert [sample.time_us - samples[0].time_us for sample in samples] == pytest.approx(
        [1000 * i for i in range(len(samples))], abs=200
    )
    assert samples[-1].pressure_pa == pytest.approx(5_000, abs=500)


@pytest.mark.nightly
@pytest.mark.parametrize("rate_hz", [100, 1000])
def test_ten_minutes_of_calibration_are_recorded(program: Path, tmp_path: Path, rate_hz: int) -> None:
    """The calibration plan in the chip's real time: 0 lost, identical, its plateaus at the plan's pressures."""
    run = tmp_path / "run.boat"
    save_settings(Settings(rate_hz=rate_hz), tmp_path)
    options = ["--plan", "calibration", "--cycles", "10", "--out", str(run), "--json"]
    with emulated(program) as chip:
        command = [sys.executable, "-m", "boat_daq", "record", "--port", chip.url, *options]
        done = subprocess.run(
            command, capture_output=True, text=True, cwd=ROOT, timeout=3000,
            env=os.environ | {"BOAT_DAQ_HOME": str(tmp_path)},
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert (summary["stop_reason"], summary["lost_samples"], summary["gaps"]) == ("finished", 0, 0)
    assert summary["cycles"] == {"complete": 10, "partial": 0}
    assert summary["duration_s"] > 600
    assert summary["samples"] == pytest.approx(rate_hz * summary["duration_s"], abs=2)
    check_plateaus(run, cycles=10)
    verified = subprocess.run(
        [sys.executable, "-m", "boat_daq", "verify", str(run), "--json"], capture_output=True, text=True, cwd=ROOT
    )
    assert json.loads(verified.stdout)["identical"] is True


def check_plateaus(run: Path, *, cycles: int) -> None:
    """Check that each plateau holds its pressure, and the light that the simulated actuator gives at it."""
    recording = load_recording(run)
    reached = recording.steps[(recording.steps.status == "reached") & (recording.steps.branch != "end")]
    down, up = range(40, -50, -10), range(-30, 60, 10)
    assert [int(target) for target in reached.target_kpa] == [50, *([*down, *up] * cycles)]
    for step in reached.itertuples():
        held = (recording.time_s >= step.settled_s) & (recording.time_s <= step.ended_s)
        assert np.mean(recording.pressure_kpa[held]) == pytest.approx(step.target_kpa, abs=0.1)
        signal = np.mean(recording.lit[held, :2] - recording.dark[held, :2].astype(float), axis=0)
        expected = [1600 + slope * step.target_kpa for slope in (3.2, 2.3)]
        np.testing.assert_allclose(signal, expected, atol=2.0)
