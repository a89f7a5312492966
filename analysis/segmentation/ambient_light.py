"""What ambient light moves the mean signal of a position by in every cycle alike.

Dark and lit are read one after the other, so what the light changes by in between remains in the signal. A lamp that
flickers near a multiple of the sampling rate leaves a slow wave; if the cycles last about a multiple of its period it
moves a position alike in each of them, and no scatter shows it. The change of the dark readings gives its shape; the
regression of the signals of parts of the holds on that, creep fitted besides, its size, common to all sensors.
Source: GUM (JCGM 100) F.2.4.5, an effect that is recognised and not corrected: u^2 = its square + its variance.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from analysis.data.recording import Recording
from analysis.segmentation.plateaus import Plateau
from protocol.base.arrays import FloatArray, IntArray

_PARTS = 4  # of a hold
CHANGE_S = 2.0  # over which the change of the light is taken: less is lost in the noise of the dark readings
_BY_CHANCE = 1e-3  # of such light by that noise alone


def ambient_in_means(
    recording: Recording, plateaus: tuple[Plateau, ...], used: IntArray, positions: FloatArray
) -> FloatArray:
    """Return the error that ambient light gives each plateau in every cycle alike, [sensors, plateaus] mV.

    One standard uncertainty with the sign of the wave: the errors of all plateaus are fully correlated. Zero without
    dark readings or changing light, and for plateaus that do not count. `used` and `positions` [n] are the plateaus of
    the cycles that count, from 0, and the label of the position (level and branch) of each.
    """
    change = np.zeros((recording.n_sensors, len(plateaus)))
    normal, right, parts = 0.0, 0.0, []
    for sensor in range(recording.n_sensors if recording.dark is not None else 0):
        chosen = np.asarray([np.isfinite(plateaus[i].signal_mv[sensor]) for i in used], dtype=bool)
        holds = [plateaus[i] for i in used[chosen]]
        if not holds:
            continue
        means, noise = _means_of_parts(recording, sensor, holds)
        _, place = np.unique(positions[chosen], return_inverse=True)
        count = np.bincount(place)
        of_place = np.stack([np.bincount(place, column) / count for column in means.mean(axis=1).T], axis=1)
        away = means - of_place[place][:, None, :]
        dof = away[:, :, 0].size - count.size
        if float((away[:, :, 0] ** 2).sum()) <= float(stats.chi2.isf(_BY_CHANCE, dof)) * noise**2:
            continue
        sign = np.asarray([1.0 if hold.branch == "loading" else -1.0 for hold in holds])[:, None, None]
        away -= sign * (sign * away).mean(axis=0)
        x, y = away[:, :, 1], away[:, :, 2]
        weight = 1.0 / max(float(np.mean(y**2)), np.finfo(float).tiny)
        normal += weight * float(np.sum(x * x))
        right += weight * float(np.sum(x * y))
        change[sensor, used[chosen]] = of_place[place, 1]
        parts.append((np.flatnonzero(chosen), weight, x, y))
    if not normal > 0.0:
        return np.zeros_like(change)
    size, scores = right / normal, np.zeros(used.size)
    for rows, weight, x, y in parts:  # what a hold's parts and sensors miss it by they share: ripple of the pressure
        scores[rows] += weight * np.sum(x * (y - size * x), axis=1)
    return np.asarray(change * np.hypot(size, np.linalg.norm(scores) / normal))


def _means_of_parts(recording: Recording, sensor: int, holds: list[Plateau]) -> tuple[FloatArray, float]:
    """Return means of parts of the holds, [holds, parts, 3], light, change and signal, and the light's noise."""
    assert recording.dark is not None
    rows, good = np.arange(recording.n), recording.usable[:, sensor]
    dark, signal = (
        np.interp(rows, rows[good], values[good, sensor].astype(np.float64))
        for values in (recording.dark, recording.signal_mv)
    )
    window = max(round(CHANGE_S / recording.interval_s), 1)
    columns = np.column_stack([dark - dark.mean(), _change(dark - dark.mean(), window), signal - signal.mean()])
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(columns, axis=0)])
    edges = np.asarray([np.linspace(hold.settled_first, hold.last + 1, _PARTS + 1) for hold in holds]).astype(np.int64)
    length = np.maximum(np.diff(edges, axis=1), 1)
    white = float((np.diff(dark, 2) ** 2).mean()) / 6.0 if dark.size > 2 else 0.0  # a median of counts is coarse
    noise = float(np.sqrt(white / length.mean()))
    return np.asarray(np.diff(sums[edges], axis=1) / length[:, :, None]), noise


def _change(values: FloatArray, window: int) -> FloatArray:
    """Return the mean of the next `window` values less that of the last ones: a wave a quarter of its period on."""
    sums, at = np.concatenate([[0.0], np.cumsum(values)]), np.arange(values.size)
    before, after = np.maximum(at - window, 0), np.minimum(at + window, values.size)
    return np.asarray((sums[after] - sums[at]) / (after - at) - (sums[at + 1] - sums[before]) / (at + 1 - before))
