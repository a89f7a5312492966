"""A sequential test for many figures at once: self-starting CUSUM.

Strategy: each new value is compared with all healthy values before it: T = (x - mean) / (s sqrt(1 + 1/n)) follows
Student's t with n - 1 degrees of freedom, and its quantile turned into a normal one is an independent standard
normal z for every cycle, however short the history (D. M. Hawkins, D. H. Olwell, Cumulative Sum Charts, 1998, ch. 7).
Two sums, S+ = max(0, S+ + z - k) and S- = max(0, S- - z - k), alarm beyond h. h follows from the wanted number of
healthy cycles between false alarms by Siegmund's formula.

Rules: z is clipped, so no single cycle can raise an alarm; the spread is never taken smaller than a figure's floor, the
change that nobody cares about, so that a very quiet actuator does not cry over trifles.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import optimize, stats

from analysis.shadow.arrays import Floats

REFERENCE = 0.5
CLIP = 4.0
FEWEST = 3
"""k in standard deviations; the greatest |z|; healthy values before the first test."""


def cycles_between_alarms(threshold: float | Floats, reference: float = REFERENCE) -> Floats:
    """Return the mean number of healthy values until a one-sided CUSUM passes `threshold`.

    Siegmund's approximation, ARL = (exp(2 k b) - 2 k b - 1) / (2 k^2) with b = h + 1.166.
    """
    b = 2.0 * reference * (np.asarray(threshold) + 1.166)
    return np.asarray((np.exp(b) - b - 1.0) / (2.0 * reference**2))


def threshold_for(cycles: float, sides: int, reference: float = REFERENCE) -> float:
    """Return h so that `sides` one-sided sums together raise one false alarm in `cycles` healthy values."""
    wanted = cycles * sides
    return float(optimize.brentq(lambda h: float(cycles_between_alarms(h, reference)) - wanted, 0.0, 60.0))


@dataclass(slots=True)
class SelfStartingCusum:
    """Sums of many figures side by side; arrays have the shape of `floor`, a last axis of two holds up and down.

    Parameters
    ----------
    floor : smallest spread taken for each figure.
    """

    floor: Floats
    count: Floats = field(init=False)
    mean: Floats = field(init=False)
    squares: Floats = field(init=False)
    sums: Floats = field(init=False)
    length: Floats = field(init=False)
    shift: Floats = field(init=False)

    def __post_init__(self) -> None:
        shape = self.floor.shape
        self.count, self.mean, self.squares = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        self.sums, self.length, self.shift = (np.zeros((*shape, 2)) for _ in range(3))

    def update(self, values: Floats) -> Floats:
        """Take one value of each figure (NaN: none this time) and return the sums, shape (..., 2).

        `length` counts the values since each sum last stood at zero, `shift` is their mean distance from the baseline.
        """
        seen = np.isfinite(values)
        x = np.where(seen, values, self.mean)
        z = np.where(seen & (self.count >= FEWEST), self._normal_score(x), 0.0)
        steps = np.stack([z, -z], axis=-1) - REFERENCE
        sums = np.where(seen[..., None], np.maximum(0.0, self.sums + steps), self.sums)
        running = sums > 0.0
        length = np.where(running, self.length + seen[..., None], 0.0)
        new = np.where(running, self.shift + ((x - self.mean)[..., None] - self.shift) / np.maximum(length, 1.0), 0.0)
        self.shift = np.where(seen[..., None], new, self.shift)
        self.sums, self.length = sums, length
        self._learn(x, seen)
        return sums

    def _normal_score(self, x: Floats) -> Floats:
        n = np.maximum(self.count, 2.0)
        spread = np.maximum(np.sqrt(self.squares / (n - 1.0)), self.floor)
        t = (x - self.mean) / (spread * np.sqrt(1.0 + 1.0 / n))
        tail = np.maximum(stats.t.sf(np.abs(t), n - 1.0), 1e-12)
        return np.asarray(np.clip(np.sign(t) * stats.norm.isf(tail), -CLIP, CLIP))

    def _learn(self, x: Floats, seen: Floats) -> None:
        self.count = self.count + seen
        gap = x - self.mean
        self.mean = self.mean + np.where(seen, gap / np.maximum(self.count, 1.0), 0.0)
        self.squares = self.squares + np.where(seen, gap * (x - self.mean), 0.0)
