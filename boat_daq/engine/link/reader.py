"""The one reading thread: transport.read -> link.receive -> sinks, in that order, and nothing else.

Rules: no disk, no screen, no sleep on this thread. Every sink sees every block in the same order. A sink that raises is
reported in a block of its own, once, and called again with the next; reading never stops for it. The link is used under
one lock, so `send` may be called from any thread and writes at once: a vent does not wait for the reader. What was sent
comes to the sinks as blocks too, on the reading thread. No lock is held while a sink runs, so a sink may call anything
here, and so may a thread that a sink waits for.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from boat_daq.engine.link.block import Block, EngineEvent, PortLost, PortSilent, Sink, SinkFailed
from boat_daq.engine.link.ports import Transport
from boat_daq.engine.log import note
from protocol.base.errors import DeviceError
from protocol.link.events import Link, LinkEvent, LinkStatistics
from protocol.link.messages import Command, Heartbeat

URGENT_NICE = -10  # of the threads that read and record
SILENCE_NS = 1_000_000_000  # without a byte, after which one `PortSilent` event is passed on


class RecordingSink(Protocol):
    """A sink that keeps what it needs to decode the bytes again."""

    def __call__(self, block: Block, /) -> None:
        """Take a block."""

    def attached(self, decoder_state: Mapping[str, Any]) -> None:
        """Take the state of the decoder before the first block."""


class PortReader:
    """Reads a transport through a link on its own thread and passes blocks to sinks."""

    def __init__(
        self,
        transport: Transport,
        link: Link,
        *,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.transport = transport
        self.link = link
        self._clock_ns = clock_ns
        self._lock = threading.Lock()  # of the link, the list of sinks, and what was sent
        self._sinks: tuple[Sink, ...] = ()
        self._sent: list[tuple[tuple[Sink, ...], Block]] = []  # not yet passed to the sinks of that instant
        self._failing: list[Sink] = []  # reported once, until they take a block again
        self._failed: list[SinkFailed] = []  # to be reported
        self._stop = threading.Event()
        self._last_byte_ns = clock_ns()
        self.heard_ns = self._last_byte_ns  # all bytes that had arrived by then were read and passed on
        self.urgent = True  # False where the system does not let the reading thread run before others
        self._silent = False
        self._thread = threading.Thread(target=self._run, name=f"reader {transport.description}", daemon=True)

    @property
    def statistics(self) -> LinkStatistics:
        """The link's counters now."""
        with self._lock:
            return self.link.statistics

    def add_sink(self, sink: Sink) -> None:
        """Pass every later block to `sink` too, after the present sinks."""
        with self._lock:
            self._sinks = (*self._sinks, sink)

    def remove_sink(self, sink: Sink) -> None:
        """Pass no later block to `sink`; one that is being passed may still arrive."""
        with self._lock:
            self._sinks = tuple(other for other in self._sinks if other != sink)

    def add_recorder(self, recorder: RecordingSink) -> None:
        """Put a recorder before the other sinks, and pass it the decoder's present state.

        With it the file's bytes give the same samples again, wherever in a stream the recording began.
        """
        with self._lock:
            recorder.attached(self.link.decoder_state())
            self._sinks = (recorder, *self._sinks)

    def send(self, command: Command) -> None:
        """Encode a command and write it now, or as soon as the one before it is answered. VENT always now."""
        with self._lock:
            now_ns = self._clock_ns()
            self._write(self.link.send(command, now_ns), now_ns)

    def feed(self, command: Heartbeat) -> None:
        """Write at once what feeds a fast virtual board's watchdog (`Link.feed`)."""
        with self._lock:
            now_ns = self._clock_ns()
            self._write(self.link.feed(command, now_ns), now_ns)

    def start(self) -> None:
        self._last_byte_ns = self.heard_ns = self._clock_ns()
        self._thread.start()

    def stop(self) -> None:
        """Stop reading and close the port. Returns when both are done. May be called twice."""
        self._stop.set()
        if self._thread.ident is None:
            self.transport.close()
        elif self._thread is not threading.current_thread():
            self._thread.join()

    def _run(self) -> None:
        self.urgent = raise_priority()
        try:
            while not self._stop.is_set():
                self._turn()
        except DeviceError as error:
            self._pass_sent()
            self._report(PortLost(error))
        finally:
            self._pass_sent()
            self.transport.close()

    def _turn(self) -> None:
        """One read, and what is due besides."""
        began_ns = self._clock_ns()
        data = self.transport.read()
        now_ns = self._clock_ns()
        self._pass_sent()
        if data:
            self._last_byte_ns, self._silent = now_ns, False
            with self._lock:
                sinks, events = self._sinks, self.link.receive(data, now_ns)
            self._pass(sinks, Block(now_ns, data, events=tuple(events)))
        elif not self._silent and now_ns - self._last_byte_ns > SILENCE_NS:
            self._silent = True
            self._report(PortSilent((now_ns - self._last_byte_ns) * 1e-9))
        if not data or not self.transport.unread:
            self.heard_ns = began_ns
        self._poll()
        if self._failed:
            failed, self._failed = self._failed, []
            self._report(*failed)

    def _poll(self) -> None:
        """Repeat commands without an answer, and report those that are lost."""
        with self._lock:
            now_ns, deadline = self._clock_ns(), self.link.next_deadline_ns
            if deadline is None or now_ns < deadline:
                return
            heard_ns = now_ns if not self.transport.unread else self.heard_ns
            events, again = self.link.poll(now_ns, heard_ns)
            self._write(again, now_ns)
        if events:
            self._report(*events)

    def _write(self, data: bytes, now_ns: int) -> None:
        """Write under the lock, so that the sinks get what was sent in its order."""
        if data:
            self.transport.write(data)
            self._sent.append((self._sinks, Block(now_ns, data, sent=True)))

    def _pass_sent(self) -> None:
        with self._lock:
            sent, self._sent = self._sent, []
        for sinks, block in sent:
            self._pass(sinks, block)

    def _report(self, *events: LinkEvent | EngineEvent) -> None:
        self._pass(self._sinks, Block(self._clock_ns(), b"", events=events))

    def _pass(self, sinks: tuple[Sink, ...], block: Block) -> None:
        """Pass one block to every sink, whatever any of them raises."""
        for sink in sinks:
            try:
                sink(block)
            except Exception as error:  # noqa: BLE001 - a page's fault must not stop the recording
                if sink not in self._failing:
                    self._failing.append(sink)
                    self._failed.append(SinkFailed(_name(sink), error))
            else:
                if self._failing and sink in self._failing:
                    self._failing.remove(sink)


def _name(sink: Sink) -> str:
    return getattr(sink, "__qualname__", type(sink).__name__)


def raise_priority() -> bool:
    """Have the system run this thread before others, so that a busy computer delays it less; return whether it does.

    On Linux, what this thread starts has its priority too.
    """
    if sys.platform == "linux":
        try:
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), URGENT_NICE)
        except PermissionError:  # a user without the right (RLIMIT_NICE)
            note("warning", f"{threading.current_thread().name} has normal priority: this user may not raise it")
            return False
    elif sys.platform == "win32":
        import ctypes

        kernel = ctypes.windll.kernel32
        kernel.GetCurrentThread.restype = ctypes.c_void_p
        return bool(kernel.SetThreadPriority(ctypes.c_void_p(kernel.GetCurrentThread()), 2))  # THREAD_PRIORITY_HIGHEST
    return sys.platform == "linux"
