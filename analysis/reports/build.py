"""A report's content: what stands in it and in which order, for HTML and PDF alike.

Strategy: a report is a list of sections, a section holds paragraphs, tables and drawings. This file fills them from
analyses and computes nothing; `html` and `pdf` only set them. What a reader looks at first stands first:
verdict and key figures, then curves, loops, drift, uncertainty, tables, settings, provenance.

Rules: every figure of a table is one of `Analysis`, rounded as its uncertainty warrants; a void figure prints a dash
and its reason; SIMULATED stands across the head of every page of a simulated run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from analysis.data.boat_file import program_version
from analysis.errors import RequestError
from analysis.figures import between_runs as comparison
from analysis.figures.pipeline import Analysis
from analysis.figures.repeatability import judge
from analysis.reports import run_section as sections
from analysis.reports.breaks import breaks
from analysis.reports.cells import date_of
from analysis.reports.document import Report, Section
from analysis.reports.runs import history_of_unit, runs_table, spread_of_runs
from analysis.reports.shadow import shadow_section

if TYPE_CHECKING:
    from analysis.figures.against_shadow import AgainstShadow


def build_report(
    analyses: Sequence[Analysis], limits: Mapping[str, float] | None = None, shadow: AgainstShadow | None = None
) -> Report:
    """Fill a report: calibration or repeatability, as the run is; several runs are compared.

    Parameters
    ----------
    shadow : of a single run, `analysis.figures.against_shadow`; None leaves the section out.

    Raises
    ------
    RequestError : no run, or a limit for something that has none.
    """
    if not analyses:
        raise RequestError("there is no run to report on", "Give one recording or more.")
    limits = dict(limits or {})
    if len(analyses) > 1:
        return _several(analyses, limits)
    analysis = analyses[0]
    filled = [sections.key_figures(analysis, limits)]
    filled += [breaks(analysis)] if analysis.breaks else []
    if any(s.calibration for s in analysis.sensors):
        filled += [sections.curves(analysis), sections.coefficients(analysis)]
    filled += [sections.loops(analysis)] if analysis.loops.n_cycles else []
    filled += [sections.over_cycles(analysis)] if analysis.loops.n_cycles > 1 else []
    filled += sections.budget(analysis)
    filled += [shadow_section(shadow)] if shadow is not None else []
    filled.append(sections.run(analysis))
    if analysis.plateaus:
        filled.append(sections.readings(analysis))
    names = {"calibration": "Calibration report", "staircase": "Staircase report"}
    title = names.get(analysis.kind, "Repeatability report")
    return Report(
        title,
        comparison.unit_of(analysis) or "unit not named",
        analysis.recording.simulated,
        _verdict(analysis, limits),
        _facts(analysis),
        tuple(filled),
        _footer(analysis),
    )


def _several(analyses: Sequence[Analysis], limits: Mapping[str, float]) -> Report:
    units = [comparison.unit_of(a) for a in analyses]
    filled = [runs_table(analyses)]
    for unit in dict.fromkeys(units):
        own = [a for a, u in zip(analyses, units, strict=True) if u == unit]
        if len(own) > 1:
            filled += spread_of_runs(own, unit) + history_of_unit(own, unit)
            calibrated = [a for a in own if a.kind == "calibration"]
            if len(calibrated) > 1:
                latest = max(calibrated, key=lambda a: str(a.recording.meta.get("started_utc") or ""))
                filled += sections.budget(latest, calibrated, unit or "the unit")
    for number, analysis in enumerate(analyses, 1):
        parts = sections.key_figures(analysis, limits).parts
        if analysis.kind != "calibration" and analysis.loops.n_cycles:
            parts = (*parts, *sections.loop_drawings(analysis))
        where = (sections.where_the_loop_is(analysis),) if analysis.loops.n_cycles else ()
        filled.append(Section(f"Run {number}: {_name(analysis)}", (*parts, *where)))
    known = [u or "not named" for u in dict.fromkeys(units)]
    verdict = (
        "; ".join(f"run {i}: {_verdict(a, limits)}" for i, a in enumerate(analyses, 1))
        if limits
        else (f"{len(analyses)} runs of {len(known)} unit{'s' if len(known) > 1 else ''} compared; no limits were set.")
    )
    if units.count("") > 1:
        verdict = f"{verdict.rstrip('.')}. {units.count('')} runs name no unit and are taken to be of one."
    return Report(
        "Comparison of runs",
        ", ".join(known),
        any(a.recording.simulated for a in analyses),
        verdict,
        (("Runs", str(len(analyses))), ("Units", ", ".join(known)), ("Program", f"boat-daq {program_version()}")),
        tuple(filled),
        f"boat-daq {program_version()}",
    )


def _verdict(analysis: Analysis, limits: Mapping[str, float]) -> str:
    cycles = analysis.cycles.as_json()
    counted = f"{cycles['complete']} complete cycles, {cycles['partial']} partial"
    if not limits:
        usable = [s.calibration for s in analysis.sensors if s.calibration is not None]
        if not usable:
            return f"{counted}. No limits were set, so there is no verdict."
        low, high = usable[0].x_range
        refused = [
            f"sensor {i} is flat"
            if not s.figures["fso_mv"].value
            else f"the curve of sensor {i} turns inside the range"
            for i, s in enumerate(analysis.sensors, 1)
            if s.calibration is not None and not s.calibration.monotone
        ]
        if refused:
            return f"{counted}. Not usable: {', '.join(refused)}."
        return f"{counted}. Calibrated from {low:+.2f} to {high:+.2f} mm. No limits were set."
    verdicts = judge(analysis, limits)
    broken = [v for v in verdicts if v.kept is False]
    unknown = [v for v in verdicts if v.kept is None]
    if broken:
        said = ", ".join(f"{v.name} of {v.sensor} {v.value:.3g} against {v.limit:g} {v.unit}" for v in broken)
        return f"{counted}. FAILS: {said}."
    if unknown:
        return (
            f"{counted}. No verdict: {', '.join(f'{v.name} of {v.sensor}' for v in unknown)} could not be determined."
        )
    return f"{counted}. PASSES {'the limit' if len(limits) == 1 else f'all {len(limits)} limits'}."


def _facts(analysis: Analysis) -> tuple[tuple[str, str], ...]:
    meta, recording = analysis.recording.meta, analysis.recording
    plan = meta.get("plan")
    name = plan.get("name", "") if isinstance(plan, dict) else (plan or "")
    rows = [
        ("Unit", meta.get("unit")),
        ("Operator", meta.get("operator")),
        ("Recorded", date_of(meta.get("started_utc"))),
        ("Board", meta.get("board_id")),
        ("Plan", name),
        ("Note", meta.get("note")),
        ("Samples", f"{recording.n} at {recording.rate_hz:.1f} Hz, {recording.lost} lost"),
        ("Duration", f"{recording.duration_s:.1f} s"),
        ("Elongation", analysis.elongations.source if analysis.elongations else "not read"),
    ]
    return tuple((label, str(value)) for label, value in rows if value not in (None, ""))


def _name(analysis: Analysis) -> str:
    return f"{comparison.unit_of(analysis) or 'unit not named'}, {date_of(analysis.recording.meta.get('started_utc'))}"


def _footer(analysis: Analysis) -> str:
    recording = str(analysis.recording.meta.get("uuid") or "")[:8]
    return f"boat-daq {program_version()}   recording {recording}" if recording else f"boat-daq {program_version()}"
