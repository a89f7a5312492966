"""`boat-daq export`: the samples of a run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd

from analysis import load_recording
from tests.boat_daq.commands.calls import call, exit_code, program


def test_every_sample_is_exported(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """The CSV has one row a sample, and a JSON file of metadata."""
    found = call("export", stairs[0], "--format", "csv", "--out", tmp_path / "r.csv")
    rows = [line for line in (tmp_path / "r.csv").read_text().splitlines() if not line.startswith("#")]
    assert len(rows) == 1 + found["samples"]
    assert [Path(file).name for file in found["files"]] == ["r.csv", "r.json"]


def test_export_carries_elongation_and_its_uncertainty(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """By the run's own readings: columns in the CSV, where from in the metadata; imported again without."""
    target = tmp_path / "r.csv"
    found = call("export", stairs[0], "--format", "csv", "--out", target, "--elongation", stairs[1])
    assert found["calibration"]["unit"] == "SA1"
    assert found["elongation_void"] == ""
    rows = pd.read_csv(target, comment="#")
    assert rows["elongation_valid"].mean() > 0.9
    assert rows["elongation_mm"].between(-3.2, 4.2).mean() > 0.9
    assert (rows["u_mm"].dropna() > 0).all()
    columns = json.loads((tmp_path / "r.json").read_text())["columns"]
    assert (columns["elongation_mm"], columns["u_mm"], columns["elongation_valid"]) == ("mm", "mm", "1")
    np.testing.assert_array_equal(load_recording(target).signal_mv, load_recording(stairs[0]).signal_mv)


def test_run_without_readings_is_exported_without_elongation(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """The reason is on standard error and in the JSON."""
    ended = program("export", stairs[0], "--format", "mat", "--out", tmp_path / "r.mat")
    assert ended.code == 0
    assert "without elongation: no elongation was read in this run" in ended.err


def test_unknown_format_is_a_usage_error() -> None:
    """Exit code 2 before any file is read."""
    assert exit_code("export", "absent", "--format", "xml", "--out", "b") == 2
