"""The section of a report on a run that was interrupted and resumed: the tests over the break, and both parts.

Rules: nothing is computed here but a rounding.
"""

from __future__ import annotations

from analysis.figures.across_breaks import ALPHA, Break
from analysis.figures.figure import SENSOR_FIGURES
from analysis.figures.pipeline import Analysis
from analysis.numbers import NOTHING, rounded, with_uncertainty
from analysis.reports.cells import cell, p_value
from analysis.reports.document import ReportTable, Section, SectionPart

_OF_A_PART = ("sensitivity_mv_per_mm", "fso_mv", "system_hysteresis_percent_fso", "repeatability_percent_fso")


def breaks(analysis: Analysis) -> Section:
    """One table a break, and one of the parts' figures where they differ."""
    parts: list[SectionPart] = []
    for found in analysis.breaks:
        parts += [found.sentence.capitalize() + ".", _comparisons(found)]
    if analysis.parts:
        parts.append(_parts(analysis))
    return Section("Before and after the break", tuple(parts))


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
            *(cell(p.sensors[i].figures[key]) for p in analysis.parts),
        )
        for i, sensor in enumerate(analysis.sensors)
        for key in _OF_A_PART
        if key in sensor.figures
    )
    return ReportTable(header, rows, "Each part's own figures, with 95 % intervals.", numeric=False)
