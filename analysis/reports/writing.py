"""The door to the reports: analyses in, one file out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.errors import FileError, RequestError
from analysis.figures.pipeline import Analysis
from analysis.reports.build import build_report
from analysis.reports.document import Report
from analysis.reports.html import write_html
from analysis.reports.pdf import write_pdf

if TYPE_CHECKING:
    from analysis.figures.against_shadow import AgainstShadow

WRITERS = {".html": write_html, ".pdf": write_pdf}


def write_report(
    analyses: Sequence[Analysis],
    path: str | Path,
    limits: Mapping[str, float] | None = None,
    shadow: AgainstShadow | None = None,
) -> Report:
    """Write a report of one run, or a comparison of several.

    Parameters
    ----------
    path : ends in .html or .pdf.
    limits : name -> value, see `analysis.figures.repeatability.LIMITS`; the verdict is given against them.
    shadow : the run beside the digital shadow, for a report on one run; None leaves it out.

    Raises
    ------
    RequestError : another ending, no run, an unknown limit. FileError : the file cannot be written.
    """
    path = Path(path)
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise RequestError(f"{path.name} ends in neither .html nor .pdf", "Choose one of the two.")
    report = build_report(analyses, limits, shadow)
    try:
        writer(report, path)
    except OSError as error:
        raise FileError(f"{path} cannot be written: {error.strerror or error}", "Choose another folder.") from error
    return report
