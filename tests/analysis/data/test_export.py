"""Exported samples: numbers unchanged, text neutralised, simulated runs marked."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis import load_recording
from analysis.data.export import export
from analysis.numbers import neutral
from tests.analysis.boat_builder import Plant, triangle, write_boat


@settings(deadline=None, max_examples=25)
@given(st.lists(st.floats(-1e6, 1e6), min_size=5, max_size=20))
def test_numbers_survive_export_and_import(tmp_path_factory: pytest.TempPathFactory, values: list[float]) -> None:
    """Every exported number is read again to the last bit."""
    folder = tmp_path_factory.mktemp("round")
    recording = Plant().run(np.asarray(values), np.zeros(len(values), bool), np.zeros(len(values)))
    export(recording, folder / "a.csv", "csv")
    again = load_recording(folder / "a.csv")
    np.testing.assert_array_equal(again.pressure_kpa, recording.pressure_kpa)
    np.testing.assert_array_equal(again.signal_mv, recording.signal_mv)


@pytest.mark.fault(49, 54, how="a formula for a note, in a simulated run", times=1)
def test_export_says_simulated_and_neutralises_text(tmp_path: Path) -> None:
    """Faults 49 and 54: the note is one cell that no spreadsheet runs; SIMULATED is in CSV, sidecar and Parquet."""
    meta = {"note": '=cmd|"/c calc",@x', "operator": "+1"}
    run = write_boat(tmp_path / "r.boat", Plant().run(*triangle(2, 5)), meta=meta)
    recording = load_recording(run)
    export(recording, tmp_path / "r.csv", "csv")
    lines = (tmp_path / "r.csv").read_text().splitlines()
    assert lines[0].startswith("# SIMULATED")
    import csv

    for cells in csv.reader(lines):
        assert not any(cell.startswith(("=", "@", "\t")) for cell in cells)
    assert json.loads((tmp_path / "r.json").read_text())["SIMULATED"] is True
    assert load_recording(tmp_path / "r.csv").simulated
    export(recording, tmp_path / "r.parquet", "parquet")
    import pyarrow.parquet as pq

    assert b"SIMULATED" in pq.read_metadata(tmp_path / "r.parquet").metadata
    frame = pd.read_parquet(tmp_path / "r.parquet")
    np.testing.assert_array_equal(frame["s1_mv"], recording.signal_mv[:, 0])
    assert neutral("=1+1") == "'=1+1"


def test_exported_comments_begin_with_a_hash_and_hold_no_cell(tmp_path: Path) -> None:
    """A reader that skips lines beginning with # meets the header next; a formula in a note stays inside its line."""
    from analysis.data.export import _comment

    line = _comment('note: "a,=1+1\\n"')
    assert line.startswith("# note")
    assert "," not in line
    assert line.count("\n") == 1


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_cancelled_export_leaves_the_one_before(tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It used to leave the first samples under the name that was chosen, and the export before was gone."""
    target, recording = tmp_path / f"r.{suffix}", Plant().run(*triangle(2, 5))
    target.write_text("the export before")

    def cancelled(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pyarrow.parquet.write_table", cancelled)
    with pytest.raises(KeyboardInterrupt):
        export(recording, target, "csv" if suffix == "csv" else "parquet", progress=cancelled)
    assert [file.name for file in tmp_path.iterdir()] == [target.name]
    assert target.read_text() == "the export before"
