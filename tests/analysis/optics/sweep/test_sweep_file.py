"""The results file of a sweep."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from analysis.optics.scene.parameters import Light
from analysis.optics.sweep.sweep import SweepRequest, SweepResult, run_sweep
from protocol.base.errors import FileError, RequestError
from tests.analysis.optics.sweep.conftest import same


def test_a_stopped_sweep_resumes_where_it_was(
    small_request: SweepRequest, small_result: SweepResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stopped by its progress call, the sweep leaves what was finished, simulates only the rest, and ends with the same
    bits.
    """
    monkeypatch.setattr("analysis.optics.sweep.sweep._RAYS_PER_ITEM", 3_000)  # two designs
    file = tmp_path / "sweep.sqlite"

    def stop(done: float, total: float) -> None:
        if done >= 30:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_sweep(small_request, file=file, threads=1, progress=stop)
    again = run_sweep(small_request, file=file)
    assert 0 < again.simulated < again.ndr.size
    assert same(again, small_result)
    assert run_sweep(small_request, file=file).simulated == 0


def test_a_results_file_keeps_to_its_parameters(small_request: SweepRequest, tmp_path: Path) -> None:
    """A file of another sweep, or of no sweep, is refused; more designs of the same sweep are welcome."""
    file = tmp_path / "sweep.sqlite"
    run_sweep(replace(small_request, designs=small_request.designs[:2]), file=file)
    assert run_sweep(replace(small_request, designs=small_request.designs[:3]), file=file).simulated == 15
    with pytest.raises(RequestError, match="other parameters"):
        run_sweep(replace(small_request, light=Light(rays=99)), file=file)
    (tmp_path / "text").write_text("not a database, but long enough to be read as one " * 20)
    with pytest.raises(FileError) as refused:
        run_sweep(small_request, file=tmp_path / "text")
    assert refused.value.remedy


def test_rows_of_a_version_without_changes_of_power_are_simulated_again(
    small_request: SweepRequest, small_result: SweepResult, tmp_path: Path
) -> None:
    """A file written before the column existed is taken on; its designs get the same bits and the new column."""
    file = tmp_path / "sweep.sqlite"
    run_sweep(small_request, file=file)
    with closing(sqlite3.connect(file)) as db, db:
        db.execute("alter table simulation drop column power_changes")
    again = run_sweep(small_request, file=file)
    assert again.simulated == again.ndr.size
    assert same(again, small_result)
    assert run_sweep(small_request, file=file).simulated == 0
