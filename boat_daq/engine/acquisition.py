"""The one reading thread: transport.read -> link.receive -> sinks, in that order, and nothing else.

Rules: no disk, no screen, no sleep on this thread. Every sink sees every block in the same order. A sink that raises
is reported in the next block and called again; reading never stops for it. The link is used under one lock, so
`send` may be called from any thread and writes at once: a vent does not wait for the reader.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from boat_daq.engine.blocks import Sink
from boat_daq.engine.transports import Transport
from protocol.connection import Link
from protocol.messages import Command


class Acquisition:
    """Reads `transport` through `link` on its own thread and hands blocks to sinks.

    Parameters
    ----------
    transport : an open port.
    link : decoder and encoder, binary or text.
    silence_s : after so long without a byte a `PortSilent` event is told.
    clock_ns : host monotonic clock.
    """

    def __init__(
        self,
        transport: Transport,
        link: Link,
        *,
        silence_s: float = 1.0,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        raise NotImplementedError

    def add_sink(self, sink: Sink) -> None:
        """Hand every later block to `sink` too, after the sinks that are there."""
        raise NotImplementedError

    def remove_sink(self, sink: Sink) -> None:
        """Hand no later block to `sink`; returns when a block on its way has been handed over."""
        raise NotImplementedError

    def switch_link(self, link: Link, *, add_sink: Sink | None = None) -> None:
        """Use `link` from the next byte on, and add a sink at the same instant.

        A recording begins with a fresh link, so that what its file holds can be decoded again from its first byte.
        """
        raise NotImplementedError

    def send(self, command: Command) -> int:
        """Encode and write a command now; return its sequence number.

        Raises
        ------
        DeviceError : the port is gone or does not take bytes.
        LocalError : the link cannot say this command.
        """
        raise NotImplementedError

    def start(self) -> None:
        """Begin to read."""
        raise NotImplementedError

    def stop(self) -> None:
        """Stop reading and close the port; returns when both are done. May be called twice."""
        raise NotImplementedError

    @property
    def alive(self) -> bool:
        """Whether the thread reads."""
        raise NotImplementedError
