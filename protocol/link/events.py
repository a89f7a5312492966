"""What a link reports: events, counters, and the interface of every kind of link.

`Connection` (binary protocol) and `TextConnection` (firmware that prints text) implement `Link`. A link is sans-IO:
bytes and the time go in, events and bytes come out; it opens no port, reads no clock and starts no thread.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from protocol.link.messages import AckStatus, BoardEvent, Command, Heartbeat, Hello
from protocol.recording import ExtraChannel, SampleKind


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
    """The board identified itself."""

    hello: Hello


@dataclass(frozen=True, slots=True)
class WrongProtocol:
    """The board uses another protocol version than this program: report both, and do not START."""

    board_version: int
    program_version: int


@dataclass(frozen=True, slots=True)
class BoardRestarted:
    """The board lost its state: a new segment begins. `hello` is None if seen by "booted" or a new index alone."""

    hello: Hello | None


@dataclass(frozen=True, slots=True)
class ClockWentBack:
    """The board's clock is `by_us` behind what the index and the sampling period say: a new segment begins."""

    by_us: int


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
    | ClockWentBack
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
    lost: int = 0  # samples taken, by their index, that never arrived
    crc_errors: int = 0
    malformed: int = 0  # not COBS, impossible length, payload shorter than its type's
    oversize: int = 0  # runs without a delimiter, too long for a frame
    duplicates: int = 0  # samples repeated or out of order, dropped
    unknown: int = 0  # good frames of a type not known, or samples before a HELLO gave their number of sensors
    resent: int = 0  # commands sent again
    late_answers: int = 0  # answers to no pending command: repeated, or after the command was given up


class Link(Protocol):
    """Bytes in, events out; commands to bytes. Every `now_ns` is the host's monotonic clock."""

    can_command: bool  # whether pressure can be commanded
    cannot_command_reason: str  # why not; empty if it can

    @property
    def hello(self) -> Hello | None:
        """The last HELLO, None before the first."""

    @property
    def n_sensors(self) -> int | None:
        """Number of sensors of the samples, None while unknown."""

    @property
    def sample_kind(self) -> SampleKind:
        """Which `recording.sample_dtype` the samples have."""

    @property
    def channels(self) -> tuple[ExtraChannel, ...]:
        """The extra channels of the samples."""

    @property
    def statistics(self) -> LinkStatistics:
        """The counters so far."""

    @property
    def next_deadline_ns(self) -> int | None:
        """Latest time for the next `poll`; None while nothing is pending."""

    def decoder_state(self) -> dict[str, Any]:
        """Return the decoder's memory of the bytes so far, ready for JSON.

        A link made with it (`decoder_state=`) derives the same samples from the bytes that follow. A recording begun in
        the middle of a stream stores it, so that its own bytes suffice.
        """

    def receive(self, data: bytes, now_ns: int) -> list[LinkEvent]:
        """Return the events in the bytes, in their order."""

    def receive_chunks(self, chunks: Sequence[tuple[int, bytes]]) -> list[LinkEvent]:
        """Return the same for many chunks (now_ns, data) at once; only the division into `Samples` is coarser."""

    def send(self, command: Command, now_ns: int) -> bytes:
        """Return the bytes of a command; empty while another awaits its answer: then `poll` returns them."""

    def feed(self, command: Heartbeat, now_ns: int) -> bytes:
        """Return bytes that feed the watchdog at once: `command`, or the repeat of a pending one.

        For a virtual board faster than real time: its watchdog may expire within 250 ms of the host's.
        """

    def poll(self, now_ns: int, heard_ns: int | None = None) -> tuple[list[LinkEvent], bytes]:
        """Return the lost commands, and the bytes to send next; all that arrived by `heard_ns` has been received."""
