"""Boards of other makers, from the wire contract alone, each unusual in a way that the contract allows or forbids.

One thread serves one board on a pseudo-terminal in real time. What the program sent is checked through
`Board.acts` (commands executed), `heard` (all frames received), and `pressures` (kPa, each tick).
"""

from __future__ import annotations

import os
import select
import struct
import threading
import time
import tty
import zlib
from typing import ClassVar

IDENTIFY, START, STOP, SET_PRESSURE, VENT, HEARTBEAT, CLEAR_FAULT, SET_LIMITS = range(0x81, 0x89)
HELLO, SAMPLE, ACK, EVENT = range(0x01, 0x05)
IDLE, RAMPING, HOLDING, VENTED, FAULT = range(5)
TICK_S = 0.002


def stuffed(body: bytes) -> bytes:
    """Encode a body by COBS, with its delimiter."""
    out = bytearray()
    for run in body.split(b"\0"):
        out += bytes([len(run) + 1]) + run  # a body is at most 200 bytes: no run is longer than 253
    return bytes(out) + b"\0"


def unstuffed(wire: bytes) -> bytes:
    out, at = bytearray(), 0
    while at < len(wire):
        out += wire[at + 1 : at + wire[at]]
        at += wire[at]
        if at < len(wire):
            out.append(0)
    return bytes(out)


class Board:
    """A plain board: remembers the last type and seq, answers at once."""

    sensors = 2
    rate_max_hz = 500
    adc_bits = 12
    hard_pa = (-60_000, 70_000)
    identity = b"STRANGE-01"
    first_us = 0
    ramp_pa_s = 40_000
    extra = b""  # at the end of every payload
    statuses: ClassVar[dict[int, int]] = {}  # command -> status it is refused with
    delay_s = 0.0  # of every answer
    boots_s = 0.0  # neither receives nor sends for so long after power-on
    lose: ClassVar[dict[int, int]] = {}  # command -> how many of its first answers are lost

    def __init__(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.url = os.ttyname(self._slave)
        self.acts: list[int] = []
        self.heard: list[tuple[int, int]] = []
        self.pressures: list[float] = []
        self.indices: list[int] = []
        self._lose = dict(self.lose)
        self._seq = 0
        self._later: list[tuple[float, bytes]] = []
        self._waiting = b""
        self._begun_s = time.monotonic()
        self.reset()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def reset(self) -> None:
        """Power-on."""
        self.state, self.pressure, self.target = IDLE, 0.0, 0.0
        self.rate, self.index, self.next_s = 0, 0, 0.0
        self.ramp = float(self.ramp_pa_s)
        self.limits = self.hard_pa
        self.timeout_s, self.fed_s = 0.0, time.monotonic()
        self.last: tuple[int, int] | None = None
        self.answer = b""

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)

    # ---- frames ----------------------------------------------------------------------------------------------------

    def frame(self, kind: int, payload: bytes) -> bytes:
        body = bytes([kind, self._seq]) + payload + self.extra
        self._seq = (self._seq + 1) % 256
        return stuffed(body + struct.pack("<I", zlib.crc32(body)))

    def hello(self, boot_reason: int = 0) -> bytes:
        low, high = self.hard_pa
        head = struct.pack(
            "<BBBBHBBHii", 1, 3, 1, self.sensors, self.rate_max_hz, self.adc_bits, boot_reason, 3300, low, high
        )
        return self.frame(HELLO, head + self.identity.ljust(16, b"\0"))

    def event(self, code: int, value: int) -> bytes:
        return self.frame(EVENT, struct.pack("<IBi", self.clock_us(), code, value))

    def clock_us(self) -> int:
        return (self.first_us + int((time.monotonic() - self._begun_s) * 1e6)) % 2**32

    def send(self, data: bytes) -> None:
        while data:
            try:
                data = data[os.write(self._master, data) :]
            except BlockingIOError:  # no reader: a real UART would drop it too
                return

    def chatter(self) -> bytes:
        """Return the bytes that it sends besides, each tick."""
        return b""

    def _run(self) -> None:
        last_s = time.monotonic()
        while not self._stop.is_set():
            ready, _, _ = select.select([self._master], [], [], TICK_S)
            now_s = time.monotonic()
            data = os.read(self._master, 4096) if ready else b""
            if now_s - self._begun_s < self.boots_s:
                last_s = now_s
                continue
            self._waiting += data
            *frames, self._waiting = self._waiting.split(b"\0")
            for body in map(unstuffed, filter(None, frames)):
                if len(body) >= 6 and struct.unpack("<I", body[-4:])[0] == zlib.crc32(body[:-4]):
                    self._take(body[0], body[1], body[2:-4], now_s)
            self._move(now_s, now_s - last_s)
            last_s = now_s
            self.send(self.chatter())
            while self._later and self._later[0][0] <= now_s:
                self.send(self._later.pop(0)[1])
            while self.rate and self.next_s <= now_s:
                self.next_s += 1 / self.rate
                self.indices.append(self.index)
                self.send(self.sample())
                self.index += 1

    def sample(self) -> bytes:
        flags = 4 if self.timeout_s else 0
        head = struct.pack("<IIiBB", self.index, self.clock_us(), round(self.pressure), self.state, flags)
        counts = [(2000 + 40 * n + round(self.pressure / 100) + self.index % 3, 100 + n) for n in range(self.sensors)]
        return self.frame(SAMPLE, head + b"".join(struct.pack("<HH", *pair) for pair in counts))

    # ---- commands --------------------------------------------------------------------------------------------------

    def _take(self, kind: int, seq: int, payload: bytes, now_s: float) -> None:
        self.heard.append((kind, seq))
        self.fed_s = now_s
        if (kind, seq) != self.last:
            self.last, self.answer = (kind, seq), b""
            if kind == IDENTIFY:
                self.answer = self.hello()
            else:
                status = self.statuses.get(kind, 0) or self.act(kind, payload, now_s)
                self.answer = self.frame(ACK, bytes([kind, seq, status]))
        if self._lose.get(kind, 0) > 0:
            self._lose[kind] -= 1
        elif self.delay_s:
            self._later.append((now_s + self.delay_s, self.answer))
        else:
            self.send(self.answer)

    def act(self, kind: int, payload: bytes, now_s: float) -> int:
        self.acts.append(kind)
        if kind == START:
            (rate,) = struct.unpack("<H", payload)
            if not 0 < rate <= self.rate_max_hz:
                return 3
            self.rate, self.index, self.next_s = rate, 0, now_s
        elif kind == STOP:
            self.rate = 0
        elif kind == SET_PRESSURE:
            target, ramp = struct.unpack("<iI", payload)
            if self.state == FAULT:
                return 5
            if not self.limits[0] <= target <= self.limits[1]:
                return 3
            self.target, self.ramp, self.state = float(target), float(ramp or self.ramp_pa_s), RAMPING
        elif kind == VENT:
            self.state = FAULT if self.state == FAULT else VENTED
        elif kind == HEARTBEAT:
            (timeout_ms,) = struct.unpack("<H", payload)
            if timeout_ms == 0 and self.state not in (IDLE, VENTED):
                return 4
            if timeout_ms and not 100 <= timeout_ms <= 5000:
                return 3
            self.timeout_s = timeout_ms / 1000
        elif kind == CLEAR_FAULT:
            if self.state != FAULT:
                return 4
            self.state = VENTED
        elif kind == SET_LIMITS:
            low, high = struct.unpack("<ii", payload)
            if not self.hard_pa[0] <= low < high <= self.hard_pa[1]:
                return 3
            self.limits = (low, high)
        else:
            return 1
        return 0

    def _move(self, now_s: float, dt_s: float) -> None:
        if self.timeout_s and self.state != FAULT and now_s - self.fed_s > self.timeout_s:
            self.state = FAULT
            self.send(self.event(4, int(1000 * (now_s - self.fed_s))))
        goal, rate = (self.target, self.ramp) if self.state in (RAMPING, HOLDING) else (0.0, 100_000.0)
        self.pressure += max(-rate * dt_s, min(rate * dt_s, goal - self.pressure))
        if self.state == RAMPING and self.pressure == self.target:
            self.state = HOLDING
        self.pressures.append(self.pressure / 1000)


class LosesStart(Board):
    """Its first answers to START, SET_PRESSURE and SET_LIMITS are lost."""

    lose: ClassVar[dict[int, int]] = {START: 1, SET_PRESSURE: 2, SET_LIMITS: 1}


class Late(Board):
    """Every answer takes 200 ms: just in time."""

    delay_s = 0.2


class TooLate(Board):
    """Every answer takes 900 ms: the link counts as lost."""

    delay_s = 0.9


class NoLimits(Board):
    """Refuses limits."""

    statuses: ClassVar[dict[int, int]] = {SET_LIMITS: 6}


class NoWatchdog(Board):
    """Has no watchdog."""

    statuses: ClassVar[dict[int, int]] = {HEARTBEAT: 6}


class NoStart(Board):
    """Refuses every sampling rate."""

    statuses: ClassVar[dict[int, int]] = {START: 3}


class Slow(Board):
    """Samples 40 times a second at most, and has one sensor of 16 bits."""

    rate_max_hz = 40
    sensors = 1
    adc_bits = 16


class Four(Board):
    """Has four sensors, an identity of 16 characters, not all ASCII, and a clock about to wrap."""

    sensors = 4
    identity = b"B\xd6ARD-WITHOUT-NU"
    first_us = 2**32 - 3_000_000


class BootsLate(Board):
    """Neither receives nor sends for two seconds after its port opened."""

    boots_s = 2.0


class Newer(Board):
    """Has a newer minor version: longer messages, unknown types, and a LOG that floods the link."""

    extra = b"\xaa\x00\x55"

    def chatter(self) -> bytes:
        log = self.frame(0x10, b"debug: loop %d, all is well here" % self._seq)
        return (
            log * 2 + b"\0\0" + self.frame(0x7F, bytes(range(100))) + self.frame(EVENT, struct.pack("<IBi", 0, 77, 5))
        )


class Resets(Board):
    """Its supply fails for an instant, once under pressure."""

    def __init__(self) -> None:
        self._reset_done = False
        super().__init__()

    def chatter(self) -> bytes:
        if self._reset_done or self.pressure < 20_000:
            return b""
        self._reset_done = True
        self.reset()
        return b"\xff\x13boot v3.1\r\n\0" + self.hello(2) + self.event(1, 2)


class Narrow(Board):
    """Its hard limits are tighter than the plan."""

    hard_pa = (-10_000, 30_000)


class Leaks(Board):
    """Never exceeds 12 kPa."""

    def _move(self, now_s: float, dt_s: float) -> None:
        super()._move(now_s, dt_s)
        self.pressure = min(self.pressure, 12_000.0)


class Drops(Board):
    """Reports samples that it dropped: an index gap, the flag, and the event before it."""

    def sample(self) -> bytes:
        if self.index == 150:
            self.index += 7
            event = self.event(9, 7)
            frame = super().sample()
            body = bytearray(unstuffed(frame[:-1]))[:-4]
            body[15] |= 16
            return event + stuffed(bytes(body) + struct.pack("<I", zlib.crc32(bytes(body))))
        return super().sample()


class Trickles(Board):
    """Its UART sends bytes one by one, with empty frames between."""

    def send(self, data: bytes) -> None:
        for at in range(len(data)):
            super().send(data[at : at + 1])
        super().send(b"\0" if data else b"")


class Running(Board):
    """Samples before the host connects: an earlier host was killed; it holds its pressure, without a watchdog armed."""

    def reset(self) -> None:
        super().reset()
        self.rate, self.next_s, self.index = 100, time.monotonic(), 12_345
        self.state, self.target, self.pressure = HOLDING, 20_000.0, 20_000.0


class Latched(Board):
    """Has latched a fault before the host connects; its cause is gone."""

    def reset(self) -> None:
        super().reset()
        self.state = FAULT


class NoSensors(Board):
    """Reports that it has no sensor, which the contract forbids."""

    sensors = 0


class NoScale(Board):
    """Reports a converter of no bits, from which no signal can be computed."""

    adc_bits = 0


class NoVacuum(Board):
    """Has limits that exclude 0 kPa: no unit can be vented within them."""

    hard_pa = (5_000, 70_000)


class NoRate(Board):
    """Samples at most 0 times a second."""

    rate_max_hz = 0
