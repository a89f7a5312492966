"""One figure of a report: value, unit, count, interval, or why there is none."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from analysis.numbers import NOTHING, rounded
from analysis.segmentation.losses import Losses


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of a report: value, unit, how many it rests on, 95 % interval, or why there is none.

    Attributes
    ----------
    value : NaN or infinite where `void` says why.
    n : number of independent items behind it (cycles, plateaus or points, as `definition` says).
    low, high : 95 % confidence interval; NaN where none can be given.
    void : why the figure is not to be used, or "".
    note : why the interval is missing or wide, or "".
    window : what was lost or left out of the samples that it rests on; None where it rests on none directly.
    """

    value: float
    unit: str
    n: int
    low: float = float("nan")
    high: float = float("nan")
    void: str = ""
    note: str = ""
    definition: str = ""
    window: Losses | None = None

    @classmethod
    def nothing(cls, unit: str, reason: str, definition: str = "") -> Figure:
        """A figure that cannot be given, with the reason."""
        return cls(float("nan"), unit, 0, void=reason, definition=definition)

    def as_json(self) -> dict[str, Any]:
        """Return the figure as a dictionary; NaN and infinity are left for the writer to turn into null."""
        return {
            "value": self.value,
            "unit": self.unit,
            "n": self.n,
            "interval_95": [self.low, self.high],
            "void": self.void,
            "note": self.note,
            "definition": self.definition,
            "window": self.window.as_json() if self.window is not None else None,
        }


def with_interval(figure: Figure) -> str:
    """Return "44.62 [44.45, 44.76] dB"."""
    if math.isnan(figure.value):
        return NOTHING
    half = (figure.high - figure.low) / 4  # of a 95 % interval: about one standard uncertainty
    text = rounded(figure.value, half)
    if math.isfinite(figure.low) and math.isfinite(figure.high):
        text += f" [{rounded(figure.low, half)}, {rounded(figure.high, half)}]"
    return f"{text} {figure.unit}"
