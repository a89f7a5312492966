"""Figures of a sensor at their limits: no noise, no span, intervals at zero, the reading error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis import Options, analyse, fit_calibration
from analysis.figures import sensor_figures as metrics
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
