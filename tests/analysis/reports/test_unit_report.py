"""The report of a unit over time: each sensor with its curves, dates, table and proposal, marked where simulated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from analysis import fit_calibration
from analysis.history.unit_history import DatedCalibration, UnitHistory, history_of
from analysis.reports.html import render_html
from analysis.reports.unit_report import _uncertainty, curve_differences, unit_report, write_unit_report
from protocol.base.errors import RequestError
from tests.analysis.boat_builder import PAPER

DATES = ("2026-01-05T10:00:00+00:00", "2026-04-01T10:00:00+00:00", "2026-09-20T10:00:00+00:00")


def history(sensor: int, degrees: tuple[int, ...] = (3, 2, 3)) -> UnitHistory:
    """Return three calibrations, 1 mV apart, of curves of several degrees."""
    x, rng, found = np.linspace(-2.7, 3.8, 30), np.random.default_rng(sensor), []
    for k, (when, degree) in enumerate(zip(DATES, degrees, strict=True)):
        y = np.polynomial.Polynomial(PAPER[sensor])(x) + k + 0.1 * rng.standard_normal(x.size)
        u = np.column_stack([x, np.full(x.size, 0.05)])
        found.append(DatedCalibration(when, fit_calibration(x, y, degree), u))
    return history_of(found, f"s{sensor + 1}")


def test_report_has_curves_dates_table_and_proposal(tmp_path: Path) -> None:
    """One section a sensor, SIMULATED at its head, the proposal in the verdict; curves of several degrees."""
    histories = [history(0), history(1)]
    report = unit_report("SA1 <b>", histories, simulated=True)
    text = render_html(report)
    assert [section.title for section in report.sections] == ["Sensor 1", "Sensor 2", "How the interval is proposed"]
    assert "SIMULATED" in text
    assert "SA1 &lt;b&gt;" in text
    assert "due again 20" in report.verdict
    assert text.count("2026-04-01") >= 2
    assert np.isnan(histories[0].coefficients[1, 3])
    with pytest.raises(RequestError, match="neither"):
        write_unit_report("SA1", histories, tmp_path / "r.txt", simulated=True)


def test_curves_are_compared_with_the_first() -> None:
    """1 and 2 mV above it, over the range of both."""
    for k, (x, difference) in enumerate(curve_differences(history(0, (3, 3, 3)))):
        assert x.size > 10
        assert difference == pytest.approx(k, abs=0.3)


def test_uncertainty_fills_its_plot() -> None:
    """Truth: U is 0.05 mm everywhere. An axis to 1250 times of it showed a line at zero."""
    ax = Figure().add_subplot()
    _uncertainty(history(0), 0, ax)
    assert ax.get_ylim() == pytest.approx((0.0, 1.25 * 0.05))
