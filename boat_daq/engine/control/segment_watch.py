"""One segment of a profile, watched by board time: it lasts as long as it says, and the pressure has to follow it.

The setpoint is a function of the time since the segment began. Of a profile in kilopascal the pressure has to come near
its setpoint, within the plan's tolerance and what it moves in `LAG_S`, at least once in every `arrival_timeout_s`; else
the segment times out. Of one in millimetres the controller of the elongation watches that it follows.
"""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from boat_daq.engine.plan import Plan, PlannedStep
from boat_daq.engine.sample_columns import Columns
from boat_daq.engine.snapshot import Phase
from protocol.recording import Segment

LAG_S = 0.5  # how far a pressure may stay behind a setpoint that moves


class SegmentWatch:
    """Watches one segment; `outcome` becomes "reached" or "timeout" at `ended_us`. Its interface is `StepWatch`'s."""

    def __init__(self, plan: Plan, step: PlannedStep, *, started_us: int, wait_for_reading: bool = False) -> None:
        assert step.segment is not None
        self.segment: Segment = step.segment
        self._plan, self._start, self._started_us = plan, step.start, started_us
        self._end_us = started_us + round(1e6 * self.segment.duration_s(step.start))
        self._moved_us = started_us + round(1e6 * self.segment.moving_s(step.start))
        self._near_us = started_us
        self._extremes = (math.inf, -math.inf)
        self._waits_since_us: int | None = None
        self.reading_awaited = wait_for_reading and self.segment.reading
        self.reading_timed_out = False
        self.arrived_us: int | None = None
        self.settled_us: int | None = None
        self.ended_us: int | None = None
        self.outcome: str | None = None

    def setpoint(self, time_us: int) -> tuple[float, float, float]:
        """Return value, rate and acceleration at a board time."""
        return self.segment.at((time_us - self._started_us) / 1e6, self._start)

    def commanded(self, time_us: int, from_kpa: float) -> None:
        """Begin the time allowed where the unit comes from another pressure: a ramp from there takes its time."""
        ramp_s = 0.0 if self._plan.controls_elongation else abs(self.setpoint(time_us)[0] - from_kpa)
        self._near_us = max(self._near_us, time_us + round(1e6 * ramp_s / self._plan.ramp_kpa_per_s))

    @property
    def phase(self) -> Phase:
        if self._waits_since_us is not None and self.outcome is None:
            return Phase.WAITING_FOR_READING
        return Phase.RAMPING if self.arrived_us is None else Phase.DWELLING

    def waited_s(self, now_us: int) -> float:
        """Return how long it has waited for its reading by `now_us`, seconds; 0 where it did not."""
        return 0.0 if self._waits_since_us is None else ((self.ended_us or now_us) - self._waits_since_us) / 1e6

    def feed(self, block: Columns) -> None:
        block = block.part(block.pressure_known)
        if not len(block) or self.outcome is not None:
            return
        now_us, pressure = int(block.time_us[-1]), block.pressure_kpa
        self._extremes = min(self._extremes[0], float(pressure.min())), max(self._extremes[1], float(pressure.max()))
        if not self._plan.controls_elongation:
            self._follow(block)
        if self.arrived_us is None and now_us >= self._moved_us:
            self.arrived_us = self.settled_us = self._moved_us
        if now_us < self._end_us or self.outcome is not None:
            return
        if self.reading_awaited:
            self._waits_since_us = self._waits_since_us or now_us
            if now_us < self._waits_since_us + round(1e6 * self._plan.reading_timeout_s):
                return
            self.reading_timed_out = True
        self.outcome, self.ended_us = "reached", now_us

    def _follow(self, block: Columns) -> None:
        """Time out where the pressure has not been near its setpoint for too long."""
        at_us = int(block.time_us[-1])
        value, rate, _ = self.setpoint(at_us)
        near = np.abs(block.pressure_kpa - value) <= self._plan.tolerance_kpa + LAG_S * abs(rate)
        if near.any():
            self._near_us = max(self._near_us, at_us)
        elif at_us - self._near_us > 1e6 * self._plan.arrival_timeout_s:
            self.outcome, self.ended_us = "timeout", at_us

    def detail(self) -> dict[str, Any]:
        """Return what is kept of the segment beside its times."""
        kept: dict[str, Any] = {
            "segment": asdict(self.segment), "start": self._start, "quantity": self._plan.quantity
        }  # fmt: skip
        if math.isfinite(self._extremes[0]):
            kept |= {"pressure_min_kpa": self._extremes[0], "pressure_max_kpa": self._extremes[1]}
        return kept | ({"reading_timed_out": True} if self.reading_timed_out else {})
