"""`boat-daq batch`: a folder of runs in one table."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from tests.boat_daq.commands.calls import call


def test_each_file_is_a_row_of_the_table(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """A run of one sensor is one row, and a file that is not a run a row with its reason."""
    found = call("batch", stairs[0].parent, "--workers", "1", "--out", tmp_path / "t.csv")
    assert found["runs"] == 2  # the elongation file is no run: it is a row with its reason
    assert found["failed"] == 1
    assert len(pd.read_csv(tmp_path / "t.csv")) == 2
