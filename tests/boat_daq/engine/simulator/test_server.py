"""The virtual board on real ports: a plain reader loses nothing, a missing one holds nothing up."""

from __future__ import annotations

import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import serial

from boat_daq.engine.simulator.server import BoardServer, BoardSettings, ServedBoard, serve
from protocol.base.errors import DeviceError, RequestError
from protocol.link.framing import FrameReader
from protocol.link.messages import (
    Ack,
    BoardEvent,
    BoardMessage,
    Command,
    EventCode,
    Heartbeat,
    Hello,
    Identify,
    Sample,
    SetPressure,
    Start,
    Stop,
    Vent,
    decode_message,
    encode_command,
)
from protocol.recording import BoardState, SampleFlag
from tests.boat_daq.engine.served_board import serve_in_thread

PATIENCE_S = 20.0
needs_pty = pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals on this system")


class Host:
    """A plain reader: pyserial on a pty, a socket on TCP."""

    def __init__(self, url: str) -> None:
        self.serial = serial.Serial(url, timeout=0.05) if not url.startswith("socket:") else None
        self.socket = None
        if self.serial is None:
            name, _, port = url.removeprefix("socket://").rpartition(":")
            self.socket = socket.create_connection((name, int(port)))
            self.socket.settimeout(0.05)
        self.reader = FrameReader()
        self.seq = 0

    def send(self, command: Command) -> None:
        self.seq += 1
        data = encode_command(command, self.seq)
        if self.serial is not None:
            self.serial.write(data)
        else:
            self.socket.sendall(data)

    def read(self) -> list[BoardMessage]:
        if self.serial is not None:
            data = self.serial.read(max(1, self.serial.in_waiting))
        else:
            try:
                data = self.socket.recv(65_536)
            except TimeoutError:
                data = b""
        return [decode_message(frame, 2) for frame in self.reader.receive(data)]

    def until(self, wanted, patience_s: float = PATIENCE_S) -> list[BoardMessage]:
        """Read until a message is wanted; return all up to its batch."""
        messages, deadline = [], time.monotonic() + patience_s
        while time.monotonic() < deadline:
            messages += self.read()
            if any(wanted(message) for message in messages):
                return messages
        raise AssertionError(f"not reported in {patience_s} s: {messages[-3:]}")

    def hello(self) -> Hello:
        self.send(Identify())
        return next(m for m in self.until(lambda m: isinstance(m, Hello)) if isinstance(m, Hello))

    def close(self) -> None:
        (self.serial or self.socket).close()

    def __enter__(self) -> Host:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def reached(index: int):
    """A test for a sample of that index or a later one."""
    return lambda message: isinstance(message, Sample) and message.index >= index


def indices(messages: list[BoardMessage]) -> np.ndarray:
    """Indices of the samples among messages."""
    return np.array([m.index for m in messages if isinstance(m, Sample)])


def served(port: str, **settings) -> ServedBoard:
    """A board in a thread of this process."""
    return serve_in_thread(BoardSettings(port=port, **settings))


PORTS = [pytest.param("pty", marks=needs_pty), "127.0.0.1:0"]


@pytest.mark.parametrize("port", PORTS)
def test_no_sample_is_lost_at_100x(port):
    """10,000 samples at 100 Hz and 100 times real time, from a process of its own: every index, no damaged frame."""
    with serve(BoardSettings(port=port, speed=100.0)) as board, Host(board.url) as host:
        assert "SIMULATED" in host.hello().board_id
        host.send(Start(100))
        index = indices(host.until(reached(10_000)))
        host.send(Stop())
        np.testing.assert_array_equal(index, np.arange(index.size))
        assert host.reader.crc_errors == host.reader.malformed == host.reader.oversize == 0


@pytest.mark.parametrize("port", PORTS)
def test_ten_thousand_samples_a_second(port):
    """10 kHz at real time, in real time."""
    with serve(BoardSettings(port=port)) as board, Host(board.url) as host:
        host.hello()
        host.send(Start(10_000))
        began = time.monotonic()
        index = indices(host.until(reached(10_000)))
        assert 0.9 < time.monotonic() - began < 5.0
        np.testing.assert_array_equal(index, np.arange(index.size))


@pytest.mark.parametrize("port", PORTS)
def test_board_outlives_its_hosts(port):
    """A host that leaves without a command: the board continues, its watchdog vents, the next host connects."""
    with served(port, speed=50.0) as board:
        with Host(board.url) as host:
            host.hello()
            host.send(Start(100))
            host.send(Heartbeat(5000))
            host.send(SetPressure(40_000, 0))
            held = host.until(lambda m: isinstance(m, Sample) and m.state == BoardState.HOLDING)[-1]
        time.sleep(0.5)  # 25 s of board time, where the computer has the time
        with Host(board.url) as host:
            last = host.until(lambda m: isinstance(m, Sample) and m.state == BoardState.FAULT)[-1]
            assert last.index > held.index
            vented = host.until(lambda m: isinstance(m, Sample) and abs(m.pressure_pa) < 1000)[-1]
            assert vented.state == BoardState.FAULT
            assert host.hello().boot_reason == 0


@needs_pty
def test_a_busy_computer_is_not_a_dead_host():
    """At 100x the board waits for a connected host that stalls for 0.2 s (20 s of board time); for 2 s it does not."""
    with served("pty", speed=100.0) as board, Host(board.url) as host:
        host.hello()
        host.send(Start(100))
        host.send(Heartbeat(5000))
        host.send(SetPressure(40_000, 0))
        host.until(lambda m: isinstance(m, Sample) and m.state == BoardState.HOLDING)
        host.send(Heartbeat(5000))
        time.sleep(0.2)
        host.send(Heartbeat(5000))
        time.sleep(0.05)
        seen = host.read()
        assert any(isinstance(m, Sample) for m in seen)
        assert not any(isinstance(m, BoardEvent) for m in seen)
        time.sleep(2.0)
        shown = host.until(lambda m: isinstance(m, BoardEvent))
        assert shown and next(m for m in shown if isinstance(m, BoardEvent)).code == EventCode.HEARTBEAT_LOST


@needs_pty
def test_a_stall_of_the_board_is_not_counted_as_its_hosts():
    """At 100x the board's program gets no processor for 1.5 s, the host runs again 0.1 s after it: not vented."""
    server, stop = BoardServer(BoardSettings(speed=100.0)), threading.Event()
    thread = threading.Thread(target=server.run, args=(stop.is_set,))
    advance = server.board.advance

    def starved(dt_us: int, *, free_bytes: int | None = None) -> bytes:
        server.board.advance = advance
        time.sleep(1.5)
        return advance(dt_us, free_bytes=free_bytes)

    thread.start()
    with Host(server.url) as host:
        host.hello()
        host.send(Start(100))
        host.send(Heartbeat(5000))
        host.send(SetPressure(40_000, 0))
        host.until(lambda m: isinstance(m, Sample) and m.state == BoardState.HOLDING)
        host.send(Heartbeat(5000))
        server.board.advance = starved
        time.sleep(1.6)
        host.send(Heartbeat(5000))
        seen = host.until(lambda m: isinstance(m, Ack) and m.command_seq == host.seq)
        assert not any(isinstance(m, BoardEvent) for m in seen)
    stop.set()
    thread.join()
    server.close()


@pytest.mark.parametrize("port", PORTS)
def test_bytes_sent_before_closing_are_read(port):
    """A VENT written just before closing the port is executed."""
    with served(port) as board:
        with Host(board.url) as host:
            host.hello()
            host.send(SetPressure(20_000, 0))
            host.send(Start(100))
            host.until(lambda m: isinstance(m, Sample) and m.state == BoardState.RAMPING)
            host.send(Vent())
        time.sleep(0.1)
        with Host(board.url) as host:
            assert host.until(lambda m: isinstance(m, Sample))[0].state == BoardState.VENTED


@pytest.mark.fault(26, how="a host that does not read, on each kind of port", times=2)
@pytest.mark.parametrize("port", PORTS)
def test_host_that_does_not_read_gets_an_exact_gap(port):
    """Beyond the transmit buffer samples are dropped and reported (EVENT 9, flag); the board's clock continues."""
    with served(port, speed=100.0, buffer_bytes=20_000) as board, Host(board.url) as host:
        host.hello()
        host.send(Start(2000))
        time.sleep(1.5)  # 300,000 samples of 30 bytes: more than any socket's own buffer takes
        messages = host.until(lambda m: isinstance(m, BoardEvent) and m.code == EventCode.SAMPLES_DROPPED)
        messages += host.until(lambda m: isinstance(m, Sample))
        samples = [m for m in messages if isinstance(m, Sample)]
        shown = [m.value for m in messages if isinstance(m, BoardEvent)]
        steps = np.diff([s.index for s in samples])
        flagged = [row for row, s in enumerate(samples) if s.flags & SampleFlag.DROPPED_BEFORE]
        assert (steps[steps > 1] - 1).tolist() == shown[: len(flagged)]
        assert (np.flatnonzero(steps > 1) + 1).tolist() == flagged
        assert host.reader.crc_errors == host.reader.malformed == 0


@needs_pty
def test_next_host_does_not_read_the_past():
    """What a host left unread is gone: the next one's first sample is a present one."""
    with served("pty", speed=100.0) as board:
        with Host(board.url) as host:
            host.hello()
            host.send(Start(100))
            time.sleep(0.3)
        time.sleep(0.3)
        with Host(board.url) as host:
            first = next(m for m in host.until(lambda m: isinstance(m, Sample)) if isinstance(m, Sample))
            assert first.index > 1000  # what the first one left unread ends near 400


@needs_pty
def test_an_answer_is_not_queued_behind_seconds_of_samples():
    """At 100x a host that has stalled for 0.5 s is answered behind what the port holds, not 5,000 samples."""
    with served("pty", speed=100.0) as board, Host(board.url) as host:
        host.hello()
        host.send(Start(100))
        host.until(reached(100))
        time.sleep(0.5)
        host.send(Vent())
        until_answer = host.until(lambda m: isinstance(m, Ack) and m.command_seq == host.seq)
        assert np.diff(indices(until_answer)).max() == 1
        assert indices(until_answer).size < 2000


@needs_pty
def test_pty_is_raw_from_the_first_byte():
    """Nothing is echoed and no byte is special: 03, 04, 0D, 0A, 11, 13 come through both ways."""
    special = bytes([3, 4, 13, 10, 17, 19, 26, 28, 127])
    server = BoardServer(BoardSettings())
    try:
        with serial.Serial(server.url, timeout=1) as port:
            assert server._carrier.write(special) == len(special)
            assert port.read(len(special)) == special
            port.write(special)
            time.sleep(0.05)
            assert server._carrier.read() == special
            assert server._carrier.read() == b""
    finally:
        server.close()


@needs_pty
def test_unplug_and_replug(tmp_path: Path):
    """The port goes away under the host and comes back, the link finds it again, the board is the same one."""
    link = tmp_path / "board"
    with served("pty", speed=10.0, faults=("unplug@5:5",), link=str(link)) as board:
        assert board.url == str(link)
        with Host(board.url) as host:
            host.hello()
            host.send(Start(100))
            with pytest.raises((OSError, serial.SerialException)):
                host.until(lambda _: False, 10.0)
        deadline = time.monotonic() + 10.0
        while not link.exists() and time.monotonic() < deadline:
            time.sleep(0.01)
        with Host(board.url) as host:
            first = next(m for m in host.until(lambda m: isinstance(m, Sample)) if isinstance(m, Sample))
            assert 900 < first.index < 3000
    assert not link.is_symlink()


@pytest.mark.parametrize("port", PORTS)
def test_board_that_resets_when_opened(port):
    """HELLO comes without IDENTIFY, after the boot."""
    with served(port, speed=10.0, faults=("reset_on_open@0:1",)) as board, Host(board.url) as host:
        messages = host.until(lambda m: isinstance(m, BoardEvent))
        assert [type(m) for m in messages] == [Hello, BoardEvent]


def test_second_tcp_host_is_turned_away():
    """One host at a time: the second is closed at once, the first is not affected."""
    with served("127.0.0.1:0") as board, Host(board.url) as first:
        first.hello()
        with Host(board.url) as second:
            ready, _, _ = select.select([second.socket], [], [], PATIENCE_S)
            assert ready
            assert second.socket.recv(100) == b""
        assert first.hello().protocol == 1


def test_truth_file(tmp_path: Path):
    """A row for each sample, found by run and index, and the header has SIMULATED."""
    path = tmp_path / "truth.csv"
    with served("127.0.0.1:0", speed=50.0, truth=str(path), unit="SA2") as board, Host(board.url) as host:
        host.hello()
        host.send(SetPressure(50_000, 0))
        host.send(Start(100))
        host.until(reached(1000))
        host.send(Stop())
    head, columns, *rows = path.read_text().splitlines()
    assert "SIMULATED" in head
    assert columns == "run,index,time_s,pressure_kpa,elongation_mm,s1_mv,s2_mv"
    table = np.array([row.split(",") for row in rows], float)
    np.testing.assert_array_equal(table[:, 1], np.arange(len(table)))
    assert len(table) > 1000
    assert table[1000, 3:5] == pytest.approx([50.0, 3.6], abs=0.2)


@pytest.mark.parametrize(
    ("settings", "error", "text"),
    [
        (BoardSettings(port="127.0.0.1"), RequestError, "HOST:PORT"),
        (BoardSettings(port="127.0.0.1:99999"), RequestError, "HOST:PORT"),
        (BoardSettings(port="0.0.0.0:0"), RequestError, "other machines"),
        (BoardSettings(port="127.0.0.1:0", unit="SA8"), RequestError, "SA8"),
        (BoardSettings(port="127.0.0.1:0", faults=("meteor@1",)), RequestError, "meteor"),
        (BoardSettings(port="127.0.0.1:0", speed=0.5), RequestError, "speed"),
        (BoardSettings(port="127.0.0.1:0", speed=1001), RequestError, "speed"),
        (BoardSettings(port="127.0.0.1:0", truth="/no/such/folder/t.csv"), RequestError, "cannot write"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_cannot_be_served_is_refused(settings, error, text):
    """With cause and remedy, before anything is served; from a process of its own, too."""
    with pytest.raises(error, match=text) as refusal:
        BoardServer(settings)
    assert refusal.value.remedy


def test_taken_port_is_refused():
    """The port and the reason are named."""
    with served("127.0.0.1:0") as board, pytest.raises(DeviceError, match="cannot listen"):
        BoardServer(BoardSettings(port=board.url.removeprefix("socket://")))


def test_refusal_from_another_process():
    """`serve` raises the error of its process."""
    with pytest.raises(RequestError, match="SA8"):
        serve(BoardSettings(port="127.0.0.1:0", unit="SA8"))


def answers(host: str, port: int) -> bool:
    """Whether a server accepts connections there."""
    try:
        socket.create_connection((host, port), timeout=1).close()
    except OSError:
        return False
    return True


def test_process_ends_with_its_parent():
    """The board's process ends when its standard input does, as it does when the parent is killed."""
    code = (
        "import sys; from boat_daq.engine.simulator.server import *; "
        "board = serve(BoardSettings(port='127.0.0.1:0')); print(board.url, flush=True); sys.stdin.read()"
    )
    parent = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    url = parent.stdout.readline().strip()
    with Host(url) as host:
        host.hello()
    parent.kill()
    parent.communicate()
    address = url.removeprefix("socket://").rpartition(":")
    deadline = time.monotonic() + PATIENCE_S
    while (alive := answers(address[0], int(address[2]))) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not alive


@pytest.mark.skipif(os.name != "posix", reason="groups of processes")
def test_ctrl_c_while_a_board_starts_reaches_its_parent_alone():
    """The terminal sends it to all; the process of the board, still importing, prints no traceback of its own."""
    code = (
        "import signal; from boat_daq.engine.simulator.server import *; "
        "signal.signal(signal.SIGINT, signal.default_int_handler); print(flush=True); "  # a shell may have it ignored
        "board = serve(BoardSettings(port='127.0.0.1:0')); print(flush=True); sys.stdin.read()"
    )
    command, pipe = [sys.executable, "-c", code], subprocess.PIPE
    parent = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, start_new_session=True)
    parent.stdout.readline()
    time.sleep(0.15)
    os.killpg(parent.pid, signal.SIGINT)
    assert parent.communicate()[1].count("Traceback") == 1
