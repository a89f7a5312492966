"""Drawings of a report without anything to draw."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from analysis import analyse
from analysis.reports import drawings
from analysis.reports.build import write_report
from analysis.reports.document import ReportDrawing
from analysis.reports.drawings import as_svg
from tests.analysis.boat_builder import Plant, triangle


@pytest.mark.parametrize("vented", [False, True])
def test_a_continuous_run_whose_sensors_see_nothing_draws_without_a_warning(tmp_path: Path, vented: bool) -> None:
    """No full scale, or no cycle at all: no curve, so nothing that a legend could name."""
    pressure, loading, cycle = triangle(4, 10)
    recording = Plant(cubics=((1650.0,),) * 2).run(0.0 * pressure if vented else pressure, loading, cycle)
    from analysis import Recording

    signal = np.full_like(recording.signal_mv, 1650.0)
    analysis = analyse(Recording.from_arrays(recording.time_s, recording.pressure_kpa, signal), mcmc=False)
    for draw in (partial(drawings.loop_difference, analysis), partial(drawings.drift_of_levels, analysis, 0)):
        assert as_svg(ReportDrawing((draw,), ""), 7.0).startswith("<svg")
    write_report([analysis], tmp_path / "r.html")
    assert "<svg" in (tmp_path / "r.html").read_text(encoding="utf-8")
