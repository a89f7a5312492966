"""A leak behind the gauge, from one cycle against the healthy loop.

Strategy: the board holds the gauge's pressure, so a leak between gauge and bladder is not seen in it. What is seen is
the elongation: its pressure p_nom(x) falls behind the gauge, r = p - p_nom(x) fills at r' = loss p and forgets nothing
until the valve opens. Within a cycle that is one part in two hundred, under a hysteresis fifty times larger with the
same phase. So the first whole cycle of a run is kept as the healthy loop (`Loop`, residual against pressure on both
branches) and taken off; what is left knows neither how long a hold was nor where the cycle was cut, and

    e = c + g p + drift t + loss (integral of p dt)

has offset c and gain g to itself. Drift and leak look alike within a cycle, but not from cycle to cycle: the slope of e
is taken from the mean of the cycle before, and both e and the integral are freed of it.

Rules: arrays of one cycle, time in s, pressure in kPa, NaN where the residual is unknown. A step of pressure in which
the elongation is not known throughout is left out as a whole: the end of a calibration's range cuts noise on one side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.shadow.arrays import Booleans, Floats

STEPS = 24
KNOWN_SHARE = 0.97
"""The loop is kept in so many equal steps of pressure a branch; a step known by less than this share is left out."""
FEWEST_SAMPLES = 10
WORST_CONDITION = 1e4


def second_branch(pressure_kpa: Floats) -> Booleans:
    """Return which rows come after the extreme that the cycle does not begin at."""
    p = pressure_kpa
    turn = int(np.argmin(p) if p[0] > (p.min() + p.max()) / 2.0 else np.argmax(p))
    return np.asarray(np.arange(len(p)) > turn)


@dataclass(frozen=True, slots=True)
class Loop:
    """Residual of a healthy cycle against pressure.

    Parameters
    ----------
    low_kpa, step_kpa : where the steps of pressure begin, and their width.
    pressure_kpa, residual_kpa : of each branch, the steps' means; NaN where a step is not known throughout.
    """

    low_kpa: float
    step_kpa: float
    pressure_kpa: tuple[Floats, Floats]
    residual_kpa: tuple[Floats, Floats]

    @classmethod
    def of(cls, pressure_kpa: Floats, residual_kpa: Floats) -> Loop | None:
        """Return the loop of one cycle, shape (n,) each; None where pressure stands still or nothing is known."""
        p, span = pressure_kpa, float(np.ptp(pressure_kpa)) if len(pressure_kpa) else 0.0
        if not span > 0.0 or not np.isfinite(residual_kpa).any():
            return None
        low, step, later = float(p.min()), span / STEPS, second_branch(p)
        place = np.minimum(((p - low) / step).astype(int), STEPS - 1)
        r = np.where(_throughout(place + STEPS * later, np.isfinite(residual_kpa)), residual_kpa, np.nan)
        means = []
        for branch in (~later, later):
            inside = [branch & (place == k) for k in range(STEPS)]
            means.append([(p[i].mean(), _known_mean(r[i])) for i in inside if i.any()])
        down, up = (np.array(rows).reshape(-1, 2) for rows in means)
        return cls(low, step, (down[:, 0], up[:, 0]), (down[:, 1], up[:, 1]))

    def beyond(self, pressure_kpa: Floats, residual_kpa: Floats) -> Floats:
        """Return by how much another cycle's residual is above the loop, kPa; NaN where either is not known."""
        later = second_branch(pressure_kpa)
        out = np.full(len(pressure_kpa), np.nan)
        for branch, p, r in zip((~later, later), self.pressure_kpa, self.residual_kpa, strict=True):
            if len(p):
                out[branch] = residual_kpa[branch] - np.interp(pressure_kpa[branch], p, r)
        place = np.clip((pressure_kpa - self.low_kpa) / self.step_kpa, 0, STEPS - 1).astype(int) + STEPS * later
        return np.where(_throughout(place, np.isfinite(residual_kpa)), out, np.nan)


@dataclass(frozen=True, slots=True)
class Level:
    """Mean of what a cycle had beyond the loop, kPa, and the mean time of it, s."""

    time_s: float
    beyond_kpa: float

    @classmethod
    def of(cls, time_s: Floats, beyond_kpa: Floats) -> Level:
        """Return the level of a cycle; NaN where nothing is known."""
        known = np.isfinite(beyond_kpa)
        return cls(_known_mean(np.where(known, time_s, np.nan)), _known_mean(beyond_kpa))

    def slope_since(self, before: Level) -> float:
        """Return the drift between two cycles, kPa/s; 0 where there is none to tell."""
        gap = self.time_s - before.time_s
        slope = (self.beyond_kpa - before.beyond_kpa) / gap if gap > 0.0 else np.nan
        return float(slope) if np.isfinite(slope) else 0.0


def loss_percent_per_min(
    time_s: Floats, pressure_kpa: Floats, beyond_kpa: Floats, drift_kpa_per_s: float | None = None
) -> float:
    """Return the leak behind the gauge, % of the pressure a minute; NaN where the cycle does not determine it.

    Parameters
    ----------
    time_s, pressure_kpa : shape (n,), one cycle.
    beyond_kpa : shape (n,), its residual, less the healthy loop where there is one.
    drift_kpa_per_s : slope of it from cycle to cycle, which both sides are freed of; None: the leak makes all of it.
    """
    known = np.isfinite(beyond_kpa)
    if known.sum() < FEWEST_SAMPLES:
        return np.nan
    t, p = time_s - time_s[0], pressure_kpa
    filled = np.concatenate([[0.0], np.cumsum(np.diff(t) * (p[1:] + p[:-1]) / 2.0)])
    e = beyond_kpa
    if drift_kpa_per_s is not None:
        e = e - drift_kpa_per_s * t
        filled = filled - filled[-1] / t[-1] * t
    design = np.stack([np.ones_like(p), p, filled], axis=1)[known]
    size = np.linalg.norm(design, axis=0)
    if not (size > 0.0).all() or np.linalg.cond(design / size) > WORST_CONDITION:
        return np.nan
    return 6000.0 * float(np.linalg.lstsq(design / size, e[known], rcond=None)[0][2] / size[2])


class LeakWatch:
    """Figures of a run's leak, cycle after cycle.

    Parameters
    ----------
    run_in_cycles : the last of these is the healthy loop; until it is known the leak is NaN.
    """

    def __init__(self, run_in_cycles: int) -> None:
        self._run_in, self._cycles = run_in_cycles, 0
        self._loop: Loop | None = None
        self._before = Level(np.nan, np.nan)

    def take(self, time_s: Floats, pressure_kpa: Floats, residual_kpa: Floats) -> float:
        """Take the next whole cycle, shape (n,) each; return its leak in % of the pressure a minute."""
        self._cycles += 1
        rows = np.isfinite(pressure_kpa)
        time_s, pressure_kpa, residual_kpa = time_s[rows], pressure_kpa[rows], residual_kpa[rows]
        if self._loop is None:
            if self._cycles >= self._run_in:
                self._loop = Loop.of(pressure_kpa, residual_kpa)
            if self._loop is not None:
                self._before = Level.of(time_s, self._loop.beyond(pressure_kpa, residual_kpa))
            return np.nan
        beyond = self._loop.beyond(pressure_kpa, residual_kpa)
        level, before = Level.of(time_s, beyond), self._before
        self._before = level
        return loss_percent_per_min(time_s, pressure_kpa, beyond, level.slope_since(before))


def _throughout(place: np.ndarray, known: Booleans) -> Booleans:
    """Return which rows are known, in a place that is known by `KNOWN_SHARE` or more."""
    rows = np.bincount(place, minlength=2 * STEPS)
    share = np.bincount(place, known, 2 * STEPS) / np.maximum(rows, 1)
    return np.asarray(known & (share[place] >= KNOWN_SHARE))


def _known_mean(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else np.nan
