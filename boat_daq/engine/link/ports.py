"""Ports: serial devices, pseudo-terminals and TCP; every failure of one is a `DeviceError`.

Rules: a read waits up to 50 ms for the first byte and then takes what is there, so a stop flag is seen in time and
nothing spins. `unread` is whether there is more than `read` has returned. `write` sends all or raises where nothing is
taken for 250 ms; it may be called from another thread than the one that reads. A port is closed by the thread that
reads it: closing under a blocking read raises `TypeError` in pyserial. An unplugged port raises any of four types
there, one of which (`termios.error`) is not even an `OSError`; they all become `DeviceError` here. TCP is read from the
socket itself: pyserial's own `socket://` reports at most one byte to be waiting, and one call a byte is too slow for
any board.
"""

from __future__ import annotations

import errno
import os
import re
import select
import socket
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias, TypeVar
from urllib.parse import urlsplit

import serial
from serial.tools import list_ports as system_ports

from protocol.base.errors import DeviceError

READ_WAIT_S = 0.05  # of every kind of port
DEFAULT_BAUD = 115_200
WRITE_WAIT_S = 0.25
_RECEIVE_BYTES = 65_536
_T = TypeVar("_T")
_WINDOWS_BUFFER_BYTES = 65_536  # the driver's own 4 KB is 0.1 s at 1,000 samples/s
if sys.platform == "win32":
    _PORT_ERRORS: tuple[type[Exception], ...] = (OSError, TypeError, AttributeError, serial.SerialException)
else:
    import termios

    _PORT_ERRORS = (OSError, TypeError, AttributeError, serial.SerialException, termios.error)


@dataclass(frozen=True, slots=True)
class PortInfo:
    """A port of this machine, as the system describes it.

    `usb_serial` is the serial number of its USB device, empty where it has none; `interface` is that of the port, where
    one device has several.
    """

    port: str
    description: str
    usb_serial: str = ""
    interface: str = ""


def list_ports() -> list[PortInfo]:
    """Return the serial ports of this machine, as the system lists them; none is opened.

    Pseudo-terminals and TCP are not among them.
    """
    found = [
        PortInfo(
            p.device, p.description.removeprefix("n/a"), p.serial_number or "", (p.location or "").partition(":")[2]
        )
        for p in system_ports.comports()
    ]
    return sorted(found, key=lambda port: port.port)


def usb_port(url: str) -> PortInfo | None:
    """Return the port of a USB device with a serial number that is at `url`, a device or a link to it; else None."""
    names = {url, os.path.realpath(url), url.replace("/dev/tty.", "/dev/cu.")}  # macOS lists the latter only
    return next((port for port in list_ports() if port.usb_serial and port.port in names), None)


def find_port(wanted: PortInfo) -> str | None:
    """Return the port at which a USB device is now, by its serial number; None where none or several have it."""
    identity = (wanted.usb_serial, wanted.interface)
    found = [port.port for port in list_ports() if (port.usb_serial, port.interface) == identity]
    return found[0] if len(found) == 1 else None


class SerialTransport:
    """A serial device or a pseudo-terminal, through pyserial. Exclusive, so that a second program is refused."""

    def __init__(self, port: str, baud: int = DEFAULT_BAUD) -> None:
        self.description = port
        try:
            # not `serial_for_url`, which would open other kinds of port (rfc2217://, spy://)
            self._port = serial.Serial(
                port, baud, timeout=READ_WAIT_S, write_timeout=WRITE_WAIT_S, exclusive=True, xonxoff=False
            )
            if sys.platform == "win32":
                self._port.set_buffer_size(rx_size=_WINDOWS_BUFFER_BYTES)
        except (ValueError, *_PORT_ERRORS) as error:
            raise open_error(port, error) from error

    def read(self) -> bytes:
        """Return what is there, waiting up to 50 ms for the first byte."""
        return _or_gone(self.description, self._receive)

    @property
    def unread(self) -> bool:
        """Whether there is more than `read` has returned."""
        return _or_gone(self.description, lambda: bool(self._port.in_waiting))

    def write(self, data: bytes) -> None:
        _or_gone(self.description, lambda: _write_all(self._port, data))

    def _receive(self) -> bytes:
        """Wait for a byte, and take what came with it. A block of one byte costs as much as a long one."""
        if sys.platform == "win32":
            first = bytes(self._port.read(1))
            return first + bytes(self._port.read(self._port.in_waiting)) if first else first
        return _read_some(self._port)

    def close(self) -> None:
        """Close; errors of a port that is gone already are ignored."""
        try:
            self._port.close()
        except _PORT_ERRORS:
            return


def _read_some(port: serial.Serial) -> bytes:
    """Return what is there on POSIX, waiting for the first byte. Two calls of the system where pyserial makes five."""
    if not select.select([port.fileno()], [], [], READ_WAIT_S)[0]:
        return b""
    try:
        data = os.read(port.fileno(), _RECEIVE_BYTES)
    except BlockingIOError:  # called ready, and there is nothing yet
        return b""
    if not data:  # ready, and nothing to read: the device has left
        raise serial.SerialException("the device was removed")
    return data


def _write_all(port: serial.Serial, data: bytes) -> None:
    """Write until nothing is left, or the port takes nothing for `WRITE_WAIT_S`.

    pyserial's own `write` on POSIX checks its timeout once more behind the last byte, and takes a stall of this program
    there for a port that takes nothing.
    """
    if sys.platform == "win32":
        port.write(data)
        return
    while data:
        try:
            data = data[os.write(port.fileno(), data) :]
        except BlockingIOError:
            if not select.select([], [port.fileno()], [], WRITE_WAIT_S)[1]:
                raise serial.SerialTimeoutException("Write timeout") from None


class SocketTransport:
    """A TCP port: a board behind a network adapter, or a virtual board."""

    def __init__(self, url: str, *, allow_remote: bool = False) -> None:
        self.description = url
        host, port = _socket_address(url)
        if not allow_remote and not _is_loopback(host):
            cause = f"{host} is another machine, and the link is neither encrypted nor authenticated"
            remedy = "Allow remote ports in the settings if the network is yours."
            raise DeviceError(cause, remedy, command="boat-daq config set allow_remote=true")
        try:
            self._socket = socket.create_connection((host, port), timeout=2.0)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._socket.settimeout(WRITE_WAIT_S)
        except OSError as error:
            remedy = "Check host and port, and that the board's program runs."
            raise DeviceError(f"no answer at {url}: {error}", remedy) from error

    def read(self) -> bytes:
        """Return what is there, waiting up to 50 ms for the first byte."""
        return _or_gone(self.description, self._receive)

    @property
    def unread(self) -> bool:
        """Whether there is more than `read` has returned."""
        return _or_gone(self.description, lambda: bool(select.select([self._socket], [], [], 0)[0]))

    def write(self, data: bytes) -> None:
        _or_gone(self.description, lambda: self._socket.sendall(data))

    def close(self) -> None:
        self._socket.close()

    def _receive(self) -> bytes:
        if not select.select([self._socket], [], [], READ_WAIT_S)[0]:
            return b""
        data = self._socket.recv(_RECEIVE_BYTES)
        if not data:
            raise ConnectionResetError("the other end closed the connection")
        return data


def _or_gone(port: str, action: Callable[[], _T]) -> _T:
    """Return the result of an action on an open port. Whatever it raises means that the port is gone."""
    try:
        return action()
    except serial.SerialTimeoutException as error:
        raise DeviceError(f"{port} accepts no data", "Check that the board runs; reconnect it.") from error
    except TimeoutError as error:
        raise DeviceError(f"{port} accepts no data", "Check that the board's program runs.") from error
    except _PORT_ERRORS as error:
        why = f" ({error.strerror})" if isinstance(error, OSError) and error.strerror else ""  # none of pyserial's own
        raise DeviceError(f"{port} was disconnected{why}", "Check the cable and reconnect it.") from error


def open_error(port: str, error: Exception) -> DeviceError:
    """Return cause and remedy of a port that does not open.

    pyserial on Windows reports the system's error only within a text, so that one is searched.
    """
    written = re.search(r"(?:Errno |\()(\d+)", str(error))  # by pyserial, into its message
    number = getattr(error, "errno", None) or (int(written[1]) if written else None)
    text = str(error).lower()
    if number in {errno.EBUSY, errno.EAGAIN} or "exclusively lock" in text or "resource busy" in text:
        return DeviceError(f"{port} is in use by another program", "Close that program (a terminal, another boat-daq).")
    if number in {errno.EACCES, errno.EPERM} or "permission" in text or "access is denied" in text:
        remedy = "Close the other program that has it open, or check its driver."
        if sys.platform.startswith("linux"):
            remedy = "Add yourself to its group (dialout) and log in again, or install a udev rule."
        return DeviceError(f"no permission to open {port}", remedy)
    if number in {errno.ENOENT, errno.ENODEV, errno.ENXIO} or "filenotfound" in text:
        if address := re.search(r"(?<!/dev/)\b[\w.-]+:\d+$", port):
            return DeviceError(f"there is no port {port}", f"Write an address as socket://{address[0]}.")
        present = ", ".join(p.port for p in list_ports())
        remedy = f"Choose one that is present: {present}." if present else "Plug in the board; no port is present."
        return DeviceError(f"there is no port {port}", remedy)
    if number in {errno.ENOTTY, errno.EINVAL, errno.EISDIR}:
        return DeviceError(f"{port} is not a serial port", "Choose a port of the list.", command="boat-daq ports")
    reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return DeviceError(f"{port} cannot be opened: {reason}", "Choose a port of the list.", command="boat-daq ports")


def _socket_address(url: str) -> tuple[str, int]:
    parts = urlsplit(url)
    try:
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port:
        raise DeviceError(f"{url} is not an address", "Write socket://HOST:PORT, such as socket://127.0.0.1:7777.")
    return host, port


def _is_loopback(host: str) -> bool:
    try:
        addresses = {info[4][0] for info in socket.getaddrinfo(host, None)}
    except OSError:
        return False
    return all(str(address).startswith("127.") or address == "::1" for address in addresses)


Transport: TypeAlias = SerialTransport | SocketTransport


def open_transport(url: str, *, baud: int = DEFAULT_BAUD, allow_remote: bool = False) -> Transport:
    """Open a port.

    `url`: a serial device or pseudo-terminal ("COM3", "/dev/ttyACM0"), or "socket://host:port". `baud`: baud rate of a
    serial device, 8N1. `allow_remote`: let "socket://" leave this machine; the connection is neither encrypted nor
    authenticated.
    """
    if url.startswith("socket://"):
        return SocketTransport(url, allow_remote=allow_remote)
    return SerialTransport(url, baud)
