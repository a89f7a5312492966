"""A certificate as PDF: every page numbered and marked, the XML inside, nothing off the page."""

from __future__ import annotations

import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from analysis import Analysis
from analysis.certificates import document
from analysis.certificates.certificate import certificate_of
from analysis.certificates.dcc import dcc_xml
from analysis.certificates.document import certificate_document
from analysis.reports.document import ReportTable
from boat_daq.workflows.certificate import write_certificate
from protocol.base.errors import BoatDaqError
from tests.analysis.certificates.conftest import REQUEST, with_meta


def run(*command: str | Path) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@pytest.mark.skipif(shutil.which("pdfdetach") is None, reason="poppler's tools are not installed")
def test_pdf_has_numbered_pages_the_xml_and_an_empty_place_for_a_signature(
    calibration: Analysis, tmp_path: Path
) -> None:
    """PDF/A-3a as its own metadata state it; the attached file is the XML, letter by letter."""
    certificate = certificate_of([calibration], REQUEST)
    path = write_certificate(certificate, tmp_path / "c.pdf")
    content = path.read_bytes()
    assert b"<pdfaid:part>3</pdfaid:part>" in content
    assert b"<pdfaid:conformance>A</pdfaid:conformance>" in content
    assert b"/AFRelationship/Data" in content.replace(b" ", b"")
    run("pdfdetach", "-saveall", "-o", tmp_path, path)
    assert (tmp_path / "dcc.xml").read_text(encoding="utf-8") == dcc_xml(certificate)
    pages = run("pdftotext", "-layout", path, "-").split("\f")[:-1]
    for k, page in enumerate(pages, 1):
        assert f"page {k} of {len(pages)}" in page
        assert certificate.number in page
        assert "relates only to the item calibrated" in page
        assert "SIMULATED" not in page
    whole = " ".join(" ".join(pages).split())
    assert "Lab & Söhne" in whole
    assert re.search(r"Authorised by _+ _+ _+", whole)
    assert "not traceable: no uncertainty is given for pressure gauge, temperature" in whole
    assert re.findall(r"(?:analysis|boat_daq|protocol|docs)/|\w\.(?:md|py)\b", whole + dcc_xml(certificate)) == []


@pytest.mark.skipif(shutil.which("pdftotext") is None, reason="poppler's tools are not installed")
def test_simulated_run_is_marked_on_every_page(calibration: Analysis, tmp_path: Path) -> None:
    certificate = certificate_of([with_meta(calibration, simulated=True)], REQUEST)
    pages = run("pdftotext", write_certificate(certificate, tmp_path / "c.pdf"), "-").split("\f")[:-1]
    assert len(pages) > 1
    assert all("SIMULATED · NO CERTIFICATE" in page for page in pages)
    assert not any("Calibration certificate" in page or "relates only" in page for page in pages)


def test_document_rounds_the_numbers_of_the_certificate(calibration: Analysis) -> None:
    """Each row of the table is a level, to the place of two digits of U, as in the XML; neither has a -0."""
    certificate = certificate_of([calibration], REQUEST)
    levels = certificate.items[0].sensors[0].levels
    section = next(s for s in certificate_document(certificate).sections if s.title == "Results: sensor 1")
    table = next(part for part in section.parts if isinstance(part, ReportTable))
    assert len(table.rows) == len(levels)
    for row, level in zip(table.rows, levels, strict=True):
        assert float(row[2]) == pytest.approx(level.elongation_mm, abs=level.expanded_mm / 20)
        assert float(row[6]) == pytest.approx(level.expanded_mm, rel=0.06)
        assert len(row[6].replace(".", "").lstrip("0")) == 2
    root = ET.fromstring(dcc_xml(certificate))
    lists = [element.text.split() for element in root.iter("{https://ptb.de/si}uncertaintyXMLList")]
    assert sorted(float(u) for one in lists for u in one) == sorted(float(row[6]) for row in table.rows)
    numbers = " ".join(element.text or "" for element in root.iter("{https://ptb.de/si}valueXMLList"))
    assert "-0.0" not in numbers.split()


def test_comparison_has_a_row_for_each_item(calibration: Analysis) -> None:
    runs = [with_meta(calibration, unit=unit, item=unit) for unit in ("SA1", "SA2", "SA3")]
    document = certificate_document(certificate_of(runs, REQUEST))
    section = next(s for s in document.sections if s.title == "Comparison")
    assert [row[0] for row in section.parts[0].rows] == ["SA1", "SA2", "SA3"]


def test_another_ending_is_refused(calibration: Analysis, tmp_path: Path) -> None:
    with pytest.raises(BoatDaqError, match="neither"):
        write_certificate(certificate_of([calibration], REQUEST), tmp_path / "c.docx")
    with pytest.raises(BoatDaqError, match="cannot be written"):
        write_certificate(certificate_of([calibration], REQUEST), tmp_path / "no" / "c.xml")


@pytest.mark.parametrize(("number", "colour"), [(1, "#0072B2"), (2, "#D55E00")])
def test_each_sensor_has_its_colour(number: int, colour: str) -> None:
    """Blue and vermillion of Okabe and Ito, as in window and report; both were blue."""
    ax = Figure().add_subplot()
    calibration = SimpleNamespace(x_range=(0.0, 1.0), predict=np.sin)
    document._curve(number, SimpleNamespace(calibration=calibration, levels=()), ax)
    assert ax.lines[0].get_color() == colour
