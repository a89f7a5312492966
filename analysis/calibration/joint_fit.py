"""The calibration as one joint fit by branch on position means.

A position p (a level of one branch) has the mean reading x_p with a variance u_p^2 and the mean signal y_p with a
variance s_p^2. With z = x mapped to -1..1 over the means at the end levels and B = 1 loading, -1 unloading,
    y_p = f(z_p) + B_p (1 - z_p^2) (c0 + c1 z_p) / 2 + e_p,    variance of e_p = s_p^2 + f'^2 u_p^2 + t^2.
The loop closes at both ends and is not an error of the curve. t^2 is a moment estimate, where no position was read
twice. Sources: GUM (JCGM 100) 5.1.2; R. DerSimonian, N. Laird, Controlled Clinical Trials 7 (1986) 177 (t^2).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre
from scipy import optimize, stats
from scipy.interpolate import BSpline

from analysis.calibration.quantised_x import Positions, common_variance
from analysis.polynomial import LeastSquares, legendre_slopes
from analysis.statistics import bound_between
from protocol.base.arrays import BoolArray, FloatArray
from protocol.base.errors import DataError

ITERATIONS = 8
_LEAST_SLOPE = 0.07  # of the steepest: an error of x acts by no less, or a turn of the curve has no error
_LOOP_TERMS, MORE_LOOP_TERMS = 2, 5
OTHER_SHAPE = 0.001  # chance of such a gain by more terms for a loop of the model's shape
SUSPECTED = 0.2  # chance of such means for the right curve: no evidence yet, but a misfit may hide in it
_EXACT = 1e-10  # of the largest |y|: less is the rounding of the arithmetic
WIDTH_POINTS = 101
WIDTH_DRAWS = 512


@dataclass(frozen=True, slots=True)
class PositionMeans:
    """Means over the readings of each position, [positions]."""

    x: FloatArray
    y: FloatArray
    branch: FloatArray  # 1 loading, -1 unloading, 0 at the end levels, which both share
    x_variance: FloatArray  # of the mean, from the scatter within positions and the grid
    y_variance: FloatArray
    dof: int  # degrees of freedom of that scatter; 0 if no position was read twice
    independent: bool = True  # False if most of the error is the rounding that a position has in every cycle
    shared: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def ends(self) -> tuple[float, float]:
        """The means at the two end levels; the outermost means where the ends were not read."""
        at_end = self.x[self.branch == 0]
        chosen = at_end if at_end.size > 1 and np.ptp(at_end) > 0.5 * np.ptp(self.x) else self.x
        return float(chosen.min()), float(chosen.max())

    @property
    def inside(self) -> BoolArray:
        """[positions] True between the end levels."""
        low, high = self.ends
        return (self.x > low) & (self.x < high)

    @property
    def inner_pairs(self) -> int:
        """Number of inner positions on the branch that has fewer of them."""
        return min(int((self.inside & (self.branch == b)).sum()) for b in (-1, 1))

    @property
    def own_variance(self) -> FloatArray:
        """[positions] `y_variance` without what is shared."""
        return np.maximum(self.y_variance - self.shared**2, 0.0) if self.shared.size else self.y_variance

    def with_shared(self, shared: FloatArray, positions: npt.ArrayLike) -> PositionMeans:
        """Return the means with an error of y that is fully correlated, [n] of the points with these labels."""
        _, first = np.unique(np.asarray(positions), return_index=True)
        return replace(self, y_variance=self.y_variance + shared[first] ** 2, shared=shared[first])

    def loop_terms(self) -> int:
        """Return how many terms of the loop are fitted: each takes an inner position on either branch."""
        return min(self.inner_pairs, _LOOP_TERMS)


def position_means(
    fit: LeastSquares,
    x: FloatArray,
    y: FloatArray,
    positions: npt.ArrayLike,
    branch: npt.ArrayLike,
    reading: Positions | None = None,
) -> PositionMeans:
    """Return the means over the readings of each position; `fit` gives the slope, `reading` None means exact x."""
    labels, first, of_point = np.unique(np.asarray(positions), return_index=True, return_inverse=True)
    of_point = of_point.reshape(-1)
    count = np.bincount(of_point)
    dof = x.size - labels.size
    dof = dof if 2 * dof >= labels.size else 0  # the scatter of a few pairs is no estimate: the misfit has it then
    of_branch = np.asarray(branch, dtype=np.float64)[first]
    if reading is not None:
        whole, none = reading.grid**2 / 12.0, np.zeros(count.size)
        shared = common_variance(reading.reader_sd, reading.grid) if dof else whole
        own = (reading.reader_sd**2 + whole - shared) / count if dof else none  # of the mean: it is no estimate by L_p
        y_variance = reading.mean_variance if dof else none
        return PositionMeans(reading.x, reading.y, of_branch, own + shared, y_variance, dof, shared < own.mean())
    mean_x, mean_y = (np.bincount(of_point, v) / count for v in (x, y))
    off = y - mean_y[of_point] - fit.slope(mean_x)[of_point] * (x - mean_x[of_point])
    scatter = float(off @ off) / dof if dof > 0 else 0.0
    return PositionMeans(mean_x, mean_y, of_branch, np.zeros(count.size), scatter / count, dof)


class CurveBasis(Protocol):
    """A family of curves of z = -1..1, linear in its coefficients."""

    @property
    def complexity(self) -> int:
        """Number of coefficients."""

    def design(self, z: npt.ArrayLike) -> FloatArray:
        """Return the design matrix [points, coefficients]."""

    def slope_design(self, z: npt.ArrayLike) -> FloatArray:
        """Return its derivative by z."""

    def constrained(self, loop_terms: int) -> BoolArray | None:
        """[coefficients and loop terms] True where a coefficient may not be negative; None where all are free."""


@dataclass(frozen=True, slots=True)
class PolynomialBasis:
    """Legendre polynomials up to `degree`."""

    degree: int

    @property
    def complexity(self) -> int:
        return self.degree + 1

    def design(self, z: npt.ArrayLike) -> FloatArray:
        return np.asarray(legendre.legvander(np.atleast_1d(np.asarray(z, dtype=np.float64)), self.degree))

    def slope_design(self, z: npt.ArrayLike) -> FloatArray:
        return legendre_slopes(np.atleast_1d(np.asarray(z, dtype=np.float64)), self.degree)

    def constrained(self, loop_terms: int) -> None:
        """All coefficients are free."""


@dataclass(frozen=True, slots=True)
class JointFit:
    """The fitted curve over z = (x - centre) / half_width and its loop, c0 and c1, with the covariance of both."""

    basis: CurveBasis
    centre: float
    half_width: float
    coefficients: FloatArray
    loop: FloatArray
    influence: FloatArray  # [curve and loop, positions] d coefficients / d y_p; zero rows where a constraint holds
    known_variance: FloatArray  # [positions] variance of y_p about the curve by scatter and reading
    misfit_sd: float  # t, the scatter of positions that were read once about the model
    residuals: FloatArray  # [positions] of y
    leverage: FloatArray  # [positions]
    slope_at: FloatArray  # [positions] of the branch of each
    means: PositionMeans

    @property
    def ends(self) -> tuple[float, float]:
        return self.means.ends

    @property
    def dof(self) -> int:
        """Positions less free coefficients."""
        return self.means.x.size - int((np.abs(self.influence).sum(axis=1) > 0).sum())

    @property
    def chi_squared(self) -> float:
        """Of the position means about the model, in their known variances; infinite where these are zero."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return float((self.residuals**2 / self.known_variance).sum())

    @property
    def variance(self) -> FloatArray:
        """[positions] of y_p about the curve, all causes together."""
        return self.known_variance + self.misfit_sd**2

    @property
    def covariance(self) -> FloatArray:
        """Of the coefficients of curve and loop."""
        return self._propagated(self.influence)

    def _propagated(self, influence: FloatArray) -> FloatArray:
        """Return the covariance of coefficients with such an influence."""
        root = self.root(influence)
        return np.asarray(root @ root.T)

    def root(self, influence: FloatArray) -> FloatArray:
        """Return what independent normal errors of sd 1 move coefficients with such an influence by."""
        if not self.means.shared.size:
            return np.asarray(influence * np.sqrt(self.variance))
        own = np.sqrt(np.maximum(self.variance - self.means.shared**2, 0.0))
        return np.column_stack([influence * own, influence @ self.means.shared])

    @property
    def effective_dof(self) -> float:
        """Degrees of freedom of the variances: of the scatter within positions, and of the misfit between them."""
        share = float(np.mean(self.misfit_sd**2 / self.variance)) if self.misfit_sd > 0 else 0.0
        by_scatter = self.means.y_variance + self.means.independent * self.slope_at**2 * self.means.x_variance
        estimated = float(np.mean(by_scatter / self.variance))  # rounding that is shared is known by the grid
        of_scatter = estimated**2 / self.means.dof if self.means.dof > 0 else 0.0
        of_misfit = share**2 / self.dof if self.dof > 0 else 0.0
        return 1.0 / (of_scatter + of_misfit) if of_scatter + of_misfit > 0 else float("inf")

    def scaled(self, x: npt.ArrayLike) -> FloatArray:
        return (np.asarray(x, dtype=np.float64) - self.centre) / self.half_width

    def rows(self, x: npt.ArrayLike) -> FloatArray:
        """Return the rows of the curve's design at x, [points, coefficients]."""
        return self.basis.design(self.scaled(x).ravel())

    def predict(self, x: npt.ArrayLike) -> FloatArray:
        """Return the curve, the middle between the branches."""
        return np.asarray(self.rows(x) @ self.coefficients).reshape(np.shape(x))

    def slope_rows(self, x: npt.ArrayLike) -> FloatArray:
        """Return the rows of its derivative by x, [points, coefficients]."""
        return self.basis.slope_design(self.scaled(x).ravel()) / self.half_width

    def slope(self, x: npt.ArrayLike) -> FloatArray:
        return np.asarray(self.slope_rows(x) @ self.coefficients).reshape(np.shape(x))

    @property
    def whole_curve_covariance(self) -> FloatArray:
        """Of the curve's coefficients, by all errors of the position means."""
        return self._propagated(self.influence[: self.coefficients.size])

    def curve_covariance(self, variance: FloatArray) -> FloatArray:
        """Return the covariance of the curve's coefficients that independent errors of the position means make."""
        part = self.influence[: self.coefficients.size]
        return np.asarray((part * variance) @ part.T)

    def u(self, x: npt.ArrayLike) -> FloatArray:
        rows, covariance = self.rows(x), self.whole_curve_covariance
        variance = np.einsum("ij,jk,ik->i", rows, covariance, rows)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0))).reshape(np.shape(x))

    def prediction_errors(self) -> FloatArray:
        """[inner positions] error of predicting each from the others, r / (1 - h)."""
        inside = self.means.inside
        return np.asarray((self.residuals / np.maximum(1.0 - self.leverage, 0.05))[inside])

    def between_positions_sd(self) -> float:
        """Return by how much positions that are left out are predicted worse than their own scatter allows."""
        inside, left = self.means.inside, np.maximum(1.0 - self.leverage, 0.05)
        if not inside.any():
            return 0.0
        excess = float(np.mean(self.prediction_errors() ** 2 - (self.known_variance / left)[inside]))
        return float(np.sqrt(max(excess, 0.0)))

    def draws(self, rng: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray]:
        """Draw coefficients [count, coefficients] within the errors, and the ends of their range [count, 2]."""
        means, size = self.means, (count, self.means.x.size)
        by_reading = np.sqrt(means.x_variance) * rng.standard_normal(size)
        rest = np.sqrt(means.own_variance + self.misfit_sd**2) * rng.standard_normal(size)
        if means.shared.size:
            rest += rng.standard_normal((count, 1)) * means.shared
        moved = (rest - self.slope_at * by_reading) @ self.influence[: self.coefficients.size].T
        ends = np.stack([by_reading[:, int(np.argmin(np.abs(means.x - end)))] + end for end in self.ends], axis=1)
        return self.coefficients + moved, ends

    def loop_width(self, x: npt.ArrayLike) -> FloatArray:
        """Return loading less unloading."""
        z = np.clip(self.scaled(x), -1.0, 1.0)
        return np.asarray((1.0 - z**2) * np.polynomial.polynomial.polyval(z, [*self.loop, 0.0]))

    def loop_width_u(self, x: npt.ArrayLike) -> FloatArray:
        z = np.clip(self.scaled(x), -1.0, 1.0)
        rows = (1.0 - z**2)[..., None] * z[..., None] ** np.arange(self.loop.size)
        covariance = self._propagated(self.influence[self.coefficients.size :])
        variance = np.einsum("...i,ij,...j->...", rows, covariance, rows)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)


def joint_fit(means: PositionMeans, basis: CurveBasis, loop_terms: int | None = None) -> JointFit:
    """Fit curve and loop to position means, by default with as many loop terms as they carry; may raise DataError."""
    terms = means.loop_terms() if loop_terms is None else loop_terms
    size, needed = means.x.size, basis.complexity + terms
    low, high = means.ends
    if size < needed or not high > low:
        raise DataError(f"{size} positions for {needed} coefficients", "Read more positions, or fit a lower degree.")
    centre, half = (low + high) / 2, (high - low) / 2
    constrained = basis.constrained(terms)
    x, y = means.x, means.y
    z = (x - centre) / half
    design = np.column_stack([basis.design(z), _loop_design(z, means.branch, terms)])
    rows = np.column_stack([basis.slope_design(z), _loop_slope_design(z, means.branch, terms)])
    floor = (_EXACT * float(np.abs(y).max(initial=1e-300))) ** 2
    slope, misfit = np.full(size, float(np.polyfit(x, y, 1)[0])), 0.0
    for step in range(ITERATIONS):
        known = slope**2 * means.x_variance + means.y_variance
        read_once = means.dof == 0 or not known.min() > floor  # then the misfit alone shows the scatter
        if step == 0 and read_once and not known.min() > floor:
            misfit = float(np.var(y)) or floor
        variance = np.maximum(known + misfit, floor)
        root = 1.0 / np.sqrt(variance)
        solution, inverse, free = _solved(design * root[:, None], y * root, constrained)
        influence = np.zeros((needed, size))
        influence[free] = inverse * root
        hat = design @ influence
        residuals = y - design @ solution
        if read_once:
            squares = (np.eye(size) - hat) ** 2 / variance[:, None]
            spread, excess = float(squares.sum()), float((residuals**2 / variance).sum() - (squares @ known).sum())
            misfit = max(excess / spread, 0.0) if spread > _EXACT and size > int(free.sum()) else 0.0
        if step < ITERATIONS - 1:
            slope = rows @ solution / half
            least = _LEAST_SLOPE * np.abs(slope).max()
            slope = np.where(np.abs(slope) < least, np.copysign(least, slope), slope)
    if np.linalg.matrix_rank(design[:, free] * root[:, None]) < int(free.sum()):
        cause = f"the positions do not carry {needed} coefficients"
        raise DataError(cause, "Read more positions, or fit a lower degree.")
    known = np.maximum(known, floor) if misfit == 0.0 else known
    split = basis.complexity
    return JointFit(
        basis, centre, half, solution[:split], solution[split:], influence, known, float(np.sqrt(misfit)), residuals,
        np.einsum("ii->i", hat).copy(), slope, means,
    )  # fmt: skip


def _solved(
    design: FloatArray, target: FloatArray, constrained: BoolArray | None
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the least-squares solution, the pseudo-inverse for its free coefficients, and which are free."""
    if constrained is None:
        inverse = np.asarray(np.linalg.pinv(design), dtype=np.float64)
        return inverse @ target, inverse, np.ones(design.shape[1], dtype=bool)
    lower = np.where(constrained, 0.0, -np.inf)
    solution = optimize.lsq_linear(design, target, bounds=(lower, np.inf), method="bvls").x
    free = ~(constrained & (np.abs(solution) <= 1e-9 * np.abs(solution).max()))
    return solution, np.asarray(np.linalg.pinv(design[:, free]), dtype=np.float64), np.asarray(free)


def _loop_design(z: FloatArray, branch: FloatArray, terms: int) -> FloatArray:
    half_open = 0.5 * branch * np.maximum(1.0 - z**2, 0.0)
    return np.asarray(half_open[:, None] * z[:, None] ** np.arange(terms))


def _loop_slope_design(z: FloatArray, branch: FloatArray, terms: int) -> FloatArray:
    powers = np.arange(terms)
    falling = (powers + 2.0) * z[:, None] ** (powers + 1)
    rising = powers * z[:, None] ** np.maximum(powers - 1, 0)
    return np.asarray(0.5 * branch[:, None] * (rising - falling))


def loop_is_represented(fit: JointFit) -> bool:
    """Return whether the loop has the model's shape: more terms do not leave significantly less."""
    if not fit.loop.size or fit.dof < 1:
        return False
    try:
        more = joint_fit(fit.means, fit.basis, MORE_LOOP_TERMS)
    except DataError:
        return True
    gained = fit.dof - more.dof
    weights = 1.0 / np.maximum(fit.known_variance + more.misfit_sd**2, np.finfo(float).tiny)
    before, after = (float(weights @ each.residuals**2) for each in (fit, more))
    if gained < 1 or more.dof < 2 or not after > 0:
        return True
    ratio = max(before - after, 0.0) / gained / (after / more.dof)
    return bool(stats.f.sf(ratio, gained, more.dof) > OTHER_SHAPE)


def fit_of_best_loop(means: PositionMeans, basis: CurveBasis, most_terms: int) -> JointFit | None:
    """Return the fit with as many loop terms as lessen the residual variance; None if the positions carry no such loop.

    A term is kept if it lowers the sum of squares by more than its expectation (H. Theil, Economic Forecasts and
    Policy, 1961, 6.3: F > 1).
    """
    fits: list[JointFit] = []
    with suppress(DataError):  # as many as the positions carry
        fits.extend(joint_fit(means, basis, terms) for terms in range(1, min(means.inner_pairs, most_terms) + 1))
    represented = [fit for fit in fits if loop_is_represented(fit)]
    if not represented:
        return None
    variance = fits[-1].variance
    return min(represented, key=lambda fit: float((fit.residuals**2 / variance).sum()) + fit.loop.size)


@dataclass(frozen=True, slots=True)
class LoopEstimate:
    """The greatest width of a loop, less what its variance adds, and its 95 % interval, in the unit of y.

    `at_levels` is the greatest at the positions that were read, `between` the bound of what lies between these.
    """

    width: float
    low: float
    high: float
    at_levels: float = float("inf")
    between: float = 0.0


def greatest_loop_width(fit: JointFit, rng: np.random.Generator, draws: int = WIDTH_DRAWS) -> LoopEstimate:
    """Estimate the greatest distance of the branches.

    Its square exceeds the truth's by about its variance, found by redrawing the loop. The interval is about the
    greatest width less its bias; it starts at zero if a loop of zero would give such a width with a chance of 5 % or
    more.
    """
    z = np.linspace(-1.0, 1.0, WIDTH_POINTS)
    rows = (1.0 - z**2)[:, None] * z[:, None] ** np.arange(fit.loop.size)
    root = fit.root(fit.influence[fit.coefficients.size :])
    noise = (rng.standard_normal((draws, root.shape[1])) @ root.T) @ rows.T
    noise = np.concatenate([noise, -noise])
    widths = rows @ fit.loop
    at = int(np.argmax(np.abs(widths)))
    greatest = float(np.abs(widths[at]))
    redrawn = np.abs(widths + noise).max(axis=1)
    widen = float(stats.t.ppf(0.975, fit.effective_dof))
    reach = widen * float(np.linalg.norm(rows[at] @ root))
    alone = np.abs(noise[:draws]).max(axis=1)
    by_chance = widen / float(stats.norm.ppf(0.975))

    width = np.sqrt(np.maximum(2.0 * greatest**2 - np.mean(redrawn**2), 0.0))
    centre = 2.0 * greatest - redrawn.mean()
    low = np.minimum(np.maximum(centre - reach, 0.0), width)
    if greatest <= by_chance * np.percentile(np.tile(alone, 2), 95.0):
        low = 0.0
    branches = [np.clip(fit.means.x[fit.means.branch * side >= 0], *fit.ends) for side in (-1, 1)]
    apart = [(x, np.abs(fit.loop_width(x))) for x in branches]
    known = float(width / greatest) if greatest > 0.0 else 0.0  # without what its variance adds
    at_levels = min(float(y.max(initial=0.0)) for _, y in apart)
    of_levels = (known * at_levels, known * max(bound_between(x, y) for x, y in apart))
    return LoopEstimate(float(width), float(low), float(np.maximum(centre, width) + reach), *of_levels)


ORDER = 3
WITHOUT_KNOT = 3  # levels of a cubic spline that have no knot of their own


@dataclass(frozen=True, slots=True)
class MonotoneSplineBasis:
    """A constant and cubic I-splines over z = -1..1 with interior `knots`; falling curves where `falls`.

    Source: J. O. Ramsay, Monotone regression splines in action, Statistical Science 3 (1988) 425.
    """

    knots: tuple[float, ...]
    falls: bool = False

    @classmethod
    def through(cls, z: FloatArray, falls: bool) -> MonotoneSplineBasis:
        """Return the basis with as many knots as the levels in z carry, at its quantiles; z of both branches."""
        count = max((z.size + 2) // 2 - WITHOUT_KNOT, 1)
        knots = np.quantile(np.clip(z, -1.0, 1.0), np.linspace(0.0, 1.0, count + 2)[1:-1])
        return cls(tuple(float(knot) for knot in np.unique(knots) if -1.0 < knot < 1.0), falls)

    @property
    def complexity(self) -> int:
        return len(self.knots) + ORDER + 1

    @property
    def _splines(self) -> BSpline:
        knots = np.concatenate([np.full(ORDER + 1, -1.0), self.knots, np.full(ORDER + 1, 1.0)])
        return BSpline(knots, np.eye(self.complexity), ORDER)

    def _within(self, z: npt.ArrayLike) -> FloatArray:
        return np.clip(np.atleast_1d(np.asarray(z, dtype=np.float64)), -1.0, 1.0)

    def design(self, z: npt.ArrayLike) -> FloatArray:
        """Return the design matrix [points, coefficients]; z beyond -1..1 is taken for the end, NaN gives NaN."""
        return self._integrated(np.asarray(self._splines(self._within(z))))

    def slope_design(self, z: npt.ArrayLike) -> FloatArray:
        return self._integrated(np.asarray(self._splines.derivative()(self._within(z))))

    def _integrated(self, rows: FloatArray) -> FloatArray:
        sums = np.cumsum(rows[:, ::-1], axis=1)[:, ::-1]
        sums[:, 1:] *= -1.0 if self.falls else 1.0
        return np.asarray(sums, dtype=np.float64)

    def constrained(self, loop_terms: int) -> BoolArray:
        """All but the constant and the loop's terms may not be negative."""
        return np.concatenate([[False], np.ones(self.complexity - 1, dtype=bool), np.zeros(loop_terms, dtype=bool)])
