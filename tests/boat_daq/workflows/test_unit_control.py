"""A unit under control: refused without its calibration, identified, tuned, and made into a regulator."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from analysis import fit_calibration
from analysis.data.recording import STEP_COLUMNS, Recording
from analysis.elongation_control.controller import Output, StopCode
from analysis.elongation_control.run_response import run_elongation
from boat_daq.engine.settings import UnitLibrary
from boat_daq.workflows.unit_control import (
    as_regulator,
    check_setpoint,
    dynamics_of,
    fusion_of,
    held_elongation,
    identify_unit,
    live_prediction_of,
    load_twin,
    prepare_control,
    regulator_of,
    store_twin,
    twin_path,
)  # fmt: skip
from protocol.base.errors import FileError, RequestError
from protocol.recording import Segment
from protocol.simulator.plant import Sensors
from protocol.simulator.specimens import find_specimen
from tests.analysis.twin_unit import swings


@pytest.fixture
def units(tmp_path) -> UnitLibrary:
    return UnitLibrary(tmp_path, simulated=True)


def swings_run() -> Recording:
    """Return a run of SA1 without noise."""
    pressure_kpa, x, signals = swings("SA1")
    return Recording.from_arrays(
        np.arange(x.size) / 100.0, pressure_kpa, signals, meta={"unit": "SA1"}, source="a.boat"
    )


@pytest.fixture(scope="module")
def run() -> Recording:
    return swings_run()


def accept(units: UnitLibrary) -> None:
    """Accept a calibration of SA1."""
    _, x, signals = swings("SA1")
    x, signals = x[1000::200], signals[1000::200]
    sensors = [
        {
            "name": f"s{i + 1}", "fit": fit_calibration(x, signals[:, i], 3).as_json(), "elongation_mm": x.tolist(),
            "signal_mv": signals[:, i].tolist(), "noise_mv": 1.5, "model_mv": 0.7,
        }
        for i in range(2)
    ]  # fmt: skip
    units.add_calibration("SA1", {"sensors": sensors, "simulated": True})


def test_without_an_accepted_calibration_there_is_no_control(units, run):
    for refused in (
        lambda: identify_unit(run, units),
        lambda: regulator_of(units, "SA1"),
        lambda: load_twin(units, ""),
    ):
        with pytest.raises(RequestError, match=r"no accepted calibration|not named"):
            refused()


def test_an_identified_unit_has_a_regulator_until_its_calibration_changes(units, run):
    accept(units)
    with pytest.raises(RequestError, match="not identified"):
        regulator_of(units, "SA1")
    identify_unit(run, units)
    regulator = regulator_of(units, "SA1")
    assert regulator.unit == "SA1"
    assert load_twin(units, "SA1").tuning is None  # no step test yet: slow gains
    with pytest.raises(RequestError, match=r"to 3\.79 mm"):
        regulator.check(9.0)
    twin = load_twin(units, "SA1")
    store_twin(units, replace(twin, calibration_utc="2026-01-01T00:00:00+00:00"))
    with pytest.raises(RequestError, match="another calibration"):
        regulator_of(units, "SA1")


def test_a_setpoint_is_refused_before_anything_is_connected(units, run):
    """Without a calibration of either kind, outside the range, and no number; inside it is taken."""
    with pytest.raises(RequestError, match="no accepted calibration"):
        check_setpoint(units, "SA1", 1.0)
    accept(units)
    identify_unit(run, units)
    for mm in (50.0, float("nan")):
        with pytest.raises(RequestError, match="outside the calibrated range"):
            check_setpoint(units, "SA1", mm)
    check_setpoint(units.of(simulated=False), "SA1", 1.0)


def test_a_held_elongation_is_that_of_the_control(units):
    """The sensors' own loops are taken out, as the control does: a hold after a rise is not read below its setpoint."""
    accept(units)
    rise, hold = np.linspace(-2.5, 1.5, 400), np.full(300, 1.5)
    x = np.r_[np.linspace(0.0, -2.5, 200), rise, hold]
    unit = find_specimen("SA1")
    segment = asdict(Segment("step", 1.5, hold_s=3.0))
    detail = json.dumps({"segment": segment, "start": -2.5, "quantity": "mm"})
    values = (2, 0, 2, 1, "loading", 0.0, 36.0, 6.0, 6.0, 6.0, 9.0, "reached", detail)
    run = Recording.from_arrays(
        np.arange(x.size) / 100.0, x, Sensors(unit.sensors, unit.range_mm).advance(x),
        steps=pd.DataFrame([dict(zip(STEP_COLUMNS, values, strict=True))]), meta={"unit": "SA1"},
    )  # fmt: skip
    held = held_elongation(units, run, 1.5)
    assert held["deviation_mm"] == pytest.approx(held["elongation_mm"] - 1.5)
    assert abs(held["deviation_mm"]) < 0.01
    assert held["rms_mm"] < 0.01 < held["u_mm"]
    found = run_elongation(run, fusion_of(units, "SA1"))[0][-150:].mean() - 1.5
    assert abs(found) > 0.015


def test_another_actuator_is_kept_and_predicts_nothing_until_its_light_is_traced(units, run, monkeypatch, tmp_path):
    accept(units)
    twin = identify_unit(run, units)
    fusion = fusion_of(units, "SA1")
    assert live_prediction_of(units, "SA1", fusion) is not None
    actuator = replace(twin.actuator, wall_mm=2.4)
    store_twin(units, replace(twin, actuator=actuator, face="inner"))
    again = identify_unit(run, units)
    assert (again.actuator, again.face) == (actuator, "inner")
    monkeypatch.setattr("analysis.signal_prediction.light_table.cache_folder", lambda: tmp_path)
    assert live_prediction_of(units, "SA1", fusion) is None
    path = twin_path(units, "SA1")
    path.write_text(path.read_text(encoding="utf-8").replace('"wall_mm": 2.4', '"wall_mm": -2.4'), encoding="utf-8")
    with pytest.raises(FileError, match="wall_mm"):
        load_twin(units, "SA1")


def test_a_calibration_run_prepares_the_control_and_says_what_is_next(units, run, monkeypatch):
    accept(units)
    monkeypatch.setattr(
        "analysis.data.load.load_recording", lambda _: replace(run, meta={**run.meta, "simulated": True})
    )
    text = prepare_control(Path("a.boat"), units)
    assert text.startswith("unit SA1 identified: R² ")
    assert load_twin(units, "SA1").model.r2 > 0.99


@pytest.mark.parametrize("code", StopCode)
def test_why_the_control_stops_is_a_message_of_its_own(code):
    found = Output(1.0, 2.0, 0.5, 0.4, 0.1, saturated=True, lost=(2,), stop=code, cause="cause", remedy="remedy")
    controller = SimpleNamespace(
        unit="SA1", period_s=0.04, delay_margin_s=0.1, check=None, begin=None, advance=lambda *_, shaped: found
    )
    regulated = as_regulator(controller).advance(0.0, 0.0, (0.5, 0.0, 0.0), np.zeros((1, 2)), (-40.0, 50.0), True)
    assert regulated.stop.kind.name in (code.name, "SENSORS_DISAGREE", f"ELONGATION_{code.name}")
    assert (regulated.stop.cause, regulated.stop.remedy) == ("cause", "remedy")
    assert (regulated.pressure_kpa, regulated.u_mm, regulated.saturated, regulated.lost) == (1.0, 0.1, True, (2,))


def test_dynamics_ask_the_units_of_the_runs_own_kind_of_board(tmp_path):
    """The calibration of a simulated run is sought among simulated units."""
    sample = Path(__file__).parents[3] / "recordings" / "simulated_SA1_two_cycles.boat"
    with pytest.raises(RequestError, match="simulated unit SA1 has no accepted calibration"):
        dynamics_of(UnitLibrary(tmp_path), sample)
