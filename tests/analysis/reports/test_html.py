"""HTML reports: one file that loads nothing."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from analysis import Analysis, Options, analyse
from analysis.reports.build import write_report
from tests.analysis.boat_builder import PAPER, Plant, Staircase

MARKUP = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Analysis:
    """A simulated calibration whose operator is markup."""
    stairs = Staircase(Plant(cubics=PAPER[:1], noise_mv=(1.49,), loop_mm=0.25), cycles=2)
    path = tmp_path_factory.mktemp("c") / "e.csv"
    stairs.elongations().to_csv(path, index=False)
    meta = {
        "simulated": True,
        "operator": MARKUP,
        "unit": "SA1",
        "note": "a & b",
        "uuid": "1",
        "started_utc": "2026-01-01T00:00:00+00:00",
    }
    return analyse(stairs.recording(meta=meta), path, options=Options(mcmc=False))


@pytest.fixture(scope="module")
def written(calibration: Analysis, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the calibration's report is r.html and r.pdf."""
    folder = tmp_path_factory.mktemp("written")
    for ending in ("html", "pdf"):
        write_report([calibration], folder / f"r.{ending}")
    return folder


@pytest.mark.fault(48, 54, how="markup in each name and note of a simulated run", times=1)
def test_html_is_one_file_that_loads_nothing(written: Path) -> None:
    """Fault 48: markup is escaped, no outside reference, no script, SIMULATED in head and title."""
    html = (written / "r.html").read_text(encoding="utf-8")
    assert MARKUP not in html
    assert "&lt;script&gt;" in html
    outside = re.findall(r'(?:src|href|url)\s*[=(]\s*["\']?(?!#|data:)([^"\')\s>]+)', html)
    assert [ref for ref in outside if not ref.startswith("#")] == []
    assert "<script" not in html
    assert html.count("SIMULATED") >= 2
    assert html.count("<svg") >= 5  # curve, loops, cycles, budget, trace
