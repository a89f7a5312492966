"""Rate-independent hysteresis: a generalised Prandtl-Ishlinskii operator.

A play operator clamps its state w into [up(v) - r, down(v) + r] for the input v, so rising inputs follow one envelope
and falling inputs the other (asymmetric loops). A weighted sum of plays with growing radii r has return-point memory (a
closed minor loop erases itself) and congruent minor loops, independent of the rate (M. Al Janaideh, S. Rakheja, C.-Y.
Su, Mechatronics 19, 2009, 656-670). The composition of two clamps is a clamp, so a block of inputs is a prefix scan
over intervals, log2(n) numpy passes; clamping never rounds, so the division into blocks does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from protocol.base.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class PlaySum:
    """Parameters of a weighted sum of play operators; each envelope is v + curvature v^2.

    `up_curvature` <= `down_curvature`, so that the interval is never empty. Both envelopes must rise over the inputs v:
    |v| < 1 / (2 |curvature|).
    """

    radii: tuple[float, ...]
    weights: tuple[float, ...]
    up_curvature: float = 0.0
    down_curvature: float = 0.0

    def __post_init__(self) -> None:
        if len(self.radii) != len(self.weights) or min(self.radii, default=0.0) < 0.0:
            raise ValueError("one weight for each radius, and no radius below zero")
        if self.up_curvature > self.down_curvature:
            raise ValueError("the rising envelope must not lie above the falling one")


class Hysteresis:
    """A `PlaySum` with its memory, at first in the virgin state: all plays at rest under the input 0."""

    def __init__(self, model: PlaySum) -> None:
        self.model = model
        self._radii = np.array(model.radii)
        self.plays = np.zeros(len(model.radii))  # state of each play, (m,)

    def advance(self, inputs: FloatArray) -> FloatArray:
        """Return the output after each of `inputs`, both shape (n,)."""
        if inputs.size == 0:
            return np.empty(0)
        square = inputs * inputs
        low = (inputs + self.model.up_curvature * square)[:, None] - self._radii
        high = (inputs + self.model.down_curvature * square)[:, None] + self._radii
        states = clamp(self.plays, *compose_clamps(low, high))
        self.plays = states[-1]
        # Column by column, not a matrix product: BLAS orders its sums by the size of the block.
        output = np.zeros(inputs.size)
        for column, weight in enumerate(self.model.weights):
            output += weight * states[:, column]
        return output


def clamp(value: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return `value` limited to [low, high]; all broadcast to one shape."""
    clamped: FloatArray = np.minimum(np.maximum(value, low), high)
    return clamped


def compose_clamps(low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return for each row the one clamp equal to all clamps up to and with it; bounds [n, m], row after row.

    Hillis-Steele scan: after the pass with shift s each row holds the composition of its last 2 s clamps.
    """
    low, high = low.copy(), high.copy()
    shift = 1
    while shift < len(low):
        lower, upper = low[shift:], high[shift:]
        composed = clamp(low[:-shift], lower, upper), clamp(high[:-shift], lower, upper)
        low[shift:], high[shift:] = composed
        shift *= 2
    return low, high
