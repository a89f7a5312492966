"""Which calibrations are accepted, and what is stored: always a newer entry of the unit's history."""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from analysis import load_recording
from analysis.calibration.fit import fit_calibration
from analysis.calibration.record import CalibrationRecord, SensorRecord
from analysis.figures.pipeline import analyse
from analysis.figures.sensor_analysis import Options
from analysis.warning import Warning, WarningCode
from boat_daq.engine.recording.closed_run import ClosedRun
from boat_daq.engine.settings import UnitLibrary
from boat_daq.workflows import acceptance
from boat_daq.workflows.acceptance import (
    Lack,
    RunCalibration,
    SensorCalibration,
    accept,
    accept_run,
    accepted_record,
    lacking,
    missed_bounds,
    obstacle_to,
    run_calibration,
    withdraw,
)
from boat_daq.workflows.live_conversion import prepare
from boat_daq.workflows.outlets import elongation_of
from protocol.base.errors import RequestError
from tests.analysis import boat_builder
from tests.analysis.boat_builder import Staircase, marks_of, write_boat
from tests.boat_daq.viewmodels.helpers import SAMPLE

X = np.linspace(-2.0, 3.0, 12)
FIT = fit_calibration(X, 1650 + 40 * X + np.sin(9 * X))
SENSOR = SensorCalibration(record=SensorRecord("s1", FIT.as_json(), FIT.x, FIT.y))
BARE = SensorCalibration(record=SensorRecord("s2", void="no elongation was read"))
RUN = RunCalibration(
    path="/runs/a.boat", unit="SA1", simulated=False, cycles=2, sensors=(SENSOR,), plateaus=12, read=12, curve="3",
    recording_id="a",
)  # fmt: skip


def test_a_run_without_a_curve_names_what_it_lacks_first() -> None:
    bare = replace(RUN, sensors=(BARE, BARE), read=1)
    runs = (replace(bare, cycles=0), replace(bare, plateaus=0), bare)
    assert [lacking(run) for run in runs] == [Lack.CYCLES, Lack.PLATEAUS, Lack.READINGS]
    assert [str(obstacle_to(run)) for run in runs] == [
        "This run has no complete cycle.", "This run has no plateaus.", "Only 1 of 12 plateaus has a reading.",
    ]  # fmt: skip
    assert lacking(RUN) is None


@pytest.mark.parametrize("hold_s", [0.0, 2.0])
def test_turning_points_with_readings_are_a_repeatability_run(tmp_path, hold_s: float) -> None:
    """Steps at two levels make no curve, read or not: such a run is judged by its cycles and the limits."""
    stairs = Staircase(cycles=3, dwell_s=hold_s, ramp_kpa_per_s=40.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(boat_builder, "LEVELS", np.array([50, -40]))
        steps = [
            (m.id, m.number, m.cycle, m.branch, m.target_kpa, round(m.started_s * 1e6), round(m.ended_s * 1e6))
            for m in marks_of(stairs).itertuples()
        ]
        path = write_boat(tmp_path / "SA1.boat", stairs.recording(), steps=steps)
    for elongations_mm in ({}, {n: 3.8 if n % 2 else -2.7 for n in range(1, 8)}):
        for step, mm in elongations_mm.items():
            ClosedRun(path).add_reading(step, mm, "typed", resolution_mm=0.1)
        run = run_calibration(analyse(path, mcmc=False, options=Options(fidelity="draft")), path)
        assert (run.cycles, lacking(run)) == (3, Lack.PLATEAUS)
        assert run.verdict is not None
        assert run.verdict.code == "limits"


def test_each_sensor_needs_a_curve_with_an_inverse() -> None:
    assert obstacle_to(RUN) is None
    assert str(obstacle_to(replace(RUN, sensors=(SENSOR, BARE)))) == "Sensor 2: no elongation was read."
    bent = replace(SENSOR.record, fit={**SENSOR.record.fit, "monotone": False})
    found = obstacle_to(replace(RUN, sensors=(replace(SENSOR, record=bent),)))
    assert found is not None and "one signal would give two elongations" in str(found)
    assert str(obstacle_to(None)) == "Nothing is analysed yet."
    assert str(obstacle_to(replace(RUN, sensors=()))) == "The run has no sensor."


def test_a_calibration_without_u_is_marked_where_it_is_accepted() -> None:
    """One cycle: out of tolerance with the reason, which is stored; live, a value without a band."""
    unknown = replace(SENSOR.record, u_reason="one cycle gives no uncertainty: run two or more")
    missed = missed_bounds(replace(RUN, sensors=(replace(SENSOR, record=unknown),)))
    assert missed == ("Sensor 1: U is not known: one cycle gives no uncertainty: run two or more",)
    assert missed_bounds(RUN) == ()
    found = prepare(CalibrationRecord((unknown,), simulated=False))(np.array([[1660.0], [1700.0]]))
    assert np.isfinite(found.mm).all()
    assert np.isnan(found.expanded_mm).all()
    assert [edge.size for edge in found.band(np.array([0.0, 1.0]))] == [0, 0, 0]


def test_u_with_a_stand_in_is_marked_live() -> None:
    """In the value, the name of the calibration that streams carry, and the parameter of the SECoP node."""
    stated = CalibrationRecord((replace(SENSOR.record, u_stand_in="U rests on a stand-in"),), simulated=False)
    for record, mark in ((stated, "U rests on a stand-in"), (replace(stated, sensors=(SENSOR.record,)), "")):
        conversion = prepare(record)
        found = conversion(np.array([[1660.0]]))
        assert (found.stand_in, conversion.named("SA1")) == (mark, "SA1, U with a stated value" if mark else "SA1")
        assert elongation_of(lambda conversion=conversion: conversion)((1660.0,)) == (
            found.mm[0], found.expanded_mm[0], bool(mark),
        )  # fmt: skip


def test_acceptance_and_withdrawal_add_entries(tmp_path) -> None:
    """The stored content is the record's; a withdrawal brings the entry before back."""
    missed = replace(SENSOR, out_of_tolerance=(Warning(WarningCode.OUT_OF_TOLERANCE, "r2", "R² is low"),))
    run, units = replace(RUN, sensors=(missed,)), UnitLibrary(tmp_path)
    record = accepted_record(run, [{"converged": False}])
    assert record.out_of_tolerance == ("Sensor 1: R² is low, uncertainty bands not converged",)
    assert missed_bounds(RUN) == ()
    stored, first = accept(units, record, operator="Ada"), units.load("SA1").calibration
    assert first is not None
    assert (first.content, first.recording, first.operator) == (record.as_json(), "a.boat", "Ada")
    assert (stored.unit, stored.operator, stored.calibrated_utc) == ("SA1", "Ada", first.utc)
    accept(units, replace(record, recording="b.boat"))
    withdraw(units, "SA1", first)
    again = units.load("SA1").calibration
    assert again is not None and (again.content, again.recording) == (first.content, "a.boat")
    withdraw(units, "SA1", None)
    assert units.load("SA1").calibration is None
    assert len(units.load("SA1").history) == 4


def test_run_of_a_virtual_board_is_accepted_into_its_own_library(tmp_path, monkeypatch) -> None:
    """One out of tolerance only where that is stated; one of an unnamed unit never."""
    units = UnitLibrary(tmp_path)
    record = accept_run(SAMPLE, units, anyway=True, operator="Ada")
    assert (record.unit, record.simulated, len(record.sensors)) == ("SA1", True, 2)
    assert units.names() == [] and units.of(simulated=True).names() == ["SA1"]
    missed = replace(RUN, sensors=(replace(SENSOR, out_of_tolerance=(Warning(WarningCode.IMPORT, "", "off"),)),))
    monkeypatch.setattr(acceptance, "analysed_run", lambda path, elongation: None)
    for run, cause in ((missed, "out of tolerance: Sensor 1: off"), (replace(RUN, unit=""), "names no unit")):
        monkeypatch.setattr(acceptance, "run_calibration", lambda found, path, run=run: run)
        with pytest.raises(RequestError, match=cause):
            accept_run(SAMPLE, units)


def test_a_run_without_readings_is_accepted_with_a_file_of_them(tmp_path) -> None:
    """The refusal names the option; the curve is that of the recorded readings, whose grid the file does not state."""
    recording = load_recording(SAMPLE)
    steps = recording.steps.set_index("id").loc[recording.current_readings["step"]]
    typed = {"pressure_kpa": steps["target_kpa"], "elongation_mm": recording.current_readings["elongation_mm"].array}
    readings, bare = tmp_path / "typed.csv", tmp_path / "run.boat"
    pd.DataFrame(typed).to_csv(readings, index=False)
    shutil.copy(SAMPLE, bare)
    with contextlib.closing(sqlite3.connect(bare)) as db, db:
        db.execute("DELETE FROM reading")
    units = UnitLibrary(tmp_path / "units")
    with pytest.raises(RequestError, match="cannot be accepted: None of 37 plateaus has a reading") as refused:
        accept_run(bare, units, anyway=True)
    assert "--elongation" in refused.value.remedy
    record, truth = accept_run(bare, units, elongation=readings, anyway=True), accept_run(SAMPLE, units, anyway=True)
    assert [sensor.fit["coefficients"] for sensor in record.sensors] == [
        pytest.approx(sensor.fit["coefficients"], rel=0.01) for sensor in truth.sensors
    ]
