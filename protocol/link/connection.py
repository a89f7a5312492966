"""The host's side of the binary protocol: bytes in, events out; commands in, bytes out (protocol/SPEC.md).

`framing` finds and checks frames, `messages` decodes them, `sample_stream` counts losses, `PendingCommands` repeats
commands; this module joins them. Rules of this file:

- Samples are converted to arrays a chunk at a time, everything else frame by frame. Consecutive samples form one
  `Samples`, split only by another message between them.
- A HELLO without an IDENTIFY, or a "booted", is a restart if the board had state to lose: a command answered or a
  sample received since the last HELLO. So neither a board that resets when its port is opened nor a repeated answer
  counts as a restart.
- With a board of another protocol version only IDENTIFY, VENT and STOP are sent.

Commands and their answers: numbering, repetition, and loss (protocol/SPEC.md, "Commands").

A command without an answer is repeated with the same seq after 250 ms, three transmissions in all; 250 ms after the
third it is lost. Rules of this file:

- In turn (as in a session): one command at a time, because a board that remembers only the last type and seq would act
  twice on a repeat with another command before it. Commands sent meanwhile wait; the repeats feed the board's watchdog.
  Otherwise every command is transmitted at once.
- VENT never waits. A command that it overtook is repeated after its answer where acting twice is harmless, and not at
  all where it is not (START, CLEAR_FAULT); an earlier SET_PRESSURE is never transmitted after it.
- An answer belongs to the command with its type *and* seq. Any other answer is counted and changes nothing.
- A repetition never undoes a later command: a command is superseded by one of the same type with other values,
  SET_PRESSURE by VENT, START and STOP by each other. It is not repeated, so the newer one need not wait; its answer is
  still reported, its loss only if the board has answered nothing at all since it was sent.
- After a restart of the board only VENT and IDENTIFY of the earlier commands are transmitted.
- A stall of this program is not a silent board: no command is given up before everything that had arrived by its
  deadline was read, nor by a late caller, since the answer may be in the backlog. Three more windows are granted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import compress
from typing import Any

import numpy as np

from protocol.base.arrays import IntArray
from protocol.base.errors import RemoteError
from protocol.link import events as link
from protocol.link import messages
from protocol.link.events import LinkEvent, LinkStatistics
from protocol.link.framing import Frame, FrameReader
from protocol.link.messages import PROTOCOL_VERSION, Ack, Command, Identify, Start, Stop, Vent
from protocol.link.sample_stream import Rows, SampleStream, implausible
from protocol.recording import ExtraChannel, SampleFlag, SampleKind, sample_dtype, session_channels

RETRY_NS = 250_000_000
LATE_NS = 100_000_000  # twice as long as a read waits: so late a caller was stalled itself
ATTEMPTS = 3
_SUPERSEDES: dict[type[Command], type[Command]] = {Vent: messages.SetPressure, Start: Stop, Stop: Start}
_ONCE_ONLY = (Start, messages.ClearFault)  # repeated, they would restart the stream or clear a newer fault


@dataclass(slots=True)
class _Pending:
    command: Command
    seq: int
    frame: bytes
    first_ns: int
    deadline_ns: int
    attempts: int = 1
    superseded: bool = False
    overtaken: bool = False  # by a VENT, and not to be repeated
    stalls: int = 0  # deadlines that this program missed, or had not read the port by

    @property
    def live(self) -> bool:
        """Whether it may still be repeated."""
        return not (self.superseded or self.overtaken)

    def give_up(self) -> None:
        """Await its answer only, for as long as its repeats would have taken."""
        self.deadline_ns = self.first_ns + ATTEMPTS * RETRY_NS


class PendingCommands:
    """The commands that await their answer, or their turn.

    Parameters
    ----------
    in_turn : whether a command waits until the one before it is answered or lost.
    """

    def __init__(self, *, in_turn: bool = False) -> None:
        self._in_turn = in_turn
        self._seq = 0
        self._pending: dict[tuple[int, int], _Pending] = {}
        self._queue: list[Command] = []
        self._last_answer_ns: int | None = None
        self.hellos_due = 0  # IDENTIFYs sent whose HELLO may still arrive
        self._identified_ns = 0  # when the last of them was sent
        self.resent = 0
        self.late_answers = 0

    @property
    def next_deadline_ns(self) -> int | None:
        """The earliest deadline, 0 if the next command can be sent, None while nothing is pending."""
        if self._queue and not self._in_flight:
            return 0
        return min((pending.deadline_ns for pending in self._due_in_turn()), default=None)

    def send(self, command: Command, now_ns: int) -> bytes:
        """Number a command and return its frame; empty where it has to wait for its turn (`poll`)."""
        self._supersede(command)
        if isinstance(command, Vent):
            self._overtake()
            return self._put(command, now_ns)
        if not self._in_turn or (self._in_flight is None and not self._queue):
            return self._put(command, now_ns)
        messages.encode_command(command, 0)  # an impossible value is refused now
        if command not in self._queue:
            self._queue.append(command)
        return b""

    def feed(self, command: messages.Heartbeat, now_ns: int) -> bytes:
        """Return a frame to send now: the heartbeat, or the early repeat of a pending command."""
        waiting = self._in_flight
        if not self._in_turn or waiting is None or isinstance(waiting.command, Identify):
            return self.send(command, now_ns)
        self.resent += 1
        return waiting.frame

    def _supersede(self, command: Command) -> None:
        """Withdraw the commands that a newer one contradicts."""

        def contradicted(other: Command) -> bool:
            same_type = type(other) is type(command) and other != command
            return same_type or _SUPERSEDES.get(type(command)) is type(other)

        self._queue = [other for other in self._queue if not contradicted(other)]
        for pending in self._pending.values():
            if contradicted(pending.command):
                pending.superseded = True
                pending.give_up()

    def _overtake(self) -> None:
        """Repeat nothing after a VENT that must not be done twice."""
        for pending in self._pending.values():
            if isinstance(pending.command, _ONCE_ONLY):
                pending.overtaken = True
                pending.give_up()

    def _put(self, command: Command, now_ns: int) -> bytes:
        """Return the frame of the next command; IDENTIFY begins with a lone 00, which flushes the line."""
        seq = self._seq
        frame = messages.encode_command(command, seq)
        self._seq = (seq + 1) & 0xFF
        if isinstance(command, Identify):
            frame = b"\0" + frame
            self._expect_hello(now_ns)
        key = (messages.COMMAND_TYPES[type(command)], seq)
        self._pending[key] = _Pending(command, seq, frame, now_ns, now_ns + RETRY_NS)
        return frame

    @property
    def _in_flight(self) -> _Pending | None:
        """The command that may be repeated, so that no other may precede it; the newest, if VENT overtook one."""
        return next((pending for pending in reversed(self._pending.values()) if pending.live), None)

    def _due_in_turn(self) -> list[_Pending]:
        """Return the commands with a deadline: while a VENT is pending, those it overtook have none."""
        pending = list(self._pending.values())
        venting = self._in_turn and any(isinstance(one.command, Vent) for one in pending)
        return [one for one in pending if not venting or not one.live or isinstance(one.command, Vent)]

    def acknowledge(self, ack: Ack, now_ns: int) -> list[LinkEvent]:
        """Return the command that an ACK answers; an ACK that fits none is counted."""
        pending = self._pending.pop((ack.command_type, ack.command_seq), None)
        if pending is None:
            self.late_answers += 1
            return []
        self._last_answer_ns = now_ns
        if pending.first_ns > self._identified_ns:
            self.hellos_due = 0  # answers come in order: no HELLO is pending any more
        return [link.CommandDone(pending.command, pending.seq, ack.status)]

    def identified(self, now_ns: int) -> list[LinkEvent]:
        """Return the IDENTIFYs that a HELLO answers."""
        self.hellos_due = max(0, self.hellos_due - 1)
        keys = [key for key, pending in self._pending.items() if isinstance(pending.command, Identify)]
        if keys:
            self._last_answer_ns = now_ns
        answered = [self._pending.pop(key) for key in keys]
        return [link.CommandDone(pending.command, pending.seq, None) for pending in answered]

    def board_restarted(self) -> list[LinkEvent]:
        """Give up the commands that the board forgot, all but VENT and IDENTIFY."""
        self.keep_waiting(Identify)
        keys = [key for key, pending in self._pending.items() if not isinstance(pending.command, Vent | Identify)]
        forgotten = [self._pending.pop(key) for key in keys]
        return [link.CommandLost(pending.command, pending.seq) for pending in forgotten]

    def keep_waiting(self, *kinds: type[Command]) -> None:
        """Drop the queued commands that are none of these."""
        self._queue = [command for command in self._queue if isinstance(command, kinds)]

    def poll(self, now_ns: int, heard_ns: int | None = None) -> tuple[list[LinkEvent], bytes]:
        """Return the lost commands, and the frames to send: repeats, and the next command; see `Link`."""
        events: list[LinkEvent] = []
        frames = b""
        heard_ns = now_ns if heard_ns is None else heard_ns
        for pending in self._due_in_turn():
            if now_ns < pending.deadline_ns:
                continue
            if pending.attempts < ATTEMPTS and pending.live:
                frames += self._repeat(pending, now_ns)
                continue
            late_ns = now_ns - pending.deadline_ns
            if heard_ns < pending.deadline_ns and late_ns <= LATE_NS:
                continue
            heard_since = self._last_answer_ns is not None and self._last_answer_ns >= pending.first_ns
            missed = not (pending.superseded and heard_since)
            if missed and late_ns > LATE_NS and pending.stalls < ATTEMPTS:
                pending.stalls += 1
                pending.deadline_ns = now_ns + RETRY_NS
                continue
            del self._pending[messages.COMMAND_TYPES[type(pending.command)], pending.seq]
            if missed:
                events.append(link.CommandLost(pending.command, pending.seq))
        if self._queue and self._in_flight is None:
            frames += self._put(self._queue.pop(0), now_ns)
        return events, frames

    def _repeat(self, pending: _Pending, now_ns: int) -> bytes:
        pending.attempts += 1
        pending.deadline_ns = now_ns + RETRY_NS
        self.resent += 1
        if isinstance(pending.command, Identify):
            self._expect_hello(now_ns)
        return pending.frame

    def _expect_hello(self, now_ns: int) -> None:
        self.hellos_due += 1
        self._identified_ns = now_ns


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

    Parameters
    ----------
    n_sensors : number of sensors of a board whose HELLO is not among the bytes (a recording begun later); else it is
        taken from the HELLO, and samples before it are counted as unknown.
    in_turn : a command waits until the one before it is answered, and is then returned by `poll`; VENT never waits.
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
        """The counters so far."""
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
        """Return the bytes of a command; empty where it waits for its turn and is returned by `poll`.

        Raises
        ------
        RequestError : a value that its field cannot hold.
        RemoteError : the board uses another protocol version, and the command is not IDENTIFY, VENT or STOP.
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
        """Return the events in the bytes, in their order; samples carry `now_ns` as their `host_ns`.

        Damaged, unknown and repeated frames are counted in `statistics`, never raised.
        """
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
            return [link.WrongProtocol(hello.protocol, PROTOCOL_VERSION), *self._pending_commands.identified(now_ns)]
        restarted = self._has_state and not self._pending_commands.hellos_due
        self.hello, self._wrong_version = hello, None
        self.n_sensors, self._adc_bits, self.channels = hello.n_sensors, hello.adc_bits, hello.channels
        self._stream.stream_may_restart()
        if not restarted:
            return [link.HelloReceived(hello), *self._pending_commands.identified(now_ns)]
        self._has_state = False
        forgotten = self._pending_commands.board_restarted()
        return [link.BoardRestarted(hello), *forgotten, *self._pending_commands.identified(now_ns)]

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
        received = link.BoardEventReceived(event, self._stream.unwrapped_time(event.time_us))
        if event.code != messages.EventCode.BOOTED:
            return [received]
        self._stream.stream_may_restart()
        if not self._has_state:
            return [received]
        self._has_state = False
        return [link.BoardRestarted(None), *self._pending_commands.board_restarted(), received]
