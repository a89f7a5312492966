"""Serves a virtual board on a port, at 1 to 1000 times real time. The only place where the board meets a clock.

The board's time follows the monotonic clock times the speed, in steps of a few milliseconds of wall time. The host's
bytes are handed over before each step, so that a stalled machine does not starve the board's watchdog while the feed
lies in the buffer; for the same reason a fast board does not make up for a stall: its time then simply went slower. At
1x it does, so that its clock keeps to the wall's. Nor does a fast board count milliseconds of a busy computer as
seconds without a host: just before its watchdog would vent, it waits up to a second of wall time for one that is
connected; the time in which this program itself did not run is not counted: the host may have stalled with it. Nor does
it run ahead of what that host has read: an answer would come behind seconds of samples, and count as none; while bytes
wait for the port its time stops, again for up to a second without a byte taken. Longer, a host that does not read does
not delay the board: beyond the transmit buffer samples are dropped, counted and reported, as the contract requires.
Without a host the bytes are discarded.

What a virtual board is served on: a pseudo-terminal or a TCP port of this machine. One host at a time on either.

The pseudo-terminal is set raw before a byte is sent: else what the board sends is echoed back to it, and a data byte 03
flushes the queue. Its other end is not held open here: as long as the master is, its settings stay, and a hang-up shows
that the host has closed; what it left unread is discarded then, so that the next host does not read old data. On TCP a
second host is turned away at once rather than left waiting.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, TypeAlias

import numpy as np

from boat_daq.engine.simulator.virtual_camera import MjpegStream, VideoFile, VirtualCamera, parse_camera_fault, scene_of
from boat_daq.own_packages import start_module
from protocol.base.errors import BoatDaqError, ChoiceError, DeviceError, RequestError
from protocol.simulator.board import VirtualBoard
from protocol.simulator.faults import parse_fault

_READ_BYTES = 65_536
_LOOPBACK = ("127.0.0.1", "::1", "localhost")


class PtyCarrier:
    """A pseudo-terminal. With `link`, a symbolic link that finds it again after a replug."""

    def __init__(self, link: Path | None = None) -> None:
        if sys.platform == "win32":
            raise RequestError("there are no pseudo-terminals on this system", "use --tcp 127.0.0.1:0")
        if link is not None and link.exists() and not link.is_symlink():
            raise RequestError(f"{link} exists and is not a link", "choose another path for the link")
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
            raise ChoiceError(f"{address!r} is not HOST:PORT", "use 127.0.0.1:0 for any free port")
        self._host = host.strip("[]") or "127.0.0.1"
        if self._host not in _LOOPBACK and not allow_remote:
            remedy = "use 127.0.0.1, or add --allow-remote: the connection is neither encrypted nor authenticated"
            raise RequestError(f"{self._host} would open the board to other machines", remedy)
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


_SPEEDS = (1.0, 1000.0)
_STEP_S = 0.005
_FAST_STEP_S = 0.002  # from 20x on, where the host waits for more board time in each step
_LONGEST_STEP_S = 0.02
_GRACE_S = 1.0  # of looking: how long a fast board waits for a connected host that sends nothing, or takes nothing


@dataclass(frozen=True, slots=True)
class BoardSettings:
    """What to serve, and how."""

    port: str = "pty"  # "pty", or "HOST:PORT" for TCP (port 0 = any free one)
    speed: float = 1.0  # board time over wall time, 1 to 1000
    unit: str = "SA1"
    seed: int = 0
    faults: tuple[str, ...] = ()  # as NAME@SECONDS[:VALUE]
    truth: str | None = None  # CSV file for the noise-free values beside each sample, or None
    link: str | None = None  # symbolic link to the pseudo-terminal, which finds it again after a replug
    buffer_bytes: int = 1 << 20  # transmit buffer; what does not fit into it is dropped
    allow_remote: bool = False  # let TCP listen on other addresses than loopback
    video: str | None = None  # file for the pictures of a virtual camera, or None
    mjpeg: int | None = None  # port for them on this computer (0 = any free one), or None
    scene: tuple[str, ...] = ()  # fields of the camera's `CameraScene` as KEY=VALUE
    camera_faults: tuple[str, ...] = ()  # as NAME@SECONDS[:DURATION]


class BoardServer:
    """A board on a port. `run` serves until it is stopped; `close` removes the port."""

    def __init__(self, settings: BoardSettings) -> None:
        """Open the port; `url` is what a host connects to."""
        if not _SPEEDS[0] <= settings.speed <= _SPEEDS[1]:
            raise ChoiceError(f"a speed of {settings.speed:g} is not possible", "use 1 to 1000")
        self._speed = settings.speed
        self._buffer_bytes = settings.buffer_bytes
        faults = [parse_fault(text) for text in settings.faults]
        log_truth = settings.truth is not None
        filmed = settings.video is not None or settings.mjpeg is not None
        self.board = VirtualBoard(
            settings.unit, seed=settings.seed, faults=faults, log_truth=log_truth, log_elongation=filmed
        )
        if settings.port == "pty":
            self._carrier: Carrier = PtyCarrier(Path(settings.link) if settings.link else None)
        else:
            self._carrier = TcpCarrier(settings.port, allow_remote=settings.allow_remote)
        self._truth = _open_truth(settings, self.board.n_sensors) if settings.truth is not None else None
        self._pending = bytearray()
        self._congested = False
        self._connected = False
        self._plugged = True
        self._looked_s = self._seen_s = 0.0  # time spent looking for the host, and when it last was
        self._heard_s = self._taken_s = 0.0  # of the time spent looking: when the host last sent, and took, a byte
        self._carrier.plug()
        self.camera_url = ""
        self._camera = self._open_camera(settings) if filmed else None

    def _open_camera(self, settings: BoardSettings) -> VirtualCamera:
        """Return the camera that films the board's unit, and set where its stream is."""
        scene = scene_of(dict(text.partition("=")[::2] for text in (f"seed={settings.seed}", *settings.scene)))
        faults = [parse_camera_fault(text) for text in settings.camera_faults]
        if settings.mjpeg is None:
            return VirtualCamera(scene, VideoFile(Path(settings.video or "")), faults, newest_only=False)
        stream = MjpegStream(settings.mjpeg)
        self.camera_url = stream.url
        return VirtualCamera(scene, stream, faults, newest_only=True)

    @property
    def url(self) -> str:
        """Where a host finds the board: a device's path, or socket://host:port."""
        return self._carrier.url

    def run(self, stopped: Callable[[], bool], replugged: Callable[[str], None] | None = None) -> None:
        """Serve until `stopped()`. `replugged(url)` is called for a port that returned under another name."""
        step_s = _FAST_STEP_S if self._speed >= 20 else _STEP_S
        clock_us = 1e6 * self._speed
        origin, done_us = time.monotonic(), 0
        while not stopped():
            due_us = int((time.monotonic() - origin) * clock_us) - done_us
            if due_us < step_s * clock_us:
                self._carrier.wait(step_s - due_us / clock_us, to_write=bool(self._pending))
                due_us = int((time.monotonic() - origin) * clock_us) - done_us
            now_us = min(due_us, int(_LONGEST_STEP_S * clock_us))
            if self._speed > 1.0:
                now_us = min(now_us, self._for_host_us())
                origin += (due_us - now_us) / clock_us
            done_us += now_us
            self._step(now_us)
            self._follow_plug(replugged)

    def _step(self, dt_us: int) -> None:
        """Exchange bytes with the host and move the board on."""
        now_s = time.monotonic()
        self._looked_s += min(now_s - self._seen_s, _LONGEST_STEP_S)
        self._seen_s = now_s
        data = self._carrier.read()
        if data:
            self._heard_s = self._looked_s
            self.board.receive(data)
        if self._carrier.connected != self._connected:
            self._connected = not self._connected
            if self._connected:
                self.board.opened()
            elif self._plugged:
                self._pending.clear()
                self._carrier.closed_by_host()
        sent = self.board.advance(dt_us, free_bytes=self._room())
        if self._connected:
            self._pending += sent
            self._flush()
        if self._truth is not None:
            _write_truth(self._truth, self.board)
        if self._camera is not None:
            self._camera.take(*self.board.take_elongation())

    def _for_host_us(self) -> int:
        """Return how far a fast board's time may advance before it waits for its host."""
        watchdog_us = self.board.watchdog_us
        if not self._connected:
            return sys.maxsize
        if self._pending and self._looked_s - self._taken_s < _GRACE_S:
            return 0
        if watchdog_us is None or self._looked_s - self._heard_s > _GRACE_S:
            return sys.maxsize
        return max(0, watchdog_us - self.board.now_us - 1)

    def _room(self) -> int:
        """Return the bytes free in the transmit buffer. Once full, none until it is half empty."""
        free = self._buffer_bytes - len(self._pending)
        self._congested = free < self._buffer_bytes // 2 if self._congested else free <= 64
        return 0 if self._congested else free

    def _flush(self) -> None:
        while self._pending:
            taken = self._carrier.write(self._pending)
            if not taken:
                return
            self._taken_s = self._looked_s
            del self._pending[:taken]

    def _follow_plug(self, replugged: Callable[[str], None] | None) -> None:
        if self.board.unplugged == self._plugged:
            self._plugged = not self._plugged
            if self._plugged:
                before = self.url
                self._carrier.plug()
                if replugged is not None and self.url != before:
                    replugged(self.url)
            else:
                self._carrier.unplug()
                self._pending.clear()
                self._connected = False

    def close(self) -> None:
        """Take the port away, finish the video and close the truth file."""
        self._carrier.unplug()
        if self._camera is not None:
            self._camera.close()
        if self._truth is not None:
            self._truth.close()


def _open_truth(settings: BoardSettings, n_sensors: int) -> IO[str]:
    """Return the opened truth file, its header written."""
    path = Path(settings.truth or "")
    try:
        file = path.open("w", encoding="utf-8", newline="")
    except OSError as error:
        raise RequestError(f"cannot write {path}: {error.strerror}", "name a file in a folder that exists") from None
    file.write(f"# SIMULATED unit {settings.unit} seed {settings.seed}: noise-free values beside each sample\n")
    signals = [f"s{number}_mv" for number in range(1, n_sensors + 1)]
    file.write(",".join(["run", "index", "time_s", "pressure_kpa", "elongation_mm", *signals]) + "\n")
    file.flush()
    return file


def _write_truth(file: IO[str], board: VirtualBoard) -> None:
    truth = board.take_truth()
    if truth.size:
        names = ("run", "index", "time_us", "pressure_kpa", "elongation_mm", "signal_mv")
        table = np.column_stack([truth[name] for name in names])
        table[:, 2] /= 1e6
        row = "%d,%d,%.6f,%.5f,%.6f" + ",%.4f" * board.n_sensors + "\n"
        file.write((row * len(table)) % tuple(table.ravel().tolist()))
        file.flush()


# ---- beside another program ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ServedBoard(AbstractContextManager["ServedBoard"]):
    """A board served by another process or thread; close it, or use it in a `with`."""

    url: str
    close: Callable[[], None]  # may be called twice
    camera_url: str = ""  # of its virtual camera, where it has one

    def __exit__(self, *_: object) -> None:
        self.close()


def serve(settings: BoardSettings) -> ServedBoard:
    """Serve a board beside this program, in a process of its own."""
    text = json.dumps(dataclasses.asdict(settings))
    pipe = subprocess.PIPE
    process = start_module(
        "boat_daq.engine.simulator.server", text, stdin=pipe, stdout=pipe, text=True, start_new_session=True
    )
    assert process.stdin is not None
    assert process.stdout is not None
    url, _, camera_url = process.stdout.readline().strip().partition(" ")
    if not url:
        process.communicate()
        BoardServer(settings).close()  # raises what the process ran into
        raise DeviceError("the virtual board did not start", "see the messages above")

    def close() -> None:
        process.communicate()  # the end of its input is its end

    return ServedBoard(url, close, camera_url)


def _serve_for_parent(text: str) -> None:
    """Serve with the settings in `text` (JSON) until standard input ends.

    Ctrl-C is left to the parent: a board that ended first could not be vented any more. A session of its own keeps it
    away while this process is still importing; on Windows there is none.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    stated: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in json.loads(text).items()}
    try:
        server = BoardServer(BoardSettings(**stated))
    except BoatDaqError:
        sys.exit(1)  # the parent finds the same, and reports it
    stop = threading.Event()

    def wait_for_parent() -> None:
        sys.stdin.read()
        stop.set()

    threading.Thread(target=wait_for_parent, daemon=True).start()
    with contextlib.closing(server):
        try:
            os.write(sys.stdout.fileno(), f"{server.url} {server.camera_url}\n".encode())
        except BrokenPipeError:  # the parent is gone
            return
        server.run(stop.is_set)


if __name__ == "__main__":
    _serve_for_parent(sys.argv[1])


class BoardInThread:
    """A board that is served until it is closed; `url` is its port, `truth` the CSV of its noise-free values."""

    def __init__(self, unit: str, *, speed: float, seed: int) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self.truth = Path(self._folder.name) / "truth.csv"
        port = "127.0.0.1:0" if sys.platform == "win32" else "pty"
        self._server = BoardServer(BoardSettings(port=port, unit=unit, speed=speed, seed=seed, truth=str(self.truth)))
        self.url = self._server.url
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="virtual board", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        self._server.run(self._stop.is_set)
        self._server.close()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._folder.cleanup()
