"""A report: its content and order, for HTML and PDF alike, and the writing of it.

A report is a list of sections with paragraphs, tables and drawings. This module fills them from analyses; `html` and
`pdf` only set them. Nothing is computed: every figure is a field of `Analysis` or of a comparison of runs, rounded as
its uncertainty warrants; a void figure prints a dash and its reason; SIMULATED is printed across the head of every page
of a simulated run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.calibration_export.verdict import Verdict, VerdictState, verdict_of
from analysis.figures.figure import KEY_FIGURES, SENSOR_FIGURES
from analysis.figures.pipeline import Analysis
from analysis.history.between_runs import RunComparison, UnitComparison, compare_runs
from analysis.numbers import rounded
from analysis.progress import Progress
from analysis.reports import drawings
from analysis.reports import run_section as sections
from analysis.reports.camera_section import camera_section
from analysis.reports.document import Report, ReportDrawing, ReportTable, Section, cell, date_of
from analysis.reports.run_section import breaks
from analysis.reports.shadow_section import shadow_section
from analysis.reports.shown_units import in_units
from analysis.reports.unit_report import history_of_unit, write_built
from analysis.version import program_version
from protocol.base.errors import RequestError
from protocol.base.units import STORED_UNITS, ShownUnits

if TYPE_CHECKING:
    from analysis.figures.against_shadow import AgainstShadow

MARKS = {
    VerdictState.OK: "\u25cf",
    VerdictState.CHECK: "\u25b2",
    VerdictState.FAIL: "\u25a0",
    VerdictState.NONE: "\u25cb",
}

ALERTS = (VerdictState.CHECK, VerdictState.FAIL)


def write_report(
    analyses: Analysis | Sequence[Analysis],
    path: str | Path,
    limits: Mapping[str, float] | None = None,
    shadow: AgainstShadow | None = None,
    *,
    units: ShownUnits = STORED_UNITS,
    progress: Progress | None = None,
) -> Report:
    """Write a report of one run, or a comparison of several, and return it; one that was cancelled leaves no file.

    Raises RequestError for another ending, no run, or an unknown limit; FileError if the file cannot be written.
    `path`: ends in .html or .pdf. `limits`: name -> value, see `analysis.figures.acceptance.LIMITS`; the verdict is
    given against them. `shadow`: the run beside the digital shadow, for a report on one run; None leaves it out.
    """
    runs = [analyses] if isinstance(analyses, Analysis) else analyses

    def build() -> Report:
        report = build_report(runs, limits, shadow)
        return in_units(report, units.of_signals_in(runs[0].recording.signal_unit))

    return write_built(build, Path(path), progress)


def build_report(
    analyses: Sequence[Analysis], limits: Mapping[str, float] | None = None, shadow: AgainstShadow | None = None
) -> Report:
    """Return a report: calibration or repeatability, as the run is; several runs are compared.

    Raises RequestError without a run, or for a limit of something that has none.
    """
    if not analyses:
        raise RequestError("there is no run to report on", "Give one recording or more.")
    limits = dict(limits or {})
    if len(analyses) > 1:
        return _several(compare_runs(analyses), limits)
    analysis, verdict = analyses[0], verdict_of(analyses[0], limits)
    filled = [sections.key_figures(analysis, verdict)]
    filled += [breaks(analysis)] if analysis.breaks else []
    filled += [sections.hysteresis(analysis, verdict)] if analysis.loops.n_cycles else []
    filled += [sections.over_cycles(analysis)] if analysis.loops.n_cycles > 1 else []
    filled += [sections.other_figures(analysis)]
    filled += [sections.coefficients(analysis)] if any(s.calibration for s in analysis.sensors) else []
    filled += sections.budget(analysis.budgets, analysis=analysis)
    filled += [camera_section(analysis, analysis.camera)] if analysis.camera is not None else []
    filled += sections.influence_quantities(analysis)
    filled += [shadow_section(shadow)] if shadow is not None else []
    filled.append(sections.run(analysis))
    filled += [sections.readings(analysis)] if analysis.plateaus else []
    names = {"calibration": "Calibration report", "staircase": "Staircase report"}
    title = names.get(analysis.kind, "Repeatability report")
    about = title, analysis.recording.unit or "unit not named", analysis.recording.simulated
    date = analysis.recording.started_utc
    text, alert = _verdict(verdict), verdict.state in ALERTS
    return Report(*about, text, _facts(analysis), tuple(filled), _footer(analysis), date, alert=alert)


def _several(compared: RunComparison, limits: Mapping[str, float]) -> Report:
    analyses, names = compared.analyses, [name or "not named" for name in compared.names]
    filled = [runs_table(analyses)]
    for unit in compared.units:
        filled += spread_of_runs(unit) + history_of_unit(unit)
        filled += sections.budget(unit.budgets, unit.unit or "the unit")
    verdicts: list[Verdict] = []
    for number, analysis in enumerate(analyses, 1):
        verdicts.append(verdict_of(analysis, limits))
        parts = (*sections.curves(analysis), *sections.undefined(analysis))
        filled += [Section(f"Run {number}: {_name(analysis)}", parts)] if parts else []
    text = " ".join(f"Run {i}: {_verdict(one)}" for i, one in enumerate(verdicts, 1))
    unnamed = sum(not analysis.recording.unit for analysis in analyses)
    if unnamed > 1:
        text = f"{text} {unnamed} runs name no unit and are taken to be of one."
    about = "Comparison of runs", ", ".join(names), any(a.recording.simulated for a in analyses)
    program = f"boat-daq {program_version()}"
    facts = ("Runs", str(len(analyses))), ("Units", ", ".join(names)), ("Program", program)
    date, alert = max(a.recording.started_utc for a in analyses), any(one.state in ALERTS for one in verdicts)
    return Report(*about, text, facts, tuple(filled), program, date, alert=alert)


def _verdict(verdict: Verdict) -> str:
    """Return the verdict with the mark of its state, as the window shows it."""
    return f"{MARKS[verdict.state]} {verdict.sentence}."


def _facts(analysis: Analysis) -> tuple[tuple[str, str], ...]:
    meta, recording = analysis.recording.meta, analysis.recording
    plan = meta.get("plan")
    name = plan.get("name", "") if isinstance(plan, dict) else (plan or "")
    cycles = analysis.cycles.as_json()
    rows = [
        *((label, text) for label, text in recording.metadata.lines() if label != "Note"),
        ("Recorded", date_of(recording.started_utc)),
        ("Board", meta.get("board_id")),
        ("Plan", name),
        ("Note", meta.get("note")),
        *((f"Marker at {time_s:.2f}\u00a0s", text) for time_s, text in meta.get("markers", ())),
        ("Samples", f"{recording.n} at {recording.rate_hz:.1f} Hz, {recording.lost} lost"),
        ("Duration", f"{recording.duration_s:.1f} s"),
        ("Cycles", f"{cycles['complete']} complete" + (f", {cycles['partial']} partial" if cycles["partial"] else "")),
        ("Elongation", analysis.elongations.source if analysis.elongations else "not read"),
    ]
    return tuple((label, str(value)) for label, value in rows if value not in (None, ""))


def _name(analysis: Analysis) -> str:
    return f"{analysis.recording.unit or 'unit not named'}, {date_of(analysis.recording.started_utc)}"


def _footer(analysis: Analysis) -> str:
    recording = str(analysis.recording.meta.get("uuid") or "")[:8]
    return f"boat-daq {program_version()}" + (f"   recording {recording}" if recording else "")


def runs_table(analyses: Sequence[Analysis]) -> Section:
    """Return the section with the key figures of every run side by side."""
    heads, tables = ("run", "unit", "sensor"), []
    for names in (KEY_FIGURES[:2], KEY_FIGURES[2:5], (KEY_FIGURES[5], "fso_mv")):
        rows = []
        for number, a in enumerate(analyses, 1):
            for k, sensor in enumerate(a.sensors, 1):
                shown = [cell(sensor.figures.get(key), SENSOR_FIGURES[key].decimals) for key in names]
                rows.append((str(number), a.recording.unit, str(k), *shown))
        labels = [SENSOR_FIGURES[name].label_with_unit for name in names]
        tables.append(ReportTable((*heads, *labels), tuple(rows)))
    tables[-1] = replace(tables[-1], caption="95 % intervals within each run; FSO: full-scale output.")
    draws = tuple(partial(drawings.side_by_side, analyses, name) for name in KEY_FIGURES[:2])
    drawn = ReportDrawing(draws, "Each run with its 95 % interval; runs of one unit are next to one another.", 2.4)
    return Section("Runs compared", (drawn, *tables))


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
