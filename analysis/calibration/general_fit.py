"""A polynomial fit of any two columns, with its options: stated uncertainty, constraints, resistance to wrong points.

Strategy: the constraint is fitted first, then the robust method, which fits under the same constraint; the residuals of
the result are tested. A stated uncertainty then gives the covariance, whatever the scatter is (ISO/TS 28038:2018, 6 and
7): the chi-square test states whether the two agree.

Rules: the order of the options changes nothing; every point with less than full weight is in the trail.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from analysis.calibration.checks import calibration_warnings
from analysis.calibration.constrained_fit import monotone, through_zero, with_solution
from analysis.calibration.fit import Calibration, fit_calibration
from analysis.calibration.residual_tests import ChiSquared, chi_squared, residual_tests, residual_warnings
from analysis.calibration.robust_fit import RobustFit, RobustMethod, huber, leave_out
from analysis.warning import Warning, WarningCode
from protocol.base.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class FitOptions:
    """Options of a fit: y(0) = 0, a slope of one sign, and what is done with points off the curve."""

    through_zero: bool = False
    monotone: bool = False
    robust: RobustMethod | None = None


@dataclass(frozen=True, slots=True)
class GeneralFit:
    """A fit with its tests.

    Attributes
    ----------
    calibration : the curve; where an uncertainty was stated its covariance is that of the statement.
    residual_sd : scatter about the curve, of a point of weight 1.
    stated : test of the stated uncertainty; None without one.
    robust : the trail; None without a robust method.
    tests : of the residuals, see `residual_tests`.
    warnings : what coefficients and standard errors do not show.
    """

    calibration: Calibration
    residual_sd: float
    options: FitOptions
    stated: ChiSquared | None
    robust: RobustFit | None
    tests: dict[str, Any]
    warnings: tuple[Warning, ...]

    @property
    def kept(self) -> npt.NDArray[np.bool_]:
        """[n of all points] True for the points of the calibration."""
        return self.robust.kept if self.robust is not None else np.ones(self.calibration.n, dtype=bool)

    def as_json(self) -> dict[str, Any]:
        """Return the keys of `fit --json`."""
        return {
            **self.calibration.as_json(),
            "residual_sd": self.residual_sd,
            "through_zero": self.options.through_zero,
            "constrained_monotone": self.options.monotone,
            "stated_uncertainty": None if self.stated is None else self.stated.as_json(),
            "robust": None if self.robust is None else self.robust.as_json(),
            "residual_tests": self.tests,
        }


def general_fit(
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    degree: int = 3,
    *,
    standard_uncertainty: npt.ArrayLike | None = None,
    options: FitOptions | None = None,
) -> GeneralFit:
    """Fit y(x), a polynomial of `degree`, with options.

    Parameters
    ----------
    x, y : [n] points.
    degree : 0 to 10.
    standard_uncertainty : [n] stated standard uncertainty of each y: the points' weights, and the covariance.
    options : constraints and robust method; none by default.

    Raises
    ------
    DataError, RequestError : as `fit_calibration`, or a constraint that the points cannot carry.
    """
    options = options or FitOptions()

    def constrained(calibration: Calibration) -> Calibration:
        found = through_zero(calibration) if options.through_zero else calibration
        return monotone(found) if options.monotone else found

    u = None if standard_uncertainty is None else np.asarray(standard_uncertainty, dtype=np.float64).ravel()
    calibration = constrained(fit_calibration(x, y, degree, standard_uncertainty=u))
    robust = None
    if options.robust is not None:
        robust = (huber if options.robust is RobustMethod.HUBER else leave_out)(calibration, constrained)
        calibration = robust.calibration
        u = None if u is None else u[robust.kept]
    stated = None if u is None else chi_squared(calibration, u)
    return GeneralFit(
        calibration if u is None else _as_stated(calibration, u),
        calibration.residual_sd,
        options,
        stated,
        robust,
        residual_tests(calibration),
        (*_left_out(robust), *calibration_warnings(calibration), *residual_warnings(calibration, stated)),
    )


def _as_stated(calibration: Calibration, u: FloatArray) -> Calibration:
    """Return the same curve with the covariance that the stated uncertainties give."""
    fit = calibration.fit
    return with_solution(
        calibration, fit.basis_coefficients, fit.basis_factor, fit.leverage, sd=float(u.min()),
        zero_constant=fit.basis_factor.shape[1] <= calibration.degree,
    )  # fmt: skip


def _left_out(robust: RobustFit | None) -> tuple[Warning, ...]:
    """A warning for each point that was left out; one for all that count less."""
    if robust is None or not robust.trail:
        return ()
    if robust.method is RobustMethod.LEAVE_OUT:
        return tuple(
            Warning(
                WarningCode.POINT_LEFT_OUT, "",
                f"row {one.row + 1} is left out: x = {one.x:.6g}, y = {one.y:.6g}, {one.residual:+.3g} off the curve, "
                f"{one.reason}",
            )
            for one in robust.trail
        )  # fmt: skip
    least = min(robust.trail, key=lambda one: one.weight)
    count = f"{len(robust.trail)} of {robust.kept.size} points count less than the others"
    where = f"row {least.row + 1} least, {least.weight:.2g} of a point: x = {least.x:.6g}, y = {least.y:.6g}"
    return (Warning(WarningCode.POINT_LEFT_OUT, "", f"{count}; {where}"),)
