"""The shadow's alarms on virtual boards, healthy and faulty, in the real window under Xvfb."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.system.test_window_scenarios import ROOT, SHOTS, screen  # noqa: F401 - a fixture

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.timeout(240),
    pytest.mark.skipif(shutil.which("Xvfb") is None, reason="Xvfb is not installed: no screen to open a window on"),
]


@pytest.fixture
def watched(screen, tmp_path):  # noqa: F811 - the fixture above
    """Run cycles in a window of its own; return its alarms and rows."""

    def go(seed: int, cycles: int, *fault: str) -> dict[str, list[list[str]]]:
        folder = Path(os.environ.get(SHOTS, str(tmp_path)))
        folder.mkdir(parents=True, exist_ok=True)
        home = tmp_path / "home"
        home.mkdir()
        env = os.environ | {
            "DISPLAY": screen, "QT_QPA_PLATFORM": "xcb", "BOAT_DAQ_HOME": str(home), "PYTHONPATH": str(ROOT),
        }  # fmt: skip
        command = [sys.executable, "-m", "tests.system.window_shadow", str(folder), str(seed), str(cycles), *fault]
        done = subprocess.run(command, cwd=home, env=env, capture_output=True, text=True, timeout=220)
        assert done.returncode == 0, done.stdout + done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    return go


@pytest.mark.parametrize("seed", [21, 22])
def test_healthy_board_raises_no_alarm(watched, seed):
    """Thirty cycles of a healthy unit."""
    seen = watched(seed, 30)
    assert seen["cycles"] >= 29
    assert seen["alarms"] == []


def test_sensor_disagreement_is_named_and_dated(watched):
    """20 mV between the sensors from 300 s on: found within three cycles, with kind and first cycle."""
    seen = watched(23, 24, "sensor_disagreement@300:20")
    _, since, found = next(a for a in seen["alarms"] if a[0] == "sensor disagreement")
    assert 11 <= since <= 16
    assert since <= found <= since + 3
    assert any(row[0] == "Sensor disagreement" and row[1].startswith(f"cycle {since},") for row in seen["rows"])
