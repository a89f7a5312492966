"""The posterior, the inverse and the segmentation, each on made data whose truth is known."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from numpy.polynomial import Polynomial

from analysis.calibration import Calibration, fit_calibration
from analysis.cycles import find_cycles
from analysis.inverse import NODES, Inverse
from analysis.plateaus import Plateau, find_plateaus
from analysis.polynomial import FloatArray
from analysis.posterior import MAX_STEPS, Posterior, sample_posterior
from analysis.recording import Recording
from analysis.tradeoff.measure import Method, Setting

CUBIC = Polynomial((1651.9842, 46.4413, -2.6934, -0.36251))
NOISE_MV, RANGE_MM = 1.49, (-2.70, 3.80)
"""The paper's first sensor."""
READING_MM = 0.5 / 12**0.5
SIGNALS = 20_000
RATE_HZ, DWELL_S, RAMP_KPA_PER_S = 100.0, 5.0, 20.0


def _calibration() -> Calibration:
    x = np.tile(np.linspace(*RANGE_MM, 10), 9)
    return fit_calibration(x, CUBIC(x) + NOISE_MV * np.random.default_rng(0).standard_normal(x.size))


def posterior_settings(quick: bool) -> list[Setting]:
    """Steps of the 64 walkers; the sampler stops of itself when it has converged."""
    fit = _calibration()
    closed = fit.std_errors * np.sqrt(fit.dof / (fit.dof - 2))

    def error(posterior: Posterior) -> float:
        return 100.0 * float(np.abs(posterior.sd / closed - 1.0).max())

    def sampler(steps: int) -> Callable[[int], Posterior]:
        return lambda repeat: sample_posterior(fit.x, fit.y, seed=repeat, max_steps=steps)

    steps = (250, 1000, MAX_STEPS) if quick else (100, 250, 500, 1000, 2000, MAX_STEPS)
    return [Setting(f"64 walkers x {n} steps at most", sampler(n), error) for n in steps]


def inverse_settings(quick: bool) -> list[Setting]:
    """The program's Newton, tables of several sizes, and the roots of each cubic, for signals whose x is known."""
    fit = _calibration()
    x = np.random.default_rng(1).uniform(*RANGE_MM, SIGNALS)
    powers = fit.coefficients.astype(np.longdouble)
    y = (((powers[3] * x + powers[2]) * x + powers[1]) * x + powers[0]).astype(np.float64)
    inverse = Inverse.of(fit)

    def error_of(count: int) -> Callable[[FloatArray], float]:
        return lambda found: float(np.abs(found - x[:count]).max())

    settings = [Setting("Newton", lambda _: inverse(y), error_of(SIGNALS), work=SIGNALS)]
    sizes = (17, 65, NODES) if quick else (9, 17, 33, 65, 129, NODES, 1025, 4097)
    settings += [Setting(f"table of {n}", _table(fit, n, y), error_of(SIGNALS), work=SIGNALS) for n in sizes]
    few = SIGNALS // 40
    settings.append(Setting("roots of the cubic", lambda _: _roots(fit, y[:few]), error_of(few), work=few))
    return settings


def _table(fit: Calibration, nodes: int, y: FloatArray) -> Callable[[int], FloatArray]:
    at = np.linspace(*fit.x_range, nodes)
    signals = fit.predict(at)
    return lambda _: np.interp(y, signals, at)


def _roots(fit: Calibration, y: FloatArray) -> FloatArray:
    """Solve the cubic by its companion matrix, one signal after the other; the root inside the range."""
    b, middle = fit.coefficients, float(np.mean(fit.x_range))
    roots = (np.roots([b[3], b[2], b[1], b[0] - value]) for value in y)
    return np.array([r.real[np.argmin(np.abs(r - middle))] for r in roots])


def segmentation_settings(quick: bool) -> list[Setting]:
    """Every sample or every k-th of a staircase of 5 cycles: the plateaus' means against the noise-free truth."""
    levels, pressure = _staircase()
    x = np.interp(pressure, (-40.0, 50.0), RANGE_MM)
    rng = np.random.default_rng(2)
    time_s = np.arange(pressure.size) / RATE_HZ
    truth = CUBIC(np.interp(levels, (-40.0, 50.0), RANGE_MM))
    runs = [
        (pressure + 0.05 * rng.standard_normal(x.size), CUBIC(x) + NOISE_MV * rng.standard_normal(x.size))
        for _ in range(7)
    ]

    def segmented(every: int) -> Callable[[int], tuple[Plateau, ...]]:
        recordings = [Recording.from_arrays(time_s[::every], p[::every], y[::every, None]) for p, y in runs]
        return lambda repeat: find_plateaus(recordings[repeat], find_cycles(recordings[repeat]))

    def error(found: tuple[Plateau, ...]) -> float:
        if len(found) != truth.size:
            return float("inf")
        return float(np.sqrt(np.mean((np.array([p.signal_mv[0] for p in found]) - truth) ** 2)))

    steps = (1, 2, 5, 10, 20) if quick else (1, 2, 3, 5, 10, 20, 50)
    return [Setting(_every(k), segmented(k), error) for k in steps]


def _every(k: int) -> str:
    return "every sample" if k == 1 else f"one sample in {k}"


def _staircase() -> tuple[FloatArray, FloatArray]:
    """Return the level of each hold, and the pressure of each sample, kPa."""
    down = np.arange(50.0, -41.0, -10.0)
    levels = np.concatenate([down[:1], *[np.concatenate([down[1:], down[-2::-1]])] * 5])
    ramp = np.arange(round(10.0 / RAMP_KPA_PER_S * RATE_HZ)) / round(10.0 / RAMP_KPA_PER_S * RATE_HZ)
    parts = [np.full(round(DWELL_S * RATE_HZ), levels[0])]
    for before, level in itertools.pairwise(levels):
        parts += [before + (level - before) * ramp, np.full(round(DWELL_S * RATE_HZ), level)]
    return levels, np.concatenate(parts)


POSTERIOR = Method(
    "posterior", "Posterior: steps of the sampler", "Student's t, the closed form without reading error", True,
    "the width of the band: 3 %", 3.0, "% of the sd", "a posterior", 
    lambda f: f"64 walkers x {f.posterior_steps} steps at most", posterior_settings,
)  # fmt: skip
INVERSE = Method(
    "inverse", "Inverse: mV to mm", "the x that each signal was made from, in extended precision", True,
    "the reader of mm: a tenth of the reading error", READING_MM / 10, "mm", "a value", lambda f: "Newton", inverse_settings,
)  # fmt: skip
SEGMENTATION = Method(
    "segmentation", "Segmentation: samples used", "the noise-free signal at each level of the staircase", True,
    "the calibration's points: a tenth of the noise", NOISE_MV / 10, "mV", "a run of 5 cycles", lambda f: _every(1),
    segmentation_settings,
)  # fmt: skip
