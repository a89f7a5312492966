"""Checks of a calibration: is the model right, is it stable, and which points are suspect?

Replicates (equal x) separate pure error from lack of fit; leaving one cycle out measures how well a new cycle is
predicted; degrees 1 to 4 are compared by AICc and by that same prediction. Sources: Draper and Smith, Applied
Regression Analysis (1998), 2.1 (lack of fit); Hurvich and Tsai, Biometrika 76 (1989) 297 (AICc); ISO/TS 28038:2018, 6.5
(choice of degree).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy import stats

from analysis.calibration.fit import Calibration, fit_calibration
from analysis.warning import Warning, WarningCode
from protocol.base.arrays import FloatArray
from protocol.base.errors import BoatDaqError

_DEGREES = (1, 2, 3, 4)
MONOMIAL_ROUNDING = 1e-6  # of the span of y: more is seen in a figure
OUTLIER_CHANCE = 0.02  # that a sound calibration has a point named as an outlier
NEAR_TURN = 0.07  # of the range: a turning point this near to an end puts what lies twice as far beyond back inside
_EXACT = 1e-9  # of the largest y: what the rounding of an exact fit may leave
HIGHEST_LEVERAGE = 0.85  # beyond it a point's own error goes into the curve, not into its residual


def lack_of_fit(calibration: Calibration) -> dict[str, float] | None:
    """Return f, p and degrees of freedom of the test by replicates; None without any, or without spare positions."""
    x, group = np.unique(calibration.x, return_inverse=True)
    pure_dof, lack_dof = calibration.n - x.size, x.size - calibration.degree - 1
    if pure_dof < 1 or lack_dof < 1:
        return None
    means = np.bincount(group, calibration.y) / np.bincount(group)
    pure = float(((calibration.y - means[group]) ** 2).sum())
    lack = float(((means[group] - calibration.predict(calibration.x)) ** 2).sum())
    if pure <= 0:
        return None
    f = (lack / lack_dof) / (pure / pure_dof)
    return {"f": f, "p": float(stats.f.sf(f, lack_dof, pure_dof)), "lack_dof": lack_dof, "pure_dof": pure_dof}


def aicc(calibration: Calibration) -> float:
    """Return the corrected Akaike criterion; infinite where n <= k + 1."""
    k = calibration.degree + 2  # coefficients and the noise
    if calibration.n <= k + 1:
        return float("inf")
    squares = float(calibration.residuals @ calibration.residuals)
    if squares <= 0:
        return float("-inf")
    correction = 2 * k + 2 * k * (k + 1) / (calibration.n - k - 1)
    return float(calibration.n * np.log(squares / calibration.n) + correction)


def leave_one_out(x: FloatArray, y: FloatArray, group: FloatArray, degree: int) -> dict[str, Any]:
    """Predict each group (a cycle) of the points [n] from the others.

    Returns the rms prediction error and, by group, the largest change of the curve without it, in the unit of y; None
    for a group without which the degree cannot be fitted.
    """
    whole = fit_calibration(x, y, degree)
    design = whole.fit.basis.design(x)
    grid = whole.fit.basis.design(np.linspace(*whole.x_range, 101))
    errors: list[float] = []
    moves: list[float | None] = []
    for g in np.unique(group):
        out = group == g
        if np.unique(x[~out]).size <= degree:
            moves.append(None)
            continue
        part = np.linalg.lstsq(design[~out], y[~out], rcond=None)[0]
        errors += (y[out] - design[out] @ part).tolist()
        moves.append(float(np.abs(grid @ (part - whole.fit.basis_coefficients)).max()))
    rms = float(np.sqrt(np.mean(np.square(errors)))) if errors else float("nan")
    return {"prediction_rms": rms, "largest_move": moves}


def compare_degrees(x: FloatArray, y: FloatArray, group: FloatArray | None = None) -> list[dict[str, float]]:
    """Compare degrees 1 to 4 by AICc and by cross-validation over groups [n], by default point by point."""
    rows = []
    for degree in _DEGREES:
        try:
            calibration = fit_calibration(x, y, degree)
        except BoatDaqError:
            continue
        if group is not None and np.unique(group).size > 1:
            prediction = leave_one_out(x, y, group, degree)["prediction_rms"]
        else:  # leaving one point out has a closed form: e / (1 - h)
            left = 1.0 - calibration.fit.leverage
            carried = calibration.dof > 0 and left.min() > 1e-9  # else the fit needs each point: none can be left out
            prediction = float(np.sqrt(np.mean((calibration.residuals / left) ** 2))) if carried else float("nan")
        rows.append({"degree": degree, "aicc": aicc(calibration), "prediction_rms": prediction})
    return rows


def preferred_degree(rows: list[dict[str, float]]) -> int | None:
    """Return the lowest degree whose AICc is within 2 of the best (Burnham and Anderson); None for too few points."""
    best = min((row["aicc"] for row in rows), default=float("inf"))
    if best == float("inf"):
        return None
    return int(next(row["degree"] for row in rows if row["aicc"] <= best + 2.0 or row["aicc"] == best))


def fit_checks(calibration: Calibration, group: FloatArray | None = None) -> dict[str, Any]:
    """Return all checks of a calibration; `group` is each point's cycle, where there are cycles."""
    rows = compare_degrees(calibration.x, calibration.y, group)
    content: dict[str, Any] = {"lack_of_fit": lack_of_fit(calibration), "degrees": rows}
    content["preferred_degree"] = preferred_degree(rows)
    if group is not None and np.unique(group).size > 1:
        content["leave_one_cycle_out"] = leave_one_out(calibration.x, calibration.y, group, calibration.degree)
    return content


def calibration_warnings(
    calibration: Calibration, units: tuple[str, str] = ("", ""), *, points: bool = True
) -> tuple[Warning, ...]:
    """Return what the coefficients and their uncertainties alone do not show; without `points` nothing on one point."""
    x_unit, y_unit = (f" {unit}" if unit else "" for unit in units)
    found = [
        *_texts(calibration, y_unit),
        *_near_turning_points(calibration, x_unit),
        *(_suspect_points(calibration, y_unit) if points else ()),
    ]
    constant = [item for item in found if item[0] is WarningCode.CONSTANT_Y]
    return tuple(Warning(code, "", text) for code, text in constant or found)


def _texts(calibration: Calibration, y_unit: str) -> Iterator[tuple[WarningCode, str]]:
    value, last = calibration.y_range
    if value == last and calibration.n > 1 and calibration.degree > 0:
        at_all = f"y is constant, {value:.6g}{y_unit} at all {calibration.n} points"
        yield WarningCode.CONSTANT_Y, f"{at_all}: it does not depend on x"
        return
    if calibration.dof < 1:
        text = f"{calibration.n} points for {calibration.degree + 1} coefficients: no uncertainty can be given"
        yield WarningCode.NO_UNCERTAINTY, text
    if calibration.spline is not None:
        return
    powers = np.vander(calibration.x, calibration.degree + 1, increasing=True)
    rounding = float(np.abs(powers @ calibration.coefficients - calibration.predict(calibration.x)).max())
    if rounding > MONOMIAL_ROUNDING * (last - value) and rounding > 1e-12 * max(np.abs(calibration.y_range)):
        yield (
            WarningCode.MONOMIAL_ROUNDING,
            f"the coefficients b0, b1, ... give the curve only to {rounding:.2g}{y_unit}: x lies far from zero "
            f"for its range; fit x - {calibration.fit.basis.centre:g} instead",
        )


def _near_turning_points(calibration: Calibration, x_unit: str) -> Iterator[tuple[WarningCode, str]]:
    """Name turning points so near to the range that an x beyond the turn would be read as one inside."""
    low, high = calibration.x_range
    for turn in calibration.turning_points:
        beyond = max(low - turn, turn - high)
        if calibration.monotone and 0.0 <= beyond < NEAR_TURN * (high - low):
            yield (
                WarningCode.NEAR_TURNING_POINT,
                f"the curve turns at x = {turn:.4g}{x_unit}, {beyond:.2g}{x_unit} beyond its "
                "range: an x as far on the other side of the turn is read as one inside",
            )


def _suspect_points(calibration: Calibration, y_unit: str) -> Iterator[tuple[WarningCode, str]]:
    """Yield warnings of a point off the curve, and of one that could be off unseen; none for an exact fit.

    The largest externally studentised residual against Student's t with Bonferroni's bound (R. D. Cook, S. Weisberg,
    Residuals and Influence in Regression, 1982, 2.2.2).
    """
    fit, dof, x, y = calibration.fit, calibration.dof, calibration.x, calibration.y
    alone = int(np.argmax(fit.leverage))
    if dof > 0 and fit.leverage[alone] > HIGHEST_LEVERAGE and calibration.degree > 0:
        why = f"it alone determines the curve there (leverage {fit.leverage[alone]:.2f})"
        yield WarningCode.HIGH_LEVERAGE, f"check the point at x = {x[alone]:.4g}: {why}"
    weighted = np.sqrt(fit.weights) * fit.residuals
    left = 1.0 - fit.leverage
    if dof < 2 or not calibration.scatter_sd > 1e-12 * np.abs(calibration.y).max() or left.min() < 1e-9:
        return
    own = weighted**2 / left
    rest = np.maximum(dof * calibration.scatter_sd**2 - own, 0.0) / (dof - 1)
    with np.errstate(divide="ignore"):
        studentised = np.sqrt(own / rest)
    worst = int(np.argmax(studentised))
    if calibration.n * 2.0 * float(stats.t.sf(studentised[worst], dof - 1)) < OUTLIER_CHANCE:
        exact = np.sqrt(rest[worst]) <= _EXACT * np.abs(calibration.y).max()
        far = " on which all others lie" if exact else f", {studentised[worst]:.1f} of its standard deviations"
        name = f"the point at x = {x[worst]:.4g}, y = {y[worst]:.6g}"
        yield WarningCode.OUTLIER, f"{name} is {abs(fit.residuals[worst]):.3g}{y_unit} off the curve{far}"
