"""The figures of a run against a plant whose truth is in closed form."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from analysis import Options, Recording, analyse, load_recording
from analysis.figures.stored_results import store_analysis
from analysis.numbers import finite
from analysis.statistics import resampling_weights
from tests.analysis.boat_builder import PAPER, PAPER_NOISE, Plant, Staircase, marks_of, triangle, write_boat
from tests.conftest import mostly_at_night

LOOP = 0.25
QUICK = Options(mcmc=False, x_resolution_mm=0.0)
ANALYZE_KEYS = {
    "simulated", "duration_s", "rate_hz", "gaps", "cycles", "sensors", "system_sensitivity_mv_per_mm", "flags",
}  # fmt: skip
SENSOR_KEYS = {
    "name", "calibration", "posterior", "sensitivity_mv_per_mm", "hysteresis_percent_fso", "snr_db", "noise_mv",
    "fso_mv", "nonlinearity_percent_fso", "repeatability_percent_fso", "drift_percent_fso_per_100_cycles",
    "system_hysteresis_percent_fso",
}  # fmt: skip


def elongation_file(stairs: Staircase, folder: Path) -> Path:
    """The exact elongations of a staircase as a file."""
    path = folder / "elongation.csv"
    stairs.elongations().to_csv(path, index=False)
    return path


def true_hysteresis(cubic: tuple[float, ...]) -> tuple[float, float]:
    """Largest distance of the system's branches at the staircase's levels, % FSO, and the FSO."""
    plant = Plant(loop_mm=LOOP)
    curve = np.polynomial.Polynomial(cubic)
    fso = abs(curve(3.8) - curve(-2.7))
    p = np.arange(-40.0, 51.0, 10.0)
    apart = np.abs(curve(plant.elongation(p, np.asarray(True))) - curve(plant.elongation(p, np.asarray(False))))
    return 100 * apart.max() / fso, fso


@pytest.mark.parametrize(("sensors", "sign"), mostly_at_night((2, 1.0), (1, -1.0), (4, -1.0)))
def test_a_staircase_gives_the_plants_truth(tmp_path: Path, sensors: int, sign: float) -> None:
    """b0 within 1 mV, sensitivity within 1 %, R2 above 0.999, hysteresis within 0.5 % FSO, SNR within 0.5 dB."""
    cubics = tuple(tuple(sign * b for b in c) for c in (PAPER * 2)[:sensors])
    stairs = Staircase(Plant(cubics=cubics, noise_mv=(PAPER_NOISE * 2)[:sensors], loop_mm=LOOP))
    analysis = analyse(stairs.recording(), elongation_file(stairs, tmp_path), options=QUICK)
    assert analysis.cycles.as_json() == {"complete": 5, "partial": 0, "with_gap": 0}
    for sensor, cubic, noise in zip(analysis.sensors, cubics, stairs.plant.noise_mv, strict=True):
        hysteresis, fso = true_hysteresis(cubic)
        figures = sensor.figures
        assert sensor.calibration is not None
        assert sensor.calibration.coefficients[0] == pytest.approx(cubic[0], abs=1.0)
        assert sensor.calibration.r2 > 0.999
        assert figures["sensitivity_mv_per_mm"].value == pytest.approx(fso / 6.5, rel=0.01)
        assert figures["system_hysteresis_percent_fso"].value == pytest.approx(hysteresis, abs=0.5)
        assert figures["sensor_hysteresis_percent_fso"].value < 0.5
        assert figures["snr_db"].value == pytest.approx(20 * np.log10(fso / noise), abs=0.5)
        assert figures["fso_mv"].value == pytest.approx(fso, rel=0.01)


def test_continuous_cycles_give_the_systems_figures() -> None:
    """Hysteresis, SNR, span and drift of continuous cycles against the plant's closed form."""
    plant = Plant(loop_mm=LOOP, drift_mv_per_cycle=0.05)
    analysis = analyse(plant.run(*triangle(15, 20)))
    for sensor, cubic, noise in zip(analysis.sensors, PAPER, PAPER_NOISE, strict=True):
        hysteresis, fso = true_hysteresis(cubic)
        assert sensor.as_json()["hysteresis_percent_fso"]["abscissa"] == "pressure_kpa"
        assert sensor.figures["system_hysteresis_percent_fso"].value == pytest.approx(hysteresis, abs=0.3)
        assert sensor.figures["fso_mv"].value == pytest.approx(fso, rel=0.005)
        assert sensor.figures["snr_db"].value == pytest.approx(20 * np.log10(fso / noise), abs=0.2)
        drift = sensor.figures["drift_percent_fso_per_100_cycles"]
        assert drift.low <= 100 * 5.0 / fso <= drift.high
        assert sensor.calibration is None


def test_intervals_hold_the_truth_at_their_stated_rate() -> None:
    """The 95 % bootstrap interval of the sensitivity over 5 cycles covers the truth in 88 to 100 % of 60 runs."""
    truth = true_hysteresis(PAPER[0])[1] / 6.5
    x = Staircase().elongations()["elongation_mm"].to_numpy()
    from analysis.calibration.fit import fit_calibration
    from analysis.figures.curve_figures import resample_fit, sensitivities

    rng = np.random.default_rng(0)
    cycle = np.concatenate([[0], np.repeat(np.arange(5), 18)])
    hits = []
    for _ in range(60):
        y = np.polynomial.Polynomial(PAPER[0])(x) + rng.normal(0, 1.0, x.size) + rng.normal(0, 0.5, 5)[cycle]
        fit = fit_calibration(x, y)
        figure = sensitivities(resample_fit(fit, cycle, resampling_weights(5, rng, 500)))["sensitivity_mv_per_mm"]
        hits.append(figure.low <= truth <= figure.high)
    assert 0.88 <= np.mean(hits) <= 1.0


def test_the_object_of_the_surface_is_complete_and_plain(tmp_path: Path) -> None:
    """Every key of the contract is there, and the whole is JSON without NaN."""
    stairs = Staircase(Plant(cubics=PAPER[:1], noise_mv=PAPER_NOISE[:1]), cycles=2)
    options = Options(seed=1, x_resolution_mm=0.02)
    analysis = analyse(stairs.recording(), elongation_file(stairs, tmp_path), options=options)
    content = json.loads(json.dumps(finite(analysis.to_json()), allow_nan=False))
    assert set(content) >= ANALYZE_KEYS
    for sensor in content["sensors"]:
        assert set(sensor) >= SENSOR_KEYS
        assert set(sensor["posterior"]) >= {"coefficients", "sigma_mv", "tau", "n_eff", "acceptance", "converged"}
        assert set(sensor["calibration"]) >= {"degree", "n", "coefficients", "std_errors", "covariance", "r2", "rmse",
                                              "range", "turning_points", "monotone"}  # fmt: skip
        assert sensor["hysteresis_percent_fso"]["abscissa"] == "elongation_mm"
        assert len(sensor["hysteresis_percent_fso"]["per_cycle"]) == 2


@pytest.mark.fault(44, how="one run analysed twice with one seed", times=2)
def test_same_file_same_numbers(tmp_path: Path) -> None:
    """Fault 44: two analyses with one seed are equal to the last bit."""
    stairs = Staircase(cycles=2)
    file = elongation_file(stairs, tmp_path)
    first, second = (
        json.dumps(finite(analyse(stairs.recording(), file, seed=3, mcmc=False).to_json())) for _ in range(2)
    )
    assert first == second


@pytest.mark.fault(38, how="a run with one partial cycle", times=1)
def test_a_partial_run_is_still_reported() -> None:
    """Fault 38: no complete cycle, one partial; figures void with reasons, no exception."""
    stairs = Staircase()
    pressure, loading, cycle, _ = stairs.trace()
    analysis = analyse(stairs.plant.run(pressure[:3000], loading[:3000], cycle[:3000]))
    assert analysis.cycles.as_json() == {"complete": 0, "partial": 1, "with_gap": 0}
    assert all(f.void for f in analysis.sensors[0].figures.values() if np.isnan(f.value))
    assert "no_cycle" in {warning.code for warning in analysis.warnings}


@pytest.mark.fault(37, how="NaN and Inf in signal and pressure", times=1)
def test_values_that_are_no_numbers_are_masked_with_a_count(tmp_path: Path) -> None:
    """Fault 37: NaN and Inf in signal and pressure are counted and change the figures by nothing but their absence."""
    stairs = Staircase(Plant(loop_mm=LOOP))
    whole = stairs.recording()
    signal, pressure = whole.signal_mv.copy(), whole.pressure_kpa.copy()
    signal[1000:1010, 0], pressure[5000] = np.inf, np.nan

    analysis = analyse(
        Recording.from_arrays(whole.time_s, pressure, signal), elongation_file(stairs, tmp_path), options=QUICK
    )
    assert analysis.recording.masked["signal_not_finite"] == 10
    assert analysis.recording.masked["pressure_not_finite"] == 1
    assert analysis.sensors[0].calibration is not None
    assert analysis.sensors[0].calibration.coefficients[0] == pytest.approx(PAPER[0][0], abs=1.0)


def test_a_boat_file_gives_the_same_figures_and_keeps_the_result(tmp_path: Path) -> None:
    """The file decodes to the same run (counts of 1/16 mV), and stores one result for two equal analyses."""

    stairs = Staircase(Plant(loop_mm=LOOP), cycles=2)
    recording = stairs.recording()
    run = write_boat(tmp_path / "run é.boat", recording)
    loaded = load_recording(run)
    assert loaded.simulated
    assert np.abs(loaded.signal_mv - recording.signal_mv).max() <= 1 / 32 + 1e-9
    assert not loaded.signal_mv.flags.writeable
    for _ in range(2):
        assert store_analysis(run, analyse(run, elongation_file(stairs, tmp_path), options=QUICK)) == ""
    with closing(sqlite3.connect(run)) as db, db:
        assert db.execute("SELECT count(*), min(program_version) != '' FROM result").fetchone() == (1, 1)


def test_readings_of_the_session_calibrate_and_the_last_one_counts(tmp_path: Path) -> None:
    """Readings carry their step; a correction replaces the reading before it."""

    stairs = Staircase(Plant(loop_mm=LOOP), cycles=2)
    marks = marks_of(stairs)
    rows = [
        (int(i), int(n), int(k), b, float(t), round(s * 1e6), round(e * 1e6))
        for i, n, k, b, t, s, e in marks[
            ["id", "number", "cycle", "branch", "target_kpa", "started_s", "ended_s"]
        ].itertuples(index=False)
    ]
    run = write_boat(tmp_path / "run.boat", stairs.recording(), steps=rows)
    x = stairs.elongations()["elongation_mm"].round(1)
    with closing(sqlite3.connect(run)) as db, db:
        insert = "INSERT INTO reading (utc, step, elongation_mm, resolution_mm, source) VALUES ('', ?, ?, 0.1, 'test')"
        db.execute(insert, (5, 99.0))
        db.executemany(insert, [(int(i), float(v)) for i, v in zip(marks["id"], x, strict=True)])
    analysis = analyse(run, options=Options(mcmc=False))
    assert analysis.sensors[0].calibration is not None
    assert analysis.sensors[0].calibration.r2 > 0.999
    assert analysis.reading_sd_mm == pytest.approx(0.1 / 12**0.5)
    assert analysis.recording.target_kpa[np.isfinite(analysis.recording.target_kpa)].min() == -40.0
    assert "marks_disagree" not in {warning.code for warning in analysis.warnings}
