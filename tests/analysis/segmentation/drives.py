"""Pressures that go up and down over and over, with the times at which they truly do: triangles and staircases.

Strategy: a drive is a line through corners, so that it may be sampled at any rate and phase, and the time at which it
passes a level is exact. Ramps and holds vary from one to the next as those of a pump and of an operator do, or else the
periods would be the same multiple of the sampling interval throughout.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from analysis.segmentation.strokes import find_strokes, thresholds
from protocol.base.arrays import FloatArray

LOW_KPA, SPAN_KPA = -40.0, 90.0
HOLDS_DIFFER, RAMPS_DIFFER = 0.10, 0.05


def half_widths(
    time_s: np.ndarray, x: np.ndarray, y: np.ndarray, up_rows: np.ndarray, samples: int = 15
) -> tuple[float, float]:
    """Mean and sd over cycles of half the distance of the branches' means over 30 to 70 % of the stroke above 2 mm/s.

    The branch is the direction of a moving mean of x over so many samples; of one it is the sign of each step, as the
    published reference takes it, wrong for up to 0.9 % of the samples, which makes it up to 2.6 % smaller.
    """
    low, high = np.percentile(x, [1, 99])
    padded = np.pad(x, samples // 2, mode="edge")
    speed = np.gradient(np.convolve(padded, np.full(samples, 1.0 / samples), "valid"), time_s)
    inside = ((x - low) / (high - low) >= 0.3) & ((x - low) / (high - low) <= 0.7) & (np.abs(speed) > 2.0)
    found = []
    for first, last in itertools.pairwise(up_rows.tolist()):
        rows = np.arange(first, last)
        up, down = (y[rows[inside[rows] & (way * speed[rows] > 0)]].mean() for way in (1, -1))
        found.append(0.5 * abs(up - down))
    return float(np.mean(found)), float(np.std(found, ddof=1))


@dataclass(frozen=True, slots=True)
class DrivenRun:
    """The samples of a drive, s and kPa, and the times and pressures of its corners."""

    time_s: FloatArray
    pressure_kpa: FloatArray
    at_s: FloatArray
    corners_kpa: FloatArray

    def periods_s(self, level_kpa: float) -> FloatArray:
        """Return the true times from one passage of a level to the next, upwards."""
        at, corners = self.at_s, self.corners_kpa
        before = np.flatnonzero((corners[:-1] < level_kpa) & (corners[1:] >= level_kpa))
        share = (level_kpa - corners[before]) / (corners[before + 1] - corners[before])
        return np.diff(at[before] + share * (at[before + 1] - at[before]))

    def errors_s(self) -> FloatArray:
        """Return the errors of the periods that are found; one of inf if strokes are missed."""
        time_s, kpa = self.time_s, self.pressure_kpa
        rises, periods = time_s[find_strokes(time_s, kpa, kpa).up_rows], self.periods_s(thresholds(kpa)[1])
        return np.array([np.inf]) if rises.size != periods.size + 1 else np.diff(rises) - periods


@dataclass(frozen=True, slots=True)
class Drive:
    """Cycles from the upper end down and back.

    Parameters
    ----------
    dwell_s : duration of each hold; 0 for none.
    """

    cycles: int
    steps: int
    dwell_s: float
    ramp_kpa_per_s: float
    rate_hz: float
    noise_kpa: float

    def run(self, rng: np.random.Generator) -> DrivenRun:
        """Return a run with random lengths of holds and ramps, phase of the samples and noise."""
        way = LOW_KPA + SPAN_KPA * np.linspace(1.0, 0.0, self.steps + 1)
        levels = np.concatenate([way[:1], *[way[1:], way[-2::-1]] * self.cycles])
        lengths = np.empty(2 * levels.size - 1)
        lengths[::2] = self.dwell_s * rng.uniform(1.0 - HOLDS_DIFFER, 1.0 + HOLDS_DIFFER, levels.size)
        speed = self.ramp_kpa_per_s * rng.uniform(1.0 - RAMPS_DIFFER, 1.0 + RAMPS_DIFFER, levels.size - 1)
        lengths[1::2] = np.abs(np.diff(levels)) / speed
        at, corners = np.concatenate([[0.0], np.cumsum(lengths)]), np.repeat(levels, 2)
        time_s = np.arange(rng.uniform(0.0, 1.0 / self.rate_hz), at[-1], 1.0 / self.rate_hz)
        noise = self.noise_kpa * rng.standard_normal(time_s.size)
        return DrivenRun(time_s, np.interp(time_s, at, corners) + noise, at, corners)
