"""Polynomial fits under a constraint: through the origin, or monotone over the range.

y(0) = 0 is one linear equation of the scaled coefficients: the fit is done in its null space, the constant is exactly
zero. Monotone (one sign of the slope over the range) is a least-squares problem with linear inequalities at many x,
solved as least distance by non-negative least squares; the better of rising and falling is kept. Where inequalities
bind, the standard errors are the larger ones of the fit without them. Source: Lawson and Hanson, Solving Least Squares
Problems (1974), chapters 20, 23.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import linalg, optimize

from analysis.calibration.fit import Calibration, turning_points
from analysis.polynomial import LeastSquares
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError

SLOPES = 401  # number of x over the range at which the slope is constrained
_LEAST_SLOPE = 1e-4  # of the mean slope: enough that the curve does not turn between two of these x


def through_zero(calibration: Calibration) -> Calibration:
    """Return the fit of the same points with y(0) = 0; raises DataError for degree 0."""
    if calibration.degree < 1:
        raise DataError("a constant through zero is zero", "Choose a degree of at least 1.")
    free = linalg.null_space(calibration.fit.basis.design(np.zeros(1)))
    root = np.sqrt(calibration.fit.weights)
    design = (root[:, None] * calibration.fit.basis.design(calibration.x)) @ free
    q, r = linalg.qr(design, mode="economic")
    if not np.linalg.cond(r) < 1.0 / np.finfo(float).eps:
        raise DataError("the x other than zero do not determine the degree", "Measure at more positions.")
    solution = linalg.solve_triangular(r, q.T @ (root * calibration.y))
    factor = free @ linalg.solve_triangular(r, np.eye(r.shape[0]))
    return with_solution(calibration, free @ solution, factor, np.einsum("ij,ij->i", q, q), zero_constant=True)


def monotone(calibration: Calibration) -> Calibration:
    """Return the fit of the same points whose slope has one sign; raises DataError if nothing can rise or fall."""
    if calibration.monotone:
        return calibration
    if calibration.degree < 1 or not np.ptp(calibration.y) > 0:
        raise DataError("a constant neither rises nor falls", "Choose a degree of at least 1, or other columns.")
    fits = [_one_sided(calibration, sign) for sign in (1.0, -1.0)]
    found = [fit for fit in fits if fit is not None]
    if not found:
        raise DataError("no monotone curve of this degree was found", "Choose another degree.")
    return min(found, key=lambda one: one.rmse)


def _one_sided(calibration: Calibration, sign: float) -> Calibration | None:
    """Return the best fit with sign * slope above a small positive value at every one of `SLOPES` x."""
    fit, root = calibration.fit, np.sqrt(calibration.fit.weights)
    free = _free_directions(calibration)
    q, r = linalg.qr((root[:, None] * fit.basis.design(calibration.x)) @ free, mode="economic")
    best = linalg.solve_triangular(r, q.T @ (root * calibration.y))
    grid = np.linspace(*calibration.x_range, SLOPES)
    rows = sign * fit.basis.slope_design(grid) @ free @ linalg.solve_triangular(r, np.eye(r.shape[0]))
    low, high = calibration.x_range
    least = _LEAST_SLOPE * float(np.ptp(calibration.y)) / (high - low)
    needed = least - sign * fit.basis.slope_design(grid) @ free @ best
    # least distance: the smallest z with rows z >= needed; the curve is best + R^-1 z
    dual = np.vstack([rows.T, needed[None, :]])
    target = np.append(np.zeros(rows.shape[1]), 1.0)
    weights, _ = optimize.nnls(dual, target, maxiter=50 * SLOPES)
    residual = dual @ weights - target
    if not abs(residual[-1]) > 1e-12:
        return None
    moved = -residual[:-1] / residual[-1]
    solution = free @ (best + linalg.solve_triangular(r, moved))
    found = with_solution(
        calibration, solution, fit.basis_factor, fit.leverage, zero_constant=free.shape[1] < fit.basis.degree + 1
    )
    return found if found.monotone else None


def _free_directions(calibration: Calibration) -> FloatArray:
    """Directions in which the coefficients may move: all, or those that keep y(0) = 0 of a fit through zero."""
    fit = calibration.fit
    if fit.basis_factor.shape[1] == fit.basis.degree + 1:
        return np.eye(fit.basis.degree + 1)
    return np.asarray(linalg.null_space(fit.basis.design(np.zeros(1))), dtype=np.float64)


def with_solution(
    calibration: Calibration,
    basis_coefficients: FloatArray,
    factor: FloatArray,
    leverage: FloatArray,
    *,
    zero_constant: bool = False,
) -> Calibration:
    """Return a calibration of the same points with another solution, [degree + 1] in its scaled basis.

    `factor` is F, [degree + 1, parameters], with the covariance sd^2 F F^T; `leverage` is [n]; `zero_constant` makes
    the constant exactly zero.
    """
    old = calibration.fit
    weights = old.weights
    change = np.asarray(old.basis.to_monomials(), dtype=np.float64)
    coefficients = change @ basis_coefficients
    if zero_constant:
        coefficients[0] = 0.0
    residuals = calibration.y - old.basis.design(calibration.x) @ basis_coefficients
    fit: LeastSquares = replace(
        old, basis_coefficients=basis_coefficients, coefficients=coefficients, basis_factor=factor,
        monomial_factor=change @ factor, residuals=residuals, leverage=leverage,
    )  # fmt: skip
    squares, dof = float(weights @ residuals**2), calibration.n - factor.shape[1]
    mean = float(weights @ calibration.y / weights.sum())
    total = float(weights @ (calibration.y - mean) ** 2)
    sd = float(np.sqrt(squares / dof)) if dof > 0 else float("nan")
    covariance = sd**2 * fit.monomial_factor @ fit.monomial_factor.T
    if zero_constant:
        covariance[0], covariance[:, 0] = 0.0, 0.0
    turns, (low, high) = turning_points(fit), calibration.x_range
    return replace(
        calibration, fit=fit, coefficients=coefficients, covariance=covariance,
        std_errors=np.sqrt(np.diag(covariance)), r2=1.0 - squares / total if total > 0 else float("nan"),
        adjusted_r2=1.0 - squares / total * (calibration.n - 1) / dof if total > 0 and dof > 0 else float("nan"),
        rmse=float(np.sqrt(squares / weights.sum())), residual_sd=sd, turning_points=turns,
        monotone=total > 0 and calibration.degree > 0 and not any(low < turn < high for turn in turns),
    )  # fmt: skip
