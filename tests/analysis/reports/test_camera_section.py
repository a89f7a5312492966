"""The report's section on a camera's elongation."""

from __future__ import annotations

import pytest

from analysis.reports.build import build_report
from analysis.reports.camera_section import TITLE
from analysis.reports.document import ReportDrawing, ReportTable
from analysis.reports.drawings import as_svg
from tests.analysis.reports.conftest import MARKUP
from tests.analysis.tracking.filmed_run import camera_analysis


def test_the_continuous_record_is_beside_the_plateaus() -> None:
    """Sensitivity, hysteresis, R2, dynamic error and distance of both sensors; delay and scale in a sentence."""
    analysis = camera_analysis()
    section = next(s for s in build_report([analysis]).sections if s.title == TITLE)
    text = next(part for part in section.parts if isinstance(part, str))
    assert "The frames are late by 58" in text
    assert "of the scale 0.20 %" in text
    table = next(part for part in section.parts if isinstance(part, ReportTable))
    names = [row[0] for row in table.rows]
    assert names == [f"Sensor {i}, {what}" for i in (1, 2) for what in ("plateaus", "continuous record")]
    assert analysis.camera is not None
    assert float(table.rows[1][1]) == pytest.approx(analysis.camera.sensors[0].sensitivity_mv_per_mm, abs=0.01)
    assert table.rows[1][3] == f"{analysis.camera.sensors[0].r2:.5f}"


def test_loop_speed_and_cycles_are_drawn() -> None:
    """Every drawing has data."""
    section = next(s for s in build_report([camera_analysis()]).sections if s.title == TITLE)
    drawings = [part for part in section.parts if isinstance(part, ReportDrawing)]
    assert [len(drawing.draw) for drawing in drawings] == [1, 2, 2, 1]
    for drawing in (drawings[1], drawings[3]):
        svg, _ = as_svg(drawing, 6.5, text=True)
        assert "undefined" not in svg
    assert "cycle" in svg


def test_a_run_without_a_camera_has_no_such_section(calibration) -> None:
    """The other sections are as before."""
    report = build_report([calibration])
    assert MARKUP in dict(report.facts).values()
    assert TITLE not in [section.title for section in report.sections]
