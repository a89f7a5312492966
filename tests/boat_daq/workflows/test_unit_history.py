"""A unit over time from its accepted calibrations."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from boat_daq.engine.settings import Unit, UnitLibrary
from boat_daq.viewmodels.results.unit_over_time import unit_rows
from boat_daq.workflows.unit_history import UnitOverTime, in_force_at_times, report_unit, unit_over_time
from protocol.base.errors import RequestError
from tests.boat_daq.viewmodels.results.units import accepted, unit


def test_accepted_calibrations_are_arranged_over_time() -> None:
    """Two calibrations 2 mV apart: days, E_n, U of the live reading, a proposal, a line each in the table."""
    found = unit_over_time(unit(0.0, 2.0))
    assert len(found.histories) == 2
    assert (found.times()[0][0].tolist(), found.times()[1]) == ([0.0, 60.0], "d")
    short = [SimpleNamespace(when=("2026-11-27T13:14:00", f"2026-11-27T{end}")) for end in ("13:17:00", "18:14:00")]
    assert [UnitOverTime((one,), "").times()[1] for one in short] == ["min", "h"]
    assert UnitOverTime((short[0],), "").times()[0][0] == pytest.approx([0.0, 3.0])
    assert found.histories[0].value_mv[1] - found.histories[0].value_mv[0] == pytest.approx(2.0)
    assert np.isfinite(found.histories[0].expanded_mm).all()
    assert "Due again 2026" in found.sentence
    assert unit_rows(found)[0][:2] == (" 2   2026-03-11  10:00", "1")
    assert len(unit_rows(found)) == 4


def test_withdrawn_calibrations_are_left_out() -> None:
    """One that was undone, and the first in force again: it counts once."""
    first, second = accepted("2026-01-01T00:00:00+00:00"), accepted("2026-02-01T00:00:00+00:00", 9.0)
    again = dataclasses.replace(first, utc="2026-02-02T00:00:00+00:00", note="in force again")
    withdrawn = dataclasses.replace(first, utc="2026-02-03T00:00:00+00:00", accepted=False, content={"simulated": True})
    assert in_force_at_times((first, second, again)) == [first]
    assert in_force_at_times((first, withdrawn)) == []


def test_unit_without_calibration_has_no_history(tmp_path: Path) -> None:
    """The reason is given; its report is refused."""
    assert unit_over_time(Unit("SA1")).void == "SA1 has no accepted calibration yet"
    with pytest.raises(RequestError, match="no accepted calibration"):
        report_unit(UnitLibrary(tmp_path), "SA1", tmp_path / "r.html")
