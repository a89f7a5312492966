"""What a window lost is counted under its reason, figure by figure, and voids a figure above the limit."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np

from analysis import Options, Recording, analyse
from analysis.segmentation.losses import LossCounter, Losses
from protocol.recording import SampleFlag
from tests.analysis.boat_builder import Staircase, write_boat

QUICK = Options(mcmc=False)


def without(recording: Recording, rows: slice | np.ndarray) -> Recording:
    """The run without some rows; the index shows it."""
    kept = np.delete(np.arange(recording.n), rows)
    return Recording.from_arrays(
        recording.time_s[kept], recording.pressure_kpa[kept], recording.signal_mv[kept], index=recording.index[kept]
    )


def test_a_window_counts_each_sample_once() -> None:
    """Ten rows: a gap of 3, one saturated row that is no number either, one invalid, one NaN."""
    signal = np.arange(10.0)
    signal[[2, 5]] = np.nan
    flags = np.zeros(10, dtype=np.uint16)
    flags[2], flags[7] = SampleFlag.SATURATED, SampleFlag.PRESSURE_INVALID
    index = np.arange(10) + 3 * (np.arange(10) > 3)
    run = Recording.from_arrays(np.arange(10.0), np.zeros(10), signal, flags=flags, index=index)
    counter = LossCounter.of(run, 0)
    assert counter.of_windows([slice(0, 10)]) == Losses(13, lost=3, saturated=1, flagged=1, not_finite=1)
    assert counter.of_windows([slice(4, 10)]) == Losses(6, flagged=1, not_finite=1)  # the gap lies before it
    assert counter.of_windows([slice(0, 3), slice(6, 8)]) == Losses(5, saturated=1, flagged=1)
    assert counter.of_windows([]).share == 0.0


def test_the_limit_is_a_limit() -> None:
    """20 of 100 carry a figure, 21 do not; the reason names the counts."""
    assert Losses(100, lost=20).void() == ""
    assert "21 lost" in Losses(100, lost=21).void()


def test_samples_that_failed_their_check_reach_the_figures_of_their_window(tmp_path: Path) -> None:
    """40 samples lost in the hold at 0 kPa of cycle 2 while 25 frames failed; 10 more lost on a ramp, in no window."""
    stairs = Staircase(cycles=2)
    holds = stairs.trace()[3]
    hold = next(rows for rows, level in zip(holds, stairs.levels(), strict=True) if level[0] == 0.0 and level[2] == 2)
    rows = np.concatenate([np.arange(hold[0] + 100, hold[0] + 140), np.arange(holds[4][1] + 20, holds[4][1] + 30)])
    path = write_boat(tmp_path / "a.boat", without(stairs.recording(), rows))
    at_us = int((hold[0] + 120) * 1e4)
    with closing(sqlite3.connect(path)) as db, db:
        for time_us, frames, failed in ((0, 0, 7), (at_us - 500_000, 900, 7), (at_us + 600_000, 1000, 32)):
            db.execute(
                "INSERT INTO health (host_ns, segment, time_us, bytes, frames, samples, lost, crc_errors, malformed,"
                " oversize, duplicates, unknown) VALUES (0, 0, ?, 0, ?, ?, 0, ?, 0, 0, 0, 0)",
                (time_us, frames, frames, failed),
            )
    db.close()
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    found = analyse(path, tmp_path / "e.csv", options=QUICK).to_json()
    assert found["crc_errors"] == 25
    assert found["losses"][0]["crc_failed"] == 25
    assert found["losses"][0]["lost"] == 25
    for sensor in found["sensors"]:
        for name in ("sensitivity_mv_per_mm", "system_hysteresis_percent_fso", "snr_db"):
            window = sensor["figures"][name]["window"]
            assert (window["crc_failed"], window["lost"]) == (25, 15), name
