"""The disk space required before the first pressure, compared with what recordings take."""

from __future__ import annotations

import pytest

from boat_daq.engine.recording import file
from boat_daq.engine.recording.file import bytes_per_second, check_space
from protocol.base.errors import StorageError
from protocol.simulator.board import VirtualBoard
from tests.boat_daq.engine.board_link import record_run
from tests.conftest import mostly_at_night


@pytest.mark.parametrize(("rate_hz", "seconds"), mostly_at_night((2_000, 15.0), (100, 60.0)))
def test_the_estimate_covers_a_real_recording_and_not_many(tmp_path, rate_hz, seconds):
    """What a recording takes a second is below the estimate, and above a third of it."""
    path = tmp_path / "run.boat"
    record_run(path, VirtualBoard(), seconds, rate_hz=rate_hz)
    size = path.stat().st_size - 60_000  # tables without rows
    assert size / seconds < bytes_per_second(rate_hz, 2) < 3 * size / seconds


@pytest.mark.fault(28, how="less disk space than the plan's rate needs", times=1)
def test_a_plan_that_does_not_fit_is_refused_with_both_figures(tmp_path, monkeypatch):
    """The reader learns how much is needed and how much is there."""
    check_space(tmp_path, rate_hz=100, duration_s=60, n_sensors=2)
    monkeypatch.setattr(file.shutil, "disk_usage", lambda _: type("usage", (), {"free": 50_000_000})())
    with pytest.raises(StorageError, match=r"needs about \d+ MB and .* has 50 MB free"):
        check_space(tmp_path, rate_hz=10_000, duration_s=3600, n_sensors=2)


@pytest.mark.fault(29, how="a folder that is absent, or read-only", times=2)
def test_a_folder_that_cannot_be_written_is_refused(tmp_path, monkeypatch):
    """Absent or read-only: refused before the start."""
    with pytest.raises(StorageError, match="no folder"):
        check_space(tmp_path / "none", rate_hz=100, duration_s=1, n_sensors=2)
    monkeypatch.setattr(file.os, "access", lambda *_: False)
    with pytest.raises(StorageError, match="cannot be written"):
        check_space(tmp_path, rate_hz=100, duration_s=1, n_sensors=2)
