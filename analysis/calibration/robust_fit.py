"""Fits that a few wrong points do not pull: Huber's estimate, or points left out one by one, each with a trail.

Strategy: Huber weighs a point down by k / |r| where its residual r is beyond k = 1.345 robust standard deviations
(95 % efficient for normal errors), by iterated weighted least squares; its covariance is the asymptotic one with
Huber's correction. Leaving out removes the point with the largest externally studentised residual as long as Student's
t with Bonferroni's bound rejects it, and fits again each time.

Rules: nothing is dropped in silence: the trail names every point with less than full weight, its residual and its
weight. At most a quarter of the points is left out. Sources: Huber, Robust Statistics (1981), 7.6 and 7.8; Cook and
Weisberg, Residuals and Influence in Regression (1982), 2.2.2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np
from scipy import stats

from analysis.calibration.constrained_fit import with_solution
from analysis.calibration.fit import Calibration, fit_calibration
from analysis.statistics import robust_sd
from protocol.base.arrays import BoolArray, FloatArray
from protocol.base.errors import BoatDaqError, DataError

HUBER_K = 1.345
ITERATIONS = 200
CONVERGED = 1e-9
"""Of the robust scale: what a residual may still move."""
CHANCE = 0.02
"""That a sound set of points loses one."""
MOST_LEFT_OUT = 4
"""At most one point in so many."""


Refit = Callable[[Calibration], Calibration]


class RobustMethod(StrEnum):
    """What is done with a point far from the curve."""

    HUBER = "huber"
    LEAVE_OUT = "leave-out"


@dataclass(frozen=True, slots=True)
class Downweighted:
    """A point with less than full weight: its row among the points, its x and y, its residual, weight and reason."""

    row: int
    x: float
    y: float
    residual: float
    weight: float
    reason: str

    def as_json(self) -> dict[str, Any]:
        """Return an entry of the trail."""
        return {name: getattr(self, name) for name in ("row", "x", "y", "residual", "weight", "reason")}


@dataclass(frozen=True, slots=True)
class RobustFit:
    """A calibration of all points (Huber) or of those kept, and the trail of the others.

    `kept` [n] marks the points of the calibration.
    """

    method: RobustMethod
    calibration: Calibration
    trail: tuple[Downweighted, ...]
    kept: BoolArray

    def as_json(self) -> dict[str, Any]:
        """Return `robust` of `fit --json`."""
        return {"method": str(self.method), "trail": [one.as_json() for one in self.trail]}


def huber(calibration: Calibration, refit: Refit = lambda fit: fit) -> RobustFit:
    """Fit the same points by Huber's estimate.

    Parameters
    ----------
    refit : applied to each fit, for a constraint.

    Raises
    ------
    DataError : no degrees of freedom are left to judge a point by, or the iteration does not converge.
    """
    if calibration.dof < 1:
        raise DataError("there are as many coefficients as points: no point can be judged", "Measure more points.")
    x, y, given, whole = calibration.x, calibration.y, calibration.fit.weights, calibration.fit
    found, root = calibration, np.sqrt(given)
    for _ in range(ITERATIONS):
        scale = _scale(root * found.residuals, calibration.dof)
        if not scale > CONVERGED * float(np.ptp(y)):
            return RobustFit(RobustMethod.HUBER, calibration, (), np.ones(y.size, dtype=bool))  # an exact fit
        weights = _huber_weights(root * found.residuals / scale)
        before = found.residuals
        u = 1.0 / np.sqrt(given * weights)
        found = refit(fit_calibration(x, y, calibration.degree, standard_uncertainty=u))
        if np.abs(found.residuals - before).max() <= CONVERGED * scale:
            break
    else:
        raise DataError("Huber's iteration does not converge", "Leave points out instead.")
    scale = _scale(root * found.residuals, calibration.dof)
    standard = root * found.residuals / scale
    weights = _huber_weights(standard)
    found = with_solution(
        calibration, found.fit.basis_coefficients, whole.basis_factor, whole.leverage, weights=given * weights,
        sd=_huber_sd(standard, scale, calibration), zero_constant=whole.basis_factor.shape[1] <= calibration.degree,
    )  # fmt: skip
    trail = tuple(
        Downweighted(
            int(i), float(x[i]), float(y[i]), float(found.residuals[i]), float(weights[i]),
            f"{abs(standard[i]):.1f} robust standard deviations off",
        )
        for i in np.flatnonzero(weights < 1.0)
    )  # fmt: skip
    kept = np.ones(y.size, dtype=bool)
    return RobustFit(RobustMethod.HUBER, replace(found, fit=replace(found.fit, weights=given)), trail, kept)


def _huber_weights(standard: FloatArray) -> FloatArray:
    return np.asarray(np.minimum(1.0, HUBER_K / np.maximum(np.abs(standard), HUBER_K)), dtype=np.float64)


def _scale(residuals: FloatArray, dof: int) -> float:
    """Robust sd of the residuals, about zero, for the degrees of freedom that the fit took."""
    middle = robust_sd(np.concatenate([residuals, -residuals]))
    return float(middle * np.sqrt(residuals.size / dof))


def _huber_sd(standard: FloatArray, scale: float, calibration: Calibration) -> float:
    """The sd that gives Huber's asymptotic covariance with the factor of the unweighted fit (Huber 1981, 7.6)."""
    n, parameters = standard.size, calibration.n - calibration.dof
    inside = np.abs(standard) <= HUBER_K
    mean_slope = float(inside.mean())
    if not mean_slope > 0:
        return float("nan")
    correction = 1.0 + parameters / n * float(inside.var()) / mean_slope**2
    psi = np.clip(standard, -HUBER_K, HUBER_K)
    return float(correction * scale * np.sqrt(float(psi @ psi) / (n - parameters)) / mean_slope)


def leave_out(calibration: Calibration, refit: Callable[[Calibration], Calibration] = lambda fit: fit) -> RobustFit:
    """Fit the points without those that are off the curve.

    Parameters
    ----------
    refit : applied to each fit, for a constraint.
    """
    kept = np.ones(calibration.n, dtype=bool)
    trail: list[Downweighted] = []
    found = calibration
    while (~kept).sum() < calibration.n // MOST_LEFT_OUT:
        rows = np.flatnonzero(kept)
        studentised = studentised_residuals(found)
        if not np.isfinite(studentised).any():
            break
        worst = int(np.nanargmax(studentised))
        chance = rows.size * 2.0 * float(stats.t.sf(studentised[worst], found.dof - 1))
        if not chance < CHANCE:
            break
        row = int(rows[worst])
        after = kept.copy()
        after[row] = False
        try:
            found = refit(_of_points(calibration, after))
        except BoatDaqError:
            break  # the rest does not carry the degree: the point stays
        kept = after
        off = float(calibration.y[row] - found.predict(calibration.x[row]))
        reason = f"{studentised[worst]:.1f} standard deviations off the others, chance {chance:.1g}"
        trail.append(Downweighted(row, float(calibration.x[row]), float(calibration.y[row]), off, 0.0, reason))
    return RobustFit(RobustMethod.LEAVE_OUT, found, tuple(trail), kept)


def studentised_residuals(calibration: Calibration) -> FloatArray:
    """Return |residual| of each point in standard deviations of a fit without it; NaN where that cannot be given."""
    fit, dof = calibration.fit, calibration.dof
    left = 1.0 - fit.leverage
    largest = float(np.abs(calibration.y).max(initial=0.0))
    if dof < 2 or not calibration.residual_sd > 1e-12 * largest:
        return np.full(calibration.n, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        own = fit.weights * fit.residuals**2 / left
        rest = np.maximum(dof * calibration.residual_sd**2 - own, 0.0) / (dof - 1)
        return np.asarray(np.where(left < 1e-9, np.nan, np.sqrt(own / rest)), dtype=np.float64)


def _of_points(calibration: Calibration, kept: BoolArray) -> Calibration:
    weights = calibration.fit.weights[kept]
    u = None if np.all(weights == 1.0) else 1.0 / np.sqrt(weights)
    return fit_calibration(calibration.x[kept], calibration.y[kept], calibration.degree, standard_uncertainty=u)
