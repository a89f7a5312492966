"""What the plateaus of a cycle differ by together from those of the other cycles: one-way random effects.

What is shared has the degrees of freedom of the cycles, the rest those of the plateaus. Only places that every cycle
has are compared.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy import stats

from analysis.segmentation.loops import Loops
from analysis.segmentation.serial_correlation import RANDOM_WALK, Dependence
from protocol.base.arrays import BoolArray, FloatArray

_FEWEST_PAIRS, _WANDERING = 12, 2.6  # standard errors: 0.5 %, one-sided


@dataclass(frozen=True, slots=True)
class CycleEffect:
    """What the plateaus of a cycle differ by together from those of other cycles; `places` is how many each cycle has.

    `mean_variance` is of the means of the cycles, mV^2, `dependence` of their order. The effect moved the curve too:
    the error of a mean over n cycles adds 1/n of its variance. Analysis of variance (S. R. Searle, G. Casella, C. E.
    McCulloch, Variance Components, 1992, 3.6); degrees of freedom of the sum by Welch and Satterthwaite.
    """

    cycles: int
    places: int
    mean_variance: float
    own_variance: float
    dependence: Dependence = field(default_factory=lambda: Dependence(2, 1))

    @classmethod
    def of(cls, loops: Loops, sensor: int) -> CycleEffect:
        """Assess the cycles of a run; no variance where it has one only."""
        values = np.where(loops.own, loops.signal_mv[sensor], np.nan)
        whole = np.asarray(np.isfinite(values).all(axis=1))
        cycles, places = loops.n_cycles, int(whole.sum())
        if cycles < 2 or places < 2:
            return cls(cycles, places, 0.0, 0.0, Dependence(max(cycles, 2), 1))
        away = values.transpose(1, 0, 2)[:, whole]
        away = away - away.mean(axis=0)
        means = away.mean(axis=1)
        own = float(((away - means[:, None]) ** 2).sum()) / ((cycles - 1) * (places - 1))
        found = replace(Dependence.of(means, 2), columns=1)
        if _wanders(values.transpose(1, 0, 2), whole):
            found = replace(found, rho=RANDOM_WALK)
        return cls(cycles, places, float(means @ means) / (cycles - 1), own, found)

    def _parts(self, repeatability: float, drift: float) -> tuple[float, float]:
        """Return the variances of what the cycles differ by together, with its error of the curve, and of the rest."""
        shared = self.mean_variance - self.own_variance / max(self.places, 1) - drift**2
        shared = min(max(shared, 0.0), repeatability**2)
        ahead = 1.0 + 1.0 / max(self.cycles, 1)
        if self.dependence.noticed:  # few degrees of freedom: as much more as k = 2 covers less with them
            ahead = self.dependence.next_share * (stats.t.ppf(0.975, max(self.dependence.dof, 2.0)) / 2.0) ** 2
        return shared * ahead, repeatability**2 - shared

    def repeatability(self, pooled: float, drift: float) -> float:
        """Return the repeatability of a reading in a further cycle, mV, of the pooled one without the drift."""
        return float(np.sqrt(sum(self._parts(pooled, drift))))

    def dof(self, pooled: float, drift: float) -> float:
        """Return the degrees of freedom of `repeatability`."""
        of_cycles, of_plateaus = self._parts(pooled, drift)
        rows = self.dependence.dof if self.dependence.noticed else max(self.cycles - 1, 1)
        rest = float(max(self.cycles - 1, 1) * max(self.places - 1, 1))
        small = of_cycles**2 / rows + of_plateaus**2 / rest
        return (of_cycles + of_plateaus) ** 2 / small if small > 0.0 else rest

    def upper_mv(self, share: float) -> float:
        """Return the upper limit of what a further cycle may differ by from the curve, at a one-sided confidence."""
        if self.cycles < 2:
            return 0.0
        rows = self.cycles - 1
        limit = self.mean_variance * rows / float(stats.chi2.ppf(1.0 - share, rows))
        return float(np.sqrt(limit * (1.0 + 1.0 / self.cycles)))

    def interval(self, pooled: float) -> tuple[float, float]:
        """Return the 95 % interval of a pooled sd over the cycles: that of a normal sample of as many degrees."""
        dof = self.dof(pooled, 0.0)
        low, high = (float(np.sqrt(dof / stats.chi2.ppf(share, dof))) for share in (0.975, 0.025))
        of_cycles, rest = self._parts(pooled, 0.0)  # cycles that depend on one another scatter less than they may
        more = (of_cycles / self.dependence.variance_share + rest) / max(of_cycles + rest, np.finfo(float).tiny)
        return pooled * low, pooled * high * float(np.sqrt(more))


def _wanders(values: FloatArray, whole: BoolArray) -> bool:
    """Return whether neighbours in a cycle differ from their means alike, as a random walk makes them.

    `values` are [cycles, 2, levels], `whole` [2, levels] those that all cycles have. The lag-1 correlation along the
    branches, of what is left without the cycles' means, is tested by its standard error for independent values.
    """
    away = np.where(whole, values, 0.0)
    away = np.where(whole, away - away.mean(axis=0), 0.0)
    away = np.where(whole, away - away.sum(axis=(1, 2), keepdims=True) / max(int(whole.sum()), 1), 0.0)
    pairs, squares = whole[:, 1:] & whole[:, :-1], float((away**2).sum())
    count = int(pairs.sum()) * (values.shape[0] - 1)
    if count < _FEWEST_PAIRS or not squares > 0.0:
        return False
    mean_square = squares / (values.shape[0] * int(whole.sum()))
    products = float((away[:, :, 1:] * away[:, :, :-1])[:, pairs].sum()) / (values.shape[0] * int(pairs.sum()))
    return bool(products / mean_square * np.sqrt(count) > _WANDERING)
