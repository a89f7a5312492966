"""Faults of the virtual board: one table of their kinds, and the schedule of a run.

A fault is written NAME@SECONDS[:VALUE]; SECONDS is board time since power-on. A fault whose value is a duration ends by
itself (0 = never), one that counts ends when it is used up, every other one stays.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from protocol.base.errors import ChoiceError

Lasting = Literal["stays", "seconds", "count"]


@dataclass(frozen=True, slots=True)
class FaultRow:
    """A row of the table: `default` of the value, and `value_name`, its unit or meaning."""

    default: float
    value_name: str
    lasting: Lasting
    sentence: str
    low: float = 0.0
    high: float = 1e9


FAULTS: dict[str, FaultRow] = {
    # channel
    "bit_flips": FaultRow(
        1e-3, "chance per byte", "stays", "One bit of a sent byte is flipped, with that probability.", 0, 1
    ),
    "drop_byte": FaultRow(1e-3, "chance per byte", "stays", "A sent byte is lost, with that probability.", 0, 1),
    "garbage": FaultRow(1000, "bytes", "count", "That many random bytes are sent between two frames."),
    "boot_text": FaultRow(1, "lines", "count", "Lines of text and NULs, as a boot loader prints them."),
    "wrong_baud": FaultRow(0, "seconds", "seconds", "Every byte arrives changed, as at a wrong baud rate."),
    "other_device": FaultRow(0, "seconds", "seconds", "The port belongs to another device: text instead of frames."),
    "silent": FaultRow(
        0, "seconds", "seconds", "The port stays open and the board executes commands, but sends nothing."
    ),
    "unplug": FaultRow(3, "seconds", "seconds", "The port disappears, and returns with the board still running."),
    # frames
    "absurd_value": FaultRow(3, "samples", "count", "Good frames with 5 MPa, 65535 counts, dark above lit, in turn."),
    "index_gap": FaultRow(1, "samples", "count", "That many SAMPLE frames are lost in the channel."),
    "dropped": FaultRow(10, "samples", "count", "The board drops that many samples, flags the next and sends EVENT 9."),
    "duplicate": FaultRow(1, "samples", "count", "That many SAMPLE frames arrive twice."),
    "reorder": FaultRow(1, "pairs", "count", "That many pairs of SAMPLE frames arrive in the wrong order."),
    "ack_lost": FaultRow(3, "answers", "count", "That many answers are lost; the commands are executed."),
    "ack_late": FaultRow(400, "ms", "stays", "Answers are delayed by that time."),
    "ack_refused": FaultRow(4, "status", "count", "The next SET_PRESSURE is refused with that status.", 1, 6),
    "wrong_protocol": FaultRow(2, "version", "stays", "HELLO names that version of the protocol.", 0, 255),
    # the board
    "clock_wrap": FaultRow(0, "", "stays", "The 32-bit clock wraps at that time (it starts just short of 2^32)."),
    "clock_back": FaultRow(5, "seconds", "stays", "The 32-bit clock goes back by that time.", 0, 4294),
    "drift_ppm": FaultRow(200, "ppm", "stays", "The board's clock is fast by that value; slow if negative.", -1e5, 1e5),
    "jitter": FaultRow(2, "ms", "stays", "Each sample is delayed by up to that time (at most 0.9 of its period)."),
    "slow_rate": FaultRow(62, "Hz", "stays", "The board samples at that rate, whatever START requested.", 1, 2e4),
    "reset": FaultRow(1, "boot reason", "count", "The board reboots: HELLO, vented, its clock at 0, no samples.", 0, 4),
    "reset_on_open": FaultRow(0.5, "seconds", "stays", "Opening the port resets the board; it boots for that time."),
    "estop": FaultRow(
        5, "seconds", "seconds", "The e-stop is pressed; at 0 s it is pressed from power-on, without an EVENT."
    ),
    "pressure_invalid": FaultRow(5, "seconds", "seconds", "The pressure sensor fails: flagged, vented, FAULT."),
    # pneumatics and body
    "overshoot": FaultRow(4, "kPa", "stays", "Each new target is overshot by that pressure.", 0, 30),
    "beyond_limit": FaultRow(60, "kPa", "count", "The pressure jumps to that value, whatever was commanded.", -90, 150),
    "leak": FaultRow(5, "% per minute", "stays", "The bladder loses that share a minute behind the gauge."),
    "dead_pump": FaultRow(0, "seconds", "seconds", "The pumps stop; pressure only leaks or vents."),
    "stall": FaultRow(30, "kPa", "stays", "The pumps reach at most that gauge pressure, positive or negative."),
    "softening": FaultRow(
        5, "% over 50 cycles", "stays", "The body softens with every cycle, by that share.", -100, 100
    ),
    # sensors
    "frozen_channel": FaultRow(1, "sensor", "stays", "That sensor repeats its last counts.", 1, 2),
    "saturate": FaultRow(1, "sensor", "stays", "Ambient light drives that sensor to full scale.", 1, 2),
    "ambient_step": FaultRow(
        300, "mV", "stays", "A lamp: the ambient light increases at once by that signal.", -100, 2000
    ),
    "ambient_ramp": FaultRow(10, "mV/s", "stays", "The ambient light increases at that rate, up to 600 mV.", -100, 1e4),
    "flicker": FaultRow(200, "mV", "stays", "The ambient light flickers at 100 Hz with that amplitude.", 0, 1000),
    "sensor_disagreement": FaultRow(20, "mV", "stays", "The last sensor is offset by that signal.", -1e3, 1e3),
}


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault of a run; times in board microseconds since power-on."""

    name: str
    start_us: int
    value: float

    @property
    def end_us(self) -> int | None:
        """When it ends by itself; None where it does not."""
        if FAULTS[self.name].lasting != "seconds" or self.value <= 0:
            return None
        return self.start_us + round(self.value * 1e6)


def fault_list() -> str:
    """Return the table as text, a line for each fault."""
    rows = []
    for name, kind in FAULTS.items():
        value = f" (VALUE: {kind.value_name}, {kind.default:g})" if kind.value_name else ""
        rows.append(f"  {name:20} {kind.sentence}{value}")
    return "\n".join(rows)


def parse_fault(text: str) -> Fault:
    """Return the fault in NAME@SECONDS[:VALUE], by default at power-on. RequestError: no such name or value."""
    head, _, value = text.strip().partition(":")
    name, _, seconds = head.partition("@")
    if name not in FAULTS:
        raise ChoiceError(f"there is no fault {name!r}", "list them", command="boat-daq board --fault list")
    return make_fault(name, _number(text, seconds or "0"), _number(text, value) if value else None)


def make_fault(name: str, at_s: float = 0.0, value: float | None = None) -> Fault:
    """Return one of `FAULTS`, by default with the table's value. RequestError: no such name, time or value."""
    if name not in FAULTS:
        raise ChoiceError(f"there is no fault {name!r}", "list them", command="boat-daq board --fault list")
    kind = FAULTS[name]
    value = kind.default if value is None else value
    if not 0 <= at_s <= 1e9:
        raise ChoiceError(f"the fault {name} cannot begin at {at_s:g} s", "count seconds from power-on")
    if not kind.low <= value <= kind.high:
        raise ChoiceError(f"the fault {name} cannot have the value {value:g}", f"use {kind.low:g} to {kind.high:g}")
    return Fault(name, round(at_s * 1e6), value)


def _number(text: str, part: str) -> float:
    try:
        number = float(part)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ChoiceError(f"{part!r} in the fault {text!r} is not a number", "use NAME@SECONDS[:VALUE]")
    return number


class FaultSchedule:
    """The active faults, in board time."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        self._coming = sorted(faults, key=lambda fault: fault.start_us)
        self._on: list[Fault] = []
        self.active: dict[str, float] = {}  # those that stay or last, by name; the latest wins

    @property
    def next_change_us(self) -> int | None:
        """When the next fault begins or ends by itself."""
        times = [fault.start_us for fault in self._coming[:1]]
        times += [fault.end_us for fault in self._on if fault.end_us is not None]
        return min(times, default=None)

    def move_to(self, now_us: int) -> tuple[list[Fault], list[Fault]]:
        """Return the faults that have begun and ended up to and with `now_us`."""
        begun = [fault for fault in self._coming if fault.start_us <= now_us]
        self._coming = self._coming[len(begun) :]
        self._on += [fault for fault in begun if FAULTS[fault.name].lasting != "count"]
        ended = [fault for fault in self._on if fault.end_us is not None and fault.end_us <= now_us]
        self._on = [fault for fault in self._on if fault not in ended]
        self.active = {fault.name: fault.value for fault in self._on}
        return begun, ended


class Countdown(Counter[str]):
    """How many are left of each fault that counts, by name."""

    def take(self, name: str, most: int = 1) -> int:
        """Use at most `most` of the number left, and return how many."""
        taken = min(self[name], most)
        self[name] -= taken
        if not self[name]:
            del self[name]
        return taken
