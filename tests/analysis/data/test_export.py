"""Exported samples: numbers unchanged, text neutralised, simulated runs marked."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import loadmat

from analysis import load_recording
from analysis.data.boat_writer import first_difference, write_boat_file
from analysis.data.export import SUFFIXES, ConvertedElongation, export
from analysis.data.recording import Recording
from analysis.numbers import neutral
from protocol.base.errors import RequestError
from tests.analysis.boat_builder import Plant, triangle, write_boat


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
    """Faults 49 and 54: no text is in the table, where a spreadsheet runs it; SIMULATED is in every file."""
    meta = {"note": '=cmd|"/c calc",@x', "operator": "+1"}
    run = write_boat(tmp_path / "r.boat", Plant().run(*triangle(2, 5)), meta=meta)
    recording = load_recording(run)
    export(recording, tmp_path / "r.csv", "csv")
    lines = (tmp_path / "r.csv").read_text().splitlines()
    assert lines[0].startswith("index,time_s")
    assert lines[0].endswith(",simulated")
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


def converted(recording: Recording) -> ConvertedElongation:
    """Return an elongation with holes, and where it is from."""
    x = np.linspace(-2, 3, recording.n)
    x[::7] = np.nan
    return ConvertedElongation(x, np.full(recording.n, 0.1), np.isfinite(x), {"unit": "SA1", "notes": ["µ, ü"]})


def test_hdf5_has_a_dataset_a_column(tmp_path: Path) -> None:
    """Values to the last bit, units, metadata longer than an attribute may be, and SIMULATED."""
    h5py = pytest.importorskip("h5py")
    recording = replace(Plant().run(*triangle(2, 5)), meta={"simulated": True, "note": "n" * 70_000})
    export(recording, tmp_path / "r.h5", "hdf5", converted=converted(recording))
    with h5py.File(tmp_path / "r.h5") as file:
        assert file.attrs["SIMULATED"]
        np.testing.assert_array_equal(file["elongation_mm"], converted(recording).elongation_mm)
        np.testing.assert_array_equal(file["s1_mv"], recording.signal_mv[:, 0])
        assert file["u_mm"].attrs["unit"] == "mm"
        stated = json.loads(file["boat_daq"][()])
    assert stated["calibration"]["unit"] == "SA1"
    assert len(stated["session"]["note"]) == 70_000


def test_hdf5_without_its_library_is_refused_with_the_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No half-written file stays."""
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(RequestError, match="not installed") as caught:
        export(Plant().run(*triangle(2, 5)), tmp_path / "r.h5", "hdf5")
    assert "h5py" in caught.value.command
    assert list(tmp_path.iterdir()) == []


def test_mat_has_a_vector_a_column(tmp_path: Path) -> None:
    """As scipy reads it: values to the last bit, units and metadata."""
    recording = Plant().run(*triangle(2, 5))
    export(recording, tmp_path / "r.mat", "mat", converted=converted(recording))
    found = loadmat(tmp_path / "r.mat", squeeze_me=True)
    np.testing.assert_array_equal(found["elongation_mm"], converted(recording).elongation_mm)
    np.testing.assert_array_equal(found["s2_mv"], recording.signal_mv[:, 1])
    assert str(found["units"]["elongation_mm"]) == "mm"
    assert json.loads(str(found["boat_daq"]))["calibration"]["notes"] == ["µ, ü"]


@pytest.mark.nightly
@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="octave is not installed")
def test_octave_reads_the_mat_file(tmp_path: Path) -> None:
    """Size, a value and the unit, by another reader than scipy."""
    recording = Plant().run(*triangle(2, 5))
    export(recording, tmp_path / "r.mat", "mat", converted=converted(recording))
    script = "s = load('r.mat'); printf('%d %.17g %s', numel(s.elongation_mm), s.s1_mv(5), s.units.u_mm)"
    done = subprocess.run(
        ["octave-cli", "--no-init-file", "--eval", script], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout == f"{recording.n} {recording.signal_mv[4, 0]:.17g} mm"


def with_channels() -> Recording:
    """Return a run with a temperature, which has holes, and a name that a table reserves."""
    recording = Plant().run(*triangle(2, 5))
    channel = np.stack([20.0 + 0.001 * recording.time_s, np.full(recording.n, 0.1), np.arange(recording.n)], axis=1)
    channel[5:9, 0] = np.nan
    meta = {"channels": [["temperature", "°C"], ["pressure", "bar"], ["status", ""]]}
    return replace(recording, channel=channel, meta=meta)


@pytest.mark.parametrize("suffix", ["csv", "parquet", "h5", "mat"])
def test_extra_channels_are_columns_of_every_format(tmp_path: Path, suffix: str) -> None:
    """Named with their unit, holes included; a CSV gives the same channels when it is read again."""
    recording, path = with_channels(), tmp_path / f"r.{suffix}"
    export(recording, path, SUFFIXES[path.suffix])
    column = "temperature_degc"
    assert recording.channel is not None
    if suffix == "csv":
        again = load_recording(path)
        assert again.channels == recording.channels == (("temperature", "°C"), ("pressure", "bar"), ("status", ""))
        np.testing.assert_array_equal(again.channel, recording.channel)
        stated = json.loads(path.with_suffix(".json").read_text())["columns"]
        assert (stated[column], stated["pressure_bar"], stated["pressure_kpa"]) == ("°C", "bar", "kPa")
    elif suffix == "parquet":
        np.testing.assert_array_equal(pd.read_parquet(path)[column], recording.channel[:, 0])
    elif suffix == "h5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path) as file:
            np.testing.assert_array_equal(file[column], recording.channel[:, 0])
            assert file[column].attrs["unit"] == "°C"
    else:
        np.testing.assert_array_equal(loadmat(path)[column][:, 0], recording.channel[:, 0])


def test_channels_of_a_table_are_kept_in_its_recording(tmp_path: Path) -> None:
    """A column with the unit of another quantity is a channel; the recording verifies, one without channels too."""
    table, path = tmp_path / "lab.csv", tmp_path / "lab.boat"
    head = "time (s),pressure (kPa),s1 (mV),Room temperature (°C),Flow [L/min],remark,elongation_mm\n"
    table.write_text(head + "".join(f"{n / 10},{n},{1000 + n},{20 + n / 100},0.5,7,1\n" for n in range(30)))
    recording = load_recording(table)
    assert recording.channels == (("Room temperature", "°C"), ("Flow", "L/min"))
    write_boat_file(path, recording, original=table)
    again = load_recording(path)
    assert again.channel is not None and again.channels == recording.channels
    np.testing.assert_array_equal(again.channel[:, 0], 20 + np.arange(30) / 100)
    assert first_difference(path) == ""
    older = tmp_path / "older.boat"
    meta = {key: value for key, value in recording.meta.items() if key != "channels"}
    write_boat_file(older, replace(recording, channel=None, meta=meta), original=table)
    assert load_recording(older).channels == () and first_difference(older) == ""
