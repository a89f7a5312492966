"""A drift is used, cycles that depend on one another are noticed, and noise may grow over the range."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis import Options, Recording, analyse
from analysis.calibration.record import CalibrationRecord
from analysis.calibration_export.run_record import calibration_record
from analysis.figures.cycle_figures import drift, repeatability
from analysis.figures.figure import Reason
from analysis.numbers import finite
from analysis.segmentation.cycle_effect import CycleEffect
from analysis.segmentation.loops import Loops
from analysis.segmentation.serial_correlation import RANDOM_WALK, Dependence
from analysis.warning import WarningCode
from tests.analysis.boat_builder import PAPER, Plant, Staircase, triangle
from tests.conftest import mostly_at_night

SYSTEM = "system_hysteresis_percent_fso"
QUICK = Options(mcmc=False, fidelity="draft", x_resolution_mm=0.02)
LEVELS = np.arange(-40.0, 51.0, 10.0)


def system_truth(plant: Plant, levels: np.ndarray = LEVELS) -> float:
    """Return the loop of signal over pressure without drift and noise, % FSO."""
    cubic = np.polynomial.Polynomial(plant.cubics[0])
    down, up = (cubic(plant.elongation(levels, np.full(levels.size, way))) for way in (False, True))
    return 100.0 * float(np.abs(up - down).max() / abs(cubic(3.8) - cubic(-2.7)))


def drifting(recording: Recording, mv_per_s: float) -> Recording:
    """Return a recording with a drift of all signals."""
    signal = recording.signal_mv + mv_per_s * recording.time_s[:, None]
    return Recording.from_arrays(recording.time_s, recording.pressure_kpa, signal)


@pytest.mark.parametrize("total_mv", mostly_at_night(-15.0, 0.0, 5.0))
def test_a_drift_is_no_loop(tmp_path: Path, total_mv: float) -> None:
    """The loop of a staircase is that without its drift; drift and repeatability keep it."""
    stairs = Staircase(Plant(loop_mm=0.25, seed=3))
    run = stairs.recording()
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    analysis = analyse(drifting(run, total_mv / run.time_s[-1]), tmp_path / "e.csv", options=QUICK)
    sensor = analysis.sensors[0]
    assert any(w.code is WarningCode.DRIFT and w.subject == "s1" for w in analysis.warnings) == (total_mv != 0.0)
    found, per_cycles = sensor.figures[SYSTEM], sensor.figures["drift_percent_fso_per_100_cycles"]
    assert found.low <= system_truth(stairs.plant) <= found.high
    assert found.high - found.low < 0.5
    assert sensor.figures["sensor_hysteresis_percent_fso"].low < 0.2
    assert per_cycles.value == pytest.approx(100.0 * total_mv / 5.0 / 2.556, abs=5.0)


@pytest.mark.parametrize("cubic", [PAPER[0], tuple(-b for b in PAPER[1])])
def test_a_drift_is_no_loop_of_a_continuous_run(cubic: tuple[float, ...]) -> None:
    """Rising and falling sensors, 15 mV over eight cycles."""
    plant = Plant(cubics=(cubic,), noise_mv=(1.0,), loop_mm=0.25)
    run = plant.run(*triangle(8, 10.0))
    found = analyse(drifting(run, 15.0 / 80.0), options=QUICK).sensors[0].figures[SYSTEM]
    assert found.low <= system_truth(plant, np.linspace(-40.0, 50.0, 91)) <= found.high


def loops_of(values: np.ndarray) -> Loops:
    """Return loops of one sensor, of values [cycles, places]."""
    cycles, places = values.shape
    signal = values.reshape(cycles, 2, places // 2).transpose(1, 0, 2)[None]
    shape = signal.shape[1:]
    return Loops(
        np.arange(places // 2) * 1.0, np.zeros(shape), None, signal, np.ones(shape, bool),
        tuple(range(1, cycles + 1)), (), (0.0, 1.0), binned=True,
    )  # fmt: skip


def correlated(rng: np.random.Generator, cycles: int, rho: float) -> np.ndarray:
    """Return a stationary autoregression of sd 1, or a random walk for rho = 1."""
    steps = rng.standard_normal(cycles)
    if rho == 1.0:
        return np.cumsum(steps)
    values = steps.copy()
    for i in range(1, cycles):
        values[i] = rho * values[i - 1] + np.sqrt(1.0 - rho**2) * steps[i]
    return values


@pytest.mark.parametrize(
    ("rho", "least", "most"), mostly_at_night((0.8, 0.93, 0.995), (0.0, 0.92, 0.99), (1.0, 0.92, 0.98))
)
def test_the_interval_of_the_drift_allows_for_cycles_that_depend_on_one_another(
    rho: float, least: float, most: float
) -> None:
    """Independent cycles, an autoregression and a random walk of 30 cycles without drift: 0 is in the interval."""
    rng, held = np.random.default_rng(5), []
    for _ in range(300):
        values = correlated(rng, 30, rho)[:, None] + 0.1 * rng.standard_normal((30, 8))
        found = drift(loops_of(values), 0, 250.0)
        held.append(found.low <= 0.0 <= found.high)
    assert least <= np.mean(held) <= most


def test_few_cycles_state_that_they_are_assumed_to_be_independent() -> None:
    """Of 10 a random walk often goes unnoticed, of 30 hardly ever: the assumption is stated with the former."""
    for cycles, stated in ((5, True), (10, True), (30, False)):
        loops = loops_of(np.random.default_rng(1).standard_normal((cycles, 8)))
        spread = repeatability(loops, 0, 250.0, np.ones((1, cycles)))["repeatability_percent_fso"]
        for figure in (drift(loops, 0, 250.0), spread):
            assert figure.reason is not Reason.DEPENDENT
            assert figure.definition.endswith(f"; {cycles} cycles are assumed to be independent") == stated


def test_dependence_is_said_where_it_is_noticed() -> None:
    """Figures over cycles carry the code; that of repeatability is wider than of the same cycles in another order."""
    rng = np.random.default_rng(2)
    values = correlated(rng, 40, 0.95)[:, None] + 0.05 * rng.standard_normal((40, 8))
    shuffled = values[rng.permutation(40)]
    weights = rng.multinomial(40, np.full(40, 1 / 40), size=200).astype(float)
    both = [
        repeatability(loops_of(each), 0, 250.0, weights)["repeatability_percent_fso"] for each in (values, shuffled)
    ]
    assert [figure.reason is Reason.DEPENDENT for figure in both] == [True, False]
    assert both[0].value == pytest.approx(both[1].value)
    assert both[0].high > 1.2 * both[1].high
    assert drift(loops_of(values), 0, 250.0).reason is Reason.DEPENDENT


def test_dependence_by_closed_forms() -> None:
    """Independent values have n - 1 degrees of freedom and (n + 1) / n; a random walk about twice its spread ahead."""
    none = Dependence(12, 1)
    assert (none.dof, none.variance_share, none.slope_widening) == (pytest.approx(11.0), pytest.approx(1.0), 1.0)
    assert none.next_share == pytest.approx(13.0 / 12.0)
    walk = Dependence(12, 1, 0.999)
    k = 12.0
    expected = (1.0 + (k - 1.0) * (2.0 * k - 1.0) / (6.0 * k)) / ((k + 1.0) / 6.0)
    assert walk.next_share == pytest.approx(expected, rel=0.03)
    assert 2.0 < walk.dof < 3.0


def test_u_follows_noise_that_grows_over_the_range(tmp_path: Path) -> None:
    """New readings at the top and at the bottom are within U alike; a sound sensor keeps one noise."""
    stairs = Staircase(Plant(noise_mv=(0.0, 0.0)), cycles=4)
    pressure, loading, cycle, _ = stairs.trace()
    rng = np.random.default_rng(1)
    clean = stairs.plant.run(pressure, loading, cycle)
    z = (stairs.plant.elongation(pressure, loading) + 2.7) / 6.5
    stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
    cubic, held = np.polynomial.Polynomial(PAPER[0]), {}
    for name, growth in (("growing", 3.0), ("shrinking", -0.75), ("sound", 0.0)):
        noise = 1.5 * (1.0 + growth * z)
        signal = clean.signal_mv + noise[:, None] * rng.standard_normal(clean.signal_mv.shape)
        run = Recording.from_arrays(clean.time_s, clean.pressure_kpa, signal)
        analysis = analyse(run, tmp_path / "e.csv", options=replace(QUICK, x_resolution_mm=0.0))
        x, u = analysis.u_elongation[0].T
        fit = analysis.sensors[0].calibration
        assert fit is not None
        reader = CalibrationRecord.parse(finite(calibration_record(analysis).as_json())).sensors[0].inverse()
        np.testing.assert_allclose(2.0 * reader.standard_uncertainty(x), u, rtol=0.02)
        for at in (1, 20, 39):
            sd = 1.5 * (1.0 + growth * (x[at] + 2.7) / 6.5)
            read = cubic(x[at]) + sd * rng.standard_normal(4000)
            within = np.abs(read - fit.predict(x[at])) <= u[at] * abs(fit.slope(x[at]))
            held[name, at] = float(within.mean())
    assert all(0.935 <= share <= 0.97 for share in held.values()), held


@pytest.mark.parametrize(("walk_mv", "noticed"), [(8.0, True), (0.0, False)])
def test_a_random_walk_is_noticed_within_its_cycles(walk_mv: float, noticed: bool) -> None:
    """Five cycles show it by neighbouring holds; independent holds, with cycles that differ, are not taken for it."""
    rng, found, ahead = np.random.default_rng(3), [], []
    for _ in range(60):
        walk = np.cumsum(rng.standard_normal(100)) * walk_mv / 10.0
        values = walk[:90].reshape(5, 18) + 0.2 * rng.standard_normal((5, 18)) + 0.5 * rng.standard_normal((5, 1))
        values[:, :9] = values[:, 8::-1]  # the unloading branch goes down in pressure
        effect = CycleEffect.of(loops_of(values), 0)
        found.append(effect.dependence.rho == RANDOM_WALK)
        pooled = float(np.sqrt(np.mean(values.var(axis=0, ddof=1))))
        ahead.append(abs(walk[95] - walk[:90].mean()) <= 2.0 * effect.repeatability(pooled, 0.0))
    if noticed:
        assert np.mean(found) > 0.95
        assert np.mean(ahead) > 0.9
    else:
        assert np.mean(found) < 0.05
