"""Points off the curve are left out one by one, each with its residual and reason.

Strategy: the point with the largest externally studentised residual is left out as long as Student's t with
Bonferroni's bound rejects it, at most a quarter of the points; the rest is fitted again each time. Source: R. D. Cook,
S. Weisberg, Residuals and Influence in Regression, 1982, 2.2.2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats

from analysis.calibration.fit import Calibration, fit_calibration
from protocol.base.arrays import BoolArray, FloatArray
from protocol.base.errors import BoatDaqError

_CHANCE = 0.02  # that a sound set of points loses one
MOST_LEFT_OUT = 4  # one point in so many


@dataclass(frozen=True, slots=True)
class LeftOutPoint:
    """A point that is left out: its row among the points from 0, its residual from the curve of the others, and why."""

    row: int
    x: float
    y: float
    residual: float
    reason: str


@dataclass(frozen=True, slots=True)
class ReducedFit:
    """A calibration of the points kept, [n] True, and the others in the order in which they were left out."""

    calibration: Calibration
    left_out: tuple[LeftOutPoint, ...]
    kept: BoolArray


def leave_out(calibration: Calibration, refit: Callable[[Calibration], Calibration] = lambda fit: fit) -> ReducedFit:
    """Fit the points without those that are off the curve; `refit` applies a constraint to each fit."""
    kept = np.ones(calibration.n, dtype=bool)
    left: list[LeftOutPoint] = []
    found = calibration
    while (~kept).sum() < calibration.n // MOST_LEFT_OUT:
        rows = np.flatnonzero(kept)
        studentised = studentised_residuals(found)
        if not np.isfinite(studentised).any():
            break
        worst = int(np.nanargmax(studentised))
        chance = rows.size * 2.0 * float(stats.t.sf(studentised[worst], found.dof - 1))
        if not chance < _CHANCE:
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
        left.append(LeftOutPoint(row, float(calibration.x[row]), float(calibration.y[row]), off, reason))
    return ReducedFit(found, tuple(left), kept)


def studentised_residuals(calibration: Calibration) -> FloatArray:
    """Return |residual| of each point in standard deviations of a fit without it; NaN where that cannot be given."""
    fit, dof = calibration.fit, calibration.dof
    left = 1.0 - fit.leverage
    largest = float(np.abs(calibration.y).max(initial=0.0))
    if dof < 2 or not calibration.scatter_sd > 1e-12 * largest:
        return np.full(calibration.n, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        own = fit.weights * fit.residuals**2 / left
        rest = np.maximum(dof * calibration.scatter_sd**2 - own, 0.0) / (dof - 1)
        return np.asarray(np.where(left < 1e-9, np.nan, np.sqrt(own / rest)), dtype=np.float64)


def _of_points(calibration: Calibration, kept: BoolArray) -> Calibration:
    weights = calibration.fit.weights[kept]
    equal = bool(np.all(weights == 1.0))
    return fit_calibration(
        calibration.x[kept], calibration.y[kept], calibration.degree, weights=None if equal else weights
    )
