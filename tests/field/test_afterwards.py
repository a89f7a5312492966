"""A marker is added to a closed recording, printed, and the samples stay as they are."""

from __future__ import annotations

from pathlib import Path

import pytest
from scipy.io import loadmat

from analysis import analyse, load_recording
from analysis.data.boat_writer import first_difference, write_boat_file
from analysis.data.csv_import import import_csv
from analysis.data.export import export
from analysis.reports.build import build_report
from boat_daq.workflows.run_files import add_marker, markers_of
from protocol.base.errors import BoatDaqError
from tests.field.truth import Run, put


@pytest.fixture
def closed(tmp_path: Path, run: Run) -> Path:
    """Return a closed recording of two segments."""
    lines = run.lines(head="")
    rows = [f"{line},{1 + (k >= len(lines) // 2)}" for k, line in enumerate(lines)]
    path = put(tmp_path, ["time_s,pressure_kpa,s1_mv,segment", *rows])
    write_boat_file(tmp_path / "a.boat", import_csv(path), original=path)
    return tmp_path / "a.boat"


def test_a_marker_is_added_afterwards_and_printed(closed: Path) -> None:
    """In either segment, in the order of time; the report shows it."""
    add_marker(closed, 60.25, "hose touched")
    add_marker(closed, 12.5, "valve opened")
    assert markers_of(closed) == [(12.5, "valve opened"), (60.25, "hose touched")]
    facts = dict(build_report([analyse(load_recording(closed), mcmc=False)]).facts)
    assert facts["Marker at 60.25\u00a0s"] == "hose touched"
    assert first_difference(closed) == ""
    export(load_recording(closed), closed.with_suffix(".mat"), "mat")
    assert "hose touched" in str(loadmat(closed.with_suffix(".mat"))["boat_daq"])


@pytest.mark.parametrize(
    ("time_s", "text", "cause"), [(-1.0, "x", "outside"), (1e4, "x", "outside"), (1.0, " ", "text")]
)
def test_a_marker_outside_the_recording_is_refused(closed: Path, time_s: float, text: str, cause: str) -> None:
    """So is one that says nothing."""
    with pytest.raises(BoatDaqError, match=cause):
        add_marker(closed, time_s, text)
    assert markers_of(closed) == []
