"""The interlock: the only way to a pressure, and the watch over every sample.

Rules. A pressure command exists only as the result of `Interlock.authorise`, which applies the tightest limits of
board, unit and plan. Every sample is inspected as a level, not as an edge: an e-stop that was pressed before the board
was connected counts like one that is pressed now. What is found latches, and no pressure is authorised until the
operator clears it and its cause is gone. The caller (`Controller`) vents at every trip.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.control.sequencer import VENTED_KPA, ControlEvent
from boat_daq.engine.control.trips import Trip, trip_of_level
from boat_daq.engine.sample_columns import Columns
from boat_daq.engine.snapshot import Limits, MessageKind
from protocol.base.errors import RequestError
from protocol.base.units import Quantity, UnitText
from protocol.link.messages import SetPressure
from protocol.recording import BoardState, SampleFlag

MARGIN_KPA = 2.0  # beyond a limit by more than this the board vents by itself, and so do we
IMPLAUSIBLE_KPA = 1000.0  # a good checksum is no validation: no unit of this kind reads ten atmospheres
FLAT_PRESSURE_KPA = 20.0  # a sensor whose reading stays the same while the pressure moves so far is frozen
FLAT_SAMPLES = 20
ARRIVAL_S = 10.0  # allowed beyond the ramp's own time; without progress, for a vented unit to reach zero
LEFT_S, PROGRESS_KPA = 1.0, 0.5
WINDOW_US, BAD_SHARE = 1_000_000, 0.01  # of board time, in which more than this share of bad samples is an alarm
_TRIPPING = int(SampleFlag.ESTOP | SampleFlag.PRESSURE_INVALID)


class Interlock:
    """Limits, levels, latch."""

    def __init__(self) -> None:
        self._limits: dict[str, tuple[float, float]] = {}
        self._present: Trip | None = None
        self.limits: Limits | None = None  # the tightest; None before any is known
        self.latched: Trip | None = None

    # ---- limits ----------------------------------------------------------------------------------------------------

    def set_limits(self, source: str, limits_kpa: tuple[float, float] | None) -> None:
        """Set or remove (None) the limits of "board", "unit" or "plan"."""
        self._limits.pop(source, None)
        if limits_kpa is not None:
            low, high = limits_kpa
            if not (math.isfinite(low) and math.isfinite(high) and low <= 0 <= high and low < high):
                ends = Quantity(low, "kPa", named=False), " to ", Quantity(high, "kPa")
                text = UnitText(f"the {source}'s limits ", *ends, " are not usable")
                raise RequestError(text, "give a range around 0 kPa, the lower limit first")
            self._limits[source] = limits_kpa
        self.limits = _tightest(self._limits)

    def of(self, source: str) -> tuple[float, float] | None:
        """Return the limits of "board", "unit" or "plan"; None where it has none."""
        return self._limits.get(source)

    def check(self, target_kpa: float, *, new_plan: bool = False) -> None:
        """Refuse a target outside the limits. For a new plan those of the one before do not count."""
        limits = _tightest({k: v for k, v in self._limits.items() if k != "plan"}) if new_plan else self.limits
        if limits is None:
            raise RequestError("no pressure limits are known yet", "connect a board first")
        if not math.isfinite(target_kpa):
            raise RequestError(f"{target_kpa} is not a pressure")
        asked, low, high = (Quantity(kpa, "kPa") for kpa in (target_kpa, limits.min_kpa, limits.max_kpa))
        if target_kpa > limits.max_kpa + 1e-9:
            text = UnitText(asked, f" is above the {limits.max_source}'s limit of ", high)
            raise RequestError(text, "choose a lower pressure")
        if target_kpa < limits.min_kpa - 1e-9:
            text = UnitText(asked, f" is below the {limits.min_source}'s limit of ", low)
            raise RequestError(text, "choose a higher pressure")

    def authorise(self, target_kpa: float, ramp_kpa_per_s: float) -> SetPressure:
        """Return the command for a pressure: no other function makes one."""
        if self.latched is not None:
            raise RequestError(
                UnitText("no pressure: ", self.latched.cause), self.latched.remedy or "clear the fault first"
            )
        self.check(target_kpa)
        if not 0 < ramp_kpa_per_s < 1e5:
            text = UnitText("a ramp of ", Quantity(ramp_kpa_per_s, "kPa/s"), " is not possible")
            raise RequestError(text, "give a rate above 0")
        return SetPressure(round(target_kpa * 1000), max(1, round(ramp_kpa_per_s * 1000)))

    # ---- levels ----------------------------------------------------------------------------------------------------

    def inspect(self, block: Columns) -> Trip | None:
        """Inspect every sample. Latch and return the first trip, None where nothing new is found."""
        if not len(block):
            return None
        if self._clear(block):
            self._present = None
            return None
        levels = self._levels(block)
        self._present = self._describe(block, len(block) - 1, levels)
        found = [int(np.argmax(level)) for level in levels.values() if level[-1] or level.any()]
        first = self._describe(block, min(found), levels) if found else None
        return self.trip(first) if first else None

    def trip(self, found: Trip) -> Trip | None:
        """Latch `found`; returns it, or None when something was latched already."""
        if self.latched is not None:
            return None
        self.latched = found
        return found

    def require_gone(self) -> None:
        """Refuse to clear a trip whose level the newest sample still shows. The board clears its own latch."""
        if self._present is not None and self._present.kind is not MessageKind.BOARD_FAULT:
            raise RequestError(f"the cause of the fault is still present: {self._present.cause}", self._present.remedy)

    def _clear(self, block: Columns) -> bool:
        """Whether no sample shows a trip. True of nearly every block, for a fifth of the work."""
        low, high = self._bounds
        pressure = block.pressure_kpa
        return (
            int(np.bitwise_or.reduce(block.flags)) & _TRIPPING == 0
            and int(block.state.max()) < BoardState.FAULT
            and float(pressure.min()) >= max(low - MARGIN_KPA, -IMPLAUSIBLE_KPA)  # never true of nan
            and float(pressure.max()) <= min(high + MARGIN_KPA, IMPLAUSIBLE_KPA)
        )

    def _levels(self, block: Columns) -> dict[MessageKind, NDArray[np.bool_]]:
        """Return for each kind of trip which samples show it [n]. Of one sample's kinds the first here is named."""
        pressure, known = block.pressure_kpa, block.pressure_known
        low, high = self._bounds
        with np.errstate(invalid="ignore"):  # a pressure that is not a number is caught by `known`
            return {
                MessageKind.ESTOP: (block.flags & int(SampleFlag.ESTOP)) != 0,
                MessageKind.PRESSURE_INVALID: ~known,
                MessageKind.IMPLAUSIBLE: known & (np.abs(pressure) > IMPLAUSIBLE_KPA),
                MessageKind.OVER_PRESSURE: known & (pressure > high + MARGIN_KPA),
                MessageKind.UNDER_PRESSURE: known & (pressure < low - MARGIN_KPA),
                MessageKind.BOARD_FAULT: block.state == BoardState.FAULT,
            }

    def _describe(self, block: Columns, at: int, levels: dict[MessageKind, NDArray[np.bool_]]) -> Trip | None:
        """Return what sample `at` shows."""
        kind = next((kind for kind, level in levels.items() if level[at]), None)
        if kind is None:
            return None
        pressure_kpa, (low, high) = float(block.pressure_kpa[at]), self._bounds
        return trip_of_level(kind, pressure_kpa, int(block.time_us[at]), low=low, high=high, margin=MARGIN_KPA)

    @property
    def _bounds(self) -> tuple[float, float]:
        limits = self.limits
        return (limits.min_kpa, limits.max_kpa) if limits else (-math.inf, math.inf)


def _tightest(limits_kpa: dict[str, tuple[float, float]]) -> Limits | None:
    if not limits_kpa:
        return None
    low_source = max(limits_kpa, key=lambda source: limits_kpa[source][0])
    high_source = min(limits_kpa, key=lambda source: limits_kpa[source][1])
    return Limits(limits_kpa[low_source][0], limits_kpa[high_source][1], low_source, high_source)


class FlatLine:
    """Detects sensors that read the same value while the pressure moves."""

    def __init__(self) -> None:
        self._value: NDArray[np.float64] = np.empty(0)  # of each sensor's newest sample; since it reads that value:
        self._low = self._high = self._value  # extremes of the pressure
        self._samples: NDArray[np.int64] = np.empty(0, np.int64)
        self._frozen: NDArray[np.bool_] = np.empty(0, bool)

    @property
    def frozen(self) -> tuple[int, ...]:
        """Sensors (from 1) that are frozen now."""
        return tuple((np.flatnonzero(self._frozen) + 1).tolist())

    def inspect(self, block: Columns) -> list[int]:
        """Return the sensors (from 1) newly found frozen."""
        n, sensors = block.raw.shape
        if not n:
            return []
        if len(self._value) != sensors:
            self._value, self._frozen = np.full(sensors, np.nan), np.zeros(sensors, bool)
            self._low, self._high, self._samples = self._value, self._value, np.zeros(sensors, np.int64)
        newest = block.raw[-1]
        other = (block.raw != newest)[::-1].argmax(axis=0)  # samples since another reading; 0: there was none
        length = np.where(other, other, n)
        back = block.pressure_kpa[::-1]
        low, high = np.fmin.accumulate(back)[length - 1], np.fmax.accumulate(back)[length - 1]
        same = (other == 0) & (newest == self._value)
        self._low = np.where(same, np.fmin(low, self._low), low)
        self._high = np.where(same, np.fmax(high, self._high), high)
        self._samples = np.where(same, self._samples, 0) + length
        flat = (self._high - self._low >= FLAT_PRESSURE_KPA) & (self._samples >= FLAT_SAMPLES)
        found = flat & ~(self._frozen & same)
        self._value, self._frozen = newest, found | (self._frozen & same)
        return (np.flatnonzero(found) + 1).tolist()


class SensorAlarms:
    """Notices sensors without signal, at the end of the converter's range, and impossible samples, by the second."""

    def __init__(self) -> None:
        self.present: dict[str, ControlEvent] = {}  # by its text
        self._begin(0)

    def _begin(self, now_us: int) -> None:
        self._since_us, self._n, self._impossible = now_us, 0, 0
        self._sum: NDArray[np.float64] | float = 0.0  # of each sensor's signal; its square; samples at the end
        self._squares: NDArray[np.float64] | float = 0.0
        self._saturated: NDArray[np.int64] | int = 0

    def inspect(self, block: Columns, now_us: int, full_counts: int | None) -> list[ControlEvent]:
        """Return the alarms that begin.

        `now_us` never goes back; `full_counts` is the converter's highest reading, None where the samples are signals,
        of which neither a range nor a zero is known.
        """
        bad = (block.flags & int(SampleFlag.IMPLAUSIBLE)) != 0
        signal = block.signal_mv[~bad] if bad.any() else block.signal_mv
        self._n += len(block)
        self._impossible += int(bad.sum())
        if full_counts is not None:
            self._saturated = self._saturated + (block.raw >= full_counts).sum(axis=0)
            self._sum, self._squares = self._sum + signal.sum(axis=0), self._squares + (signal**2).sum(axis=0)
        if now_us - self._since_us < WINDOW_US or self._n < FLAT_SAMPLES:
            return []
        found = {event.text: event for event in self._alarms(counts=full_counts is not None)}
        new = [event for text, event in found.items() if text not in self.present]
        self.present = found
        self._begin(now_us)
        return new

    def _alarms(self, *, counts: bool) -> Iterator[ControlEvent]:
        least, good = BAD_SHARE * self._n, max(self._n - self._impossible, 1)
        if self._impossible > least:
            text = "samples with impossible values arrive, and are left out"
            yield ControlEvent(
                MessageKind.IMPLAUSIBLE, text, "warning", "check the sensors, their cables and the board"
            )
        if not counts:
            return
        mean = np.asarray(self._sum) / good
        silent = mean**2 <= np.asarray(self._squares) / good - mean**2  # the mean is within the standard deviation
        for i in np.flatnonzero(silent & (self._impossible <= least)).tolist():
            text, remedy = f"sensor {i + 1} gives no signal", "check its emitter, receiver and cable"
            yield ControlEvent(MessageKind.SENSOR_LOST, text, "warning", remedy, i + 1)
        for i in np.flatnonzero(np.asarray(self._saturated) > least).tolist():
            text, remedy = f"sensor {i + 1} is saturated", "reduce the light or its gain"
            yield ControlEvent(MessageKind.SATURATED, text, "warning", remedy, i + 1)


class PressureWatch:
    """Notices a manual pressure that is not reached, or left, and a pressure that stays on a vented unit."""

    def __init__(self) -> None:
        self.present: ControlEvent | None = None
        self._goal_kpa: float | None = None
        self._least_kpa = math.inf  # the nearest to zero, with nothing commanded
        self._deadline_us = 0

    def commanded(self, now_us: int, pressure_kpa: float, goal_kpa: float, ramp_kpa_per_s: float) -> None:
        self.present, self._goal_kpa = None, goal_kpa
        self._deadline_us = now_us + round(1e6 * (abs(goal_kpa - pressure_kpa) / ramp_kpa_per_s + ARRIVAL_S))

    def inspect(self, now_us: int, pressure_kpa: float, goal_kpa: float | None) -> ControlEvent | None:
        """Return the alarm that begins. `goal_kpa`: None while nothing is commanded; `now_us` never goes back."""
        if goal_kpa != self._goal_kpa:
            self.present, self._goal_kpa, self._least_kpa = None, goal_kpa, math.inf
            self._deadline_us = now_us + round(1e6 * ARRIVAL_S)
        away = abs(pressure_kpa - (goal_kpa or 0.0))
        if away < VENTED_KPA:
            self.present, self._least_kpa = None, 0.0
            self._deadline_us = now_us + round(1e6 * LEFT_S)
        elif goal_kpa is None and away < self._least_kpa - PROGRESS_KPA:
            self._least_kpa, self._deadline_us = away, now_us + round(1e6 * ARRIVAL_S)
        if away < VENTED_KPA or now_us <= self._deadline_us or self.present is not None:
            return None
        at, remedy = Quantity(pressure_kpa, "kPa", ".1f"), "check for a leak, and that the pump runs"
        if goal_kpa is None:
            text = UnitText("the pressure stays at ", at, " on a vented unit")
            remedy = "open its valve manually, or check the zero of the pressure sensor"
        else:
            text = UnitText("the pressure is ", at, ", not ", Quantity(goal_kpa, "kPa"))
        self.present = ControlEvent(MessageKind.PRESSURE_OFF, text, "warning", remedy, pressure_kpa)
        return self.present
