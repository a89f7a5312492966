"""An axis for what spans decades: the data are base-10 logarithms, the labels what was measured."""

from __future__ import annotations

import math
from collections.abc import Callable

import pyqtgraph as pg

from boat_daq.viewmodels.models.tradeoff_report import power_text

MOST_LABELS = 7
DIGITS = (1, 2, 5)
FEW_DECADES = 1.6  # over fewer, the 2 and the 5 between are labelled too


class LogAxis(pg.AxisItem):  # type: ignore[misc]
    """Labels at powers of ten, at 1-2-5 where few decades are shown; `words` writes a value."""

    def __init__(self, orientation: str, words: Callable[[float], str] = power_text) -> None:
        super().__init__(orientation)
        self.words = words
        self.enableAutoSIPrefix(False)
        self.setStyle(tickLength=-4, autoExpandTextSpace=False, hideOverlappingLabels=True)

    def tickValues(self, minVal: float, maxVal: float, size: float) -> list[tuple[float, list[float]]]:
        """Return the one level of ticks, as logarithms."""
        return [(1.0, log_ticks(minVal, maxVal))]

    def tickStrings(self, values: list[float], scale: float, spacing: float) -> list[str]:
        """Return the labels of `values`."""
        return [self.words(10.0**value) for value in values]


def log_ticks(low: float, high: float) -> list[float]:
    """Return the logarithms of round values between two logarithms: at most `MOST_LABELS` or so."""
    first, last = math.floor(low), math.ceil(high)
    digits = DIGITS if high - low <= FEW_DECADES else (1,)
    step = max(1, math.ceil((last - first) / MOST_LABELS))
    ticks = [n + math.log10(d) for n in range(first, last + 1, step) for d in digits]
    return [t for t in ticks if low - 1e-9 <= t <= high + 1e-9]
