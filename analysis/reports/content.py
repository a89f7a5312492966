"""What a report consists of: sections of paragraphs, tables and drawings; values that the writers set.

Rules: no analysis and no layout here, only the shape of a report.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from analysis.reports.drawings import Draw

PLAIN_NUMBER = re.compile(r"^[+-]?[0-9]+(\.[0-9]+)?$")
DIGIT_SPACE, POINT_SPACE = "\u2007", "\u2008"  # as wide as a digit, as a point


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


def aligned(table: Table) -> Table:
    """Return the table with plain numbers padded so that right-aligned columns meet at the decimal point."""
    if not table.numeric:
        return table
    columns = [list(column) for column in zip(*table.rows, strict=True)] if table.rows else []
    for column in columns[1:]:
        places = [len(cell.partition(".")[2]) if PLAIN_NUMBER.match(cell) else None for cell in column]
        most = max((p for p in places if p is not None), default=0)
        for row, (cell, own) in enumerate(zip(column, places, strict=True)):
            if own is not None and own < most:
                column[row] = cell + (POINT_SPACE if own == 0 else "") + DIGIT_SPACE * (most - own)
    return Table(table.header, tuple(zip(*columns, strict=True)), table.caption, table.numeric)
