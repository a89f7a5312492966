"""The document model of a report: sections of paragraphs, tables and drawings, and how a cell writes a number."""

from __future__ import annotations

import datetime
import re
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes

from analysis.figures.figure import Figure
from analysis.numbers import rounded
from protocol.base.units import MINUS, NOTHING

Draw = Callable[[Axes], None]
_NUMBER = r"[+-]?[0-9]+(?:\.[0-9]+)?"
PAIR = re.compile(rf"^({_NUMBER})(?:( ± | … )({_NUMBER}))?$")
_NUMBERS = re.compile(rf"^[<>±] ?{_NUMBER}|^{_NUMBER}|^[+-]?∞")
_HYPHEN = re.compile(r"(?<![\w.)\-/])(?<!:\d\d )-(?=[0-9])")
DIGIT_SPACE, POINT_SPACE = "\u2007", "\u2008"  # as wide as a digit, as a point


@dataclass(frozen=True, slots=True)
class ReportTable:
    """A table; columns of numbers after the first are right-aligned where `numeric`; in two columns where `halved`."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    numeric: bool = True
    halved: bool = False


@dataclass(frozen=True, slots=True)
class ReportDrawing:
    """Drawings side by side; height in inches."""

    draw: tuple[Draw, ...]
    caption: str = ""
    height: float = 2.9


SectionPart = str | ReportTable | ReportDrawing


@dataclass(frozen=True, slots=True)
class Section:
    title: str
    parts: tuple[SectionPart, ...]


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file within a PDF: its name, content, media type and what it is."""

    name: str
    text: str
    mime_type: str
    description: str


@dataclass(frozen=True, slots=True)
class Report:
    """A whole report: `facts` lines of its head, `date` ISO 8601 or "", `marks` above every page beside SIMULATED.

    `alert`: the verdict needs attention.
    """

    title: str
    subject: str
    simulated: bool
    verdict: str
    facts: tuple[tuple[str, str], ...]
    sections: tuple[Section, ...]
    footer: str
    date: str = ""
    marks: tuple[str, ...] = ()
    author: str = "boat-daq"
    attachments: tuple[Attachment, ...] = ()
    alert: bool = False


def right_aligned(table: ReportTable) -> tuple[bool, ...]:
    """Return which columns are right-aligned: those of numbers, in a table of numbers; the first names the row."""
    columns = list(zip(*table.rows, strict=True)) if table.rows else [()] * len(table.header)
    numbers = [[bool(_NUMBERS.match(cell)) for cell in column if cell not in ("", NOTHING)] for column in columns]
    return tuple(table.numeric and at > 0 and 2 * sum(one) >= len(one) for at, one in enumerate(numbers))


def aligned(table: ReportTable) -> ReportTable:
    """Return the table with numbers padded so that right-aligned columns meet at the decimal points, in pairs too."""
    columns = [list(column) for column in zip(*table.rows, strict=True)] if table.rows else []
    for column, right in zip(columns, right_aligned(table), strict=bool(columns)):
        column[:] = _aligned_column(column) if right else map(typeset, column)
    return replace(table, rows=tuple(zip(*columns, strict=True)))


def _aligned_column(column: list[str]) -> list[str]:
    """Pad plain numbers, and pairs of them (value ± uncertainty, low … high), to the same places."""
    split = [PAIR.match(cell) for cell in column]
    places = [[_decimals(part) for part in m.group(1, 3) if part] if m else [] for m in split]
    most = [max((p[k] for p in places if len(p) > k), default=0) for k in (0, 1)]
    whole = max((len(m[3].partition(".")[0]) for m in split if m and m[3]), default=0)
    out = []
    for cell, m in zip(column, split, strict=True):
        if m is None:
            out.append(typeset(cell))
            continue
        text = _padded(m[1], most[0])
        if m[3]:
            text += m[2] + DIGIT_SPACE * (whole - len(m[3].partition(".")[0])) + _padded(m[3], most[1])
        out.append(text.replace("-", MINUS))
    return out


def _decimals(number: str) -> int:
    return len(number.partition(".")[2])


def _padded(number: str, places: int) -> str:
    own = _decimals(number)
    return number + (POINT_SPACE if own == 0 < places else "") + DIGIT_SPACE * (places - own)


def typeset(text: str) -> str:
    """Return the text with the minus sign before negative numbers; dates, their offsets and names keep the hyphen."""
    return _HYPHEN.sub(MINUS, text)


def cells(figure: Figure | None, decimals: int = 3) -> tuple[str, str]:
    """Value and interval, rounded alike; a value without an interval to so many decimals."""
    if figure is None or np.isnan(figure.value):
        return NOTHING, ""
    half = (figure.high - figure.low) / 4
    if not np.isfinite(half) or half == 0:
        half = 10.0 ** (1 - decimals)
    known = np.isfinite(figure.low) and np.isfinite(figure.high)
    return rounded(figure.value, half), f"{rounded(figure.low, half)} … {rounded(figure.high, half)}" if known else ""


def cell(figure: Figure | None, decimals: int = 3) -> str:
    """Return value and interval in one cell."""
    value, interval = cells(figure, decimals)
    return f"{value} [{interval}]" if interval else value


def p_value(p: float) -> str:
    """Return a p-value with its relation, e.g. `= 0.012`."""
    return "< 0.001" if p < 0.001 else f"= {p:.3f}"


def power(k: int) -> str:
    """Return an exponent as its superscript."""
    return {1: "", 2: "²", 3: "³"}.get(k, f"^{k}")


def date_of(text: object) -> str:
    """Return an ISO time as date, time and offset; any other text as it is."""
    try:
        return datetime.datetime.fromisoformat(str(text)).strftime("%Y-%m-%d %H:%M:%S %z").replace("+0000", "UTC")
    except ValueError:
        return str(text or "")
