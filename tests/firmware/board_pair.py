"""The virtual board and the firmware, given the same input in step, and the messages of both.

The firmware is given the pressure that the virtual board's control measured at each tick, so that both must reach
the same decisions; noise, counts and the pressure in the samples are the plant's and are not compared. A board may pass
a threshold one control tick (10 ms) sooner or later than the other: the one counts its setpoint in fractions of a
kPa, the other in hundredths of a Pa.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass

import pytest

import protocol.simulator.board
from protocol.link.framing import FrameReader
from protocol.link.messages import Ack, BoardEvent, BoardMessage, EventCode, Hello, Sample, decode_message
from protocol.simulator.board import VirtualBoard
from protocol.simulator.board_control import BoardControl
from protocol.simulator.faults import Fault
from protocol.simulator.plant import TICK_US
from tests.firmware.firmware_build import FirmwareProcess

PLANT_FAULTS = ("beyond_limit", "dead_pump", "stall", "leak")  # they act through the pressure
TRIP_PA = 500  # a pressure one tick later
MOST_TICKS = 100  # for one request: the output of that time fits the process's buffer at any rate


class BoardPair:
    """Both boards, just booted."""

    def __init__(self, process: FirmwareProcess, monkeypatch: pytest.MonkeyPatch, faults: Iterable[Fault] = ()) -> None:
        self._found = found = []

        class WatchedControl(BoardControl):
            def tick(self, now_us: int) -> None:
                found.append(round(1000 * self.pneumatics.pressure_kpa))
                BoardControl.tick(self, now_us)

        monkeypatch.setattr(protocol.simulator.board, "BoardControl", WatchedControl)
        faults = tuple(faults)
        self._board = VirtualBoard(faults=faults)
        self._process = process
        self._tick = 0
        self._switches = sorted(requests_of(faults))
        clock_wrap = next((fault.start_us for fault in faults if fault.name == "clock_wrap"), 0)
        process.transmitted("Z")
        self.virtual = self._board.advance(0)
        self.firmware = process.boot(clock_us=-clock_wrap % 2**32)
        self._switch()

    def wait(self, ticks: int) -> None:
        """Let board time pass, by control ticks of 10 ms."""
        end = self._tick + ticks
        while self._tick < end:
            part = (
                min([end, self._tick + MOST_TICKS, *(tick for tick, _ in self._switches if tick > self._tick)])
                - self._tick
            )
            self._found.clear()
            self.virtual += self._board.advance(part * TICK_US)
            self.firmware += self._process.transmitted("T " + " ".join(map(str, self._found)))
            self._tick += part
            self._switch()
            self.firmware += self._process.transmitted(f"P {round(1000 * self._board.pressure_kpa)}")

    def receive(self, data: bytes) -> None:
        """Give the same bytes to both."""
        self._board.receive(data)
        self.virtual += self._board.advance(0)
        self.firmware += self._process.receive(data)

    def _switch(self) -> None:
        while self._switches and self._switches[0][0] <= self._tick:
            self.firmware += self._process.transmitted(self._switches.pop(0)[1])


def requests_of(faults: Iterable[Fault]) -> list[tuple[int, str]]:
    """Return (tick, request to the firmware) for the faults that act on the board itself."""
    orders = []
    for fault in faults:
        tick, value = fault.start_us // TICK_US, int(fault.value)
        match fault.name:
            case "estop" | "pressure_invalid":
                letter, on = ("E", 1) if fault.name == "estop" else ("V", 0)
                orders.append((tick, f"{letter} {on}"))
                if fault.end_us is not None:
                    orders.append((fault.end_us // TICK_US, f"{letter} {1 - on}"))
            case "saturate":
                orders.append((tick, f"S {1 << value - 1}"))
            case "dropped":
                orders.append((tick, f"D {value}"))
            case "reset":
                orders.append((tick, f"B {value} 0"))
            case "clock_wrap":
                pass
            case name:
                assert name in PLANT_FAULTS
    return orders


# ---- messages ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Messages:
    """Messages of a board: its samples and all others, each in order."""

    samples: list[Sample]
    others: list[BoardMessage]


def messages_of(data: bytes) -> Messages:
    """Decode a board's bytes: valid frames, numbered consecutively from each boot."""
    reader = FrameReader()
    messages = []
    seq = 0
    for frame in reader.receive(data):
        message = decode_message(frame, 2)
        assert message is not None
        if isinstance(message, Hello) and frame.seq == 0:
            seq = 0
        assert frame.seq == seq
        seq = (seq + 1) % 256
        messages.append(message)
    assert (reader.crc_errors, reader.malformed, reader.oversize) == (0, 0, 0)
    samples = [message for message in messages if isinstance(message, Sample)]
    return Messages(samples, [message for message in messages if not isinstance(message, Sample)])


def assert_the_same(virtual: bytes, firmware: bytes) -> None:
    """Fail on the first message in which the two boards differ."""
    one, other = messages_of(virtual), messages_of(firmware)
    for expected, found in zip(one.others, other.others, strict=False):
        assert same_message(expected, found), f"virtual board: {expected}\nfirmware: {found}"
    assert one.others[len(other.others) :] == []
    assert other.others[len(one.others) :] == []
    instants = [(sample.index, sample.time_us) for sample in one.samples]
    assert [(sample.index, sample.time_us) for sample in other.samples] == instants
    shown = [(sample.state, sample.flags) for sample in one.samples]
    for at, sample in enumerate(other.samples):
        assert (sample.state, sample.flags) in shown[max(0, at - 1) : at + 2], f"{sample}, virtual board: {shown[at]}"


def same_message(expected: BoardMessage, found: BoardMessage) -> bool:
    """Return whether two messages mean the same; those that follow from a threshold may be a tick apart."""
    if isinstance(expected, Hello) and isinstance(found, Hello):
        return expected == dataclasses.replace(found, board_id=expected.board_id)
    if isinstance(expected, BoardEvent) and isinstance(found, BoardEvent):
        late_us = (found.time_us - expected.time_us + TICK_US) % 2**32
        near = TRIP_PA if expected.code == EventCode.TARGET_NOT_REACHED else 0
        return expected.code == found.code and late_us <= 2 * TICK_US and abs(expected.value - found.value) <= near
    return isinstance(expected, Ack) and expected == found
