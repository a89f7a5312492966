"""Ports: bytes unchanged, and every failure one kind of error with a reason and a remedy."""

from __future__ import annotations

import errno
import io
import os
import pty
import socket
import termios
import threading
import time
import tty
from collections.abc import Iterator

import pytest
import serial

from boat_daq.engine.link import ports
from boat_daq.engine.link.ports import SerialTransport, list_ports, open_error, open_transport
from protocol.base.errors import DeviceError

EVERY_BYTE = bytes(range(256)) * 4


@pytest.fixture
def terminal() -> Iterator[tuple[io.FileIO, str]]:
    """A pseudo-terminal's master and the name of its slave."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    name = os.ttyname(slave)
    os.close(slave)
    with os.fdopen(master, "r+b", buffering=0) as file:
        yield file, name


def read_all(transport, n: int, timeout_s: float = 2.0) -> bytes:
    data, end = b"", time.monotonic() + timeout_s
    while len(data) < n and time.monotonic() < end:
        data += transport.read()
    return data


def test_a_pseudo_terminal_carries_every_byte_both_ways(terminal):
    """NUL, ETX and newlines arrive as they were sent, in both directions."""
    master, name = terminal
    port = open_transport(name)
    master.write(EVERY_BYTE)
    assert read_all(port, len(EVERY_BYTE)) == EVERY_BYTE
    port.write(EVERY_BYTE)
    assert master.read(4096) == EVERY_BYTE
    port.close()


def test_a_read_without_data_returns_soon_and_empty(terminal):
    """A stop flag is seen in time: 50 ms, not for ever and not at once."""
    port = open_transport(terminal[1])
    began = time.monotonic()
    assert port.read() == b""
    assert 0.02 < time.monotonic() - began < 0.5
    port.close()


def test_a_frame_that_comes_while_the_reader_waits_is_one_read(terminal):
    """Its first byte used to come alone: two blocks for each sample, and twice the reader's work."""
    master, name = terminal
    port, frame = open_transport(name), bytes(range(40))
    writer = threading.Timer(0.02, master.write, (frame,))
    writer.start()
    reads = [port.read() for _ in range(3)]
    writer.join()
    assert [data for data in reads if data] == [frame]
    port.close()


def test_a_second_opener_gets_port_in_use(terminal):
    """Two programs on one port would each receive a part of the bytes."""
    port = open_transport(terminal[1])
    with pytest.raises(DeviceError, match="in use") as refusal:
        open_transport(terminal[1])
    assert refusal.value.remedy
    port.close()


def test_a_missing_port_names_those_present():
    """The remedy of a wrong name is the list of right ones."""
    with pytest.raises(DeviceError, match="no port /dev/ttyNOWHERE") as refusal:
        open_transport("/dev/ttyNOWHERE")
    present = [port.port for port in list_ports()]
    assert all(port in refusal.value.remedy for port in present)
    assert ("no port is present" in refusal.value.remedy) is (not present)


@pytest.mark.parametrize("port", ["localhost:7000", "tcp://localhost:7000"])
def test_an_address_that_is_no_port_is_written_right(port: str) -> None:
    """The remedy is the address as it is to be written."""
    assert open_error(port, FileNotFoundError(2, "")).remedy == "Write an address as socket://localhost:7000."
    assert "socket" not in open_error("/dev/ttyUSB0:9600", FileNotFoundError(2, "")).remedy


def test_a_file_is_not_a_port(tmp_path):
    """What opens but is no terminal is refused by what it is."""
    file = tmp_path / "file"
    file.write_bytes(b"x")
    with pytest.raises(DeviceError, match="is not a serial port"):
        open_transport(str(file))


@pytest.mark.fault(13, how="busy, forbidden and absent, as the system reports them", times=6)
@pytest.mark.parametrize(
    ("error", "text"),
    [
        (serial.SerialException(errno.EACCES, "could not open port x: Permission denied"), "no permission"),
        (serial.SerialException("could not open 'COM3': PermissionError(13, 'Access is denied.')"), "no permission"),
        (serial.SerialException(errno.EBUSY, "could not open port"), "in use"),
        (serial.SerialException("could not open 'COM9': FileNotFoundError(2, 'cannot find it')"), "no port"),
        (OSError(errno.EIO, "Input/output error"), "cannot be opened: Input/output error"),
        (ValueError("Not a valid baudrate: 0"), "cannot be opened: Not a valid baudrate"),
    ],
)  # fmt: skip
def test_the_reasons_a_port_does_not_open_are_distinguished(error, text):
    """Busy, forbidden, absent: each has its own cause and remedy, whatever type pyserial raises."""
    shown = open_error("x", error)
    assert text in shown.cause
    assert shown.remedy


@pytest.mark.fault(11, how="the other end of a pseudo-terminal closed", times=1)
def test_an_unplugged_port_is_detected(terminal):
    """The other end gone: a DeviceError within two seconds, not an end of data without an error."""
    master, name = terminal
    port = open_transport(name)
    master.close()
    began = time.monotonic()
    with pytest.raises(DeviceError, match="was disconnected"):
        read_all(port, 1)
    assert time.monotonic() - began < 2.0
    port.close()


@pytest.mark.fault(11, how="each type of error that an unplug raises in pyserial", times=4)
@pytest.mark.parametrize(
    "error",
    [OSError(5, "I/O"), termios.error(5, "I/O"), TypeError("NoneType"), serial.SerialException("readiness to read")],
)
def test_every_type_that_pyserial_raises_becomes_one(terminal, monkeypatch, error):
    """An unplug raises four types in pyserial, one of them no OSError."""
    port = SerialTransport(terminal[1])

    def fail(*_):
        raise error

    monkeypatch.setattr(ports, "_read_some", fail)
    monkeypatch.setattr(ports, "_write_all", fail)
    with pytest.raises(DeviceError, match="was disconnected"):
        port.read()
    with pytest.raises(DeviceError, match="was disconnected"):
        port.write(b"x")
    port.close()


def test_a_port_that_is_ready_and_has_nothing_is_not_gone(terminal, monkeypatch):
    """A system may call a port ready by mistake: that is no byte, and no unplug."""
    port = open_transport(terminal[1])

    def nothing_yet(*_):
        raise BlockingIOError(errno.EAGAIN, "nothing yet")

    with monkeypatch.context() as system:
        system.setattr(os, "read", nothing_yet)
        terminal[0].write(b"x")
        assert port.read() == b""
    assert port.read() == b"x"
    port.close()


def test_a_stall_behind_a_frame_is_no_port_that_takes_nothing(terminal, monkeypatch):
    """This program stalls for longer than a write may take, just after its bytes have left: they have left."""
    master, name = terminal
    port, plain = open_transport(name), os.write

    def stalled(fd, data):
        written = plain(fd, data)
        time.sleep(0.3)
        return written

    monkeypatch.setattr(os, "write", stalled)
    port.write(b"command")
    assert master.read(7) == b"command"
    port.close()


def test_a_port_that_takes_nothing_does_not_hang_the_writer(terminal):
    """A board that has stopped reading costs a quarter of a second, then an error."""
    port = open_transport(terminal[1])
    began = time.monotonic()
    with pytest.raises(DeviceError, match="accepts no data"):
        for _ in range(100):
            port.write(bytes(4096))
    assert time.monotonic() - began < 3.0
    port.close()


def test_a_socket_carries_a_megabyte_in_few_reads():
    """TCP is read in large pieces: pyserial's own socket:// would take a million calls."""
    server = socket.create_server(("127.0.0.1", 0))
    data = EVERY_BYTE * 1024

    def serve():
        connection, _ = server.accept()
        connection.sendall(data)
        assert connection.recv(16) == b"command"
        connection.close()

    thread = threading.Thread(target=serve)
    thread.start()
    port = open_transport(f"socket://127.0.0.1:{server.getsockname()[1]}")
    got, reads = b"", 0
    while len(got) < len(data):
        got += port.read()
        reads += 1
    assert got == data
    assert reads < len(data) / 1000
    port.write(b"command")
    with pytest.raises(DeviceError, match="was disconnected"):
        read_all(port, 1)
    thread.join()
    port.close()
    server.close()


@pytest.mark.parametrize(
    ("url", "text"),
    [
        ("socket://192.0.2.1:7777", "another machine"),
        ("socket://127.0.0.1:1", "no answer"),
        ("socket://localhost", "not an address"),
        ("socket://localhost:port", "not an address"),
    ],
)
def test_socket_addresses_are_checked(url, text):
    """No connection leaves this machine unless allowed, and a wrong address is refused."""
    with pytest.raises(DeviceError, match=text):
        open_transport(url)


@pytest.mark.parametrize(("addresses", "near"), [(["127.0.0.1", "::1"], True), (["127.0.0.1", "192.0.2.7"], False)])
def test_a_name_of_this_computer_and_another_is_another(monkeypatch, addresses, near):
    """A name that resolves to a loopback address among others may lead elsewhere: it is refused like a remote one."""
    found = [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (address, 0)) for address in addresses]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_: found)
    assert ports._is_loopback("board.lab") is near
