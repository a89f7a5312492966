"""Open a port by its URL: a serial device, a pseudo-terminal, TCP, or the replay of a recording."""

from __future__ import annotations

from typing import TypeAlias

from boat_daq.engine.link.ports import DEFAULT_BAUD, SerialTransport, SocketTransport
from boat_daq.engine.link.replay import ReplayTransport


def open_transport(url: str, *, baud: int = DEFAULT_BAUD, allow_remote: bool = False) -> Transport:
    """Open a port.

    Parameters
    ----------
    url : a serial device or pseudo-terminal ("COM3", "/dev/ttyACM0"), "socket://host:port", or
        "replay:FILE.boat[@SPEED]" (SPEED a factor, default 1; "max" for as fast as it goes).
    baud : baud rate of a serial device, 8N1.
    allow_remote : let "socket://" leave this machine; the connection is neither encrypted nor authenticated.
    """
    if url.startswith("socket://"):
        return SocketTransport(url, allow_remote=allow_remote)
    if url.startswith("replay:"):
        return ReplayTransport.from_url(url)
    return SerialTransport(url, baud)


Transport: TypeAlias = SerialTransport | SocketTransport | ReplayTransport
