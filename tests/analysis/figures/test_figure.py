"""The table of figures: every figure of an analysis has its entry, in the unit of the table."""

from __future__ import annotations

from pathlib import Path

from analysis import Options, analyse
from analysis.figures.figure import SENSOR_FIGURES, SYSTEM_FIGURES, Reason
from tests.analysis.boat_builder import Plant, Staircase, triangle

QUICK = Options(mcmc=False)


def test_every_figure_has_its_entry_and_unit(tmp_path: Path) -> None:
    """Of a calibration and of a continuous run; % of the span is % in JSON."""
    stairs = Staircase(cycles=3)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    calibration = analyse(stairs.recording(), tmp_path / "e.csv", options=QUICK)
    assert set(calibration.sensors[0].figures) == set(SENSOR_FIGURES)
    assert set(calibration.system_figures) == set(SYSTEM_FIGURES)
    for analysis in (calibration, analyse(Plant().run(*triangle(3, 10)), options=QUICK)):
        for key, figure in analysis.sensors[0].figures.items():
            assert figure.unit == SENSOR_FIGURES[key].unit


def test_a_void_figure_has_a_reason_code() -> None:
    """Void or without interval, each with its code; a sound figure has none."""
    figures = analyse(Plant().run(*triangle(1, 10)), options=QUICK).sensors[0].figures
    assert figures["repeatability_percent_fso"].reason is Reason.FEW_CYCLES
    assert figures["fso_mv"].reason is Reason.ONE_CYCLE
    assert all(figure.reason for figure in figures.values() if figure.void or figure.note)
