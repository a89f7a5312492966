"""What the residuals of a fit say: is the stated uncertainty true, are neighbours alike, does the curve explain y?

Strategy: with a stated uncertainty of every point, sum (r / u)^2 is chi-square with n - p degrees of freedom where
curve and uncertainties are right (ISO/TS 28038:2018, 6.4). Neighbouring residuals, in the order of x and in that of the
rows, are compared by the Durbin-Watson statistic, whose mean and variance follow from the design (Durbin and Watson,
Biometrika 38 (1951) 159, section 3). The curve is tested against a constant by F.

Rules: a test that cannot be made is None. Several warnings of one fit each name their own cause.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from scipy import stats

from analysis.calibration.fit import Calibration
from analysis.numbers import percent
from analysis.warning import Warning, WarningCode
from protocol.base.arrays import FloatArray

LEVEL = 0.05
"""Two-sided level of the test of a stated uncertainty, as ISO/TS 28038 has it on each side."""
AUTOCORRELATED = 1e-3
"""Level of the test of neighbours: it is made twice for each fit."""
LEAST_POINTS = 8
"""Fewer residuals have no order to speak of."""
WEAK_R2 = 0.9
"""Of the variance of y: a curve that explains less is no calibration."""


class StatedUncertainty(StrEnum):
    """How a stated uncertainty compares with the scatter about the curve."""

    CONSISTENT = "consistent"
    TOO_SMALL = "too_small"
    TOO_LARGE = "too_large"


@dataclass(frozen=True, slots=True)
class ChiSquared:
    """The test of a stated uncertainty: statistic, degrees of freedom, its 95 % interval, and the verdict.

    `ratio` is the scatter about the curve over what was stated.
    """

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
    """Test the stated standard uncertainties of the points against their scatter; None without degrees of freedom.

    Parameters
    ----------
    u : [n] stated standard uncertainty of each y.
    """
    dof = calibration.dof
    if dof < 1:
        return None
    statistic = float(((calibration.residuals / u) ** 2).sum())
    low, high = (float(stats.chi2.ppf(share, dof)) for share in (LEVEL / 2, 1 - LEVEL / 2))
    verdict = StatedUncertainty.CONSISTENT
    if statistic > high:
        verdict = StatedUncertainty.TOO_SMALL
    elif statistic < low:
        verdict = StatedUncertainty.TOO_LARGE
    return ChiSquared(statistic, dof, low, high, float(np.sqrt(statistic / dof)), verdict)


@dataclass(frozen=True, slots=True)
class DurbinWatson:
    """Likeness of neighbouring residuals: 2 for none, below it where neighbours are alike.

    `expected` is the mean of the statistic for independent errors and this design, `p` the chance of one so low.
    """

    statistic: float
    expected: float
    p: float

    def as_json(self) -> dict[str, Any]:
        """Return an entry of `residual_tests`."""
        return asdict(self)


def durbin_watson(calibration: Calibration, order: FloatArray | None = None) -> DurbinWatson | None:
    """Compare neighbouring residuals; None for fewer than `LEAST_POINTS` of them, or residuals that are all zero.

    Parameters
    ----------
    order : [n] neighbours by this; None takes the order of the rows.

    Notes
    -----
    With M the residual-maker and A the matrix of sum (e_i - e_i-1)^2: mean tr(MA) / v and variance
    2 (tr((MA)^2) - tr(MA)^2 / v) / (v (v + 2)), v degrees of freedom; p from the normal distribution.
    """
    fit, v = calibration.fit, calibration.dof
    rows = np.arange(calibration.n) if order is None else np.argsort(order, kind="stable")
    residuals = (np.sqrt(fit.weights) * fit.residuals)[rows]
    squares = float(residuals @ residuals)
    if v < LEAST_POINTS or not np.sqrt(squares / v) > 1e-12 * float(np.abs(calibration.y).max()):
        return None
    statistic = float((np.diff(residuals) ** 2).sum() / squares)
    design = (np.sqrt(fit.weights)[:, None] * fit.basis.design(calibration.x))[rows] @ fit.basis_factor
    q, _ = np.linalg.qr(design)
    n = calibration.n
    aq = _differences(q)
    qaq = q.T @ aq
    trace = 2.0 * (n - 1) - float(np.trace(qaq))
    # tr(A^2) of the tridiagonal A: squares of its diagonal (1, 2 ... 2, 1) and twice its n - 1 neighbours
    square = 2.0 + 4.0 * (n - 2) + 2.0 * (n - 1)
    square += float(np.sum(qaq**2)) - 2.0 * float(np.sum(aq**2))
    expected = trace / v
    variance = 2.0 * (square - trace * expected) / (v * (v + 2.0))
    p = float(stats.norm.cdf((statistic - expected) / np.sqrt(variance)))
    return DurbinWatson(statistic, expected, p)


def _differences(q: FloatArray) -> FloatArray:
    """A q, with A the matrix of the sum of squared differences of neighbours."""
    steps = np.diff(q, axis=0)
    out = np.zeros_like(q)
    out[:-1] -= steps
    out[1:] += steps
    return out


@dataclass(frozen=True, slots=True)
class Explanation:
    """The curve against a constant: F, its degrees of freedom, and the chance of so much by no relation at all."""

    f: float
    curve_dof: int
    dof: int
    p: float

    def as_json(self) -> dict[str, Any]:
        """Return `explanation` of `residual_tests`."""
        return asdict(self)


def explanation(calibration: Calibration) -> Explanation | None:
    """Test the curve against a constant; None for a constant, and without degrees of freedom or variance of y."""
    curve_dof = calibration.n - calibration.dof - 1
    if curve_dof < 1 or calibration.dof < 1 or not np.isfinite(calibration.r2) or calibration.r2 >= 1.0:
        return None
    f = max(calibration.r2, 0.0) / curve_dof / ((1.0 - calibration.r2) / calibration.dof)
    return Explanation(f, curve_dof, calibration.dof, float(stats.f.sf(f, curve_dof, calibration.dof)))


def residual_tests(calibration: Calibration) -> dict[str, Any]:
    """Return `residual_tests` of `fit --json`."""
    by_x, by_row, explained = _tests(calibration)
    content = {"durbin_watson_by_x": by_x, "durbin_watson_by_row": by_row, "explanation": explained}
    return {name: None if test is None else test.as_json() for name, test in content.items()}


def residual_warnings(calibration: Calibration, stated: ChiSquared | None = None) -> tuple[Warning, ...]:
    """Return what the residuals contradict: the stated uncertainty, independence, a relation of x and y at all."""
    return tuple(Warning(code, "", text) for code, text in _texts(calibration, stated))


def _tests(calibration: Calibration) -> tuple[DurbinWatson | None, DurbinWatson | None, Explanation | None]:
    return durbin_watson(calibration, calibration.x), durbin_watson(calibration), explanation(calibration)


def _texts(calibration: Calibration, stated: ChiSquared | None) -> Iterator[tuple[WarningCode, str]]:
    if stated is not None and stated.verdict is not StatedUncertainty.CONSISTENT:
        times = f"{stated.ratio:.2g} times" if stated.ratio >= 0.095 else f"{stated.ratio:.1g} times"
        found = f"the points scatter {times} their stated uncertainty (chi-square {stated.chi_squared:.4g}, "
        found += f"expected {stated.low:.4g} to {stated.high:.4g})"
        cause = "it is too small, or the curve misses their shape"
        if stated.verdict is StatedUncertainty.TOO_LARGE:
            cause = "it is too large, or holds a part that all points share"
        yield WarningCode.STATED_UNCERTAINTY, f"{found}: {cause}"
    by_x, by_row, explained = _tests(calibration)
    if explained is not None and explained.p > LEVEL:
        unrelated = f"no relation is evident: R² {calibration.r2:.2f}, p {explained.p:.2g} against a constant"
        yield WarningCode.NOTHING_EXPLAINED, unrelated
    elif explained is not None and calibration.r2 < WEAK_R2:
        share = percent(max(calibration.r2, 0.0))
        yield WarningCode.NOTHING_EXPLAINED, f"the curve explains only {share} of the variance of y"
    causes = {"x": "the curve misses their shape", "row": "the points drift or share errors"}
    for (name, cause), test in zip(causes.items(), (by_x, by_row), strict=True):
        if test is not None and test.p < AUTOCORRELATED:
            order = "in the order of x" if name == "x" else "in the order of the rows"
            alike = f"neighbouring residuals {order} are alike (Durbin-Watson {test.statistic:.2f}, expected "
            alike += f"{test.expected:.2f}): {cause}; standard errors are too small"
            yield WarningCode.AUTOCORRELATED, alike
