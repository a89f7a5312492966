"""The signals that the chain predicts: pressure, shape, rays, light, voltage; and what disagrees with it.

A signal is gain times light plus offset, with a loss of the guide: for a given loss the others are linear, so that only
the loss is searched. The band holds the fit's own misfit, by far its larger part. Both sensors at one elongation that
the pressure does not explain are mechanics, both shifted by one voltage electronics, else optics.
"""

from __future__ import annotations

import enum
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from analysis.signal_prediction.light_table import LOSSES_DB_PER_CM, LightTable, stored_light
from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError

_LEAST_POINTS = 6
SHIFT_SIGMA = 4.0


class Disagreement(enum.StrEnum):
    """What does not fit."""

    NONE = "none"
    MECHANICS = "mechanics"  # elongation against pressure
    OPTICS = "optics"  # one signal against elongation
    ELECTRONICS = "electronics"  # both signals alike


@dataclass(frozen=True, slots=True)
class PredictedSignal:
    """One sensor's forward model."""

    gain_mv_per_percent: float
    offset_mv: float
    loss_db_per_cm: float
    covariance: tuple[tuple[float, ...], ...]  # [3][3] of the three
    at_bound: bool  # whether the loss lies at a bound, where its variance says nothing
    rms_mv: float
    rms_percent_fso: float
    r2: float
    nodes_mm: FloatArray
    nodes_mv: FloatArray

    def __call__(self, elongation_mm: FloatArray) -> FloatArray:
        """Return the signal at elongations, mV; NaN outside the table."""
        return np.interp(elongation_mm, self.nodes_mm, self.nodes_mv, left=np.nan, right=np.nan)

    def band_mv(self, noise_mv: float = 0.0) -> float:
        """Return the half width of the 95 % band: misfit of the chain, and noise of a sample."""
        return 2.0 * float(np.hypot(self.rms_mv, noise_mv))

    def as_json(self) -> dict[str, Any]:
        return {key: value for key, value in asdict(self).items() if not key.startswith("nodes")}


def fit_signal_model(
    elongation_mm: FloatArray, signal_mv: FloatArray, table: LightTable | None = None, *, fit_loss: bool = True
) -> PredictedSignal:
    """Return the forward model of one sensor, fitted to readings [n]; the loss is 0 unless `fit_loss`."""
    light = table or stored_light()
    ends = light.elongation_mm[[0, -1]] + [-0.1, 0.1]  # a reading may lie a little beyond
    known = np.isfinite(elongation_mm) & np.isfinite(signal_mv)
    known &= (elongation_mm >= ends[0]) & (elongation_mm <= ends[1])
    x, y = elongation_mm[known], signal_mv[known]
    if len(x) < _LEAST_POINTS or np.ptp(x) == 0.0:
        remedy = f"Give a calibration run with {_LEAST_POINTS} readings or more."
        raise DataError(f"only {len(x)} readings lie inside the chain's table", remedy)

    def solved(loss: float) -> tuple[FloatArray, FloatArray]:
        """Return (gain, offset) and residuals [n] at a loss."""
        columns = np.stack([light.light(x, loss), np.ones(len(x))], axis=1)
        found = np.asarray(np.linalg.lstsq(columns, y, rcond=None)[0], dtype=np.float64)
        return found, np.asarray(y - columns @ found)

    low, high = LOSSES_DB_PER_CM[0], LOSSES_DB_PER_CM[-1]
    loss = low
    if fit_loss:
        searched = minimize_scalar(lambda at: float((solved(at)[1] ** 2).sum()), bounds=(low, high), method="bounded")
        loss = min((low, high, float(searched.x)), key=lambda at: float((solved(at)[1] ** 2).sum()))
    (gain, offset), residual = solved(loss)
    step = 0.01 if loss < high else -0.01
    slope = gain * (light.light(x, loss + step) - light.light(x, loss)) / step
    jacobian = np.stack([light.light(x, loss), np.ones(len(x)), slope], axis=1)
    scale = np.abs(jacobian).max(axis=0)
    variance = float(residual @ residual) / max(len(x) - 3, 1)
    covariance = np.linalg.pinv((jacobian / scale).T @ (jacobian / scale)) * variance / np.outer(scale, scale)
    rms = float(np.sqrt(np.mean(residual**2)))
    values = gain * light.light(light.elongation_mm, loss) + offset
    r2 = 1.0 - float(residual @ residual) / float(((y - y.mean()) ** 2).sum())
    rows = tuple(tuple(row) for row in covariance.tolist())
    fso = float(np.ptp(y))
    at_bound = fit_loss and loss in (low, high)
    return PredictedSignal(
        float(gain), float(offset), loss, rows, at_bound, rms, 100.0 * rms / fso, r2,
        light.elongation_mm, values
    )  # fmt: skip


def what_disagrees(residual_mv: FloatArray, slope_mv_per_mm: FloatArray, u_mv: FloatArray, u_mm: float) -> Disagreement:
    """Return which link of the chain does not fit at an instant.

    `residual_mv`: signal less that of the calibration at the elongation expected from the pressure. Each hypothesis has
    one free shift: of the elongation (slope times shift) or of the voltage (one for all). The one that leaves the
    smaller weighted sum of squares is chosen, if that is credible; else one sensor alone is off.
    """
    known = np.isfinite(residual_mv)
    r, b, u = residual_mv[known], slope_mv_per_mm[known], u_mv[known]
    expected = np.hypot(u, b * u_mm)
    if not len(r) or (bool((np.abs(r) <= SHIFT_SIGMA * expected).all()) and _left(r, b, u) <= SHIFT_SIGMA**2):
        return Disagreement.NONE
    left = {Disagreement.MECHANICS: _left(r, b, u), Disagreement.ELECTRONICS: _left(r, np.ones(len(r)), u)}
    best = min(left, key=lambda name: left[name])
    return best if left[best] <= SHIFT_SIGMA**2 or len(r) == 1 else Disagreement.OPTICS


def _left(residual: FloatArray, shape: FloatArray, u: FloatArray) -> float:
    """Return the weighted sum of squares that the best multiple of a shape leaves."""
    weight = 1.0 / u**2
    best = float((weight * shape * residual).sum() / (weight * shape * shape).sum())
    return float((weight * (residual - best * shape) ** 2).sum())
