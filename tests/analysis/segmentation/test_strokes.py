"""Strokes of real data against the reference."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from analysis.data.csv_table import read_table
from analysis.segmentation.strokes import find_strokes


def test_strokes_of_real_data_meet_the_reference(shared_data: Path) -> None:
    """All six files of the pneumatic set: 10 strokes each way, figures within 2 %, holes and 62 Hz included."""
    folder = shared_data / "zillen_pneumatic"
    for name, truth in json.loads((folder / "expected.json").read_text())["files"].items():
        columns = read_table(folder / name).columns
        found = find_strokes(columns[0] / 1000, columns[4], columns[6], min_speed=2.0)
        assert (found.up_rows.size, found.down_rows.size, found.cycles) == (10, 10, 9)
        for key, value in {
            "peak_mean": found.peak_mean, "trough_mean": found.trough_mean, "period_mean_s": found.period_mean_s,
            "loop_area_mean_Nmm": found.loop_area_mean, "half_width_mid_N": found.half_width_mean,
            "stroke_p1_p99": found.span,
        }.items():  # fmt: skip
            assert value == pytest.approx(truth[key], rel=0.02), (name, key)
