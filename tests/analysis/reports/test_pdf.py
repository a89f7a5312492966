"""PDF reports: fonts, page numbers, margins, the same bytes each time."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from analysis import Analysis
from analysis import figure_style as style
from analysis.reports.build import build_report
from analysis.reports.document import Report, ReportTable, Section
from analysis.reports.pdf import INNER, render_pages, write_pdf
from analysis.reports.unit_report import WRITERS
from tests.analysis.reports.conftest import MARKUP


@pytest.mark.fault(48, 54, how="markup in each name and note of a simulated run", times=1)
@pytest.mark.skipif(shutil.which("pdffonts") is None, reason="poppler's tools are not installed")
def test_pdf_has_embedded_fonts_and_numbered_pages(written: Path) -> None:
    """A4, every font embedded, "page x of y" and SIMULATED on each page, the markup as plain text."""
    fonts = subprocess.run(["pdffonts", written / "r.pdf"], capture_output=True, text=True, check=True).stdout
    assert all(" yes yes yes " in line for line in fonts.splitlines()[2:])
    info = subprocess.run(["pdfinfo", written / "r.pdf"], capture_output=True, text=True, check=True).stdout
    pages = int(re.search(r"Pages:\s+(\d+)", info)[1])
    assert "A4" in info
    assert pages <= 6
    text = subprocess.run(["pdftotext", written / "r.pdf", "-"], capture_output=True, text=True, check=True).stdout
    assert all(f"page {k} of {pages}" in text for k in range(1, pages + 1))
    assert text.count("SIMULATED\n") >= pages
    assert re.search(r"Tagged:\s+yes", info)
    assert all(b in (written / "r.pdf").read_bytes() for b in (b"<pdfaid:part>3<", b"<pdfuaid:part>1<"))
    assert MARKUP in " ".join(text.split())


@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="poppler's tools are not installed")
def test_a_long_verdict_stays_within_the_margins(calibration: Analysis, tmp_path: Path) -> None:
    """The verdict is bold, and bold letters are wider: no word of it passes the rule above it."""
    verdict = "FAILS: " + ", ".join(f"hysteresis of s{i} 4.48 against 4 % FSO" for i in range(1, 9))
    path = tmp_path / "r.pdf"
    WRITERS[".pdf"](replace(build_report([calibration]), verdict=verdict, sections=()), path)
    boxes = subprocess.run(["pdftotext", "-bbox", path, "-"], capture_output=True, text=True, check=True).stdout
    ends = [float(x) for x in re.findall(r'xMax="([0-9.]+)" yMax="[0-9.]+">[^<]+</word>', boxes)]
    assert len(ends) > 60
    assert max(ends) <= 72.0 * (style.MARGIN_INCH + INNER) + 0.5


@pytest.mark.fault(44, how="one report written twice", times=2)
@pytest.mark.parametrize("sections", [1, pytest.param(99, marks=pytest.mark.nightly)])
def test_same_report_same_bytes(calibration: Analysis, tmp_path: Path, sections: int) -> None:
    """Fault 44 for reports: written twice, equal; the first section with its drawings, nightly all of them."""
    report = build_report([calibration])
    report = replace(report, sections=report.sections[:sections])
    for ending, write in WRITERS.items():
        paths = [tmp_path / f"{k}{ending}" for k in (1, 2)]
        for path in paths:
            write(report, path)
        assert paths[0].read_bytes() == paths[1].read_bytes()


def words_of(path: Path) -> list[tuple[float, float, float, str]]:
    """Left, right, height and text of each word, points."""
    boxes = subprocess.run(["pdftotext", "-bbox", path, "-"], capture_output=True, text=True, check=True).stdout
    word = r'<word xMin="([\d.]+)" yMin="([\d.]+)" xMax="([\d.]+)" yMax="([\d.]+)">([^<]*)</word>'
    return [(float(x0), float(x1), float(y1) - float(y0), text) for x0, y0, x1, y1, text in re.findall(word, boxes)]


def of_tables(*tables: ReportTable) -> Report:
    return Report("T", "", False, "", (), (Section("S", tables),), "")


@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="poppler's tools are not installed")
def test_words_wrap_before_the_type_becomes_small(tmp_path: Path) -> None:
    """A budget with long sources keeps 7.5 points: its widest column is of words; a table of numbers alone shrinks."""
    source = "u = 0.1 % of x, normal, certificate DKD-K-4711, glass scale in the photograph, compared by two operators"
    budget = ReportTable(
        ("Component", "sensor 1, \u00b5m", "share", "source"), (("parallax", "28.9", "34.0 %", source),) * 3
    )
    numbers = ReportTable(("no.", *["s, mV"] * 12), (("1", *["-1234.567 \u00b1 12.345"] * 12),) * 3)
    write_pdf(of_tables(budget, numbers), tmp_path / "t.pdf")
    words = words_of(tmp_path / "t.pdf")
    heights = {name: next(h for _, _, h, text in words if text.startswith(name)) for name in ("parallax", "\u22121234")}
    assert heights["\u22121234"] < 7.0 / 7.5 * heights["parallax"]
    assert max(right for _, right, _, _ in words) <= 72.0 * (style.MARGIN_INCH + INNER) + 0.5


@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="poppler's tools are not installed")
def test_any_text_stays_on_its_pages(tmp_path: Path) -> None:
    """Ten thousand letters without a space, private and unpaired characters, a reversal of direction, markup."""
    markup, shalom = "#panic() *b* $x$ @r <l>", "\u05e9\u05dc\u05d5\u05dd"
    texts = ("x" * 10_000, "a\ue000b\ud800c\x00d\x0be", "\u202eevil", markup, shalom)
    facts = tuple((f"fact {k}", text) for k, text in enumerate(texts))
    rows = tuple((text, "1") for text in texts)
    section = Section(markup, (*texts, ReportTable(("a", "b"), rows)))
    report = Report(markup, shalom, False, texts[0], facts, (section,), "")
    write_pdf(report, tmp_path / "t.pdf")
    words = words_of(tmp_path / "t.pdf")
    assert min(left for left, *_ in words) >= 72.0 * style.MARGIN_INCH - 0.5
    assert max(right for _, right, _, _ in words) <= 72.0 * (style.MARGIN_INCH + INNER) + 0.5
    text = subprocess.run(["pdftotext", tmp_path / "t.pdf", "-"], capture_output=True, text=True, check=True).stdout
    assert markup in text
    assert text.count("x") > 40_000
    assert "\u202e" not in text


def test_pages_are_images() -> None:
    """The window shows each page as a picture; a table longer than a page leaves no heading alone on one."""
    pages = render_pages(of_tables(ReportTable(("no.",), tuple((str(k),) for k in range(90)), "A caption.")), 40.0)
    assert len(pages) == 2
    assert all(page.startswith(b"\x89PNG") for page in pages)
