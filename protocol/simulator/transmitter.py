"""The virtual board's transmitter: numbered frames, a finite transmit buffer, and the effects of faults on them.

Samples beyond the free buffer are dropped, counted, and reported with the next one that fits (EVENT 9, flag bit 4) or,
if none follows, at the end of their run; messages always fit. A dropped frame never had a sequence number; one lost in
the channel did.

The channel model between virtual board and host: it changes bytes only where a fault is active.

Damage is drawn byte by byte in the order sent, so that it does not depend on how the bytes are divided.

SAMPLE frames by the block: `messages.encode_message` as array operations over many samples.

- A CRC-32 is affine: the CRC of a body of fixed length is a constant, xor one table entry for each byte and position.
- The body is shorter than 254 bytes, so COBS is one byte longer than it: each 00 becomes the distance to the next.
Tests compare every frame with `encode_message`.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from protocol.link.messages import BoardEvent, BoardMessage, EventCode, MessageType, encode_message
from protocol.recording import SampleFlag
from protocol.simulator.faults import Countdown, FaultSchedule

Bytes = NDArray[np.uint8]

CRC_LENGTH = 4


@functools.cache
def body_dtype(n_sensors: int) -> np.dtype[np.void]:
    """Return the record of a SAMPLE body without its CRC; `counts` is (lit, dark) for each sensor."""
    head = [("type", "u1"), ("seq", "u1"), ("index", "<u4"), ("time_us", "<u4"), ("pressure_pa", "<i4")]
    return np.dtype([*head, ("state", "u1"), ("flags", "u1"), ("counts", "<u2", (n_sensors, 2))])


def frame_length(n_sensors: int) -> int:
    """Return the transmitted bytes of one SAMPLE frame."""
    return body_dtype(n_sensors).itemsize + CRC_LENGTH + 2


def encode_samples(bodies: NDArray[np.void], first_seq: int) -> Bytes:
    """Return the frames of consecutive samples, shape (n, frame_length).

    Parameters
    ----------
    bodies : records of `body_dtype`, shape (n,); `type` and `seq` are filled in here.
    first_seq : number of the first frame; the others follow modulo 256.
    """
    n, size = bodies.size, bodies.dtype.itemsize
    bodies["type"] = MessageType.SAMPLE
    bodies["seq"] = (first_seq + np.arange(n)) & 0xFF
    places = np.empty((size + CRC_LENGTH, n), np.uint8)  # one row a position, so that each step is one long operation
    places[:size] = bodies.view(np.uint8).reshape(n, size).T
    constant, tables = _crc_tables(size)
    crc = np.full(n, constant, "<u4")
    for place, table in zip(places, tables, strict=False):
        crc ^= table[place]
    places[size:] = crc.view(np.uint8).reshape(n, CRC_LENGTH).T
    return _cobs(places)


def _cobs(places: Bytes) -> Bytes:
    """Return COBS(body) 00 for bodies of shape (length, n), length < 254; result shape (n, length + 2)."""
    length, n = places.shape
    place = np.arange(1, length + 1, dtype=np.uint8)[:, None]
    zero = places == 0
    here_or_after = np.full((length + 1, n), length + 1, np.uint8)  # position of the next 00; the last is the delimiter
    here_or_after[:length] = np.where(zero, place, length + 1)
    here_or_after = np.minimum.accumulate(here_or_after[::-1], axis=0)[::-1]
    frames = np.zeros((length + 2, n), np.uint8)
    frames[0] = here_or_after[0]
    frames[1:-1] = np.where(zero, here_or_after[1:] - place, places)
    return np.ascontiguousarray(frames.T)


@functools.cache
def _crc_tables(length: int) -> tuple[int, NDArray[np.uint32]]:
    """Return the CRC of `length` zeros, and the change by each byte value at each position, shape (length, 256)."""
    constant = crc32(bytes(length))
    changes = [
        [crc32(bytes((value,)) + bytes(length - place - 1), crc32(bytes(place))) ^ constant for value in range(256)]
        for place in range(length)
    ]
    return constant, np.array(changes, np.uint32)


OTHER_DEVICE = b"T=21.5 C RH=40 %\r\n"


class Channel:
    """Turns bytes as sent into bytes as received."""

    def __init__(self, seed: int) -> None:
        self._generators = {
            name: np.random.default_rng((seed, number)) for number, name in enumerate(("bit_flips", "drop_byte"), 101)
        }
        self._until: dict[str, int] = {}  # bytes until the next damage of that name
        self._which_bit = np.random.default_rng((seed, 104))
        self._sent_as_other = 0  # bytes of another device
        self._wrong_baud = np.random.default_rng((seed, 103))

    def carry(self, data: bytes, faults: Mapping[str, float]) -> bytes:
        """Return what arrives of `data` while `faults` are active."""
        if "silent" in faults or "unplug" in faults:
            return b""
        if "other_device" in faults:
            return self._other_text(len(data))
        if "wrong_baud" in faults:
            noise = (1 + 255 * self._wrong_baud.random(len(data))).astype(np.uint8)
            data = (np.frombuffer(data, np.uint8) ^ noise).tobytes()
        if "bit_flips" in faults:
            damaged = bytearray(data)
            for place in self._places("bit_flips", faults["bit_flips"], len(data)):
                damaged[place] ^= 1 << int(self._which_bit.integers(8))
            data = bytes(damaged)
        if "drop_byte" in faults:
            kept = bytearray(data)
            for place in reversed(self._places("drop_byte", faults["drop_byte"], len(data))):
                del kept[place]
            data = bytes(kept)
        return data

    def _other_text(self, length: int) -> bytes:
        """Return as many bytes of another device's text as the board would have sent."""
        start = self._sent_as_other % len(OTHER_DEVICE)
        self._sent_as_other += length
        return (OTHER_DEVICE * (length // len(OTHER_DEVICE) + 2))[start : start + length]

    def _places(self, name: str, chance: float, length: int) -> list[int]:
        """Return which of the next `length` bytes are damaged, each with the same probability."""
        generator = self._generators[name]
        chance = min(max(chance, 1e-12), 1.0)
        place = self._until[name] if name in self._until else int(generator.geometric(chance)) - 1
        places = []
        while place < length:
            places.append(place)
            place += int(generator.geometric(chance))
        self._until[name] = place - length
        return places


_EVENT_BYTES = 20  # reserved for an EVENT
ABSURD_PA = 5_000_000
ABSURD_COUNTS = 0xFFFF


class Transmitter:
    """Sends frames in order; `take` returns the bytes sent.

    `free_bytes` are free in the transmit buffer until the next `take`; None = unlimited. While `off`, as on a booting
    board, nothing is sent.

    Parameters
    ----------
    n_sensors : number of sensors of a sample.
    """

    def __init__(self, n_sensors: int, schedule: FaultSchedule, seed: int) -> None:
        self.free_bytes: int | None = None
        self.countdown = Countdown()
        self._schedule = schedule
        self._frame_length = frame_length(n_sensors)
        self._channel = Channel(seed)
        self._out = bytearray()
        self._absurd = 0
        self._held = np.empty((0, self._frame_length), np.uint8)  # the first of a pair in the wrong order
        self.reset()

    def reset(self) -> None:
        """Reset as after a reboot."""
        self.off = False
        self._seq = 0
        self._dropped = 0

    def take(self) -> bytes:
        """Return the bytes sent since the last call."""
        out = bytes(self._out)
        self._out.clear()
        return out

    def send_raw(self, data: bytes) -> None:
        """Send encoded frames, or bytes that are not a frame."""
        if not self.off:
            self._out += self._channel.carry(data, self._schedule.active)

    def send(self, message: BoardMessage) -> None:
        """Send one message."""
        frame = encode_message(message, self._seq)
        self._seq += 1
        self.send_raw(frame)

    def send_samples(self, bodies: NDArray[np.void]) -> None:
        """Send consecutive samples (`body_dtype`), or drop those beyond the free buffer."""
        self._make_absurd(bodies)
        lost = self.countdown.take("dropped", bodies.size)
        self._dropped += lost
        bodies = bodies[lost:]
        fitting = bodies.size
        if self.free_bytes is not None:
            fitting = max(0, (self.free_bytes - len(self._out) - _EVENT_BYTES) // self._frame_length)
        sent = bodies[:fitting]
        if sent.size:
            if self._dropped:
                sent["flags"][0] |= SampleFlag.DROPPED_BEFORE
                self.report_dropped(int(sent["time_us"][0]))
            frames = encode_samples(sent, self._seq)
            self._seq += sent.size
            self.send_raw(self._arrange(frames).tobytes())
        self._dropped += bodies.size - sent.size

    def report_dropped(self, time_us: int) -> None:
        """Report the dropped samples: before the next sample, or at the end of a run."""
        if self._dropped:
            self.send(BoardEvent(time_us, EventCode.SAMPLES_DROPPED, self._dropped))
            self._dropped = 0

    def _make_absurd(self, bodies: NDArray[np.void]) -> None:
        """Put impossible values into good frames: too much pressure, too many counts, dark above lit."""
        for row in range(self.countdown.take("absurd_value", bodies.size)):
            kind = self._absurd % 3
            self._absurd += 1
            if kind == 0:
                bodies["pressure_pa"][row] = ABSURD_PA
            elif kind == 1:
                bodies["counts"][row] = ABSURD_COUNTS
            else:
                bodies["counts"][row] = bodies["counts"][row][:, ::-1].copy()

    def _arrange(self, frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Lose, repeat or swap whole frames, as faults demand."""
        if not self.countdown and not len(self._held):
            return frames
        frames = frames[self.countdown.take("index_gap", len(frames)) :]
        twice = self.countdown.take("duplicate", len(frames))
        frames = np.concatenate([self._held, np.repeat(frames[:twice], 2, axis=0), frames[twice:]])
        swapped = 2 * self.countdown.take("reorder", len(frames) // 2)
        rest = frames[swapped:]
        self._held = frames[:0]
        if "reorder" in self.countdown:  # one is left over: its partner follows
            self._held, rest = rest, rest[:0]
        return np.concatenate([frames[np.arange(swapped) ^ 1], rest])
