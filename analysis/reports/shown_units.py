"""A report in the units that its reader chose: every number whose unit is stated beside it, and every axis.

Strategy: a report states the unit of a number in the head of its column, at the end of the row's name, in the column
"unit", or directly behind the number; an axis at the end of its title. What is stated so is converted here, in one
place, after the report is built from stored values; digits keep their significance.

Rules: the head of a report is what people wrote, and stays as it is, as do axes whose ticks are names. JSON, exported
files and certificates have no choice of units.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator

from analysis.numbers import NUMBER, decimals_for, in_unit
from analysis.reports.document import Draw, Report, ReportDrawing, ReportTable, Section, SectionPart
from protocol.base.units import CHOICES, STORED_UNITS, Shown, ShownUnits, as_text, in_signal_unit

_UNIT = r"(?:kPa|mV|mm|µm)(?:[²³])?(?:/(?:kPa|mV|mm|s)[²³]?)?"
_STATED = re.compile(rf"({NUMBER}(?: (?:to|and|±|\u2026|/) {NUMBER})*) ({_UNIT})(?![\w/²³])")
_END = re.compile(rf"(?:^|, )({_UNIT})(?= \(|$)")
_SHARE = re.compile(r"%$|^[A-Za-z]")  # a share, or words: no number of the row's unit


def in_units(report: Report, units: ShownUnits) -> Report:
    """Return the report with its numbers and axes in these units; the report itself where they are the stored ones."""
    if units == STORED_UNITS:
        return report
    sections = tuple(Section(s.title, tuple(_part(part, units) for part in s.parts)) for s in report.sections)
    return replace(report, sections=sections, verdict=_text(report.verdict, units))


def _part(part: SectionPart, units: ShownUnits) -> SectionPart:
    match part:
        case ReportTable():
            return _table(part, units)
        case ReportDrawing():
            draws = tuple(partial(_drawn, units, draw) for draw in part.draw)
            return replace(part, draw=draws, caption=_text(part.caption, units))
    return _text(part, units)


def _text(text: str, units: ShownUnits) -> str:
    """Return a text with the numbers converted that a unit directly follows."""

    def one(found: re.Match[str]) -> str:
        shown = units.shown(found[2])
        same = shown.symbol == found[2]
        return found[0] if same else f"{in_unit(found[1], shown)} {as_text(shown.symbol)}"

    converted = _STATED.sub(one, text)
    return converted if units.voltage in CHOICES["voltage"] else in_signal_unit(converted, units.voltage)


def _stated(title: str, units: ShownUnits) -> tuple[str, Shown | None]:
    """Return a title with the unit at its end as it is shown, and the conversion; None where there is nothing to do."""
    found = _END.search(title)
    shown = units.shown(found[1]) if found else None
    if found is None or shown is None or shown.symbol == found[1]:
        return title, None
    return f"{title[: found.start(1)]}{as_text(shown.symbol)}{title[found.end(1) :]}", shown


def _table(table: ReportTable, units: ShownUnits) -> ReportTable:
    header, by_column = zip(*(_stated(title, units) for title in table.header), strict=True)
    unit_at = table.header.index("unit") if "unit" in table.header else None
    rows = tuple(_row(row, by_column, unit_at, units) for row in table.rows)
    return replace(table, header=header, rows=rows, caption=_text(table.caption, units))


def _row(
    row: tuple[str, ...], by_column: Sequence[Shown | None], unit_at: int | None, units: ShownUnits
) -> tuple[str, ...]:
    first, by_row = _stated(row[0], units) if row else ("", None)
    last = ""
    if by_row is None and unit_at is not None:
        last, by_row = _stated(row[unit_at], units)
    cells = [first]
    for at, (cell, by_head) in enumerate(zip(row[1:], by_column[1:], strict=True), 1):
        shown = by_head or by_row
        if at == unit_at and last:
            cells.append(last)
        elif shown is not None and not _SHARE.search(cell):
            cells.append(in_unit(cell, shown))
        else:
            cells.append(_text(cell, units))
    if row and by_row is None and by_column[0] is not None:
        cells[0] = in_unit(first, by_column[0])
    return tuple(cells)


class _ScaledLocator(MaxNLocator):
    """Ticks at 1, 2 and 5 of the shown unit, at the places of the stored one."""

    def __init__(self, shown: Shown) -> None:
        super().__init__(nbins="auto", steps=[1, 2, 5, 10])
        self.shown = shown

    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        ticks = super().tick_values(self.shown.value(vmin), self.shown.value(vmax))
        return [(tick - self.shown.offset) / self.shown.factor for tick in ticks]


def _drawn(units: ShownUnits, draw: Draw, ax: Axes) -> None:
    """Draw, then label the axes in the chosen units."""
    draw(ax)
    for axis in (ax.xaxis, ax.yaxis):
        title, shown = _stated(axis.get_label_text(), units)
        if shown is not None and not isinstance(axis.get_major_locator(), FixedLocator):
            axis.set_label_text(title)
            axis.set_major_locator(_ScaledLocator(shown))
            axis.set_major_formatter(FuncFormatter(partial(_tick, shown, axis)))


def _tick(shown: Shown, axis: Axis, value: float, _: int | None) -> str:
    """Return the label of a tick, with the decimals that the step of the ticks needs."""
    ticks = np.unique(np.round([shown.value(tick) for tick in axis.get_majorticklocs()], 12))
    step = float(np.diff(ticks).min()) if ticks.size > 1 else 1.0
    text = f"{shown.value(value) + 0.0:.{max(0, decimals_for(step) - 1)}f}"
    return ("0" if float(text) == 0 else text).replace("-", "\u2212")
