"""Replay a recording as a port: its raw bytes in the board's time, faster or slower.

A real board's bytes are replayed at the times of their arrival. Those of a fast virtual board are slowed down to its
board time: a run recorded at 20 times real time plays at 1x, and `speed` always means board time.
"""

from __future__ import annotations

import math
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from boat_daq.engine.link.ports import READ_WAIT_S
from protocol.base.errors import DeviceError
from protocol.recording import open_recording

_AT_ONCE_BYTES = 65_536
_ROWS = 1_000  # read in one go: short transactions
_REAL = 0.05  # |pace - 1| below which the board ran in real time, and the times of arrival are kept
_PACE_FROM_NS = 200_000_000  # shortest segment whose pace is measured


class ReplayEnded(DeviceError):
    """The recording is at its end."""


class ReplayTransport:
    """Plays the bytes of a recording that came from the board; takes none.

    `speed`: board time of the recording for one second here; infinite for as fast as it is read.
    """

    can_write = False
    unread = False  # nothing here answers a command

    def __init__(self, path: Path, speed: float = 1.0) -> None:
        if not speed > 0:
            raise DeviceError(f"a replay at speed {speed:g} does not advance", "Give a factor above 0, or max.")
        self.path = path
        self.description = f"replay of {path.name}"
        self._speed = speed
        self._chunks = _chunks(path)
        self._next = next(self._chunks, None)
        if self._next is None:
            raise DeviceError(f"{path} holds no raw bytes of a board", "Replay one that was recorded from a board.")
        self._start_s: float | None = None
        self._closed = threading.Event()

    @classmethod
    def from_url(cls, url: str) -> ReplayTransport:
        """Open "replay:FILE.boat[@SPEED]"."""
        name, speed = url.removeprefix("replay:"), 1.0
        head, at, tail = name.rpartition("@")
        if at and not Path(name).exists():
            try:
                speed = math.inf if tail == "max" else float(tail)
            except ValueError:
                raise DeviceError(f"{tail!r} is not a speed", "Write replay:FILE.boat@10, or @max.") from None
            name = head
        return cls(Path(name), speed)

    def read(self) -> bytes:
        """Return what is due by now, waiting up to 50 ms for it.

        Raises
        ------
        ReplayEnded : after the last byte.
        """
        if self._start_s is None:
            self._start_s = time.monotonic()
        if self._next is None or self._closed.is_set():
            raise ReplayEnded(f"{self.description}: at its end")
        wait_s = self._due_s(self._next[0]) - time.monotonic()
        if wait_s > 0 and (self._closed.wait(min(wait_s, READ_WAIT_S)) or wait_s > READ_WAIT_S):
            return b""
        return self._take()

    def write(self, data: bytes) -> None:
        """Refuse: a recording takes no commands. DeviceError: always."""
        raise DeviceError(f"{self.description}: a replay takes no commands", "Connect a board.")

    def close(self) -> None:
        """Stop playing."""
        self._closed.set()

    def _due_s(self, played_s: float) -> float:
        assert self._start_s is not None
        return self._start_s + played_s / self._speed

    def _take(self) -> bytes:
        now, data = time.monotonic(), bytearray()
        while self._next is not None and self._due_s(self._next[0]) <= now and len(data) < _AT_ONCE_BYTES:
            data += self._next[1]
            self._next = next(self._chunks, None)
        return bytes(data)


def _chunks(path: Path) -> Iterator[tuple[float, bytes]]:
    """Give (seconds since the first byte, bytes), the file closed in between."""
    last, played_s, before_ns = 0, 0.0, -1
    sql = "SELECT id, host_ns, raw FROM chunk WHERE id > ? AND direction = 0 ORDER BY id LIMIT ?"
    slowed = _slowed(path)
    while True:
        with closing(open_recording(path)) as db:
            rows = db.execute(sql, (last, _ROWS)).fetchall()
        if not rows:
            return
        for at, host_ns, raw in rows:
            took_s = slowed.get(at, (host_ns - before_ns) * 1e-9 if before_ns >= 0 else 0.0)
            pieces = math.ceil(took_s / READ_WAIT_S) if at in slowed else 1
            yield from _spread(bytes(raw), played_s, took_s, pieces=pieces)
            played_s += took_s
            before_ns = host_ns
        last = rows[-1][0]


def _spread(raw: bytes, from_s: float, took_s: float, *, pieces: int) -> Iterator[tuple[float, bytes]]:
    """Give the bytes of one read in pieces, spread over the board time they took.

    At 100 times real time one read holds seconds of samples; slowed down in one piece they would follow a silence.
    """
    pieces = max(1, min(pieces, len(raw)))
    ends = [len(raw) * i // pieces for i in range(pieces + 1)]
    for i in range(pieces):
        yield from_s + took_s * (i + 1) / pieces, raw[ends[i] : ends[i + 1]]


def _slowed(path: Path) -> dict[int, float]:
    """Return the board time of each chunk of a segment not in real time, seconds.

    A block's time is divided by bytes: the host's clock does not resolve a faster board.
    """
    slowed: dict[int, float] = {}
    fast = False  # a segment too short to have a pace has that of the one before it
    with closing(open_recording(path)) as db:
        segments = db.execute(
            "SELECT s.id, s.first_chunk, min(b.first_time_us), max(b.last_time_us), s.host_ns, max(c.host_ns) "
            "FROM segment s JOIN block b ON b.segment = s.id JOIN chunk c ON c.id = b.last_chunk "
            "GROUP BY s.id ORDER BY s.first_chunk"
        ).fetchall()
        for number, first_chunk, first_us, last_us, first_ns, last_ns in segments:
            if last_ns - first_ns > _PACE_FROM_NS and last_us > first_us:
                fast = abs(1000.0 * (last_us - first_us) / (last_ns - first_ns) - 1.0) >= _REAL
            if fast:
                slowed |= _by_bytes(db, number, first_chunk, first_us)
    return slowed


def _by_bytes(connection: sqlite3.Connection, segment: int, first_chunk: int, before_us: int) -> dict[int, float]:
    """Divide each block's time among the chunks that it came in."""
    found: dict[int, float] = {}
    blocks = connection.execute("SELECT last_chunk, last_time_us FROM block WHERE segment = ? ORDER BY id", (segment,))
    for last_chunk, last_us in blocks.fetchall():
        sizes = connection.execute(
            "SELECT id, length(raw) FROM chunk WHERE id BETWEEN ? AND ? AND direction = 0", (first_chunk, last_chunk)
        ).fetchall()
        whole = sum(size for _, size in sizes)
        found |= {at: (last_us - before_us) * 1e-6 * size / whole for at, size in sizes if whole}
        if sizes:
            first_chunk, before_us = last_chunk + 1, last_us
    return found
