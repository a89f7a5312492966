"""What a link tells the program: events, counters, and the interface that every kind of link keeps.

`Link` is the one interface; `Connection` (the binary protocol) and `TextConnection` (firmware that prints text) keep
it, so that nothing above knows which of the two it holds. A link is sans-IO: bytes and the time go in, events and
bytes come out; it opens no port, reads no clock and starts no thread.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from protocol.link.messages import AckStatus, BoardEvent, Command, Heartbeat, Hello
from protocol.recording import SampleKind


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Consecutive samples: a read-only array of `recording.sample_dtype`, flags of the host set."""

    array: np.ndarray[Any, np.dtype[np.void]]


@dataclass(frozen=True, slots=True)
class SampleGap:
    """Exactly `lost` samples are missing before the one with `before_index`, which was taken at `time_us`."""

    lost: int
    before_index: int
    time_us: int


@dataclass(frozen=True, slots=True)
class HelloReceived:
    """The board said who it is."""

    hello: Hello


@dataclass(frozen=True, slots=True)
class WrongProtocol:
    """The board speaks another version than this program: name both, and do not START."""

    board_version: int
    program_version: int


@dataclass(frozen=True, slots=True)
class BoardRestarted:
    """The board lost its state: a new segment begins, never spliced to the last.

    `hello` is None where the restart was seen without one (an event "booted", or an index that began again).
    """

    hello: Hello | None


@dataclass(frozen=True, slots=True)
class BoardEventReceived:
    """An event of the board; `time_us` is its time on the unwrapped clock of the samples."""

    event: BoardEvent
    time_us: int


@dataclass(frozen=True, slots=True)
class CommandDone:
    """The board answered. `status` is None for IDENTIFY, which a HELLO answers; a refusal is answered too."""

    command: Command
    seq: int
    status: AckStatus | int | None


@dataclass(frozen=True, slots=True)
class CommandLost:
    """No answer to a command sent three times, or the board restarted before it answered."""

    command: Command
    seq: int


LinkEvent = (
    Samples
    | SampleGap
    | HelloReceived
    | WrongProtocol
    | BoardRestarted
    | BoardEventReceived
    | CommandDone
    | CommandLost
)


@dataclass(frozen=True, slots=True)
class LinkStatistics:
    """Cumulative counters since the link was made."""

    bytes: int = 0  # received
    frames: int = 0  # good ones, whatever their type
    samples: int = 0  # delivered
    lost: int = 0  # samples that the index says were taken and that never came
    crc_errors: int = 0
    malformed: int = 0  # not COBS, impossible length, payload shorter than its type's
    oversize: int = 0  # runs without a delimiter, too long for a frame
    duplicates: int = 0  # samples repeated or out of order, dropped
    unknown: int = 0  # good frames of a type not known, or samples before a HELLO said how many sensors they carry
    resent: int = 0  # commands sent again
    late_answers: int = 0  # answers to nothing that waits: repeated, or after the command was given up


class Link(Protocol):
    """Bytes in, events out; commands to bytes. Every `now_ns` is the host's monotonic clock."""

    can_command: bool  # whether pressure can be commanded
    cannot_command_reason: str  # why not; empty if it can

    @property
    def hello(self) -> Hello | None:
        """The last HELLO, None before the first."""

    @property
    def n_sensors(self) -> int | None:
        """Number of sensors of the samples, None while not known."""

    @property
    def sample_kind(self) -> SampleKind:
        """Which `recording.sample_dtype` the samples have."""

    @property
    def statistics(self) -> LinkStatistics:
        """The counters so far."""

    @property
    def next_deadline_ns(self) -> int | None:
        """When `poll` has something to do at the latest; None if it waits for nothing."""

    def decoder_state(self) -> dict[str, Any]:
        """Return what the decoder remembers of the bytes so far, ready for JSON.

        A link made with it (`decoder_state=`) makes the same samples of the bytes that follow: a recording begun in
        the middle of a stream keeps it, so that it can be derived again from its own bytes alone.
        """

    def receive(self, data: bytes, now_ns: int) -> list[LinkEvent]:
        """Return what the bytes tell, in their order."""

    def receive_chunks(self, chunks: Sequence[tuple[int, bytes]]) -> list[LinkEvent]:
        """Do the same for many chunks (now_ns, data) at once; only the cutting into `Samples` is coarser."""

    def send(self, command: Command, now_ns: int) -> bytes:
        """Return the bytes that carry a command; empty where another waits for its answer: then `poll` gives them."""

    def feed(self, command: Heartbeat, now_ns: int) -> bytes:
        """Return bytes that feed the board's watchdog at once, `command` or the repeat of what waits for its answer.

        For a virtual board that runs faster than its host: in 250 ms of ours, its watchdog's time may be over.
        """

    def poll(self, now_ns: int, heard_ns: int | None = None) -> tuple[list[LinkEvent], bytes]:
        """Return the commands that were lost, and the bytes of those to repeat or whose turn has come.

        What had come by `heard_ns` (`now_ns`, where left out) has been received: nothing is lost that was due later.
        """
