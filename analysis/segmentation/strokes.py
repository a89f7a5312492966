"""Strokes of a drive and the loops of its answer: what a stage, a tester or a pump does over and over.

Strategy: two thresholds at 25 and 75 % of the span p1..p99 of the drive; a rise through both is an upstroke. Cycles run
from rise to rise. Used for data whose drive is not a pressure plan; the cycles of a calibration are
`analysis.segmentation.cycles`.

Rules: the figures are those of the loop, without a calibration; nothing is smoothed.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.arrays import FloatArray, IntArray
from analysis.data.recording import Recording
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


def stroke_figures(recording: Recording, *, min_speed_kpa_per_s: float = 0.0) -> dict[str, Any]:
    """Return the strokes and loops of a run whose drive is the pressure, ready for JSON.

    The friction is half the width of a sensor's loop along the pressure, over 30 to 70 % of the signal's span; the half
    width is the same along the signal, over 30 to 70 % of the pressure's.

    Parameters
    ----------
    recording : of a continuous run.
    min_speed_kpa_per_s : slower samples do not enter the half width.

    Raises
    ------
    DataError : fewer than ten usable samples, or the pressure or a signal does not move.
    """
    time_s, pressure_kpa = recording.time_s, recording.pressure_kpa
    drive = find_strokes(time_s, pressure_kpa, pressure_kpa)
    sensors = []
    for number in range(recording.n_sensors):
        signal_mv = np.where(recording.usable[:, number], recording.signal_mv[:, number], np.nan)
        loop = find_strokes(time_s, pressure_kpa, signal_mv, min_speed=min_speed_kpa_per_s)
        across = find_strokes(time_s, signal_mv, pressure_kpa)
        sensors.append({
            "name": f"s{number + 1}",
            "span_mv": across.span,
            "half_width_mv": {"mean": loop.half_width_mean, "sd": loop.half_width_sd},
            "friction_kpa": {"mean": across.half_width_mean, "sd": across.half_width_sd},
            "loop_area_kpa_mv": {"mean": loop.loop_area_mean, "sd": loop.loop_area_sd},
        })  # fmt: skip
    return {
        "cycles": drive.cycles,
        "strokes_up": drive.up_rows.size,
        "strokes_down": drive.down_rows.size,
        "span_kpa": drive.span,
        "peak_kpa": {"mean": drive.peak_mean, "sd": drive.peak_sd},
        "trough_kpa": {"mean": drive.trough_mean, "sd": drive.trough_sd},
        "period_s": {"mean": drive.period_mean_s, "sd": drive.period_sd_s},
        "sensors": sensors,
    }


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
