"""Reports: complete, escaped, self-contained, the same every time."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from analysis import Analysis, AnalysisError, Options, analyse
from analysis.figures.acceptance import judge
from analysis.reports import drawings
from analysis.reports.build import WRITERS, build_report, write_report
from analysis.reports.document import ReportDrawing, ReportTable, aligned
from analysis.reports.panels import as_svg
from analysis.reports.pdf import INNER, LEFT
from tests.analysis.boat_builder import PAPER, Plant, Staircase, triangle

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
def repeatability() -> Analysis:
    """Ten continuous cycles whose first two are off by 5 mV."""
    plant = Plant(loop_mm=0.25)
    pressure, loading, cycle = triangle(10, 10)
    recording = plant.run(pressure, loading, cycle)
    signal = recording.signal_mv + 5.0 * (cycle <= 2)[:, None]
    from analysis import Recording

    return analyse(Recording.from_arrays(recording.time_s, recording.pressure_kpa, signal))


@pytest.fixture(scope="module")
def written(calibration: Analysis, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which the calibration's report stands as r.html and r.pdf."""
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


@pytest.mark.fault(48, 54, how="markup in each name and note of a simulated run", times=1)
@pytest.mark.skipif(shutil.which("pdffonts") is None, reason="poppler's tools are not installed")
def test_pdf_has_embedded_fonts_and_numbered_pages(written: Path) -> None:
    """A4, every font embedded, "page x of y" and SIMULATED on each page, the markup as plain text."""
    fonts = subprocess.run(["pdffonts", written / "r.pdf"], capture_output=True, text=True, check=True).stdout
    assert all(" yes yes yes " in line for line in fonts.splitlines()[2:])
    info = subprocess.run(["pdfinfo", written / "r.pdf"], capture_output=True, text=True, check=True).stdout
    pages = int(re.search(r"Pages:\s+(\d+)", info)[1])
    assert "A4" in info
    text = subprocess.run(["pdftotext", written / "r.pdf", "-"], capture_output=True, text=True, check=True).stdout
    assert all(f"page {k} of {pages}" in text for k in range(1, pages + 1))
    assert text.count("SIMULATED\n") >= pages
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
    assert max(ends) <= 72.0 * (LEFT + INNER) + 0.5


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


def test_figures_of_the_report_are_those_of_the_analysis(calibration: Analysis) -> None:
    """The key table prints the sensitivity that the analysis holds, rounded."""
    report = build_report([calibration])
    table = next(part for part in report.sections[0].parts if isinstance(part, ReportTable))
    row = next(row for row in table.rows if row[0].startswith("Sensitivity, end points"))
    assert float(row[1]) == pytest.approx(calibration.sensors[0].figures["sensitivity_mv_per_mm"].value, abs=0.05)


def test_warm_up_cycles_are_found_and_named(repeatability: Analysis) -> None:
    """Two cycles off by 5 mV are warm-up, no more."""
    assert repeatability.sensors[0].by_cycle.warm_up == 2
    report = build_report([repeatability])
    said = [p for s in report.sections for p in s.parts if isinstance(p, str)]
    assert any("warm-up in cycles 1, 2" in text for text in said)


def test_the_verdict_is_against_the_users_limits(repeatability: Analysis) -> None:
    """Kept, broken, and a limit that does not exist."""
    assert "PASSES" in build_report([repeatability], {"hysteresis": 6.0, "snr": 40.0}).verdict
    broken = build_report([repeatability], {"hysteresis": 1.0}).verdict
    assert "FAILS" in broken
    assert "hysteresis of s1" in broken
    with pytest.raises(AnalysisError, match="no limit called"):
        judge(repeatability.sensors, {"beauty": 1.0})


def test_runs_of_one_unit_are_compared(calibration: Analysis) -> None:
    """Within-run and between-run spread and the unit's history have their sections."""
    second = replace(
        calibration,
        recording=replace(
            calibration.recording,
            meta={**calibration.recording.meta, "uuid": "2", "started_utc": "2026-02-01T00:00:00+00:00"},
        ),
    )
    report = build_report([calibration, second])
    titles = [section.title for section in report.sections]
    assert any(title.startswith("Within-run and between-run spread") for title in titles)
    assert any(title.startswith("History of SA1") for title in titles)
    assert "name no unit" not in report.verdict
    nameless = [
        replace(a, recording=replace(a.recording, meta={**a.recording.meta, "unit": None}))
        for a in (calibration, second)
    ]
    assert "2 runs name no unit and are taken to be of one." in build_report(nameless).verdict


def test_a_run_without_cycles_still_makes_a_report(tmp_path: Path) -> None:
    """Fault 38: partial run, report made."""
    stairs = Staircase()
    pressure, loading, cycle, _ = stairs.trace()
    analysis = analyse(stairs.plant.run(pressure[:2500], loading[:2500], cycle[:2500]))
    for ending in ("html", "pdf"):
        write_report([analysis], tmp_path / f"r.{ending}")
        assert (tmp_path / f"r.{ending}").stat().st_size > 5000


@pytest.mark.parametrize("vented", [False, True])
def test_a_continuous_run_whose_sensors_see_nothing_draws_without_a_warning(tmp_path: Path, vented: bool) -> None:
    """No full scale, or no cycle at all: no curve, so nothing that a legend could name."""
    pressure, loading, cycle = triangle(4, 10)
    recording = Plant(cubics=((1650.0,),) * 2).run(0.0 * pressure if vented else pressure, loading, cycle)
    from analysis import Recording

    signal = np.full_like(recording.signal_mv, 1650.0)
    analysis = analyse(Recording.from_arrays(recording.time_s, recording.pressure_kpa, signal), mcmc=False)
    for draw in (partial(drawings.loop_difference, analysis), partial(drawings.drift_of_levels, analysis, 0)):
        assert as_svg(ReportDrawing((draw,), ""), 7.0).startswith("<svg")
    write_report([analysis], tmp_path / "r.html")
    assert "<svg" in (tmp_path / "r.html").read_text(encoding="utf-8")


def test_columns_meet_at_the_decimal_point() -> None:
    """1.5 above 12.25 is padded by one digit, a whole number by point and digits."""
    table = aligned(ReportTable(("a", "b"), (("x", "1.5"), ("y", "12.25"), ("z", "3"), ("w", "–"))))
    assert [row[1] for row in table.rows] == ["1.5\u2007", "12.25", "3\u2008\u2007\u2007", "–"]
    assert len({len(row[1].partition(".")[2]) for row in table.rows[:2]}) == 1


def test_another_ending_is_refused(calibration: Analysis, tmp_path: Path) -> None:
    """Neither HTML nor PDF, and a folder that is not there."""
    with pytest.raises(AnalysisError, match="neither"):
        write_report([calibration], tmp_path / "r.docx")
    with pytest.raises(AnalysisError, match="cannot be written"):
        write_report([calibration], tmp_path / "no" / "r.pdf")


def test_a_dead_sensor_is_named_and_in_no_mean(tmp_path: Path) -> None:
    """The verdict names it, a sentence holds all that is undefined, the system's sensitivity is not half of one."""
    stairs = Staircase(Plant(cubics=(PAPER[0], (1000.0,)), noise_mv=(1.0, 0.0)), cycles=2)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    analysis = analyse(stairs.recording(), tmp_path / "e.csv", options=Options(mcmc=False))
    assert analysis.sensors[0].figures["sensitivity_mv_per_mm"].value > 30
    assert analysis.system_sensitivity.void == "s2 is flat"
    report = build_report([analysis])
    assert report.verdict.endswith("Not usable: sensor 2 is flat.")
    said = [part for section in report.sections for part in section.parts if isinstance(part, str)]
    assert sum("full-scale output is zero" in text for text in said) == 1
