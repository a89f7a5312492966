"""One to four sensors from the samples to every product: figures, inverse, fusion, conversion, files, reports."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis import Options, analyse
from analysis.calibration_export.calibration_file import CalibrationFile, read_calibration
from analysis.calibration_export.conversion import convert_recording
from analysis.calibration_export.forms import FORMS, calibration_text
from analysis.data.export import export
from analysis.data.load import load_recording
from analysis.data.recording import Recording
from analysis.figures.pipeline import Analysis
from analysis.reports.build import build_report
from analysis.reports.document import ReportTable
from analysis.segmentation.strokes import stroke_figures
from tests.analysis.boat_builder import PAPER, PAPER_NOISE, Plant, Staircase, triangle

COUNTS = [1, 4, *(pytest.param(count, marks=pytest.mark.nightly) for count in (2, 3))]


def plant(sensors: int) -> Plant:
    """Return a plant with so many sensors, those behind the second a little less sensitive."""
    cubics = tuple(tuple(c * (0.9 if i > 1 else 1.0) for c in PAPER[i % 2]) for i in range(sensors))
    return Plant(cubics=cubics, noise_mv=tuple(PAPER_NOISE[i % 2] for i in range(sensors)), rate_hz=50.0)


@pytest.fixture(scope="module", params=COUNTS)
def calibrated(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, Analysis]:
    """A staircase of three cycles with its readings, analysed."""
    stairs = Staircase(plant(request.param), cycles=3, dwell_s=1.6)
    readings = tmp_path_factory.mktemp("counts") / "x.csv"
    stairs.elongations().to_csv(readings, index=False)
    recording = stairs.recording()
    return recording, analyse(recording, readings, options=Options(mcmc=False, x_resolution_mm=0.01))


def test_every_sensor_has_its_figures(calibrated: tuple[Recording, Analysis]) -> None:
    """Sensitivity near the plant's own, in the object of the surface and in a report of one table for two sensors."""
    recording, run = calibrated
    for sensor, cubic in zip(run.sensors, plant(recording.n_sensors).cubics, strict=True):
        ends = np.polynomial.Polynomial(cubic)(np.array([-2.7, 3.8]))
        assert sensor.figures["sensitivity_mv_per_mm"].value == pytest.approx((ends[1] - ends[0]) / 6.5, rel=0.01)
    assert [sensor["name"] for sensor in run.to_json()["sensors"]] == list(recording.sensor_names)
    tables = [part for part in build_report([run]).sections[0].parts if isinstance(part, ReportTable)]
    named = [head for table in tables for head in table.header if head.startswith("Sensor ")]
    assert list(dict.fromkeys(named)) == [f"Sensor {n}" for n in range(1, recording.n_sensors + 1)]


def test_signals_become_elongation(calibrated: tuple[Recording, Analysis], tmp_path: Path) -> None:
    """The fused elongation is the plant's within its uncertainty, which falls with the sensors; read from the file."""
    recording, run = calibrated
    path = tmp_path / "c.json"
    path.write_text(CalibrationFile.of_run(run).text(), encoding="utf-8")
    calibration = read_calibration(path)
    converted = convert_recording(recording, calibration)
    known = converted.valid & (recording.pressure_kpa > -35) & (recording.pressure_kpa < 45)
    truth = plant(recording.n_sensors).elongation(recording.pressure_kpa, np.zeros(recording.n, bool))
    assert known.sum() > 0.5 * recording.n
    error = np.abs(converted.elongation_mm - truth)[known]
    assert np.mean(error <= converted.u_mm[known]) > 0.9
    assert float(np.nanmedian(converted.u_mm)) < 0.12 / np.sqrt(recording.n_sensors) + 0.03


def test_every_form_names_the_number_of_sensors(calibrated: tuple[Recording, Analysis]) -> None:
    """C, MATLAB, CSV and JSON of the calibration exist for each count."""
    recording, run = calibrated
    calibration = CalibrationFile.of_run(run)
    texts = {form: calibration_text(calibration, form) for form in FORMS}
    assert f"#define BOAT_SENSORS {recording.n_sensors}" in texts["c"]
    assert all(f"s{recording.n_sensors}" in texts[form] for form in ("json", "csv"))


def test_an_export_is_read_again(calibrated: tuple[Recording, Analysis], tmp_path: Path) -> None:
    """Each signal comes back to the last bit."""
    recording, _ = calibrated
    export(recording, tmp_path / "r.csv", "csv")
    np.testing.assert_array_equal(load_recording(tmp_path / "r.csv").signal_mv, recording.signal_mv)


@pytest.mark.parametrize("sensors", COUNTS)
def test_continuous_run_has_figures_of_each_sensor(sensors: int) -> None:
    """Repeatability and strokes of twelve cycles without holds."""
    recording = plant(sensors).run(*triangle(12, 4.0, rate_hz=50.0))
    run = analyse(recording, options=Options(mcmc=False))
    assert (run.kind, len(run.sensors)) == ("repeatability", sensors)
    assert all(np.isfinite(sensor.figures["repeatability_percent_fso"].value) for sensor in run.sensors)
    assert len(stroke_figures(recording, min_speed_kpa_per_s=0.0)["sensors"]) == sensors
    build_report([run])
