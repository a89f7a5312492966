"""What a virtual board is served on: a pseudo-terminal or a TCP port of this machine. One host at a time on either.

The pseudo-terminal is set raw before a byte is sent: else what the board sends is echoed back to it, and a data byte 03
flushes the queue. Its other end is not held open here: as long as the master is, its settings stay, and a hang-up shows
that the host has closed; what it left unread is discarded then, so that the next host does not read old data. On TCP a
second host is turned away at once rather than left waiting.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import time
from pathlib import Path
from typing import TypeAlias

from boat_daq.errors import DeviceError, OperatorError

_READ_BYTES = 65_536
_LOOPBACK = ("127.0.0.1", "::1", "localhost")


class PtyCarrier:
    """A pseudo-terminal.

    With `link`, a symbolic link that finds it again after a replug.
    """

    def __init__(self, link: Path | None = None) -> None:
        if sys.platform == "win32":
            raise OperatorError("there are no pseudo-terminals on this system", "use --tcp 127.0.0.1:0")
        if link is not None and link.exists() and not link.is_symlink():
            raise OperatorError(f"{link} exists and is not a link", "choose another path for the link")
        self.url = ""
        self._link = link
        self._master = -1
        self._poll = select.poll()

    def plug(self) -> None:
        """Open the port; `url` may differ from before."""
        master, slave = os.openpty()
        self._tty = os.ttyname(slave)
        os.close(slave)
        self._master = master
        os.set_blocking(master, False)
        self._poll = select.poll()
        self._poll.register(master, select.POLLIN)
        self.closed_by_host()  # raw, and empty
        self.url = self._tty
        if self._link is not None:
            fresh = self._link.with_name(self._link.name + ".new")
            fresh.unlink(missing_ok=True)
            fresh.symlink_to(self._tty)
            fresh.replace(self._link)
            self.url = str(self._link)

    def closed_by_host(self) -> None:
        """Discard what the host that has left did not read."""
        import termios
        import tty

        slave = os.open(self._tty, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            tty.setraw(slave)
            termios.tcflush(slave, termios.TCIFLUSH)
        finally:
            os.close(slave)

    def unplug(self) -> None:
        """Take the port away."""
        if self._master >= 0:
            os.close(self._master)
        self._master = -1
        if self._link is not None:
            self._link.unlink(missing_ok=True)

    @property
    def connected(self) -> bool:
        """Whether a host has the port open."""
        return self._master >= 0 and not any(event & select.POLLHUP for _, event in self._poll.poll(0))

    def wait(self, timeout_s: float, *, to_write: bool) -> None:
        """Sleep until something can be read (or written), or the time is over."""
        if not self.connected:  # a hang-up would wake every wait at once
            time.sleep(timeout_s)
            return
        self._poll.modify(self._master, select.POLLIN | (select.POLLOUT if to_write else 0))
        self._poll.poll(timeout_s * 1000)

    def read(self) -> bytes:
        """Return what the host has sent."""
        # EIO: no host has it open. What was written before closing, a VENT perhaps, is still read first.
        with contextlib.suppress(OSError):
            return os.read(self._master, _READ_BYTES)
        return b""

    def write(self, data: bytes | bytearray) -> int:
        """Send what can be sent now and return how many bytes that were."""
        with contextlib.suppress(OSError):
            return os.write(self._master, data)
        return 0


class TcpCarrier:
    """A TCP port; loopback only, unless remote hosts are allowed by name. Its methods are those of `PtyCarrier`."""

    def __init__(self, address: str, *, allow_remote: bool = False) -> None:
        host, colon, port = address.rpartition(":")
        if not colon or not port.isdecimal() or int(port) > 65535:
            raise OperatorError(f"{address!r} is not HOST:PORT", "use 127.0.0.1:0 for any free port")
        self._host = host.strip("[]") or "127.0.0.1"
        if self._host not in _LOOPBACK and not allow_remote:
            remedy = "use 127.0.0.1, or add --allow-remote: the connection is neither encrypted nor authenticated"
            raise OperatorError(f"{self._host} would open the board to other machines", remedy)
        self._port = int(port)
        self.url = ""
        self._listener: socket.socket | None = None
        self._client: socket.socket | None = None

    def plug(self) -> None:
        family = socket.AF_INET6 if ":" in self._host else socket.AF_INET
        listener = socket.socket(family, socket.SOCK_STREAM)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((self._host, self._port))
            listener.listen()
        except OSError as error:
            listener.close()
            remedy = "use another port, or 0 for any free one"
            raise DeviceError(f"cannot listen on {self._host}:{self._port}: {error.strerror}", remedy) from None
        listener.setblocking(False)
        self._listener = listener
        self._port = listener.getsockname()[1]
        shown = f"[{self._host}]" if ":" in self._host else self._host
        self.url = f"socket://{shown}:{self._port}"

    def unplug(self) -> None:
        for end in (self._client, self._listener):
            if end is not None:
                end.close()
        self._client = self._listener = None

    @property
    def connected(self) -> bool:
        return self._client is not None

    def closed_by_host(self) -> None:
        return  # a socket leaves nothing behind

    def wait(self, timeout_s: float, *, to_write: bool) -> None:
        readers = [end for end in (self._listener, self._client) if end is not None]
        if not readers:
            time.sleep(timeout_s)
            return
        writers = [self._client] if to_write and self._client is not None else []
        ready, _, _ = select.select(readers, writers, [], timeout_s)
        if self._listener in ready:
            self._accept()

    def _accept(self) -> None:
        assert self._listener is not None
        with contextlib.suppress(OSError):  # gone again already
            client, _ = self._listener.accept()
            if self._client is not None:
                client.close()
                return
            client.setblocking(False)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._client = client

    def read(self) -> bytes:
        if self._client is None:
            return b""
        try:
            data = self._client.recv(_READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._drop_client()
        return data

    def write(self, data: bytes | bytearray) -> int:
        if self._client is None:
            return 0
        try:
            return self._client.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self._drop_client()
            return 0

    def _drop_client(self) -> None:
        assert self._client is not None
        self._client.close()
        self._client = None


Carrier: TypeAlias = PtyCarrier | TcpCarrier
