"""Whether the holds of a staircase are settled: the trend of the signal within them, tested against noise.

Linear creep moves a signal after each step by gamma times the lag, the sum of all steps before, each decayed by
exp(-t / tau). One gamma and one tau describe all holds of a run, so that their trends are tested together (t-test of
the holds' own values of gamma); what the positions move by besides, such as a leak makes, is tested by F. Of a run that
is not settled the lag gives what is left to come. The upper limit of tau is that of the profile likelihood.
Source: W. N. Findley, J. S. Lai, K. Onaran, Creep and Relaxation of Nonlinear Viscoelastic Materials (1976), 5.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy import stats

from analysis.data.recording import Recording
from analysis.json_object import json_object
from analysis.segmentation.plateaus import Plateau
from protocol.base.arrays import FloatArray, IntArray

_BY_CHANCE = 1e-3  # of such trends in settled holds
_PARTS = 4  # of a hold
_TIMES = (0.2, 10.0, 24)  # time constants tried, in lengths of a hold, and their number
_LONGEST_EXPONENT = 60.0  # beyond it a creep is over, whatever its size
_ITERATIONS, _MOST_CREEP = 3, 0.5
_MARGIN = 1.2  # of what is still to come: an elongation creeps, the signal follows its curve
_WITHIN = 3.84  # of chi-square: 95 % of the profile likelihood


@dataclass(frozen=True, slots=True)
class Settling:
    """The test of one sensor's holds; `p_value` is NaN where nothing was tested.

    `held_s` is the median time of a hold; `remaining_mv` [plateaus] what each is still to move by, zeros where settled.
    """

    p_value: float
    held_s: float
    remaining_mv: FloatArray
    time_constant_s: float = float("nan")

    @property
    def settled(self) -> bool:
        """Whether the holds move by no more than noise."""
        return not self.p_value < _BY_CHANCE

    @property
    def most_mv(self) -> float:
        """The most that a hold is still to move by."""
        return float(np.abs(self.remaining_mv).max(initial=0.0))

    @property
    def u_mv(self) -> float:
        """Standard uncertainty of a signal at some time between the dwell and rest: rectangular from zero."""
        moving = self.remaining_mv[self.remaining_mv != 0.0]
        return float(np.sqrt(np.mean(moving**2) / 3.0)) if moving.size else 0.0

    def as_json(self) -> dict[str, object]:
        """Return the object of `analyze --json`."""
        tested = None if np.isnan(self.p_value) else self.settled
        return {"settled": tested} | json_object(self, "p_value", "held_s", "time_constant_s", "remaining_mv=most_mv")


def settling_of(
    recording: Recording, plateaus: tuple[Plateau, ...], sensor: int, used: IntArray, positions: FloatArray
) -> Settling:
    """Test the holds of a sensor, counted from 0; `used` and `positions` [n] are the plateaus that count and labels."""
    none = np.zeros(len(plateaus))
    held_s = float(np.median([p.end_s - p.start_s for p in plateaus])) if plateaus else float("nan")
    count = np.unique(positions, return_counts=True)[1]
    parts = [_parts(recording, plateaus[i], sensor) for i in used]
    known = np.asarray([np.isfinite(part).all() for part in parts], dtype=bool)
    if known.sum() < max(3, known.size // 2) or count.size < 2:
        return Settling(float("nan"), held_s, none)
    holds, labels = used[known], np.unique(positions[known], return_inverse=True)[1].reshape(-1)
    time_s, signal = np.moveaxis(np.stack([part for part, good in zip(parts, known, strict=True) if good]), 1, 0)
    signal = signal - signal.mean(axis=1, keepdims=True)
    length = float(np.median(time_s[:, -1] - time_s[:, 0])) * _PARTS / (_PARTS - 1)
    taus = np.geomspace(_TIMES[0] * length, _TIMES[1] * length, _TIMES[2])
    steps = _steps(plateaus, sensor)
    tried = [_creep(steps, holds, time_s, signal, float(tau)) for tau in taus]
    left = np.asarray([float(((signal - gamma * shape) ** 2).sum()) for gamma, _, shape, _ in tried])
    at = int(np.argmin(left))
    gamma, own, shape, _ = tried[at]
    by_creep = 2.0 * float(stats.t.sf(abs(gamma) / own, holds.size - 1)) if own > 0.0 else float("nan")
    tries = float(np.log2(taus[-1] / taus[0]))  # those that differ by a factor of two count as tries of their own
    trend, other = _other_trend(time_s, signal - gamma * shape, labels)
    p_value = float(np.nanmin([1.0, 2.0 * by_creep * tries, 2.0 * other]))
    if not p_value < _BY_CHANCE:
        return Settling(p_value, held_s, none)
    if 2.0 * other < _BY_CHANCE:
        none[holds] += trend * length
    noise = left[at] / max(signal.size - holds.size - 2, 1)
    likely = np.flatnonzero(left - left[at] < _WITHIN * noise)
    slowest = int(likely[-1])
    if 2.0 * by_creep * tries < _BY_CHANCE:
        gamma, _, _, lag = tried[slowest]
        none += np.where(np.isfinite(lag), _MARGIN * gamma * lag, 0.0)
    return Settling(p_value, held_s, none, float(taus[at]))


def _parts(recording: Recording, plateau: Plateau, sensor: int) -> FloatArray:
    """Return time since the begin of the hold and mean signal of parts of its settled part, [2, parts]."""
    edges = np.linspace(plateau.settled_first, plateau.last + 1, _PARTS + 1).astype(np.int64)
    found = np.full((2, _PARTS), np.nan)
    for k, (first, end) in enumerate(itertools.pairwise(edges.tolist())):
        good = recording.usable[first:end, sensor]
        if good.any():
            found[0, k] = recording.time_s[first:end][good].mean() - plateau.start_s
            found[1, k] = recording.signal_mv[first:end, sensor][good].mean()
    return found


@dataclass(frozen=True)
class _Steps:
    """The plateaus with a signal, [n]: their places among all `count`, and their signals.

    A lag decays over `since_s` from the plateau before, and over `settled_s` to the middle of the settled part.
    """

    places: IntArray
    signal: list[float]
    since_s: FloatArray
    settled_s: FloatArray
    count: int


def _steps(plateaus: tuple[Plateau, ...], sensor: int) -> _Steps:
    known = np.asarray([i for i, p in enumerate(plateaus) if np.isfinite(p.signal_mv[sensor])], dtype=np.int64)
    chosen = [plateaus[i] for i in known]
    begin, end = np.asarray([(p.start_s, p.end_s) for p in chosen]).reshape(-1, 2).T
    share = np.asarray([(p.settled_first - p.first) / max(p.last - p.first, 1) for p in chosen])
    settled_s = 0.5 * (share * (end - begin) + end - begin)
    signal = [float(p.signal_mv[sensor]) for p in chosen]
    return _Steps(known, signal, np.diff(begin, prepend=0.0), settled_s, len(plateaus))


def _lags(steps: _Steps, tau: float, gamma: float = 0.0) -> FloatArray:
    """Return the lag of each plateau in the middle of its settled part, [plateaus] mV.

    It is the sum of the steps of the signal at rest, which itself is `gamma` lags ahead, each less its decay.
    """
    fades, decays = np.exp(-steps.settled_s / tau), np.exp(-steps.since_s / tau)
    lags: list[float] = []
    lag, rest = 0.0, float("nan")
    for signal, fade, decay in zip(steps.signal, fades.tolist(), decays.tolist(), strict=True):
        lag *= decay
        before = rest if lags else signal
        rest = (signal + gamma * fade * (lag - before)) / (1.0 - gamma * fade)
        lag += rest - before
        lags.append(lag * fade)
    found = np.full(steps.count, np.nan)
    found[steps.places] = lags
    return found


def _creep(
    steps: _Steps, holds: IntArray, time_s: FloatArray, signal: FloatArray, tau: float
) -> tuple[float, float, FloatArray, FloatArray]:
    """Return gamma, its standard error from the holds, the course of these for gamma = 1, and the lags [plateaus]."""
    gamma = 0.0
    for _ in range(_ITERATIONS):
        lags = _lags(steps, tau, gamma)
        found = _gamma(lags[holds], time_s, signal, tau)
        gamma = float(np.clip(found[0], -_MOST_CREEP, _MOST_CREEP))
    return *found, lags


def _gamma(lag: FloatArray, time_s: FloatArray, signal: FloatArray, tau: float) -> tuple[float, float, FloatArray]:
    """Return gamma, its standard error and the course of holds of such lags, [holds]."""
    middle = np.asarray([0.5 * (time_s[:, 0] + time_s[:, -1])]).T
    shape = -lag[:, None] * np.exp(np.minimum(-(time_s - middle) / tau, _LONGEST_EXPONENT))
    shape = shape - shape.mean(axis=1, keepdims=True)
    products, squares = (shape * signal).sum(axis=1), (shape**2).sum(axis=1)
    whole = float(squares.sum())
    if not whole > 0.0:
        return 0.0, 0.0, shape
    gamma = float(products.sum()) / whole
    apart = products - gamma * squares
    return gamma, float(np.sqrt((apart**2).sum() * lag.size / (lag.size - 1))) / whole, shape


def _other_trend(time_s: FloatArray, left: FloatArray, labels: IntArray) -> tuple[FloatArray, float]:
    """Return the mean slope of each hold's position, [holds] mV/s, and the chance of such slopes; NaN if unknown."""
    away = time_s - time_s.mean(axis=1, keepdims=True)
    slope = (left * away).sum(axis=1) / (away**2).sum(axis=1)
    count = np.bincount(labels)
    mean = np.bincount(labels, slope) / count
    dof = slope.size - count.size
    scatter = float(((slope - mean[labels]) ** 2).sum()) / dof if dof > 0 else 0.0
    if not scatter > 0.0:
        return mean[labels], float("nan")
    return mean[labels], float(stats.f.sf(float(count @ mean**2) / count.size / scatter, count.size, dof))
