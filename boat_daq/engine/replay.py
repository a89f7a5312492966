"""A recording as a port: its raw bytes come again, in the board's time, faster or slower.

A real board's bytes come at the times they came. What a fast virtual board gave is slowed down to its board time: a run
recorded at 20 times real time plays as it would have been, and `speed` always means board time.
"""

from __future__ import annotations

import math
import threading
import time
from bisect import bisect_right
from collections.abc import Iterator
from pathlib import Path

from boat_daq.engine.transports import READ_WAIT_S
from boat_daq.errors import DeviceError
from protocol.recording import open_recording

_AT_ONCE_BYTES = 65_536
_ROWS = 1_000  # read in one go: short transactions
_REAL = 0.05  # a pace so near to 1 is a real board's, whose own times are kept
_PACE_FROM_NS = 200_000_000  # of a segment, before its pace says anything


class ReplayEnded(DeviceError):
    """The recording is at its end: no fault, but no more bytes."""


class ReplayTransport:
    """Plays the bytes of `path` that came from the board; takes none.

    Parameters
    ----------
    path : a recording.
    speed : board time of the recording for one second here; infinite for as fast as it is read.

    Raises
    ------
    DeviceError : the speed is not positive, or there are no bytes. RecordingError : not a recording.
    """

    can_write = False

    def __init__(self, path: Path, speed: float = 1.0) -> None:
        if not speed > 0:
            raise DeviceError(f"a replay at speed {speed:g} never moves", "Give a factor above 0, or max.")
        self.path = path
        self.description = f"replay of {path.name}"
        self._speed = speed
        self._chunks = _chunks(path)
        self._next = next(self._chunks, None)
        if self._next is None:
            raise DeviceError(f"{path} holds no bytes of a board", "There is nothing to replay.")
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
                raise DeviceError(f"{tail!r} is no speed", "Write replay:FILE.boat@10, or @max.") from None
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

    @property
    def unread(self) -> bool:
        """False: nothing here answers a command."""
        return False

    def write(self, data: bytes) -> None:
        """Refuse: nobody is there.

        Raises
        ------
        DeviceError : always.
        """
        raise DeviceError(f"{self.description}: a recording cannot be commanded", "Connect to a board.")

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
    """Give (seconds since the first byte, bytes) of all that came, without keeping the file open in between."""
    last, played_s, before_ns = 0, 0.0, -1
    sql = "SELECT id, host_ns, raw FROM chunk WHERE id > ? AND direction = 0 ORDER BY id LIMIT ?"
    first_chunks, paces = _paces(path)
    while True:
        connection = open_recording(path)
        try:
            rows = connection.execute(sql, (last, _ROWS)).fetchall()
        finally:
            connection.close()
        if not rows:
            return
        for at, host_ns, raw in rows:
            pace = paces[bisect_right(first_chunks, at)]
            played_s += pace * (host_ns - before_ns) * 1e-9 if before_ns >= 0 else 0.0
            before_ns = host_ns
            yield played_s, bytes(raw)
        last = rows[-1][0]


def _paces(path: Path) -> tuple[list[int], list[float]]:
    """Return the segments' first chunks, and the board time in a second of host time before each and after the last."""
    connection = open_recording(path)
    try:
        rows = connection.execute(
            "SELECT s.first_chunk, min(b.first_time_us), max(b.last_time_us), s.host_ns, max(c.host_ns) "
            "FROM segment s JOIN block b ON b.segment = s.id JOIN chunk c ON c.id = b.last_chunk "
            "GROUP BY s.id ORDER BY s.first_chunk"
        ).fetchall()
    finally:
        connection.close()
    paces = [1.0]
    for _, first_us, last_us, first_ns, last_ns in rows:
        long_enough = last_ns - first_ns > _PACE_FROM_NS and last_us > first_us
        pace = 1000.0 * (last_us - first_us) / (last_ns - first_ns) if long_enough else paces[-1]
        paces.append(1.0 if abs(pace - 1.0) < _REAL else pace)
    return [int(row[0]) for row in rows], paces
