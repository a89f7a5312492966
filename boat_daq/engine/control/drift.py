"""Is a plateau steady? A drift with its own uncertainty, from samples that are not independent.

The slope of a least-squares line through the window is the drift of a channel; its standard error follows from the
residuals' scatter. Neighbouring samples resemble each other (the pump's lag, the converter's filter), so n samples
count only as n_eff = n (1 - r) / (1 + r), r the residuals' lag-1 autocorrelation (Santer et al., J. Geophys. Res. 105
(2000) 7337, eq. 6), never more than n.

A plateau is steady when no drift faster than a stated tolerance is credible: |slope| + k * standard error <= tolerance,
in every channel. This is a test of equivalence. A test that the slope does not differ from zero would pass any channel
that is noisy enough. Here a noisier channel needs a longer window.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from protocol.base.uncertainty import COVERAGE_FACTOR

_MIN_SAMPLES = 8
MIN_EFFECTIVE = 3.0


@dataclass(frozen=True, slots=True)
class Drift:
    """Slope of a channel over a window."""

    slope: float  # unit per second
    std_error: float
    scatter: float  # rms of the residuals, in the channel's unit
    n_eff: float

    def within(self, tolerance: float) -> bool:
        """Whether no drift faster than `tolerance` (unit per second) is credible."""
        return abs(self.slope) + COVERAGE_FACTOR * self.std_error <= tolerance


def drift(time_s: NDArray[np.float64], values: NDArray[np.float64]) -> Drift:
    """Return the drift of `values` [n] over `time_s` [n].

    Too few samples, or samples of one instant, give an infinite standard error, so that nothing follows from them.
    """
    n = len(values)
    t = time_s - time_s.mean() if n else time_s
    s_tt = float(t @ t)
    if n < _MIN_SAMPLES or s_tt == 0 or not np.isfinite(values).all():
        return Drift(0.0, math.inf, math.inf, 0.0)
    slope = float(t @ (values - values.mean()) / s_tt)
    residuals = values - values.mean() - slope * t
    energy = float(residuals @ residuals)
    if energy <= 1e-24 * max(1.0, float(values @ values)):  # a straight line within rounding
        return Drift(slope, 0.0, 0.0, float(n))
    r = min(max(float(residuals[1:] @ residuals[:-1]) / energy, 0.0), 0.999)
    n_eff = n * (1 - r) / (1 + r)
    if n_eff < MIN_EFFECTIVE:
        return Drift(slope, math.inf, math.sqrt(energy / n), n_eff)
    variance = energy / n * n_eff / (n_eff - 2)
    return Drift(slope, math.sqrt(variance / s_tt * n / n_eff), math.sqrt(energy / n), n_eff)
