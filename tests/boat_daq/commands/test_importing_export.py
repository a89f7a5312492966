"""`boat-daq export`: the samples of a run."""

from __future__ import annotations

from pathlib import Path

from tests.boat_daq.commands.calls import call, exit_code


def test_every_sample_is_exported(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """The CSV has one row a sample, and a JSON file of metadata."""
    found = call("export", stairs[0], "--format", "csv", "--out", tmp_path / "r.csv")
    rows = [line for line in (tmp_path / "r.csv").read_text().splitlines() if not line.startswith("#")]
    assert len(rows) == 1 + found["samples"]
    assert [Path(file).name for file in found["files"]] == ["r.csv", "r.json"]


def test_unknown_format_is_a_usage_error() -> None:
    """Exit code 2 before any file is read."""
    assert exit_code("export", "absent", "--format", "xml", "--out", "b") == 2
