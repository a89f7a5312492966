"""A report's content: what stands in it and in which order, for HTML and PDF alike.

Strategy: a report is a list of sections, a section holds paragraphs, tables and drawings. This file fills them from
analyses and computes nothing; `report_html` and `report_pdf` only set them. What a reader looks at first stands first:
verdict and key figures, then curves, loops, drift, uncertainty, tables, settings, provenance.

Rules: every figure of a table is one of `Analysis`, rounded as its uncertainty warrants; a void figure prints a dash
and its reason; SIMULATED stands across the head of every page of a simulated run.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from analysis import comparison, figures
from analysis.boat_file import program_version
from analysis.checks import fit_checks
from analysis.errors import AnalysisError, RequestError
from analysis.figures import Draw
from analysis.history import unit_history
from analysis.numbers import NOTHING, rounded, with_uncertainty
from analysis.pipeline import Analysis
from analysis.repeatability import LIMITS, judge, per_cycle
from analysis.statistics import Figure
from analysis.uncertainty import Budget, elongation_budget

PUBLISHED = {
    "sensitivity_mv_per_mm": ("39.3", "29.2"), "snr_db": ("44.7", "45.2"),
    "system_hysteresis_percent_fso": ("4.95", "4.46"),
}  # fmt: skip
KEY_FIGURES = (
    ("sensitivity_mv_per_mm", "Sensitivity, end to end"), ("fso_mv", "Full-scale output"),
    ("system_hysteresis_percent_fso", "Hysteresis, system (over pressure)"),
    ("sensor_hysteresis_percent_fso", "Hysteresis, sensor (over elongation)"),
    ("nonlinearity_percent_fso", "Non-linearity"), ("repeatability_percent_fso", "Repeatability, pooled"),
    ("repeatability_worst_percent_fso", "Repeatability, worst level"), ("combined_error_percent_fso", "Combined error"),
    ("drift_percent_fso_per_100_cycles", "Drift"), ("noise_mv", "Noise, rms"), ("snr_db", "Signal-to-noise ratio"),
    ("slope_at_rest_mv_per_mm", "Slope at rest"), ("least_squares_slope_mv_per_mm", "Least-squares slope"),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Table:
    """A table; columns after the first are aligned right where `numeric`."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    numeric: bool = True


@dataclass(frozen=True, slots=True)
class Drawing:
    """Drawings side by side, or stacked on one abscissa with `ratios`; size and left margin in inches."""

    draw: tuple[Draw, ...]
    caption: str
    height: float = 2.9
    ratios: tuple[float, ...] = ()
    left: float = 0.62


@dataclass(frozen=True, slots=True)
class Section:
    """A heading and what follows it."""

    title: str
    parts: tuple[str | Table | Drawing, ...]


@dataclass(frozen=True, slots=True)
class Report:
    """All that is set. `facts` are the lines of the head: who, what, when."""

    title: str
    subject: str
    simulated: bool
    verdict: str
    facts: tuple[tuple[str, str], ...]
    sections: tuple[Section, ...]
    footer: str
    keywords: Mapping[str, str] = field(default_factory=dict)


def build_report(analyses: Sequence[Analysis], limits: Mapping[str, float] | None = None) -> Report:
    """Fill a report: calibration or repeatability, as the run is; several runs are compared.

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
    sections = [_key_figures(analysis, limits)]
    if any(s.calibration for s in analysis.sensors):
        sections += [_curves(analysis), _coefficients(analysis)]
    sections += [_loops(analysis)] if analysis.loops.n_cycles else []
    sections += [_over_cycles(analysis)] if analysis.loops.n_cycles > 1 else []
    sections += _budget(analysis)
    if analysis.plateaus:
        sections.append(_readings(analysis))
    sections.append(_run(analysis))
    names = {"calibration": "Calibration report", "staircase": "Staircase report"}
    title = names.get(analysis.kind, "Repeatability report")
    return Report(
        title, comparison.unit_of(analysis) or "unit not named", analysis.recording.simulated, _verdict(analysis, limits),
        _facts(analysis), tuple(sections), _footer(analysis),
    )  # fmt: skip


def _several(analyses: Sequence[Analysis], limits: Mapping[str, float]) -> Report:
    units = [comparison.unit_of(a) for a in analyses]
    sections = [_runs_table(analyses)]
    for unit in dict.fromkeys(units):
        own = [a for a, u in zip(analyses, units, strict=True) if u == unit]
        if len(own) > 1:
            sections += _spread(own, unit) + _history(own, unit)
    for number, analysis in enumerate(analyses, 1):
        part = _key_figures(analysis, limits)
        sections.append(Section(f"Run {number}: {_name(analysis)}", part.parts))
        if analysis.loops.n_cycles:
            sections.append(Section(f"Run {number}: loops", _loops(analysis).parts))
    known = [u or "not named" for u in dict.fromkeys(units)]
    verdict = "; ".join(f"run {i}: {_verdict(a, limits)}" for i, a in enumerate(analyses, 1)) if limits else (
        f"{len(analyses)} runs of {len(known)} unit{'s' if len(known) > 1 else ''} compared; no limits were set."
    )  # fmt: skip
    return Report(
        "Comparison of runs", ", ".join(known), any(a.recording.simulated for a in analyses), verdict,
        (("Runs", str(len(analyses))), ("Units", ", ".join(known)), ("Program", f"boat-daq {program_version()}")),
        tuple(sections), f"boat-daq {program_version()}",
    )  # fmt: skip


def _verdict(analysis: Analysis, limits: Mapping[str, float]) -> str:
    cycles = analysis.cycles.as_json()
    counted = f"{cycles['complete']} complete cycles, {cycles['partial']} partial"
    if not limits:
        usable = [s.calibration for s in analysis.sensors if s.calibration is not None]
        if not usable:
            return f"{counted}. No limits were set, so there is no verdict."
        low, high = usable[0].x_range
        refused = [s.name for s in analysis.sensors if s.calibration is not None and not s.calibration.monotone]
        if refused:
            return f"{counted}. Not usable: the curve of {', '.join(refused)} turns inside the range."
        return f"{counted}. Calibrated from {low:+.2f} to {high:+.2f} mm. No limits were set."
    verdicts = judge(analysis, limits)
    broken = [v for v in verdicts if v.kept is False]
    unknown = [v for v in verdicts if v.kept is None]
    if broken:
        said = ", ".join(f"{v.name} of {v.sensor} {v.value:.3g} against {v.limit:g} {v.unit}" for v in broken)
        return f"{counted}. FAILS: {said}."
    if unknown:
        return f"{counted}. No verdict: {', '.join(f'{v.name} of {v.sensor}' for v in unknown)} could not be determined."
    return f"{counted}. PASSES all {len(limits)} limits."


def _facts(analysis: Analysis) -> tuple[tuple[str, str], ...]:
    meta, recording = analysis.recording.meta, analysis.recording
    plan = meta.get("plan")
    name = plan.get("name", "") if isinstance(plan, dict) else (plan or "")
    rows = [
        ("Unit", meta.get("unit")), ("Operator", meta.get("operator")), ("Recorded", _date(meta.get("started_utc"))),
        ("Board", meta.get("board_id")), ("Plan", name), ("Note", meta.get("note")),
        ("Samples", f"{recording.n} at {recording.rate_hz:.1f} Hz, {recording.lost} lost"),
        ("Duration", f"{recording.duration_s:.1f} s"),
        ("Elongation", analysis.elongations.source if analysis.elongations else "not read"),
    ]  # fmt: skip
    return tuple((label, str(value)) for label, value in rows if value not in (None, ""))


def _key_figures(analysis: Analysis, limits: Mapping[str, float]) -> Section:
    paper = comparison.unit_of(analysis) in ("", "SA1") and len(analysis.sensors) == 2
    rows = []
    for key, label in KEY_FIGURES:
        parts = [s.figures.get(key) for s in analysis.sensors]
        if all(p is None for p in parts):
            continue
        unit = next(p.unit for p in parts if p is not None)
        cells = [_cell(p) for p in parts]
        published = " / ".join(PUBLISHED[key]) if paper and key in PUBLISHED else ""
        limit = next((f"{limits[n]:g}" for n, (k, _, _) in LIMITS.items() if k == key and n in limits), "")
        rows.append((label, *cells, unit, published, limit))
    if np.isfinite(analysis.system_sensitivity.value):
        span = ["" for _ in analysis.sensors[1:]]
        published = "34.2" if paper else ""
        rows.append(("Sensitivity of the system", _cell(analysis.system_sensitivity), *span, "mV/mm", published, ""))
    if np.isfinite(analysis.actuator_hysteresis.value):
        span = ["" for _ in analysis.sensors[1:]]
        rows.append(("Hysteresis, actuator (x over p)", _cell(analysis.actuator_hysteresis), *span, "% of span", "", ""))
    header = ("Figure", *(f"Sensor {i + 1}" for i in range(len(analysis.sensors))), "Unit", "Published", "Limit")
    keep = [i for i in range(len(header)) if i < len(header) - 2 or any(row[i] for row in rows)]
    table = Table(
        tuple(header[i] for i in keep), tuple(tuple(row[i] for i in keep) for row in rows),
        "Square brackets: 95 % confidence interval, bootstrap over cycles (drift: Sen). FSO: full-scale output.",
    )  # fmt: skip
    void = sorted({f"{label}: {p.void}." for k, label in KEY_FIGURES for s in analysis.sensors
                   if (p := s.figures.get(k)) is not None and p.void})  # fmt: skip
    return Section("Key figures", (table, *void))


def _curves(analysis: Analysis) -> Section:
    parts: list[str | Table | Drawing] = []
    for i, sensor in enumerate(analysis.sensors):
        if sensor.calibration is not None:
            drawing = (figures.calibration_curve(analysis, i), figures.residuals(analysis, i))
            caption = f"Sensor {i + 1}: plateau means, fit and bands; below, residuals."
            parts.append(Drawing(drawing, caption, 3.9, (2.6, 1.0)))
    return Section("Calibration curve", tuple(parts))


def _coefficients(analysis: Analysis) -> Section:
    parts: list[str | Table | Drawing] = []
    for i, sensor in enumerate(analysis.sensors):
        c, p = sensor.calibration, sensor.posterior
        if c is None:
            parts.append(f"Sensor {i + 1} is not calibrated: {sensor.calibration_void}.")
            continue
        rows = []
        for k, (b, u) in enumerate(zip(c.coefficients, c.std_errors, strict=True)):
            sampled = with_uncertainty(float(p.mean[k]), float(p.sd[k])) if p else NOTHING
            rows.append((f"b{k}", with_uncertainty(float(b), float(u)), sampled, "mV" if k == 0 else f"mV/mm{_power(k)}"))
        header = ("", "least squares ± u", "posterior ± sd", "unit")
        parts.append(Table(header, tuple(rows), f"Sensor {i + 1}: y = b0 + b1 x + ..., x in mm. {_quality(analysis, i)}"))
    return Section("Coefficients", tuple(parts))


def _quality(analysis: Analysis, sensor: int) -> str:
    c, p = analysis.sensors[sensor].calibration, analysis.sensors[sensor].posterior
    assert c is not None
    turning = ", ".join(f"{t:.2f}" for t in c.turning_points) or "none"
    text = (
        f"R² = {c.r2:.5f}, residual sd {c.residual_sd:.2f} mV, n = {c.n}, range {c.x_range[0]:+.2f} to {c.x_range[1]:+.2f} mm, "
        f"{'monotone' if c.monotone else 'NOT monotone'}, turning points {turning} mm."
    )
    checks = fit_checks(c, analysis.sensors[sensor].point_cycle)
    if checks["lack_of_fit"] is not None:
        text += f" Lack of fit: F = {checks['lack_of_fit']['f']:.2f}, p = {checks['lack_of_fit']['p']:.3f}."
    text += f" Degree by AICc: {checks['preferred_degree']}."
    if p is not None:
        text += f" Posterior: {p.n_eff:.0f} effective samples, tau {p.tau:.0f}, "
        text += "converged." if p.converged else "NOT CONVERGED."
    return text


def _loops(analysis: Analysis) -> Section:
    parts: list[str | Table | Drawing] = []
    draws = [figures.system_loop(analysis, i) for i in range(len(analysis.sensors))]
    for at in range(0, len(draws), 2):
        parts.append(Drawing(tuple(draws[at : at + 2]), "Every cycle; unloading and loading branch.", 2.9))
    second = [figures.loop_difference(analysis)]
    if analysis.loops.elongation_mm is not None and np.isfinite(analysis.loops.elongation_mm).any():
        second.append(figures.actuator_loop(analysis))
    parts.append(Drawing(tuple(second), "Where the hysteresis sits, and the actuator's own loop where x was read.", 2.7))
    return Section("Hysteresis loops", tuple(parts))


def _over_cycles(analysis: Analysis) -> Section:
    sensors = range(len(analysis.sensors))
    parts: list[str | Table | Drawing] = [
        Drawing(
            (
                figures.per_cycle_figure(analysis, "hysteresis_percent_fso", "hysteresis, % FSO", "Hysteresis per cycle"),
                figures.per_cycle_figure(analysis, "displacement_percent_fso", "displacement, % FSO", "Common drift"),
            ),
            "Each cycle; displacement is the mean of all levels from the second half of the run.", 2.5,
        ),
        Drawing(
            (
                figures.per_cycle_figure(analysis, "snr_db", "SNR, dB", "Signal-to-noise ratio per cycle"),
                figures.per_cycle_figure(analysis, "span_mv", "span, mV", "Output span per cycle (sensitivity to pressure)"),
            ),
            "Each cycle.", 2.5,
        ),
    ]  # fmt: skip
    parts += [
        Drawing((figures.drift_of_levels(analysis, i), figures.distribution(analysis, i)), f"Sensor {i + 1}.", 2.8)
        for i in sensors
    ]
    for i in sensors:
        warm = per_cycle(analysis, i).warm_up
        if warm:
            numbers = ", ".join(str(n) for n in analysis.loops.numbers[:warm])
            parts.append(f"Sensor {i + 1}: warm-up cycles {numbers}, beyond three robust sds of the second half.")
    return Section("Over the cycles", tuple(parts))


def _budget(analysis: Analysis) -> list[Section]:
    try:
        calibrations = [s.calibration for s in analysis.sensors if s.calibration is not None]
        if not calibrations:
            return []
        middle = sum(calibrations[0].x_range) / 2
        budgets = elongation_budget(analysis, middle)
    except AnalysisError as error:
        return [Section("Uncertainty of an elongation", (f"Not given: {error.cause}.",))]
    drawing = Drawing(
        tuple(figures.budget_pareto(b, f"Sensor {i + 1} at {middle:+.2f} mm") for i, b in enumerate(budgets[:2])),
        "Components, largest first, with their share of the variance.", 2.6, left=1.05,
    )  # fmt: skip
    return [Section("Uncertainty of an elongation", (drawing, *(_budget_table(i, b) for i, b in enumerate(budgets))))]


def _budget_table(sensor: int, budget: Budget) -> Table:
    shares = budget.shares()
    rows = [(c.name, f"{1000 * c.contribution:.1f}", f"{shares[c.name]:.1%}", c.source) for c in budget.components]
    rows.append(("combined", f"{1000 * budget.u:.1f}", "100 %", f"effective degrees of freedom {budget.dof:.0f}"))
    rows.append(("expanded, k = 2", f"{1000 * budget.expanded:.0f}", "", "about 95 %"))
    return Table(("Component", "u, µm", "share", "source"), tuple(rows), f"Sensor {sensor + 1}: {budget.what_halves_it()}.")


def _readings(analysis: Analysis) -> Section:
    x = analysis.elongations.elongation_mm if analysis.elongations else None
    rows = []
    for i, p in enumerate(analysis.plateaus):
        if not p.branch:
            continue
        signals = [with_uncertainty(m, u) for m, u in zip(p.signal_mv, p.signal_se_mv, strict=True)]
        reading = f"{x[i]:+.2f}" if x is not None and np.isfinite(x[i]) else NOTHING
        rows.append((str(p.number), str(p.cycle), p.branch, f"{p.pressure_kpa:+.2f}", reading, *signals,
                     str(min(p.n)), p.void or ""))  # fmt: skip
    header = ("no.", "cycle", "branch", "kPa", "mm", *(f"s{i + 1}, mV" for i in range(len(analysis.sensors))), "n", "void")
    keep = [i for i in range(len(header)) if header[i] != "void" or any(row[i] for row in rows)]
    table = Table(tuple(header[i] for i in keep), tuple(tuple(r[i] for i in keep) for r in rows), "Means ± standard error.")
    return Section("Plateaus and readings", (table,))


def _run(analysis: Analysis) -> Section:
    o = analysis.options
    settings = (
        ("Degree", str(o.degree)), ("Settled within", f"{o.plateau.tolerance_kpa:g} kPa for {o.plateau.settling_s:g} s"),
        ("Void above", f"{o.plateau.max_damaged:.0%} of a window lost or left out"),
        ("Reading error, sd", f"{analysis.reading_sd_mm:.3f} mm"), ("Seed", str(o.seed)),
        ("Program", f"boat-daq {program_version()}"), ("Recorded with", str(analysis.recording.meta.get("program_version"))),
        ("Recording", str(analysis.recording.meta.get("uuid") or analysis.recording.source)),
    )  # fmt: skip
    flags = tuple((f["code"].replace("_", " "), f["text"]) for f in analysis.flags)
    parts: list[str | Table | Drawing] = [Drawing((figures.trace(analysis),), "Measured pressure.", 1.9)]
    parts.append(Table(("Flag", "What"), flags, numeric=False) if flags else "No flags: nothing was lost, masked or void.")
    parts.append(Table(("Setting", "Value"), settings, numeric=False))
    return Section("The run, flags and settings", tuple(parts))


def _runs_table(analyses: Sequence[Analysis]) -> Section:
    rows = []
    for number, a in enumerate(analyses, 1):
        for sensor in a.sensors:
            cells = [_cell(sensor.figures.get(k)) for k in
                     ("sensitivity_mv_per_mm", "system_hysteresis_percent_fso", "snr_db", "fso_mv")]  # fmt: skip
            b0 = NOTHING
            if sensor.calibration is not None:
                b0 = with_uncertainty(float(sensor.calibration.coefficients[0]), float(sensor.calibration.std_errors[0]))
            rows.append((str(number), comparison.unit_of(a), sensor.name, b0, *cells))
    header = ("run", "unit", "sensor", "b0, mV", "sensitivity, mV/mm", "hysteresis, % FSO", "SNR, dB", "FSO, mV")
    return Section("The runs side by side", (Table(header, tuple(rows), "95 % intervals within each run."),))


def _spread(analyses: Sequence[Analysis], unit: str) -> list[Section]:
    rows = []
    for i in range(min(len(a.sensors) for a in analyses)):
        try:
            spread = comparison.sensor_spread(analyses, i)
        except AnalysisError as error:
            return [Section(f"Spread of {unit}", (f"Not given: {error.cause}.",))]
        for label, value in (("within a run (s_r)", spread.pooled.repeatability), ("between runs (s_L)", spread.pooled.between),
                             ("reproducibility (s_R)", spread.pooled.reproducibility)):  # fmt: skip
            rows.append((spread.name, label, f"{value:.3g}", f"{100 * value / spread.full_scale_mv:.3f}"))
    table = Table(
        ("sensor", "standard deviation", "mV", "% FSO"), tuple(rows),
        f"{len(analyses)} runs; pooled over pressure levels and branches (ISO 5725-2).",
    )  # fmt: skip
    return [Section(f"Within-run and between-run spread of {unit or 'the unit'}", (table,))]


def _history(analyses: Sequence[Analysis], unit: str) -> list[Section]:
    parts: list[str | Table | Drawing] = []
    for i in range(min(len(a.sensors) for a in analyses)):
        try:
            history = unit_history(analyses, i)
        except AnalysisError:
            continue
        if len(history.when) < 2:
            continue
        rows = [
            (when, with_uncertainty(v, u), rounded(e, 0.1) if np.isfinite(e) else NOTHING,
             "outside" if k in history.out_of_control else "")
            for k, (when, v, u, e) in enumerate(
                zip(map(_date, history.when), history.value_mv, history.expanded_mv, history.en, strict=True))
        ]  # fmt: skip
        caption = (
            f"Sensor {i + 1} at x = {history.check_point_mm:g} mm: mean {history.centre_mv:.2f} mV, control limits "
            f"{history.lower_mv:.2f} to {history.upper_mv:.2f} mV; U with k = 2; |En| above 1 is disagreement."
        )
        parts.append(Table(("calibrated", "y(x0) ± U, mV", "En", "control"), tuple(rows), caption))
    return [Section(f"History of {unit or 'the unit'}", tuple(parts))] if parts else []


def _cell(figure: Figure | None) -> str:
    if figure is None or np.isnan(figure.value):
        return NOTHING
    half = (figure.high - figure.low) / 4
    text = rounded(figure.value, half)
    if np.isfinite(figure.low) and np.isfinite(figure.high):
        text += f" [{rounded(figure.low, half)}, {rounded(figure.high, half)}]"
    return text


def _power(k: int) -> str:
    return {1: "", 2: "²", 3: "³"}.get(k, f"^{k}")


def _date(text: object) -> str:
    try:
        return datetime.datetime.fromisoformat(str(text)).strftime("%Y-%m-%d %H:%M:%S %z")
    except ValueError:
        return str(text or "")


def _name(analysis: Analysis) -> str:
    return f"{comparison.unit_of(analysis) or 'unit not named'}, {_date(analysis.recording.meta.get('started_utc'))}"


def _footer(analysis: Analysis) -> str:
    recording = str(analysis.recording.meta.get("uuid") or "")[:8]
    return f"boat-daq {program_version()}   recording {recording}" if recording else f"boat-daq {program_version()}"
