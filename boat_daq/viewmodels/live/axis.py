"""The vertical range of a live plot: steps of 1-2-5 with hysteresis, so that the axis is steady.

Called at a few hertz, never in the frame: pyqtgraph's own autorange doubles the cost of one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from boat_daq.formatting import duration
from protocol.base.arrays import FloatArray
from protocol.base.units import MINUS

LADDER = (1.0, 2.0, 5.0)
TICK_PX = 14.0  # of one label
LEAST_PX, END_PX = 10.0, 1.0  # between two labels at least; of a label from the end of its axis
CONSTANT_RANGE = 1e-9  # of a value: a range so narrow is that of a constant
_NEAR_SHARE = 0.08  # of a height: two numbers that are nearer cover each other
DIVISIONS = 7  # at most so many labelled ticks over a range


def rung(span: float) -> float:
    """Return the smallest step of 1, 2, 5 x 10^n that is not below `span` (which is > 0)."""
    decade = 10.0 ** math.floor(math.log10(span))
    return next((step * decade for step in LADDER if step * decade >= span * (1 - 1e-12)), 10 * decade)


def tick_step(span: float, room_px: float = math.inf) -> float:
    """Return the spacing of labelled ticks over a range of `span` drawn on `room_px` pixels."""
    divisions = min(DIVISIONS, max(2.0, room_px / TICK_PX))
    return rung(span / divisions) if span > 0 and math.isfinite(span) else 1.0


def finer_step(low: float, high: float, step: float, room_px: float) -> float:
    """Return the step, or a finer one with two labels between the ends of a range on `room_px` pixels if they fit."""
    end = END_PX * (high - low) / room_px

    def labels(step: float) -> int:
        return math.floor((high - end) / step) - math.ceil((low + end) / step) + 1

    while labels(step) < 2 and (finer := rung(step / 2.5)) * room_px >= LEAST_PX * (high - low):
        step = finer
    return step


def framed(low: float, high: float, *, smallest: float = 0.0) -> tuple[float, float]:
    """Return a range of whole tick steps around [low, high], at least `smallest` wide; a tenth of a constant."""
    middle, span = (low + high) / 2, max(high - low, smallest)
    if span <= CONSTANT_RANGE * max(abs(middle), 1.0):
        span = 0.1 * abs(middle) if abs(middle) > CONSTANT_RANGE else 1.0
    step = tick_step(span) / 2
    low, high = min(low, middle - span / 2), max(high, middle + span / 2)
    margin = 0.04 * span
    return math.floor((low - margin) / step) * step, math.ceil((high + margin) / step) * step


def padded(low: float, high: float, margin: float) -> tuple[float, float]:
    """Return [low, high] widened by the share `margin` on either side; a point becomes an interval."""
    width = (high - low) or max(abs(high), 1.0)
    return low - margin * width, high + margin * width


@dataclass(slots=True)
class SteadyRange:
    """A range that follows data with hysteresis.

    Parameters
    ----------
    smallest : the least width, in the axis's unit, so that noise does not fill the plot.
    patience_s : how long the data must need less before the range shrinks.
    """

    smallest: float = 1.0
    patience_s: float = 1.5
    low: float = math.nan
    high: float = math.nan
    _roomy_since: float = field(default=math.nan, init=False)

    def update(self, low: float, high: float, now_s: float) -> tuple[float, float]:
        """Take the extremes of what is shown at `now_s`; return the range to show."""
        if not (math.isfinite(low) and math.isfinite(high)):
            return (self.low, self.high) if math.isfinite(self.low) else (0.0, self.smallest)
        wanted = framed(low, high, smallest=self.smallest)
        if not (math.isfinite(self.low) and self.holds(low, high)):
            self._take(wanted)
        elif wanted[1] - wanted[0] < 0.7 * (self.high - self.low):
            if math.isnan(self._roomy_since):
                self._roomy_since = now_s
            elif now_s - self._roomy_since >= self.patience_s:
                self._take(wanted)
        else:
            self._roomy_since = math.nan
        return self.low, self.high

    def holds(self, low: float, high: float) -> bool:
        """Return whether these extremes are inside; those of no value (NaN) are."""
        return not (low < self.low or high > self.high)

    def _take(self, wanted: tuple[float, float]) -> None:
        self.low, self.high = wanted
        self._roomy_since = math.nan


def extremes(*columns: FloatArray) -> tuple[float, float]:
    """Return the least and greatest finite value of all `columns`; NaN, NaN where there is none."""
    low, high = math.inf, -math.inf
    for column in columns:
        finite = column[np.isfinite(column)]
        if finite.size:
            low, high = min(low, float(finite.min())), max(high, float(finite.max()))
    return (low, high) if low <= high else (math.nan, math.nan)


HOUR_S = 3600.0
TIME_STEPS_S = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 28800, 86400)


def time_step(span_s: float) -> float:
    """Return the spacing of labelled ticks over `span_s` seconds: 1-2-5 below a second, clock divisions above."""
    wanted = span_s / 8
    if wanted < 1:
        return rung(max(wanted, 1e-6))
    return float(next((step for step in TIME_STEPS_S if step >= wanted), TIME_STEPS_S[-1]))


def next_step(step: float, *, time: bool = False) -> float:
    if time and step >= 1:
        return float(next((wider for wider in TIME_STEPS_S if wider > step), 2 * step))
    return rung(1.5 * step)


def clock_unit(low_s: float, high_s: float) -> str:
    """Return what all labels of a time axis from `low_s` to `high_s` show: s, min:s or h:min:s."""
    if time_step(high_s - low_s) < 1:
        return "s"
    return "h:min:s" if max(abs(low_s), abs(high_s)) >= HOUR_S else "min:s"


def clock(time_s: float, step_s: float, unit: str = "min:s") -> str:
    """Return a tick's label: `2.4`, `0:05`, `1:03:00`; the distance of the ticks decides the decimals."""
    if unit == "s":
        return f"{time_s:.{max(1, -math.floor(math.log10(step_s)))}f}".replace("-", MINUS)
    text = duration(abs(time_s))
    return (MINUS if time_s < -0.5 else "") + (f"0:{text:0>5}" if unit == "h:min:s" and text.count(":") < 2 else text)


def number_labels(curves: Sequence[tuple[FloatArray, FloatArray]]) -> list[tuple[float, float, str]]:
    """Return the numbers of curves (x, y of one length), from 1, each where its curve is farthest from the others.

    Those of curves that are alike everywhere are at different places; an empty curve has none.
    """
    values = [y for _, y in curves if y.size]
    near = _NEAR_SHARE * float(np.ptp(np.concatenate(values))) if values else 0.0
    labels = []
    for i, (x, y) in enumerate(curves):
        if not x.size:
            continue
        apart = np.full(x.size, np.inf)
        for other_x, other_y in (other for k, other in enumerate(curves) if k != i and other[0].size):
            apart = np.fmin(apart, np.abs(y - np.interp(x, other_x, other_y, left=np.nan, right=np.nan)))
        at = int(np.argmax(np.where(np.isfinite(apart), apart, 0.0)))
        if not near < apart[at] < np.inf:
            at = round((i + 0.5) / len(curves) * (x.size - 1))
        labels.append((float(x[at]), float(y[at]), str(i + 1)))
    return labels
