"""Recordings written by the importer: samples and overview."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from analysis import BoatDaqError, load_recording
from analysis.data.boat_file import opened
from analysis.data.boat_writer import packed_samples, write_boat_file
from analysis.data.csv_import import import_csv
from analysis.data.export import export
from analysis.data.recording import Recording
from protocol.recording import SampleFlag
from tests.analysis.boat_builder import Plant, triangle

ROWS = [(0.0, 1.5, 1650.25), (0.01, 1.75, 1651.5), (0.02, 2.0, 1652.75), (0.03, 2.5, 1653.0)]


def text(separator: str = ",", decimal: str = ".", header: str | None = "time_s,pressure_kpa,s1_mv") -> str:
    """The rows above in a dialect."""
    lines = [header.replace(",", separator)] if header else []
    lines += [separator.join(str(v).replace(".", decimal) for v in row) for row in ROWS]
    return "\n".join(lines) + "\n"


@pytest.mark.fault(35, how="the overview against all samples", times=1)
def test_the_overview_holds_the_extremes(tmp_path: Path) -> None:
    """Its extremes are those of the samples, its rows a thousandth of them."""
    recording = Plant().run(*triangle(3, 20))
    export(recording, tmp_path / "a.csv", "csv")
    write_boat_file(tmp_path / "a.boat", load_recording(tmp_path / "a.csv"), original=tmp_path / "a.csv")
    with opened(tmp_path / "a.boat") as db:
        rows = db.execute("SELECT n, pressure_max_kpa, signal_min_mv FROM overview").fetchall()
    samples, highest_kpa, lowest_mv = zip(*rows, strict=True)
    assert sum(samples) == recording.n
    assert len(rows) == -(-recording.n // 1000)
    np.testing.assert_allclose(max(highest_kpa), recording.pressure_kpa.max())
    np.testing.assert_allclose(np.min([json.loads(low) for low in lowest_mv], axis=0), recording.signal_mv.min(axis=0))


def test_a_gap_is_flagged_at_the_sample_behind_it() -> None:
    """Rows 3 and 7 follow missing ones; no other row is flagged."""
    index = np.array([0, 1, 2, 6, 7, 8, 9, 20, 21])
    run = Recording.from_arrays(
        index * 0.01, np.zeros(index.size), np.ones((index.size, 1)), index=index, flags=np.zeros(index.size, int)
    )
    flags = packed_samples(run)["flags"] & SampleFlag.GAP_BEFORE
    assert np.flatnonzero(flags).tolist() == [3, 7]


def test_an_import_becomes_a_recording_with_its_original_bytes(tmp_path: Path) -> None:
    """import -> .boat -> load gives the same run; the file's bytes are in it; nothing is overwritten."""
    import sqlite3

    path, run = tmp_path / "a.csv", tmp_path / "a.boat"
    path.write_text(text())
    recording = import_csv(path)
    write_boat_file(run, recording, original=path)
    again = load_recording(run)
    np.testing.assert_allclose(again.time_s, recording.time_s, atol=1e-9)
    np.testing.assert_array_equal(again.signal_mv, recording.signal_mv)
    with closing(sqlite3.connect(run)) as db, db:
        assert b"".join(r for (r,) in db.execute("SELECT raw FROM chunk ORDER BY id")) == path.read_bytes()
    with pytest.raises(BoatDaqError, match="exists already"):
        write_boat_file(run, recording, original=path)
