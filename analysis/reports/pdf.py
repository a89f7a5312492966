"""A report as PDF: A4, embedded fonts, page x of y, SIMULATED across the head of every page of a simulated run.

Strategy: the content becomes blocks, measured in inches with the font's own metrics; `pages` breaks them over pages;
only then, with the number of pages known, are they drawn with matplotlib. Drawings have fixed margins, so that their
axes are aligned from page to page.

Rules: the same report gives the same bytes; no text leaves the page: columns are sized by measuring, long cells wrap.
"""

from __future__ import annotations

import io
import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_pdf import FigureCanvasPdf, PdfPages
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from analysis import figure_style as style
from analysis.progress import Progress
from analysis.reports.document import Report, ReportDrawing, ReportTable, SectionPart, aligned, right_aligned, typeset
from analysis.reports.drawings import set_drawing
from analysis.reports.pages import Item, PageBlock, Rule, Text, broken, placed
from analysis.reports.text_metrics import families, printable, shortened, width_of, wrapped

WIDTH, HEIGHT = style.A4_INCH
LEFT = style.MARGIN_INCH
INNER = WIDTH - 2 * LEFT
TOP, BOTTOM = 0.95, 0.8
PAGE_INCH = HEIGHT - TOP - BOTTOM
LINE_INCH = 0.165
ROW_INCH = 0.185
KEPT_TOGETHER = 0.4  # of a page: a shorter table is not broken
ORPHANS = 4  # rows of a table that stay together at its ends
PAD_INCH = 0.16
WRAPPED_INCH = 1.2  # a column of words is not narrower, the type is smaller instead
LABEL_INCH = 1.0
TEXT_PT, SMALL_PT, WRAPPED_PT, MIN_PT = 8.5, 7.5, 7.5, 5.5


def write_pdf(report: Report, path: Path, progress: Progress | None = None) -> None:
    """Write the report, at once: a report that was cancelled leaves no file.

    Parameters
    ----------
    report, path : what is written, and where.
    progress : is called with the pages that are set and their number.
    """
    blocks = _head(report)
    for section in report.sections:
        blocks += [*_heading(section.title), *itertools.chain.from_iterable(map(_part, section.parts))]
    pages = broken(blocks, PAGE_INCH)
    title = f"{'SIMULATED ' if report.simulated else ''}{report.title}: {report.subject}"
    information = {"Title": title, "Creator": report.footer, "Producer": "matplotlib", "CreationDate": None}
    content = io.BytesIO()
    with mpl.rc_context(style.RC), PdfPages(content, metadata=information) as pdf:
        for number, page in enumerate(pages, 1):
            items = placed(page, PAGE_INCH, TOP, last=number == len(pages))
            pdf.savefig(_page(report, items, number, len(pages)))
            if progress is not None:
                progress(number, len(pages))
    path.write_bytes(content.getvalue())


def _part(part: SectionPart) -> list[PageBlock]:
    if isinstance(part, ReportTable):
        return _table(part)
    if isinstance(part, ReportDrawing):
        return [PageBlock(part.height, drawing=part, kept=True, space=0.04), *_caption(part.caption)]
    return _paragraph(part)


def _page(report: Report, items: list[Item], number: int, count: int) -> Canvas:
    canvas = Canvas(figsize=(WIDTH, HEIGHT))
    FigureCanvasPdf(canvas)
    for item in [*items, *_frame(report, number, count)]:
        if isinstance(item, Text):
            _set(canvas, item)
        elif isinstance(item, Rule):
            y = 1 - item.y / HEIGHT
            ends = [item.x / WIDTH, (item.x + item.length) / WIDTH]
            canvas.add_artist(Line2D(ends, [y, y], color=item.colour, linewidth=item.thick))
        else:
            set_drawing(canvas, item.drawing, LEFT, item.y, INNER)
    if report.simulated:
        band = Rectangle((0, 1 - 0.34 / HEIGHT), 1, 0.34 / HEIGHT, facecolor=style.WARNING, edgecolor="none")
        canvas.add_artist(band)
        _set(canvas, Text(WIDTH / 2, 0.225, "S I M U L A T E D", 11, style.PAPER, "bold", "center"))
    return canvas


def _set(canvas: Canvas, text: Text) -> None:
    fonts = families(text.text)
    weight = text.weight if len(fonts) == 1 else "normal"  # the fonts of other scripts have one weight
    font: Any = {"fontsize": text.size, "color": text.colour, "fontfamily": list(fonts), "fontweight": weight}
    at = text.x / WIDTH, 1 - text.y / HEIGHT
    canvas.text(*at, printable(text.text), ha=text.align, va="baseline", parse_math=False, **font)


def _frame(report: Report, number: int, count: int) -> list[Item]:
    """Head and foot of every page."""
    low = HEIGHT - 0.5
    items: list[Item] = [
        Rule(LEFT, low - 0.18, INNER),
        Text(LEFT, low, shortened(report.footer, INNER - 1.2, SMALL_PT), SMALL_PT, style.SOFT),
        Text(WIDTH - LEFT, low, f"page {number} of {count}", SMALL_PT, style.SOFT, align="right"),
    ]
    if number > 1:
        head = shortened(f"{report.title}   {report.subject}", INNER, SMALL_PT)
        items += [Text(LEFT, 0.66, head, SMALL_PT, style.SOFT), Rule(LEFT, 0.74, INNER)]
    return items


def _head(report: Report) -> list[PageBlock]:
    blocks = [PageBlock(0.3, (Text(LEFT, 0.1, report.title, 20, weight="bold"),), kept=True)]
    subject = wrapped(report.subject, INNER, 12)
    subject[1:] = [shortened(" ".join(subject[1:]), INNER - 0.2, 12)] if len(subject) > 2 else subject[1:]
    blocks += [PageBlock(0.22, (Text(LEFT, 0.1, line, 12, style.SOFT),), kept=True) for line in subject]
    blocks.append(PageBlock(0.03, rule=Rule(LEFT, 0.0, INNER, style.SENSORS[0], 1.6), kept=True))
    blocks += [
        PageBlock(0.2, (Text(LEFT, 0.2, line, 9.5, weight="bold"),), kept=True)
        for line in wrapped(typeset(report.verdict), INNER, 9.5, "bold")
    ]
    return [*blocks, *_facts(report.facts)]


def _facts(facts: Sequence[tuple[str, str]]) -> list[PageBlock]:
    """Who, what, when: short ones in two columns, long ones below over the whole width."""
    half = INNER / 2
    short = [(k, v) for k, v in facts if width_of(v, TEXT_PT) <= half - LABEL_INCH - PAD_INCH]
    rows = (len(short) + 1) // 2
    blocks = []
    for row in range(rows):
        texts: list[Text] = []
        for column, (label, value) in enumerate(short[row::rows]):
            x = LEFT + column * half
            texts += [Text(x, 0.12, label, TEXT_PT, style.SOFT), Text(x + LABEL_INCH, 0.12, value)]
        blocks.append(PageBlock(0.175, tuple(texts), space=0.0 if row else 0.2, kept=True))
    for label, value in (fact for fact in facts if fact not in short):
        for k, line in enumerate(wrapped(value, INNER - LABEL_INCH, TEXT_PT)[:4]):
            name = [] if k else [Text(LEFT, 0.12, label, TEXT_PT, style.SOFT)]
            blocks.append(PageBlock(0.175, (*name, Text(LEFT + LABEL_INCH, 0.12, line)), kept=True))
    return blocks


def _heading(title: str) -> list[PageBlock]:
    lines = [(Text(LEFT, 0.14, line, 12, weight="bold"),) for line in wrapped(title, INNER, 12, "bold")]
    first = [PageBlock(0.22, lines[0], space=0.24, kept=True, starts=True)] if lines else []
    return [*first, *(PageBlock(0.22, line, kept=True) for line in lines[1:])]


def _paragraph(text: str, size: float = TEXT_PT, colour: str = style.INK) -> list[PageBlock]:
    lines = wrapped(typeset(text), INNER, size)
    return [
        PageBlock(LINE_INCH, (Text(LEFT, 0.8 * LINE_INCH, line, size, colour),), space=0.0 if k else 0.05)
        for k, line in enumerate(lines)
    ]


def _caption(text: str) -> list[PageBlock]:
    """A caption in small type: its lines stay together, and white below parts it from what follows."""
    lines = [replace(line, space=0.0, kept=True) for line in _paragraph(text, SMALL_PT, style.SOFT)]
    return lines[:-1] + [replace(line, kept=False, height=line.height + 0.06) for line in lines[-1:]]


def _table(table: ReportTable) -> list[PageBlock]:
    table, right = aligned(table), right_aligned(table)
    size, widths = _columns(table)
    head = replace(_row(table.header, right, widths, size, head=True), kept=True)
    rows = [replace(_row(row, right, widths, size, head=False), head=head) for row in table.rows]
    whole = sum(row.height for row in (head, *rows)) < KEPT_TOGETHER * PAGE_INCH
    caption = _caption(table.caption) if table.caption else []
    last = len(rows) - 1
    kept = [bool(caption) if at == last else whole or at < ORPHANS or at > last - ORPHANS for at in range(len(rows))]
    rows = [replace(row, kept=keep) for row, keep in zip(rows, kept, strict=True)]
    return [replace(head, space=0.08), *rows, *caption]


def _row(cells: tuple[str, ...], right: Sequence[bool], widths: list[float], size: float, *, head: bool) -> PageBlock:
    x, texts, most = LEFT, [], 1
    colour, weight = (style.SOFT, "bold") if head else (style.INK, "normal")
    for cell, width, at_right in zip(cells, widths, right, strict=True):
        lines = wrapped(cell, width - PAD_INCH, size, weight)
        most = max(most, len(lines))
        place = x + width - PAD_INCH if at_right else x
        texts += [
            Text(place, 0.13 + k * ROW_INCH, line, size, colour, weight, "right" if at_right else "left")
            for k, line in enumerate(lines)
        ]
        x += width
    rule = Rule(LEFT, 0.0, INNER, style.SOFT if head else style.LINE, 0.8 if head else 0.4)
    return PageBlock(most * ROW_INCH, tuple(texts), rule)


def _columns(table: ReportTable) -> tuple[float, list[float]]:
    """Font size and column widths: as wide as the text, spread over the page; wrapped in the last resort."""
    size, available = TEXT_PT, INNER + PAD_INCH  # the last column needs no white at its right
    while True:
        widths = [
            max(width_of(name, size, "bold"), *(width_of(row[i], size) for row in table.rows), 0.0) + PAD_INCH
            for i, name in enumerate(table.header)
        ]
        if sum(widths) <= available:
            spare = available - sum(widths)
            if table.numeric and len(widths) > 1:  # the last column ends at the margin
                return size, [w + spare / (len(widths) - 1) * (i > 0) for i, w in enumerate(widths)]
            return size, [*widths[:-1], widths[-1] + spare]
        widest = int(np.argmax(widths))
        rest = available - (sum(widths) - widths[widest])
        wraps = not right_aligned(table)[widest] and rest >= WRAPPED_INCH  # words wrap before they become small
        if size <= (WRAPPED_PT if wraps else MIN_PT):
            widths[widest] = max(rest, 0.8)
            return size, widths
        size -= 0.25
