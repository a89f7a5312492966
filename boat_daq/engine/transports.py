"""Ports: bytes in, bytes out, and every way in which a port fails turned into one kind of error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

DEFAULT_BAUD = 115_200


class Transport(Protocol):
    """An open port, owned by one reading thread; `write` may be called from another."""

    @property
    def description(self) -> str:
        """The port as a reader knows it."""
        ...

    @property
    def can_write(self) -> bool:
        """False for a replay: nobody is there to be commanded."""
        ...

    def read(self) -> bytes:
        """Return what is there, waiting up to 50 ms for the first byte; b"" when nothing came.

        Raises
        ------
        DeviceError : the port is gone.
        """
        ...

    def write(self, data: bytes) -> None:
        """Send all of `data`; raises DeviceError when the port is gone or takes nothing for 250 ms."""
        ...

    def close(self) -> None:
        """Close; may be called twice."""
        ...


@dataclass(frozen=True, slots=True)
class PortInfo:
    """A port of this machine, as the system describes it."""

    port: str
    description: str
    hardware_id: str
    serial_number: str | None


def list_ports() -> list[PortInfo]:
    """Return the serial ports the system knows; pseudo-terminals and TCP are not among them."""
    raise NotImplementedError


def open_transport(url: str, *, baud: int = DEFAULT_BAUD, allow_remote: bool = False) -> Transport:
    """Open a port.

    Parameters
    ----------
    url : a serial device or pseudo-terminal ("COM3", "/dev/ttyACM0"), "socket://host:port", or
        "replay:FILE.boat[@SPEED]" (SPEED a factor, default 1; "max" for as fast as it goes).
    baud : of a serial device; 8N1.
    allow_remote : let "socket://" leave this machine.

    Raises
    ------
    DeviceError : no such port (names those present), busy, no permission, refused, gone.
    """
    raise NotImplementedError
