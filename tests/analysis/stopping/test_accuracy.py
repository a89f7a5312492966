"""What resampling and sampling leave uncertain, and as many draws as a tolerance allows."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal, stats

from analysis.atlas.runs import Stairs
from analysis.calibration.draws import COVERAGE
from analysis.calibration.fit import fit_calibration
from analysis.calibration.posterior import Posterior
from analysis.data.recording import Recording
from analysis.errors import RequestError
from analysis.figures.pipeline import analyse, redrawn
from analysis.figures.sensor_analysis import Options
from analysis.numbers import finite
from analysis.stopping.accuracy import (
    BATCHES,
    FEWEST_SAMPLES,
    Accuracy,
    accuracy_of,
    analyse_within,
    band_noise,
    draws_for,
    greatest_band_error,
    sample_within,
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Recording, Path]:
    """Return three cycles of a staircase, and the file of its elongations."""
    stairs = Stairs(cycles=3, rate_hz=30.0, dwell_s=1.0)
    levels, branch = stairs.holds
    rows = zip(levels, stairs.elongation(levels, branch), strict=True)
    file = tmp_path_factory.mktemp("run") / "elongation.csv"
    file.write_text("pressure_kpa,elongation_mm\n" + "".join(f"{p:.6f},{x:.9f}\n" for p, x in rows), encoding="ascii")
    return stairs.recording(), file


def drawn_posterior(draws: np.ndarray) -> Posterior:
    """Return a posterior of straight lines with given draws of its coefficients."""
    rng = np.random.default_rng(0)
    x = np.linspace(0.0, 1.0, 20)
    fit = fit_calibration(x, 2.0 + x + 0.1 * rng.standard_normal(20), 1)
    size = len(draws)
    return Posterior(fit, draws, np.ones(size), draws[0], draws[0], 1.0, 0.0, 1.0, size, 0.5, size, converged=True)


def test_the_worst_limit_of_a_band_errs_as_stated() -> None:
    """Of 100 bands of a straight line at 31 places, which err together: its rms is the stated one within a sixth.

    With the distances of single draws, which are noise at each place, it was 1.22 times the true one.
    """
    rng, x = np.random.default_rng(6), np.linspace(0.0, 1.0, 31)
    half = 1.959964 * drawn_posterior(rng.standard_normal((400_000, 2))).curves(x).std(axis=0)
    true, stated = [], []
    for seed in range(100):
        posterior = drawn_posterior(rng.standard_normal((3_200, 2)))
        low, high = np.percentile(posterior.curves(x), [2.5, 97.5], axis=0)
        true.append(max(np.abs(low + half).max(), np.abs(high - half).max()))
        stated.append(np.abs(band_noise(posterior, x, seed)).max(axis=(1, 2)))
    ratio = np.sqrt(np.mean(np.square(stated)) / np.mean(np.square(true)))
    assert ratio == pytest.approx(1.0, abs=0.16)


def test_the_error_of_a_band_contains_the_autocorrelation() -> None:
    """Of 300 chains it is the true one, root mean square, to 12 %; of 16 autocorrelation times a fifth too small."""
    rng, x = np.random.default_rng(7), np.array([1.0])
    for slow, least, most in ((0.9, 0.88, 1.12), (0.97, 0.88, 1.12), (0.99, 1.2, 1.4)):
        true, stated = [], []
        for seed in range(300):
            steps = rng.standard_normal(3_200)
            steps[1:] *= math.sqrt(1.0 - slow**2)
            chain = signal.lfilter([1.0], [1.0, -slow], steps)
            posterior = drawn_posterior(np.column_stack([np.zeros_like(chain), chain]))
            slope = posterior.calibration.fit.basis.design(x)[0, 1]
            true.append(np.percentile(chain, [2.5, 97.5]) - stats.norm.ppf([0.025, 0.975]))
            stated.append(band_noise(posterior, x, seed)[:, :, 0] / slope)
        assert least < np.sqrt(np.mean(np.square(true)) / np.mean(np.square(stated))) < most


def test_the_error_of_a_band_is_true() -> None:
    """Of 100 bands of 3,200 independent draws, both limits are within the stated error in 89 % or more."""
    rng, x, inside = np.random.default_rng(2), np.array([0.5]), []
    truth = np.percentile(drawn_posterior(rng.standard_normal((400_000, 2))).curves(x), [2.5, 97.5])
    for _ in range(100):
        posterior = drawn_posterior(rng.standard_normal((200 * BATCHES, 2)))
        error = np.quantile(np.abs(band_noise(posterior, x)).max(axis=(1, 2)), COVERAGE)
        inside.append(np.abs(np.array(posterior.curve_band(x)).ravel() - truth).max() <= error)
    assert 0.89 <= np.mean(inside) <= 0.995


def test_the_error_of_two_bands_is_that_of_the_worse() -> None:
    """Of two sensors it is more than of each, and no more than a normal error that two in 22 exceed is above one."""
    rng = np.random.default_rng(4)
    bands = [drawn_posterior(rng.standard_normal((3_200, 2))) for _ in range(2)]
    both, alone = greatest_band_error(bands, "y"), [greatest_band_error([band], "y") for band in bands]
    assert max(alone) < both < 1.3 * max(alone)
    assert math.isnan(greatest_band_error([], "mm"))


def test_a_band_takes_as_many_samples_as_its_tolerance() -> None:
    """Half of the error takes about four times as many samples; one beyond all samples is refused."""
    asked = []

    def sample(samples: int) -> Posterior:
        asked.append(samples)
        return drawn_posterior(np.random.default_rng(5).standard_normal((max(samples, 3_200), 2)))

    coarse = greatest_band_error([sample(3_200)], "y")
    posterior, error = sample_within(sample, coarse / 2)
    assert error <= coarse / 2
    assert 4 * 3_200 <= posterior.n_eff <= 8 * 3_200
    assert asked[1] == FEWEST_SAMPLES
    with pytest.raises(RequestError, match="more draws"):
        sample_within(sample, coarse / 100)
    with pytest.raises(RequestError, match="longer chain"):  # one that does not grow
        sample_within(lambda _: posterior, error / 1.2)


def test_draws_follow_from_the_tolerance(run: tuple[Recording, Path]) -> None:
    """Half of the coarse error takes more resamples, no more than 16 times as many, and is met."""
    recording, file = run
    options = Options(mcmc=False, x_resolution_mm=0.0)
    coarse = accuracy_of(analyse_within(recording, file, options, 100.0, "%FSO"))
    assert coarse.resamples == 400
    assert math.isnan(coarse.band_mm)
    fine = accuracy_of(analyse_within(recording, file, options, coarse.error("%FSO") / 2, "%FSO"))
    assert fine.error("%FSO") <= coarse.error("%FSO") / 2
    assert 480 <= fine.resamples <= 6_400


def test_a_tolerance_that_no_draws_meet_is_refused_with_the_best(
    run: tuple[Recording, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Too small a tolerance, none, and one of a posterior that is not sampled."""
    recording, file = run
    monkeypatch.setattr("analysis.stopping.accuracy.MOST_RESAMPLES", 400)
    options = Options(mcmc=False, x_resolution_mm=0.0)
    for tolerance, unit, part in ((1e-9, "%FSO", "allow"), (0.0, "mm", "above 0"), (0.1, "mm", "posterior")):
        with pytest.raises(RequestError) as refused:
            analyse_within(recording, file, options, tolerance, unit)  # type: ignore[arg-type]  # of the table above
        assert part in refused.value.remedy


def test_the_least_tolerance_that_a_refusal_names_is_met(
    run: tuple[Recording, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Resamples of three cycles jump, so that no law gives what the most of them leave."""
    recording, file = run
    monkeypatch.setattr("analysis.stopping.accuracy.MOST_RESAMPLES", 3_000)
    options = Options(mcmc=False, x_resolution_mm=0.0)
    with pytest.raises(RequestError) as refused:
        analyse_within(recording, file, options, 1e-9, "%FSO")
    least = float(refused.value.remedy.split()[1])
    found = accuracy_of(analyse_within(recording, file, options, least, "%FSO"))
    assert 0.0 < found.error("%FSO") <= least


def test_a_tiny_tolerance_takes_all_draws() -> None:
    """The square of its ratio to the error is beyond the numbers of a computer."""
    assert draws_for(1_000, 0.1, 1e-300, "mm", 50_000) == 50_000


def test_the_least_tolerance_of_a_band_is_met() -> None:
    """It is the error that the most samples leave, rounded up."""

    def sample(samples: int) -> Posterior:
        return drawn_posterior(np.random.default_rng(5).standard_normal((samples, 2)))

    with pytest.raises(RequestError, match="more draws") as refused:
        sample_within(sample, 1e-9)
    least = float(refused.value.remedy.split()[1])
    assert sample_within(sample, least)[1] <= least


def test_an_accuracy_states_the_larger_of_what_it_has() -> None:
    """Intervals and band in % FSO; a band alone in mm; nothing where there is neither."""
    found = Accuracy(0.2, 0.1, 0.01, 100, 500, 0.21)
    assert (found.error("%FSO"), found.error("mm")) == (0.21, 0.01)
    assert math.isnan(replace(found, band_mm=math.nan).error("mm"))
    assert found.as_json()["resamples"] == 100


def test_other_draws_give_what_a_whole_analysis_gives(run: tuple[Recording, Path]) -> None:
    """With another seed, resamples and posterior: the same JSON; the error of the run is that of its worst limit."""
    recording, file = run
    coarse = analyse(recording, file, options=Options(mcmc=False, resamples=400))
    other = Options(seed=3, resamples=700, posterior_samples=FEWEST_SAMPLES)
    found = redrawn(coarse, other)
    whole = analyse(recording, file, options=other)
    assert json.dumps(finite(found.to_json())) == json.dumps(finite(whole.to_json()))
    figures = [figure for sensor in found.sensors for figure in sensor.figures.values() if figure.unit == "% FSO"]
    accuracy, greatest = accuracy_of(found), max(figure.error_by_draws for figure in figures)
    assert greatest <= accuracy.intervals_percent_fso < 1.5 * greatest
    assert accuracy.percent_fso >= max(accuracy.intervals_percent_fso, accuracy.band_percent_fso)
