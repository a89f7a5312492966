"""The GUM's worked examples, ISO 5725 and En by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import signal, stats

from analysis import Options, Recording, analyse
from analysis.figures.uncertainty import (
    Component,
    combine,
    elongation_budget,
    elongation_reader,
    signal_parts,
)
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
    assert "no single component" in combine([Component("a", 1.0), Component("b", 1.0)]).what_halves_it()


def test_stated_interval_of_an_elongation_holds_the_truth(tmp_path: Path) -> None:
    """Over the samples of 6 runs with known x, x +- U (k = 2) holds the truth 93 to 97.5 % of the time."""
    inside, count = 0, 0
    for seed in range(6):
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
    """The budget lists the ten components, each with its source; on a grid, reading is the largest."""
    stairs = Staircase(Plant(loop_mm=0.25))
    frame = stairs.elongations()
    frame["elongation_mm"] = (frame["elongation_mm"] * 2).round() / 2
    frame.to_csv(tmp_path / "grid.csv", index=False)
    analysis = analyse(stairs.recording(), tmp_path / "grid.csv", options=Options(mcmc=False))
    budget = elongation_budget(analysis, 0.5)[0]
    assert {c.name for c in budget.components} == {
        "reading", "noise", "repeatability", "reproducibility", "hysteresis", "zero drift", "resolution",
        "ambient residual", "fit", "lack of fit",
    }  # fmt: skip
    assert all(c.source for c in budget.components)
    assert next(iter(budget.shares())) == "reading"


def test_spread_between_runs_enters_the_budget(tmp_path: Path) -> None:
    """Four calibrations whose b0 differ: the budget's reproducibility is the sd of y(x) over the slope, less the fit's.

    With one run it is not assessed.
    """
    offsets, runs = (0.0, 3.0, -2.0, 1.0), []
    for seed, offset in enumerate(offsets):
        cubics = tuple((c[0] + offset, *c[1:]) for c in PAPER)
        stairs = Staircase(Plant(cubics=cubics, loop_mm=0.1, seed=seed), cycles=2)
        stairs.elongations().to_csv(tmp_path / "e.csv", index=False)
        runs.append(analyse(stairs.recording(), tmp_path / "e.csv", mcmc=False))
    alone, among = (elongation_budget(runs[0], 0.5, runs=part)[0] for part in ((), runs))
    assert alone.shares()["reproducibility"] == 0.0
    found = next(c for c in among.components if c.name == "reproducibility")
    slope = float(np.polynomial.Polynomial(PAPER[0]).deriv()(0.5))
    assert found.contribution == pytest.approx(np.std(offsets, ddof=1) / slope, rel=0.05)
    assert found.dof == 3
    assert among.u > alone.u


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
