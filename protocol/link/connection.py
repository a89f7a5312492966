"""The host's side of the binary protocol: bytes in, events out; commands in, bytes out (protocol/SPEC.md).

`framing` finds and checks frames, `messages` decodes them, `sample_stream` counts losses, `pending_commands` repeats
commands. Consecutive samples form one `Samples`, split only by another message between them. A HELLO without an
IDENTIFY, or a "booted", is a restart if the board had state to lose: a command answered or a sample received since the
last HELLO. So neither a board that resets when its port is opened nor a repeated answer counts as a restart. A board of
another protocol version receives only IDENTIFY, VENT and STOP.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import compress
from typing import Any

import numpy as np

from protocol.base.arrays import IntArray
from protocol.base.errors import RemoteError
from protocol.link import messages
from protocol.link.events import (
    BoardEventReceived,
    BoardRestarted,
    HelloReceived,
    LinkEvent,
    LinkStatistics,
    WrongProtocol,
)
from protocol.link.framing import Frame, FrameReader
from protocol.link.messages import PROTOCOL_VERSION, Ack, Command, Identify, Stop, Vent
from protocol.link.pending_commands import PendingCommands
from protocol.link.sample_stream import Rows, SampleStream, implausible
from protocol.recording import ExtraChannel, SampleFlag, SampleKind, sample_dtype, session_channels

_TO_ANY_VERSION = (Identify, Vent, Stop)
_SAMPLE = int(messages.MessageType.SAMPLE)  # a plain integer: compared for every frame
_HEAD = 16  # bytes of a SAMPLE body before the counts: type, seq, index, time, pressure, state, flags


@lru_cache(maxsize=64)
def _wire_dtype(n_sensors: int, n_channels: int, itemsize: int) -> np.dtype[np.void]:
    """Return the record of a SAMPLE body of `itemsize` bytes."""
    return np.dtype(
        {
            "names": ["index", "time_us", "pressure_pa", "state", "flags", "counts", "channel"],
            "formats": ["<u4", "<u4", "<i4", "u1", "u1", ("<u2", (n_sensors, 2)), ("<f4", (n_channels,))],
            "offsets": [2, 6, 10, 14, 15, _HEAD, _HEAD + 4 * n_sensors],
            "itemsize": itemsize,
        }
    )


class Connection:
    """The binary protocol, host side: a `protocol.link.events.Link`.

    `n_sensors`: number of sensors if the bytes hold no HELLO (a recording begun later); else the HELLO gives it, and
    samples before it are counted as unknown. `in_turn`: a command waits until the one before it is answered, and is
    then returned by `poll`; VENT never waits.
    """

    can_command = True
    cannot_command_reason = ""
    sample_kind: SampleKind = "counts"

    def __init__(
        self,
        *,
        n_sensors: int | None = None,
        adc_bits: int = 16,
        channels: tuple[ExtraChannel, ...] = (),
        decoder_state: dict[str, Any] | None = None,
        in_turn: bool = False,
    ) -> None:
        self.n_sensors = n_sensors  # None before the HELLO
        self.channels = channels
        self.hello: messages.Hello | None = None  # the last one of this protocol version
        self._adc_bits = adc_bits
        self._reader = FrameReader()
        self._stream = SampleStream()
        self._pending_commands = PendingCommands(in_turn=in_turn)
        self._wrong_version: int | None = None
        self._has_state = False  # whether a restart of the board would lose anything
        self._unknown = 0
        if decoder_state is not None:
            self.n_sensors, self._adc_bits = decoder_state["n_sensors"], decoder_state["adc_bits"]
            self.channels = session_channels(decoder_state)
            self._reader.restore(decoder_state["frames"])
            self._stream.restore(decoder_state["samples"], self._dtype)

    def decoder_state(self) -> dict[str, Any]:
        """Return the decoder's memory of the bytes so far, ready for JSON; see `Link`."""
        return {
            "n_sensors": self.n_sensors,
            "adc_bits": self._adc_bits,
            "channels": [list(channel) for channel in self.channels],
            "frames": self._reader.state(),
            "samples": self._stream.state(),
        }

    @property
    def _dtype(self) -> np.dtype[np.void]:
        return sample_dtype(self.n_sensors or 1, "counts", len(self.channels))

    @property
    def statistics(self) -> LinkStatistics:
        return LinkStatistics(
            **self._reader.counters,
            **self._stream.counters,
            unknown=self._unknown,
            resent=self._pending_commands.resent,
            late_answers=self._pending_commands.late_answers,
        )

    @property
    def next_deadline_ns(self) -> int | None:
        """Latest time for the next `poll`; None while nothing is pending."""
        return self._pending_commands.next_deadline_ns

    def send(self, command: Command, now_ns: int) -> bytes:
        """Return the bytes of a command; empty until its turn (see `poll`). RequestError: a value does not fit.

        RemoteError: the board uses another protocol version, and the command is not IDENTIFY, VENT or STOP.
        """
        if self._wrong_version is not None and not isinstance(command, _TO_ANY_VERSION):
            cause = f"the board uses protocol version {self._wrong_version}, this program version {PROTOCOL_VERSION}"
            raise RemoteError(cause, "update the board's firmware or this program, so that both use the same version")
        return self._pending_commands.send(command, now_ns)

    def feed(self, command: messages.Heartbeat, now_ns: int) -> bytes:
        """Return bytes that feed a fast virtual board's watchdog at once; see `Link`."""
        return self._pending_commands.feed(command, now_ns)

    def poll(self, now_ns: int, heard_ns: int | None = None) -> tuple[list[LinkEvent], bytes]:
        """Return the commands that were lost, and the bytes of those to repeat or send next; see `Link`."""
        return self._pending_commands.poll(now_ns, heard_ns)

    def receive(self, data: bytes, now_ns: int) -> list[LinkEvent]:
        """Return the events in the bytes; `now_ns` is the samples' `host_ns`. Damaged frames are counted."""
        bodies = self._reader.receive_bodies(data)
        return self._take(bodies, np.full(len(bodies), now_ns, np.int64))

    def receive_chunks(self, chunks: Sequence[tuple[int, bytes]]) -> list[LinkEvent]:
        """Return the same for many chunks (now_ns, data) at once; only the division into `Samples` is coarser."""
        ends: list[int] = []
        bodies = self._reader.receive_bodies(b"".join([data for _, data in chunks]), ends)
        chunk_ends = np.cumsum([len(data) for _, data in chunks])
        times = np.array([now_ns for now_ns, _ in chunks], np.int64)
        return self._take(bodies, times[np.searchsorted(chunk_ends, ends)])

    def _take(self, bodies: list[bytes], host_ns: IntArray) -> list[LinkEvent]:
        events: list[LinkEvent] = []
        run = 0
        others = [at for at, body in enumerate(bodies) if body[0] != _SAMPLE]
        for at in [*others, len(bodies)]:
            if at > run:
                events += self._take_samples(bodies[run:at], host_ns[run:at])
            if at < len(bodies):
                events += self._take_message(bodies[at], int(host_ns[at]))
            run = at + 1
        return events

    def _take_samples(self, bodies: list[bytes], host_ns: IntArray) -> list[LinkEvent]:
        if self.n_sensors is None:
            self._unknown += len(bodies)
            return []
        needed = _HEAD + 4 * (self.n_sensors + len(self.channels))
        lengths = set(map(len, bodies))
        if len(lengths) > 1 or min(lengths) < needed + 4:  # lengths differ: cut to the known head, drop what is short
            long_enough = [len(body) >= needed + 4 for body in bodies]
            self._reader.malformed += long_enough.count(False)
            bodies = [body[:needed] for body in compress(bodies, long_enough)]
            host_ns = host_ns[long_enough]
        if not bodies:
            return []
        self._has_state = True
        return self._stream.accept(self._to_rows(bodies, host_ns))

    def _to_rows(self, bodies: list[bytes], host_ns: IntArray) -> Rows:
        assert self.n_sensors is not None
        wire: Rows = np.frombuffer(b"".join(bodies), _wire_dtype(self.n_sensors, len(self.channels), len(bodies[0])))
        rows = np.empty(len(bodies), self._dtype)
        for name in ("index", "time_us", "pressure_pa", "state", "flags"):
            rows[name] = wire[name]
        rows["host_ns"] = host_ns
        rows["lit"] = wire["counts"][:, :, 0]
        rows["dark"] = wire["counts"][:, :, 1]
        if self.channels:
            rows["channel"] = wire["channel"]
        absurd = implausible(rows, self._adc_bits)
        if absurd.any():
            rows["flags"][absurd] |= np.uint16(SampleFlag.IMPLAUSIBLE)
        return rows

    def _take_message(self, body: bytes, now_ns: int) -> list[LinkEvent]:
        try:
            message: Any = messages.decode_message(Frame(body[0], body[1], body[2:-4]), self.n_sensors or 1)
        except RemoteError:
            self._reader.malformed += 1
            return []
        match message:
            case messages.Hello():
                return self._take_hello(message, now_ns)
            case Ack():
                return self._take_ack(message, now_ns)
            case messages.BoardEvent():
                return self._take_event(message)
        self._unknown += 1
        return []

    def _take_hello(self, hello: messages.Hello, now_ns: int) -> list[LinkEvent]:
        if hello.protocol != PROTOCOL_VERSION:
            self._wrong_version, self.n_sensors = hello.protocol, None
            self._pending_commands.keep_waiting(*_TO_ANY_VERSION)
            return [WrongProtocol(hello.protocol, PROTOCOL_VERSION), *self._pending_commands.identified(now_ns)]
        restarted = self._has_state and not self._pending_commands.hellos_due
        self.hello, self._wrong_version = hello, None
        self.n_sensors, self._adc_bits, self.channels = hello.n_sensors, hello.adc_bits, hello.channels
        self._stream.stream_may_restart()
        if not restarted:
            return [HelloReceived(hello), *self._pending_commands.identified(now_ns)]
        self._has_state = False
        forgotten = self._pending_commands.board_restarted()
        return [BoardRestarted(hello), *forgotten, *self._pending_commands.identified(now_ns)]

    def _take_ack(self, ack: Ack, now_ns: int) -> list[LinkEvent]:
        if ack.status == messages.AckStatus.DONE:
            if ack.command_type == messages.MessageType.START:
                self._stream.stream_started()
            elif ack.command_type == messages.MessageType.STOP:
                self._stream.stream_may_restart()
        events = self._pending_commands.acknowledge(ack, now_ns)
        self._has_state |= bool(events)
        return events

    def _take_event(self, event: messages.BoardEvent) -> list[LinkEvent]:
        received = BoardEventReceived(event, self._stream.unwrapped_time(event.time_us))
        if event.code != messages.EventCode.BOOTED:
            return [received]
        self._stream.stream_may_restart()
        if not self._has_state:
            return [received]
        self._has_state = False
        return [BoardRestarted(None), *self._pending_commands.board_restarted(), received]
