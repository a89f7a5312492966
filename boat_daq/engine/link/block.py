"""A block: bytes of one read or write and the events decoded from them, passed from the reading thread to the sinks.

Rules: a block is a value, shared by all sinks and changed by none. Every byte that came or went is in exactly one
block, so the blocks of a session, in order, are the session. What the engine itself detects (port gone, silence, a sink
that failed) comes the same way, as an event in a block, so that one stream holds everything in order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from protocol.base.errors import DeviceError
from protocol.link.events import LinkEvent


@dataclass(frozen=True, slots=True)
class PortLost:
    """The port is gone. Unplugged, or closed at the other end. No block follows."""

    error: DeviceError


@dataclass(frozen=True, slots=True)
class PortSilent:
    """The port is open and nothing came for `silent_s`; once for each silence."""

    silent_s: float


@dataclass(frozen=True, slots=True)
class SinkFailed:
    """A sink raised; it is called again with the next block."""

    sink: str
    error: Exception


EngineEvent: TypeAlias = PortLost | PortSilent | SinkFailed


@dataclass(frozen=True, slots=True)
class Block:
    """One read (or one write) of the port."""

    host_ns: int  # host monotonic clock at the arrival, or at the sending
    raw: bytes
    sent: bool = False  # False for bytes from the board, True for bytes to it
    events: tuple[LinkEvent | EngineEvent, ...] = ()


Sink: TypeAlias = Callable[[Block], None]
