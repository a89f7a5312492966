"""Periodic interference in the residuals of several cycles, such as the alias of the mains' flicker.

Strategy: the interference is one sine through all cycles. Everything else that is known (columns of offset, gain, leak,
and their slow change) is projected out of the rows, and out of sine and cosine likewise; over a grid of frequencies
near the cycle's own (elsewhere a wave does no harm) the one that explains most power is the interference, if noise
alone would not explain as much. A wave that the record is too short to separate from a harmonic of the cycle is left
in: it may be the leak itself.

Source: the Lomb-Scargle periodogram with a free baseline (J. D. Scargle, ApJ 263, 1982, 835; M. Zechmeister and
M. Kuerster, A&A 496, 2009, 577).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.arrays import FloatArray

LOWEST, HIGHEST, OVERSAMPLING = 0.4, 3.0, 4.0
"""Frequencies searched, per cycle of the actuator; steps of them in 1 over the whole time."""
BY_CHANCE = 1e-3
FEWEST_CYCLES = 3.0


@dataclass(frozen=True, slots=True)
class Interference:
    """A sine: frequency in Hz, amplitudes of cosine and sine in the unit of the values."""

    frequency_hz: float = 0.0
    cosine: float = 0.0
    sine: float = 0.0

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return the sine at these times."""
        phase = 2.0 * np.pi * self.frequency_hz * time_s
        return np.asarray(self.cosine * np.cos(phase) + self.sine * np.sin(phase))


def find_interference(time_s: FloatArray, values: FloatArray, columns: FloatArray, period_s: float) -> Interference:
    """Return the sine in the values; amplitude 0 where noise alone would show as much, or in less than 3 cycles.

    Parameters
    ----------
    time_s, values : shape (n,), rising.
    columns : shape (n, m), other terms of the values.
    period_s : of the actuator's cycle.
    """
    span = float(time_s[-1] - time_s[0])
    if span < 0.9 * FEWEST_CYCLES * period_s:
        return Interference()
    base, size, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    base = base[:, size > 1e-8 * size[0]]
    rest = values - base @ (base.T @ values)
    grid = np.arange(LOWEST / period_s, HIGHEST / period_s, 1.0 / (OVERSAMPLING * span))
    orders = grid * period_s
    grid = grid[np.abs(orders - np.rint(orders)) * span > period_s]
    best, found, power = Interference(), 0.0, float(rest @ rest)
    for frequency in grid.tolist():
        phase = 2.0 * np.pi * frequency * time_s
        waves = np.stack([np.cos(phase), np.sin(phase)], axis=1)
        waves -= base @ (base.T @ waves)
        amplitude = np.linalg.lstsq(waves, rest, rcond=1e-6)[0]
        taken = float(rest @ (waves @ amplitude))
        if taken > found:
            best, found = Interference(frequency, float(amplitude[0]), float(amplitude[1])), taken
    # power explained in noise over the noise's variance is chi-squared with two degrees: exp(-taken / 2 variance)
    variance = (power - found) / max(len(values) - base.shape[1] - 3, 1)
    return best if found > 2.0 * variance * np.log(len(grid) / BY_CHANCE) else Interference()
