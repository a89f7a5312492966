"""Checks of a calibration: is the model right, and is it stable?

Strategy: replicates (equal x) tell pure error from lack of fit; leaving one cycle out tells how a new cycle would be
predicted; degrees 1 to 4 are compared by AICc and by that same prediction.

Sources: Draper and Smith, Applied Regression Analysis (1998), 2.1 (lack of fit); Hurvich and Tsai, Biometrika 76
(1989) 297 (AICc); ISO/TS 28038:2018, 6.5 (choice of degree).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import stats

from analysis.arrays import FloatArray
from analysis.calibration.fit import Calibration, fit_calibration
from analysis.errors import AnalysisError

DEGREES = (1, 2, 3, 4)


def lack_of_fit(calibration: Calibration) -> dict[str, float] | None:
    """Test the fit against its replicates.

    Returns
    -------
    f, p, and the degrees of freedom; None where no x is repeated, or every distinct x is used up by the degree.
    """
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
    """Predict each group (a cycle) from the others.

    Returns
    -------
    rms of the prediction errors and, for each group, by how much the curve moves at most when it is left out; both in
    the unit of y. Groups without which the degree cannot be carried count as None.
    """
    whole = fit_calibration(x, y, degree)
    grid = np.linspace(*whole.x_range, 101)
    errors: list[float] = []
    moves: list[float | None] = []
    for g in np.unique(group):
        out = group == g
        try:
            part = fit_calibration(x[~out], y[~out], degree)
        except AnalysisError:
            moves.append(None)
            continue
        errors += (y[out] - part.predict(x[out])).tolist()
        moves.append(float(np.abs(part.predict(grid) - whole.predict(grid)).max()))
    rms = float(np.sqrt(np.mean(np.square(errors)))) if errors else float("nan")
    return {"prediction_rms": rms, "largest_move": moves}


def compare_degrees(x: FloatArray, y: FloatArray, group: FloatArray | None = None) -> list[dict[str, float]]:
    """Compare degrees 1 to 4 by AICc and by cross-validation (over groups, or point by point)."""
    rows = []
    for degree in DEGREES:
        try:
            calibration = fit_calibration(x, y, degree)
        except AnalysisError:
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
    """Return the lowest degree whose AICc is within 2 of the best: less is not evidence (Burnham and Anderson).

    None where there are too few points to tell.
    """
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
