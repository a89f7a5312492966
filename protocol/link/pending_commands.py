"""Commands and their answers: numbering, repetition, and loss (protocol/SPEC.md, "Commands").

A command without an answer is repeated with the same seq after 250 ms, three transmissions in all; 250 ms after the
third it is lost. In turn (as in a session) one command is open at a time, because a board that remembers only the last
type and seq would act twice on a repeat with another command before it; the repeats feed its watchdog. Rules:

- VENT never waits. A command that it overtook is repeated after its answer where acting twice is harmless, and not at
  all where it is not (START, CLEAR_FAULT); an earlier SET_PRESSURE is never transmitted after it.
- An answer belongs to the command with its type *and* seq. Any other answer is counted and changes nothing.
- A command superseded by a later one (same type with other values; SET_PRESSURE by VENT; START and STOP by each other)
  is not repeated. Its answer is still reported, its loss only if the board has answered nothing since it was sent.
- After a restart of the board only VENT and IDENTIFY of the earlier commands are transmitted.
- A stall of this program is not a silent board: before a command is given up, everything that arrived by its deadline
  has been read; a late caller gets three more windows, since the answer may be in the backlog.
"""

from __future__ import annotations

from dataclasses import dataclass

from protocol.link import messages
from protocol.link.events import CommandDone, CommandLost, LinkEvent
from protocol.link.messages import Ack, Command, Identify, Start, Stop, Vent

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
    """The commands that await their answer or, with `in_turn`, the answer to the one before."""

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
        return [CommandDone(pending.command, pending.seq, ack.status)]

    def identified(self, now_ns: int) -> list[LinkEvent]:
        """Return the IDENTIFYs that a HELLO answers."""
        self.hellos_due = max(0, self.hellos_due - 1)
        keys = [key for key, pending in self._pending.items() if isinstance(pending.command, Identify)]
        if keys:
            self._last_answer_ns = now_ns
        answered = [self._pending.pop(key) for key in keys]
        return [CommandDone(pending.command, pending.seq, None) for pending in answered]

    def board_restarted(self) -> list[LinkEvent]:
        """Give up the commands that the board forgot, all but VENT and IDENTIFY."""
        self.keep_waiting(Identify)
        keys = [key for key, pending in self._pending.items() if not isinstance(pending.command, Vent | Identify)]
        forgotten = [self._pending.pop(key) for key in keys]
        return [CommandLost(pending.command, pending.seq) for pending in forgotten]

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
                events.append(CommandLost(pending.command, pending.seq))
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
