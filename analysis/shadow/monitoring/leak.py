"""A leak behind the gauge, from a cycle against the run's own healthy loop (METHODS.md).

In a cycle the leak is one part in two hundred, under a hysteresis fifty times larger with the same phase. The loop of
the first cycles is therefore subtracted; the rest does not depend on holds nor on where the cycle begins:

    e = c + g p + drift t + loss (integral of p dt) + periodic interference

Drift and leak look alike within a cycle: the slope of e is taken from the mean of the cycle before. The interference,
aliased mains, is the one sine near the cycle's frequency that explains most power beside the other columns, if noise
would not explain as much (J. D. Scargle, ApJ 263, 1982, 835; M. Zechmeister and M. Kuerster, A&A 496, 2009, 577). A
wave that cannot be separated from a harmonic of the cycle is left in: it may be the leak.

A step of pressure whose elongation is not known throughout is left out: the end of a range truncates the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from protocol.base.arrays import BoolArray, FloatArray

LOWEST, _HIGHEST, OVERSAMPLING = 0.4, 3.0, 4.0
"""Frequencies searched, per cycle of the actuator; steps of them in 1 over the whole time."""
_BY_CHANCE = 1e-3
_FEWEST_CYCLES = 3.0


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
    """Return the sine in the values; amplitude 0 where noise alone would show as much, or in less than 3 cycles."""
    span = float(time_s[-1] - time_s[0])
    if span < 0.9 * _FEWEST_CYCLES * period_s:
        return Interference()
    base, size, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    base = base[:, size > 1e-8 * size[0]]
    rest = values - base @ (base.T @ values)
    grid = np.arange(LOWEST / period_s, _HIGHEST / period_s, 1.0 / (OVERSAMPLING * span))
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
    return best if found > 2.0 * variance * np.log(len(grid) / _BY_CHANCE) else Interference()


_STEPS = 48  # equal steps of pressure a branch of the loop
KNOWN_SHARE = 0.97  # a step known by less than this share is left out
LEARNING_S, MEMORY_S, BLOCK_S = 80.0, 400.0, 0.5
"""Time over which the loop is learnt, the interference is searched, and samples are averaged for the search."""
FEWEST_SAMPLES = 10
_WORST_CONDITION = 1e4


def second_branch(pressure_kpa: FloatArray) -> BoolArray:
    """Return the rows after the extreme at which the cycle does not begin."""
    p = pressure_kpa
    turn = int(np.argmin(p) if p[0] > (p.min() + p.max()) / 2.0 else np.argmax(p))
    return np.asarray(np.arange(len(p)) > turn)


@dataclass(frozen=True, slots=True)
class HealthyLoop:
    """Residual of a healthy cycle against pressure."""

    low_kpa: float  # with step_kpa: lower end and width of the steps of pressure
    step_kpa: float
    # pressure_kpa, residual_kpa: means of the steps of each branch; NaN where a step is not known throughout
    pressure_kpa: tuple[FloatArray, FloatArray]
    residual_kpa: tuple[FloatArray, FloatArray]

    @classmethod
    def of(cls, cycles: Sequence[tuple[FloatArray, FloatArray]]) -> HealthyLoop | None:
        """Return the loop of whole cycles, (pressure, residual) of each; None where it is unknown."""
        p, r = (np.concatenate(columns) for columns in zip(*cycles, strict=True))
        later = np.concatenate([second_branch(pressure) for pressure, _ in cycles])
        span = float(np.ptp(p)) if len(p) else 0.0
        if not span > 0.0 or not np.isfinite(r).any():
            return None
        low, step = float(p.min()), span / _STEPS
        place = np.minimum(((p - low) / step).astype(int), _STEPS - 1)
        r = np.where(_throughout(place + _STEPS * later, np.isfinite(r)), r, np.nan)
        means = []
        for branch in (~later, later):
            inside = [branch & (place == k) for k in range(_STEPS)]
            means.append([(p[i].mean(), known_mean(r[i])) for i in inside if i.any()])
        down, up = (np.array(rows).reshape(-1, 2) for rows in means)
        return cls(low, step, (down[:, 0], up[:, 0]), (down[:, 1], up[:, 1]))

    def beyond(self, pressure_kpa: FloatArray, residual_kpa: FloatArray) -> FloatArray:
        """Return another cycle's residual less the loop, kPa; NaN where either is unknown."""
        later = second_branch(pressure_kpa)
        out = np.full(len(pressure_kpa), np.nan)
        for branch, p, r in zip((~later, later), self.pressure_kpa, self.residual_kpa, strict=True):
            if len(p):
                out[branch] = residual_kpa[branch] - np.interp(pressure_kpa[branch], p, r)
        place = np.clip((pressure_kpa - self.low_kpa) / self.step_kpa, 0, _STEPS - 1).astype(int) + _STEPS * later
        return np.where(_throughout(place, np.isfinite(residual_kpa)), out, np.nan)


def drift_between(*cycles: tuple[FloatArray, FloatArray]) -> float:
    """Return the drift between the means of two cycles (times, residuals beyond the loop), kPa/s; 0 where unknown."""
    times = [known_mean(np.where(np.isfinite(beyond), time, np.nan)) for time, beyond in cycles]
    (gap,), (growth,) = np.diff(times), np.diff([known_mean(beyond) for _, beyond in cycles])
    return float(growth / gap) if gap > 0.0 and np.isfinite(growth) else 0.0


def loss_percent_per_min(
    time_s: FloatArray, pressure_kpa: FloatArray, beyond_kpa: FloatArray, drift_kpa_per_s: float | None = None
) -> float:
    """Return the leak behind the gauge, % of the pressure a minute; NaN where the cycle does not determine it.

    `beyond_kpa`: the residual, less the healthy loop where that is known. `drift_kpa_per_s`: its slope from cycle to
    cycle, subtracted from both sides; None: the leak causes all of it.
    """
    known = np.isfinite(beyond_kpa)
    if known.sum() < FEWEST_SAMPLES:
        return np.nan
    t, p, filled, e = time_s - time_s[0], pressure_kpa, integral(time_s, pressure_kpa), beyond_kpa
    if drift_kpa_per_s is not None:
        e = e - drift_kpa_per_s * t
        filled = filled - filled[-1] / t[-1] * t
    design = np.stack([np.ones_like(p), p, filled], axis=1)[known]
    size = np.linalg.norm(design, axis=0)
    if not (size > 0.0).all() or np.linalg.cond(design / size) > _WORST_CONDITION:
        return np.nan
    return 6000.0 * float(np.linalg.lstsq(design / size, e[known], rcond=None)[0][2] / size[2])


def integral(time_s: FloatArray, pressure_kpa: FloatArray) -> FloatArray:
    """Return the pressure's integral over time from the first row on, kPa s."""
    p = pressure_kpa
    return np.concatenate([[0.0], np.cumsum(np.diff(time_s) * (p[1:] + p[:-1]) / 2.0)])


@dataclass(frozen=True, slots=True)
class _Cycle:
    """A stored cycle: time, pressure, residual beyond the loop."""

    time_s: FloatArray
    pressure_kpa: FloatArray
    beyond_kpa: FloatArray

    def coarse(self) -> FloatArray:
        """Return means over `BLOCK_S`, NaN left out: time, beyond, pressure, its integral less its trend."""
        known = np.isfinite(self.beyond_kpa)
        t = self.time_s - self.time_s[0]
        filled = integral(self.time_s, self.pressure_kpa)
        filled = filled - filled[-1] / t[-1] * t
        place = (t / BLOCK_S).astype(int)[known]
        rows = np.bincount(place)
        columns = (self.time_s, self.beyond_kpa, self.pressure_kpa, filled)
        return np.stack([np.bincount(place, c[known])[rows > 0] / rows[rows > 0] for c in columns], axis=1)


class LeakWatch:
    """Figures of a run's leak; after the run-in the loop is learnt for `LEARNING_S`."""

    def __init__(self, run_in_cycles: int) -> None:
        self._run_in, self._cycles = run_in_cycles, 0
        self._loop: HealthyLoop | None = None
        self._kept: list[_Cycle] = []  # residuals until there is a loop, then residuals beyond it

    def take(self, time_s: FloatArray, pressure_kpa: FloatArray, residual_kpa: FloatArray) -> float:
        """Take the next whole cycle; return its leak in % of the pressure a minute, NaN where it is not determined."""
        self._cycles += 1
        rows = np.isfinite(pressure_kpa)
        t, p, r = time_s[rows], pressure_kpa[rows], residual_kpa[rows]
        if self._cycles < self._run_in or np.isfinite(r).sum() < FEWEST_SAMPLES:
            return np.nan
        if self._loop is None:
            self._learn(_Cycle(t, p, r))
            return np.nan
        before = self._kept[-1]
        now = _Cycle(t, p, self._loop.beyond(p, r))
        self._kept = [*(c for c in self._kept if t[-1] - c.time_s[0] <= MEMORY_S), now]
        wave = self._interference()
        e, earlier = (c.beyond_kpa - wave.at(c.time_s) for c in (now, before))
        return loss_percent_per_min(t, p, e, drift_between((before.time_s, earlier), (t, e)))

    def _learn(self, cycle: _Cycle) -> None:
        self._kept.append(cycle)
        if cycle.time_s[-1] - self._kept[0].time_s[0] < LEARNING_S:
            return
        self._loop = HealthyLoop.of([(c.pressure_kpa, c.beyond_kpa) for c in self._kept])
        if self._loop is not None:
            beyond = self._loop.beyond
            self._kept = [_Cycle(c.time_s, c.pressure_kpa, beyond(c.pressure_kpa, c.beyond_kpa)) for c in self._kept]

    def _interference(self) -> Interference:
        """Return the interference in the stored cycles, beside offset, gain and leak that change slowly."""
        t, e, p, filled = np.concatenate([c.coarse() for c in self._kept]).T
        period = float(np.median([c.time_s[-1] - c.time_s[0] for c in self._kept]))
        if len(t) < FEWEST_SAMPLES:
            return Interference()
        age = (t - t.mean()) / max(float(np.ptp(t)), 1e-9)
        columns = [np.ones_like(t), age, age**2, *(f * w for f in (p, filled) for w in (np.ones_like(t), age))]
        return find_interference(t, e, np.stack(columns, axis=1), period)


def _throughout(place: np.ndarray, known: BoolArray) -> BoolArray:
    """Return which rows are known, in a step that is known by `KNOWN_SHARE` or more."""
    rows = np.bincount(place, minlength=2 * _STEPS)
    share = np.bincount(place, known, 2 * _STEPS) / np.maximum(rows, 1)
    return np.asarray(known & (share[place] >= KNOWN_SHARE))


def known_mean(values: FloatArray) -> float:
    """Return the mean of the values that are finite; NaN without any."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else np.nan
