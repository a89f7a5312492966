"""A sequential test for many figures at once: self-starting CUSUM.

T = (x - mean) / (s sqrt(1 + 1/n)) of all healthy values before follows Student's t; as a normal quantile it is an
independent standard normal z (D. M. Hawkins, D. H. Olwell, Cumulative Sum Charts, 1998, ch. 7). S+ = max(0, S+ + z - k)
and S- = max(0, S- - z - k) alarm beyond h. z is clipped, so no single cycle can raise an alarm; the spread is never
smaller than a figure's floor, its least relevant change.
"""

from __future__ import annotations

import numpy as np
from scipy import optimize, stats

from protocol.base.arrays import BoolArray, FloatArray

REFERENCE = 0.5  # k in standard deviations
CLIP = 4.0  # the greatest |z|
_FEWEST = 3  # healthy values before the first test
SPENT = 8  # cycles of history that a self-starting sum loses to its own scatter, found by simulation (map alarms-shift)
FEWEST_FOR_CORRELATION = 20  # a shorter history counts as dependent
CORRELATED = 0.5  # of neighbours, in 1/sqrt(n): more counts as dependent


def cycles_between_alarms(threshold: float | FloatArray) -> FloatArray:
    """Return the mean number of healthy values until a one-sided CUSUM passes `threshold`.

    Siegmund's approximation, ARL = (exp(2 k b) - 2 k b - 1) / (2 k^2) with b = h + 1.166.
    """
    b = 2.0 * REFERENCE * (np.asarray(threshold) + 1.166)
    return np.asarray((np.exp(b) - b - 1.0) / (2.0 * REFERENCE**2))


def threshold_for(cycles: float, sides: int) -> float:
    """Return h so that `sides` one-sided sums together raise one false alarm in `cycles` healthy values."""
    wanted = cycles * sides
    return float(optimize.brentq(lambda h: float(cycles_between_alarms(h)) - wanted, 0.0, 60.0))


def smallest_shift(history: int, threshold: float) -> float:
    """Return the smallest lasting shift, in standard deviations, that a self-starting sum finds; infinite without one.

    The baseline learns the shift d as well: the sum grows to n (d ln(d / k) - d + k) at most, which must reach the
    threshold and its overshoot, 1.166. Nine in ten such shifts are then found.
    """
    if history <= SPENT:
        return float("inf")
    wanted = (threshold + 1.166) / (history - SPENT)

    def short(d: float) -> float:
        return float(d * np.log(d / REFERENCE) - d + REFERENCE - wanted)

    return float(optimize.brentq(short, REFERENCE, 1e6))


class SelfStartingCusum:
    """Sums of many figures; arrays have the shape of `floor`, their smallest spread; a last axis is up and down."""

    def __init__(self, floor: FloatArray) -> None:
        self.floor, shape = floor, floor.shape
        self.tested, self.before, self.last = np.zeros((*shape, 4)), np.zeros((*shape, 2, 4)), np.zeros(shape)
        self.count, self.mean, self.squares = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        self.sums, self.length, self.shift = (np.zeros((*shape, 2)) for _ in range(3))

    def update(self, values: FloatArray) -> FloatArray:
        """Take one value of each figure (NaN: none this time) and return the sums, shape (..., 2).

        `length` counts the values since each sum was last zero, `shift` is their mean distance from the baseline.
        """
        seen = np.isfinite(values)
        x = np.where(seen, values, self.mean)
        z = np.where(seen & (self.count >= _FEWEST), self._normal_score(x), 0.0)
        steps = np.stack([z, -z], axis=-1) - REFERENCE
        sums = np.where(seen[..., None], np.maximum(0.0, self.sums + steps), self.sums)
        running = sums > 0.0
        length = np.where(running, self.length + seen[..., None], 0.0)
        new = np.where(running, self.shift + ((x - self.mean)[..., None] - self.shift) / np.maximum(length, 1.0), 0.0)
        self.shift = np.where(seen[..., None], new, self.shift)
        self.sums, self.length = sums, length
        tested = seen & (self.count >= _FEWEST)
        moments = np.stack([np.ones_like(z), z, z * z, z * self.last], axis=-1)
        self.tested = self.tested + np.where(tested[..., None], moments, 0.0)
        self.last = np.where(tested, z, self.last)
        self.before = np.where(running[..., None], self.before, self.tested[..., None, :])
        self._learn(x, seen)
        return sums

    def dependent(self) -> BoolArray:
        """Return whether the values before each sum's rise correlate, or are fewer than 20, shape (..., 2)."""
        n, total, squares, products = np.moveaxis(self.before, -1, 0)
        n = np.maximum(n, 1.0)
        mean = total / n
        power = np.maximum(squares / n - mean**2, 1e-300)
        correlation = (products / np.maximum(n - 1.0, 1.0) - mean**2) / power
        return np.asarray((n < FEWEST_FOR_CORRELATION) | (correlation > CORRELATED / np.sqrt(n)))

    def spread(self) -> FloatArray:
        """Return the spread that a new value is compared with, its floor included."""
        return np.asarray(np.maximum(np.sqrt(self.squares / np.maximum(self.count - 1.0, 1.0)), self.floor))

    def _normal_score(self, x: FloatArray) -> FloatArray:
        n = np.maximum(self.count, 2.0)
        t = (x - self.mean) / (self.spread() * np.sqrt(1.0 + 1.0 / n))
        tail = np.maximum(stats.t.sf(np.abs(t), n - 1.0), 1e-12)
        return np.asarray(np.clip(np.sign(t) * stats.norm.isf(tail), -CLIP, CLIP))

    def _learn(self, x: FloatArray, seen: FloatArray) -> None:
        self.count = self.count + seen
        gap = x - self.mean
        self.mean = self.mean + np.where(seen, gap / np.maximum(self.count, 1.0), 0.0)
        self.squares = self.squares + np.where(seen, gap * (x - self.mean), 0.0)
