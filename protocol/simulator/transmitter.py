"""The virtual board's transmitter: numbered frames, a finite transmit buffer, and the effects of faults on them.

Samples beyond the free buffer are dropped, counted, and reported with the next one that fits (EVENT 9, flag bit 4) or
at the end of their run; messages always fit. A dropped frame has no sequence number; one lost in the channel had one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from protocol.link.messages import BoardEvent, BoardMessage, EventCode, encode_message
from protocol.recording import SampleFlag
from protocol.simulator.channel_model import Channel
from protocol.simulator.faults import Countdown, FaultSchedule
from protocol.simulator.sample_frames import encode_samples, frame_length

_EVENT_BYTES = 20  # reserved for an EVENT
ABSURD_PA = 5_000_000
ABSURD_COUNTS = 0xFFFF


class Transmitter:
    """Sends frames in order while `free_bytes` last (None: no limit); nothing while `off`, as on a booting board."""

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
