"""A reading to be checked keeps a calibration from being accepted until it is confirmed with a reason."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from unittest.mock import Mock

import pytest

from analysis.calibration_export.verdict import verdict_of
from boat_daq.engine.recording.closed_run import ClosedRun
from boat_daq.engine.settings import UnitLibrary
from boat_daq.workflows import acceptance
from boat_daq.workflows.acceptance import accept_run, change_readings, confirm_readings, obstacle_to, run_calibration
from boat_daq.workflows.run_analysis import analysed_run
from protocol.base.errors import RequestError, StorageError
from tests.boat_daq.viewmodels.helpers import SAMPLE


@pytest.fixture(scope="module")
def mistyped(tmp_path_factory):
    """A copy of the sample with 10.00 mm in place of the reading at its sixth step."""
    path = tmp_path_factory.mktemp("typo") / "SA1.boat"
    path.write_bytes(SAMPLE.read_bytes())
    run = ClosedRun(path)
    run.add_reading(run.steps()[5].number, 10.0, "typed", resolution_mm=0.5)
    return path


def test_mistyped_reading_is_not_accepted_until_it_is_confirmed(mistyped, tmp_path, monkeypatch) -> None:
    """`anyway` does not pass it; a reason does, and stays in the recording as a newer reading of the same value."""
    units = UnitLibrary(tmp_path)
    found = analysed_run(mistyped)
    run = run_calibration(found, mistyped)
    assert run.verdict is not None
    assert run.verdict.check_count == "1 reading to check"
    assert "+10.00 mm at" in str(obstacle_to(run))
    monkeypatch.setattr(acceptance, "analysed_run", lambda path, elongation: found)
    with pytest.raises(RequestError, match="1 reading to check"):
        accept_run(mistyped, units, anyway=True)
    with pytest.raises(RequestError, match="with a reason"):
        confirm_readings(run, "  ")
    _refuse_confirmed(mistyped, units, monkeypatch)
    assert len(confirm_readings(run, "read again", reader="Ada")) == 1
    last = ClosedRun(mistyped).readings()[-1]
    assert (last.elongation_mm, last.reader, last.note, last.source) == (10.0, "Ada", "confirmed: read again", "typed")
    verdict = verdict_of(analysed_run(mistyped))
    assert (verdict.readings, verdict.confirmed[0].confirmed) == ((), "read again")
    with closing(sqlite3.connect(mistyped)) as db:
        assert db.execute("SELECT count(*) FROM reading WHERE elongation_mm = 10.0").fetchone() == (4,)


def _refuse_confirmed(path, units, monkeypatch) -> None:
    """A reason is not kept where acceptance fails all the same, by another obstacle or on the disk."""
    read = ClosedRun(path).readings()
    with pytest.raises(RequestError, match="the curve turns inside its range"):
        accept_run(path, units, anyway=True, confirm="read again")
    assert ClosedRun(path).readings() == read
    monkeypatch.setattr(acceptance, "obstacle_to", lambda run: None)
    monkeypatch.setattr(UnitLibrary, "add_calibration", Mock(side_effect=StorageError("the disk is full", "free some")))
    with pytest.raises(StorageError, match="the disk is full"):
        accept_run(path, units, anyway=True, confirm="read again")
    monkeypatch.undo()
    last = ClosedRun(path).readings()[-1]
    assert (last.elongation_mm, last.note) == (10.0, "")


def test_withdrawn_reading_is_left_out(mistyped, tmp_path) -> None:
    """A withdrawal takes the point out of the curve: nothing is left to check."""
    path = tmp_path / "b.boat"
    path.write_bytes(mistyped.read_bytes())
    step = ClosedRun(path).steps()[5].number
    assert change_readings(path, {step: None}) == {step: 10.0}
    run = run_calibration(analysed_run(path), path)
    assert run.verdict is not None
    assert not run.verdict.readings
