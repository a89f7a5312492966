"""The figures of a run as texts of tables: figures, uncertainty, limits, interruptions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analysis.figures.figure import SENSOR_FIGURES, Figure, FigureDefinition
from analysis.numbers import decimals_for
from boat_daq.formatting import number, sensor_words
from protocol.base.units import NOTHING, Quantity, UnitText, in_signal_unit

if TYPE_CHECKING:
    from analysis.conformity import Conformity
    from analysis.figures.acceptance import LimitStatement
    from analysis.figures.across_breaks import Break, Comparison
    from analysis.figures.pipeline import Analysis
    from analysis.figures.sensor_analysis import SensorAnalysis

Cell = tuple[str, str]
"""A text of a table with its tooltip."""
HYSTERESIS_KEY, DRIFT_KEY = "system_hysteresis_percent_fso", "drift_percent_fso_per_100_cycles"
SENSITIVITY_KEY, SNR_KEY, FSO_KEY = "sensitivity_mv_per_mm", "snr_db", "fso_mv"
_MID_RANGE = "of one reading of elongation, in the middle of the range"
_OF_RUN = (HYSTERESIS_KEY, DRIFT_KEY, SENSITIVITY_KEY, SNR_KEY, FSO_KEY)
_SHAPES = {"pass": "\u25cf", "conditional_pass": "\u25d0", "conditional_fail": "\u25b3", "fail": "\u25b2"}
"""Marks of a statement of conformity beside a value; one that is undetermined has none."""
_MARKS = ", ".join(f"{shape} {statement.replace('_', ' ')}" for statement, shape in _SHAPES.items())


def figure_text(
    figure: Figure | None, decimals: int, stated: LimitStatement | None = None, *, unit: str = "", brief: bool = False
) -> Cell:
    """Return a figure as text, its 95 % interval in a second line, with definition and count as its tooltip.

    Parameters
    ----------
    stated : conformity with a limit, which marks the value.
    unit : what the figure is in, where its signals are in another unit than mV.
    brief : whether the interval is left to the tooltip, unless the value is an end of it.
    """
    if figure is None:
        return NOTHING, "not computed for this run"
    if stated is not None:
        decimals = stated.decimals(decimals)
    text, lines = number(figure.value, decimals), [figure.definition] if figure.definition else []
    if stated is not None:
        text = f"{_SHAPES.get(stated.conformity, '')} {text}".strip()
        lines.append(f"{stated.conformity.label}: {stated.text}")
    if math.isfinite(figure.low) and math.isfinite(figure.high):
        alike = number(figure.low, decimals) == number(figure.high, decimals)
        finer = decimals + 1 if alike and figure.low < figure.high else decimals
        low, value, high = (number(each, finer) for each in (figure.low, figure.value, figure.high))
        if not brief or (value in (low, high) and not alike):
            text += f"\n{low} to {high}"
        lines.append(f"95 % confidence interval: {low} to {high} {unit or figure.unit}")
    if figure.n:
        lines.append(f"n = {figure.n}")
    lines += [part for part in (figure.void, figure.note) if part]
    return text, "\n".join(lines)


def figure_rows(
    sensors: Sequence[SensorAnalysis],
    keys: Sequence[str] = tuple(SENSOR_FIGURES),
    signal_unit: str = "mV",
    *,
    brief: bool = False,
) -> tuple[tuple[Cell, ...], ...]:
    """Return the table of figures: name over unit and published limit, then every sensor; none that no sensor has."""
    from analysis.figures.acceptance import TOLERANCES, against_published

    limits = {tolerance.key: tolerance for tolerance in TOLERANCES}
    stated = [{one.tolerance.key: one for one in against_published(sensor)} for sensor in sensors]
    rows = []
    for d in (SENSOR_FIGURES[key] for key in keys):
        if any(d.key in sensor.figures for sensor in sensors):
            pairs = zip(sensors, stated, strict=True)
            unit = in_signal_unit(d.unit, signal_unit)
            cells = [
                figure_text(
                    f := s.figures.get(d.key), _decimals(d, f, signal_unit), known.get(d.key), unit=unit, brief=brief
                )
                for s, known in pairs
            ]
            limit, tip = limits.get(d.key), f"{in_signal_unit(d.label_with_unit, signal_unit)}\n{cells[0][1]}"
            below = unit
            if limit is not None:
                below, tip = (
                    f"{d.unit}, limit {limit.symbol} {limit.limit:g}",
                    f"{tip}\nlimit: {limit.source}; {_MARKS}",
                )
            rows.append(((f"{d.label}\n{below}", tip), *cells))
    return tuple(rows)


def _decimals(definition: FigureDefinition, figure: Figure | None, signal_unit: str) -> int:
    """Return the usual decimals of a figure; those of its interval for a signal in another unit than mV."""
    if figure is None or in_signal_unit(definition.unit, signal_unit) == definition.unit:
        return definition.decimals
    return max(0, decimals_for(figure.uncertainty))


def verdict_rows(sensors: Sequence[SensorAnalysis]) -> list[tuple[Cell, ...]]:
    """Return the row with the verdict on each sensor's curve; none where no curve was tested."""
    found = [sensor.calibration.adequacy if sensor.calibration is not None else None for sensor in sensors]
    cells = [(str(a.verdict), a.sentence) if a is not None else (NOTHING, "not tested") for a in found]
    return [(("Curve", "Whether the curve follows the readings within their scatter"), *cells)] if any(found) else []


def uncertainty_rows(found: Analysis) -> tuple[tuple[Cell, ...], ...]:
    """Return the uncertainty of an elongation, the conformity with the published limits, and the budgets."""
    return (*_expanded_rows(found), *_limit_rows(found), *_component_rows(found))


def _expanded_rows(found: Analysis) -> list[tuple[Cell, ...]]:
    """Return the expanded uncertainty of an elongation and whether it is traceable; none without a calibration."""
    if found.budgets is None or not found.budgets.budgets:
        return []
    at, budgets = Quantity(found.budgets.x_mm, "mm", "+.2f"), found.budgets.budgets
    expanded: list[Cell] = []
    for b in budgets:
        mark = ", stated" if b.stand_in else ""
        half = UnitText("\u00b1", Quantity(b.expanded, "mm", ".3f"), mark)
        known = half, UnitText(f"k = 2, {b.dof:.0f} degrees of freedom, at ", at)
        expanded.append(("not known", b.void) if b.void else known)
    traced = [one for b in budgets if (one := b.traceability) is not None]
    reasons = [("yes" if one.traceable else "no", one.text) for one in traced]
    return [
        ((UnitText("Expanded uncertainty\nk = 2, at ", at), _MID_RANGE), *expanded),
        (("Traceable", reasons[0][1] if reasons else ""), *reasons),
    ]


def _component_rows(found: Analysis) -> list[tuple[Cell, ...]]:
    """Return the budgets of an elongation, a row a component and a column a sensor; none without a calibration."""
    if found.budgets is None or not found.budgets.budgets:
        return []
    budgets, shares = found.budgets.budgets, [budget.shares() for budget in found.budgets.budgets]
    rows = []
    for parts in zip(*(budget.components for budget in budgets), strict=True):
        cells = []
        for c, own in zip(parts, shares, strict=True):
            text = UnitText(Quantity(c.contribution, "mm", ".4f")) if c.assessed else "not assessed"
            share = f"{100 * own[c.name]:.0f} % of the variance; " if c.assessed else ""
            cells.append((text, f"{share}{c.source}"))
        rows.append(((parts[0].name.capitalize(), parts[0].source), *cells))
    return rows


def _limit_rows(found: Analysis) -> list[tuple[Cell, ...]]:
    from analysis.conformity import RULE
    from analysis.figures.acceptance import against_published

    rows = []
    for stated in zip(*(against_published(sensor) for sensor in found.sensors), strict=False):
        tolerance, definition = stated[0].tolerance, SENSOR_FIGURES[stated[0].tolerance.key]
        name = f"{definition.label}\n{tolerance.symbol} {tolerance.limit:g} {definition.unit}"
        cells = [(_conformity_text(one.conformity), f"{one.text}\n{RULE}") for one in stated]
        rows.append(((name, tolerance.source), *cells))
    return rows


def _conformity_text(conformity: Conformity) -> str:
    """Return a statement with its mark, a condition in a second line: two of them leave names their width."""
    condition, _, stated = conformity.label.rpartition(" ")
    return f"{_SHAPES.get(conformity, '')} {stated}\n{condition}".strip()


@dataclass(frozen=True, slots=True)
class RunFigure:
    """A figure of the whole run with its 95 % interval and its published limit; NaN where there is none."""

    value: float = math.nan
    low: float = math.nan
    high: float = math.nan
    limit: float = math.nan
    symbol: str = ""  # of the limit


def run_figures(sensor: SensorAnalysis) -> dict[str, RunFigure]:
    """Return the figures of a sensor that plots show beside those of single cycles, by key."""
    from analysis.figures.acceptance import TOLERANCES

    limits = {one.key: (one.limit, one.symbol) for one in TOLERANCES}
    found = {key: sensor.figures[key] for key in _OF_RUN if key in sensor.figures}
    return {key: RunFigure(f.value, f.low, f.high, *limits.get(key, ())) for key, f in found.items()}


@dataclass(frozen=True, slots=True)
class BreakResult:
    """An interruption of a resumed run; rows are quantity, mean before and after, p of t and F."""

    at_cycle: float
    sentence: str
    rows: tuple[tuple[str, ...], ...]


def break_result(found: Break) -> BreakResult:
    comparisons = tuple(replace(c, sensor=sensor_words(c.sensor)) for c in found.comparisons)
    at = 0.5 + float(max(found.before, default=0))
    return BreakResult(at, replace(found, comparisons=comparisons).sentence, tuple(map(_tested, comparisons)))


def _tested(c: Comparison) -> tuple[str, ...]:
    """Return one comparison across an interruption as texts; a rejected test is marked."""
    p = [
        ("\u25b2 " if name in c.significant else "") + (f"{value:.2g}" if np.isfinite(value) else NOTHING)
        for name, value in (("t", c.t_p), ("F", c.f_p))
    ]
    means = f"{c.mean_before:.4g} (n = {c.n_before})", f"{c.mean_after:.4g} (n = {c.n_after})"
    return f"{c.sensor}: {c.quantity} ({c.unit})", *means, *p
