"""Whether two calibrations of one unit agree: coefficients, the difference of the curves, E_n.

On the shared range E_n = (y - y_ref) / sqrt(U^2 + U_ref^2), U = 2 times the standard uncertainty of the curve, free of
the loop about it (ISO/IEC 17043, ISO 13528, 9.7); |E_n| <= 1 agrees. Nothing is extrapolated; calibrations without a
shared range are refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError, RequestError
from protocol.base.units import COVERAGE_FACTOR

if TYPE_CHECKING:  # the window imports this module, and none of the fit's libraries
    from analysis.calibration.fit import Calibration

_POINTS = 161


@dataclass(frozen=True, slots=True)
class Coefficient:
    """A coefficient of x^power, now and before, with its standard errors."""

    power: int
    value: float
    std_error: float
    value_before: float
    std_error_before: float

    @property
    def e_n(self) -> float:
        """The difference over its expanded uncertainty; NaN without standard errors."""
        expanded = COVERAGE_FACTOR * float(np.hypot(self.std_error, self.std_error_before))
        return (self.value - self.value_before) / expanded if expanded > 0 else float("nan")


@dataclass(frozen=True, slots=True)
class Agreement:
    """Two calibrations of one sensor on a grid (mm) of their shared range: differences new less earlier, and E_n."""

    grid: FloatArray
    before_mv: FloatArray
    difference_mv: FloatArray
    difference_mm: FloatArray
    e_n: FloatArray
    coefficients: tuple[Coefficient, ...]

    @property
    def worst(self) -> int:
        """Index of the greatest |E_n|; of the greatest difference where there is none."""
        score = self.e_n if np.isfinite(self.e_n).any() else self.difference_mv
        return int(np.nanargmax(np.abs(score)))

    @property
    def agrees(self) -> bool | None:
        """Whether |E_n| <= 1 all over the range; None where it cannot be computed."""
        worst = float(self.e_n[self.worst])
        return abs(worst) <= 1.0 if np.isfinite(worst) else None


def compare_fits(new: Mapping[str, Any], before: Mapping[str, Any]) -> Agreement:
    """Compare two fits as `fit --json` shows them; raises DataError without a shared range, or for a spline."""
    low, high = (pick(new["range"][i], before["range"][i]) for i, pick in ((0, max), (1, min)))
    if not low < high:
        raise DataError("the two calibrations share no range of elongation", "Compare runs of one plan.")
    if not all(fit["coefficients"] for fit in (new, before)):
        raise DataError("a spline has no coefficients to compare", "Compare two polynomials, of degree 1 to 6.")
    grid = np.linspace(low, high, _POINTS)
    y, sd = _curve(new, grid)
    y_before, sd_before = _curve(before, grid)
    slope = np.polynomial.polynomial.polyval(
        grid, np.polynomial.polynomial.polyder(np.asarray(new["coefficients"], dtype=np.float64))
    )
    difference = y - y_before
    with np.errstate(divide="ignore", invalid="ignore"):
        e_n = difference / (COVERAGE_FACTOR * np.hypot(sd, sd_before))
        mm = np.where(slope != 0, difference / slope, np.nan)
    e_n = np.where(np.isfinite(e_n), e_n, np.where(difference == 0, 0.0, np.nan))
    return Agreement(grid, y_before, difference, mm, e_n, _coefficients(new, before))


def between_calibrations_mm(calibrations: Sequence[Calibration], x_mm: float) -> tuple[float, int]:
    """Return the sd between calibrations of one sensor, as elongation at `x_mm`, and its degrees of freedom.

    The variance of y(x_mm) less the uncertainty of the fits (floored at zero), through the mean slope: the spread of
    the signal at one pressure would hold the actuator's as well. RequestError: fewer than two of them reach `x_mm`.
    """
    fits = [c for c in calibrations if c.x_range[0] <= x_mm <= c.x_range[1]]
    if len(fits) < 2:
        raise RequestError(f"fewer than two runs are calibrated at {x_mm:+z.2f} mm", "Record another calibration.")
    values = np.asarray([float(c.predict(x_mm)) for c in fits])
    by_fit = np.mean([float(c.curve_parts(x_mm)[0]) ** 2 for c in fits])  # the grid rounds alike in every run
    slope = float(np.mean([float(c.slope(x_mm)) for c in fits]))
    return float(np.sqrt(max(values.var(ddof=1) - by_fit, 0.0)) / abs(slope)), len(fits) - 1


def _curve(fit: Mapping[str, Any], grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return y and its standard error on the grid."""
    coefficients = np.asarray(fit["coefficients"], dtype=np.float64)
    covariance = np.asarray(_with_reading(fit, "covariance"), dtype=np.float64)
    powers = np.vander(grid, coefficients.size, increasing=True)
    variance = np.einsum("gi,ij,gj->g", powers, covariance, powers)
    return powers @ coefficients, np.sqrt(np.maximum(variance, 0.0))


def _with_reading(fit: Mapping[str, Any], key: str) -> Any:
    """Return `key` with the reading of x included, where the fit has it: older ones do not."""
    return fit.get(f"{key}_with_reading", fit[key])


def _coefficients(new: Mapping[str, Any], before: Mapping[str, Any]) -> tuple[Coefficient, ...]:
    columns = [
        np.asarray(values, dtype=np.float64)
        for fit in (new, before)
        for values in (fit["coefficients"], _with_reading(fit, "std_errors"))
    ]
    size = max(column.size for column in columns)
    padded = [np.append(column, np.zeros(size - column.size)) for column in columns]
    return tuple(Coefficient(power, *(float(column[power]) for column in padded)) for power in range(size))
