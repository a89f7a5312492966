"""What `boat-daq tradeoff` measures of the live plot: points drawn against what the screen can show.

The reference is every sample of the span, drawn: in each column of pixels the lowest and highest value. Half a pixel of
height is what the eye can notice; that a peak stands in the next column is not held against a setting.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from analysis.tradeoff import Method, Setting
from boat_daq.engine.pyramid import MinMaxPyramid

WIDTH_PX, HEIGHT_PX = 1000, 300
RATE_HZ, MINUTES = 100.0, 60
FULL_SPAN = 1.2  # of the signal's own span: the axis has room above and below


def decimation_settings(quick: bool) -> list[Setting]:
    """An hour at 100 Hz, with two spikes of one sample, on a plot of 1000 x 300 pixels."""
    time_s = np.arange(round((MINUTES / 4 if quick else MINUTES) * 60 * RATE_HZ)) / RATE_HZ
    signal = 1650.0 + 110.0 * np.sin(time_s / 25.0) + 1.49 * np.random.default_rng(3).standard_normal(time_s.size)
    signal[[time_s.size // 3, time_s.size // 2 + 17]] += (60.0, -60.0)
    pyramid = MinMaxPyramid(2, time_s.size)
    pyramid.append(np.stack([time_s, signal]))
    points = (250, 500, 2000, 8000) if quick else (125, 250, 500, 1000, 2000, 4000, 8000, 16000)
    span = float(time_s[-1])

    def draw(count: int, _: int) -> NDArray[np.float64]:
        return pyramid.draw(0.0, span, count)

    error = _judge(time_s, signal)
    return [Setting(f"{n} points", partial(draw, n), error) for n in points]


def _judge(time_s: NDArray[np.float64], signal: NDArray[np.float64]) -> Callable[[NDArray[np.float64]], float]:
    """Return the judge of drawn points: rms over the columns of what is missing or too much at either end, px."""
    edges = np.linspace(0.0, time_s[-1], WIDTH_PX + 1)
    pixel = FULL_SPAN * float(np.ptp(signal)) / HEIGHT_PX
    truth = _envelope(time_s, signal, edges)

    def error(drawn: NDArray[np.float64]) -> float:
        # the line between two points passes the columns between them
        at = np.union1d(drawn[0], edges)
        line = np.interp(at, drawn[0], drawn[1])
        rows = np.concatenate([drawn, [at, line]], axis=1)
        rows = rows[:, np.argsort(rows[0], kind="stable")]
        found = _envelope(rows[0], rows[1], edges)
        apart = _beyond(truth, found) + _beyond(found, truth)
        return float(np.sqrt(np.mean(apart**2))) / pixel

    return error


def _beyond(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far one envelope (lowest, highest) reaches beyond the other's three columns about it."""
    low, high = minimum_filter1d(other[0], 3), maximum_filter1d(other[1], 3)
    return np.stack([np.maximum(low - one[0], 0.0), np.maximum(one[1] - high, 0.0)])


def _envelope(at: NDArray[np.float64], values: NDArray[np.float64], edges: NDArray[np.float64]) -> NDArray[np.float64]:
    starts = np.minimum(np.searchsorted(at, edges[:-1]), at.size - 1)
    return np.stack([np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)])


DECIMATION = Method(
    "decimation", "Live plot: points drawn", "every sample of the span, column by column of pixels", True,
    "the eye at the live plot: half a pixel", 0.5, "pixels", "a curve drawn",
    lambda f: f"{f.points_a_column * WIDTH_PX} points", decimation_settings,
)  # fmt: skip
