"""The session's inside: controller and journal under one lock, and the blocks of the reading thread carried to them.

Rules: nothing is waited for under the lock but a write to the port, which takes 250 ms at the very longest; effects
are carried out in the order in which the controller gave them; a sink of the user runs outside the lock.
"""

from __future__ import annotations

import dataclasses
import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from boat_daq.engine.blocks import Block, PortLost, SinkFailed
from boat_daq.engine.control.board_commands import Send
from boat_daq.engine.control.controller import Controller
from boat_daq.engine.control.watchdog import FAST
from boat_daq.engine.display.ring_buffer import RingBuffer
from boat_daq.engine.link.link_health import LinkHealth
from boat_daq.engine.link.opening import OpenPort
from boat_daq.engine.link.reader import Acquisition
from boat_daq.engine.log import note_failure
from boat_daq.engine.session.journal import Journal
from boat_daq.engine.snapshot import HealthSnapshot, MessageKind
from boat_daq.errors import DeviceError, StorageError
from protocol.errors import ProtocolError
from protocol.link.events import HelloReceived, Samples, WrongProtocol
from protocol.link.messages import Command, Heartbeat, SetPressure

_OF_THE_BOARD = ("board_id", "vref_mv", "adc_bits", "polarity", "rate_hz", "unit", "limits_pa")

SampleSink = Callable[[np.ndarray[Any, Any]], None]


class Core:
    """Controller, journal and acquisition, joined."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.journal = Journal()
        self.control = Controller()
        self.port: OpenPort | None = None
        self.acquisition: Acquisition | None = None
        self.health: LinkHealth | None = None
        self.ring: RingBuffer | None = None
        self.sinks: tuple[SampleSink, ...] = ()
        self.pressures = 0  # odd while a pressure is being sent: see `Session.vent`
        self.lost: DeviceError | None = None  # the port, as the reading thread saw it
        self.refused: tuple[str, str] | None = None  # the board: cause and remedy
        self.expected_id: str | None = None  # of the board that was lost
        self.heard = False  # any byte on this port

    @property
    def simulated(self) -> bool:
        """Whether what comes is no real unit's."""
        hello, replayed = self.control.hello, self.port.replayed if self.port else None
        return bool(replayed["simulated"]) if replayed else hello is not None and hello.simulated

    @property
    def good_frames(self) -> bool:
        """Whether anything came that is a frame of the protocol."""
        return self.acquisition is not None and self.acquisition.statistics.frames > 0

    def describe(self) -> dict[str, Any]:
        """Return what a recording says of board, link and plan (keys of `protocol.recording.SESSION_KEYS`)."""
        assert self.port is not None
        link, hello, replayed = self.port.link, self.control.hello, self.port.replayed
        limits, plan = self.control.interlock.limits, self.control.sequencer.plan
        described = {
            "simulated": self.simulated,
            "board_id": hello.board_id if hello else "",
            "profile": self.port.profile,
            "n_sensors": link.n_sensors,
            "sample_kind": link.sample_kind,
            "vref_mv": hello.vref_mv if hello else 0,
            "adc_bits": hello.adc_bits if hello else 0,
            "rate_hz": self.control.rate_hz,
            "limits_pa": [1000 * limits.min_kpa, 1000 * limits.max_kpa] if limits else None,
            "plan": dataclasses.asdict(plan) if plan else None,
        }
        return described if replayed is None else {**described, **{key: replayed[key] for key in _OF_THE_BOARD}}

    def attach(self, port: OpenPort) -> None:
        """Begin to read a port that has just been opened; the reading of a replay is begun by the keeper."""
        acquisition = Acquisition(port.transport, port.link)
        health = LinkHealth(lambda: acquisition.statistics, asked_hz=self.control.rate_hz, lag_ms=self._lag_ms)
        acquisition.add_sink(health)
        acquisition.add_sink(self._take)
        with self.lock:
            self.port, self.acquisition, self.health = port, acquisition, health
            self.lost = self.refused = None
            self.heard = False
            dialogue = self.control.dialogue
            dialogue.can_command, dialogue.can_write = port.can_command, port.transport.can_write
            dialogue.whole_contract = port.profile is None
            self.control.readiness.why_read_only = port.why_read_only
            if port.replayed is None:
                acquisition.start()
            self.control.link_opened(time.monotonic_ns())
            if port.replayed is not None:
                self._listen(port.replayed)
            self._carry_out()

    def detach(self) -> None:
        """Stop reading and close the port; waits for the reading thread, so never called on it."""
        with self.lock:
            acquisition, self.acquisition = self.acquisition, None
        if acquisition is not None:
            acquisition.stop()

    @contextmanager
    def acting(self) -> Iterator[Controller]:
        """Give the controller under the lock, and carry out what follows, also where it refuses."""
        with self.lock:
            self.control.dialogue.now_ns = time.monotonic_ns()
            try:
                yield self.control
            finally:
                self._carry_out()

    def tick(self) -> None:
        """Let time pass."""
        with self.acting() as control:
            if self.acquisition is not None:
                control.tick(time.monotonic_ns())
            if self.health is not None:
                self.health.real_time = control.dialogue.meter.speed <= FAST

    def send_now(self, command: Command, *, feeds: bool = False) -> bool:
        """Write a command without asking for the lock; returns whether the port took it."""
        acquisition = self.acquisition
        if acquisition is None or self.port is None or not self.port.transport.can_write:
            return False
        try:
            if feeds and isinstance(command, Heartbeat):
                acquisition.feed(command)
            else:
                acquisition.send(command)
        except (DeviceError, ProtocolError):
            return False  # the reading thread finds the port gone; a link that cannot say it has told why
        return True

    def tell(self, kind: MessageKind, level: str, cause: str, remedy: str = "") -> None:
        """Tell the operator."""
        with self.lock:
            self.journal.tell(kind, level, cause, remedy, host_ns=time.monotonic_ns())

    def storage_failed(self, error: StorageError) -> None:
        """The disk fails, on the recorder's thread: no run without its record."""
        with self.acting() as control:
            self.journal.tell(MessageKind.STORAGE, "error", error.cause, error.remedy, host_ns=time.monotonic_ns())
            control.abort(error.cause)

    def health_now(self) -> HealthSnapshot:
        """Return the link's figures."""
        assert self.health is not None
        return self.health.snapshot()

    def _lag_ms(self) -> float:
        recorder = self.journal.recorder
        return recorder.lag_ms if recorder is not None else 0.0

    # ---- on the reading thread -------------------------------------------------------------------------------------

    def _take(self, block: Block) -> None:
        """Take a block: first what it means, then whoever looks on."""
        if block.sent:
            return
        with self.lock:
            self.heard = self.heard or bool(block.raw)
            for event in block.events:
                match event:
                    case HelloReceived(hello) if self.expected_id not in (None, hello.board_id):
                        text = f"another board is on the port: {hello.board_id}"
                        self.refused = (text, f"plug {self.expected_id} in again")
                        return
                    case WrongProtocol(theirs, ours):
                        text = f"the board speaks protocol version {theirs}, this program version {ours}"
                        self.refused = (text, "update the board's firmware or this program to the same version")
                    case PortLost(error):
                        self.lost = error
                    case SinkFailed(name, failure):
                        note_failure(f"{name} failed", failure)
                        self.journal.tell(
                            MessageKind.SINK_FAILED, "error", f"{name} failed: {failure!r}", "report this as a fault"
                        )
            self.control.events(block.events, block.host_ns)
            if any(isinstance(event, HelloReceived) for event in block.events):
                self._greeted()
            self._carry_out()
            self._fill_ring(block)
        if self.sinks:
            for event in block.events:
                if isinstance(event, Samples):
                    for sink in self.sinks:
                        sink(event.array)

    def _greeted(self) -> None:
        """A board that came back is recorded on; what the screen shows begins with the first board."""
        assert self.acquisition is not None
        hello = self.control.hello
        if self.health is not None:
            self.health.asked_hz = self.control.rate_hz  # a board may give less than was wished
        if hello is not None and self.ring is None:
            kind = self.acquisition.link.sample_kind
            scale = hello.vref_mv / 2**hello.adc_bits if kind == "counts" else None
            self.ring = RingBuffer(hello.n_sensors, mv_per_count=scale)
        if hello is not None and self.expected_id == hello.board_id and self.journal.recorder is not None:
            self.acquisition.add_recorder(self.journal.recorder)
        self.expected_id = None

    def _fill_ring(self, block: Block) -> None:
        if self.ring is not None:
            self.ring.target_kpa = math.nan if self.control.target_kpa is None else self.control.target_kpa
            self.ring(block)

    def _listen(self, meta: dict[str, Any]) -> None:
        """Take scale and sensors from the metadata of a replayed recording: no HELLO need be in its bytes."""
        scale = meta["vref_mv"] / 2 ** meta["adc_bits"] if meta["sample_kind"] == "counts" else None
        self.control.listen(1.0 if scale is None else scale)
        self.ring = RingBuffer(int(meta["n_sensors"]), mv_per_count=scale)

    def _carry_out(self) -> None:
        """Send and keep what the controller asks for, in its order."""
        host_ns, board_us = time.monotonic_ns(), self.control.dialogue.board_us
        for effect in self.control.take():
            if not isinstance(effect, Send):
                self.journal.take(effect, host_ns=host_ns, time_us=board_us)
            elif isinstance(effect.command, SetPressure):
                self.pressures += 1
                self.send_now(effect.command)
                self.pressures += 1
            else:
                self.send_now(effect.command, feeds=effect.feeds)
