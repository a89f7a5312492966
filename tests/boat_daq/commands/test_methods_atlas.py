"""`boat-daq atlas`: maps written, errors reported."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from analysis.studies.failure_maps.sweep import Axis, Study, StudyResult
from boat_daq.cli import app
from protocol.base.errors import DataError


def ladder(x: float, y: float) -> StudyResult:
    """Right below 2, a warning from 2, refused from 3; wrong without warning where x and y are 1."""
    if x >= 3:
        raise DataError("too far", "Come back.")
    return StudyResult(5.0 if x == y == 1 else 0.0, "far" if x >= 2 else "")


def ladder_study() -> Study:
    return Study(
        "ladder-x", "ladder", "A ladder", "itself", "mm", 1.0, Axis("x", "mm", (0, 1, 2, 3)),
        Axis("y", "", (0, 1), ("none", "one")), ladder,
    )  # fmt: skip


def test_the_command_writes_and_ends_well(tmp_path: Path) -> None:
    """`atlas inverse --json` prints the maps and leaves pictures."""
    ran = CliRunner().invoke(app, ["atlas", "inverse", "--out", str(tmp_path), "--json"])
    assert ran.exit_code == 0, ran.output
    content = json.loads(ran.stdout)
    assert [m["name"] for m in content["maps"]] == ["inverse-turning"]
    assert (tmp_path / "calibration.svg").is_file()


def test_a_number_wrong_without_warning_fails_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error names the first such point."""
    monkeypatch.setattr("analysis.studies.failure_maps.maps.chosen_studies", lambda _names: [ladder_study()])
    ran = CliRunner().invoke(app, ["atlas", "--out", str(tmp_path)])
    assert ran.exit_code == 1
    assert "1 results are wrong without a warning, the first in ladder-x" in str(ran.exception)
