"""The small hysteresis loop of a sensor over elongation, found from its calibration's readings and taken out.

The loop is that of Rayleigh: plays of evenly spread radii about the middle of the range, their mean slope subtracted,
so that it closes at both ends and both branches lie about the curve. Its one parameter is half its width in the middle,
by least squares of the curve's residuals; where these show none, at three standard errors, it is 0.

Source: Lord Rayleigh, Phil. Mag. 23 (1887) 225; as a Prandtl-Ishlinskii model of constant density, M. Brokate,
J. Sprekels, Hysteresis and Phase Transitions (1996), chapter 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from protocol.base.arrays import FloatArray

_PLAYS = 8
_SIGNIFICANT = 3.0
_LEAST_POINTS = 12


@dataclass(frozen=True, slots=True)
class SensorLoops:
    """The loops of a unit's sensors over one range. `half_mv` [sensors]: half the width in the middle, signed."""

    range_mm: tuple[float, float]
    half_mv: FloatArray

    @property
    def radii(self) -> FloatArray:
        half = (self.range_mm[1] - self.range_mm[0]) / 2
        return np.asarray(half * (np.arange(_PLAYS) + 0.5) / _PLAYS)

    def rest(self, elongation_mm: float) -> FloatArray:
        """Return a memory [m] on the curve itself: the true one is not known."""
        return np.full(_PLAYS, elongation_mm - sum(self.range_mm) / 2)

    def after(self, memory: FloatArray, elongation_mm: float) -> FloatArray:
        v = elongation_mm - sum(self.range_mm) / 2
        return np.asarray(np.minimum(np.maximum(memory, v - self.radii), v + self.radii))

    def shape(self, memory: FloatArray, elongation_mm: float) -> float:
        """Return the loop at an instant: 1 on the rising branch in the middle of the range, -1 on the falling one."""
        half, radii = (self.range_mm[1] - self.range_mm[0]) / 2, self.radii
        weight = -1.0 / float(np.minimum(radii, half - radii).sum())
        v = elongation_mm - sum(self.range_mm) / 2
        return weight * float(memory.sum() - v * (half - radii).sum() / half)

    def signal_mv(self, memory: FloatArray, elongation_mm: float) -> FloatArray:
        """Return what the loops add to the signals [sensors], mV."""
        return np.asarray(self.half_mv * self.shape(memory, elongation_mm))


def find_loops(elongation_mm: FloatArray, residual_mv: Sequence[FloatArray]) -> SensorLoops | None:
    """Return the loops of sensors; None where no residual shows one.

    `elongation_mm`: [n] readings in the order of the run, which began at rest. `residual_mv`: for each sensor, signals
    less the curve [n].
    """
    known = np.isfinite(elongation_mm)
    if known.sum() < _LEAST_POINTS:
        return None
    x = elongation_mm[known]
    loops = SensorLoops((float(x.min()), float(x.max())), np.zeros(len(residual_mv)))
    memory, shape = loops.rest(0.0), np.empty(len(x))
    for i, mm in enumerate(x.tolist()):
        memory = loops.after(memory, mm)
        shape[i] = loops.shape(memory, mm)
    away = shape - shape.mean()
    power, found = float(away @ away), []
    for residual in residual_mv:
        y = residual[known] - residual[known].mean()
        half = float(away @ y) / power if power > 0 else 0.0
        rest = y - half * away
        error = float(np.sqrt(rest @ rest / (len(x) - 2) / power)) if power > 0 else np.inf
        found.append(half if abs(half) > _SIGNIFICANT * error else 0.0)
    return SensorLoops(loops.range_mm, np.asarray(found)) if any(found) else None
