"""A second decoder, to test the first against: one frame at a time, one sample at a time, as SPEC.md reads.

Bare `cobs`, `zlib` and `struct`, no array; nothing is shared with the package but its flags' values.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field

from cobs import cobs

WRAP = 1 << 32


def signed(difference: int) -> int:
    """Return the smallest difference of two 32-bit counters."""
    return (difference + (WRAP >> 1)) % WRAP - (WRAP >> 1)


@dataclass
class PlainDecoder:
    """Decodes bytes; `samples` are (index, time, pressure, state, flags, lit, dark), `gaps` (lost, before, time)."""

    n_sensors: int | None = None
    adc_bits: int = 16
    samples: list[tuple] = field(default_factory=list)
    gaps: list[tuple[int, int, int]] = field(default_factory=list)
    restarts: int = 0  # those that only the index shows
    crc_errors: int = 0
    malformed: int = 0
    oversize: int = 0
    unknown: int = 0
    duplicates: int = 0
    collected: bytearray = field(default_factory=bytearray)
    last: tuple[int, int, int] | None = None  # index, raw time, time
    period: int = 0
    fresh: bool = True  # no neighbour before the next sample
    may_restart: bool = False
    started: bool = False
    unclaimed: int = 0
    held: list[tuple] = field(default_factory=list)
    doubtful: tuple[tuple, int] | None = None  # sample, step: whether its clock went back shows with the next one
    previous: tuple[int, int] | None = None  # raw time of the sample before the last, index steps since
    went_back: list[int] = field(default_factory=list)

    def receive(self, data: bytes) -> None:
        for byte in data:
            if byte:
                self.collected.append(byte)
                if len(self.collected) == 211:
                    self.oversize += 1
                continue
            run, self.collected = bytes(self.collected), bytearray()
            if 0 < len(run) <= 210:
                self._frame(run)

    def _frame(self, run: bytes) -> None:
        try:
            body = cobs.decode(run)
        except cobs.DecodeError:
            self.malformed += 1
            return
        if not 6 <= len(body) <= 200:
            self.malformed += 1
        elif zlib.crc32(body[:-4]) != struct.unpack("<I", body[-4:])[0]:
            self.crc_errors += 1
        else:
            self._message(body[0], body[2:-4])

    def _message(self, type_: int, payload: bytes) -> None:
        sizes = {1: 34, 3: 3, 4: 9}
        if type_ == 2 and self.n_sensors is not None:
            if len(payload) < 14 + 4 * self.n_sensors:
                self.malformed += 1
            else:
                self._sample(payload)
        elif type_ not in sizes:
            self.unknown += 1
        elif len(payload) < sizes[type_]:
            self.malformed += 1
        elif type_ == 1:
            self.n_sensors, self.adc_bits = payload[3], payload[6]
            self._may_restart()
        elif type_ == 3 and payload[2] == 0 and payload[0] in (0x82, 0x83):
            self._may_restart()
            self.started |= payload[0] == 0x82
        elif type_ == 4 and payload[4] == 1:
            self._may_restart()

    def _may_restart(self) -> None:
        self.may_restart = True
        self._drop_held()

    def _drop_held(self) -> None:
        self.duplicates += len(self.held)
        self.held = []

    def _sample(self, payload: bytes) -> None:
        index, raw, pressure, state, flags = struct.unpack_from("<IIiBB", payload)
        counts = struct.unpack_from(f"<{2 * self.n_sensors}H", payload, 14)
        self._place((index, raw, pressure, state, flags, counts[0::2], counts[1::2]))

    def _place(self, sample: tuple) -> None:
        index, raw = sample[:2]
        lost = 0
        if self.may_restart:
            self._settle(None)
        if self.last is None or self.may_restart:
            if self.last is not None and (index, raw) == self.last[:2]:
                self.duplicates += 1
                return
            started, self.may_restart, self.started = self.started, False, False
            if self.last is None or signed(index - self.last[0]) <= 0:
                ours = started or self.last is not None
                lost, self.unclaimed = (index, 0) if ours else (0, index)
                self._begin_at(index, raw)
            elif started and self.unclaimed:
                self.gaps.append((self.unclaimed, self.unclaimed, self.last[2]))
                self.unclaimed = 0
        step = signed(index - (self.last[0] if self.doubtful is None else self.doubtful[0][0]))
        if step <= 0:
            self._late(sample)
        else:
            self._drop_held()
            self._settle((raw, step))
            self._judge(sample, step, lost)

    def _follows(self, before: int, raw: int, expected: float) -> bool:
        elapsed = signed(raw - before)
        elapsed += max(round((expected - elapsed) / WRAP), 0) * WRAP
        far = abs(elapsed - expected) > max(2_000_000, expected / 2)
        return elapsed >= 0 and not (raw < before and expected > 0 and far)

    def _judge(self, sample: tuple, step: int, lost: int) -> None:
        """Keep a sample, or wait for the next one where its clock may have gone back."""
        raw, before = sample[1], self.last[1]
        elapsed = signed(raw - before)
        if step > 1:
            elapsed += max(round((step * self.period - elapsed) / WRAP), 0) * WRAP
        strange = (
            raw < before
            and self.period > 0
            and abs(elapsed - step * self.period) > max(2_000_000, step * self.period / 2)
        )
        if elapsed < 0 or strange:
            earlier = self.previous
            if earlier is None or not self._follows(earlier[0], raw, (earlier[1] + step) * self.period):
                self.doubtful = sample, step
                return
        self._keep(sample, step, lost)

    def _settle(self, following: tuple[int, int] | None) -> None:
        """Decide on the sample in doubt by the one that follows it; None: by nothing."""
        if self.doubtful is None:
            return
        (sample, step), self.doubtful = self.doubtful, None
        raw, before = sample[1], self.last[1]
        if following is not None and not self._follows(before, following[0], (step + following[1]) * self.period):
            elapsed = signed(raw - before)
            if step > 1:
                elapsed += max(round((step * self.period - elapsed) / WRAP), 0) * WRAP
            behind = -elapsed if elapsed < 0 else before - raw
            self.went_back.append(behind + step * max(self.period, 0))
            self.last = (self.last[0], raw, self.last[2] - behind)
            self.period, self.fresh = 0, True
        self._keep(sample, step, 0)

    def _begin_at(self, index: int, raw: int) -> None:
        if self.last is None or signed(raw - self.last[1]) < 0:
            self.last = ((index - 1) % WRAP, raw, raw)
        else:
            self.last = ((index - 1) % WRAP, *self.last[1:])
        self.period, self.fresh, self.previous = 0, True, None

    def _keep(self, sample: tuple, step: int, lost: int) -> None:
        index, raw, pressure, state, flags, lit, dark = sample
        elapsed = signed(raw - self.last[1])
        if step > 1:
            elapsed += max(round((step * self.period - elapsed) / WRAP), 0) * WRAP
        elif not self.fresh:
            self.period = elapsed
        self.fresh = False
        self.previous = self.last[1], step
        time = self.last[2] + elapsed
        lost += step - 1
        full = 1 << self.adc_bits
        absurd = not -110_000 <= pressure <= 1_000_000 or elapsed < 0
        absurd |= any(a >= full or b >= full or b > a + int(full / 256) for a, b in zip(lit, dark, strict=True))
        self.samples.append((index, time, pressure, state, flags | absurd << 8 | (lost > 0) << 9, lit, dark))
        if lost:
            self.gaps.append((lost, index, time))
        self.last = (index, raw, time)

    def _late(self, sample: tuple) -> None:
        index, raw = sample[:2]
        if self.held:
            before = self.held[-1]
            if (index - before[0]) % WRAP != 1 or signed(raw - before[1]) <= 0:
                self._drop_held()
        if signed(raw - (self.last[1] if self.doubtful is None else self.doubtful[0][1])) <= 0:
            self._drop_held()
            self.duplicates += 1
            return
        self.held.append(sample)
        if len(self.held) == 16:
            held, self.held = self.held, []
            self._settle(None)
            self.restarts += 1
            self.unclaimed = held[0][0]
            self._begin_at(*held[0][:2])
            for kept in held:
                self._settle((kept[1], 1))
                self._judge(kept, 1, 0)
