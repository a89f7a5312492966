"""Displacement columns as elongation; signals of other quantities, with scale and offset."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis import Analysis, analyse, load_recording
from analysis.calibration.record import CalibrationRecord
from analysis.calibration_export.calibration_file import CalibrationFile, read_calibration
from analysis.calibration_export.conversion import convert_recording
from analysis.calibration_export.forms import calibration_text, write_calibration
from analysis.calibration_export.run_record import calibration_record
from analysis.certificates.certificate import Request, certificate_of
from analysis.certificates.dcc import dcc_xml
from analysis.certificates.document import certificate_document
from analysis.certificates.laboratory import Laboratory
from analysis.data.boat_writer import write_boat_file
from analysis.data.csv_import import import_csv
from analysis.data.export import export
from analysis.history.unit_history import unit_history
from analysis.reports.build import write_report
from analysis.reports.unit_report import unit_report
from boat_daq.viewmodels.results.run_result import _run_result
from protocol.base.errors import BoatDaqError
from tests.field.truth import FSO_MV, Run, is_the_truth, put

SLOPE_MM = 0.08  # a kPa
UNIT_OF = {"Force (N)": "N", "Resistance (kOhm)": "kohm", "Capacitance [pF]": "pF", "Wavelength (nm)": "nm",
           "S1 (counts)": "counts"}  # fmt: skip


def with_laser(run: Run, form: str = "{:.3f},{:.4f},{:.4f},{:.4f}", head: str = "Laser (mm)") -> list[str]:
    """Return a table with a displacement sensor of 1 um, 2 um noise."""
    rng = np.random.default_rng(4)
    x = SLOPE_MM * run.pressure_kpa + rng.normal(0, 0.002, run.time_s.size)
    rows = zip(run.time_s, run.pressure_kpa, run.signal_mv, np.round(x, 3), strict=True)
    return [f"time_s,pressure_kpa,s1_mv,{head}", *(form.format(*row) for row in rows)]


@pytest.mark.parametrize(("head", "mapped"), [("Laser (mm)", ""), ("Ch 4", "4:mm"), ("LVDT (um)", "4*1000:um")])
def test_a_displacement_column_is_the_elongation(tmp_path: Path, run: Run, head: str, mapped: str) -> None:
    """A calibration without a typed reading: 6 mV/kPa over 0.08 mm/kPa, also from the stored recording."""
    path = put(tmp_path, with_laser(run, head=head))
    recording = import_csv(path, columns={"elongation_mm": mapped} if mapped else None)
    write_boat_file(tmp_path / "a.boat", recording, original=path)
    for one in (recording, load_recording(tmp_path / "a.boat")):
        found = analyse(one, mcmc=False)
        assert found.kind == "calibration"
        assert found.sensors[0].figures["sensitivity_mv_per_mm"].value == pytest.approx(6 / SLOPE_MM, rel=0.01)
        assert found.elongations.resolution_mm < 0.01


@pytest.mark.parametrize("title", UNIT_OF)
def test_signals_of_other_quantities_keep_their_unit(tmp_path: Path, run: Run, title: str) -> None:
    """The figures are in the unit of the signal, and an export is imported again with it."""
    unit = UNIT_OF[title]
    recording = import_csv(put(tmp_path, run.lines(head=f"time_s,pressure_kpa,{title}")))
    assert recording.signal_unit == unit
    found = analyse(recording, mcmc=False)
    assert found.to_json()["signal_unit"] == unit
    assert found.sensors[0].figures["fso_mv"].value == pytest.approx(FSO_MV, abs=0.5)
    assert found.sensors[0].figures["fso_mv"].unit == unit
    files = export(recording, tmp_path / "out.csv", "csv")
    assert json.loads(files[1].read_text())["columns"][f"s1_{unit.lower()}"] == unit
    again = import_csv(files[0])
    assert again.signal_unit == unit
    np.testing.assert_array_equal(again.signal_mv, recording.signal_mv)


@pytest.fixture(scope="module")
def force(tmp_path_factory: pytest.TempPathFactory, run: Run) -> Analysis:
    """A calibration of signals in N: 3 N over 4 mm."""
    folder, newton = tmp_path_factory.mktemp("force"), replace(run, signal_mv=run.signal_mv / 100)
    path = put(folder, [line.replace("s1_mv", "Force (N)") for line in with_laser(newton)])
    recording = import_csv(path)
    meta = {**recording.meta, "unit": "F1", "started_utc": "2026-11-01T10:00:00+00:00"}
    return analyse(replace(recording, meta=meta), mcmc=False)


def test_no_document_of_other_signals_shows_millivolts(tmp_path: Path, force: Analysis) -> None:
    """Report, certificate, exported code, history and the tables of the window are in N, with its digits."""
    write_report([force], tmp_path / "a.html")
    texts = [(tmp_path / "a.html").read_text(encoding="utf-8")]
    certificate = certificate_of([force], Request(Laboratory("Lab"), customer="C", limits={"hysteresis": 5.0}))
    texts += [dcc_xml(certificate), repr(certificate_document(certificate))]
    assert r"\newton\per\milli\metre" in texts[1]
    assert "signal, N" in texts[2]
    assert re.search(r"'16\.\d{4}'", texts[2])  # a level, to the digits of 3 N
    calibration = CalibrationFile.of_run(force)
    codes = [calibration_text(calibration, form) for form in ("c", "matlab", "csv")]
    write_calibration(calibration, tmp_path / "c.json", "json")
    assert read_calibration(tmp_path / "c.json").signal_unit == "N"
    histories = [unit_history([force], 0, check_point_mm=2.0)]
    texts.append(repr(unit_report("F1", histories, simulated=False)))
    shown = _run_result(force, tmp_path / "f.boat")
    texts.append(repr([force, shown.key_figures, shown.figures, shown.uncertainty, shown.warnings]))
    assert "Full-scale output\\nN" in texts[-1]
    assert not any("_mv" in text for text in codes)
    for text in (*texts, *codes):
        assert not re.search(r"\bmV\b|milli.volt", text)


def test_a_calibration_is_not_applied_to_signals_of_another_unit(force: Analysis, run: Run, tmp_path: Path) -> None:
    """Neither to a recording nor to a board; nor is it compared with one of such signals."""
    other = import_csv(put(tmp_path, run.lines()))
    with pytest.raises(BoatDaqError, match="the signals are in mV, the calibration is for signals in N"):
        convert_recording(other, CalibrationFile.of_run(force))
    with pytest.raises(BoatDaqError, match="signals in N and mV are not compared"):
        certificate_of([force, analyse(other, mcmc=False)], Request(Laboratory("Lab"), customer="C"))
    record = calibration_record(force)
    assert CalibrationRecord.parse(record.as_json()).signal_unit == "N"


def test_scale_and_offset_are_of_the_map(tmp_path: Path, run: Run) -> None:
    """A transducer of 25 kPa a volt from 0.5 V on, and an amplifier of 2, inverted."""
    rows = zip(run.time_s, run.pressure_kpa / 25 + 0.5, 2000 - run.signal_mv / 2, strict=True)
    lines = ["time_s,AI1,AI2-a", *(f"{t:.3f},{p:.6f},{s:.4f}" for t, p, s in rows)]
    path = put(tmp_path, lines)
    columns = {"pressure_kpa": "AI1*25-12.5:kPa", "s1_mv": "AI2-a*-2+4000:mV"}
    is_the_truth(path, columns=columns)
    again = import_csv(path, columns=import_csv(path, columns=columns).meta["import_map"])
    np.testing.assert_allclose(again.pressure_kpa, run.pressure_kpa, atol=1e-4)


def test_signals_of_two_quantities_are_refused(tmp_path: Path, run: Run) -> None:
    """One recording has one unit of signals."""
    rows = [f"{line},1" for line in run.lines(head="")]
    path = put(tmp_path, ["time_s,pressure_kpa,S1 (mV),S2 (N)", *rows])
    with pytest.raises(BoatDaqError, match="in N, another signal in mV"):
        import_csv(path)
