"""The actuator's hysteresis, identified from a run, and its exact inverse: the feed-forward of the controller.

A generalised Prandtl-Ishlinskii model: elongation = offset + sum of weight * play. Under the pressure v a play moves
its state no further than into [up(v) - r, down(v) + r]; up and down are parabolas. From a given memory the elongation
is piecewise linear in the envelope, which gives the inverse in closed form. Weights are found by non-negative least
squares, the two curvatures outside of it. What precedes the first turn at either end is left out: unknown memory.

Sources: M. Al Janaideh, S. Rakheja, C.-Y. Su, Mechatronics 19 (2009) 656-670; IEEE/ASME Trans. Mechatronics 16 (2011)
734-744 for the inverse; G. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973) 413 for variable projection.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import minimize, nnls

from protocol.base.arrays import FloatArray
from protocol.base.errors import DataError

_PLAYS = 10
LEAST_SPAN_KPA = 20.0
_LEAST_POINTS = 40
MOST_POINTS = 4000
_LEAST_R2 = 0.98
_STEEPEST = 0.8  # of the curvature at which an envelope would turn inside the identified pressures


@dataclass(frozen=True, slots=True)
class HysteresisModel:
    """Elongation over pressure with memory."""

    radii: FloatArray  # with weights: [m], kPa and mm/kPa
    weights: FloatArray
    up_curvature: float  # with down_curvature: c of the envelopes v + c v^2, 1/kPa; the first is no larger
    down_curvature: float
    offset_mm: float  # elongation at plays of zero
    pressure_range_kpa: tuple[float, float]
    rms_mm: float = math.nan
    r2: float = math.nan

    def rest(self, pressure_kpa: float, elongation_mm: float) -> FloatArray:
        """Return a memory [m] that gives `elongation_mm` as nearly as any: its plays at one share of their widths."""
        low, high = self._bounds(pressure_kpa)
        least, most = float(self.weights @ low), float(self.weights @ high)
        share = 0.5 if most <= least else (elongation_mm - self.offset_mm - least) / (most - least)
        return np.asarray(low + min(max(share, 0.0), 1.0) * (high - low))

    def after(self, memory: FloatArray, pressure_kpa: float) -> FloatArray:
        """Return the memory [m] after the pressure has moved to `pressure_kpa`."""
        low, high = self._bounds(pressure_kpa)
        return np.asarray(np.minimum(np.maximum(memory, low), high))

    def elongation(self, memory: FloatArray) -> float:
        """Return the elongation of a memory [m], mm."""
        return self.offset_mm + float(self.weights @ memory)

    def pressure(self, memory: FloatArray, elongation_mm: float) -> float:
        """Return the pressure that moves a memory [m] to an elongation, kPa; the model is extended beyond its range."""
        wanted = elongation_mm - self.offset_mm
        sign = 1.0 if wanted >= float(self.weights @ memory) else -1.0
        corner = np.asarray(sign * memory + self.radii)  # of the envelope, where each play begins to move
        order = np.argsort(corner)
        corner, slope = corner[order], np.cumsum(self.weights[order])
        value = np.concatenate([[0.0], np.cumsum(slope[:-1] * np.diff(corner))]) + sign * float(self.weights @ memory)
        at = int(np.searchsorted(value, sign * wanted, side="right")) - 1
        at = min(max(at, 0), len(corner) - 1)
        envelope = sign * (corner[at] + (sign * wanted - value[at]) / slope[at])
        return _without_curvature(envelope, self.up_curvature if sign > 0 else self.down_curvature)

    def slope(self, pressure_kpa: float) -> float:
        """Return the elongation per pressure on a long swing, mm/kPa."""
        middle = self.up_curvature + self.down_curvature
        return float(self.weights.sum()) * max(1.0 + middle * pressure_kpa, 0.1)

    def series(self, pressure_kpa: FloatArray, memory: FloatArray | None = None) -> FloatArray:
        """Return the elongation [n] under pressures [n] in turn, mm; from a memory, else from the virgin one."""
        plays = _plays(pressure_kpa, self.radii, self.up_curvature, self.down_curvature, memory)
        return np.asarray(self.offset_mm + plays @ self.weights)

    def _bounds(self, pressure_kpa: float) -> tuple[FloatArray, FloatArray]:
        square = pressure_kpa * pressure_kpa
        low = pressure_kpa + self.up_curvature * square - self.radii
        return low, pressure_kpa + self.down_curvature * square + self.radii


def identify(pressure_kpa: FloatArray, elongation_mm: FloatArray, plays: int = _PLAYS) -> HysteresisModel:
    """Return the hysteresis of a run in order of time, NaN where not known, that swings between both ends."""
    known = np.isfinite(pressure_kpa) & np.isfinite(elongation_mm)
    share = max(1, int(known.sum()) // MOST_POINTS)
    pressure, elongation = (_means(values[known], share) for values in (pressure_kpa, elongation_mm))
    if len(pressure) < _LEAST_POINTS:
        raise DataError(f"only {len(pressure)} points of elongation and pressure", "Give a calibration run.")
    low, high = float(pressure.min()), float(pressure.max())
    if high - low < LEAST_SPAN_KPA:
        cause = f"the pressure spans {high - low:.0f} kPa"
        raise DataError(cause, f"Give a run over {LEAST_SPAN_KPA:.0f} kPa or more.")
    near = 0.02 * (high - low)
    first = min(int(np.argmax(pressure >= high - near)), int(np.argmax(pressure <= low + near)))
    radii = 0.5 * (high - low) * np.arange(plays) / plays
    steepest = _STEEPEST / (2.0 * max(-low, high))

    def solved(curvatures: FloatArray) -> tuple[FloatArray, float, float]:
        """Return weights [m], offset and rms for the curvatures of the envelopes."""
        middle, half = float(curvatures[0]), abs(float(curvatures[1]))
        columns = _plays(pressure, radii, middle - half, middle + half)[first:]
        y = elongation[first:]
        mean, level = columns.mean(axis=0), float(y.mean())
        weights, misfit = nnls(columns - mean, y - level)
        return weights, level - float(mean @ weights), float(misfit) / math.sqrt(len(y))

    def cost(scaled: Any) -> float:
        beyond = max(0.0, abs(float(scaled[0])) + abs(float(scaled[1])) - 1.0)
        return solved(scaled / (1.0 + beyond) * steepest)[2] * (1.0 + beyond)

    start = np.array([[0.0, 0.01], [0.2, 0.01], [0.0, 0.05]])
    options: Any = {"initial_simplex": start, "xatol": 1e-4, "fatol": 1e-7, "maxfev": 120}
    best = minimize(cost, start[0], method="Nelder-Mead", options=options).x
    best = best / max(1.0, float(np.abs(best).sum())) * steepest
    weights, offset, rms = solved(best)
    scatter = float(elongation[first:].std())
    r2 = 1.0 - (rms / scatter) ** 2 if scatter > 0 else -math.inf
    if r2 < _LEAST_R2 or not weights.sum() > 0:
        remedy = "Give a run whose pressure rises and falls over the whole range, without a leak or a disturbance."
        raise DataError(f"elongation does not follow pressure (R² {r2:.3f}, at least {_LEAST_R2:g} is needed)", remedy)
    half = abs(float(best[1]))
    found = HysteresisModel(radii, weights, float(best[0]) - half, float(best[0]) + half, offset, (low, high), rms, r2)
    return replace(found, weights=np.where(radii == 0.0, np.maximum(weights, 1e-6), weights))  # it can be inverted


def _means(values: FloatArray, share: int) -> FloatArray:
    """Return the means of `share` neighbours each."""
    whole = len(values) // share * share
    return np.asarray(values[:whole].reshape(-1, share).mean(axis=1), dtype=np.float64)


def _without_curvature(envelope: float, curvature: float) -> float:
    """Return v with v + curvature v^2 = envelope, on the branch through 0; its vertex where there is none."""
    return 2.0 * envelope / (1.0 + math.sqrt(max(1.0 + 4.0 * curvature * envelope, 0.0)))


def _plays(
    pressure_kpa: FloatArray, radii: FloatArray, up: float, down: float, memory: FloatArray | None = None
) -> FloatArray:
    """Return the states [n, m] of plays under pressures [n]; a prefix scan (Hillis, Steele 1986), as clamps compose."""
    square = pressure_kpa * pressure_kpa
    low = (pressure_kpa + up * square)[:, None] - radii
    high = (pressure_kpa + down * square)[:, None] + radii
    shift = 1
    while shift < len(low):
        lower, upper = low[shift:], high[shift:]
        low_of = np.minimum(np.maximum(low[:-shift], lower), upper)
        high_of = np.minimum(np.maximum(high[:-shift], lower), upper)
        low[shift:], high[shift:] = low_of, high_of
        shift *= 2
    start = np.zeros(len(radii)) if memory is None else memory
    return np.asarray(np.minimum(np.maximum(start, low), high))
