"""A board written from the wire contract alone, without a line of the program: an independent check of the link.

Run as a script: it prints the name of its pseudo-terminal, then answers on it until it is killed. Every sample payload
that it has written to the port is appended to `--sent`, so that a test can compare the recording with it; `--truth`
receives its clock (us) and elongation (mm) at each sample. Its plant is
simple: the pressure follows its ramp, the elongation is proportional to pressure with backlash, and
each sensor is a cubic.
"""

from __future__ import annotations

import argparse
import os
import pty
import random
import select
import struct
import time
import tty
import zlib
from pathlib import Path

CUBICS = {  # mV against mm
    "rising": [(1651.9842, 46.4413, -2.6934, -0.36251), (1624.5567, 33.37911, -2.3102, -0.14139)],
    "falling": [(1500.0, -41.0, 1.9, 0.21), (1420.0, -30.0, 1.2, 0.10)],
}
VREF_MV, BITS = 3300, 12
MM_PER_KPA = 6.5 / 90.0
PLAY_MM = 0.12


def cobs_encode(data: bytes) -> bytes:
    """Consistent overhead byte stuffing, from its definition."""
    out = bytearray()
    for run in data.split(b"\0"):
        while len(run) >= 254:
            out += b"\xff" + run[:254]
            run = run[254:]
        out += bytes([len(run) + 1]) + run
    return bytes(out)


def cobs_decode(data: bytes) -> bytes:
    out = bytearray()
    i = 0
    while i < len(data):
        n = data[i]
        out += data[i + 1 : i + n]
        i += n
        if n < 255 and i < len(data):
            out.append(0)
    return bytes(out)


class Board:
    """State of the board; `now_us` is its clock."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self.cubics = CUBICS[arguments.polarity]
        self.random = random.Random(arguments.seed)
        self.seq = 0
        self.now_us = 0
        self.state = 0
        self.rate = 0
        self.index = 0
        self.next_sample_us = 0
        self.pressure = 0.0
        self.target = 0.0
        self.ramp = 0.0
        self.limits = (-60_000, 70_000)
        self.timeout_us = 0
        self.fed_us = 0
        self.play = 0.0
        self.last_command: tuple[int, int] | None = None
        self.last_answer = b""
        self.sent_log = Path(arguments.sent).open("ab") if arguments.sent else None  # noqa: SIM115
        self.truth_log = Path(arguments.truth).open("a") if arguments.truth else None  # noqa: SIM115

    def frame(self, kind: int, payload: bytes) -> bytes:
        body = struct.pack("<BB", kind, self.seq) + payload
        self.seq = (self.seq + 1) % 256
        return cobs_encode(body + struct.pack("<I", zlib.crc32(body))) + b"\0"

    def hello(self) -> bytes:
        payload = struct.pack("<BBBBHBBHii", 1, 2, 7, len(self.cubics), 2000, BITS, 0, VREF_MV, -60_000, 70_000)
        return self.frame(0x01, payload + b"INDEPENDENT-0001")

    def command(self, body: bytes) -> bytes:
        """Answer one good frame from the host."""
        kind, seq, payload = body[0], body[1], body[2:-4]
        self.fed_us = self.now_us
        if (kind, seq) == self.last_command:
            return self.last_answer
        if kind == 0x81:
            answer = self.hello()
        else:
            answer = self.frame(0x03, bytes([kind, seq, self.obey(kind, payload)]))
        self.last_command, self.last_answer = (kind, seq), answer
        return answer

    def obey(self, kind: int, payload: bytes) -> int:
        lengths = {0x82: 2, 0x83: 0, 0x84: 8, 0x85: 0, 0x86: 2, 0x87: 0, 0x88: 8}
        if kind not in lengths:
            return 1
        if len(payload) < lengths[kind]:
            return 2
        if kind == 0x82:
            (rate,) = struct.unpack("<H", payload)
            if not 0 < rate <= 2000:
                return 3
            self.rate, self.index, self.next_sample_us = rate, 0, self.now_us
        elif kind == 0x83:
            self.rate = 0
        elif kind == 0x84:
            target, ramp = struct.unpack("<iI", payload)
            if self.state == 4:
                return 5
            if not self.limits[0] <= target <= self.limits[1]:
                return 3
            self.target, self.ramp, self.state = float(target), float(ramp or 100_000), 1
        elif kind == 0x85:
            self.state = self.state if self.state == 4 else 3
        elif kind == 0x86:
            (timeout,) = struct.unpack("<H", payload)
            if timeout == 0 and self.state not in (0, 3):
                return 4
            if timeout and not 100 <= timeout <= 5000:
                return 3
            self.timeout_us = timeout * 1000
        elif kind == 0x87:
            self.state = 3
        else:
            low, high = struct.unpack("<ii", payload)
            if not -60_000 <= low < high <= 70_000:
                return 3
            self.limits = (low, high)
        return 0

    def step(self, dt_us: int) -> bytes:
        """One sampling interval: move the pressure, watch the host, sample."""
        self.now_us += dt_us
        out = b""
        if self.timeout_us and self.state in (1, 2) and self.now_us - self.fed_us > self.timeout_us:
            self.state = 4
            unfed_ms = (self.now_us - self.fed_us) // 1000
            out += self.frame(0x04, struct.pack("<IBi", self.now_us % 2**32, 4, unfed_ms))
        goal, rate = (self.target, self.ramp) if self.state in (1, 2) else (0.0, 60_000.0)
        most = rate * dt_us / 1e6
        self.pressure += max(-most, min(most, goal - self.pressure))
        if self.state == 1 and abs(self.pressure - self.target) < 500:
            self.state = 2
        elongation = self.pressure / 1000 * MM_PER_KPA + 0.19
        self.play = max(elongation - PLAY_MM, min(elongation + PLAY_MM, self.play))
        return out + (self.sample() if self.rate else b"")

    def sample(self) -> bytes:
        """A SAMPLE frame of what is there now."""
        x = self.play
        flags = 4 if self.timeout_us else 0
        payload = struct.pack(
            "<IIiBB",
            self.index,
            self.now_us % 2**32,
            round(self.pressure + self.random.gauss(0, 30)),
            self.state,
            flags,
        )
        ambient = 200 + 60 * (self.now_us // 10_000 % 2)
        for b0, b1, b2, b3 in self.cubics:
            mv = b0 + x * (b1 + x * (b2 + x * b3)) + self.random.gauss(0, 1.0)
            dark = ambient + round(self.random.gauss(0, 1))
            payload += struct.pack("<HH", round(mv * 2**BITS / VREF_MV) + dark, dark)
        if self.sent_log:
            self.sent_log.write(payload)
        if self.truth_log:
            self.truth_log.write(f"{self.now_us},{x:.6f}\n")
        self.index += 1
        return self.frame(0x02, payload)


def write_all(port: int, data: bytes) -> None:
    while data:
        select.select([], [port], [])
        data = data[os.write(port, data) :]


def serve(board: Board, port: int, speed: float) -> None:
    """Keep board time in step with the wall clock, `speed` times as fast."""
    begun = time.monotonic()
    collected = b""
    write_all(port, board.hello())
    while True:
        due_us = int((time.monotonic() - begun) * speed * 1e6)
        dt_us = round(1e6 / (board.rate or 100))
        out = b""
        while board.now_us + dt_us <= due_us:
            out += board.step(dt_us)
        if out:
            write_all(port, out)
            for log in (board.sent_log, board.truth_log):
                if log:
                    log.flush()
        ready, _, _ = select.select([port], [], [], 0.002)
        if ready:
            collected += os.read(port, 4096)
            *frames, collected = collected.split(b"\0")
            for body in map(cobs_decode, frames):
                if len(body) >= 6 and zlib.crc32(body[:-4]) == struct.unpack("<I", body[-4:])[0]:
                    write_all(port, board.command(body))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--polarity", choices=sorted(CUBICS), default="rising")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sent")
    parser.add_argument("--truth")
    arguments = parser.parse_args()
    port, slave = pty.openpty()
    tty.setraw(slave)
    print(os.ttyname(slave), flush=True)
    serve(Board(arguments), port, arguments.speed)


if __name__ == "__main__":
    main()
