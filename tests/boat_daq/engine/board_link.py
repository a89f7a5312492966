"""What several tests of the engine use: a virtual board as a port without a clock, and recordings made with it."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

from boat_daq.engine.link.block import Block
from boat_daq.engine.link.reader import URGENT_NICE, PortReader
from boat_daq.engine.recording.recorder import Recorder
from protocol import CommandDone, Connection, Identify, SetPressure, Start
from protocol.base.errors import DeviceError
from protocol.recording import RunEnd
from protocol.simulator.board import VirtualBoard


class BoardTransport:
    """A virtual board whose time passes by `step_us` at every read, until `end_us`; then it sends nothing."""

    description = "virtual"
    can_write = True

    def __init__(self, board: VirtualBoard, *, step_us: int = 20_000, end_us: int | None = None) -> None:
        self.board = board
        self.step_us = step_us
        self.end_us = end_us
        self.unplug = False
        self.closed = self.waiting = False
        self.received: list[bytes] = []
        self._lock = threading.Lock()

    def read(self) -> bytes:
        if self.unplug:
            raise DeviceError("virtual is gone", "Plug it in again.")
        with self._lock:
            if self.end_us is None or self.board.now_us < self.end_us:
                data = self.board.advance(self.step_us)
                self.received.append(data)
                if data:
                    return data
        time.sleep(0.001)
        return b""

    @property
    def unread(self) -> bool:
        return self.waiting

    def write(self, data: bytes) -> None:
        with self._lock:
            self.board.receive(data)

    def close(self) -> None:
        self.closed = True


class Seen:
    """A sink that keeps blocks and waits for what is wanted."""

    def __init__(self) -> None:
        self.blocks: list[Block] = []
        self._changed = threading.Condition()

    def __call__(self, block: Block) -> None:
        with self._changed:
            self.blocks.append(block)
            self._changed.notify_all()

    def events(self, kind: type) -> list:  # type: ignore[type-arg]
        return [event for block in list(self.blocks) for event in block.events if isinstance(event, kind)]

    def wait(self, kind: type, n: int = 1, timeout_s: float = 5.0) -> bool:
        with self._changed:
            return self._changed.wait_for(lambda: len(self.events(kind)) >= n, timeout_s)


def meta_of(link: Connection, **more: object) -> dict[str, object]:
    hello = link.hello
    assert hello is not None
    return {
        "simulated": True,
        "n_sensors": hello.n_sensors,
        "sample_kind": "counts",
        "vref_mv": hello.vref_mv,
        "adc_bits": hello.adc_bits,
        "board_id": hello.board_id,
        "rate_hz": 100,
        **more,
    }


def identified(transport: BoardTransport) -> tuple[PortReader, Connection, Seen]:
    """Return a running acquisition that has the board's HELLO."""
    link, seen = Connection(), Seen()
    reader = PortReader(transport, link)
    reader.add_sink(seen)
    reader.start()
    reader.send(Identify())
    assert seen.wait(CommandDone)
    return reader, link, seen


def record_run(
    path: Path, board: VirtualBoard, seconds: float, *, rate_hz: int = 100, before_s: float = 0.0
) -> Recorder:
    """Record `seconds` of board time into `path` and close it; `before_s` of the stream pass before it begins."""
    transport = BoardTransport(board)
    reader, link, _ = identified(transport)
    if before_s:
        reader.send(Start(rate_hz))
        _wait_until(board, board.now_us + int(before_s * 1e6))
    recorder = Recorder(path, meta_of(link, rate_hz=rate_hz))
    reader.add_recorder(recorder)
    if not before_s:
        reader.send(Start(rate_hz))
    reader.send(SetPressure(20_000))
    transport.end_us = board.now_us + int(seconds * 1e6)
    _wait_until(board, transport.end_us)
    reader.stop()
    recorder.close(RunEnd.FINISHED)
    return recorder


def _wait_until(board: VirtualBoard, time_us: int) -> None:
    deadline = time.monotonic() + 100.0  # on a machine that has much else to do
    while board.now_us < time_us:
        assert time.monotonic() < deadline
        time.sleep(0.002)


def urgent_nice() -> int:
    """Return the nice value of an urgent thread: that of this program where its user has no right to lower it."""
    own, thread = os.getpriority(os.PRIO_PROCESS, 0), threading.get_native_id()
    try:
        os.setpriority(os.PRIO_PROCESS, thread, own - 1)
    except PermissionError:
        return own
    os.setpriority(os.PRIO_PROCESS, thread, own)
    return URGENT_NICE
