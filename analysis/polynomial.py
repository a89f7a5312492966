"""Least squares by polynomials without loss of digits.

x is centred and scaled to -1..1, the basis is Legendre's, QR solves it, and the solution is refined with residuals in
extended precision (Björck 1967; Golub and Van Loan, Matrix Computations, 5.3.8). The change to monomials, where the
digits are lost, is done once and exactly, in rational arithmetic. No normal equations, no raw Vandermonde matrix; an x
that cannot carry the degree is refused with the reason.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre
from scipy import linalg

from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError, RequestError

LongArray = npt.NDArray[np.longdouble]

MAX_DEGREE = 10
MAX_CONDITION = 1e8  # of the scaled basis: beyond it the x are clustered and fewer than 8 digits are left
REFINEMENTS = 4


@dataclass(frozen=True, slots=True)
class ScaledBasis:
    """Legendre polynomials of u = (x - centre) / half_width, degrees 0 to `degree`."""

    centre: float
    half_width: float
    degree: int

    @classmethod
    def spanning(cls, x: FloatArray, degree: int) -> ScaledBasis:
        """Return the basis in which `x` spans -1..1."""
        low, high = float(x.min()), float(x.max())
        return cls(low + (high - low) / 2, (high - low) / 2, degree)

    def scaled(self, x: npt.ArrayLike) -> FloatArray:
        return (np.asarray(x, dtype=np.float64) - self.centre) / self.half_width

    def design(self, x: npt.ArrayLike) -> FloatArray:
        u = self.scaled(x)
        rows = legendre.legvander(u.ravel(), self.degree)
        return np.asarray(rows, dtype=np.float64).reshape(*u.shape, self.degree + 1)

    def slope_design(self, x: npt.ArrayLike) -> FloatArray:
        u = self.scaled(x)
        return legendre_slopes(u.ravel(), self.degree).reshape(*u.shape, self.degree + 1) / self.half_width

    def to_monomials(self) -> list[list[Fraction]]:
        """Return T, exact, with monomial coefficients = T @ basis coefficients."""
        size = self.degree + 1
        shift, scale = Fraction(self.centre), Fraction(self.half_width)
        u = [-shift / scale, 1 / scale]  # u as a polynomial of x
        zero, columns = Fraction(0), [[Fraction(1)]]
        if size > 1:
            columns.append(u)
        for k in range(1, size - 1):  # (k+1) P_{k+1} = (2k+1) u P_k - k P_{k-1}
            terms = zip([*columns[k], zero], [zero, *columns[k]], [*columns[k - 1], zero, zero], strict=True)
            columns.append([((2 * k + 1) * (u[0] * c + u[1] * low) - k * b) / (k + 1) for c, low, b in terms])
        return [[column[row] if row < len(column) else zero for column in columns] for row in range(size)]


@dataclass(frozen=True, slots=True)
class LeastSquares:
    """A solved fit, in the basis and in monomials; `weights` [n], the largest 1; `residuals` unweighted.

    `basis_factor` [p, p] is R^-1: s^2 R^-1 R^-T is the covariance of basis coefficients. `monomial_factor` is T R^-1.
    """

    basis: ScaledBasis
    basis_coefficients: FloatArray
    coefficients: FloatArray
    basis_factor: FloatArray
    monomial_factor: FloatArray
    residuals: FloatArray
    leverage: FloatArray
    condition: float
    weights: FloatArray

    def rows(self, x: npt.ArrayLike) -> FloatArray:
        return self.basis.design(x)

    def slope_rows(self, x: npt.ArrayLike) -> FloatArray:
        return self.basis.slope_design(x)

    def predict(self, x: npt.ArrayLike) -> FloatArray:
        """Return y(x), evaluated in the scaled basis."""
        return np.asarray(legendre.legval(self.basis.scaled(x), self.basis_coefficients), dtype=np.float64)

    def slope(self, x: npt.ArrayLike) -> FloatArray:
        derivative = legendre.legder(self.basis_coefficients)
        return np.asarray(legendre.legval(self.basis.scaled(x), derivative), dtype=np.float64) / self.basis.half_width


def legendre_slopes(u: FloatArray, degree: int) -> FloatArray:
    """Return the derivatives of Legendre's polynomials, [points, degree + 1]."""
    return np.asarray(legendre.legvander(u, max(degree - 1, 0)) @ _derivatives(degree))


@functools.cache
def _derivatives(degree: int) -> FloatArray:
    """[degree, degree + 1]: of each polynomial in those of lower degree; P'_n is the sum of (2k + 1) P_k, n - k odd."""
    lower, whole = np.arange(max(degree, 1))[:, None], np.arange(degree + 1)
    return np.where((lower < whole) & ((whole - lower) % 2 == 1), 2.0 * lower + 1.0, 0.0)


def least_squares(
    x: FloatArray,
    y: FloatArray,
    degree: int,
    weights: FloatArray | None = None,
    ends: tuple[float, float] | None = None,
) -> LeastSquares:
    """Fit a polynomial of `degree` 0 to 10 through (x, y), [n] each, minimising sum w (y - f)^2, weights 1 by default.

    `ends` are mapped to -1 and 1, by default those of x. RequestError: a degree or weights that are not allowed.
    DataError: NaN or Inf, different lengths, too few distinct x, all x equal, or x too clustered.
    """
    _check(x, y, degree, weights)
    spanned = x if ends is None else np.asarray(ends)
    basis = ScaledBasis.spanning(spanned, degree) if np.ptp(x) > 0 else ScaledBasis(float(x[0]), 1.0, degree)
    root = np.ones_like(y) if weights is None else np.sqrt(weights / weights.max())
    long_design = _long_design(basis, x) * root[:, None]
    design = long_design.astype(np.float64)
    q, r = linalg.qr(design, mode="economic")
    condition = float(np.linalg.cond(r))
    if not condition < MAX_CONDITION:
        cause = f"the x are too clustered for degree {degree} (condition {condition:.0e})"
        raise DataError(cause, "Spread the points over the range, or choose a lower degree.")
    target = (y * root).astype(np.longdouble)
    solution: LongArray = np.zeros(degree + 1, dtype=np.longdouble)
    for _ in range(REFINEMENTS):
        remaining = (target - long_design @ solution).astype(np.float64)
        solution = solution + linalg.solve_triangular(r, q.T @ remaining)
    residuals = ((target - long_design @ solution) / root).astype(np.float64)
    change = basis.to_monomials()
    factor = linalg.solve_triangular(r, np.eye(degree + 1))
    coefficients = solution.astype(np.float64), _exact_product(change, solution)
    factors = factor, (_as_long(change) @ factor.astype(np.longdouble)).astype(np.float64)
    leverage = np.einsum("ij,ij->i", q, q)
    return LeastSquares(basis, *coefficients, *factors, residuals, leverage, condition, root**2)


def with_coefficients(fit: LeastSquares, x: FloatArray, y: FloatArray, basis_coefficients: FloatArray) -> LeastSquares:
    """Return the fit with other coefficients, [degree + 1] in the scaled basis; x and y are its points, [n]."""
    change = fit.basis.to_monomials()
    return replace(
        fit,
        basis_coefficients=basis_coefficients,
        coefficients=_exact_product(change, basis_coefficients.astype(np.longdouble)),
        residuals=y - fit.basis.design(x) @ basis_coefficients,
    )


def _long_design(basis: ScaledBasis, x: FloatArray) -> LongArray:
    u = (x.astype(np.longdouble) - np.longdouble(basis.centre)) / np.longdouble(basis.half_width)
    columns = [np.ones_like(u), u][: basis.degree + 1]
    for k in range(1, basis.degree):
        columns.append(((2 * k + 1) * u * columns[k] - k * columns[k - 1]) / np.longdouble(k + 1))
    return np.stack(columns, axis=1)


def _as_long(matrix: list[list[Fraction]]) -> LongArray:
    def long(value: Fraction) -> np.longdouble:
        high = float(value)
        return np.longdouble(high) + np.longdouble(float(value - Fraction(high)))

    return np.array([[long(v) for v in row] for row in matrix], dtype=np.longdouble)


def _exact_product(matrix: list[list[Fraction]], vector: LongArray) -> FloatArray:
    exact = []
    for value in vector:
        high = float(value)
        exact.append(Fraction(high) + Fraction(float(value - np.longdouble(high))))
    return np.array([float(sum(m * v for m, v in zip(row, exact, strict=True))) for row in matrix])


def _check(x: FloatArray, y: FloatArray, degree: int, weights: FloatArray | None) -> None:
    if not (isinstance(degree, int | np.integer) and 0 <= degree <= MAX_DEGREE):
        raise RequestError(f"degree {degree} is not between 0 and {MAX_DEGREE}", "Degree 3 is the usual one.")
    if x.ndim != 1 or x.shape != y.shape or (weights is not None and weights.shape != x.shape):
        raise DataError(f"x and y have different lengths ({x.size} and {y.size})", "Give one y for each x.")
    for name, values in (("x", x), ("y", y)):
        bad = int((~np.isfinite(values)).sum())
        if bad:
            raise DataError(f"{bad} of {values.size} values of {name} are not numbers (NaN or Inf)", "Leave them out.")
    if weights is not None and not (np.isfinite(weights).all() and (weights > 0).all()):
        raise RequestError("a weight is not a positive number", "Give the standard uncertainty of every point.")
    distinct = np.unique(x).size
    if distinct == 1 and degree > 0:
        raise DataError(f"all {x.size} x are equal ({x[0]:g})", "Give points at different x.")
    if distinct < degree + 1:
        cause = f"only {distinct} different positions; degree {degree} needs {degree + 1}"
        raise DataError(cause, "Measure at more positions, or choose a lower degree.")
