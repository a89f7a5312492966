"""A report as one HTML file: no script, no outside reference, drawings as inline SVG.

Jinja2 with autoescape sets all text; only the SVG that matplotlib wrote is marked as safe. On a narrow screen a row of
a table becomes a block with a line for each cell, and drawings shrink: nothing is cut off or scrolls sideways.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, select_autoescape
from markupsafe import Markup

from analysis import figure_style as style
from analysis.progress import Progress
from analysis.reports.document import (
    DIGIT_SPACE,
    POINT_SPACE,
    Report,
    ReportDrawing,
    ReportTable,
    SectionPart,
    aligned,
    right_aligned,
    typeset,
)
from analysis.reports.drawings import as_svg
from protocol.base.units import unbroken
from protocol.base.whole_file import write_whole

WIDTH_INCH = 7.4
STACKED_INCH = 4.0  # its labels are read on a telephone; the template gives it the scale of two side by side


def write_html(report: Report, path: Path, progress: Progress | None = None) -> None:
    """Write the report at once: a report that was cancelled leaves no file."""
    write_whole(path, render_html(report, progress))


def render_html(report: Report, progress: Progress | None = None) -> str:
    """Return the report as one HTML document; `progress` as `write_html` takes it."""
    environment = Environment(
        loader=PackageLoader("analysis.reports", "templates"),
        autoescape=select_autoescape(default=True, default_for_string=True),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    sections = []
    for number, section in enumerate(report.sections, 1):
        sections.append({"title": section.title, "parts": [_part(part) for part in section.parts]})
        if progress is not None:
            progress(number, len(report.sections))
    environment.filters["padded"] = _padded
    template = environment.get_template("report.html.j2")
    return template.render(report=report, verdict=unbroken(typeset(report.verdict)), sections=sections, style=style)


def _padded(cell: str) -> Markup:
    """Return a cell with its spaces for alignment apart: a narrow screen stacks the cells and leaves them out."""
    return Markup("").join(
        Markup('<span class="pad">{}</span>').format(text) if text.isspace() else text
        for text in re.split(f"([{DIGIT_SPACE}{POINT_SPACE}]+)", cell)
    )


def _panel(svg: str, described: str) -> Markup:
    """Return the drawing as an image with an alternative text, its colours as those of the page's theme."""
    for number, colour in enumerate(style.ON_DARK):
        svg = svg.replace(colour.lower(), f"var(--c{number})")
    label = Markup(' role="img" aria-label="{}"').format(typeset(described))
    return Markup(svg[:4]) + label + Markup(svg[4:])  # noqa: S704 - matplotlib's own SVG


def _part(part: SectionPart) -> dict[str, Any]:
    if isinstance(part, ReportTable):
        shown = aligned(part)
        sides = ["right" if right else "left" for right in right_aligned(part)]
        return {"kind": "table", "table": shown, "sides": sides, "caption": typeset(shown.caption)}
    if isinstance(part, ReportDrawing):
        panels = [replace(part, draw=(one,)) for one in part.draw]
        width = min(STACKED_INCH, WIDTH_INCH / len(panels))
        drawn = [_panel(*as_svg(panel, width)) for panel in panels]
        return {"kind": "drawing", "panels": drawn, "caption": typeset(part.caption)}
    return {"kind": "text", "text": unbroken(typeset(part))}
