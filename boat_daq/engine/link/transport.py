"""What the reading thread requires of a port: the `Transport` protocol."""

from __future__ import annotations

from typing import Protocol

READ_WAIT_S = 0.05
WRITE_WAIT_S = 0.25


class Transport(Protocol):
    """An open port, owned by one reading thread; `write` may be called from another."""

    @property
    def description(self) -> str:
        """The port's name for people."""

    @property
    def can_write(self) -> bool:
        """False for a replay, which takes no commands."""

    def read(self) -> bytes:
        """Return what is there, waiting up to 50 ms for the first byte.

        B"" when nothing came.

        Raises
        ------
        DeviceError : the port is gone.
        """

    @property
    def unread(self) -> bool:
        """Whether there is more than `read` has returned.

        Raises
        ------
        DeviceError : the port is gone.
        """

    def write(self, data: bytes) -> None:
        """Send all of `data`.

        Raises
        ------
        DeviceError : the port is gone, or takes nothing for 250 ms.
        """

    def close(self) -> None:
        """Close; may be called twice."""
