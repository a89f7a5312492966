"""What a recorded run tells of the dynamics, against the lag that made it."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import numpy as np
import pandas as pd
import pytest

from analysis.data.recording import STEP_COLUMNS, Recording
from analysis.elongation_control.controller import Tuning
from analysis.elongation_control.dynamic_figures import DynamicCalibration
from analysis.elongation_control.dynamics import Lag, bandwidth
from analysis.elongation_control.run_response import bode_of_run, dynamic_calibration, identify_run, tune_run
from analysis.elongation_control.sensor_loop import find_loops
from analysis.elongation_control.unit_file import TwinFile, read_twin
from protocol.base.errors import DataError, FileError
from protocol.recording import Segment
from protocol.simulator.plant import Sensors
from protocol.simulator.specimens import find_specimen
from tests.analysis.twin_unit import identified, swings

MODEL, FUSION = identified("SA1")
TRUTH = Lag(0.03, 9.0, 0.65)


def signals_of(elongation_mm: np.ndarray) -> np.ndarray:
    return np.stack([inverse.calibration.predict(elongation_mm) for inverse in FUSION.inverses], axis=1)


def run_of(quantity: str, parts: list[tuple[float, Segment]], noise_mv: float = 1.0) -> Recording:
    """Return a run whose elongation follows its segments with the lag; a step of pressure by the inverse."""
    time_s, wanted, rows, begin = [0.0], [parts[0][0]], [], 1.0
    for number, (start, segment) in enumerate(parts, 1):
        end = begin + segment.duration_s(start)
        at = np.arange(begin, end, 0.01)
        time_s += [begin - 1e-3, *at.tolist()]
        wanted += [wanted[-1]]
        wanted += [segment.at(t - begin, start)[0] for t in at]
        detail = json.dumps({"segment": asdict(segment), "start": start, "quantity": quantity})
        values = (number, 0, number, 1, "loading", 0.0, 36.0, begin, begin, begin, end, "reached", detail)
        rows.append(dict(zip(STEP_COLUMNS, values, strict=True)))
        begin = end
    grid = np.arange(0.0, time_s[-1], 0.01)
    setpoint = np.interp(grid, time_s, wanted)
    pressure = np.zeros(grid.size)
    if quantity == "kPa":
        ramped = [setpoint[0]]
        for value in setpoint[1:]:
            ramped.append(ramped[-1] + float(np.clip(value - ramped[-1], -0.36, 0.36)))
        pressure, setpoint = np.asarray(ramped), MODEL.series(np.asarray(ramped), MODEL.rest(0.0, 0.0))
    x = TRUTH.follow(grid, setpoint)
    noise = np.random.default_rng(0).normal(0.0, noise_mv, (grid.size, 2))
    steps = pd.DataFrame(rows)
    return Recording.from_arrays(grid, pressure, signals_of(x) + noise, steps=steps, meta={"unit": "SA1"}, source="run")


def test_a_step_test_gives_gains_for_its_lag():
    parts = [(0.0, Segment("step", 0.0, hold_s=1.0))]
    parts += [(a, Segment("step", b, hold_s=3.0)) for a, b in ((0.0, 14.0), (14.0, 0.0), (0.0, 14.0))]
    tuning = tune_run(run_of("kPa", parts), FUSION, MODEL)
    assert tuning.lag.omega_rad_per_s == pytest.approx(9.0, abs=0.6)
    assert tuning.lag.lag_s == pytest.approx(TRUTH.lag_s, abs=0.015)
    assert tuning.ramp_kpa_per_s == 36.0
    assert tuning.margins.phase_deg >= 59.9


def test_hysteresis_of_a_run_is_that_of_its_elongation():
    pressure_kpa, x, signals = swings("SA1")
    run = Recording.from_arrays(np.arange(x.size) / 100.0, pressure_kpa, signals)
    assert np.abs(identify_run(run, FUSION).series(pressure_kpa) - x)[1000:].max() < 0.06


def test_sines_give_the_frequency_response_of_the_lag():
    sines = [(0.5, Segment("sine", 0.5, amplitude=1.0, frequency_hz=f, periods=4.0, hold_s=1.0)) for f in (0.25, 1.0)]
    run = run_of("mm", sines)
    for point in bode_of_run(run, FUSION):
        truth = TRUTH.response(np.array([2 * np.pi * point.frequency_hz]))[0]
        assert point.gain_db == pytest.approx(20 * np.log10(abs(truth)), abs=0.2)
        assert point.phase_deg == pytest.approx(np.degrees(np.angle(truth)), abs=2.0)


def test_the_interval_of_a_gain_holds_what_differs_between_repeats():
    """Two equal sines of which the second follows by 1 % more: one point, Student's interval of two values."""
    sine = Segment("sine", 0.5, amplitude=1.0, frequency_hz=0.5, periods=4.0, hold_s=1.0)
    run = run_of("mm", [(0.5, sine), (0.5, sine)], noise_mv=0.0)
    second = (run.time_s > run.steps.started_s.iloc[1])[:, None]
    x = FUSION.evaluate(run.signal_mv).elongation_mm[:, None]
    more = np.where(second, 0.5 + 1.01 * (x - 0.5), x)[:, 0]
    (point,) = bode_of_run(replace(run, signal_mv=signals_of(more)), FUSION)
    apart_db = 20 * np.log10(1.01)
    assert point.n == 2
    assert 2 * point.u_gain_db == pytest.approx(12.706 * apart_db / 2, rel=0.02)


def test_one_sine_is_repeated_by_its_periods():
    """Periods that follow ever less, as by creep: the interval holds the first and the last."""
    sine = Segment("sine", 0.5, amplitude=1.0, frequency_hz=0.5, periods=6.0, hold_s=1.0)
    run = run_of("mm", [(0.5, sine)], noise_mv=0.0)
    x = FUSION.evaluate(run.signal_mv).elongation_mm
    fading = 0.5 + (1.02 - 0.002 * run.time_s) * (x - 0.5)
    (steady,), (point,) = bode_of_run(run, FUSION), bode_of_run(replace(run, signal_mv=signals_of(fading)), FUSION)
    assert point.n == 5
    assert steady.u_gain_db < 1e-3
    assert 2 * point.u_gain_db == pytest.approx(2.776 / 5**0.5 * 20 * np.log10(1.004) * 2.5**0.5, rel=0.1)
    (single,) = bode_of_run(run_of("mm", [(0.5, replace(sine, periods=2.0))]), FUSION)
    assert single.n == 1
    assert np.isnan([single.u_gain_db, single.u_phase_deg]).all()  # nothing was repeated
    found = DynamicCalibration("", True, "", 0.05, {}, (single,), bandwidth((single,)))
    assert [cell.partition(" ")[2] for cell in found.bode_rows()[0][1:]] == ["(one period)"] * 2


def test_steps_of_elongation_give_the_figures_of_the_lag():
    parts = [(a, Segment("step", b, hold_s=4.0)) for a, b in ((0.0, 1.0), (1.0, 0.0), (0.0, 1.0))]
    found = dynamic_calibration(run_of("mm", parts, noise_mv=0.1), FUSION)
    figures = found.steps[1.0]
    assert figures["overshoot_percent"].value == pytest.approx(6.8, abs=0.5)  # exp(-pi z / sqrt(1 - z^2))
    assert figures["settling_s"].value == pytest.approx(0.52, abs=0.06)
    assert [row["count"] for row in found.as_json()["steps"]] == [3]
    assert found.bode == ()


def test_the_sensors_own_loops_are_no_loss_of_gain():
    """A small sine lies inside the sensors' loops, over which the signals change less than along their curves."""
    parts = [(0.5, Segment("sine", 0.5, amplitude=0.25, frequency_hz=0.8, periods=8.0, hold_s=1.0))]
    run = run_of("mm", parts, noise_mv=0.0)
    unit, (_, x, signals) = find_specimen("SA1"), swings("SA1")
    truth = FUSION.evaluate(run.signal_mv).elongation_mm
    run = replace(
        run, signal_mv=Sensors(unit.sensors, unit.range_mm).advance(np.r_[np.linspace(0, 0.5, 100), truth])[100:]
    )
    residuals = [signals[::100, i] - one.calibration.predict(x[::100]) for i, one in enumerate(FUSION.inverses)]
    lag_db = 20 * np.log10(abs(TRUTH.response(np.array([2 * np.pi * 0.8]))[0]))
    (without,), (corrected,) = bode_of_run(run, FUSION), bode_of_run(run, FUSION, find_loops(x[::100], residuals))
    assert without.gain_db < lag_db - 0.08
    assert corrected.gain_db == pytest.approx(lag_db, abs=0.03)
    assert corrected.amplitude_mm == 0.25


def test_steps_and_sines_of_pressure_are_no_dynamics_of_elongation():
    """The plan step-test is one of pressure: it gives gains, no dynamic calibration."""
    with pytest.raises(DataError, match="neither steps nor sines of elongation") as refused:
        dynamic_calibration(run_of("kPa", [(0.0, Segment("step", 14.0, hold_s=2.0))]), FUSION)
    assert "steps-mm or sine-sweep-mm" in refused.value.remedy


def test_a_run_without_segments_is_refused():
    pressure_kpa, x, signals = swings("SA1")
    run = Recording.from_arrays(np.arange(x.size) / 100.0, pressure_kpa, signals)
    with pytest.raises(DataError, match="no steps, ramps or sines"):
        dynamic_calibration(run, FUSION)
    with pytest.raises(DataError, match="no steps of pressure"):
        tune_run(run_of("mm", [(0.0, Segment("step", 1.0, hold_s=2.0))]), FUSION, MODEL)


def test_a_unit_s_file_returns_every_number(tmp_path):
    twin = TwinFile("SA1", True, "2026-01-01T00:00:00+00:00", "run.boat", MODEL, Tuning.of(TRUTH, 36.0))
    twin.write(tmp_path / "units" / "SA1.twin.json")
    found = read_twin(tmp_path / "units" / "SA1.twin.json")
    assert found.tuning == twin.tuning
    assert found.model.series(np.array([5.0, -5.0])).tolist() == MODEL.series(np.array([5.0, -5.0])).tolist()
    assert read_twin(tmp_path / "none.json") is None


@pytest.mark.parametrize(
    ("key", "value"), [("hysteresis", {}), ("tuning", {"lag": 1}), ("version", 9), ("format", "other")]
)
def test_a_damaged_file_is_refused(tmp_path, key, value):
    path = tmp_path / "SA1.twin.json"
    TwinFile("SA1", True, "", "run.boat", MODEL).write(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))
    with pytest.raises(FileError):
        read_twin(path)
