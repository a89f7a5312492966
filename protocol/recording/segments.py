"""One segment of a profile over time: run by the plan, recorded with its step.

A step's detail holds `segment` (its fields), `start` (the value it began at) and `quantity`, "kPa" or "mm".
"""

from __future__ import annotations

import math
from dataclasses import dataclass

SEGMENT_KINDS = ("step", "ramp", "sine")


@dataclass(frozen=True, slots=True)
class Segment:
    """A "step" or "ramp" to `target`, or a "sine" about it, in the plan's quantity; `reading` waits for one."""

    kind: str
    target: float
    rate_per_s: float = 0.0
    hold_s: float = 0.0
    amplitude: float = 0.0
    frequency_hz: float = 0.0
    periods: float = 0.0
    reading: bool = False

    @property
    def extremes(self) -> tuple[float, float]:
        """Lowest and highest value it leads to."""
        return self.target - self.amplitude, self.target + self.amplitude

    def moving_s(self, start: float) -> float:
        """Return how long it moves by itself from `start`: a step is over at once."""
        if self.kind == "ramp":
            return abs(self.target - start) / self.rate_per_s
        return self.periods / self.frequency_hz if self.kind == "sine" else 0.0

    def duration_s(self, start: float) -> float:
        return self.moving_s(start) + self.hold_s

    def at(self, elapsed_s: float, start: float) -> tuple[float, float, float]:
        """Return value, rate (per s) and acceleration (per s2) so long after it began at `start`."""
        if elapsed_s >= self.moving_s(start):
            return self.target, 0.0, 0.0
        if self.kind == "ramp":
            rate = math.copysign(self.rate_per_s, self.target - start)
            return start + rate * elapsed_s, rate, 0.0
        w = 2.0 * math.pi * self.frequency_hz
        sine, cosine = math.sin(w * elapsed_s), math.cos(w * elapsed_s)
        return self.target + self.amplitude * sine, self.amplitude * w * cosine, -self.amplitude * w * w * sine
