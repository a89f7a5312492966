"""`boat-daq queue`: its file, its preview, and two runs on a virtual board."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from typer.testing import CliRunner

from boat_daq.cli import app
from boat_daq.engine.plan import Plan
from boat_daq.engine.run_queue import load_queue
from boat_daq.engine.simulator.server import BoardSettings
from protocol.base.errors import RequestError
from tests.boat_daq.engine.served_board import serve_in_thread

SHORT = Plan("short", "staircase", 1, high_kpa=10.0, low_kpa=0.0, step_kpa=10.0, ramp_kpa_per_s=50.0, max_dwell_s=3.0)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "short.toml").write_text(SHORT.to_toml())
    path = tmp_path / "queue.toml"
    path.write_text(
        '[[run]]\nplan = "short.toml"\nunit = "SA1"\n'
        '[[run]]\nplan = "short.toml"\nunit = "SA2"\npause_s = 0.3\nwait = "Mount SA2"\nname = "second_{unit}"\n'
    )
    return path


def test_the_preview_names_files_and_times(file: Path, tmp_path: Path) -> None:
    found = CliRunner().invoke(app, ["queue", str(file), "--preview", "--json", "--out", str(tmp_path)])
    rows = json.loads(found.stdout)["runs"]
    assert [Path(row["file"]).name for row in rows] == ["SA1_short_001.boat", "second_SA2.boat"]
    assert [row["wait"] for row in rows] == ["", "Mount SA2"]
    assert rows[0]["lasts_s"] > 0


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals")
def test_runs_follow_each_other_into_files_of_their_own(file: Path, tmp_path: Path) -> None:
    """Each unit's run is complete in its own recording; nobody is there to confirm, which `--yes` does."""
    with serve_in_thread(BoardSettings(speed=100.0)) as board:
        arguments = ["queue", str(file), "--port", board.url, "--out", str(tmp_path / "out"), "--json"]
        refused = CliRunner().invoke(app, arguments)
        assert refused.exit_code == 2
        found = CliRunner().invoke(app, [*arguments, "--yes"])
    content = json.loads(found.stdout.splitlines()[-1])
    assert [(run["unit"], run["complete_cycles"], run["failure"]) for run in content["runs"]] == [
        ("SA1", 1, ""),
        ("SA2", 1, ""),
    ]
    assert {path.name for path in (tmp_path / "out").glob("*.boat")} == {"SA1_short_001.boat", "second_SA2.boat"}


@pytest.mark.parametrize(
    "text",
    [
        "", "run = 1", "[[run]]\n", '[[run]]\nplan = "none"', '[[run]]\nplan = "calibration"\npause_s = -1',
        '[[run]]\nplan = "calibration"\nspeed = 1', '[other]\nx = 1\n[[run]]\nplan = "calibration"',
        '[[run]]\nplan = "calibration"\npause_s = 1e99', "[[run",
    ],
)  # fmt: skip
def test_a_queue_that_cannot_run_is_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "queue.toml"
    path.write_text(text)
    with pytest.raises(RequestError):
        load_queue(path)
