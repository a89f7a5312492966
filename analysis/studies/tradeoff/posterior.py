"""The posterior: walkers, steps and effective samples, and the closed form, where elongations are read on a grid.

The sampler's own warning is part of its result: a run that has not converged has no number, however near the truth it
may happen to be, and its error is infinite.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.polynomial import Polynomial

from analysis.calibration.fit import fit_calibration
from analysis.calibration.posterior import ENOUGH_SAMPLES, MAX_STEPS, WALKERS, sample_posterior
from analysis.fidelity import Fidelity
from analysis.published import SENSORS
from analysis.studies.failure_maps.fit import SENSOR_NOISE_MV
from analysis.studies.tradeoff.measure import Method, Setting
from analysis.studies.tradeoff.references import load
from protocol.base.arrays import FloatArray

_CUBIC = Polynomial(SENSORS[0].coefficients)
_GRID_MM = 0.5
GRID_U_MM = _GRID_MM / 12**0.5
RANGE_OF_READINGS_MM = (-2.5, 3.5)
AT_MM = np.linspace(*RANGE_OF_READINGS_MM, 61)
_CYCLES = 5
CLOSED = "closed form, reading error left out"
SIZES = ((32, 2_000), (64, 4_000), (128, 8_000), (128, 32_000))
"""Walkers and effective samples; a converged chain is 60 autocorrelation times of each walker, so that fewer samples
take fewer walkers."""
TOO_SHORT = (250, 500, 1_000)  # steps that end the default's chain early


@cache
def readings() -> tuple[FloatArray, FloatArray]:
    """Return x as read on the grid and y, [n]: each level of a staircase twice a cycle, five cycles.

    Every reading has an error of its own, anywhere in its cell.
    """
    levels = np.arange(RANGE_OF_READINGS_MM[0], RANGE_OF_READINGS_MM[1] + 0.01, _GRID_MM)
    return _read(np.repeat(levels, 2 * _CYCLES), 4)


@cache
def few_readings() -> tuple[FloatArray, FloatArray]:
    """Return the hardest run that is still a calibration: one branch of eight levels."""
    return _read(np.linspace(*RANGE_OF_READINGS_MM, 8), 5)


def _read(x: FloatArray, seed: int) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    true = x + _GRID_MM * rng.uniform(-0.5, 0.5, x.size)
    return x, _CUBIC(true) + SENSOR_NOISE_MV * rng.standard_normal(x.size)


def posterior_settings(quick: bool) -> list[Setting]:
    """Return the closed form, then walkers, samples and steps. A call is two posteriors: a usual run, and few readings.

    The error is that of the width of the usual run's 95 % band, root mean square over its range.
    """
    truth = np.array(load("posterior")["width_mv"])

    def error(width_mv: FloatArray | None) -> float:
        if width_mv is None:
            return float("inf")
        return 100.0 * float(np.sqrt(np.mean((width_mv / truth - 1.0) ** 2)))

    sizes, steps = (SIZES[:3], TOO_SHORT[1:2]) if quick else (SIZES, TOO_SHORT)
    found = [Setting(_name(*size), _sampler(*size), error, work=2) for size in sizes]
    found += [
        Setting(f"{WALKERS} walkers, {n} steps at most", _sampler(WALKERS, ENOUGH_SAMPLES, n), error, work=2)
        for n in steps
    ]
    return [Setting(CLOSED, _closed_form, error), *found]


def _sampler(walkers: int, samples: int, steps: int = MAX_STEPS) -> Callable[[int], FloatArray | None]:
    def call(repeat: int) -> FloatArray | None:
        usual, few = (
            sample_posterior(
                x,
                y,
                reading_sd=GRID_U_MM,
                positions=np.arange(x.size),
                seed=repeat,
                walkers=walkers,
                max_steps=steps,
                samples=samples,
            )
            for x, y in (readings(), few_readings())
        )
        return _width(usual.curve_band(AT_MM)) if usual.converged and few.converged else None

    return call


def _closed_form(_: int) -> FloatArray:
    """Return the width of the band of the least-squares fit, by Student's t."""
    return _width(fit_calibration(*readings()).band(AT_MM, 0.95))


def _width(band: tuple[FloatArray, FloatArray]) -> FloatArray:
    low, high = band
    return high - low


def _name(walkers: int, samples: int) -> str:
    return f"{walkers} walkers, {samples} samples"


def _at(level: Fidelity) -> str:
    return _name(level.walkers, level.posterior_samples)


POSTERIOR = Method(
    "posterior", "Posterior: walkers and samples",
    "importance sampling of a likelihood that quadrature integrates over the reading error", True,
    "the reader of the band's width, printed with two digits: 5 %", 5.0, "% of the width", "a posterior", _at,
    posterior_settings,
)  # fmt: skip
