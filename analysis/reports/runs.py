"""The sections of a report on several runs: side by side, their spread, a unit's history."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.errors import AnalysisError
from analysis.figures import between_runs as comparison
from analysis.figures.figure import SENSOR_FIGURES
from analysis.figures.pipeline import Analysis
from analysis.figures.unit_history import unit_history
from analysis.numbers import NOTHING, rounded, with_uncertainty
from analysis.reports import drawings
from analysis.reports.cells import cell, date_of
from analysis.reports.document import Drawing, Section, Table


def runs_table(analyses: Sequence[Analysis]) -> Section:
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
            name = (str(number), comparison.unit_of(a), sensor.name)
            first.append((*name, b0, *shown[:2]))
            second.append((*name, *shown[2:]))
    caption = "b0 ± standard uncertainty; 95 % intervals within each run; FSO: full-scale output."
    parts = (
        Table((*heads, "b0, mV", *labels[:2]), tuple(first)),
        Table((*heads, *labels[2:]), tuple(second), caption),
    )
    drawn = Drawing(
        (
            drawings.side_by_side(analyses, "sensitivity_mv_per_mm"),
            drawings.side_by_side(analyses, "system_hysteresis_percent_fso"),
        ),
        "Each run with its 95 % interval; runs of one unit stand together.",
        2.4,
    )
    return Section("The runs side by side", (drawn, *parts))


def spread_of_runs(analyses: Sequence[Analysis], unit: str) -> list[Section]:
    rows = []
    for i in range(min(len(a.sensors) for a in analyses)):
        try:
            spread = comparison.sensor_spread(analyses, i)
        except AnalysisError as error:
            return [Section(f"Spread of {unit}", (f"Not given: {error.cause}.",))]
        for label, value in (
            ("within a run (s_r)", spread.pooled.repeatability),
            ("between runs (s_L)", spread.pooled.between),
            ("reproducibility (s_R)", spread.pooled.reproducibility),
        ):
            if value > 0:
                known = 0.1 * spread.pooled.repeatability  # two figures of the spread within runs
                percent = 100.0 / spread.full_scale_mv
                shown = (rounded(value, known), rounded(percent * value, percent * known))
            else:
                shown = ("not resolved", "below that within runs")
            rows.append((spread.name, label, *shown))
    table = Table(
        ("sensor", "standard deviation", "mV", "% FSO"),
        tuple(rows),
        f"{len(analyses)} runs; pooled over pressure levels and branches (ISO 5725-2).",
    )
    return [Section(f"Within-run and between-run spread of {unit or 'the unit'}", (table,))]


def _remark(en: float, outside: bool) -> str:
    said = ["outside the control limits"] if outside else []
    return ", ".join([*said, "differs from the one before"] if abs(en) > 1 else said) or NOTHING


def history_of_unit(analyses: Sequence[Analysis], unit: str) -> list[Section]:
    parts: list[str | Table | Drawing] = []
    for i in range(min(len(a.sensors) for a in analyses)):
        try:
            history = unit_history(analyses, i)
        except AnalysisError:
            continue
        if len(history.when) < 2:
            continue
        rows = [
            (
                when,
                with_uncertainty(v, u),
                rounded(e, 0.1) if np.isfinite(e) else NOTHING,
                _remark(float(e), k in history.out_of_control),
            )
            for k, (when, v, u, e) in enumerate(
                zip(map(date_of, history.when), history.value_mv, history.expanded_mv, history.en, strict=True)
            )
        ]
        caption = (
            f"Sensor {i + 1} at x = {history.check_point_mm:g} mm: mean {history.centre_mv:.2f} mV, control limits "
            f"{history.lower_mv:.2f} to {history.upper_mv:.2f} mV; U with k = 2; |En| above 1 is disagreement."
        )
        parts.append(Table(("calibrated", "y(x0) ± U, mV", "En", "remark"), tuple(rows), caption))
    return [Section(f"History of {unit or 'the unit'}", tuple(parts))] if parts else []
