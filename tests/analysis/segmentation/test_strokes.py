"""Strokes of real data against the reference."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from analysis.data.csv_table import read_table
from analysis.segmentation.strokes import AWAY, find_strokes, thresholds
from tests.analysis.segmentation.drives import LOW_KPA, SPAN_KPA, Drive


def test_strokes_of_real_data_meet_the_reference(shared_data: Path) -> None:
    """All six files of the pneumatic set: 10 strokes each way, figures within 2 %, holes and 62 Hz included.

    The reference tells the branches by the sign of each step. Noise gives up to 0.9 % of the samples the wrong sign,
    which makes its half width up to 2.6 % smaller.
    """
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
            assert value == pytest.approx(truth[key], rel=0.03 if "half_width" in key else 0.02), (name, key)


@pytest.mark.parametrize("steps", [4, 8, 9])
@pytest.mark.parametrize("noise_kpa", [0.01, 0.5])
def test_thresholds_are_away_from_the_holds_of_a_staircase(steps: int, noise_kpa: float) -> None:
    """Of 4 and of 8 steps one is held at 75 %: noise has it pass now at its begin, now at its end, a hold later."""
    drive = Drive(6, steps, dwell_s=2.0, ramp_kpa_per_s=10.0, rate_hz=50.0, noise_kpa=noise_kpa)
    run = drive.run(np.random.default_rng(0))
    holds = LOW_KPA + SPAN_KPA * np.arange(steps + 1) / steps
    for level, usual in zip(thresholds(run.pressure_kpa), (0.25, 0.75), strict=True):
        assert np.abs(holds - level).min() > 0.04 * SPAN_KPA
        assert abs((level - LOW_KPA) / SPAN_KPA - usual) <= AWAY + 0.03
    assert np.abs(run.errors_s()).max() < 0.3


def test_thresholds_of_a_triangle_are_a_quarter_from_its_ends() -> None:
    """A drive that is held nowhere keeps 25 and 75 % of its span."""
    run = Drive(20, 1, dwell_s=0.0, ramp_kpa_per_s=10.0, rate_hz=100.0, noise_kpa=0.2).run(np.random.default_rng(0))
    low, high = np.percentile(run.pressure_kpa, [1, 99])
    assert thresholds(run.pressure_kpa) == pytest.approx((low + 0.25 * (high - low), low + 0.75 * (high - low)))
