"""Where the posterior breaks down: a bad start, too few steps, readings rounded more than they move, no noise.

Truth: Student's t, which the posterior is without reading error; and the curve that simulated readings came from.
"""

from __future__ import annotations

import numpy as np

from analysis.atlas.fit import NOISE_MV, cubic
from analysis.atlas.sweep import Axis, Study, StudyResult, joined
from analysis.calibration.posterior import Posterior, sample_posterior
from analysis.published import RANGE_MM

LEVELS, CYCLES = 10, 5
STEP_MM = (RANGE_MM[1] - RANGE_MM[0]) / (LEVELS - 1)
POSITIONS = np.tile(np.linspace(*RANGE_MM, LEVELS), CYCLES)


def messages_of(posterior: Posterior) -> str:
    """Return the messages that a user gets about a posterior."""
    return joined([warning.text for warning in posterior.warnings])


def start(ball: float, steps: float) -> StudyResult:
    """Sample from walkers that start in a ball of any size; return the worst relative error of an sd."""
    y = cubic(POSITIONS) + NOISE_MV * np.random.default_rng(2).standard_normal(POSITIONS.size)
    found = sample_posterior(POSITIONS, y, start_sd=ball, max_steps=int(steps), seed=1)
    fit = found.calibration
    closed = fit.std_errors * np.sqrt(fit.dof / (fit.dof - 2))
    away = np.abs(found.mean - fit.coefficients) / closed
    return StudyResult(float(max(np.abs(found.sd / closed - 1.0).max(), away.max())), messages_of(found))


def rounded(grid_steps: float, noise_mv: float) -> StudyResult:
    """Sample readings rounded to a grid of `grid_steps` steps between positions.

    The error is the greatest distance of the band's middle from the true curve, in its standard deviations.
    """
    grid = grid_steps * STEP_MM
    read = np.round(POSITIONS / grid) * grid if grid > 0 else POSITIONS
    y = cubic(POSITIONS) + noise_mv * np.random.default_rng(3).standard_normal(POSITIONS.size)
    found = sample_posterior(read, y, reading_sd=grid / np.sqrt(12.0), seed=1)
    at = np.linspace(*found.calibration.x_range, 31)
    curves = found.curves(at)
    return StudyResult(float(np.max(np.abs(curves.mean(axis=0) - cubic(at)) / curves.std(axis=0))), messages_of(found))


STUDIES = (
    Study(
        "posterior-start", "posterior", "A bad start, too few steps", "Student's t", "of the standard deviations", 0.1,
        Axis("walkers start in a ball of", "standard errors", (1e-6, 1e-3, 1.0, 10.0, 1e3, 1e6)),
        Axis("steps at most", "", (20.0, 50.0, 100.0, 200.0, 400.0, 1000.0)), start,
    ),
    Study(
        "posterior-reading", "posterior", "Readings rounded to a grid", "the curve that the readings came from",
        "standard deviations", 4.5,
        Axis("grid, steps between positions", "", (0.0, 0.02, 0.1, 0.3, 0.7, 1.0, 3.0)),
        Axis("noise, sd", "mV", (0.0, 1e-6, 1.49, 6.0, 50.0)), rounded,
    ),
)  # fmt: skip
