"""Figures of a unit's dynamics as values, with their texts: for a command."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any

from analysis.json_object import json_object

BODE_HEADINGS = ("frequency, amplitude", "gain, dB", "phase, °")


@dataclass(frozen=True, slots=True)
class DynamicFigure:
    """A figure with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class StepFigures:
    """Figures of a step response, each with a 95 % interval."""

    time_constant_s: DynamicFigure  # until 63.2 % of the step
    rise_s: DynamicFigure  # from 10 to 90 %
    settling_s: DynamicFigure  # until it stays within the tolerance of its final value
    overshoot_percent: DynamicFigure
    bandwidth_hz: DynamicFigure  # at -3 dB
    phase_lag_deg: DynamicFigure


@dataclass(frozen=True, slots=True)
class BodePoint:
    """One frequency of a sweep: gain and phase of the elongation over its setpoint, with standard uncertainties.

    `amplitude_mm` is that of the setpoint, NaN where it is not known; `n` the number of repeats that were averaged: one
    has no uncertainty.
    """

    frequency_hz: float
    gain_db: float
    phase_deg: float
    u_gain_db: float
    u_phase_deg: float
    amplitude_mm: float = math.nan
    n: int = 1


@dataclass(frozen=True, slots=True)
class DynamicCalibration:
    """The dynamics of a run."""

    unit: str  # with simulated, recording: the unit and the run
    simulated: bool
    recording: str
    tolerance_mm: float
    steps: dict[float, dict[str, DynamicFigure]]  # figures by the size of the step, mm
    bode: tuple[BodePoint, ...]  # a point for each frequency and amplitude
    bandwidth_hz: DynamicFigure  # at -3 dB, with its interval; NaN where no sine reaches it
    counts: dict[float, int] = field(default_factory=dict)  # number of the steps of each size
    recorded_utc: str = ""
    calibration_utc: str = ""

    @property
    def verdict(self) -> str:
        """The longest settling and the bandwidth, where they were measured."""
        settled = [figures["settling_s"].value for figures in self.steps.values()]
        parts = [f"settles to within {self.tolerance_mm:g} mm in {max(settled):.2f} s or less" if settled else ""]
        if self.bode:
            parts.append(f"bandwidth {self.bandwidth_text}")
        return ", ".join(filter(None, parts))

    @property
    def bandwidth_text(self) -> str:
        """The bandwidth with its interval, or what it is above."""
        edge, highest = self.bandwidth_hz, max((p.frequency_hz for p in self.bode), default=math.nan)
        if not math.isfinite(edge.value):
            return f"above {highest:g} Hz: -3 dB is not reached"
        if not math.isfinite(edge.low):
            return f"{edge.value:.2f} Hz at -3 dB (no interval)"
        upper = f"{edge.high:.2f}" if math.isfinite(edge.high) else f"more than {highest:g}"
        return f"{edge.value:.2f} Hz ({edge.low:.2f} to {upper} Hz) at -3 dB"

    def bode_rows(self) -> tuple[tuple[str, ...], ...]:
        """Return gain and phase with U (k = 2) as texts, in the order of `BODE_HEADINGS`."""
        return tuple(
            (
                f"{p.frequency_hz:g} Hz" + (f", {p.amplitude_mm:g} mm" if math.isfinite(p.amplitude_mm) else ""),
                f"{p.gain_db:+z.2f} {_interval(p.u_gain_db)}",
                f"{p.phase_deg:+z.2f} {_interval(p.u_phase_deg)}",
            )
            for p in self.bode
        )

    def as_json(self) -> dict[str, Any]:
        steps = [
            {
                "step_mm": size,
                "count": self.counts.get(size),
                **{name: asdict(figure) for name, figure in figures.items()},
            }
            for size, figures in self.steps.items()
        ]
        head = ("unit", "simulated", "recording", "recorded_utc", "calibration_utc", "tolerance_mm")
        edge = [self.bandwidth_hz.low, self.bandwidth_hz.high]
        found = json_object(self, *head) | {"steps": steps}
        return found | json_object(self, "bode", "bandwidth_hz=bandwidth_hz.value") | {"bandwidth_95_hz": edge}


def _interval(u: float) -> str:
    return f"± {2 * u:.2f}" if math.isfinite(u) else "(one period)"
