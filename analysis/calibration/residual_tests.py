"""Tests of a fit's residuals: is the stated uncertainty true, and does the curve explain y?

With a stated uncertainty of every point, sum (r / u)^2 is chi-square with n - p degrees of freedom if curve and
uncertainties are right (ISO/TS 28038:2018, 6.4). The curve is tested against a constant by F.
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
    """Test the stated standard uncertainties of the points, [n], by their scatter; None without degrees of freedom."""
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
