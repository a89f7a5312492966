"""The report of a dynamic calibration: its numbers are those of the figures, in HTML and PDF."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.elongation_control.dynamic_figures import BodePoint, DynamicCalibration, DynamicFigure
from analysis.reports.dynamics_report import dynamic_report, write_dynamic_report
from protocol.base.errors import RequestError

FIGURES = {
    "time_constant_s": DynamicFigure(0.42, 0.40, 0.44),
    "rise_s": DynamicFigure(0.35, 0.33, 0.37),
    "settling_s": DynamicFigure(1.1, 1.0, 1.2),
    "overshoot_percent": DynamicFigure(4.2, 3.0, 5.4),
}
BODE = (BodePoint(0.5, -0.2, -20.0, 0.05, 1.0), BodePoint(1.0, -4.0, -60.0, 0.1, 2.0, 0.2))
EDGE = DynamicFigure(0.87, 0.86, 0.88)
RESPONSE = np.array([[0.0, 1.0], [0.0, 1.02]])
FOUND = DynamicCalibration(
    "SA1", True, "folder/steps.boat", 0.05, {1.0: FIGURES}, BODE, EDGE, {1.0: RESPONSE}, {1.0: 6}
)


def test_figures_and_points_are_in_the_tables():
    report = dynamic_report(FOUND)
    steps, bode = (section.parts[-1] for section in report.sections)
    assert steps.rows == (("1 mm, 6 times", "0.420 ± 0.020", "0.350 ± 0.020", "1.10 ± 0.10", "4.2 ± 1.2"),)
    assert bode.rows[1] == ("1 Hz, 0.2 mm", "-4.00 ± 0.20", "-60.00 ± 4.00")
    assert report.verdict == "Settles to within 0.05 mm in 1.10 s or less, bandwidth 0.87 Hz (0.86 to 0.88 Hz) at -3 dB"
    assert report.simulated


def test_it_is_written_as_html_and_no_other_ending(tmp_path):
    write_dynamic_report(FOUND, tmp_path / "dynamic.html")
    text = (tmp_path / "dynamic.html").read_text(encoding="utf-8")
    assert "SIMULATED" in text
    assert "Frequency response" in text
    with pytest.raises(RequestError, match="neither"):
        write_dynamic_report(FOUND, tmp_path / "dynamic.txt")
