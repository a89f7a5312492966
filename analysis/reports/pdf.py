"""A report as PDF/A-3a and PDF/UA-1: tagged, A4, embedded fonts, page x of y, its mark across the head of every page.

Strategy: the document becomes data, the drawings SVG with their text as text, and the template `report.typ` sets the
pages with typst. Nothing is markup: a name may hold any characters. The same document as images of its pages is what
the window shows.

Rules: the same report gives the same bytes; no text leaves the page: columns are sized by measuring, long cells wrap,
and a word that is longer than a line is broken. Characters that PDF/A forbids or no font here has are replaced.
"""

from __future__ import annotations

import dataclasses
import datetime
import json
from importlib.resources import files
from pathlib import Path
from typing import Any

from analysis import figure_style as style
from analysis.progress import Progress
from analysis.reports.document import Report, ReportDrawing, ReportTable, SectionPart, aligned, right_aligned, typeset
from analysis.reports.drawings import as_svg
from analysis.reports.text_metrics import font_folders, fonts, printable
from protocol.base.units import NO_BREAK, unbroken
from protocol.base.whole_file import write_whole

WIDTH, HEIGHT = style.A4_INCH
INNER = WIDTH - 2 * style.MARGIN_INCH
PAD_INCH = 0.16
SHORT = 44  # characters of a fact that leaves place for another beside it
SHORT_WORD = 28
HEAD = 120  # characters of a running head
STANDARDS = ["a-3a", "ua-1"]  # archived, and read aloud
_SIMULATED = "SIMULATED"


def write_pdf(report: Report, path: Path, progress: Progress | None = None) -> None:
    """Write the report at once: a report that was cancelled leaves no file."""
    write_whole(path, b"".join(_compiled(report, progress, format="pdf", pdf_standards=STANDARDS)))


def render_pages(report: Report, ppi: float) -> list[bytes]:
    """Return each page of the report as a PNG image of so many pixels per inch."""
    return _compiled(report, None, format="png", ppi=ppi)


def _compiled(report: Report, progress: Progress | None, **how: Any) -> list[bytes]:
    import typst  # 80 MB that only who sets pages loads

    known = typst.Fonts(include_system_fonts=False, include_embedded_fonts=False, font_paths=font_folders())
    template = files("analysis.reports").joinpath("templates/report.typ").read_bytes()
    inputs = {"data": json.dumps(_data(report, progress))}
    made = typst.compile(template, font_paths=known, sys_inputs=inputs, timestamp=_timestamp(report.date), **how)
    return made if isinstance(made, list) else [made]


def _timestamp(date: str) -> datetime.datetime:
    """Return the moment that the file is dated: that of the report, else today; the template has no clock."""
    try:
        moment = datetime.datetime.fromisoformat(date)
    except ValueError:
        moment = datetime.datetime.combine(datetime.datetime.now(datetime.UTC).date(), datetime.time())
    return moment.replace(tzinfo=moment.tzinfo or datetime.UTC, microsecond=0)


def _data(report: Report, progress: Progress | None) -> dict[str, Any]:
    """Return what the template reads; every text of it is printable."""
    sections = []
    for number, section in enumerate(report.sections, 1):
        sections.append({"title": printable(section.title), "parts": [_part(part) for part in section.parts]})
        if progress is not None:
            progress(number, len(report.sections))
    mark = " \u00b7 ".join([*([_SIMULATED] if report.simulated else []), *report.marks])
    facts = [(label, printable(value)) for label, value in report.facts]
    head = f"{report.title}   {report.subject}"
    return {
        "name": printable(f"{f'{mark} ' if mark else ''}{report.title}: {report.subject}"),
        "author": printable(report.author),
        "title": printable(report.title),
        "subject": printable(report.subject),
        "head": printable(head if len(head) <= HEAD else f"{head[: HEAD - 1]}\u2026"),
        "footer": printable(report.footer),
        "mark": printable(mark),
        "verdict": printable(unbroken(typeset(report.verdict))),
        "alert": report.alert,
        "short": [fact for fact in facts if _is_short(fact[1])],
        "long": [fact for fact in facts if not _is_short(fact[1])],
        "sections": sections,
        "attachments": [dataclasses.asdict(file) for file in report.attachments],
        "style": {
            "fonts": fonts(), "ink": style.INK, "soft": style.SOFT, "line": style.LINE, "warning": style.WARNING,
            "accent": style.SENSOR_COLOURS[0],
            "margin": style.MARGIN_INCH, "width": WIDTH, "height": HEIGHT, "pad": PAD_INCH,
        },
    }  # fmt: skip


def _is_short(text: str) -> bool:
    return len(text) <= SHORT and max(map(len, text.split()), default=0) <= SHORT_WORD


def _part(part: SectionPart) -> dict[str, Any]:
    if isinstance(part, ReportTable):
        right = right_aligned(part)
        table = aligned(part)
        rows = [[_cell(cell, number=side) for cell, side in zip(row, right, strict=True)] for row in table.rows]
        head = [printable(name) for name in table.header]
        caption = printable(typeset(table.caption))
        longest = [max((len(row[k]) for row in rows), default=0) for k in range(len(head))]
        widest = max(range(len(head)), key=lambda k: max(longest[k], len(head[k])))
        words = not right[widest] or len(head[widest]) > longest[widest]  # words wrap before the type becomes small
        return {
            "kind": "table", "header": head, "rows": rows, "right": right, "words": words, "numeric": table.numeric,
            "halved": table.halved, "caption": caption,
        }  # fmt: skip
    if isinstance(part, ReportDrawing):
        caption = printable(typeset(part.caption))
        svg, alt = as_svg(part, INNER, text=True)
        return {"kind": "drawing", "svg": svg, "alt": printable(alt) or caption, "caption": caption}
    return {"kind": "text", "text": printable(unbroken(typeset(part)))}


def _cell(text: str, *, number: bool) -> str:
    """Return a cell's text; a number, or a pair of them, is never broken."""
    return printable(text.replace(" ", NO_BREAK) if number else text)
