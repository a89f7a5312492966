"""Reports: complete, escaped, self-contained, the same every time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from analysis import Analysis, BoatDaqError, Options, analyse
from analysis.calibration_export.verdict import verdict_of
from analysis.figures.acceptance import conformity_json, judge
from analysis.figures.figure import Figure
from analysis.reports.build import build_report, write_report
from analysis.reports.document import ReportTable, Section, cells
from analysis.reports.unit_report import WRITERS
from tests.analysis.boat_builder import PAPER, Plant, Staircase, triangle


@pytest.fixture(scope="module")
def repeatability() -> Analysis:
    """Ten continuous cycles whose first two are off by 5 mV."""
    plant = Plant(loop_mm=0.25)
    pressure, loading, cycle = triangle(10, 10)
    recording = plant.run(pressure, loading, cycle)
    signal = recording.signal_mv + 5.0 * (cycle <= 2)[:, None]
    from analysis import Recording

    return analyse(Recording.from_arrays(recording.time_s, recording.pressure_kpa, signal))


def test_figures_of_the_report_are_those_of_the_analysis(calibration: Analysis) -> None:
    """The key table prints the sensitivity that the analysis holds, rounded."""
    report = build_report([calibration])
    table = next(part for part in report.sections[0].parts if isinstance(part, ReportTable))
    row = next(row for row in table.rows if row[0].startswith("Sensitivity, end points"))
    assert float(row[1]) == pytest.approx(calibration.sensors[0].figures["sensitivity_mv_per_mm"].value, abs=0.05)
    assert dict(report.facts)["Cycles"] == "2 complete"
    tables = {part.header[0]: part for s in report.sections for part in s.parts if isinstance(part, ReportTable)}
    assert not {row[3] for row in tables["no."].rows} & {"-0.00", "+-0.00"}
    assert calibration.budgets is not None
    assert f"At x = {calibration.budgets.x_mm:+.2f} mm" in tables["Component"].caption
    assert not any("not assessed" in cell for row in tables["Component"].rows for cell in row)


def test_a_figure_without_an_interval_has_its_own_decimals() -> None:
    """One cycle gives no interval of a loop; five decimals would claim one."""
    assert cells(Figure(5.00755, "% FSO", 1), 2) == ("5.01", "")
    assert cells(Figure(5.00755, "% FSO", 3, 4.9, 5.1), 2) == ("5.008", "4.900 … 5.100")


def test_warm_up_cycles_are_found_and_named(repeatability: Analysis) -> None:
    """Two cycles off by 5 mV are warm-up, no more."""
    assert repeatability.sensors[0].by_cycle.warm_up == 2
    report = build_report([repeatability])
    paragraphs = [p for s in report.sections for p in s.parts if isinstance(p, str)]
    assert any("warm-up in cycles 1, 2" in text for text in paragraphs)


def test_the_verdict_is_against_the_users_limits(repeatability: Analysis) -> None:
    """Kept, broken, and a limit that does not exist."""
    kept = build_report([repeatability], {"hysteresis": 6.0, "snr": 40.0}).verdict
    assert kept == "\u25cf All 2 limits are kept."
    broken = build_report([repeatability], {"hysteresis": 1.0}).verdict
    assert broken.startswith("\u25a0 Hysteresis, system, sensor ")
    assert "limit 1 % FSO, fail" in broken
    with pytest.raises(BoatDaqError, match="no limit called"):
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
    rows = [row[0] for s in report.sections for t in s.parts if isinstance(t, ReportTable) for row in t.rows]
    assert rows and not any(row.startswith("Sensitivity") for row in rows)  # a column of the runs, in no second table
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


def test_another_ending_is_refused(calibration: Analysis, tmp_path: Path) -> None:
    """Neither HTML nor PDF, and a folder that is not there."""
    with pytest.raises(BoatDaqError, match="neither"):
        write_report([calibration], tmp_path / "r.docx")
    with pytest.raises(BoatDaqError, match="cannot be written") as refused:
        write_report([calibration], tmp_path / "no" / "r.pdf")
    assert refused.value.remedy == f"make the folder {tmp_path / 'no'}, or choose another"


def test_a_dead_sensor_is_named_and_in_no_mean(tmp_path: Path) -> None:
    """The verdict names it, a sentence holds all that is undefined, the system's sensitivity is not half of one."""
    stairs = Staircase(Plant(cubics=(PAPER[0], (1000.0,)), noise_mv=(1.0, 0.0)), cycles=2)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    analysis = analyse(stairs.recording(), tmp_path / "e.csv", options=Options(mcmc=False))
    assert analysis.sensors[0].figures["sensitivity_mv_per_mm"].value > 30
    assert analysis.system_sensitivity.void == "s2 is flat"
    report = build_report([analysis])
    assert report.verdict.startswith("\u25a0 Not a calibration: sensor 2 is flat. ")
    paragraphs = [part for section in report.sections for part in section.parts if isinstance(part, str)]
    assert sum("full-scale output is zero" in text for text in paragraphs) == 1


def test_progress_of_a_report_counts_its_parts(written: Path, fractions: dict[str, list[float]]) -> None:
    """HTML by its sections, PDF by its pages: every part is reported once, the last one as the whole."""
    assert (written / "r.html").exists()
    for seen in fractions.values():
        assert len(seen) >= 5
        assert seen == pytest.approx([(k + 1) / len(seen) for k in range(len(seen))])


@pytest.mark.parametrize("ending", ["html", "pdf"])
def test_cancelled_report_leaves_no_file(calibration: Analysis, tmp_path: Path, ending: str) -> None:
    """What the progress raises ends the writing, and nothing of the report is left."""

    def cancel(done: float, total: float) -> None:
        raise KeyboardInterrupt

    report = replace(build_report([calibration]), sections=(Section("Of text", ("A paragraph.",)),))
    with pytest.raises(KeyboardInterrupt):
        WRITERS[f".{ending}"](report, tmp_path / f"r.{ending}", cancel)
    assert not list(tmp_path.iterdir())


def test_report_without_limits_states_the_published_ones(calibration: Analysis, repeatability: Analysis) -> None:
    """One statement of each limit: report, verdict, `conformity` of the JSON and the window's table agree."""
    report, verdict = build_report([calibration]), verdict_of(calibration)
    (table,) = (
        part
        for section in report.sections
        for part in section.parts
        if isinstance(part, ReportTable) and part.header[0] == "Conformity"
    )
    assert table in report.sections[0].parts  # beside the verdict
    assert table.caption.startswith("Published limits; none were set.")
    assert table.header == ("Conformity", "limit", "Sensor 1", "probability")
    assert [row[2] for row in table.rows] == [one.conformity.label for one in verdict.limits]
    stated = [one["conformity"] for one in conformity_json(calibration, {}) if one["figure"] != "r2"]
    assert stated == [str(one.conformity) for one in verdict.limits]
    assert verdict.headline in report.verdict
    uncalibrated = build_report([repeatability]).verdict
    assert "published limits" in uncalibrated or "limit 5 % FSO" in uncalibrated
