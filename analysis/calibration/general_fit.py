"""A polynomial fit of any two columns, with its options: stated uncertainty, constraints, wrong points left out.

Points are left out under the same constraint. A stated uncertainty gives the covariance, whatever the scatter (ISO/TS
28038:2018, 6 and 7); the chi-square test shows whether the two agree.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from analysis.calibration.checks import calibration_warnings
from analysis.calibration.constrained_fit import monotone, through_zero
from analysis.calibration.fit import Calibration, fit_calibration, weights_of
from analysis.calibration.left_out import LeftOutPoint, leave_out
from analysis.calibration.residual_tests import ChiSquared, Explanation, chi_squared, explanation, residual_warnings
from analysis.warning import Warning, WarningCode
from protocol.base.arrays import BoolArray


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
