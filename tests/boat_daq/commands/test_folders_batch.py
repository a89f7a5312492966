"""`boat-daq batch`: a folder of runs in one table."""

from __future__ import annotations

import shutil
from pathlib import Path

import pandas as pd

from tests.boat_daq.commands.calls import call, program


def test_tables_that_are_no_runs_are_left_out(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """A run of one sensor is one row; readings, and the table of an earlier batch, are named and not analysed."""
    for path in stairs:
        shutil.copy(path, tmp_path)
    (tmp_path / "fit.csv").write_text("x,y\n1,2\n2,3\n", encoding="utf-8")
    for omitted in ([], ["t.csv"]):
        found = call("batch", tmp_path, "--workers", "1", "--out", tmp_path / "t.csv")
        assert (found["runs"], found["failed"]) == (1, 0)
        assert found["omitted"] == sorted([*omitted, "fit.csv", stairs[1].name])
    assert len(pd.read_csv(tmp_path / "t.csv")) == 1


def test_a_run_that_fails_fails_the_batch(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """Exit code 1, the table of the others, and the reason in a line of its own."""
    shutil.copy(stairs[0], tmp_path)
    (tmp_path / "bad.boat").write_text("no recording", encoding="utf-8")
    ended = program("batch", tmp_path, "--workers", "1")
    assert ended.code == 1
    assert "bad.boat: " in ended.out and "run.boat" in ended.out
    assert max(map(len, ended.out.splitlines()[:2])) <= 80
