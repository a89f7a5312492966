"""The figures of a run against a plant whose truth is in closed form."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import numpy as np
import pytest

from analysis import AnalysisError, Options, Recording, analyse, fit_calibration, load_recording
from analysis.figures import sensor_figures as metrics
from analysis.figures.stored_results import finite, store_analysis
from analysis.statistics import resampling_weights
from tests.analysis.boat_builder import PAPER, PAPER_NOISE, Plant, Staircase, marks_of, triangle, write_boat

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


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("sensors", [1, 2, 4])
def test_a_staircase_gives_the_plants_truth(tmp_path: Path, sign: float, sensors: int) -> None:
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
    analysis = analyse(plant.run(*triangle(30, 20)))
    for sensor, cubic, noise in zip(analysis.sensors, PAPER, PAPER_NOISE, strict=True):
        hysteresis, fso = true_hysteresis(cubic)
        assert sensor.hysteresis_abscissa == "pressure_kpa"
        assert sensor.figures["system_hysteresis_percent_fso"].value == pytest.approx(hysteresis, abs=0.3)
        assert sensor.figures["fso_mv"].value == pytest.approx(fso, rel=0.005)
        assert sensor.figures["snr_db"].value == pytest.approx(20 * np.log10(fso / noise), abs=0.2)
        drift = sensor.figures["drift_percent_fso_per_100_cycles"]
        assert drift.low <= 100 * 5.0 / fso <= drift.high
        assert sensor.calibration is None


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """The 95 % bootstrap interval of the sensitivity over 5 cycles covers the truth in 88 to 100 % of 60 runs."""
    truth = true_hysteresis(PAPER[0])[1] / 6.5
    x = Staircase().elongations()["elongation_mm"].to_numpy()
    from analysis.calibration.fit import fit_calibration
    from analysis.figures.sensor_figures import resample_fit, sensitivities
    from analysis.statistics import resampling_weights

    rng = np.random.default_rng(0)
    cycle = np.concatenate([[0], np.repeat(np.arange(5), 18)])
    hits = []
    for _ in range(60):
        y = np.polynomial.Polynomial(PAPER[0])(x) + rng.normal(0, 1.0, x.size) + rng.normal(0, 0.5, 5)[cycle]
        fit = fit_calibration(x, y)
        figure = sensitivities(fit, resample_fit(fit, cycle, resampling_weights(5, rng, 500)))["sensitivity_mv_per_mm"]
        hits.append(figure.low <= truth <= figure.high)
    assert 0.88 <= np.mean(hits) <= 1.0


def test_the_object_of_the_surface_is_complete_and_plain(tmp_path: Path) -> None:
    """Every key of the contract is there, and the whole is JSON without NaN."""
    stairs = Staircase(cycles=2)
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
    from analysis import Recording

    analysis = analyse(
        Recording.from_arrays(whole.time_s, pressure, signal), elongation_file(stairs, tmp_path), options=QUICK
    )
    assert analysis.recording.masked["signal_not_finite"] == 10
    assert analysis.recording.masked["pressure_not_finite"] == 1
    assert analysis.sensors[0].calibration is not None
    assert analysis.sensors[0].calibration.coefficients[0] == pytest.approx(PAPER[0][0], abs=1.0)


@pytest.mark.fault(42, how="a signal without noise", times=2)
@pytest.mark.parametrize(("noise", "expected"), [((0.0, 0.0), np.inf), ((1.0, 1.0), 20 * np.log10(255.5837 / 1.0))])
def test_snr_of_no_noise_is_infinite_and_says_so(tmp_path: Path, noise: tuple[float, float], expected: float) -> None:
    """Fault 42: a noiseless signal gives inf with a reason."""
    stairs = Staircase(Plant(noise_mv=noise), cycles=2)
    figure = analyse(stairs.recording(), elongation_file(stairs, tmp_path), options=QUICK).sensors[0].figures["snr_db"]
    assert figure.value == pytest.approx(expected, abs=0.3)
    assert bool(figure.void) == np.isinf(expected)


@pytest.mark.fault(42, how="a signal without span", times=1)
def test_a_flat_signal_is_undefined_not_an_exception(tmp_path: Path) -> None:
    """Fault 42: zero span; every figure in % FSO is void."""
    stairs = Staircase(Plant(cubics=((1000.0,), (1000.0,)), noise_mv=(0.0, 0.0)), cycles=3)
    sensor = analyse(stairs.recording(), elongation_file(stairs, tmp_path), options=QUICK).sensors[0]
    assert np.isnan(sensor.figures["snr_db"].value)
    assert sensor.figures["system_hysteresis_percent_fso"].void == "the full-scale output is zero"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda f: f.iloc[:-3], "88 rows where the run has"),
        (lambda f: f.assign(pressure_kpa=f["pressure_kpa"].to_numpy()[::-1] + 7), "row 1 is at"),
        (lambda f: f.rename(columns={"elongation_mm": "x"}), "no column 'elongation_mm'"),
    ],
)
def test_an_elongation_file_that_does_not_fit_is_refused(tmp_path: Path, change, said: str) -> None:  # type: ignore[no-untyped-def]
    """The reason names the count, the first row, or the column."""
    stairs = Staircase()
    path = tmp_path / "wrong.csv"
    change(stairs.elongations()).to_csv(path, index=False)
    with pytest.raises(AnalysisError, match=said):
        analyse(stairs.recording(), path, options=QUICK)


def test_elongations_by_cycle_and_branch_match_those_by_order(tmp_path: Path) -> None:
    """The same readings, shuffled, with cycle and branch columns, give the same calibration."""
    stairs = Staircase(Plant(loop_mm=LOOP))
    frame = stairs.elongations()
    frame["cycle"] = [k for _, _, k in stairs.levels()]
    frame["branch"] = ["loading" if up else "unloading" for _, up, _ in stairs.levels()]
    path = tmp_path / "named.csv"
    frame.sample(frac=1.0, random_state=0).to_csv(path, index=False)
    named = analyse(stairs.recording(), path, options=QUICK)
    ordered = analyse(stairs.recording(), elongation_file(stairs, tmp_path), options=QUICK)
    a, b = named.sensors[0].calibration, ordered.sensors[0].calibration
    assert a is not None
    assert b is not None
    np.testing.assert_array_equal(a.coefficients, b.coefficients)


def test_a_boat_file_gives_the_same_figures_and_keeps_the_result(tmp_path: Path) -> None:
    """The file decodes to the same run (counts of 1/16 mV), and stores one result for two equal analyses."""
    import sqlite3

    stairs = Staircase(Plant(loop_mm=LOOP), cycles=2)
    recording = stairs.recording()
    run = write_boat(tmp_path / "run é.boat", recording)
    loaded = load_recording(run)
    assert loaded.simulated
    assert np.abs(loaded.signal_mv - recording.signal_mv).max() <= 1 / 32 + 1e-9
    assert not loaded.signal_mv.flags.writeable
    for _ in range(2):
        assert store_analysis(run, analyse(run, elongation_file(stairs, tmp_path), options=QUICK)) == ""
    with sqlite3.connect(run) as db:
        assert db.execute("SELECT count(*), min(program_version) != '' FROM result").fetchone() == (1, 1)


def test_readings_of_the_session_calibrate_and_the_last_one_counts(tmp_path: Path) -> None:
    """Readings carry their step; a correction replaces the reading before it."""
    import sqlite3

    stairs = Staircase(Plant(loop_mm=LOOP), cycles=2)
    marks = marks_of(stairs)
    rows = [
        (int(i), int(n), int(k), b, float(t), round(s * 1e6), round(e * 1e6))
        for i, n, k, b, t, s, e in marks[
            ["id", "number", "cycle", "branch", "target_kpa", "started_s", "ended_s"]
        ].itertuples(index=False)
    ]
    run = write_boat(tmp_path / "run.boat", stairs.recording(), steps=rows)
    x = stairs.elongations()["elongation_mm"]
    with sqlite3.connect(run) as db:
        insert = "INSERT INTO reading (utc, step, elongation_mm, resolution_mm, source) VALUES ('', ?, ?, 0.1, 'test')"
        db.execute(insert, (5, 99.0))
        db.executemany(insert, [(int(i), float(v)) for i, v in zip(marks["id"], x, strict=True)])
    analysis = analyse(run, options=Options(mcmc=False))
    assert analysis.sensors[0].calibration is not None
    assert analysis.sensors[0].calibration.r2 > 0.9999
    assert analysis.reading_sd_mm == pytest.approx(0.1 / 12**0.5)
    assert analysis.recording.target_kpa[np.isfinite(analysis.recording.target_kpa)].min() == -40.0
    assert "marks_disagree" not in {warning.code for warning in analysis.warnings}


def test_an_interval_of_a_spread_does_not_go_below_zero() -> None:
    """Three cycles: the interval of a standard deviation, a width or a span starts at zero at least."""
    plan = Staircase(Plant(loop_mm=0.25), cycles=3)
    for sensor in analyse(plan.recording(), mcmc=False).sensors:
        for figure in sensor.figures.values():
            if figure.unit in ("mV", "% FSO"):
                assert not figure.low < 0


def test_a_signal_that_stands_still_while_pressure_moves_is_flagged() -> None:
    """A CSV tells no saturation: a signal cut off at 1,650 mV is flagged with its share; a whole one is not."""
    run = Plant().run(*triangle(4, 20))
    cut = Recording.from_arrays(run.time_s, run.pressure_kpa, np.minimum(run.signal_mv, [1650.0, 9999.0]))
    said = [w.sentence for w in analyse(cut, mcmc=False).warnings if w.code == "flat"]
    assert len(said) == 1
    assert said[0].startswith("s1")
    assert not [w for w in analyse(run, mcmc=False).warnings if w.code == "flat"]


def test_the_reading_error_is_in_the_intervals_of_the_curve(tmp_path: Path) -> None:
    """Readings misread alike in every cycle: over 40 grids the sensitivity's interval holds the truth 36 times or more.

    The cycles agree with one another, so that without the reading error the interval would hold it hardly ever.
    """
    rng, inside = np.random.default_rng(5), []
    levels, truth = np.linspace(-2.7, 3.8, 10), np.polynomial.Polynomial(PAPER[0])
    weights = resampling_weights(5, rng, 500)
    for _ in range(40):
        read = levels + 0.1 * rng.standard_normal(10)
        x, cycle = np.tile(read, 5), np.repeat(np.arange(5.0), 10)
        fit = fit_calibration(x, truth(np.tile(levels, 5)) + 0.05 * rng.standard_normal(50))
        both = [metrics.resample_fit(fit.with_reading(sd), cycle, weights, rng) for sd in (0.0, 0.1)]
        figures = [metrics.sensitivities(fit, one)["sensitivity_mv_per_mm"] for one in both]
        low, high = fit.x_range
        inside.append([f.low <= (truth(high) - truth(low)) / (high - low) <= f.high for f in figures])
    without, with_reading = np.sum(np.asarray(inside), axis=0)
    assert with_reading >= 36
    assert without <= 8


@pytest.mark.parametrize("every", [1, 3])
def test_a_curved_sensor_without_a_loop_has_no_hysteresis(tmp_path: Path, every: int) -> None:
    """The actuator's loop sets the branches' points apart, so chords between them are off a cubic by up to 1 % FSO."""
    levels = np.arange(50, -41, -10)[::every]
    path = [*levels, *levels[::-1][1:]]
    loading = np.repeat(np.arange(len(path)) >= levels.size, 300)
    plant = Plant(noise_mv=(1e-6, 1e-6), loop_mm=LOOP, pressure_noise_kpa=0.0)
    pressure = np.repeat(np.asarray(path, float), 300)
    table = tmp_path / "elongation.csv"
    x = plant.elongation(np.asarray(path, float), np.arange(len(path)) >= levels.size)
    table.write_text("pressure_kpa,elongation_mm\n" + "\n".join(f"{p},{e:.9f}" for p, e in zip(path, x, strict=True)))
    analysis = analyse(plant.run(pressure, loading, np.ones(pressure.size)), table, options=QUICK)
    for sensor in analysis.sensors:
        assert sensor.figures["sensor_hysteresis_percent_fso"].value < 1e-3
        assert max(sensor.hysteresis_per_cycle) < 1e-3
        assert sensor.figures["system_hysteresis_percent_fso"].value > 3.0


def test_readings_on_a_millimetre_grid_widen_whatever_they_enter(tmp_path: Path) -> None:
    """The actuator's loop of 0.25 mm reads as 1 mm, the full scale 1 % too wide: the intervals hold the truth."""
    stairs = Staircase(Plant(loop_mm=LOOP, noise_mv=(0.2, 0.2)), cycles=3)
    table = stairs.elongations()
    table["elongation_mm"] = table["elongation_mm"].round()
    table.to_csv(tmp_path / "grid.csv", index=False)
    analysis = analyse(stairs.recording(), tmp_path / "grid.csv", options=Options(mcmc=False, x_resolution_mm=1.0))
    actuator = analysis.actuator_hysteresis
    assert actuator.value > 10
    assert actuator.low <= 100 * LOOP / 6.5 <= actuator.high
    assert "reading error of 0.29 mm" in actuator.note
    for sensor, cubic in zip(analysis.sensors, PAPER, strict=True):
        hysteresis, fso = true_hysteresis(cubic)
        for name, truth in (("snr_db", 20 * np.log10(fso / 0.2)), ("system_hysteresis_percent_fso", hysteresis)):
            figure = sensor.figures[name]
            assert figure.low <= truth <= figure.high
        assert sensor.figures["noise_mv"].high < 0.21
        assert sensor.figures["sensor_hysteresis_percent_fso"].low == 0.0


@pytest.mark.parametrize(("loop_mm", "own_mv", "grid_mm"), [(0.45, 0.0, 0.5), (0.45, 4.0, 0.5), (0.3, 14.0, 1.0)])
def test_a_grid_both_makes_and_hides_a_sensors_loop(
    tmp_path: Path, loop_mm: float, own_mv: float, grid_mm: float
) -> None:
    """Sensors whose own loop is known, read on a grid: the interval reaches up as well as down to the truth."""
    stairs = Staircase(Plant(loop_mm=loop_mm), cycles=5, dwell_s=1.2, ramp_kpa_per_s=40.0)
    pressure, loading, _, _ = stairs.trace()
    share = np.clip((pressure + 40.0) / 90.0, 0.0, 1.0)
    run = stairs.recording()
    own = np.where(loading, -1.0, 1.0) * 2.0 * share * (1.0 - share) * own_mv
    table = stairs.elongations()
    table["elongation_mm"] = (table["elongation_mm"] / grid_mm).round() * grid_mm
    table.to_csv(tmp_path / "grid.csv", index=False)
    recording = Recording.from_arrays(run.time_s, run.pressure_kpa, run.signal_mv + own[:, None])
    options = Options(mcmc=False, x_resolution_mm=grid_mm)
    for sensor, cubic in zip(analyse(recording, tmp_path / "grid.csv", options=options).sensors, PAPER, strict=True):
        figure = sensor.figures["sensor_hysteresis_percent_fso"]
        assert figure.low <= 100.0 * own_mv / true_hysteresis(cubic)[1] <= figure.high


def test_frames_that_failed_their_crc_are_counted_apart(tmp_path: Path) -> None:
    """The link's counter over two connections grows by 3 and by 2: five frames; 7 from before do not count."""
    path = write_boat(tmp_path / "a.boat", Staircase(cycles=1).recording())
    with sqlite3.connect(path) as db:
        for count in (7, 10, 0, 2):
            db.execute(
                "INSERT INTO health (host_ns, bytes, frames, samples, lost, crc_errors, malformed, oversize,"
                " duplicates, unknown) VALUES (0, 0, 0, 0, 0, ?, 0, 0, 0, 0)", (count,),
            )  # fmt: skip
    db.close()
    found = analyse(path, options=QUICK)
    assert found.to_json()["crc_errors"] == 5
    assert next(w.sentence for w in found.warnings if w.code == "crc_errors").startswith("5 frames")


def test_a_constant_signal_is_flagged_by_its_own_name(tmp_path: Path) -> None:
    """One value in all samples of one sensor: said with the value and the count, and of that sensor alone."""
    stairs = Staircase(cycles=1)
    run = stairs.recording()
    signal = run.signal_mv.copy()
    signal[:, 1] = 1650.0
    constant = Recording.from_arrays(run.time_s, run.pressure_kpa, signal)
    found = analyse(constant, elongation_file(stairs, tmp_path), options=QUICK)
    said = [w.sentence for w in found.warnings if w.code == "constant_signal"]
    assert len(said) == 1
    assert f"the signal is constant, 1650 mV in all {run.n} samples" in said[0]
    assert said[0].startswith(found.sensors[1].name)
    assert np.isfinite(found.sensors[0].figures["snr_db"].value)
    assert not np.isfinite(found.sensors[1].figures["snr_db"].value)
