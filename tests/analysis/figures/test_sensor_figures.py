"""Figures of a sensor at their limits: no noise, no span, intervals at zero, the reading error."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from analysis import Options, analyse, fit_calibration
from analysis.figures import sensor_figures as metrics
from analysis.figures.sensor_figures import noise_and_snr, repeatability, staircase_noise
from analysis.statistics import resampling_weights
from tests.analysis.boat_builder import PAPER, Plant, Staircase

QUICK = Options(mcmc=False, x_resolution_mm=0.0)


def elongation_file(stairs: Staircase, folder: Path) -> Path:
    """The exact elongations of a staircase as a file."""
    path = folder / "elongation.csv"
    stairs.elongations().to_csv(path, index=False)
    return path


@pytest.mark.fault(42, how="a signal without noise", times=2)
@pytest.mark.parametrize(("noise", "expected"), [((0.0, 0.0), np.inf), ((1.0, 1.0), 20 * np.log10(255.5837 / 1.0))])
def test_snr_of_no_noise_is_infinite_with_a_reason(tmp_path: Path, noise: tuple[float, float], expected: float) -> None:
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


def test_an_interval_of_a_spread_does_not_go_below_zero() -> None:
    """Three cycles: the interval of a standard deviation, a width or a span starts at zero at least."""
    plan = Staircase(Plant(loop_mm=0.25), cycles=3)
    for sensor in analyse(plan.recording(), mcmc=False).sensors:
        for figure in sensor.figures.values():
            if figure.unit in ("mV", "% FSO"):
                assert not figure.low < 0


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
        figures = [metrics.sensitivities(one)["sensitivity_mv_per_mm"] for one in both]
        low, high = fit.x_range
        inside.append([f.low <= (truth(high) - truth(low)) / (high - low) <= f.high for f in figures])
    without, with_reading = np.sum(np.asarray(inside), axis=0)
    assert with_reading >= 36
    assert without <= 8


def test_interval_of_the_snr_is_that_of_the_noise_in_decibels() -> None:
    """20 log10 of the full scale over the ends of the noise's interval, and the noise divides by what is free."""
    rng = np.random.default_rng(0)
    samples = 0.5 * rng.standard_normal((6, 40, 20)) * np.linspace(0.8, 1.2, 6)[:, None, None]
    apart = samples - samples.mean(axis=2, keepdims=True)
    parts = ((apart**2).sum(axis=2).ravel(), np.full(240, 19.0), np.repeat(np.arange(1.0, 7.0), 40))
    noise, snr = noise_and_snr(parts, tuple(range(1, 7)), 250.0, resampling_weights(6, rng, 2_000))
    assert noise.value == pytest.approx(np.sqrt(samples.var(axis=2, ddof=1).mean()), rel=1e-12)
    assert snr.value == pytest.approx(20 * np.log10(250 / noise.value))
    assert [snr.low, snr.high] == pytest.approx([20 * np.log10(250 / end) for end in (noise.high, noise.low)], abs=0.05)


def test_noise_of_a_plateau_counts_one_degree_of_freedom_less() -> None:
    """Plateaus of three samples: the noise is unbiased, where division by three would find 0.816 of it."""
    rng = np.random.default_rng(1)
    sds = rng.standard_normal((400, 3)).std(axis=1, ddof=1)
    plateaus = tuple(
        SimpleNamespace(void="", branch="loading", n=(3,), signal_sd_mv=(sd,), cycle=1 + k % 4)
        for k, sd in enumerate(sds)
    )
    squares, dof, _ = staircase_noise(plateaus, 0)
    assert np.sqrt(squares.sum() / dof.sum()) == pytest.approx(1.0, abs=0.05)


def test_repeatability_and_its_interval_hold_the_true_scatter() -> None:
    """4 cycles of 74 levels with a scatter of 1 % FSO: unbiased, and 19 of 20 intervals at least near it hold it."""
    held, values = 0, []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        loops = SimpleNamespace(
            own=np.ones((2, 4, 37), bool),
            signal_mv=rng.standard_normal((1, 2, 4, 37)),
            n_cycles=4,
            numbers=(1, 2, 3, 4),
        )
        found = repeatability(loops, 0, 100.0, resampling_weights(4, rng, 500))["repeatability_percent_fso"]
        held += found.low <= 1.0 <= found.high
        values.append(found.value)
    assert np.sqrt(np.mean(np.square(values))) == pytest.approx(1.0, abs=0.02)
    assert held >= 17
