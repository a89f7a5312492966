"""The sections of a report on several runs: side by side, their spread, a unit's history."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from analysis.figures.between_runs import UnitComparison
from analysis.figures.figure import SENSOR_FIGURES
from analysis.figures.pipeline import Analysis
from analysis.figures.unit_history import UnitHistory
from analysis.numbers import NOTHING, rounded, with_uncertainty
from analysis.reports import drawings
from analysis.reports.cells import cell, date_of
from analysis.reports.document import ReportDrawing, ReportTable, Section


def runs_table(analyses: Sequence[Analysis]) -> Section:
    """Return the section with the key figures of every run side by side."""
    heads = ("run", "unit", "sensor")
    names = ("sensitivity_mv_per_mm", "system_hysteresis_percent_fso", "snr_db", "fso_mv")
    labels = [SENSOR_FIGURES[name].label_with_unit for name in names]
    first, second = [], []
    for number, a in enumerate(analyses, 1):
        for sensor in a.sensors:
            shown = [cell(sensor.figures.get(k)) for k in names]
            b0 = NOTHING
            if sensor.calibration is not None:
                b0 = with_uncertainty(
                    float(sensor.calibration.coefficients[0]), float(sensor.calibration.std_errors_with_reading[0])
                )
            name = (str(number), a.recording.unit, sensor.name)
            first.append((*name, b0, *shown[:2]))
            second.append((*name, *shown[2:]))
    caption = "b0 ± standard uncertainty; 95 % intervals within each run; FSO: full-scale output."
    parts = (
        ReportTable((*heads, "b0, mV", *labels[:2]), tuple(first)),
        ReportTable((*heads, *labels[2:]), tuple(second), caption),
    )
    drawn = ReportDrawing(
        (
            partial(drawings.side_by_side, analyses, "sensitivity_mv_per_mm"),
            partial(drawings.side_by_side, analyses, "system_hysteresis_percent_fso"),
        ),
        "Each run with its 95 % interval; runs of one unit are next to one another.",
        2.4,
    )
    return Section("The runs side by side", (drawn, *parts))


def spread_of_runs(unit: UnitComparison) -> list[Section]:
    """Return the section on the spread of a unit's levels within and between its runs."""
    title = f"Within-run and between-run spread of {unit.unit or 'the unit'}"
    if unit.spread_void:
        return [Section(title, (f"Not given: {unit.spread_void}.",))]
    rows = []
    for spread in unit.spreads:
        digits = 0.1 * spread.pooled.repeatability  # two digits of the spread within runs
        for label, value in (
            ("within a run (s_r)", spread.pooled.repeatability),
            ("between runs (s_L)", spread.pooled.between),
            ("reproducibility (s_R)", spread.pooled.reproducibility),
        ):
            percent = 100.0 / spread.full_scale_mv
            shown = (rounded(value, digits), rounded(percent * value, percent * digits))
            rows.append((spread.name, label, *(shown if value > 0 else ("not resolved", "below that within runs"))))
    caption = f"{unit.runs} runs; pooled over pressure levels and branches (ISO 5725-2)."
    return [Section(title, (ReportTable(("sensor", "standard deviation", "mV", "% FSO"), tuple(rows), caption),))]


def history_of_unit(unit: UnitComparison) -> list[Section]:
    """Return the section on a unit's calibrations over time; none where it was calibrated once."""
    parts = tuple(_history_table(history, number) for number, history in enumerate(unit.histories, 1))
    return [Section(f"History of {unit.unit or 'the unit'}", parts)] if parts else []


def _history_table(history: UnitHistory, number: int) -> ReportTable:
    points = zip(map(date_of, history.when), history.value_mv, history.expanded_mv, history.en, strict=True)
    rows = tuple(
        (
            when,
            with_uncertainty(value, expanded),
            rounded(en, 0.1) if np.isfinite(en) else NOTHING,
            _finding(float(en), k in history.out_of_control),
        )
        for k, (when, value, expanded, en) in enumerate(points)
    )
    caption = (
        f"Sensor {number} at x = {history.check_point_mm:g} mm: mean {history.centre_mv:.2f} mV, control limits "
        f"{history.lower_mv:.2f} to {history.upper_mv:.2f} mV; U with k = 2; |En| above 1 is disagreement."
    )
    return ReportTable(("calibrated", "y(x0) ± U, mV", "En", "finding"), rows, caption)


def _finding(en: float, outside: bool) -> str:
    found = {"outside the control limits": outside, "differs from the one before": abs(en) > 1}
    return ", ".join(text for text, holds in found.items() if holds) or NOTHING
