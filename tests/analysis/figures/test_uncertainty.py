"""The GUM's worked examples, ISO 5725 and En by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal, stats
from scipy.optimize import brentq

from analysis import BoatDaqError, Options, Recording, analyse
from analysis.calibration.adequacy import expanded
from analysis.calibration.type_b import contributions
from analysis.calibration_export.run_record import elongation_reader
from analysis.figures.figure import Figure
from analysis.figures.uncertainty import (
    BudgetOfSensor,
    Component,
    SignalParts,
    combine,
    curve_candidates_of,
    elongation_budget,
    elongation_uncertainty,
    middle_budgets,
    signal_parts,
)
from analysis.numbers import finite
from tests.analysis.boat_builder import PAPER, Plant, Staircase


def test_end_gauge_of_gum_h1() -> None:
    """GUM H.1: u_c = 32 nm, 16 effective degrees of freedom, U_99 = 93 nm."""
    length_nm = 50_000_623.0
    budget = combine(
        [
            Component("standard", 25.0, 1.0, 18),
            Component("difference", 9.7, 1.0, 25.6),
            Component("expansion coefficient", 1.2e-6, 0.0),
            Component("temperature", 0.41, 0.0),
            Component("difference of coefficients", 0.58e-6, -length_nm * 0.1, 50),
            Component("difference of temperatures", 0.029, -length_nm * 11.5e-6, 2),
        ]
    )
    assert round(budget.u) == 32
    assert int(budget.dof) == 16
    assert round(stats.t.ppf(0.995, int(budget.dof)) * budget.u) == 93
    assert budget.coverage == pytest.approx(0.937, abs=0.001)  # t for 16.7: 2 is not quite 95 %


def test_shares_add_up_and_name_what_halves() -> None:
    """Shares are of the variance; three quarters in one component halve the uncertainty without it."""
    budget = combine([Component("a", 2.0), Component("b", 1.0), Component("c", 0.5)])
    assert sum(budget.shares().values()) == pytest.approx(1.0)
    assert list(budget.shares()) == ["a", "b", "c"]
    assert "without a" in budget.what_halves_it()
    assert "no component halves" in combine([Component("a", 1.0), Component("b", 1.0)]).what_halves_it()


def test_stated_interval_of_an_elongation_holds_the_truth(tmp_path: Path) -> None:
    """Over the samples of 3 runs with known x, x +- U (k = 2) holds the truth 93 to 97.5 % of the time."""
    inside, count = 0, 0
    for seed in range(3):
        stairs = Staircase(Plant(seed=seed, loop_mm=0.25))
        path = tmp_path / f"{seed}.csv"
        stairs.elongations().to_csv(path, index=False)
        recording = stairs.recording()
        analysis = analyse(recording, path, options=Options(mcmc=False, x_resolution_mm=0.0))
        pressure, loading, _, _ = stairs.trace()
        truth = stairs.plant.elongation(pressure, loading)
        found = elongation_reader(analysis).evaluate(recording.signal_mv)
        # away from the ends, where noise pushes signals out of the range and only the inner half has a value
        known = np.isfinite(found.elongation_mm) & (truth > -2.4) & (truth < 3.4)
        apart = np.abs(found.elongation_mm - truth)[known]
        inside += int((apart <= 2 * found.standard_uncertainty_mm[known]).sum())
        count += int(known.sum())
    assert 0.93 <= inside / count <= 0.975


@pytest.mark.fault(23, how="what is left of ambient light, as a component of the budget", times=1)
def test_every_component_is_named_and_sourced(tmp_path: Path) -> None:
    """The budget lists ten components and the four of the reference, each with its source.

    On a grid the reading is the largest; what was not assessed has no value.
    """
    stairs = Staircase(Plant(loop_mm=0.25))
    frame = stairs.elongations()
    frame["elongation_mm"] = (frame["elongation_mm"] * 2).round() / 2
    frame.to_csv(tmp_path / "grid.csv", index=False)
    analysis = analyse(stairs.recording(), tmp_path / "grid.csv", options=Options(mcmc=False))
    budget = elongation_budget(analysis, 0.5)[0]
    assert {c.name for c in budget.components} == {
        "reading", "noise", "repeatability", "reproducibility", "hysteresis", "zero drift", "settling", "resolution",
        "ambient residual", "fit", "lack of fit", "scale of grid or photograph", "parallax", "pressure gauge",
        "temperature",
    }  # fmt: skip
    assert all(c.source for c in budget.components)
    absent = {c.name for c in budget.components if not c.assessed}
    assert absent == {
        "reproducibility", "resolution", "ambient residual", "scale of grid or photograph", "parallax",
        "pressure gauge", "temperature",
    }  # fmt: skip
    assert all(c.source.startswith("not assessed: ") for c in budget.components if not c.assessed)
    assert {c["u_mm"] for c in finite(budget.as_json())["components"] if not c["assessed"]} == {None}
    assert next(iter(budget.shares())) == "reading"


def test_spread_between_runs_enters_the_budget(tmp_path: Path) -> None:
    """Three calibrations with other b0: the budget's reproducibility is the sd of y(x) over the slope, less the fit's.

    With one run it is not assessed.
    """
    offsets, runs = (3.0, -2.0, 1.0), []
    for seed, offset in enumerate(offsets):
        cubics = tuple((c[0] + offset, *c[1:]) for c in PAPER)
        stairs = Staircase(Plant(cubics=cubics, loop_mm=0.1, seed=seed), cycles=2)
        stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
        runs.append(analyse(stairs.recording(), tmp_path / "e.csv", mcmc=False))
    alone, among = (elongation_budget(runs[0], 0.5, runs=part)[0] for part in ((), runs))
    assert not next(c for c in alone.components if c.name == "reproducibility").assessed
    found = next(c for c in among.components if c.name == "reproducibility")
    assert found.source == "between 3 runs, less fit"
    slope = float(np.polynomial.Polynomial(PAPER[0]).deriv()(0.5))
    assert found.contribution == pytest.approx(np.std(offsets, ddof=1) / slope, rel=0.05)
    assert found.dof == 2
    assert among.u > alone.u


def test_stated_contributions_are_in_the_budget_and_in_the_live_uncertainty(tmp_path: Path) -> None:
    """A scale of 1 % of x (k = 2) and a parallax of 0.2 mm: root sum of squares, in the budget and live, fused or not.

    Both sensors share the reference: fusing them reduces their noise and not this part.
    """
    given = contributions({
        "scale": {"expanded_percent": 1.0, "k": 2, "dof": 8},
        "parallax": {"half_width_mm": 0.2, "distribution": "rectangular"},
    })  # fmt: skip
    stairs = Staircase(Plant(loop_mm=0.1), cycles=2)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    bare, stated = (
        analyse(stairs.recording(), tmp_path / "e.csv", options=Options(mcmc=False, type_b=type_b))
        for type_b in ((), given)
    )
    x = 3.0
    by_reference = np.hypot(0.005 * x, 0.2 / np.sqrt(3))
    before, after = (elongation_budget(analysis, x)[0] for analysis in (bare, stated))
    assert after.u == pytest.approx(np.hypot(before.u, by_reference), rel=1e-9)
    small = before.u**4 / before.dof + (0.005 * x) ** 4 / 8
    assert after.dof == pytest.approx(after.u**4 / small)
    signal = np.asarray([float(s.calibration.predict(x)) for s in bare.sensors])
    for reader in (elongation_reader, lambda analysis: elongation_reader(analysis).inverses[0]):
        alone, among = (reader(a).evaluate(signal[: len(getattr(reader(a), "inverses", [0]))]) for a in (bare, stated))
        both = np.hypot(alone.standard_uncertainty_mm, by_reference)
        np.testing.assert_allclose(among.standard_uncertainty_mm, both, rtol=1e-3)


def test_budget_states_whether_it_is_traceable(tmp_path: Path) -> None:
    """Nothing stated: not traceable, and what is missing; everything stated with a certificate: traceable to it."""
    stairs = Staircase(cycles=1)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    analysis = analyse(stairs.recording(), tmp_path / "e.csv", options=Options(mcmc=False))
    missing = elongation_budget(analysis, 0.5)[0].traceability.missing
    assert missing[:2] == ("scale of grid or photograph", "parallax")
    given = contributions({
        "scale": {"u_percent": 0.1, "certificate": "DKD 4711"},
        "parallax": {"u_mm": 0.05},
        "pressure_gauge": {"u_kpa": 0.2, "sensitivity_mm_per_kpa": 0.07},
        "temperature": {"u_k": 1.0, "sensitivity_mm_per_k": 0.0},
    })  # fmt: skip
    stated = elongation_budget(replace(analysis, options=replace(analysis.options, type_b=given)), 0.5)[0]
    assert stated.as_json()["traceable"] is True
    assert stated.as_json()["traceability"] == "traceable to DKD 4711"
    zero = next(c for c in stated.components if c.name == "temperature")
    assert zero.assessed
    assert zero.contribution == 0.0


def test_candidate_is_what_the_run_analysed_by_it_gives(tmp_path: Path) -> None:
    """Verdict and U of another curve are those of an analysis with it; the chosen one's those of the budget.

    The truth is a monotone cubic whose best parabola turns inside the range: that one gives no U.
    """
    stairs = Staircase(Plant(cubics=((1650.0, 40.0, -8.0, 0.6),), noise_mv=(1.0,), loop_mm=0.1), cycles=2)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    chosen, other = (
        analyse(stairs.recording(), tmp_path / "e.csv", options=Options(degree, mcmc=False)) for degree in (3, 5)
    )
    assert chosen.budgets is not None
    found = {one.name: one for one in curve_candidates_of(chosen, 0, chosen.budgets.x_mm)}
    assert list(found) == ["1", "2", "3", "4", "5", "6", "spline"]
    for analysis, name in ((chosen, "3"), (other, "5")):
        calibration, budget = analysis.sensors[0].calibration, elongation_budget(analysis, chosen.budgets.x_mm)[0]
        assert found[name].verdict == calibration.adequacy.verdict
        assert found[name].expanded_mm == pytest.approx(budget.expanded, rel=1e-9)
    assert found["1"].verdict != found["3"].verdict == "adequate"
    assert np.isnan(found["2"].expanded_mm)
    assert "it turns at" in found["2"].void
    assert found["3"].prediction_rms_mv < 0.2 * found["1"].prediction_rms_mv


@pytest.mark.parametrize("leak", [0.0, 0.1])
def test_ambient_residual_is_what_the_subtraction_leaves(tmp_path: Path, leak: float) -> None:
    """Slow light of 40 counts sd on dark; `leak` of it stays in the signal: 0 or 4 counts, whatever dark's own noise.

    Light that the subtraction takes out whole is no residual, however strong it is.
    """
    stairs = Staircase(Plant(noise_mv=(1.0, 1.0)), cycles=1)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    run = stairs.recording()
    rng = np.random.default_rng(3)
    light = 40.0 * (1 - 0.8**2) ** 0.5 * signal.lfilter([1.0], [1.0, -0.8], rng.standard_normal((run.n, 2)), axis=0)
    scale = 4096.0 / 2.0**16
    dark = np.round(500.0 + light + 3.0 * rng.standard_normal(light.shape))
    lit = np.round(run.signal_mv / scale + 500.0 + (1.0 + leak) * light)
    counted = Recording.from_arrays(
        run.time_s, run.pressure_kpa, (lit - dark) * scale, lit=lit, dark=dark, meta={"vref_mv": 4096, "adc_bits": 16}
    )
    found = signal_parts(analyse(counted, tmp_path / "e.csv", options=Options(mcmc=False)), 0)
    assert found.ambient == pytest.approx(leak * 40.0 * scale, rel=0.2)
    assert found.noise == pytest.approx(np.hypot(1.0, 3.0 * scale), rel=0.1)


def test_a_curve_that_turns_gives_u_on_either_side_of_the_turn(tmp_path: Path) -> None:
    """A cubic that turns at 2.5 mm inside its range: U to both sides, growing towards it, none within U, the reason.

    The straight sensor beside it has U everywhere; the budget in the middle and the live reading are refused.
    """
    turning, straight = (1650.0, 50.0, -2.0, -40.0 / 18.75), (1650.0, 40.0, 0.0, 0.0)
    stairs = Staircase(Plant(cubics=(turning, straight), noise_mv=(1.0, 1.0), loop_mm=0.1), cycles=2)
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    analysis = analyse(stairs.recording(), tmp_path / "e.csv", options=Options(mcmc=False, x_resolution_mm=0.0))
    (of_turning, why), (of_straight, none) = zip(analysis.u_elongation, analysis.u_reason, strict=True)
    assert "turns at 2.5 mm" in why
    assert none == ""
    assert np.isfinite(of_straight).all()
    x, u = of_turning.T
    away = np.abs(x - 2.5)
    assert (away[np.isfinite(u)] > u[np.isfinite(u)]).all()
    assert np.isnan(u[away.argmin()])
    assert np.isfinite(u[[0, -1]]).all()
    below = u[(x < 2.0) & (x > 0.0)]
    assert (np.diff(below) > 0).all()
    assert analysis.budgets is not None
    assert "turns at" in analysis.budgets.void
    with pytest.raises(BoatDaqError, match=r"turns at 2\.5"):
        elongation_reader(analysis)


def loops_of(values: np.ndarray) -> SimpleNamespace:
    """Return the loops of one sensor, of values [cycles, places]."""
    cycles, places = values.shape
    signal = values.reshape(cycles, 2, places // 2).transpose(1, 0, 2)[None]
    return SimpleNamespace(n_cycles=cycles, own=np.ones(signal.shape[1:], dtype=bool), signal_mv=signal)


def a_run(**sensor: object) -> SimpleNamespace:
    """Return what the budget needs of a run: 4 cycles of 19 levels, a converter of 12 bits, 1,234 samples."""
    percent = {"repeatability_percent_fso": 0.5, "drift_percent_fso_per_100_cycles": -2.0}
    figures = {"fso_mv": Figure(250.0, "mV", 4), "noise_mv": Figure(1.5, "mV", 4)}
    figures |= {key: Figure(value, "% FSO", 4) for key, value in percent.items()}
    parts = {"calibration": None, "sensor_loop": None, "joint_loop": None, "figures": figures}
    parts |= {"settling": SimpleNamespace(u_mv=0.0), "point_plateau": np.empty(0), **sensor}
    return SimpleNamespace(
        sensors=[SimpleNamespace(**parts)],
        loops=loops_of(np.zeros((4, 36))),
        recording=SimpleNamespace(n=1234, lit=np.ones(1), dark=None, meta={"vref_mv": 3300, "adc_bits": 12}),
        plateaus=[SimpleNamespace(signal_se_mv=(se,)) for se in (0.1, 0.2, 0.9)],
        reading_sd_mm=0.1,
        options=SimpleNamespace(type_b=()),
    )


def test_signal_parts_by_hand() -> None:
    """Each part in mV, without what the others hold: GUM 4.3.7 for the steps of the converter and for a ramp."""
    step = 3300.0 / 4096.0
    resolution = step * np.sqrt(1.0 / 12.0 + 1.0 / 12.0)  # lit and dark
    drift = 0.02 * 250.0 / 100.0 * 4 / np.sqrt(12.0)
    parts = signal_parts(a_run(), 0)
    assert parts.resolution == pytest.approx(resolution)
    assert parts.noise == pytest.approx(np.sqrt(1.5**2 - resolution**2))
    assert parts.drift == pytest.approx(drift)
    assert parts.repeatability == pytest.approx(np.sqrt(1.25**2 - drift**2 - 0.2**2))
    assert (parts.noise_dof, parts.repeatability_dof) == (123.0, 3 * 35)
    assert parts.ambient == 0.0
    assert parts.independent == pytest.approx(1.5)
    assert parts.between_cycles == pytest.approx(np.sqrt(1.25**2 - 0.2**2))
    continuous = a_run()
    continuous.plateaus = []
    assert signal_parts(continuous, 0).repeatability == pytest.approx(np.sqrt(1.25**2 - drift**2))


@pytest.mark.parametrize("lacks", ["lit", "vref_mv", "adc_bits"])
def test_without_counts_there_is_no_resolution(lacks: str) -> None:
    """A recording of signals, or one that lacks its converter's data."""
    run = a_run()
    if lacks == "lit":
        run.recording.lit = None
    else:
        run.recording.meta[lacks] = None
    assert signal_parts(run, 0).resolution == 0.0


def test_run_of_one_cycle_and_level_has_degrees_of_freedom() -> None:
    """One at least, and figures that are not known are not known: no zeros, and why there is no U."""
    run = a_run()
    run.loops, run.recording.n, run.plateaus = loops_of(np.zeros((1, 2))), 5, []
    run.sensors[0].figures = {
        key: one if key == "fso_mv" else replace(one, value=np.nan) for key, one in run.sensors[0].figures.items()
    }
    parts = signal_parts(run, 0)
    assert (parts.noise_dof, parts.repeatability_dof) == (1.0, 1.0)
    np.testing.assert_array_equal((parts.noise, parts.repeatability, parts.drift), np.full(3, np.nan))
    assert parts.void == "one cycle gives no uncertainty: run two or more"


def test_half_the_loop_keeps_its_course_over_x() -> None:
    """Less what readings make: half the difference of two of 0.1 mm on 30 mV/mm has the sd 0.1 * 30 / sqrt(2)."""
    loop = SimpleNamespace(
        void="", loading=np.array([8.0, 10.0, 14.0]), unloading=np.array([0.0, 0.0, 2.0]), grid=np.arange(3.0)
    )
    curve = SimpleNamespace(slope=lambda x: np.full(np.shape(x), -30.0), x_range=(0.0, 2.0))
    found = signal_parts(a_run(calibration=curve, sensor_loop=loop), 0)
    by_reading = 0.1**2 * 30.0**2 / 2.0
    assert found.half_loop[[0, 20, 40]] == pytest.approx(np.sqrt(np.array([4.0, 5.0, 6.0]) ** 2 - by_reading))
    assert found.half_loop.size == 41
    assert found.shared == pytest.approx(np.sqrt(found.between_cycles**2 + np.mean(found.half_loop**2)))
    assert np.isnan(signal_parts(a_run(calibration=None, sensor_loop=loop), 0).half_loop).all()
    run = a_run(calibration=curve, sensor_loop=loop)
    run.reading_sd_mm = 5.0
    assert signal_parts(run, 0).half_loop.tolist() == [0.0]
    loop.void = "no overlap"
    unknown = signal_parts(a_run(calibration=curve, sensor_loop=loop), 0)
    assert np.isnan(unknown.half_loop).all()
    assert unknown.void == "the loop of the sensor is not known: no overlap"


def test_loop_no_wider_than_its_error_has_its_rms_everywhere() -> None:
    """Twice its error is a known course; less is not, and a loop narrower than its error is none."""
    joint = SimpleNamespace(
        ends=(-1.0, 3.0), loop_width=lambda x: 10.0 + 0.0 * x, loop_width_u=lambda x: 4.9 * np.ones_like(x)
    )
    fitted = {"joint_loop": joint, "calibration": SimpleNamespace(), "sensor_loop": SimpleNamespace(void="")}
    course = signal_parts(a_run(**fitted), 0).half_loop
    assert course == pytest.approx(np.full(41, 0.5 * np.sqrt(100.0 - 4.9**2)))
    joint.loop_width_u = lambda x: 6.0 * np.ones_like(x)
    assert signal_parts(a_run(**fitted), 0).half_loop == pytest.approx([4.0])
    joint.loop_width_u = lambda x: 11.0 * np.ones_like(x)
    assert signal_parts(a_run(**fitted), 0).half_loop.tolist() == [0.0]


def test_ambient_light_is_found_through_the_noise_of_the_dark_readings() -> None:
    """Light of 20 counts sd, of which 3 % is left in the signal: 0.6 mV, and none where there is no light."""
    rng = np.random.default_rng(7)
    light = 20.0 * np.cumsum(rng.standard_normal(40_000)) / 60.0
    light -= np.interp(np.arange(light.size), np.arange(0, light.size, 100), light[::100])
    light *= 20.0 / light.std()
    for left, light_sd in ((0.03, 20.0), (0.0, 20.0), (0.03, 0.0)):
        run = a_run()
        dark = 200.0 + light * (light_sd / 20.0) + 5.0 * rng.standard_normal(light.size)
        noise = 0.5 * rng.standard_normal(light.size) - 0.01 * (dark - dark.mean())
        signal = 1500.0 + left * light * (light_sd / 20.0) + noise * (light_sd > 0)
        run.recording.dark, run.recording.signal_mv = dark[:, None], signal[:, None]
        run.recording.usable = np.ones((light.size, 1), bool)
        run.plateaus = [
            SimpleNamespace(settled_first=at, last=at + 399, damaged=("",), signal_se_mv=(0.1,))
            for at in range(0, light.size, 400)
        ]
        found = signal_parts(run, 0).ambient
        assert found == pytest.approx(abs(left - 0.01) * 20.0 if light_sd else 0.0, abs=0.08)


def lit_run(dark: np.ndarray, signal: np.ndarray, *plateaus: tuple[int, int, str]) -> SimpleNamespace:
    """Return a run with dark readings and plateaus: first and last row, and whether it is damaged."""
    run = a_run()
    run.recording.dark, run.recording.signal_mv = dark[:, None], signal[:, None]
    run.recording.usable = np.isfinite(signal)[:, None]
    run.plateaus = [
        SimpleNamespace(settled_first=first, last=last, damaged=(damaged,), signal_se_mv=(0.1,))
        for first, last, damaged in plateaus
    ]
    return run


def test_ambient_light_by_its_formula() -> None:
    """cov(y_t, d_t+1) over the root of cov(d_t, d_t+1), of the plateaus that are whole, each about its own mean."""
    wave, half = 10.0 * np.sin(np.arange(200) / 15.0), 100
    dark, signal = 300.0 + wave, 1500.0 + 0.3 * wave + 0.2 * np.cos(np.arange(200) / 15.0)
    signal[half:] += 7.0
    parts = [
        (dark[rows] - dark[rows].mean(), signal[rows] - signal[rows].mean()) for rows in (slice(half), slice(half, 200))
    ]
    with_light, of_light = (sum(float(p[k][:-1] @ p[0][1:]) for p in parts) / 200 for k in (1, 0))
    run = lit_run(dark, signal, (0, 99, ""), (100, 199, ""))
    assert signal_parts(run, 0).ambient == pytest.approx(with_light / np.sqrt(of_light))
    wild = np.concatenate([signal, 1e4 * np.sin(np.arange(60.0)), [1.0, 2.0, 5.0]])
    more = np.concatenate([dark, np.cos(np.arange(60.0)), [1.0, 9.0, 2.0]])
    also = lit_run(more, wild, (200, 259, "gap"), (260, 262, ""), (0, 99, ""), (100, 199, ""))
    assert signal_parts(also, 0).ambient == pytest.approx(with_light / np.sqrt(of_light))
    assert signal_parts(lit_run(dark, signal), 0).ambient == 0.0
    assert signal_parts(lit_run(0.0 * dark + 300.0, signal, (0, 199, "")), 0).ambient == 0.0


@pytest.mark.parametrize(("light", "leak", "found"), [(3.3, 3.3, True), (2.7, 4.5, False), (9.0, 2.7, False)])
def test_ambient_light_begins_at_three_times_its_scatter(light: float, leak: float, found: bool) -> None:
    """Covariances of 400 samples, `light` and `leak` times the scatter that unrelated samples would have."""
    n, rng = 400, np.random.default_rng(2)
    pairs = rng.standard_normal((2, n))

    def ratios(share: float, part: float) -> tuple[float, float]:
        """Covariances over their scatter, of dark and of signal, with so much light in each."""
        dark, signal = series(share, part)
        d, y = dark - dark.mean(), signal - signal.mean()
        return (
            abs(d[:-1] @ d[1:]) / (d @ d) * np.sqrt(n), abs(y[:-1] @ d[1:]) / np.sqrt((y @ y) * (d @ d)) * np.sqrt(n),
        )  # fmt: skip

    def series(share: float, part: float) -> tuple[np.ndarray, np.ndarray]:
        wave = np.sin(np.arange(n) / 9.0)
        return 300.0 + pairs[0] + share * wave, 1500.0 + pairs[1] + part * wave

    share = brentq(lambda s: ratios(s, 0.0)[0] - light, 0.05, 9.0)
    part = brentq(lambda p: ratios(share, p)[1] - leak, 0.02, 90.0)
    dark, signal = series(share, part)
    assert (signal_parts(lit_run(dark, signal, (0, n - 1, "")), 0).ambient > 0.0) is found


@pytest.mark.parametrize(("expanded_mm", "known"), [(0.25, 41 - 5), (9.0, 0)])
def test_u_is_not_given_within_u_of_a_turn(monkeypatch: pytest.MonkeyPatch, expanded_mm: float, known: int) -> None:
    """41 points, 0.125 mm apart, about a turn at 0.5 mm: five are within 0.25 mm of it, the borders too."""
    curve = SimpleNamespace(
        x_range=(-2.0, 3.0), turns_inside=(0.5,), monotone=False, adequacy=None, slope=lambda x: np.ones(np.shape(x))
    )
    parts = SimpleNamespace(void="", stand_in="")
    stub = SimpleNamespace(calibration=curve, parts=parts, at=lambda _: SimpleNamespace(expanded=expanded_mm))
    monkeypatch.setattr(BudgetOfSensor, "of", lambda *_: stub)
    table, reason = elongation_uncertainty(SimpleNamespace(), 0)
    assert table.shape == ((41, 2) if known else (0, 2))
    assert np.isfinite(table[:, 1]).sum() == known
    assert reason.startswith("the curve turns at 0.5 mm")


def test_sensor_without_a_calibration_has_no_u() -> None:
    """No points, and the reason."""
    table, reason = elongation_uncertainty(a_run(name="s1", calibration_void="no readings"), 0)
    assert (table.shape, reason) == ((0, 2), "s1 is not calibrated: no readings")


def test_middle_budget_is_of_the_middle_of_the_range(monkeypatch: pytest.MonkeyPatch) -> None:
    """-2 to 6 mm: 2 mm."""
    monkeypatch.setattr("analysis.figures.uncertainty.elongation_budget", lambda *_, **__: ())
    middle = middle_budgets(a_run(calibration=SimpleNamespace(x_range=(-2.0, 6.0))))
    assert middle is not None and middle.x_mm == 2.0
    assert middle_budgets(a_run()) is None


@pytest.mark.parametrize(("dof", "inside"), [(np.inf, 0.954500), (1.0, 0.704833), (2.0, 2.0 / 6.0**0.5)])
def test_coverage_of_twice_u_by_the_degrees_of_freedom(dof: float, inside: float) -> None:
    """The normal's 95.45 %; Student's with 1 and 2 in closed form: 2/pi arctan 2, and 2 / sqrt(2 + 4)."""
    budget = combine([Component("a", 3.0, -0.5, dof)])
    assert (budget.u, budget.expanded) == (1.5, 3.0)
    assert budget.coverage == pytest.approx(inside, abs=1e-6)


def test_a_budget_of_nothing_has_no_shares() -> None:
    """All components zero: shares of zero; three quarters exactly halve."""
    assert combine([Component("a", 0.0)]).shares() == {"a": 0.0}
    assert "without a (75 % of" in combine([Component("a", 3.0**0.5), Component("b", 1.0)]).what_halves_it()


PARTS = SignalParts(1.0, 4.0, 8.0, 2.0, 3.0, np.array([0.0, 6.0, 12.0]), noise_dof=50.0, repeatability_dof=18.0)


def test_parts_add_in_squares() -> None:
    """1, 4, 8 from sample to sample make 9; 2, 3 from cycle to cycle and a loop of 6 that the curve leaves out, 7."""
    parts = replace(PARTS, half_loop=np.array([6.0]))
    assert (parts.independent, parts.between_cycles, parts.shared) == (9.0, pytest.approx(13.0**0.5), 7.0)


@pytest.mark.parametrize("away_mm", [0.0, 0.6])
def test_budget_at_an_elongation_by_hand(away_mm: float) -> None:
    """Each part over 25 mV/mm; loop and deviation of the curve bring U to what covers them, GUM F.2.4.5."""
    adequacy = SimpleNamespace(deviation_in_x=lambda _: away_mm, verdict="doubtful")
    curve = SimpleNamespace(
        slope=lambda _: -25.0, curve_parts=lambda _: (0.5, 0.25), joint=SimpleNamespace(effective_dof=7.0), dof=3.0,
        adequacy=adequacy, x_range=(0.0, 2.0),
    )  # fmt: skip
    budget = BudgetOfSensor(curve, (), PARTS, (), 4, counted=True).at(1.0)
    mm = {one.name: one.contribution for one in budget.components if one.assessed}
    of_signal = {
        "reading": 0.25, "noise": 1.0, "repeatability": 2.0, "zero drift": 3.0, "resolution": 4.0,
        "ambient residual": 8.0, "fit": 0.5,
    }  # fmt: skip
    assert {name: mm[name] for name in of_signal} == pytest.approx({name: mv / 25.0 for name, mv in of_signal.items()})
    u = np.sqrt(sum(mv**2 for mv in of_signal.values())) / 25.0
    with_loop = float(expanded(0.0, u, half_loop=6.0 / 25.0))
    assert mm["hysteresis"] == pytest.approx(np.sqrt((0.5 * with_loop) ** 2 - u**2))
    assert budget.expanded == pytest.approx(float(expanded(away_mm, u, half_loop=6.0 / 25.0)))
    dof = {one.name: one.dof for one in budget.components}
    assert (dof["noise"], dof["repeatability"], dof["fit"], dof["reading"]) == (50.0, 18.0, 7.0, np.inf)
    lines = {one.name: one.source for one in budget.components}
    assert lines["lack of fit"] == f"curve doubtful, {1000 * away_mm:.0f} µm off the preferred one"
    assert (lines["repeatability"], lines["zero drift"]) == ("4 cycles", "drift over 4 cycles")
    curve.joint = curve.adequacy = None
    plain = BudgetOfSensor(curve, (), PARTS, (), 4, counted=False).at(1.0)
    found = {one.name: one for one in plain.components}
    assert found["fit"].dof == 3.0
    assert not (found["lack of fit"].assessed or found["resolution"].assessed or found["ambient residual"].assessed)


def test_one_run_alone_tells_nothing_of_the_spread_between_runs() -> None:
    """Two runs do, and a run without that sensor, or without its calibration, is left out."""
    curve = SimpleNamespace()
    run = a_run(calibration=curve)
    run.options = SimpleNamespace(type_b=())
    bare = SimpleNamespace(sensors=[])
    for runs, count in (((), 0), ((run,), 0), ((run, run), 2), ((run, bare), 1), ((run, a_run()), 1)):
        assert len(BudgetOfSensor.of(run, 0, runs).calibrations) == count
    assert BudgetOfSensor.of(run, 0).counted
    with pytest.raises(BoatDaqError, match="is not calibrated"):
        BudgetOfSensor.of(a_run(name="s1", calibration_void="no readings"), 0)
