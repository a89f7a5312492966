"""A polynomial fit of any two columns, with its options: stated uncertainty, constraints, wrong points left out.

Points are left out under the same constraint. A stated uncertainty gives the covariance, whatever the scatter (ISO/TS
28038:2018, 6 and 7); the chi-square test shows whether the two agree.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

from analysis.calibration.checks import calibration_warnings
from analysis.calibration.constrained_fit import monotone, through_zero
from analysis.calibration.fit import Calibration, fit_calibration, weights_of
from analysis.numbers import percent
from analysis.warning import Warning, WarningCode
from protocol.base.arrays import BoolArray, FloatArray
from protocol.base.errors import BoatDaqError


@dataclass(frozen=True, slots=True)
class FitOptions:
    """Options of a fit: y(0) = 0, a slope of one sign, and whether points off the curve are left out."""

    through_zero: bool = False
    monotone: bool = False
    leave_out: bool = False


@dataclass(frozen=True, slots=True)
class GeneralFit:
    """A fit with its tests; `residual_sd` is the scatter at weight 1, `kept` is [n of all points]."""

    calibration: Calibration
    residual_sd: float
    options: FitOptions
    stated: ChiSquared | None
    left_out: tuple[LeftOutPoint, ...]
    kept: BoolArray
    explained: Explanation | None
    warnings: tuple[Warning, ...]

    def as_json(self) -> dict[str, Any]:
        """Return the keys of `fit --json`."""
        return {
            **self.calibration.as_json(),
            "residual_sd": self.residual_sd,
            "through_zero": self.options.through_zero,
            "constrained_monotone": self.options.monotone,
            "stated_uncertainty": None if self.stated is None else self.stated.as_json(),
            "left_out": [asdict(one) for one in self.left_out],
            "residual_tests": {"explanation": None if self.explained is None else asdict(self.explained)},
        }


def general_fit(
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    degree: int = 3,
    *,
    standard_uncertainty: npt.ArrayLike | None = None,
    options: FitOptions | None = None,
) -> GeneralFit:
    """Fit y(x), a polynomial of `degree` 0 to 10; `standard_uncertainty` [n] of y gives weights and covariance."""
    options = options or FitOptions()

    def constrained(calibration: Calibration) -> Calibration:
        found = through_zero(calibration) if options.through_zero else calibration
        return monotone(found) if options.monotone else found

    u = None if standard_uncertainty is None else np.asarray(standard_uncertainty, dtype=np.float64).ravel()
    calibration = constrained(fit_calibration(x, y, degree, weights=None if u is None else weights_of(u)))
    left_out: tuple[LeftOutPoint, ...] = ()
    kept = np.ones(calibration.n, dtype=bool)
    if options.leave_out:
        reduced = leave_out(calibration, constrained)
        calibration, left_out, kept = reduced.calibration, reduced.left_out, reduced.kept
        u = None if u is None else u[kept]
    stated = None if u is None else chi_squared(calibration, u)
    return GeneralFit(
        calibration if u is None else calibration.as_stated(float(u.min())),
        calibration.residual_sd,
        options,
        stated,
        left_out,
        kept,
        explanation(calibration),
        (*map(_left_out, left_out), *calibration_warnings(calibration), *residual_warnings(calibration, stated)),
    )


def _left_out(one: LeftOutPoint) -> Warning:
    point = f"row {one.row + 1} is left out: x = {one.x:.6g}, y = {one.y:.6g}"
    return Warning(WarningCode.POINT_LEFT_OUT, "", f"{point}, {one.residual:+.3g} off the curve, {one.reason}")


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
    """Fit the points without those that are off the curve; `refit` applies a constraint to each fit.

    The largest externally studentised residual is left out, one by one, as long as Student's t with Bonferroni's bound
    rejects it. Source: R. D. Cook, S. Weisberg, Residuals and Influence in Regression, 1982, 2.2.2.
    """
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


_LEVEL = 0.05  # two-sided level of the test of a stated uncertainty, as ISO/TS 28038 has it on each side
WEAK_R2 = 0.9  # of the variance of y: a curve that explains less is no calibration


class StatedUncertainty(StrEnum):
    """How a stated uncertainty compares with the scatter about the curve."""

    CONSISTENT = "consistent"
    TOO_SMALL = "too_small"
    TOO_LARGE = "too_large"


@dataclass(frozen=True, slots=True)
class ChiSquared:
    """The test of a stated uncertainty, with the 95 % interval; `ratio` is scatter about the curve over stated u."""

    chi_squared: float
    dof: int
    low: float
    high: float
    ratio: float
    verdict: StatedUncertainty

    def as_json(self) -> dict[str, Any]:
        """Return `stated_uncertainty` of `fit --json`."""
        content = asdict(self)
        interval = [content.pop("low"), content.pop("high")]
        return content | {"verdict": str(self.verdict), "interval_95": interval}


def chi_squared(calibration: Calibration, u: FloatArray) -> ChiSquared | None:
    """Test the stated u of the points, [n], by their scatter (ISO/TS 28038:2018, 6.4); None without degrees of freedom.

    Where curve and uncertainties are right, sum (r / u)^2 is chi-square with n - p degrees of freedom.
    """
    dof = calibration.dof
    if dof < 1:
        return None
    statistic = float(((calibration.residuals / u) ** 2).sum())
    low, high = (float(stats.chi2.ppf(share, dof)) for share in (_LEVEL / 2, 1 - _LEVEL / 2))
    verdict = StatedUncertainty.CONSISTENT
    if statistic > high:
        verdict = StatedUncertainty.TOO_SMALL
    elif statistic < low:
        verdict = StatedUncertainty.TOO_LARGE
    return ChiSquared(statistic, dof, low, high, float(np.sqrt(statistic / dof)), verdict)


@dataclass(frozen=True, slots=True)
class Explanation:
    """The curve against a constant: F, its degrees of freedom, and the chance of so much by no relation at all."""

    f: float
    curve_dof: int
    dof: int
    p: float


def explanation(calibration: Calibration) -> Explanation | None:
    """Test the curve against a constant; None for a constant, and without degrees of freedom or variance of y."""
    curve_dof = calibration.n - calibration.dof - 1
    if curve_dof < 1 or calibration.dof < 1 or not np.isfinite(calibration.r2) or calibration.r2 >= 1.0:
        return None
    f = max(calibration.r2, 0.0) / curve_dof / ((1.0 - calibration.r2) / calibration.dof)
    return Explanation(f, curve_dof, calibration.dof, float(stats.f.sf(f, curve_dof, calibration.dof)))


def residual_warnings(calibration: Calibration, stated: ChiSquared | None = None) -> tuple[Warning, ...]:
    """Return what the residuals contradict: the stated uncertainty, or a relation of x and y at all."""
    return tuple(Warning(code, "", text) for code, text in _texts(calibration, stated))


def _texts(calibration: Calibration, stated: ChiSquared | None) -> Iterator[tuple[WarningCode, str]]:
    if stated is not None and stated.verdict is not StatedUncertainty.CONSISTENT:
        times = f"{stated.ratio:.2g} times" if stated.ratio >= 0.095 else f"{stated.ratio:.1g} times"
        found = f"the points scatter {times} their stated uncertainty (chi-square {stated.chi_squared:.4g}, "
        found += f"expected {stated.low:.4g} to {stated.high:.4g})"
        cause = "it is too small, or the curve misses their shape"
        if stated.verdict is StatedUncertainty.TOO_LARGE:
            cause = "it is too large, or holds a part that all points share"
        yield WarningCode.STATED_UNCERTAINTY, f"{found}: {cause}"
    explained = explanation(calibration)
    if explained is not None and explained.p > _LEVEL:
        unrelated = f"no relation is evident: R² {calibration.r2:.2f}, p {explained.p:.2g} against a constant"
        yield WarningCode.NOTHING_EXPLAINED, unrelated
    elif explained is not None and calibration.r2 < WEAK_R2:
        share = percent(max(calibration.r2, 0.0))
        yield WarningCode.NOTHING_EXPLAINED, f"the curve explains only {share} of the variance of y"
