"""The elongation that the controller acts on: all sensors fused by their variances, the lost ones left out.

A sensor is lost, and stays so, when its signal is far outside its calibrated range while another is not, or when it
repeats one reading although its noise is more than half a step of the converter. Sensors that disagree, one of them
perhaps just outside its range, are not lost: which one is wrong is unknown.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.calibration.inverse import DISAGREEMENT_SIGMA, Fusion
from analysis.elongation_control.sensor_loop import SensorLoops
from protocol.base.arrays import FloatArray
from protocol.base.units import COVERAGE_FACTOR

FROZEN_SAMPLES = 30
ALONE_S = 0.12
LOST_SHARE = 0.5  # of the full-scale output: a signal farther beyond its calibrated range is that of no sensor


@dataclass(frozen=True, slots=True)
class FusedElongation:
    """A period's elongation: NaN where unknown; `u_mm` of one sample, k = 2; `lost` are the sensors newly lost."""

    mm: float
    u_mm: float
    disagreement: bool
    lost: tuple[int, ...] = ()


class SensorWatch:
    """Fuses the sensors of one unit; where `step_mv` is 0, unknown, a constant signal is no sign of a loss."""

    def __init__(self, fusion: Fusion, step_mv: float = 0.0, loops: SensorLoops | None = None) -> None:
        n = len(fusion.inverses)
        self.fusion = fusion
        self._loops, self._memory, self._mm = loops, None if loops is None else loops.rest(0.0), 0.0
        self.lost = np.zeros(n, dtype=bool)
        self._same, self._newest, self._out_s = np.zeros(n, dtype=np.int64), np.full(n, np.nan), np.zeros(n)
        ends = np.sort(np.asarray([one.nodes[[0, -1]] for one in fusion.inverses]), axis=1)
        slopes = np.ptp(ends, axis=1) / [np.ptp(one.x_range) for one in fusion.inverses]
        noise_mv = np.asarray([np.median(one.noise_mm) for one in fusion.inverses]) * slopes
        self._noisy = (step_mv > 0.0) & (noise_mv > 0.5 * step_mv)
        self._ends_mv = ends
        beyond_mv = LOST_SHARE * np.ptp(ends, axis=1)
        self._least_mv, self._most_mv = ends[:, 0] - beyond_mv, ends[:, 1] + beyond_mv

    @property
    def range_mm(self) -> tuple[float, float]:
        """The elongations that every sensor is calibrated for."""
        lows, highs = zip(*(one.x_range for one in self.fusion.inverses), strict=True)
        return max(lows), min(highs)

    def measure(self, signal_mv: FloatArray, dt_s: float) -> FusedElongation:
        """Return the elongation of the samples' mean. `signal_mv`: [n, sensors] of one period, NaN where not usable."""
        known = np.isfinite(signal_mv)
        count = known.sum(axis=0)
        mean = np.where(count, np.where(known, signal_mv, 0.0).sum(axis=0), np.nan) / np.maximum(count, 1)
        new = self._find_lost(signal_mv, mean, dt_s)
        mean = np.where(self.lost, np.nan, mean)
        if self._loops is not None and self._memory is not None:
            mean = mean - self._loops.signal_mv(self._memory, self._mm)
        found = self.fusion.evaluate(mean[None, :])
        mm, u = float(found.elongation_mm[0]), float(found.standard_uncertainty_mm[0])
        if self._loops is not None and self._memory is not None and np.isfinite(mm):
            self._memory, self._mm = self._loops.after(self._memory, mm), mm
        disagree = bool(found.disagreement[0]) or self._one_outside(mean, mm, u)
        return FusedElongation(mm, COVERAGE_FACTOR * u, disagree, new)

    def _one_outside(self, mean: FloatArray, mm: float, u: float) -> bool:
        """Return whether a sensor is outside its range although the others are well inside theirs."""
        beyond = np.flatnonzero((mean < self._ends_mv[:, 0]) | (mean > self._ends_mv[:, 1]))
        for i in beyond:  # the nearest end of its range is the least that it can disagree by
            end = self.fusion.inverses[i]([mean[i]], clamp=True)
            u_end = self.fusion.inverses[i].standard_uncertainty(end)
            if abs(float(end[0]) - mm) > DISAGREEMENT_SIGMA * float(np.hypot(u, u_end)[0]):
                return True
        return False

    def _find_lost(self, signal_mv: FloatArray, mean: FloatArray, dt_s: float) -> tuple[int, ...]:
        """Mark the sensors that are lost from now on, and return their numbers."""
        inside = (mean >= self._least_mv) & (mean <= self._most_mv)
        alone = np.isfinite(mean) & ~inside & bool((inside & ~self.lost).any())
        self._out_s = np.where(alone, self._out_s + dt_s, 0.0)
        if len(signal_mv):
            newest = signal_mv[-1]
            same = (signal_mv == newest).all(axis=0)
            self._same = np.where(same, np.where(newest == self._newest, self._same, 0) + len(signal_mv), 0)
            self._newest = newest
        frozen = self._noisy & (self._same >= FROZEN_SAMPLES)
        new = ~self.lost & (frozen | (self._out_s > ALONE_S))
        self.lost = self.lost | new
        return tuple((np.flatnonzero(new) + 1).tolist())
