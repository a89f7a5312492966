"""A report as PDF: A4, embedded fonts, page x of y, SIMULATED across the head of every page of a simulated run.

Strategy: the content is set in a flow from top to bottom, measured in inches with the font's own metrics, and broken
over pages first; only then, with the number of pages known, is it drawn with matplotlib. Drawings have fixed margins,
so that their axes stand in line from page to page.

Rules: the same report gives the same bytes; no text leaves the page: columns are sized by measuring, long cells wrap.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_pdf import FigureCanvasPdf, PdfPages
from matplotlib.figure import Figure as Canvas
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.textpath import TextToPath

from analysis.reports import style
from analysis.reports.content import DIGIT_SPACE, PLAIN_NUMBER, POINT_SPACE, Drawing, Report, Table, aligned

WIDTH, HEIGHT = style.A4_INCH
LEFT = style.MARGIN_INCH
INNER = WIDTH - 2 * LEFT
TOP, BOTTOM = 1.05, 0.85
LINE_INCH = 0.165
ROW_INCH = 0.185
STRETCH = 0.4  # a drawing grows by so much at most to fill its page
KEPT_TOGETHER = 0.4  # of a page: a shorter table is not broken
PAD_INCH = 0.16
AXES_TOP, AXES_BOTTOM, AXES_RIGHT = 0.26, 0.42, 0.12
TEXT_PT, SMALL_PT, MIN_PT = 8.5, 7.5, 5.5


@dataclass(frozen=True, slots=True)
class Text:
    """A piece of text at x, y (inches from the left and from the top of the page)."""

    x: float
    y: float
    text: str
    size: float = TEXT_PT
    colour: str = style.INK
    weight: str = "normal"
    align: str = "left"


@dataclass(frozen=True, slots=True)
class Rule:
    """A horizontal line."""

    x: float
    y: float
    length: float
    colour: str = style.LINE
    thick: float = 0.5


@dataclass(frozen=True, slots=True)
class Placed:
    """A drawing whose top is at y."""

    y: float
    drawing: Drawing


@dataclass(slots=True)
class Flow:
    """Fills pages from top to bottom."""

    pages: list[list[Text | Rule | Placed]] = field(default_factory=lambda: [[]])
    y: float = TOP

    def room(self, height: float) -> None:
        """Begin a new page where `height` does not fit on this one."""
        if self.y + height > HEIGHT - BOTTOM and self.y > TOP:
            self.pages.append([])
            self.y = TOP

    def add(self, item: Text | Rule | Placed) -> None:
        """Put an item on the current page."""
        self.pages[-1].append(item)


def write_pdf(report: Report, path: Path) -> None:
    """Write the report."""
    flow = Flow()
    _head(flow, report)
    for section in report.sections:
        first = section.parts[0] if section.parts else ""
        flow.room(0.9 + _first_height(first))
        _heading(flow, section.title)
        for part in section.parts:
            if isinstance(part, Table):
                _table(flow, part)
            elif isinstance(part, Drawing):
                _drawing(flow, part)
            else:
                _paragraph(flow, part)
    pages = [*(_filled(page) for page in flow.pages[:-1]), flow.pages[-1]]
    title = f"{'SIMULATED ' if report.simulated else ''}{report.title}: {report.subject}"
    information = {"Title": title, "Creator": report.footer, "Producer": "matplotlib", "CreationDate": None}
    with mpl.rc_context(style.RC), PdfPages(path, metadata=information) as pdf:
        for number, items in enumerate(pages, 1):
            pdf.savefig(_page(report, items, number, len(pages)))


def _filled(items: list[Text | Rule | Placed]) -> list[Text | Rule | Placed]:
    """Stretch the drawings of a page over what a break left white, by no more than `STRETCH`."""
    drawn = sum(item.drawing.height for item in items if isinstance(item, Placed))
    if not drawn:
        return items
    lowest = max(item.y + (item.drawing.height if isinstance(item, Placed) else 0.0) for item in items)
    share = min(STRETCH, (HEIGHT - BOTTOM - lowest) / drawn)
    out: list[Text | Rule | Placed] = []
    shift = 0.0
    for item in items:  # in the order of the flow: what follows a drawing moves down with its lower edge
        moved = replace(item, y=item.y + shift)
        if isinstance(moved, Placed):
            grown = moved.drawing.height * max(share, 0.0)
            moved = Placed(moved.y, replace(moved.drawing, height=moved.drawing.height + grown))
            shift += grown
        out.append(moved)
    return out


def _first_height(part: str | Table | Drawing) -> float:
    """What must stand under a heading: a whole drawing, a whole table where it is short, else a few lines."""
    if isinstance(part, Drawing):
        return part.height
    rows = len(part.rows) + 1 if isinstance(part, Table) else 4
    return (rows if rows * ROW_INCH < KEPT_TOGETHER * (HEIGHT - TOP - BOTTOM) else 4) * ROW_INCH


def _page(report: Report, items: list[Text | Rule | Placed], number: int, count: int) -> Canvas:
    canvas = Canvas(figsize=(WIDTH, HEIGHT))
    FigureCanvasPdf(canvas)
    for item in [*items, *_frame(report, number, count)]:
        if isinstance(item, Text):
            canvas.text(
                item.x / WIDTH,
                1 - item.y / HEIGHT,
                item.text,
                fontsize=item.size,
                color=item.colour,
                fontweight=item.weight,
                ha=item.align,
                va="baseline",
                parse_math=False,
            )
        elif isinstance(item, Rule):
            y = 1 - item.y / HEIGHT
            ends = [item.x / WIDTH, (item.x + item.length) / WIDTH]
            canvas.add_artist(Line2D(ends, [y, y], color=item.colour, linewidth=item.thick))
        else:
            _draw(canvas, item)
    if report.simulated:
        band = Rectangle((0, 1 - 0.34 / HEIGHT), 1, 0.34 / HEIGHT, facecolor=style.WARNING, edgecolor="none")
        canvas.add_artist(band)
        canvas.text(
            0.5,
            1 - 0.225 / HEIGHT,
            "S I M U L A T E D",
            fontsize=11,
            color=style.PAPER,
            fontweight="bold",
            ha="center",
            va="baseline",
        )
    return canvas


def _frame(report: Report, number: int, count: int) -> list[Text | Rule]:
    """Head and foot of every page."""
    low = HEIGHT - 0.5
    items: list[Text | Rule] = [
        Rule(LEFT, low - 0.18, INNER),
        Text(LEFT, low, _shortened(report.footer, INNER - 1.2, SMALL_PT), SMALL_PT, style.SOFT),
        Text(WIDTH - LEFT, low, f"page {number} of {count}", SMALL_PT, style.SOFT, align="right"),
    ]
    if number > 1:
        head = _shortened(f"{report.title}   {report.subject}", INNER, SMALL_PT)
        items += [Text(LEFT, 0.66, head, SMALL_PT, style.SOFT), Rule(LEFT, 0.74, INNER)]
    return items


def _head(flow: Flow, report: Report) -> None:
    flow.y = 0.95
    flow.add(Text(LEFT, flow.y, report.title, 20, weight="bold"))
    flow.y += 0.3
    for line in _wrapped(report.subject, INNER, 12)[:2]:
        flow.add(Text(LEFT, flow.y, line, 12, style.SOFT))
        flow.y += 0.22
    flow.y += 0.1
    lines = _wrapped(report.verdict, INNER, 9.5, "bold")
    flow.add(Rule(LEFT, flow.y - 0.05, INNER, style.SENSORS[0], 1.6))
    for line in lines:
        flow.y += 0.2
        flow.add(Text(LEFT, flow.y, line, 9.5, weight="bold"))
    flow.y += 0.34
    for label, value in report.facts:
        lines = _wrapped(value, INNER - 1.3, TEXT_PT)
        flow.add(Text(LEFT, flow.y, label, TEXT_PT, style.SOFT))
        for line in lines[:4]:
            flow.add(Text(LEFT + 1.3, flow.y, line))
            flow.y += 0.175
    flow.y += 0.05


def _heading(flow: Flow, title: str) -> None:
    flow.y += 0.26
    for line in _wrapped(title, INNER, 12, "bold"):
        flow.add(Text(LEFT, flow.y, line, 12, weight="bold"))
        flow.y += 0.22
    flow.y += 0.02


def _paragraph(flow: Flow, text: str, size: float = TEXT_PT, colour: str = style.INK) -> None:
    for line in _wrapped(text, INNER, size):
        flow.room(LINE_INCH)
        flow.y += LINE_INCH * 0.8
        flow.add(Text(LEFT, flow.y, line, size, colour))
        flow.y += LINE_INCH * 0.2
    flow.y += 0.06


def _drawing(flow: Flow, drawing: Drawing) -> None:
    flow.room(drawing.height + 0.3)
    flow.add(Placed(flow.y, drawing))
    flow.y += drawing.height
    _paragraph(flow, drawing.caption, SMALL_PT, style.SOFT)


def _draw(canvas: Canvas, placed: Placed) -> None:
    drawing, count = placed.drawing, len(placed.drawing.draw)
    for at, draw in enumerate(drawing.draw):
        if drawing.ratios:
            shares = np.asarray(drawing.ratios) / sum(drawing.ratios)
            usable = drawing.height - AXES_TOP - AXES_BOTTOM - 0.1 * (count - 1)
            top = placed.y + AXES_TOP + usable * shares[:at].sum() + 0.1 * at
            left, width, height = LEFT + drawing.left, INNER - drawing.left - AXES_RIGHT, usable * shares[at]
        else:
            cell = INNER / count
            left, width = LEFT + at * cell + drawing.left, cell - drawing.left - AXES_RIGHT
            top, height = placed.y + AXES_TOP, drawing.height - AXES_TOP - AXES_BOTTOM
        ax = canvas.add_axes((left / WIDTH, 1 - (top + height) / HEIGHT, width / WIDTH, height / HEIGHT))
        draw(ax)
        if drawing.ratios and at < count - 1:
            ax.tick_params(labelbottom=False)
            ax.set_xlabel("")


def _table(flow: Flow, table: Table) -> None:
    table = aligned(table)
    size, widths = _columns(table)
    whole = sum(_cell_lines(row, widths, size) for row in (table.header, *table.rows)) * ROW_INCH + 0.3
    flow.room(whole if whole < KEPT_TOGETHER * (HEIGHT - TOP - BOTTOM) else 3 * ROW_INCH)
    flow.y += 0.08
    _row(flow, table, table.header, widths, size, head=True)
    for row in table.rows:
        lines = _cell_lines(row, widths, size)
        if flow.y + lines * ROW_INCH > HEIGHT - BOTTOM:
            flow.room(HEIGHT)
            _row(flow, table, table.header, widths, size, head=True)
        _row(flow, table, row, widths, size, head=False)
    flow.y += 0.05
    if table.caption:
        _paragraph(flow, table.caption, SMALL_PT, style.SOFT)


def _row(flow: Flow, table: Table, cells: tuple[str, ...], widths: list[float], size: float, *, head: bool) -> None:
    lines = _cell_lines(cells, widths, size)
    x = LEFT
    for at, (cell, width) in enumerate(zip(cells, widths, strict=True)):
        right = table.numeric and at > 0
        for k, line in enumerate(_wrapped(cell, width - PAD_INCH, size) or [""]):
            place = x + width - PAD_INCH / 2 if right else x
            flow.add(
                Text(
                    place,
                    flow.y + 0.13 + k * ROW_INCH,
                    line,
                    size,
                    style.SOFT if head else style.INK,
                    "bold" if head else "normal",
                    "right" if right else "left",
                )
            )
        x += width
    flow.y += lines * ROW_INCH
    flow.add(Rule(LEFT, flow.y, INNER, style.SOFT if head else style.LINE, 0.8 if head else 0.4))


def _columns(table: Table) -> tuple[float, list[float]]:
    """Font size and column widths: as wide as the text, spread over the page; wrapped in the last resort."""
    every = [table.header, *table.rows]
    size = TEXT_PT
    while True:
        widths = [max(_width(row[i], size) for row in every) + PAD_INCH for i in range(len(table.header))]
        if sum(widths) <= INNER:
            spare = INNER - sum(widths)
            share = [spare / len(widths)] * len(widths) if table.numeric else [0.0] * (len(widths) - 1) + [spare]
            return size, [w + s for w, s in zip(widths, share, strict=True)]
        if size <= 7.0 if not table.numeric else size <= MIN_PT:
            widest = int(np.argmax(widths))
            widths[widest] = max(INNER - (sum(widths) - widths[widest]), 0.8)
            return size, widths
        size -= 0.25


def _cell_lines(row: tuple[str, ...], widths: list[float], size: float) -> int:
    return max(len(_wrapped(cell, width - PAD_INCH, size)) or 1 for cell, width in zip(row, widths, strict=True))


@lru_cache(maxsize=20_000)
def _width(text: str, size: float, weight: str = "normal") -> float:
    """Width of a line in inches, measured with the font itself."""
    font = FontProperties(family=style.RC["font.family"], size=size, weight=weight)
    return float(TextToPath().get_text_width_height_descent(text, font, ismath=False)[0]) / 72.0


def _wrapped(text: str, width: float, size: float, weight: str = "normal") -> list[str]:
    """Break text into lines that fit."""
    if PLAIN_NUMBER.match(text.rstrip(DIGIT_SPACE + POINT_SPACE)):
        return [text]
    text = " ".join(text.split())
    if not text:
        return []
    letters = max(8, int(width / (_width(text, size, weight) / len(text) or 0.1)))
    while True:
        lines = textwrap.wrap(text, letters, break_long_words=True)
        if letters <= 8 or max(_width(line, size, weight) for line in lines) <= width:
            return lines
        letters -= 2


def _shortened(text: str, width: float, size: float) -> str:
    lines = _wrapped(text, width, size)
    return lines[0] + (" …" if len(lines) > 1 else "") if lines else ""
