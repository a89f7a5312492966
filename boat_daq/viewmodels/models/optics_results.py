"""Results of ray tracing, sweep and search as the optics page shows them: plain arrays."""

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
        """Return P over [spacing, depth] for one number of cavities and one width; NaN where nothing was simulated.

        Parameters
        ----------
        cavities : their number.
        width_mm : of a cavity.
        steps : depths and spacings, mm.
        """
        out = np.full((len(steps), len(steps)), np.nan)
        chosen = (self.values[:, 0] == cavities) & np.isclose(self.values[:, 1], width_mm)
        depth, spacing = (np.abs(self.values[chosen, k, None] - np.array(steps)).argmin(axis=1) for k in (2, 3))
        out[spacing, depth] = self.p[chosen]
        return out


@dataclass(frozen=True, slots=True)
class OptimumSummary:
    """Result of the search beyond the grid: P on detected power, with ten times the rays of the search."""

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
