"""Recordings written by the importer: samples and overview."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from analysis import load_recording
from analysis.data.boat_file import opened
from analysis.data.boat_writer import write_boat_file
from analysis.data.export import export
from tests.analysis.boat_builder import Plant, triangle


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
