"""The sections of a report on one run, each filled from an `Analysis`.

Rules: nothing is computed here but a rounding; the caller leaves out a section without content.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from analysis import published
from analysis.calibration.curve_choice import curve_name
from analysis.calibration.type_b import EXPECTED
from analysis.calibration_export.verdict import Verdict
from analysis.conformity import RULE
from analysis.figures.across_breaks import ALPHA, Break
from analysis.figures.figure import KEY_FIGURES, SENSOR_FIGURES, SYSTEM_FIGURES, void_sentences
from analysis.figures.pipeline import Analysis
from analysis.figures.sensor_analysis import SensorAnalysis
from analysis.figures.uncertainty import ElongationBudgets
from analysis.figures.warnings import reading_grid
from analysis.numbers import percent, rounded, with_uncertainty
from analysis.reports import drawings
from analysis.reports.document import ReportDrawing, ReportTable, Section, SectionPart, cell, cells, p_value, power
from analysis.version import program_version
from protocol.base.units import NOTHING, as_text

HALVED = 30  # rows of readings that are set in one column
LEAST_SPREAD = 10  # cycles whose spread at each level is drawn
NEGLIGIBLE_LIFT = 0.02  # % FSO: less is not seen in a figure of two decimals


def key_figures(analysis: Analysis, verdict: Verdict) -> Section:
    """The readings that were confirmed, the figures looked for first, limits that were set, and the curves."""
    checked = [f"The reading {one.text}, is confirmed: {one.confirmed}." for one in verdict.confirmed]
    return Section(
        "Key figures",
        (*checked, *_figure_tables(analysis, KEY_FIGURES), *_conformity_tables(analysis, verdict), *curves(analysis)),
    )


def curves(analysis: Analysis) -> list[SectionPart]:
    """Return the calibration curves with their residuals below, two sensors a row."""
    calibrated = [i for i, s in enumerate(analysis.sensors) if s.calibration is not None]
    parts: list[SectionPart] = []
    for at in range(0, len(calibrated), 2):
        row = calibrated[at : at + 2]
        parts.append(ReportDrawing(tuple(partial(drawings.calibration_curve, analysis, i) for i in row), height=2.6))
        parts.append(ReportDrawing(tuple(partial(drawings.residuals, analysis, i) for i in row), height=1.7))
    return parts


def other_figures(analysis: Analysis) -> Section:
    others = tuple(key for key in SENSOR_FIGURES if key not in KEY_FIGURES)
    tables = (*_figure_tables(analysis, others), *_unit_table(analysis))
    return Section("Other figures", (*tables, _DEFINITIONS, *_lost(analysis), *undefined(analysis)))


def undefined(analysis: Analysis) -> list[str]:
    """Return why figures are undefined."""
    return void_sentences([(f"sensor {i}", s.figures) for i, s in enumerate(analysis.sensors, 1)])


_DEFINITIONS = (
    "Intervals by bootstrap over cycles (drift: Sen). FSO: full-scale output. Hysteresis: system, signal over "
    "pressure; sensor, signal over elongation; actuator, elongation over pressure."
)


def _figure_tables(analysis: Analysis, keys: Sequence[str]) -> list[ReportTable]:
    return [_figure_table(analysis, keys, chosen) for chosen in _pairs(analysis)]


def _pairs(analysis: Analysis) -> list[range]:
    count = len(analysis.sensors)
    return [range(at, min(at + 2, count)) for at in range(0, count, 2)]


def _conformity_tables(analysis: Analysis, verdict: Verdict) -> list[ReportTable]:
    """A row for each limit, with statement and probability of two sensors a table."""
    whose = "Limits that were set" if verdict.limits_set else "Published limits; none were set"
    caption = f"{whose}. Decision rule {RULE}. Probability: that the figure keeps its limit (JCGM 106:2012)."
    tables = []
    for chosen in _pairs(analysis):
        names = [analysis.sensors[i].name for i in chosen]
        stated = {(one.tolerance.key, one.sensor): one for one in verdict.limits}
        tolerances = {one.tolerance.key: one.tolerance for one in verdict.limits if one.sensor in names}
        rows = []
        for key, tolerance in tolerances.items():
            shown: list[str] = []
            for one in (stated.get((key, name)) for name in names):
                share = one.statement.probability if one is not None else np.nan
                shown += (
                    one.conformity.label if one is not None else NOTHING,
                    percent(share, 1) if np.isfinite(share) else NOTHING,
                )
            rows.append((SENSOR_FIGURES[key].label_with_unit, f"{tolerance.symbol} {tolerance.limit:g}", *shown))
        heads = [text for i in chosen for text in (f"Sensor {i + 1}", "probability")]
        if rows:
            tables.append(ReportTable(("Conformity", "limit", *heads), tuple(rows), caption))
            caption = ""
    return tables


def _figure_table(analysis: Analysis, keys: Sequence[str], chosen: range) -> ReportTable:
    sensors = [analysis.sensors[i] for i in chosen]
    paper, rows = _is_published(analysis), []
    for key in keys:
        definition, parts = SENSOR_FIGURES[key], [s.figures.get(key) for s in sensors]
        if not any(parts):
            continue
        shown = [text for p in parts for text in cells(p, definition.decimals)]
        known = [getattr(sensor, key, None) for sensor in published.SENSORS] if paper else []
        rows.append((definition.label_with_unit, *shown, " / ".join(f"{value:g}" for value in known if value)))
    heads = [text for i in chosen for text in (f"Sensor {i + 1}", "95 % interval")]
    columns = len(heads) + 1 + any(row[-1] for row in rows)
    return ReportTable(("Figure", *heads, "Published")[:columns], tuple(row[:columns] for row in rows))


def _is_published(analysis: Analysis) -> bool:
    """Return whether the published figures are of such a unit."""
    return analysis.recording.unit in ("", published.UNIT) and len(analysis.sensors) == len(published.SENSORS)


def _unit_table(analysis: Analysis) -> list[ReportTable]:
    """The figures of the unit as a whole; none where it has none."""
    known = {"system_sensitivity_mv_per_mm": f"{published.SYSTEM_SENSITIVITY_MV_PER_MM:g}"}
    known = known if _is_published(analysis) else {}
    rows = [
        (SYSTEM_FIGURES[key].label_with_unit, *cells(figure), *([known.get(key, "")] if known else []))
        for key, figure in analysis.system_figures.items()
        if np.isfinite(figure.value)
    ]
    header = ("Figure of the unit", "value", "95 % interval", *(["Published"] if known else []))
    return [ReportTable(header, tuple(rows))] if rows else []


def _lost(analysis: Analysis) -> list[str]:
    """State which share of a sensor's windows was lost or left out, and by which reason; nothing where none was."""
    parts = []
    for i, sensor in enumerate(analysis.sensors, 1):
        window = sensor.figures["system_hysteresis_percent_fso"].window
        if window is not None and window.damaged:
            parts.append(f"sensor {i} {percent(window.share, 2)} ({window.reasons()}) of {window.samples}")
    return [f"Samples lost or left out: {', '.join(parts)}."] if parts else []


def influence_quantities(analysis: Analysis) -> list[Section]:
    """Return the section with what the extra channels explain of the signals; none where there are none."""
    rows, void = [], []
    for i, sensor in enumerate(analysis.sensors, 1):
        for found in sensor.influences:
            unit = as_text(found.unit)
            per = f"/{unit}" if unit else ""
            if found.void:
                void.append(f"{found.name} of sensor {i}: {found.void}")
                continue
            share = percent(found.effect_percent_fso / 100.0, 1) if np.isfinite(found.effect_percent_fso) else NOTHING
            span = f"{found.low:.4g} to {found.high:.4g} {unit}".rstrip()
            slope = with_uncertainty(found.coefficient_mv, found.expanded_mv)
            drift = "may be drift" if found.like_drift else ""
            rows.append((str(i), found.name, span, f"{slope} mV{per}", f"{found.correlation:+z.2f}", share, drift))
    if not rows and not void:
        return []
    header = ("Sensor", "quantity", "range", "coefficient (95 %)", "correlation", "of FSO over the range", "")
    caption = (
        "The signal's difference from its mean at equal pressure and branch, over that of the quantity. May be drift: "
        "the quantity changed steadily with time."
    )
    parts: list[SectionPart] = [ReportTable(header, tuple(rows), caption)] if rows else []
    return [Section("Influence quantities", (*parts, *([f"No coefficient: {'; '.join(void)}."] if void else [])))]


def coefficients(analysis: Analysis) -> Section:
    parts: list[SectionPart] = []
    sampled = any(sensor.posterior for sensor in analysis.sensors)
    for i, sensor in enumerate(analysis.sensors):
        c, p = sensor.calibration, sensor.posterior
        if c is None:
            parts.append(f"Sensor {i + 1} is not calibrated: {sensor.calibration_void}.")
            continue
        rows = []
        for k, (b, u) in enumerate(zip(c.coefficients, c.std_errors_with_reading, strict=True)):
            posterior = with_uncertainty(float(p.mean[k]), float(p.sd[k])) if p else NOTHING
            unit = f"mV/mm{power(k)}" if k else "mV"
            rows.append((f"b{k}", with_uncertainty(float(b), float(u)), *([posterior] if sampled else []), unit))
        if c.spline is not None:
            parts.append(
                f"Sensor {i + 1}: a monotone cubic spline of {len(c.spline.knots)} knots. {_quality(analysis, i)}"
            )
            continue
        header = (f"Sensor {i + 1}", "least squares ± u", *(["posterior ± sd"] if sampled else []), "unit")
        caption = f"y = b0 + b1 x + ..., x in mm. {_quality(analysis, i)}"
        parts.append(ReportTable(header, tuple(rows), caption))
    return Section("Coefficients", tuple(parts))


def _quality(analysis: Analysis, sensor: int) -> str:
    c, p = analysis.sensors[sensor].calibration, analysis.sensors[sensor].posterior
    assert c is not None
    turning = ", ".join(f"{t:.2f}" for t in c.turning_points) or "none"
    r2 = f"R² = {c.r2:.5f}" if np.isfinite(c.r2) else "R² undefined"
    text = (
        f"{r2}, residual sd {c.residual_sd:.2f} mV, n = {c.n}, range {c.x_range[0]:+z.2f} to "
        f"{c.x_range[1]:+z.2f} mm, {'monotone' if c.monotone else 'NOT monotone'}, turning points {turning} mm."
    )
    checks = analysis.sensors[sensor].checks or {}
    lack = analysis.sensors[sensor].figures["lack_of_fit_percent_fso"]
    text += f" Curve {lack.note or lack.void}."
    if c.adequacy is not None:
        tried = c.adequacy.candidates
        errors = [(rounded(curve.prediction_rms, curve.prediction_rms), curve_name(curve.name)) for curve in tried]
        predicted = ", ".join(f"{error} ({name})" for error, name in errors)
        text += f" Cross-validated rms error, mV: {predicted}."
    text += f" Degree by AICc: {checks['preferred_degree'] or 'too few points'}."
    if p is not None:
        text += f" Posterior: {p.n_eff:.0f} effective samples, autocorrelation time {p.tau:.0f}, "
        text += "converged." if p.converged else "NOT CONVERGED."
    return text


def hysteresis(analysis: Analysis, verdict: Verdict) -> Section:
    """Return the section with loading minus unloading over pressure: of the signals and, where read, of the tip."""
    stated = (one.tolerance for one in verdict.limits if one.tolerance.key == "system_hysteresis_percent_fso")
    limit = next((tolerance.limit for tolerance in stated), None)
    x = analysis.loops.elongation_mm
    draws = [partial(drawings.loop_difference, analysis, limit)]
    if x is not None and np.isfinite(x).any():
        draws.append(partial(drawings.actuator_loop, analysis))
    return Section("Hysteresis", (ReportDrawing(tuple(draws), height=2.3 if draws[1:] else 3.6),))


def over_cycles(analysis: Analysis) -> Section:
    """Return the section on the figures of each cycle: hysteresis, drift, noise, span, levels, warm-up."""
    each = partial(drawings.per_cycle_figure, analysis)
    width = partial(each, "hysteresis_percent_fso", "hysteresis, % FSO", "Hysteresis per cycle")
    drift = partial(each, "displacement_percent_fso", "displacement, % FSO", "Common drift")
    snr = partial(each, "snr_db", "SNR, dB", "Signal-to-noise ratio per cycle")
    span = partial(each, "span_mv", "span, mV", "Output span per cycle")
    displacement = "Displacement: mean of all levels, relative to the second half of the run."
    parts: list[SectionPart] = [ReportDrawing((width, drift), displacement, 2.3)]
    many = analysis.loops.n_cycles >= LEAST_SPREAD
    parts += [ReportDrawing((snr, span), height=2.3)] if many else []
    for i, sensor in enumerate(analysis.sensors):
        if sensor.figures["fso_mv"].value > 0 and many:
            of_levels = tuple(partial(draw, analysis, i) for draw in (drawings.drift_of_levels, drawings.distribution))
            parts.append(ReportDrawing(of_levels, height=2.7))
    parts += [text for i, s in enumerate(analysis.sensors, 1) if (text := single_cycles(i, s))]
    warm_ups = {sensor.by_cycle.warm_up for sensor in analysis.sensors} - {0}
    for warm in sorted(warm_ups):
        of = " and ".join(str(i) for i, s in enumerate(analysis.sensors, 1) if s.by_cycle.warm_up == warm)
        numbers = analysis.loops.numbers[:warm]
        listed = ", ".join(map(str, numbers)) if warm <= 3 else f"{numbers[0]} to {numbers[-1]}"
        which = f"Sensor {of}: warm-up in cycle{'s' if warm > 1 else ''} {listed}"
        parts.append(f"{which}, beyond three robust standard deviations of the second half.")
    return Section("Cycle by cycle", tuple(parts))


def single_cycles(number: int, sensor: SensorAnalysis) -> str:
    """Explain why a cycle's hysteresis is larger than the headline's; nothing where it is not."""
    lift, figure = sensor.by_cycle.hysteresis_lift_percent_fso, sensor.figures["system_hysteresis_percent_fso"]
    known = [value for value in sensor.system_hysteresis_per_cycle if np.isfinite(value)]
    median = float(np.median(known)) if known else np.nan
    u = (figure.high - figure.low) / 4
    if not median - figure.value > max(u, NEGLIGIBLE_LIFT) or not np.isfinite(lift):
        return ""
    return (
        f"Sensor {number}: a single cycle has a hysteresis of {median:.2f} % FSO (median), the mean loop "
        f"{figure.value:.2f} % FSO. The widest of many noisy distances is lifted by noise, here by {lift:.2f} % FSO on "
        f"average; less that, a cycle has {median - lift:.2f} % FSO."
    )


def budget(found: ElongationBudgets | None, of: str = "", analysis: Analysis | None = None) -> list[Section]:
    """Return the section on the budget of an elongation; none without a calibration."""
    if found is None:
        return []
    title = f"Uncertainty of an elongation{f' with {of}' if of else ''}"
    parts: list[SectionPart] = []
    if analysis is not None and any(u.size for u in analysis.u_elongation):
        over_x = partial(drawings.uncertainty_over_x, analysis.u_elongation)
        why = (f" Sensor {i}: {reason}." for i, reason in enumerate(analysis.u_reason, 1) if reason)
        parts.append(ReportDrawing((over_x,), f"U of one reading by each sensor.{''.join(why)}", 2.1))
    parts.append(f"Not given: {found.void}." if found.void else _budget_table(found))
    return [Section(title, tuple(parts))]


def _budget_table(found: ElongationBudgets) -> ReportTable:
    """The sensors' budgets side by side; what was assessed for none of them is named below."""
    budgets, rows, missing = found.budgets, [], dict[str, list[str]]()
    shares = [b.shares() for b in budgets]
    traced = list(dict.fromkeys(b.traceability for b in budgets if b.traceability is not None))
    named = set() if all(one.traceable for one in traced) else set(EXPECTED.values())  # by the sentence on that
    for parts in zip(*(b.components for b in budgets), strict=True):
        name, source = parts[0].name, _sources([c.source for c in parts])
        if not any(c.assessed for c in parts):
            if name not in named:
                missing.setdefault(source.removeprefix("not assessed: "), []).append(name)
            continue
        both = [
            (f"{c.contribution:.4f}", percent(own[name], 1)) if c.assessed else (NOTHING, NOTHING)
            for c, own in zip(parts, shares, strict=True)
        ]
        rows.append((name, *sum(both, ()), source))
    dof = " / ".join(
        dict.fromkeys(
            (NOTHING if np.isnan(b.dof) else f"{b.dof:.0f}" if b.dof < 10000 else "above 10,000") for b in budgets
        )
    )
    covers = " / ".join(dict.fromkeys(NOTHING if b.void else percent(b.coverage) for b in budgets))
    combined = (t for b in budgets for t in ((NOTHING, NOTHING) if b.void else (f"{b.u:.4f}", "100 %")))
    expanded = (
        t for b in budgets for t in (NOTHING if b.void else f"{b.expanded:.3f}{', stated' if b.stand_in else ''}", "")
    )
    known = not all(b.void for b in budgets)
    rows.append(("combined", *combined, f"effective degrees of freedom {dof}" if known else ""))
    rows.append(("expanded, k = 2", *expanded, f"covers about {covers}" if known else ""))
    heads = (t for i in range(1, len(budgets) + 1) for t in (f"sensor {i}, mm", "share"))
    halves = (f"U is not known: {b.void}" if b.void else b.what_halves_it() for b in budgets)
    lines = [f"At x = {found.x_mm:+z.2f} mm, the middle of the range"]
    lines += [f"Not assessed: {', '.join(names)} ({why})" for why, names in missing.items()]
    lines += [f"An elongation is {one.text}" for one in traced]
    lines += [f"Sensor {i}: {text}" for i, text in enumerate(halves, 1)]
    return ReportTable(("Component", *heads, "source"), tuple(rows), ". ".join(lines) + ".")


def _sources(texts: Sequence[str]) -> str:
    """Join the sources of a component, one a sensor; what they begin with is named once."""
    heads, tails = zip(*(text.partition(", ")[::2] for text in dict.fromkeys(texts)), strict=True)
    if len(tails) > 1 and len(set(heads)) == 1 and all(tails):
        return f"{heads[0]}, {' / '.join(tails)}"
    return " / ".join(dict.fromkeys(texts))


def readings(analysis: Analysis) -> Section:
    errors = np.nanmedian([p.signal_se_mv for p in analysis.plateaus], axis=0)
    void = any(p.void for p in analysis.plateaus)
    rows = []
    for i, p in enumerate(analysis.plateaus):
        if p.branch:
            signals = [
                rounded(mean, error) if np.isfinite(mean) else NOTHING
                for mean, error in zip(p.signal_mv, errors, strict=True)
            ]
            x = analysis.elongations.elongation_mm[i] if analysis.elongations else np.nan
            where = (str(p.number), str(p.cycle), p.branch, _two_places(p.pressure_kpa), _two_places(x))
            rows.append((*where, *signals, str(min(p.n)), *(["void" if p.void else ""] if void else [])))
    names = (f"s{i + 1}, mV" for i in range(len(analysis.sensors)))
    header = ("no.", "cycle", "branch", "kPa", "mm", *names, "n", *([""] if void else []))
    typical = ", ".join(f"{rounded(error, error)} mV (s{i})" for i, error in enumerate(errors, 1))
    caption = f"Means of the signals; median standard error {typical}."
    caption += " The warnings name why a plateau is void." if void else ""
    return Section("Plateaus and readings", (ReportTable(header, tuple(rows), caption, halved=len(rows) > HALVED),))


def _grid(analysis: Analysis) -> str:
    """The grid that the readings were taken from, where it is from, and the standard deviation of a reading."""
    found = reading_grid(analysis)
    if found is None:
        return NOTHING
    origin = {"steps": "from their own steps", "stated": "as stated", "image": "from the uncertainty of the image"}
    return f"{found['mm']:g} mm, {origin[str(found['from'])]}; sd {analysis.reading_sd_mm:.2g} mm"


def _two_places(value: float) -> str:
    return f"{value:+z.2f}" if np.isfinite(value) else NOTHING


def run(analysis: Analysis) -> Section:
    """Return the section with the pressure of the run, its warnings and its settings."""
    o = analysis.options
    calibrated = any(s.calibration for s in analysis.sensors)
    degrees = dict.fromkeys(s.calibration.curve for s in analysis.sensors if s.calibration is not None)
    fitted = (("Degree or curve", " / ".join(degrees)), ("Reading grid", _grid(analysis)))
    settings = (
        *(fitted if calibrated else ()),
        ("Settled within", f"{o.plateau.tolerance_kpa:g} kPa for {o.plateau.settling_s:g} s"),
        ("Void above", f"{percent(o.plateau.max_damaged)} of a window lost or left out"),
        ("Seed", str(o.seed)),
        ("Program", f"boat-daq {program_version()}"),
        ("Recorded with", str(analysis.recording.meta.get("program_version") or "–")),
        ("Recording", str(analysis.recording.meta.get("uuid") or analysis.recording.source)),
    )
    # SIMULATED is across the head of every page
    warnings = tuple((w.code.replace("_", " "), w.sentence) for w in analysis.warnings if w.code != "simulated")
    parts: list[SectionPart] = [ReportDrawing((partial(drawings.trace, analysis),), height=1.9)]
    parts.append(ReportTable(("Warning", "Text"), warnings, numeric=False) if warnings else "No warnings.")
    parts.append(ReportTable(("Setting", "Value"), settings, numeric=False))
    return Section("The run, warnings and settings", tuple(parts))


_OF_A_PART = ("sensitivity_mv_per_mm", "fso_mv", "system_hysteresis_percent_fso", "repeatability_percent_fso")


def breaks(analysis: Analysis) -> Section:
    """One table a break, and one of the parts' figures where they differ."""
    parts: list[SectionPart] = []
    for found in analysis.breaks:
        parts += [found.sentence.capitalize() + ".", _comparisons(found)]
    if analysis.parts:
        parts.append(_parts(analysis))
    return Section("Before and after the interruption", tuple(parts))


def _comparisons(found: Break) -> ReportTable:
    rows = tuple(
        (
            f"{c.sensor} {c.quantity}, {c.unit}",
            with_uncertainty(c.mean_before, c.sd_before),
            with_uncertainty(c.mean_after, c.sd_after),
            f"{rounded(c.difference, (c.difference_high - c.difference_low) / 4)}",
            _test(c.t, f"({c.t_df})", c.t_p),
            _test(c.f, f"({c.f_df_after}, {c.f_df_before})", c.f_p),
            ", ".join(c.significant) or "no",
        )
        for c in found.comparisons
    )
    header = ("Quantity", "Before", "After", "Step", "t (df), p", "F (df), p", "Significant")
    n = found.comparisons[0] if found.comparisons else None
    counts = f"{n.n_before} and {n.n_after} cycles. " if n else ""
    return ReportTable(
        header, rows, f"{counts}Mean ± sd of one cycle; family-wise level {ALPHA:g} (Holm).", numeric=False
    )


def _test(value: float, df: str, p: float) -> str:
    return NOTHING if p != p else f"{value:.2f} {df}, p {p_value(p)}"


def _parts(analysis: Analysis) -> ReportTable:
    header = ("Figure", *(f"cycles {part.cycles[0]} to {part.cycles[-1]}" for part in analysis.parts))
    rows = tuple(
        (
            f"{sensor.name} {SENSOR_FIGURES[key].label_with_unit}",
            *(cell(p.sensors[i].figures[key], SENSOR_FIGURES[key].decimals) for p in analysis.parts),
        )
        for i, sensor in enumerate(analysis.sensors)
        for key in _OF_A_PART
        if key in sensor.figures
    )
    return ReportTable(header, rows, "Figures of each part with 95 % intervals.", numeric=False)
