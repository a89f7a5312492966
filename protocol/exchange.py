"""Commands and their answers: numbering, repetition, and the verdict "lost" (protocol/SPEC.md, "Commands").

A command without an answer goes out again with the same seq after 250 ms, three times in all; 250 ms after the third
it is lost. Rules of this file:

- Any number may be in flight; nothing waits for anything, VENT least of all.
- An answer belongs to the command with its type *and* seq. Any other answer is counted and changes nothing.
- A repetition never undoes what was asked later: a command is superseded by one of the same type with other values,
  SET_PRESSURE by VENT, START and STOP by each other. It is not sent again; its answer is still reported, its silence
  only if the board has answered nothing at all since it was sent.
- After a restart of the board nothing from before goes out again but VENT and IDENTIFY.
"""

from __future__ import annotations

from dataclasses import dataclass

from protocol.link import CommandDone, CommandLost, LinkEvent
from protocol.messages import (
    COMMAND_TYPES,
    Ack,
    Command,
    Identify,
    SetPressure,
    Start,
    Stop,
    Vent,
    encode_command,
)

RETRY_NS = 250_000_000
ATTEMPTS = 3
_SUPERSEDES: dict[type[Command], type[Command]] = {Vent: SetPressure, Start: Stop, Stop: Start}


@dataclass(slots=True)
class _Pending:
    command: Command
    seq: int
    frame: bytes
    first_ns: int
    deadline_ns: int
    attempts: int = 1
    superseded: bool = False


class Exchange:
    """The commands that wait for an answer."""

    def __init__(self) -> None:
        self._seq = 0
        self._pending: dict[tuple[int, int], _Pending] = {}
        self._last_answer_ns: int | None = None
        self._hellos_due = 0  # IDENTIFYs sent whose HELLO may still come
        self._identified_ns = 0  # when the last of them went out
        self.resent = 0
        self.late_answers = 0

    @property
    def next_deadline_ns(self) -> int | None:
        """The earliest deadline, None if nothing waits."""
        return min((pending.deadline_ns for pending in self._pending.values()), default=None)

    @property
    def hello_expected(self) -> bool:
        """Whether the next HELLO can be the answer to an IDENTIFY."""
        return self._hellos_due > 0

    def send(self, command: Command, now_ns: int) -> bytes:
        """Number a command and return its frame; IDENTIFY begins with a lone 00, which flushes the line."""
        seq = self._seq
        frame = encode_command(command, seq)
        self._seq = (seq + 1) & 0xFF
        if isinstance(command, Identify):
            frame = b"\0" + frame
            self._expect_hello(now_ns)
        for other in self._pending.values():
            same_type = type(other.command) is type(command) and other.command != command
            if same_type or _SUPERSEDES.get(type(command)) is type(other.command):
                other.superseded = True
                other.deadline_ns = other.first_ns + ATTEMPTS * RETRY_NS
        self._pending[COMMAND_TYPES[type(command)], seq] = _Pending(command, seq, frame, now_ns, now_ns + RETRY_NS)
        return frame

    def acknowledge(self, ack: Ack, now_ns: int) -> list[LinkEvent]:
        """Return the command that an ACK answers; an ACK that fits none is counted."""
        pending = self._pending.pop((ack.command_type, ack.command_seq), None)
        if pending is None:
            self.late_answers += 1
            return []
        self._last_answer_ns = now_ns
        if pending.first_ns > self._identified_ns:
            self._hellos_due = 0  # answers come in order: no HELLO is on its way any more
        return [CommandDone(pending.command, pending.seq, ack.status)]

    def identified(self, now_ns: int) -> list[LinkEvent]:
        """Return the IDENTIFYs that a HELLO answers."""
        self._hellos_due = max(0, self._hellos_due - 1)
        keys = [key for key, pending in self._pending.items() if isinstance(pending.command, Identify)]
        if keys:
            self._last_answer_ns = now_ns
        answered = [self._pending.pop(key) for key in keys]
        return [CommandDone(pending.command, pending.seq, None) for pending in answered]

    def board_restarted(self) -> list[LinkEvent]:
        """Give up what the board forgot; VENT and IDENTIFY go on."""
        keys = [key for key, pending in self._pending.items() if not isinstance(pending.command, Vent | Identify)]
        forgotten = [self._pending.pop(key) for key in keys]
        return [CommandLost(pending.command, pending.seq) for pending in forgotten]

    def poll(self, now_ns: int) -> tuple[list[LinkEvent], bytes]:
        """Return what is lost at `now_ns`, and the frames to send again."""
        events: list[LinkEvent] = []
        again = b""
        for key, pending in list(self._pending.items()):
            if now_ns < pending.deadline_ns:
                continue
            if pending.attempts < ATTEMPTS and not pending.superseded:
                pending.attempts += 1
                pending.deadline_ns = now_ns + RETRY_NS
                self.resent += 1
                if isinstance(pending.command, Identify):
                    self._expect_hello(now_ns)
                again += pending.frame
                continue
            del self._pending[key]
            heard_since = self._last_answer_ns is not None and self._last_answer_ns >= pending.first_ns
            if not (pending.superseded and heard_since):
                events.append(CommandLost(pending.command, pending.seq))
        return events, again

    def _expect_hello(self, now_ns: int) -> None:
        self._hellos_due += 1
        self._identified_ns = now_ns
