"""A host without a port, for tests of the virtual board: commands in, messages out, seconds of board time."""

from __future__ import annotations

from protocol.link.framing import FrameReader
from protocol.link.messages import (
    Ack,
    AckStatus,
    BoardEvent,
    BoardMessage,
    Command,
    EventCode,
    Sample,
    SetPressure,
    decode_message,
    encode_command,
)
from protocol.simulator.board import VirtualBoard
from protocol.simulator.faults import parse_fault


class BoardHost:
    """A board and all messages received from it."""

    def __init__(self, *faults: str, unit: str = "SA1", seed: int = 0) -> None:
        self.board = VirtualBoard(unit, seed=seed, faults=[parse_fault(fault) for fault in faults])
        self.reader = FrameReader()
        self.seq = 0
        self.received: list[BoardMessage] = []
        self.wait(0.0)

    def take(self, data: bytes) -> list[BoardMessage]:
        """Decode what the board sent."""
        messages = [decode_message(frame, 2) for frame in self.reader.receive(data)]
        assert None not in messages
        self.received += messages
        return messages

    def wait(self, seconds: float) -> list[BoardMessage]:
        """Pass board time; return the messages received meanwhile."""
        return self.take(self.board.advance(round(seconds * 1e6)))

    def send(self, command: Command, seq: int | None = None) -> list[BoardMessage]:
        """Send a command; return the messages received at once."""
        if seq is None:
            self.seq = seq = (self.seq + 1) % 256
        self.board.receive(encode_command(command, seq))
        return self.wait(0.0)

    def status_of(self, command: Command) -> AckStatus | int:
        """Send a command; return the status of its answer."""
        (answer,) = [message for message in self.send(command) if isinstance(message, Ack)]
        assert answer.command_seq == self.seq
        return answer.status

    def go_to(self, kpa: float, *, seconds: float = 5.0, ramp_kpa_per_s: float = 20.0) -> list[BoardMessage]:
        """Command a pressure that must be accepted, and wait."""
        command = SetPressure(round(1000 * kpa), round(1000 * ramp_kpa_per_s))
        assert self.status_of(command) == AckStatus.DONE
        return self.wait(seconds)

    @property
    def samples(self) -> list[Sample]:
        """All samples so far."""
        return [message for message in self.received if isinstance(message, Sample)]

    @property
    def events(self) -> list[BoardEvent]:
        """All events so far but the boot."""
        return [m for m in self.received if isinstance(m, BoardEvent) and m.code != EventCode.BOOTED]

    @property
    def codes(self) -> list[int]:
        """Codes of `events`."""
        return [event.code for event in self.events]
