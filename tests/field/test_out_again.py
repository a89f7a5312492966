"""Exported samples open elsewhere without an option."""

from __future__ import annotations

import csv
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis.data.csv_import import import_csv
from analysis.data.export import export
from analysis.data.recording import Recording
from tests.field.truth import Run, put


@pytest.fixture(params=[True, False], ids=["simulated", "measured"])
def recording(request: pytest.FixtureRequest, tmp_path: Path, run: Run) -> Recording:
    """Return a run with a note that would be a formula."""
    found = import_csv(put(tmp_path, run.lines()))
    return replace(found, meta={**found.meta, "simulated": request.param, "note": "=1+1", "unit": "SA1"})


def test_a_csv_has_one_header_row(tmp_path: Path, recording: Recording) -> None:
    """pandas, NumPy and the csv module of Python read it by their defaults, and so does polars where it is."""
    path = tmp_path / "out.csv"
    export(recording, path, "csv")
    frame = pd.read_csv(path)
    np.testing.assert_array_equal(frame["s1_mv"], recording.signal_mv[:, 0])
    assert ("simulated" in frame) is recording.simulated
    with path.open(newline="") as file:
        assert {len(row) for row in csv.reader(file)} == {frame.shape[1]}
    np.testing.assert_array_equal(np.genfromtxt(path, delimiter=",", names=True)["s1_mv"], frame["s1_mv"])
    again = import_csv(path)
    assert (again.unit, again.simulated) == ("SA1", recording.simulated)


def test_a_column_that_begins_empty_has_numbers(tmp_path: Path, recording: Recording) -> None:
    """A target that is set after 500 samples: polars, which looks at 100, takes it as numbers; it is never zero."""
    late = replace(recording, target_kpa=np.where(np.arange(recording.n) < 500, np.nan, 20.0))
    export(late, tmp_path / "out.csv", "csv")
    rows = (tmp_path / "out.csv").read_text().splitlines()
    assert [row.split(",")[3] for row in (rows[1], rows[2], rows[501])] == ["NaN", "", "20.0"]
    assert pd.read_csv(tmp_path / "out.csv")["target_kpa"].count() == recording.n - 500
    polars = pytest.importorskip("polars")
    read = polars.read_csv(tmp_path / "out.csv")
    assert read["s1_mv"].to_list() == recording.signal_mv[:, 0].tolist()
    assert read["target_kpa"].dtype == polars.Float64


def test_hdf5_has_named_dimensions_and_units(tmp_path: Path, recording: Recording) -> None:
    """Each column is over time_s, and states its units; xarray finds the coordinate by itself."""
    h5py = pytest.importorskip("h5py")
    export(recording, tmp_path / "out.h5", "hdf5")
    with h5py.File(tmp_path / "out.h5") as file:
        assert file["s1_mv"].attrs["units"] == "mV"
        assert file["time_s"].is_scale
        assert file["s1_mv"].dims[0].keys() == ["time_s"]


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="octave is not installed")
def test_octave_reads_the_csv(tmp_path: Path, recording: Recording) -> None:
    """The recipe of the documentation."""
    export(recording, tmp_path / "out.csv", "csv")
    script = "d = dlmread('out.csv', ',', 1, 0, 'emptyvalue', NaN); printf('%.17g %g', d(5, 2), d(5, 4));"
    done = subprocess.run(
        ["octave-cli", "--no-init-file", "--eval", script], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    time_s, target = map(float, done.stdout.split())
    assert (time_s, np.isnan(target)) == (recording.time_s[4], True)
