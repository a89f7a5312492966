"""Strokes of a drive and the loops of its answer, without a calibration: what a stage, a tester or a pump repeats.

Two thresholds at 25 and 75 % of the span p1..p99 of the drive, or up to a tenth of it away, between the levels at which
a staircase is held; a rise through both is an upstroke. Cycles run from rise to rise.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis.data.recording import Recording
from analysis.segmentation.cycles import TOLERANCE_KPA, find_cycles
from analysis.segmentation.plateaus import find_plateaus
from protocol.base.arrays import BoolArray, FloatArray, IntArray
from protocol.base.errors import DataError

_LOW, HIGH = 0.25, 0.75
AWAY, NEAR, _CHANCE, _BINS = 0.1, 0.015, 4.0, 200
"""How far thresholds may move, and how near (sd) a hold disturbs, of the span; they move where more samples are near
than elsewhere, by so many standard deviations of their numbers; bins in which samples are counted."""
MIDDLE = (0.30, 0.70)  # share of the stroke where the half width is taken
AROUND = (0.15, 0.25)  # of the stroke, where branches with few and with many samples begin to be fitted
FEWEST_IN_BRANCH, MANY_IN_BRANCH = 4, 30  # samples of a branch


@dataclass(frozen=True, slots=True)
class Strokes:
    """Strokes and loop figures; means and sample sds over cycles, in the units of drive and answer.

    `half_width` is half the distance of the answer on the way up and down at equal drive, over 30 to 70 % of the
    stroke, where it moves faster than `min_speed`; `friction` is that of the drive at equal answer, over 30 to 70 % of
    the answer's span. NaN below two cycles with a figure.
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
    friction_mean: float
    friction_sd: float

    @property
    def cycles(self) -> int:
        return max(self.up_rows.size - 1, 0)


def find_strokes(time_s: FloatArray, drive: FloatArray, answer: FloatArray, *, min_speed: float = 0.0) -> Strokes:
    """Find strokes and measure their loops in [n] rows; raises DataError if the drive does not move."""
    known = np.isfinite(time_s) & np.isfinite(drive) & np.isfinite(answer)
    time, x, y = time_s[known], drive[known], answer[known]
    if x.size < 10 or np.ptp(x) == 0:
        raise DataError("the drive does not move", "Choose the column that is driven.")
    low, high = (float(v) for v in np.percentile(x, [1, 99]))
    up, down = crossings(x, *thresholds(x))
    peaks = [float(x[a:b].max()) for a, b in _between(up[:-1], down)]  # of whole cycles
    troughs = [float(x[a:b].min()) for a, b in _between(down, up)]
    pairs = list(itertools.pairwise(up.tolist()))
    areas = [_shoelace(x[a : b + 1], y[a : b + 1]) for a, b in pairs]
    ends = tuple(float(v) for v in np.percentile(y, [1, 99]))
    branches = [_branches(x, a, b) for a, b in pairs]
    speed = np.gradient(x, time) if np.all(np.diff(time) > 0) else np.gradient(x)
    moving = [way * speed > min_speed if min_speed else np.ones(x.size, dtype=bool) for way in (-1.0, 1.0)]
    widths = [_half_distance(x, y, (low, high), moving, rows) for rows in branches]
    frictions = [_half_distance(y, x, ends, moving, rows) for rows in branches]
    figures = [s for v in (peaks, troughs, np.diff(time[up]), areas, widths, frictions) for s in _mean_sd(v)]
    return Strokes(up, down, high - low, *figures)


def stroke_figures(recording: Recording, *, min_speed_kpa_per_s: float = 0.0) -> dict[str, Any]:
    """Return the strokes and loops of a run whose drive is the pressure, ready for JSON.

    The friction is half the width of a sensor's loop along the pressure, over 30 to 70 % of the signal's span; the half
    width is the same along the signal, over 30 to 70 % of the pressure's. Raises DataError for fewer than ten usable
    samples, a held pressure, a staircase, or a signal that does not move.
    """
    time_s, pressure_kpa = recording.time_s, recording.pressure_kpa
    drive = find_strokes(time_s, pressure_kpa, pressure_kpa)
    if drive.span <= 2.0 * TOLERANCE_KPA:
        moved = f"the pressure moved by {drive.span:.2g} kPa in all, no more than a held pressure may"
        raise DataError(f"{moved}: nothing was driven", "Choose the column that is driven, or check its unit.")
    if held := find_plateaus(recording, find_cycles(recording)):
        cause = f"the pressure was held at {len(held)} plateaus: strokes are those of a continuous run"
        raise DataError(cause, "The figures of a staircase are those of its analysis.")
    sensors = []
    for number in range(recording.n_sensors):
        signal_mv = np.where(recording.usable[:, number], recording.signal_mv[:, number], np.nan)
        loop = find_strokes(time_s, pressure_kpa, signal_mv, min_speed=min_speed_kpa_per_s)
        ends_mv = np.percentile(signal_mv[np.isfinite(signal_mv)], [1, 99])
        sensors.append({
            "name": f"s{number + 1}",
            "span_mv": float(ends_mv[1] - ends_mv[0]),
            "half_width_mv": {"mean": loop.half_width_mean, "sd": loop.half_width_sd},
            "friction_kpa": {"mean": loop.friction_mean, "sd": loop.friction_sd},
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


def thresholds(x: FloatArray) -> tuple[float, float]:
    """Return the values that a stroke passes: 25 and 75 % of the span p1..p99, or between holds that are near."""
    low, high = (float(v) for v in np.percentile(x, [1, 99]))
    samples, _ = np.histogram(x, bins=_BINS, range=(low, high))
    shares = (np.arange(samples.size) + 0.5) / _BINS

    def passed(usual: float) -> float:
        levels = usual + np.linspace(-AWAY, AWAY, round(AWAY * _BINS) + 1)
        near = np.exp(-0.5 * ((levels[:, None] - shares) / NEAR) ** 2) @ samples
        here, least = near[levels.size // 2], near.min()
        held = here - least > _CHANCE * np.sqrt(here + least)
        level = float(levels[np.argmin(near)]) if held else usual
        return low + level * (high - low)

    return passed(_LOW), passed(HIGH)


def crossings(x: FloatArray, low: float, high: float) -> tuple[IntArray, IntArray]:
    """Return the rows at which the values are first above `high` after `low`, and first below `low` after `high`."""
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


def _branches(x: FloatArray, first: int, last: int) -> tuple[slice, slice]:
    """Return the rows going down and up of a cycle from one passing of the upper threshold to the next.

    Peak and trough are the middle of the rows near them: noise, and not the sign of a step, would else decide.
    """
    cycle = x[first : last + 1]
    low, high = float(cycle.min()), float(cycle.max())
    near = 0.05 * (high - low)
    trough = first + int(np.median(np.flatnonzero(cycle <= low + near)))
    before = x[first:trough]
    peak = first + int(np.median(np.flatnonzero(before >= before.max() - near))) if before.size else first
    later = x[trough : last + 1]
    return slice(peak, trough + 1), slice(trough, trough + later.size)


def _half_distance(
    x: FloatArray, y: FloatArray, ends: tuple[float, ...], moving: list[BoolArray], branches: tuple[slice, slice]
) -> float:
    """Return half the mean distance of the branches' y at equal x, over 30 to 70 % of the span between the ends.

    Each branch is a polynomial through its samples there and a little around, so that the noise of x does not move it;
    few, as where the answer turns at once, are joined by lines, which do not overshoot.
    """
    span = ends[1] - ends[0]
    if span <= 0:
        return float("nan")
    curves: list[Callable[[FloatArray], FloatArray]] = []
    places = []
    for rows, fast in zip(branches, moving, strict=True):
        share = (x[rows] - ends[0]) / span
        middle = (share >= MIDDLE[0]) & (share <= MIDDLE[1]) & fast[rows]
        few = middle.sum() < MANY_IN_BRANCH
        away = AROUND[0] if few else AROUND[1]
        inside = (share >= away) & (share <= 1.0 - away) & fast[rows]
        if inside.sum() < FEWEST_IN_BRANCH:
            return float("nan")
        places.append(np.linspace(*MIDDLE, 41) if few else share[middle])
        curves.append(_curve(share[inside], y[rows][inside], joined=few))
    at = np.concatenate(places)
    return 0.5 * abs(float((curves[1](at) - curves[0](at)).mean()))


def _curve(x: FloatArray, y: FloatArray, *, joined: bool) -> Callable[[FloatArray], FloatArray]:
    """Return y(x) of a branch: its points joined by lines, or a polynomial through them."""
    order = np.argsort(x)
    if joined:
        return lambda at: np.interp(at, x[order], y[order])
    polynomial = np.polynomial.Polynomial.fit(x, y, 4)
    return lambda at: np.asarray(polynomial(at), dtype=np.float64)


def _mean_sd(values: FloatArray | list[float]) -> tuple[float, float]:
    known = np.asarray(values, dtype=np.float64)
    known = known[np.isfinite(known)]
    if not known.size:
        return float("nan"), float("nan")
    return float(known.mean()), float(known.std(ddof=1)) if known.size > 1 else float("nan")
