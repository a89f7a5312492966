"""Where the polynomial fit, its inverse and its posterior break down.

Truth: the curve that the points were made from. Without noise it is evaluated in rational arithmetic at the very
doubles that the fit gets; with noise, the stated interval must contain the truth: over many draws of the noise, the
median error of those without warning; where most draws have a warning, that is the result. For the posterior it is
also Student's t, which the posterior is without reading error.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from analysis.calibration.checks import calibration_warnings
from analysis.calibration.fit import Calibration, fit_calibration
from analysis.calibration.inverse import Inverse
from analysis.calibration.posterior import Posterior, sample_posterior
from analysis.published import NOISE_MV as PUBLISHED_NOISE_MV
from analysis.published import RANGE_MM, SENSORS
from analysis.studies.failure_maps.sweep import Axis, Study, StudyResult, joined
from protocol.base.arrays import FloatArray

_CUBIC = SENSORS[0].coefficients
TURNING_MM = float(np.polynomial.Polynomial(_CUBIC).deriv().roots().max())
SENSOR_NOISE_MV = PUBLISHED_NOISE_MV[0]
SURE = 0.999
_DRAWS = 21
READINGS = 1000
_ROUNDING = 1e-6  # relative to the span of y: what the fit may lose without a warning


def warned(fit: Calibration) -> list[str]:
    """Return the texts of a calibration's warnings."""
    return [warning.text for warning in calibration_warnings(fit)]


def cubic(x: FloatArray) -> FloatArray:
    """Return the sensor's signal without noise, mV; the rounding of doubles is far below its noise."""
    return np.asarray(np.polynomial.polynomial.polyval(x, _CUBIC), dtype=np.float64)


def exact(x: FloatArray, coefficients: tuple[float, ...]) -> FloatArray:
    """Evaluate a polynomial without rounding, [n] -> [n]."""
    parts = [Fraction(c) for c in coefficients]
    return np.array([float(sum(c * Fraction(v) ** k for k, c in enumerate(parts))) for v in x.tolist()])


def wavy(degree: float) -> tuple[float, ...]:
    """Return the monomials of Chebyshev's polynomial in u = -1..1, which uses its whole degree."""
    return tuple(np.polynomial.chebyshev.cheb2poly([0.0] * int(degree) + [1.0]).tolist())


def clusters(width: float, degree: float) -> StudyResult:
    """Fit points in two clusters at the ends of the range, each `width` of it wide; compare the curve everywhere."""
    part = width * np.linspace(0.0, 1.0, 12)
    u = np.sort(np.concatenate([-1.0 + 2.0 * part, 1.0 - 2.0 * part]))
    fit = fit_calibration(u, exact(u, wavy(degree)), int(degree))
    at = np.linspace(-1.0, 1.0, 41)
    truth = exact(at, wavy(degree))
    return StudyResult(float(np.abs(fit.predict(at) - truth).max() / np.ptp(truth)), joined(warned(fit)))


def offset(away: float, degree: float) -> StudyResult:
    """Fit a range `away` from zero; compare the curve as a user of b0, b1, ... evaluates it."""
    half = (RANGE_MM[1] - RANGE_MM[0]) / 2
    x = away + half * np.linspace(-1.0, 1.0, 24)
    y = exact((x - away) / half, wavy(degree))
    fit = fit_calibration(x, y, int(degree))
    written = np.polynomial.polynomial.polyval(x, fit.coefficients)
    return StudyResult(float(np.abs(written - y).max() / np.ptp(y)), joined(warned(fit)))


def few_points(count: float, degree: float) -> StudyResult:
    """Fit few points with noise, the degree as high as the truth's or higher."""
    x = np.linspace(*RANGE_MM, int(count))
    return over_draws(x, np.zeros(x.size), int(degree))


def outlier(size: float, count: float) -> StudyResult:
    """Fit points with one outlier, `size` standard deviations of the noise, at an end of the range."""
    x = np.linspace(*RANGE_MM, int(count))
    return over_draws(x, np.where(x == x[-1], size, 0.0), 3)


def over_draws(x: FloatArray, off: FloatArray, degree: int) -> StudyResult:
    """Fit many draws; return the distance from the true curve in half-widths of the stated 99.9 % band.

    `x`: (n,) mm. `off`: (n,) errors put in, sd of the noise.
    """
    fits = []
    for seed in range(_DRAWS):
        noise = np.random.default_rng(seed).standard_normal(x.size)
        fits.append(fit_calibration(x, cubic(x) + SENSOR_NOISE_MV * (noise + off), degree))
    return most([_in_band(fit) for fit in fits])


def _in_band(fit: Calibration) -> StudyResult:
    at = np.linspace(*fit.x_range, 41)
    low, high = fit.band(at, SURE)
    with np.errstate(invalid="ignore"):
        parts = np.abs(fit.predict(at) - cubic(at)) / ((high - low) / 2)
    return StudyResult(float(np.max(np.where(np.isfinite(parts), parts, np.inf))), joined(warned(fit)))


def most(results: Sequence[StudyResult]) -> StudyResult:
    """Return what most of several results are: a warning, or the median error of those without one."""
    unwarned = [result.error for result in results if not result.message]
    if 2 * len(unwarned) >= len(results):
        return StudyResult(float(np.median(unwarned)))
    message = next(result.message for result in results if result.message)
    return StudyResult(float(np.median([result.error for result in results])), message)


def turning(gap_mm: float, place: float) -> StudyResult:
    """Invert a signal at `place` of a calibrated range (0 to 1) that ends `gap_mm` before the turning point.

    The error is the share of readings without a flag that lie farther from the truth than twice the stated
    uncertainty: 5 % of normal scatter do.
    """
    low, high = RANGE_MM[0], TURNING_MM - gap_mm
    x = np.tile(np.linspace(low, high, 14), 7)
    rng = np.random.default_rng(1)
    fit = fit_calibration(x, cubic(x) + SENSOR_NOISE_MV * rng.standard_normal(x.size), 3)
    truth = low + place * (high - low)
    signal = cubic(np.array([truth])) + SENSOR_NOISE_MV * rng.standard_normal(READINGS)
    found = Inverse.of(fit, noise_sd=SENSOR_NOISE_MV).evaluate(signal)
    given = ~found.outside
    beyond = np.abs(found.elongation_mm - truth)[given] > 2.0 * found.standard_uncertainty_mm[given]
    error = float(beyond.mean()) if given.mean() > 0.01 else float("nan")
    outside = f"{1 - given.mean():.0%} of the readings flagged outside the range" if given.mean() < 0.5 else ""
    return StudyResult(error, joined([outside, *warned(fit)]))


_DEGREES = tuple(float(d) for d in range(1, 11))


_LEVELS, _CYCLES = 10, 5
STEP_MM = (RANGE_MM[1] - RANGE_MM[0]) / (_LEVELS - 1)
POSITIONS = np.tile(np.linspace(*RANGE_MM, _LEVELS), _CYCLES)


def messages_of(posterior: Posterior) -> str:
    """Return the messages that a user gets about a posterior."""
    return joined([warning.text for warning in posterior.warnings])


def start(ball: float, steps: float) -> StudyResult:
    """Sample from walkers that start in a ball of any size; return the worst relative error of an sd."""
    y = cubic(POSITIONS) + SENSOR_NOISE_MV * np.random.default_rng(2).standard_normal(POSITIONS.size)
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


FIT_STUDIES = (
    Study(
        "fit-clusters", "fit", "Points in two clusters at the ends",
        "the polynomial that the points lie on, in rational arithmetic", "of the span", _ROUNDING,
        Axis("width of a cluster, share of the range", "", (1e-7, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.5)),
        Axis("degree", "", _DEGREES), clusters,
    ),
    Study(
        "fit-offset", "fit", "The range lies far from zero",
        "the polynomial that the points lie on, in rational arithmetic", "of the span", _ROUNDING,
        Axis("x at the middle of the range", "mm", (0.0, *(10.0**k for k in range(1, 10)))),
        Axis("degree", "", _DEGREES[:6]), offset,
    ),
    Study(
        "fit-few-points", "fit", "Few points, high degree",
        "the cubic that the points were made from", "half-widths of the 99.9 % band", 1.0,
        Axis("points", "", (3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 30.0, 50.0)),
        Axis("degree", "", (3.0, 4.0, 6.0, 8.0, 10.0)), few_points,
    ),
    Study(
        "fit-outlier", "fit", "One wrong point at the end",
        "the cubic that the points were made from", "half-widths of the 99.9 % band", 1.0,
        Axis("wrong by, sd of the noise", "", (0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 20.0, 1000.0)),
        Axis("points", "", (6.0, 8.0, 10.0, 15.0, 20.0, 40.0)), outlier,
    ),
    Study(
        "inverse-turning", "inverse", "Towards the turning point, and outside the range",
        "the elongation that each signal was made from", "share of readings beyond 2 u", 0.10,
        Axis("range ends before the turning point by", "mm", (2.0, 1.0, 0.7, 0.5, 0.3, 0.1, 0.05, 0.02, -0.1, -0.5)),
        Axis("place in the range", "", (-0.1, -0.03, 0.0, 0.1, 0.5, 0.9, 0.95, 1.0, 1.03, 1.1)), turning,
    ),
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
