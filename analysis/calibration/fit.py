"""The calibration: y(x) through the plateaus, with its uncertainty and its range (ISO/TS 28038:2018, 6 and 7).

`analysis.polynomial` solves; this module derives the content of a calibration certificate. `y` evaluates outside
`range` without any warranty; the inverse refuses there (`analysis.calibration.inverse`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre
from scipy import stats

from analysis.calibration.adequacy import Adequacy, expanded, judge_curve
from analysis.calibration.curve_choice import SPLINE, USUAL_DEGREE
from analysis.calibration.joint_fit import JointFit, MonotoneSplineBasis, PolynomialBasis, joint_fit, position_means
from analysis.calibration.quantised_x import Positions, gather
from analysis.json_object import json_object
from analysis.polynomial import LeastSquares, least_squares, with_coefficients
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError, RequestError

SLOPE_POINTS, FLAT = 401, 1e-3  # of the mean slope: a spline that is flatter anywhere has no inverse there
LARGEST = 1e150  # its square is still a number


@dataclass(frozen=True, slots=True, repr=False)
class Calibration:
    """A fitted polynomial y(x) = b0 + b1 x + ..., or a monotone spline."""

    coefficients: FloatArray  # monomial, b0 first, as the errors; empty for a spline
    std_errors: FloatArray
    covariance: FloatArray
    degree: int
    n: int
    r2: float  # share of the (weighted) variance explained; NaN if y does not vary
    adjusted_r2: float
    rmse: float  # over n
    residual_sd: float  # over n - degree - 1; NaN without; the smallest u of y where these were stated
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    turning_points: tuple[float, ...]  # every x where the slope changes sign, inside the range or not
    monotone: bool  # no turning point inside the range, and not flat
    fit: LeastSquares
    x: FloatArray
    y: FloatArray
    reading: Positions | None = None  # error of readings of x on a grid, see `with_reading`; None if x is known
    joint: JointFit | None = None  # the fit by branch that the curve is from; None for a fit through points
    adequacy: Adequacy | None = None
    simulated: bool = False  # whether the points are of a virtual board

    def with_reading(self, reading_sd: float, positions: npt.ArrayLike | None = None) -> Calibration:
        """Return the same curve, of x read with an sd of `reading_sd`; `positions` [n] label what was read."""
        return (
            replace(self, reading=gather(self.fit, self.x, self.y, reading_sd, positions)) if reading_sd > 0 else self
        )

    def __repr__(self) -> str:
        lines = [f"  {name} = {value} ± {u} (k = 2)" for name, value, u in self._terms]
        return "\n".join([f"<{self._heading}", *lines]) + ">"

    def _repr_html_(self) -> str:
        cells = (f"<tr><th>{name}</th><td>{value}</td><td>± {u}</td></tr>" for name, value, u in self._terms)
        head = "<tr><th></th><th>coefficient</th><th>U (k = 2)</th></tr>"
        return f"<b>{self._heading}</b><table>{head}{''.join(cells)}</table>"

    @property
    def _heading(self) -> str:
        mark, curve = "SIMULATED, " if self.simulated else "", "spline" if self.spline else f"degree {self.degree}"
        low, high = self.x_range
        quality = f"R² {self.r2:.5f}, rmse {self.rmse:.3g}"
        return f"Calibration: {mark}{curve}, {self.n} points, x {low:g} to {high:g}, {quality}"

    @property
    def _terms(self) -> list[tuple[str, str, str]]:
        """Return name, value and U of each coefficient, as shown."""
        terms = zip(self.coefficients, self.std_errors_with_reading, strict=True)
        return [(f"b{i}", f"{b:.6g}", f"{2 * u:.2g}") for i, (b, u) in enumerate(terms)]

    def plot(self, ax: Any = None, level: float = 0.95) -> Any:
        """Draw points, curve and band into a Matplotlib axes, a new one by default; return the axes."""
        if ax is None:
            from matplotlib import pyplot

            ax = pyplot.figure().add_subplot()
        grid = np.linspace(*self.x_range, 201)
        ax.fill_between(grid, *self.band(grid, level), alpha=0.3, linewidth=0, label=f"{100 * level:g} % band")
        ax.plot(grid, self.predict(grid), label="calibration")
        ax.plot(self.x, self.y, ".", color="black", label="readings")
        ax.legend()
        return ax

    def as_stated(self, sd: float) -> Calibration:
        """Return the same curve with the covariance of stated uncertainties, `sd` at weight 1, whatever the scatter."""
        covariance = sd**2 * self.fit.monomial_factor @ self.fit.monomial_factor.T
        if self.fit.basis_factor.shape[1] <= self.degree:  # the constant is exactly zero
            covariance[0], covariance[:, 0] = 0.0, 0.0
        return replace(self, std_errors=np.sqrt(np.diag(covariance)), covariance=covariance, residual_sd=sd)

    @property
    def scatter_sd(self) -> float:
        """Standard deviation of the residuals at weight 1, also where uncertainties were stated."""
        squares = float(self.fit.weights @ self.fit.residuals**2)
        return float(np.sqrt(squares / self.dof)) if self.dof > 0 else float("nan")

    @property
    def spline(self) -> MonotoneSplineBasis | None:
        """The knots of a spline; None of a polynomial."""
        basis = self.joint.basis if self.joint is not None else None
        return basis if isinstance(basis, MonotoneSplineBasis) else None

    @property
    def curve(self) -> str:
        """What kind of curve it is, as `analyze --degree` names it."""
        return str(self.degree) if self.spline is None else SPLINE

    @property
    def basis_covariance(self) -> FloatArray:
        """Covariance of the coefficients in the scaled basis, the reading of x included, a loop not."""
        if self.joint is not None:
            return self.joint.whole_curve_covariance
        if self.reading is not None:
            return self.reading.covariance(self.fit)
        return self.residual_sd**2 * self.fit.basis_factor @ self.fit.basis_factor.T

    @property
    def covariance_with_reading(self) -> FloatArray:
        """Covariance of the monomial coefficients, the reading of x included."""
        if (self.reading is None and self.joint is None) or self.spline is not None:
            return self.covariance
        change = np.asarray(self.fit.basis.to_monomials(), dtype=np.float64)
        return np.asarray(change @ self.basis_covariance @ change.T)

    @property
    def std_errors_with_reading(self) -> FloatArray:
        """Standard errors of the coefficients, the reading of x included: those to be stated."""
        if (self.reading is None and self.joint is None) or self.spline is not None:
            return self.std_errors
        return np.asarray(np.sqrt(np.diag(self.covariance_with_reading)))

    @property
    def turns_inside(self) -> tuple[float, ...]:
        """The turning points inside the range."""
        low, high = self.x_range
        return tuple(turn for turn in self.turning_points if low < turn < high)

    @property
    def dof(self) -> int:
        """Degrees of freedom of the residuals; a constraint on the coefficients adds one."""
        return self.n - int(self.fit.basis_factor.shape[1])

    @property
    def r2_interval(self) -> tuple[float, float]:
        """95 % interval of R2, from chi-square of the residual variance; by positions where these are gathered."""
        if self.dof < 1 or not np.isfinite(self.r2):
            return float("nan"), float("nan")
        dof = self.dof if self.reading is None else max(self.reading.n - self.degree - 1, 1)
        low, high = (1.0 - (1.0 - self.r2) * dof / stats.chi2.ppf(share, dof) for share in (0.025, 0.975))
        return float(low), float(high)

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
        return self.fit.predict(x) if self.spline is None or self.joint is None else self.joint.predict(x)

    def slope(self, x: npt.ArrayLike) -> FloatArray:
        """Return dy/dx."""
        return self.fit.slope(x) if self.spline is None or self.joint is None else self.joint.slope(x)

    def curve_sd(self, x: npt.ArrayLike) -> FloatArray:
        """Return the standard error of y(x) from the fit's covariance."""
        rows = self.fit.basis.design(x) @ self.fit.basis_factor
        return np.asarray(self.residual_sd * np.sqrt(np.einsum("...i,...i->...", rows, rows)), dtype=np.float64)

    def curve_u(self, x: npt.ArrayLike) -> FloatArray:
        """Return the standard uncertainty of y(x), the reading of x included; that of the fit where it is known."""
        if self.joint is not None:
            return self.joint.u(x)
        return self.curve_sd(x) if self.reading is None else self._sd(x, self.basis_covariance)

    def deviation(self, x: npt.ArrayLike) -> FloatArray:
        """Return by how much the curve is known to miss at x, in the unit of y: zeros where it is adequate."""
        return np.zeros(np.shape(x)) if self.adequacy is None else self.adequacy.deviation(x)

    def deviation_in_x(self, x: npt.ArrayLike) -> FloatArray:
        """Return by how much an x that is read from the curve is known to miss."""
        return np.zeros(np.shape(x)) if self.adequacy is None else self.adequacy.deviation_in_x(x)

    def expanded_u(self, x: npt.ArrayLike) -> FloatArray:
        """Return U (k = 2) of y(x), with what the curve is known to miss."""
        if self.adequacy is None:
            return 2.0 * self.curve_u(x)
        return expanded(self.adequacy.deviation(x), self.adequacy.average_u(x), 2.0)

    def curve_parts(self, x: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return u of y(x) by the scatter of the signals, and by the reading of x: together `curve_u` of a joint fit.

        For a fit through points, whose covariance takes errors as independent, the second is what positions share.
        """
        if self.joint is not None:
            joint = self.joint
            by_reading = joint.slope_at**2 * joint.means.x_variance
            read = self._sd(x, joint.curve_covariance(by_reading))
            whole = self.curve_u(x) if self.adequacy is None else self.adequacy.average_u(x)
            return np.sqrt(np.maximum(whole**2 - read**2, 0.0)), np.minimum(read, whole)
        if self.reading is not None:
            return self.curve_sd(x), self._sd(x, self.reading.beyond_fit(self.fit))
        return self.curve_sd(x), np.zeros(np.shape(x))

    def _sd(self, x: npt.ArrayLike, covariance: FloatArray) -> FloatArray:
        rows = self.fit.basis.design(x) if self.joint is None else self.joint.basis.design(self.joint.scaled(x))
        rows = rows.reshape(*np.shape(x), covariance.shape[0])
        variance = np.einsum("...i,ij,...j->...", rows, covariance, rows)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)

    def band(
        self, x: npt.ArrayLike, level: float = 0.95, *, new_reading: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper limit of the curve, or of one new reading, at confidence `level`; x of any shape.

        Pointwise, by Student's t with n - degree - 1 degrees of freedom (n counts positions if x was read on a grid),
        or those of the joint fit; widened by the known deviation of the curve. NaN without degrees of freedom.
        """
        spread = self.curve_u(x) if self.adequacy is None else self.adequacy.average_u(x)
        if new_reading:
            spread = np.hypot(spread, self.residual_sd)
        if self.joint is not None:
            dof = self.joint.effective_dof
        else:
            dof = self.dof if self.reading is None else max(self.reading.n - self.degree - 1, min(self.dof, 1))
        factor = stats.t.ppf(0.5 + level / 2, dof) if dof > 0 else float("nan")
        centre, reach = self.predict(x), expanded(self.deviation(x), spread, float(factor))
        return centre - reach, centre + reach

    def as_json(self) -> dict[str, Any]:
        """Return the keys of `fit --json`."""
        arrays = ("coefficients", "std_errors", "covariance", "std_errors_with_reading", "covariance_with_reading")
        scalars = ("r2", "adjusted_r2", "rmse", "residual_sd", "range=x_range", "turning_points", "monotone")
        return json_object(self, "degree", "curve", "n", *arrays, *scalars)


def fit_calibration(
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    degree: int = 3,
    *,
    standard_uncertainty: npt.ArrayLike | None = None,
    weights: npt.ArrayLike | None = None,
) -> Calibration:
    """Fit y(x), a polynomial of `degree` 0 to 10, by (weighted) least squares; x and y are [n].

    `standard_uncertainty`: u of y, [n] or one for all; it alone sets the standard errors, as in `boat-daq fit --u`.
    `weights`: [n] proportional to 1/u^2; only the ratios matter, the residuals set the standard errors. DataError:
    fewer than degree + 1 distinct x, clustered x, NaN. RequestError: degree, uncertainties or weights are not allowed.
    """
    x = np.asarray(x, dtype=np.float64).ravel()
    y = np.asarray(y, dtype=np.float64).ravel()
    stated = None
    if weights is not None:
        weights = np.asarray(weights, dtype=np.float64).ravel()
    if standard_uncertainty is not None:
        if weights is not None:
            raise RequestError("both uncertainties and weights are given", "Give standard_uncertainty or weights.")
        stated = np.asarray(standard_uncertainty, dtype=np.float64).ravel()
        stated = np.full(y.shape, stated[0]) if stated.size == 1 else stated
        weights = weights_of(stated)
    if any(np.abs(v[np.isfinite(v)]).max(initial=0.0) > LARGEST for v in (x, y)):
        raise DataError(f"a value is larger than {LARGEST:g}: its square has no number", "Give it in a larger unit.")
    fit = least_squares(x, y, degree, weights)
    found = _calibration(x, y, fit, (float(x.min()), float(x.max())), weights)
    return found if stated is None else found.as_stated(float(stated.min()))


def weights_of(u: npt.ArrayLike) -> FloatArray:
    """Return the weights 1/u^2, [n]; infinite ones are refused by the fit."""
    with np.errstate(divide="ignore"):
        return np.asarray(1.0 / np.asarray(u, dtype=np.float64).ravel() ** 2, dtype=np.float64)


def fit_by_branch(
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    degree: int | Literal["spline"] = 3,
    *,
    positions: npt.ArrayLike,
    branch: npt.ArrayLike,
    reading_sd: float = 0.0,
    shared: FloatArray | None = None,
) -> Calibration:
    """Fit y(x) and a loop about it to the means of positions that were read repeatedly.

    The range is that of the means at the end levels. Positions too few for the joint fit are fitted by
    `fit_calibration`; raises what it raises. `positions`, `branch`: [n] label of the position of each point; 1 loading,
    -1 unloading, 0 at the shared end levels. `reading_sd`: sd of one reading, the grid / sqrt(12); 0 if x is exact.
    `shared`: [n] error of y that a position has in every cycle alike, see `PositionMeans`.
    """
    usual = USUAL_DEGREE if degree == SPLINE else int(degree)
    plain = fit_calibration(x, y, usual).with_reading(reading_sd, positions)
    if not np.ptp(plain.y) > 0:
        return plain
    try:
        means = position_means(plain.fit, plain.x, plain.y, positions, branch, plain.reading)
        if shared is not None and shared.any():
            means = means.with_shared(shared, positions)
        joint = joint_fit(means, PolynomialBasis(usual))
        if degree == SPLINE:
            joint = joint_fit(means, MonotoneSplineBasis.through(joint.scaled(means.x), falls=not plain.rises))
        if joint.dof < 1:
            return plain
        scaled = least_squares(plain.x, plain.y, usual, ends=means.ends)
    except DataError:
        return plain
    if degree == SPLINE:
        return _spline_calibration(plain, replace(scaled, residuals=plain.y - joint.predict(plain.x)), joint)
    fit = with_coefficients(scaled, plain.x, plain.y, joint.coefficients)
    found = _calibration(plain.x, plain.y, fit, means.ends)
    return replace(found, reading=plain.reading, joint=joint, adequacy=judge_curve(joint))


def _spline_calibration(plain: Calibration, fit: LeastSquares, joint: JointFit) -> Calibration:
    """Return the calibration with a spline's curve; `fit` has its residuals."""
    found = _calibration(plain.x, plain.y, fit, joint.ends)
    slopes = np.abs(joint.slope(np.linspace(*joint.ends, SLOPE_POINTS)))
    none = np.empty(0)
    return replace(
        found, coefficients=none, std_errors=none, covariance=np.empty((0, 0)), turning_points=(),
        monotone=bool(slopes.min() > FLAT * slopes.mean()), reading=plain.reading, joint=joint,
        adequacy=judge_curve(joint),
    )  # fmt: skip


def _calibration(
    x: FloatArray, y: FloatArray, fit: LeastSquares, x_range: tuple[float, float], weights: FloatArray | None = None
) -> Calibration:
    degree = fit.basis.degree
    relative = np.ones_like(y) if weights is None else weights / weights.max()
    squares = float(relative @ fit.residuals**2)
    mean = float(relative @ y / relative.sum())
    total = float(relative @ (y - mean) ** 2)
    dof = x.size - degree - 1
    sd = float(np.sqrt(squares / dof)) if dof > 0 else float("nan")
    turning = turning_points(fit)
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
    """Return every real x where the slope changes sign, ascending; coefficients that are rounding error are dropped."""
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
