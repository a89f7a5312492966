"""What the optical helper hands to its page: plain arrays, ready to be drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.arrays import FloatArray

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class StateScene:
    """One state, mm along and across the actuator: polylines [k, 2] with NaN between their parts."""

    outline: FloatArray
    released: FloatArray
    secondary: FloatArray
    receiver: FloatArray


@dataclass(frozen=True, slots=True)
class DesignResult:
    """One design in all states."""

    values: tuple[int, float, float, float]
    face: str
    scenes: tuple[StateScene, ...]
    elongation_mm: FloatArray
    ndr: FloatArray
    ndr_sd: FloatArray
    andr: FloatArray
    power: FloatArray
    p: float
    delta: float
    n_sign: int
    rmse: float


@dataclass(frozen=True, slots=True)
class SweepSummary:
    """A sweep: `values` [n, 4] cavities, width, depth, spacing; the rest [n], P normalised by its maximum."""

    values: FloatArray
    p: FloatArray
    delta: FloatArray
    rmse: FloatArray
    n_sign: FloatArray
    tied: Flags
    front: Flags
    best: int
    paper: int
    ranks: NDArray[np.int64]
    seconds: float
    simulated: int
    hits: int
    rays: int

    def grid(self, cavities: int, width_mm: float, steps: tuple[float, ...]) -> FloatArray:
        """Return P over [spacing, depth] for one number of cavities and one width; NaN where nothing was simulated."""
        out = np.full((len(steps), len(steps)), np.nan)
        chosen = (self.values[:, 0] == cavities) & np.isclose(self.values[:, 1], width_mm)
        for (_, _, depth, spacing), p in zip(self.values[chosen], self.p[chosen], strict=True):
            out[int(np.argmin(np.abs(np.array(steps) - spacing))), int(np.argmin(np.abs(np.array(steps) - depth)))] = p
        return out


@dataclass(frozen=True, slots=True)
class OptimumSummary:
    """What the search beyond the grid found: P on detected power, judged with ten times the rays of the search."""

    values: tuple[int, float, float, float]
    face: str
    p: float
    start: tuple[int, float, float, float]
    start_p: float
    paper_p: float
    designs: int
    seconds: float
    checked_rays: int
    finished: bool
