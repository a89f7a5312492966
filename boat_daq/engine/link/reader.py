"""The one reading thread: transport.read -> link.receive -> sinks, in that order, and nothing else.

Rules: no disk, no screen, no sleep on this thread. Every sink sees every block in the same order. A sink that raises is
reported in a block of its own, once, and called again with the next; reading never stops for it. The link is used under
one lock, so `send` may be called from any thread and writes at once: a vent does not wait for the reader. What was sent
comes to the sinks as blocks too, on the reading thread. No lock is held while a sink runs, so a sink may call anything
here, and so may a thread that a sink waits for.

A block: bytes of one read or write and the events decoded from them, passed from the reading thread to the sinks.

Rules: a block is a value, shared by all sinks and changed by none. Every byte that came or went is in exactly one
block, so the blocks of a session, in order, are the session. What the engine itself detects (port gone, silence, a sink
that failed) comes the same way, as an event in a block, so that one stream holds everything in order.

Health of the link: rate, losses, lag, and the drift of the board's clock against the host's.

The fit is host = a + b * board, least squares over the newest sample of every read since the last restart of the
board's clock, kept as running means and products (Welford). A read arrives late by a varying delay, never early: `a`
contains the mean delay, and b - 1 is the drift. Raw times are never changed by it.

Sources: Welford, Technometrics 4 (1962) 419, for the running products.
"""

from __future__ import annotations

import contextlib
import math
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from boat_daq.engine.link.transports import Transport
from boat_daq.engine.snapshot import HealthSnapshot, LinkWarning, LinkWarningCode
from protocol.base.errors import DeviceError
from protocol.link.events import Link, LinkEvent, LinkStatistics, Samples
from protocol.link.messages import Command, Heartbeat

URGENT_NICE = -10  # of the threads that read and record


@dataclass(frozen=True, slots=True)
class PortLost:
    """The port is gone.

    Unplugged, closed at the other end, or at the end of a replay. No block follows.
    """

    error: DeviceError


@dataclass(frozen=True, slots=True)
class PortSilent:
    """The port is open and nothing came for `silent_s`; once for each silence."""

    silent_s: float


@dataclass(frozen=True, slots=True)
class SinkFailed:
    """A sink raised; it is called again with the next block."""

    sink: str
    error: Exception


EngineEvent: TypeAlias = PortLost | PortSilent | SinkFailed


@dataclass(frozen=True, slots=True)
class Block:
    """One read (or one write) of the port.

    Attributes
    ----------
    host_ns : host monotonic clock at the arrival, or at the sending.
    raw : the bytes; empty for events without bytes.
    sent : False for bytes from the board, True for bytes to it.
    events : what was decoded, in order; samples among them.
    """

    host_ns: int
    raw: bytes
    sent: bool = False
    events: tuple[LinkEvent | EngineEvent, ...] = ()


Sink: TypeAlias = Callable[[Block], None]


SILENCE_NS = 1_000_000_000  # without a byte, after which one `PortSilent` event is passed on


class RecordingSink(Protocol):
    """A sink that keeps what it needs to decode the bytes again."""

    def __call__(self, block: Block, /) -> None:
        """Take a block."""

    def attached(self, decoder_state: Mapping[str, Any]) -> None:
        """Take the state of the decoder before the first block."""


class PortReader:
    """Reads a transport through a link on its own thread and passes blocks to sinks.

    Parameters
    ----------
    transport : an open port; closed by the reading thread at its end.
    link : decoder and encoder, binary or text; kept for as long as the port is open.
    """

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
        self._last_byte_ns = self._heard_ns = clock_ns()  # of the last byte; and all that had come by then was read
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
        """Encode a command and write it now, or as soon as the one before it is answered.

        VENT always now.

        Raises
        ------
        DeviceError : the port is gone or does not take bytes.
        BoatDaqError : the link cannot encode this command.
        """
        with self._lock:
            now_ns = self._clock_ns()
            self._write(self.link.send(command, now_ns), now_ns)

    def feed(self, command: Heartbeat) -> None:
        """Write at once what feeds a fast virtual board's watchdog (`Link.feed`).

        Raises
        ------
        DeviceError, BoatDaqError : as `send`.
        """
        with self._lock:
            now_ns = self._clock_ns()
            self._write(self.link.feed(command, now_ns), now_ns)

    def start(self) -> None:
        """Begin to read."""
        self._last_byte_ns = self._clock_ns()
        self._thread.start()

    def stop(self) -> None:
        """Stop reading and close the port.

        Returns when both are done. May be called twice.
        """
        self._stop.set()
        if self._thread.ident is None:
            self.transport.close()
        elif self._thread is not threading.current_thread():
            self._thread.join()

    def _run(self) -> None:
        raise_priority()
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
            if not self.transport.unread:
                self._heard_ns = now_ns
            events, again = self.link.poll(now_ns, self._heard_ns)
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


WARN_FRACTION = 0.005  # of rate and drift
RATE_WINDOW_US = 5_000_000  # of board time
FIT_MIN_S = 10.0  # of host time, before which no drift is given
SILENT_WARN_S = 1.0
ROUGH_S, REAL_TIME = 0.3, 0.1  # from when on another speed is seen, that of a virtual board; share that is none


class ClockFit:
    """Running least squares of host time over board time."""

    def __init__(self) -> None:
        self._origin: tuple[int, int] | None = None  # first (time_us, host_ns)
        self._n = 0
        self._mean_x = self._mean_y = self._xx = self._xy = self._yy = 0.0
        self._span_s = 0.0
        self._newest_us = -(1 << 62)

    def add(self, time_us: int, host_ns: int) -> None:
        """Take a pair."""
        if self._origin is None:
            self._origin = (time_us, host_ns)
        x = (time_us - self._origin[0]) * 1e-6
        y = (host_ns - self._origin[1]) * 1e-9
        self._n += 1
        dx, dy = x - self._mean_x, y - self._mean_y
        self._mean_x += dx / self._n
        self._mean_y += dy / self._n
        self._xx += dx * (x - self._mean_x)
        self._xy += dx * (y - self._mean_y)
        self._yy += dy * (y - self._mean_y)
        self._span_s, self._newest_us = y, time_us

    @property
    def slope(self) -> float | None:
        """Host seconds for one board second; None before `FIT_MIN_S`."""
        return self._xy / self._xx if self._span_s >= FIT_MIN_S and self._xx > 0 else None

    def host_s(self, time_us: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the host's monotonic time of instants of board time, s, once a pair was added.

        A board in real time is believed to run at the host's rate until the fit gives a slope.
        """
        assert self._origin is not None
        first_us, first_ns = self._origin
        rough = self._xy / self._xx if self._span_s > ROUGH_S and self._xx > 0 else 1.0
        slope = self.slope or (1.0 if abs(rough - 1.0) < REAL_TIME else rough)
        x = (time_us - first_us) * 1e-6
        return np.asarray(first_ns * 1e-9 + self._mean_y + slope * (x - self._mean_x), dtype=np.float64)

    def before(self, time_us: int) -> bool:
        """Return whether an instant lies before the newest pair: the board's clock has restarted."""
        return time_us < self._newest_us

    @property
    def jitter_ms(self) -> float | None:
        """Rms of the residuals."""
        if self.slope is None or self._n < 3:
            return None
        return 1e3 * math.sqrt(max(0.0, self._yy - self._xy**2 / self._xx) / (self._n - 2))

    @property
    def offset_ms(self) -> float | None:
        """Host time of board time 0 by the fit, counted from the first pair's arrival."""
        if self.slope is None or self._origin is None:
            return None
        first_s = self._origin[0] * 1e-6
        return 1e3 * (self._mean_y - self.slope * (self._mean_x + first_s))


class LinkHealth:
    """A sink that watches the link.

    Parameters
    ----------
    statistics : the link's counters, such as ``lambda: link.statistics``.
    asked_hz : the rate that START requested.
    real_time : False for a virtual board at another speed: its clock is not compared with the host's.
    lag_ms, at_risk_ms : the recorder's.
    """

    def __init__(
        self,
        statistics: Callable[[], LinkStatistics],
        *,
        asked_hz: float | None = None,
        real_time: bool = True,
        lag_ms: Callable[[], float] = lambda: 0.0,
        at_risk_ms: Callable[[], float] = lambda: 0.0,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.statistics = statistics
        self.asked_hz = asked_hz
        self.real_time = real_time
        self.lag_ms, self.at_risk_ms = lag_ms, at_risk_ms
        self._clock_ns = clock_ns
        self._fit = ClockFit()
        self._window: deque[tuple[int, int]] = deque()  # (time_us of the newest, samples that came with it)
        self._in_window = 0
        self._last_byte_ns = clock_ns()

    def __call__(self, block: Block) -> None:
        """Take the times of a block."""
        if block.sent or not block.raw:
            return
        self._last_byte_ns = block.host_ns
        for event in block.events:
            if isinstance(event, Samples) and len(event.array):
                self._add(int(event.array["time_us"][-1]), len(event.array), block.host_ns)

    def snapshot(self) -> HealthSnapshot:
        """Return the state now."""
        statistics, rate_hz = self.statistics(), self._rate_hz()
        silent_s = max(0.0, (self._clock_ns() - self._last_byte_ns) * 1e-9)
        slope = self._fit.slope if self.real_time else None
        drift_ppm = None if slope is None else (slope - 1.0) * 1e6
        return HealthSnapshot(
            statistics,
            rate_hz,
            self.asked_hz,
            silent_s,
            self.lag_ms(),
            drift_ppm,
            self._fit.jitter_ms if self.real_time else None,
            self._fit.offset_ms if self.real_time else None,
            tuple(_warnings(statistics, rate_hz, self.asked_hz, silent_s, drift_ppm)),
            self.at_risk_ms(),
        )

    def _add(self, time_us: int, n: int, host_ns: int) -> None:
        if self._window and time_us < self._window[-1][0]:  # the board's clock restarted
            self._window.clear()
            self._in_window = 0
            self._fit = ClockFit()
        self._fit.add(time_us, host_ns)
        self._window.append((time_us, n))
        self._in_window += n
        while len(self._window) > 2 and time_us - self._window[0][0] > RATE_WINDOW_US:
            self._in_window -= self._window.popleft()[1]

    def _rate_hz(self) -> float | None:
        """Return samples per board time from the oldest to the newest read of the window."""
        try:
            (first_us, first_n), (last_us, _) = self._window[0], self._window[-1]
        except IndexError:
            return None
        return (self._in_window - first_n) * 1e6 / (last_us - first_us) if last_us > first_us else None


def _warnings(
    statistics: LinkStatistics, rate_hz: float | None, asked_hz: float | None, silent_s: float, drift_ppm: float | None
) -> Iterator[LinkWarning]:
    """Give what is out of bounds."""
    if silent_s > SILENT_WARN_S:
        yield LinkWarning(LinkWarningCode.SILENT, f"no data for {silent_s:.0f} s")
    if statistics.lost:
        yield LinkWarning(LinkWarningCode.LOSS, f"{statistics.lost} samples lost")
    if rate_hz is not None and asked_hz and abs(rate_hz / asked_hz - 1.0) > WARN_FRACTION:
        yield LinkWarning(LinkWarningCode.RATE, f"{rate_hz:.1f} samples/s arrive, {asked_hz:g} were requested")
    if drift_ppm is not None and abs(drift_ppm) > WARN_FRACTION * 1e6:
        text = f"the board's clock is {abs(drift_ppm) * 1e-4:.1f} % {'slow' if drift_ppm > 0 else 'fast'}"
        yield LinkWarning(LinkWarningCode.CLOCK, text)


def raise_priority() -> None:
    """Have the system run this thread before others, where it allows that: a busy computer delays it less."""
    if sys.platform == "linux":
        with contextlib.suppress(PermissionError):  # of a user without the right (RLIMIT_NICE)
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), URGENT_NICE)
    elif sys.platform == "win32":
        import ctypes

        kernel = ctypes.windll.kernel32
        kernel.GetCurrentThread.restype = ctypes.c_void_p
        kernel.SetThreadPriority(ctypes.c_void_p(kernel.GetCurrentThread()), 2)  # THREAD_PRIORITY_HIGHEST
