"""What resampling and sampling leave uncertain, and as many draws as a tolerance allows."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.atlas.runs import Stairs
from analysis.calibration.fit import fit_calibration
from analysis.calibration.posterior import Posterior, sample_posterior
from analysis.data.recording import Recording
from analysis.errors import RequestError
from analysis.figures.sensor_analysis import Options
from analysis.sequential.accuracy import BATCHES, LIMIT_ERROR, Accuracy, accuracy_of, analyse_within, band_errors


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, Path]:
    """Return three cycles of a staircase, and the file of its elongations."""
    stairs = Stairs(cycles=3, rate_hz=30.0, dwell_s=1.0)
    levels, branch = stairs.holds
    rows = zip(levels, stairs.elongation(levels, branch), strict=True)
    file = tmp_path_factory.mktemp("run") / "elongation.csv"
    file.write_text("pressure_kpa,elongation_mm\n" + "".join(f"{p:.6f},{x:.9f}\n" for p, x in rows), encoding="ascii")
    return stairs.recording(), file


def test_the_error_of_a_limit_is_that_of_a_quantile() -> None:
    """Limits of 1,000 normal draws, 2,000 times: their scatter is the stated error over 2, within 10 %."""
    drawn = np.percentile(np.random.default_rng(1).standard_normal((1_000, 2_000)), 2.5, axis=0)
    stated = LIMIT_ERROR * 2 * 1.96 / math.sqrt(1_000)
    assert 2 * np.std(drawn) == pytest.approx(stated, rel=0.1)


def drawn_posterior(draws: np.ndarray) -> Posterior:
    """Return a posterior of straight lines with given draws of its coefficients."""
    rng = np.random.default_rng(0)
    x = np.linspace(0.0, 1.0, 20)
    fit = fit_calibration(x, 2.0 + x + 0.1 * rng.standard_normal(20), 1)
    size = len(draws)
    return Posterior(fit, draws, np.ones(size), draws[0], draws[0], 1.0, 0.0, 1.0, size, 0.5, size, converged=True)


def test_the_error_of_a_band_is_true() -> None:
    """Of 200 bands of 3,200 independent draws, the limits are within the stated error in 90 % or more."""
    rng, x, inside = np.random.default_rng(2), np.array([0.5]), []
    truth = np.percentile(drawn_posterior(rng.standard_normal((400_000, 2))).curves(x), [2.5, 97.5])
    for _ in range(200):
        posterior = drawn_posterior(rng.standard_normal((200 * BATCHES, 2)))
        low, high = posterior.curve_band(x)
        error = float(band_errors(posterior, x)[0])
        inside += [abs(low[0] - truth[0]) <= error, abs(high[0] - truth[1]) <= error]
    assert 0.9 <= np.mean(inside) <= 0.99


def test_draws_follow_from_the_tolerance(run: tuple[Recording, Path]) -> None:
    """Half of the coarse error takes at least four times as many resamples, and is met."""
    recording, file = run
    options = Options(mcmc=False, x_resolution_mm=0.0)
    coarse = accuracy_of(analyse_within(recording, file, options, 100.0, "%FSO"))
    assert coarse.resamples == 100
    assert math.isnan(coarse.band_mm)
    fine = accuracy_of(analyse_within(recording, file, options, coarse.error("%FSO") / 2, "%FSO"))
    assert fine.error("%FSO") <= coarse.error("%FSO") / 2
    assert 400 <= fine.resamples <= 900


def test_a_tolerance_that_no_draws_meet_is_refused_with_the_best(run: tuple[Recording, Path]) -> None:
    """Too small a tolerance, none, and one of a posterior that is not sampled."""
    recording, file = run
    options = Options(mcmc=False, x_resolution_mm=0.0)
    for tolerance, unit, part in ((1e-9, "%FSO", "allow"), (0.0, "mm", "above 0"), (0.1, "mm", "posterior")):
        with pytest.raises(RequestError) as refused:
            analyse_within(recording, file, options, tolerance, unit)  # type: ignore[arg-type]  # of the table above
        assert part in refused.value.remedy


def test_an_accuracy_states_the_larger_of_what_it_has() -> None:
    """Intervals and band in % FSO; a band alone in mm; nothing where there is neither."""
    found = Accuracy(0.2, 0.1, 0.01, 100, 500)
    assert (found.error("%FSO"), found.error("mm")) == (0.2, 0.01)
    assert math.isnan(replace(found, band_mm=math.nan).error("mm"))
    assert found.as_json()["resamples"] == 100


@pytest.mark.nightly
def test_the_error_of_sampled_bands_is_true() -> None:
    """Of 60 sampled posteriors, the limits are within the stated error of a long chain's in 88 % or more."""
    rng = np.random.default_rng(3)
    x = np.repeat(np.linspace(-2.5, 3.5, 13), 4)
    y = 10.0 + x + 0.1 * x**2 + 0.05 * rng.standard_normal(x.size)
    at = np.array([0.5])
    truth = np.array(sample_posterior(x, y, 2, samples=200_000).curve_band(at)).ravel()
    inside = []
    for seed in range(60):
        found = sample_posterior(x, y, 2, seed=seed + 1, samples=2_000)
        inside.append(np.abs(np.array(found.curve_band(at)).ravel() - truth) <= band_errors(found, at)[0])
    assert np.mean(inside) >= 0.88
