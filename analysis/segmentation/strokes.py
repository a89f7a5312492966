"""Strokes of a drive and the loops of its answer: what a stage, a tester or a pump does over and over.

Strategy: two thresholds at 25 and 75 % of the span p1..p99 of the drive; a rise through both is an upstroke. Cycles run
from rise to rise. Used for data whose drive is not a pressure plan; the cycles of a calibration are
`analysis.segmentation.cycles`.

Rules: the figures are those of the loop, without a calibration; nothing is smoothed.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from analysis.arrays import FloatArray, IntArray
from analysis.errors import DataError

LOW, HIGH = 0.25, 0.75
MIDDLE = (0.30, 0.70)  # share of the stroke where the half width is taken


@dataclass(frozen=True, slots=True)
class Strokes:
    """Strokes and loop figures; means and sample sds over cycles, in the units of drive and answer.

    `half_width` is half the distance of the answer's mean on the way up and down, over 30 to 70 % of the stroke,
    where the drive moves faster than `min_speed`. NaN where fewer than two cycles carry a figure.
    """

    up_rows: IntArray
    down_rows: IntArray
    span: float
    peak_mean: float
    peak_sd: float
    trough_mean: float
    trough_sd: float
    period_mean_s: float
    period_sd_s: float
    loop_area_mean: float
    loop_area_sd: float
    half_width_mean: float
    half_width_sd: float

    @property
    def cycles(self) -> int:
        """Number of cycles from rise to rise."""
        return max(self.up_rows.size - 1, 0)


def find_strokes(time_s: FloatArray, drive: FloatArray, answer: FloatArray, *, min_speed: float = 0.0) -> Strokes:
    """Find strokes and measure their loops.

    Parameters
    ----------
    time_s, drive, answer : [n]; rows that are not finite are left out.
    min_speed : of the drive, units a second; slower rows do not enter the half width.

    Raises
    ------
    DataError : fewer than ten rows, or a drive that does not move.
    """
    known = np.isfinite(time_s) & np.isfinite(drive) & np.isfinite(answer)
    time, x, y = time_s[known], drive[known], answer[known]
    if x.size < 10 or np.ptp(x) == 0:
        raise DataError("the drive does not move", "Choose the column that is driven.")
    low, high = (float(v) for v in np.percentile(x, [1, 99]))
    up, down = _crossings(x, low + LOW * (high - low), low + HIGH * (high - low))
    peaks = [float(x[a:b].max()) for a, b in _between(up[:-1], down)]  # of whole cycles
    troughs = [float(x[a:b].min()) for a, b in _between(down, up)]
    pairs = list(itertools.pairwise(up.tolist()))
    areas = [_shoelace(x[a : b + 1], y[a : b + 1]) for a, b in pairs]
    widths = [_half_width(time, x, y, (a, b), (low, high), min_speed) for a, b in pairs]
    figures = [s for values in (peaks, troughs, np.diff(time[up]), areas, widths) for s in _mean_sd(values)]
    return Strokes(up, down, high - low, *figures)


def _crossings(x: FloatArray, low: float, high: float) -> tuple[IntArray, IntArray]:
    zone = (x > high).astype(np.int8) - (x < low).astype(np.int8)
    rows = np.flatnonzero(zone)
    turns = np.flatnonzero(np.diff(zone[rows]))
    arrivals = rows[turns + 1]
    rising = zone[arrivals] > 0
    return arrivals[rising], arrivals[~rising]


def _between(starts: IntArray, ends: IntArray) -> list[tuple[int, int]]:
    following = np.searchsorted(ends, starts)
    return [(int(a), int(ends[k])) for a, k in zip(starts, following, strict=True) if k < ends.size]


def _shoelace(x: FloatArray, y: FloatArray) -> float:
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))


def _half_width(
    time: FloatArray, x: FloatArray, y: FloatArray, rows: tuple[int, int], span: tuple[float, float], min_speed: float
) -> float:
    part = slice(rows[0], rows[1] + 1)
    speed = np.gradient(x[part], time[part]) if np.all(np.diff(time[part]) > 0) else np.gradient(x[part])
    share = (x[part] - span[0]) / (span[1] - span[0])
    middle = (share >= MIDDLE[0]) & (share <= MIDDLE[1])
    ways = [y[part][middle & (sign * speed > min_speed)] for sign in (1.0, -1.0)]
    return abs(float(ways[0].mean() - ways[1].mean())) / 2 if all(w.size for w in ways) else float("nan")


def _mean_sd(values: FloatArray | list[float]) -> tuple[float, float]:
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    if not known.size:
        return float("nan"), float("nan")
    return float(known.mean()), float(known.std(ddof=1)) if known.size > 1 else float("nan")
