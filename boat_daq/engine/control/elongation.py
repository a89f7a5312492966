"""Control of the elongation: a regulator at its period, on board time. A client of the interlock.

The loop takes samples, and once a period returns a pressure to request, or why it stops; it commands nothing. Its
clock is the board's, so that a virtual board is controlled alike at any speed that the link can follow. One pressure is
under way at a time: the next is computed when the board has acknowledged the one before, and the time that this takes
is compared with the delay that the regulator's margins allow.

It stops for what the regulator finds in the signals, and for what only the link shows: samples older than
`STALE_S`, a delay beyond the margin. What then happens to the pressure, vent or hold, is the operator's choice.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.sample_columns import Columns
from boat_daq.engine.snapshot import ElongationControl, MessageKind
from protocol.recording import NOT_FOR_FIGURES, SampleFlag

STALE_S = 0.2
AT_LIMIT_S = 3.0  # of a pressure at its limit or ramp, after which it is reported
SLOW_ANSWERS = 3  # in turn, that count as a delay of the link
FASTEST = 8.0  # board time over host time that a host can control at

_NO_SIGNAL = int(NOT_FOR_FIGURES & ~(SampleFlag.SATURATED | SampleFlag.PRESSURE_INVALID))

Point = tuple[float, float, float]  # setpoint: mm, mm/s and mm/s2
Signals = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LoopStop:
    """Why the elongation is no longer controlled."""

    kind: MessageKind
    cause: str
    remedy: str


@dataclass(frozen=True, slots=True)
class Regulated:
    """Pressure of one period, with setpoint, elongation and its U (k = 2), NaN where unknown."""

    pressure_kpa: float
    ramp_kpa_per_s: float
    setpoint_mm: float
    elongation_mm: float
    u_mm: float
    saturated: bool
    lost: tuple[int, ...] = ()  # sensors (from 1) newly lost
    stop: LoopStop | None = None


@dataclass(frozen=True, slots=True)
class Regulator:
    """Signals in, pressures out, for one unit.

    `begin`: (board time s, pressure kPa, signals [n, sensors] mV) -> elongation, mm. `advance`: (board time s, mean
    time of the samples s, setpoint, signals, limits kPa, whether a step is made smooth).
    """

    unit: str
    period_s: float
    delay_margin_s: float
    check: Callable[[float], None]  # refuses a setpoint outside the calibrated range, mm
    begin: Callable[[float, float, Signals], float]
    advance: Callable[[float, float, Point, Signals, tuple[float, float], bool], Regulated]


class ElongationLoop:
    """One closed loop, from its start to its stop. `lost`: sensors (from 1) that are lost."""

    def __init__(self, regulator: Regulator, *, hold: bool = False) -> None:
        self.regulator, self.hold = regulator, hold
        self.target_mm = 0.0
        self.lost: tuple[int, ...] = ()
        self.at_limit_s = 0.0
        self._blocks: list[Columns] = []
        self._last: Regulated | None = None
        self._next_us = 0
        self._sent_ns: int | None = None  # of the pressure that waits for its answer
        self._answers_s: deque[float] = deque(maxlen=SLOW_ANSWERS)

    def begin(self, block: Columns, pressure_kpa: float) -> None:
        """Start from the newest samples, at the elongation that they show.

        `pressure_kpa`: commanded now, or measured on a vented unit.
        """
        self.target_mm = self.regulator.begin(int(block.time_us[-1]) / 1e6, pressure_kpa, _signals(block))
        self._next_us = int(block.time_us[-1])

    def sent(self, now_ns: int) -> None:
        """Note that a pressure was sent."""
        self._sent_ns = now_ns

    def answered(self, now_ns: int, speed: float) -> None:
        """Note its answer; `speed` is board time over host time."""
        if self._sent_ns is not None:
            self._answers_s.append((now_ns - self._sent_ns) / 1e9 * max(speed, 1.0))
        self._sent_ns = None

    def feed(self, block: Columns, point: Point | None, limits_kpa: tuple[float, float]) -> Regulated | LoopStop | None:
        """Take samples; return the next pressure once a period is over, or why to stop.

        `point`: setpoint of a plan, mm, mm/s and mm/s2; None for the manual one.
        """
        self._blocks.append(block)
        now_us = int(block.time_us[-1])
        if now_us < self._next_us or self._sent_ns is not None:
            return None
        self._next_us = max(self._next_us + round(1e6 * self.regulator.period_s), now_us)
        blocks, self._blocks = self._blocks, []
        time_us, signals = np.concatenate([b.time_us for b in blocks]), np.concatenate([_signals(b) for b in blocks])
        shaped = point is None or not any(point[1:])
        setpoint = (self.target_mm, 0.0, 0.0) if point is None else point
        sampled_s = float(time_us.mean()) / 1e6
        found = self.regulator.advance(now_us / 1e6, sampled_s, setpoint, signals, limits_kpa, shaped)
        self._last = found
        self.lost += found.lost
        self.at_limit_s = self.at_limit_s + self.regulator.period_s if found.saturated else 0.0
        if found.stop is not None:
            return found.stop
        slowest_s = min(self._answers_s, default=0.0)
        if len(self._answers_s) == SLOW_ANSWERS and slowest_s > self.regulator.delay_margin_s:
            return self._delayed(slowest_s)
        return found

    def _delayed(self, delay_s: float) -> LoopStop:
        margin_s = self.regulator.delay_margin_s
        cause = f"the board answers after {1000 * delay_s:.0f} ms, the control tolerates {1000 * margin_s:.0f} ms"
        return LoopStop(MessageKind.LINK_DELAY, cause, "connect the board directly, or use slower gains")

    def late(self, now_ns: int, age_s: float) -> LoopStop | None:
        """Return why to stop where an answer, or the newest sample, is too late."""
        waits_s = 0.0 if self._sent_ns is None else (now_ns - self._sent_ns) / 1e9
        if waits_s > max(2.0 * self.regulator.delay_margin_s, STALE_S):
            return self._delayed(waits_s)
        if age_s <= STALE_S:
            return None
        cause = f"the newest sample is {1000 * age_s:.0f} ms old, more than {1000 * STALE_S:.0f} ms"
        return LoopStop(MessageKind.STALE_SAMPLES, cause, "check the link, and close other programs on this computer")

    def state(self) -> ElongationControl:
        """Return what is shown of it."""
        last = self._last
        if last is None:
            return ElongationControl(self.target_mm, self.target_mm, self.target_mm, float("nan"), hold=self.hold)
        delay_s, lost, hold = max(self._answers_s, default=0.0), self.lost, self.hold
        measured = (last.setpoint_mm, last.elongation_mm, last.u_mm, last.saturated)
        return ElongationControl(self.target_mm, *measured, lost, hold, delay_s)


def _signals(block: Columns) -> Signals:
    """Return the signals [n, sensors] of a block, NaN where a sample is no measurement.

    A saturated sensor's is kept: it lies far outside its range, and the flag does not say which sensor it is.
    """
    unusable = (block.flags & _NO_SIGNAL) != 0
    return np.where(unusable[:, None], np.nan, block.signal_mv)
