"""`boat-daq import`: a CSV file as a recording."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.boat_daq.commands.calls import call, exit_code


def test_exported_samples_are_imported_without_a_map(stairs: tuple[Path, Path], tmp_path: Path) -> None:
    """The preview recognises every column, and every sample is imported."""
    exported = call("export", stairs[0], "--format", "csv", "--out", tmp_path / "r.csv")
    assert call("import", tmp_path / "r.csv", "--preview")["missing"] == []
    assert call("import", tmp_path / "r.csv", "--out", tmp_path / "r.boat")["samples"] == exported["samples"]


@pytest.mark.parametrize("options", [(), ("--map", "pressure_kpa", "--preview"), ("--map", "=3", "--preview")])
def test_missing_destination_and_malformed_map_are_usage_errors(options: tuple[str, ...], tmp_path: Path) -> None:
    """Exit code 2."""
    (tmp_path / "a.csv").write_text("time_s,pressure_kpa,s1_mv\n0,1,2\n")
    assert exit_code("import", tmp_path / "a.csv", *options) == 2


def test_the_time_of_a_run_is_stated_or_not_known(tmp_path: Path) -> None:
    """Not the time of the import: nothing without a statement; `--started` and `--unit` are kept, the end follows."""
    (tmp_path / "a.csv").write_text("time_s,pressure_kpa,s1_mv\n" + "".join(f"{k},{k},{k}\n" for k in range(61)))
    call("import", tmp_path / "a.csv", "--out", tmp_path / "a.boat")
    unknown = call("info", tmp_path / "a.boat")
    assert (unknown["started_utc"], unknown["ended_utc"], unknown["unit"]) == ("", None, "")
    stated = ("--started", "2026-01-31T14:05:00+0100", "--unit", "SA1")
    call("import", tmp_path / "a.csv", "--out", tmp_path / "b.boat", *stated)
    known = call("info", tmp_path / "b.boat")
    assert known["started_utc"] == "2026-01-31T13:05:00+00:00"
    assert known["ended_utc"] == "2026-01-31T13:06:00+00:00"
    assert known["unit"] == "SA1"
    assert exit_code("import", tmp_path / "a.csv", "--out", tmp_path / "c.boat", "--started", "yesterday") == 2
