"""The live plot: points fetched for a curve against what the screen can show.

The reference is every sample of the span, drawn: in each column of pixels the lowest and highest value. Half a pixel of
height is what the eye can notice; a peak drawn in the neighbouring column is no error.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from analysis.studies.tradeoff.measure import Method, Setting
from protocol.base.arrays import FloatArray

WIDTH_PX, HEIGHT_PX = 1000, 300
_RATE_HZ, MINUTES = 100.0, 60
SPANS = tuple(4.0 ** (-k / 7) for k in (0, 3, 5, 1, 4, 2, 6))
"""Shares of the hour that are drawn; the kept widths are a factor of 4 apart."""
FULL_SPAN = 1.2  # of the signal's own span: the axis has a margin above and below
Curve = Callable[[float, int], FloatArray]
Paint = Callable[[FloatArray], None]
Drawn = tuple[float, FloatArray]


def decimation(store: Callable[[FloatArray], Curve], paint: Paint | None = None) -> Method:
    """Return the method that measures a live plot.

    `store`: takes a record [2, n] of time (s) and signal (mV), returns what fetches its points [2, m] from 0 to a time
    (s) with at most so many points. `paint`: draws points [2, m] on the plot; its time counts.
    """
    return Method(
        "decimation", "Live plot: points looked at", "every sample of the span, column by column of pixels", True,
        "the eye at the live plot: half a pixel", 0.5, "pixels",
        "a curve fetched and painted" if paint is not None else "a curve fetched",
        lambda level: f"{level.points_a_column * WIDTH_PX} points", partial(_settings, store=store, paint=paint),
    )  # fmt: skip


def _settings(quick: bool, store: Callable[[FloatArray], Curve], paint: Paint | None) -> list[Setting]:
    """Return spans of an hour at 100 Hz, with spikes of one sample, on 1000 x 300 pixels.

    Each repeat shows another span, since how well the stored widths fit the requested one depends on it.
    """
    time_s = np.arange(round(MINUTES * 60 * _RATE_HZ)) / _RATE_HZ
    signal = 1650.0 + 110.0 * np.sin(time_s / 25.0) + 1.49 * np.random.default_rng(3).standard_normal(time_s.size)
    signal[[time_s.size // 13, time_s.size // 8 + 17]] += (60.0, -60.0)
    fetch = store(np.stack([time_s, signal]))
    points = (2000, 8000, 16000, 64000) if quick else (1000, 2000, 4000, 8000, 16000, 32000, 64000)

    def draw(count: int, repeat: int) -> Drawn:
        end = float(time_s[-1]) * SPANS[repeat]
        drawn = fetch(end, count)
        if paint is not None:
            paint(drawn)
        return end, drawn

    error = _error_px(time_s, signal)
    return [Setting(f"{n} points", partial(draw, n), error) for n in points]


def _error_px(time_s: FloatArray, signal: FloatArray) -> Callable[[Drawn], float]:
    """Return the error of drawn points, px: rms over the columns of the difference at either end."""
    pixel = FULL_SPAN * float(np.ptp(signal)) / HEIGHT_PX

    def error(found: Drawn) -> float:
        end, drawn = found
        edges = np.linspace(0.0, end, WIDTH_PX + 1)
        shown = time_s <= end
        truth = _envelope(time_s[shown], signal[shown], edges)
        # the line between two points passes the columns between them
        at = np.union1d(drawn[0], edges)
        rows = np.concatenate([drawn, [at, np.interp(at, *drawn)]], axis=1)
        rows = rows[:, np.argsort(rows[0], kind="stable")]
        seen = _envelope(rows[0], rows[1], edges)
        return float(np.sqrt(np.mean((_beyond(truth, seen) + _beyond(seen, truth)) ** 2))) / pixel

    return error


def _beyond(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return how far one envelope (lowest, highest) reaches beyond the other's three columns about it."""
    low, high = minimum_filter1d(other[0], 3), maximum_filter1d(other[1], 3)
    return np.stack([np.maximum(low - one[0], 0.0), np.maximum(one[1] - high, 0.0)])


def _envelope(at: FloatArray, values: FloatArray, edges: FloatArray) -> FloatArray:
    starts = np.minimum(np.searchsorted(at, edges[:-1]), at.size - 1)
    return np.stack([np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)])
