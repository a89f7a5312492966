"""The virtual board's way out: numbered frames, a transmit buffer with an end, and whatever a fault does to them.

Samples that find no room are dropped, counted, and told with the next one that does (EVENT 9, flag bit 4) or, if none
comes, where their run ends; messages always find room. What is dropped never had a sequence number; what is lost on the
way did.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from protocol.link.messages import BoardEvent, BoardMessage, EventCode, encode_message
from protocol.recording import SampleFlag
from protocol.simulator.channel import Channel
from protocol.simulator.faults import Countdown, FaultSchedule
from protocol.simulator.sample_frames import encode_samples, frame_length

_EVENT_ROOM = 20  # bytes of an EVENT on the wire, and some
ABSURD_PA = 5_000_000
ABSURD_COUNTS = 0xFFFF


class Transmitter:
    """Frames in the order of their sending; `take` hands over what has been sent.

    `room` is what the transmit buffer can hold until the next `take`, bytes; None = any number. While `off`, as a board
    is that boots, nothing leaves.
    """

    def __init__(self, n_sensors: int, schedule: FaultSchedule, seed: int) -> None:
        self.room: int | None = None
        self.countdown = Countdown()
        self._schedule = schedule
        self._frame_length = frame_length(n_sensors)
        self._channel = Channel(seed)
        self._out = bytearray()
        self._absurd = 0
        self._held = np.empty((0, self._frame_length), np.uint8)  # the first of a pair in the wrong order
        self.reset()

    def reset(self) -> None:
        """Start as after a reboot."""
        self.off = False
        self._seq = 0
        self._dropped = 0

    def take(self) -> bytes:
        """Return the bytes sent since the last call."""
        out = bytes(self._out)
        self._out.clear()
        return out

    def send_raw(self, data: bytes) -> None:
        """Send bytes that are no frame of ours, or frames that are ready."""
        if not self.off:
            self._out += self._channel.carry(data, self._schedule.active)

    def send(self, message: BoardMessage) -> None:
        """Send one message."""
        frame = encode_message(message, self._seq)
        self._seq += 1
        self.send_raw(frame)

    def send_samples(self, bodies: NDArray[np.void]) -> None:
        """Send consecutive samples (`sample_frames.body_dtype`), or drop what finds no room."""
        self._make_absurd(bodies)
        lost = self.countdown.take("dropped", bodies.size)
        self._dropped += lost
        bodies = bodies[lost:]
        fitting = bodies.size
        if self.room is not None:
            fitting = max(0, (self.room - len(self._out) - _EVENT_ROOM) // self._frame_length)
        sent = bodies[:fitting]
        if sent.size:
            if self._dropped:
                sent["flags"][0] |= SampleFlag.DROPPED_BEFORE
                self.tell_dropped(int(sent["time_us"][0]))
            frames = encode_samples(sent, self._seq)
            self._seq += sent.size
            self.send_raw(self._arrange(frames).tobytes())
        self._dropped += bodies.size - sent.size

    def tell_dropped(self, time_us: int) -> None:
        """Report what was dropped and not yet told: before the next sample, or where a run of samples ends."""
        if self._dropped:
            self.send(BoardEvent(time_us, EventCode.SAMPLES_DROPPED, self._dropped))
            self._dropped = 0

    def _make_absurd(self, bodies: NDArray[np.void]) -> None:
        """Put values into good frames that cannot be: too much pressure, too many counts, dark above lit."""
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
        """Lose, repeat or swap whole frames, where a fault says so."""
        if not self.countdown.left and not len(self._held):
            return frames
        frames = frames[self.countdown.take("index_gap", len(frames)) :]
        twice = self.countdown.take("duplicate", len(frames))
        frames = np.concatenate([self._held, np.repeat(frames[:twice], 2, axis=0), frames[twice:]])
        swapped = 2 * self.countdown.take("reorder", len(frames) // 2)
        rest = frames[swapped:]
        self._held = frames[:0]
        if "reorder" in self.countdown.left:  # one is left over: its partner is still to come
            self._held, rest = rest, rest[:0]
        return np.concatenate([frames[np.arange(swapped) ^ 1], rest])
