"""A calibration whose operator is markup, analysed and reported once for all tests of the reports."""

from __future__ import annotations

from pathlib import Path

import pytest

from analysis import Analysis, Options, analyse
from analysis.reports.build import write_report
from tests.analysis.boat_builder import PAPER, Plant, Staircase

MARKUP = "<script>alert(1)</script>"


@pytest.fixture(scope="session")
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


@pytest.fixture(scope="session")
def fractions() -> dict[str, list[float]]:
    """What each report of `written` gave as its progress, by ending."""
    return {"html": [], "pdf": []}


@pytest.fixture(scope="session")
def written(calibration: Analysis, fractions: dict[str, list[float]], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the calibration's report is r.html and r.pdf."""
    folder = tmp_path_factory.mktemp("written")
    for ending, seen in fractions.items():
        write_report([calibration], folder / f"r.{ending}", progress=lambda done, total, s=seen: s.append(done / total))
    return folder
