"""The calibration: y(x) through the plateaus, with all that one needs to trust it.

Strategy: `analysis.polynomial` solves; this file turns the solution into what a calibration certificate states:
coefficients in the paper's monomials with standard errors and covariance, R2, residuals, range, turning points,
whether the curve is monotone where it is used, and the bands of curve and new reading (ISO/TS 28038:2018, 6 and 7).

Rules: a value; nothing in it changes. Outside `range` nothing is promised: `y` evaluates anywhere, the inverse
refuses (`analysis.calibration.inverse`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre
from scipy import stats

from analysis.arrays import FloatArray
from analysis.calibration.quantised_x import Positions, gather
from analysis.errors import DataError
from analysis.polynomial import LeastSquares, least_squares

LARGEST = 1e150  # its square is still a number
MONOMIAL_ROUNDING = 1e-6  # of the span of y: more is seen in a figure
OUTLIER_CHANCE = 0.02  # of a sound calibration having a point called off
NEAR_TURN = 0.07  # of the range: a turning point this near to an end puts what lies twice as far beyond back inside
EXACT = 1e-9  # of the largest y: what the rounding of an exact fit may leave
HIGHEST_LEVERAGE = 0.85  # beyond it a point's own error goes into the curve, not into its residual


@dataclass(frozen=True, slots=True)
class Calibration:
    """A fitted polynomial y(x) = b0 + b1 x + ... .

    Attributes
    ----------
    coefficients, std_errors : [degree + 1], monomials, b0 first.
    covariance : [degree + 1, degree + 1] of the coefficients.
    r2, adjusted_r2 : share of the (weighted) variance explained; NaN where y does not vary.
    rmse : sqrt(sum of squared residuals / n).
    residual_sd : sqrt(sum of squared residuals / (n - degree - 1)); NaN without degrees of freedom.
    x_range, y_range : of the data.
    turning_points : every x where the slope is zero and changes sign, inside the range or not.
    monotone : no turning point inside the range, and not flat.
    fit : the solution in its scaled basis.
    x, y : the data.
    reading : what reading x on a grid leaves unknown, see `with_reading`; None where x is known.
    """

    coefficients: FloatArray
    std_errors: FloatArray
    covariance: FloatArray
    degree: int
    n: int
    r2: float
    adjusted_r2: float
    rmse: float
    residual_sd: float
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    turning_points: tuple[float, ...]
    monotone: bool
    fit: LeastSquares
    x: FloatArray
    y: FloatArray
    reading: Positions | None = None

    def with_reading(self, reading_sd: float, positions: npt.ArrayLike | None = None) -> Calibration:
        """Return the same curve, of x that were read with an sd of `reading_sd` (a grid / sqrt(12)).

        `positions` [n] label what was read; points of one label share what the grid rounds alike.
        """
        return (
            replace(self, reading=gather(self.fit, self.x, self.y, reading_sd, positions)) if reading_sd > 0 else self
        )

    @property
    def basis_covariance(self) -> FloatArray:
        """Covariance of the coefficients in the scaled basis, the reading of x included."""
        if self.reading is not None:
            return self.reading.covariance(self.fit)
        return self.residual_sd**2 * self.fit.basis_factor @ self.fit.basis_factor.T

    @property
    def covariance_with_reading(self) -> FloatArray:
        """Covariance of the monomial coefficients, the reading of x included."""
        change = np.asarray(self.fit.basis.to_monomials(), dtype=np.float64)
        return np.asarray(change @ self.basis_covariance @ change.T) if self.reading is not None else self.covariance

    @property
    def std_errors_with_reading(self) -> FloatArray:
        """Standard errors of the coefficients, the reading of x included: those to be stated."""
        return np.asarray(np.sqrt(np.diag(self.covariance_with_reading))) if self.reading else self.std_errors

    @property
    def dof(self) -> int:
        """Degrees of freedom of the residuals."""
        return self.n - self.degree - 1

    @property
    def residuals(self) -> FloatArray:
        """[n] observed minus fitted."""
        return self.fit.residuals

    @property
    def full_scale(self) -> float:
        """|y(x_max) - y(x_min)| of the fitted curve."""
        low, high = self.predict(np.asarray(self.x_range))
        return abs(float(high - low))

    @property
    def rises(self) -> bool:
        """True where y grows with x over the range, from end to end."""
        low, high = self.predict(np.asarray(self.x_range))
        return bool(high > low)

    def predict(self, x: npt.ArrayLike) -> FloatArray:
        """Return y(x), evaluated in the scaled basis."""
        return self.fit.predict(x)

    def slope(self, x: npt.ArrayLike) -> FloatArray:
        """Return dy/dx."""
        return self.fit.slope(x)

    def curve_sd(self, x: npt.ArrayLike) -> FloatArray:
        """Return the standard error of y(x) from the fit's covariance."""
        rows = self.fit.basis.design(x) @ self.fit.basis_factor
        return np.asarray(self.residual_sd * np.sqrt(np.einsum("...i,...i->...", rows, rows)), dtype=np.float64)

    def curve_u(self, x: npt.ArrayLike) -> FloatArray:
        """Return the standard uncertainty of y(x), the reading of x included; that of the fit where it is known."""
        if self.reading is None:
            return self.curve_sd(x)
        rows = self.fit.basis.design(x)
        return np.asarray(np.sqrt(np.einsum("...i,ij,...j->...", rows, self.basis_covariance, rows)), dtype=np.float64)

    def band(
        self, x: npt.ArrayLike, level: float = 0.95, *, new_reading: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper limit of the curve, or of one new reading, at confidence `level`.

        Student's t with n - degree - 1 degrees of freedom, or as many fewer as there are positions where x was read on
        a grid; pointwise, not simultaneous. NaN where there are none.
        """
        spread = self.curve_u(x)
        if new_reading:
            spread = np.hypot(spread, self.residual_sd)
        dof = self.dof if self.reading is None else max(self.reading.n - self.degree - 1, min(self.dof, 1))
        factor = stats.t.ppf(0.5 + level / 2, dof) if dof > 0 else float("nan")
        centre = self.predict(x)
        return centre - factor * spread, centre + factor * spread

    def as_json(self) -> dict[str, Any]:
        """Return the keys of `fit --json`."""
        return {
            "degree": self.degree,
            "n": self.n,
            "coefficients": self.coefficients.tolist(),
            "std_errors": self.std_errors.tolist(),
            "covariance": self.covariance.tolist(),
            "std_errors_with_reading": self.std_errors_with_reading.tolist(),
            "covariance_with_reading": self.covariance_with_reading.tolist(),
            "r2": self.r2,
            "adjusted_r2": self.adjusted_r2,
            "rmse": self.rmse,
            "residual_sd": self.residual_sd,
            "range": list(self.x_range),
            "turning_points": list(self.turning_points),
            "monotone": self.monotone,
        }


@dataclass(frozen=True, slots=True)
class Words:
    """How points and units of a calibration are called; without words a point is its x and y, bare."""

    point: Callable[[int], str] | None = None
    x_unit: str = ""
    y_unit: str = ""

    def at(self, calibration: Calibration, i: int, *, both: bool = False) -> str:
        """Return the name of point `i`."""
        if self.point is not None:
            return self.point(i)
        y = f", y = {calibration.y[i]:.6g}" if both else ""
        return f"the point at x = {calibration.x[i]:.4g}{y}"

    def x(self, value: str) -> str:
        """Return a value of x with its unit."""
        return f"{value} {self.x_unit}".strip()

    def y(self, value: str) -> str:
        """Return a value of y with its unit."""
        return f"{value} {self.y_unit}".strip()


NO_WORDS = Words()


def reservations(calibration: Calibration, words: Words = NO_WORDS) -> tuple[str, ...]:
    """Say what a reader of the numbers alone would not see, one sentence each; none where all is well."""
    said = []
    value, last = calibration.y_range
    if value == last and calibration.n > 1 and calibration.degree > 0:
        said.append(f"y is constant, {words.y(f'{value:.6g}')} at all {calibration.n} points: it does not answer to x")
        return tuple(said)
    if calibration.dof < 1:
        said.append(f"{calibration.n} points for {calibration.degree + 1} coefficients: no uncertainty can be given")
    powers = np.vander(calibration.x, calibration.degree + 1, increasing=True)
    rounding = float(np.abs(powers @ calibration.coefficients - calibration.predict(calibration.x)).max())
    span = calibration.y_range[1] - calibration.y_range[0]
    if rounding > MONOMIAL_ROUNDING * span and rounding > 1e-12 * max(np.abs(calibration.y_range)):
        said.append(
            f"the coefficients b0, b1, ... give the curve only to {words.y(f'{rounding:.2g}')}: x lies far from zero "
            f"for its range; fit x - {calibration.fit.basis.centre:g} instead"
        )
    return (*said, *_near_turns(calibration, words), *_suspect_points(calibration, words))


def _near_turns(calibration: Calibration, words: Words) -> list[str]:
    """Say where the curve turns so near to its range that an x beyond the turn would read as one inside."""
    low, high = calibration.x_range
    near = NEAR_TURN * (high - low)
    return [
        f"the curve turns at x = {words.x(f'{turn:.4g}')}, {words.x(f'{gap:.2g}')} beyond its "
        "range: an x as far on the other side of the turn reads as one inside"
        for turn in calibration.turning_points
        if calibration.monotone and 0.0 <= (gap := max(low - turn, turn - high)) < near
    ]


def _suspect_points(calibration: Calibration, words: Words) -> list[str]:
    """Say which point is off the curve, and which could be off without being seen; none of an exact fit.

    The largest externally studentised residual against Student's t, Bonferroni's bound over all points (R. D. Cook,
    S. Weisberg, Residuals and Influence in Regression, 1982, 2.2.2).
    """
    fit, dof = calibration.fit, calibration.dof
    said = []
    alone = int(np.argmax(fit.leverage))
    if dof > 0 and fit.leverage[alone] > HIGHEST_LEVERAGE and calibration.degree > 0:
        said.append(
            f"{words.at(calibration, alone)} alone holds the curve there (leverage {fit.leverage[alone]:.2f}): "
            "an error in it would not be seen"
        )
    weighted = np.sqrt(fit.weights) * fit.residuals
    left = 1.0 - fit.leverage
    if dof < 2 or not calibration.residual_sd > 1e-12 * np.abs(calibration.y).max() or left.min() < 1e-9:
        return said
    own = weighted**2 / left
    rest = np.maximum(dof * calibration.residual_sd**2 - own, 0.0) / (dof - 1)
    with np.errstate(divide="ignore"):
        studentised = np.sqrt(own / rest)
    worst = int(np.argmax(studentised))
    if calibration.n * 2.0 * float(stats.t.sf(studentised[worst], dof - 1)) < OUTLIER_CHANCE:
        exact = np.sqrt(rest[worst]) <= EXACT * np.abs(calibration.y).max()
        far = "on which all others lie" if exact else f"{studentised[worst]:.1f} of its standard deviations"
        said.append(
            f"{words.at(calibration, worst, both=True)} is {words.y(f'{abs(fit.residuals[worst]):.3g}')} "
            f"off the curve{' ' if exact else ', '}{far}"
        )
    return said


def fit_calibration(
    x: npt.ArrayLike, y: npt.ArrayLike, degree: int = 3, *, standard_uncertainty: npt.ArrayLike | None = None
) -> Calibration:
    """Fit y(x), a polynomial of `degree`, by (weighted) least squares.

    Parameters
    ----------
    x, y : [n], for instance elongation in mm and signal in mV.
    degree : 0 to 10.
    standard_uncertainty : [n] of y; gives weights 1/u^2. The scale of the uncertainties is still taken from the
        residuals, so only their ratios matter.

    Returns
    -------
    Calibration.

    Raises
    ------
    DataError : fewer than degree + 1 distinct x, all x equal, clustered x, NaN; the message says which.
    RequestError : degree or uncertainties outside what the method is defined for.

    Examples
    --------
    >>> fit_calibration([0, 1, 2, 3, 4], [1, 2, 5, 10, 17], degree=2).coefficients.round(12).tolist()
    [1.0, 0.0, 1.0]
    """
    x = np.asarray(x, dtype=np.float64).ravel()
    y = np.asarray(y, dtype=np.float64).ravel()
    weights = None
    if standard_uncertainty is not None:
        with np.errstate(divide="ignore"):
            weights = 1.0 / np.asarray(standard_uncertainty, dtype=np.float64).ravel() ** 2
    if any(np.abs(v[np.isfinite(v)]).max(initial=0.0) > LARGEST for v in (x, y)):
        raise DataError(f"a value is larger than {LARGEST:g}: its square has no number", "Give it in a larger unit.")
    fit = least_squares(x, y, degree, weights)
    relative = np.ones_like(y) if weights is None else weights / weights.max()
    squares = float(relative @ fit.residuals**2)
    mean = float(relative @ y / relative.sum())
    total = float(relative @ (y - mean) ** 2)
    dof = x.size - degree - 1
    sd = float(np.sqrt(squares / dof)) if dof > 0 else float("nan")
    turning = turning_points(fit)
    x_range = (float(x.min()), float(x.max()))
    return Calibration(
        coefficients=fit.coefficients,
        std_errors=sd * np.sqrt(np.einsum("ij,ij->i", fit.monomial_factor, fit.monomial_factor)),
        covariance=sd**2 * fit.monomial_factor @ fit.monomial_factor.T,
        degree=int(degree),
        n=x.size,
        r2=1.0 - squares / total if total > 0 else float("nan"),
        adjusted_r2=1.0 - squares / total * (x.size - 1) / dof if total > 0 and dof > 0 else float("nan"),
        rmse=float(np.sqrt(squares / relative.sum())),
        residual_sd=sd,
        x_range=x_range,
        y_range=(float(y.min()), float(y.max())),
        turning_points=turning,
        monotone=total > 0 and degree > 0 and not any(x_range[0] < t < x_range[1] for t in turning),
        fit=fit,
        x=x,
        y=y,
    )


def turning_points(fit: LeastSquares) -> tuple[float, ...]:
    """Return every real x where the slope changes sign, ascending; none for a straight line or a constant.

    Leading coefficients that are rounding error of the fit are dropped first: a line fitted as a cubic turns nowhere.
    """
    coefficients = fit.basis_coefficients.copy()
    scale = np.abs(coefficients).max()
    while coefficients.size > 1 and abs(coefficients[-1]) <= 1e-12 * scale:
        coefficients = coefficients[:-1]
    derivative = legendre.legder(coefficients)
    if derivative.size < 2:
        return ()
    roots = legendre.legroots(derivative)
    real = np.sort(roots[np.abs(roots.imag) < 1e-7 * (1 + np.abs(roots.real))].real)
    before_after = 1e-5 * (1 + np.abs(real))
    turns = legendre.legval(real - before_after, derivative) * legendre.legval(real + before_after, derivative) < 0
    return tuple(float(u * fit.basis.half_width + fit.basis.centre) for u in real[turns])
