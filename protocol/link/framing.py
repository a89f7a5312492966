"""Frames: COBS with a 00 behind each, a CRC-32 inside (protocol/SPEC.md, "Carrier and framing").

The link carries `COBS(body) 00`, body = type, seq, payload, CRC-32 little-endian. Rules of this file:

- A frame ends at a 00 and nowhere else, so that any damage costs the frame it hits (two, if it hits the 00 between).
- Damage is never an error: it is counted under one of four names, and decoding continues.
- How the bytes are cut into chunks changes neither a frame nor a count.
- CRC(body with its CRC at the end) is the constant 0x2144DF1C for a good body and no other: one call checks a frame,
  and a whole chunk is split, decoded and checked by C code (`bytes.split`, `cobs`, `zlib`) without a loop in Python.
"""

from __future__ import annotations

from dataclasses import dataclass
from inspect import isbuiltin
from itertools import accumulate, compress
from typing import Any
from zlib import crc32

from cobs import cobs

from protocol.base.errors import RequestError

BODY_MIN = 6  # type, seq, CRC
BODY_MAX = 200
COLLECT_MAX = 210  # bytes without a 00 that a receiver keeps
RESIDUE = 0x2144DF1C  # CRC-32 of anything followed by its own CRC-32


def is_compiled() -> bool:
    """Return whether cobs has its compiled part; without it frames are decoded in Python, a tenth as fast."""
    return isbuiltin(cobs.decode)


@dataclass(frozen=True, slots=True)
class Frame:
    """One good frame without its checksum: `type` and `seq` 0 to 255."""

    type: int
    seq: int
    payload: bytes


def encode_frame(type_: int, seq: int, payload: bytes = b"") -> bytes:
    """Return a frame with its closing 00, `seq` modulo 256. RequestError: no byte, or a payload over 194 bytes."""
    if not 0 <= type_ <= 0xFF or len(payload) > BODY_MAX - BODY_MIN:
        raise RequestError(f"no frame can hold type {type_} with {len(payload)} bytes of payload")
    body = bytes((type_, seq & 0xFF)) + payload
    return bytes(cobs.encode(body + crc32(body).to_bytes(4, "little"))) + b"\0"


class ByteReader:
    """The incomplete rest of a byte stream and its counters: the base of every reader of frames, lines or packets."""

    def __init__(self) -> None:
        self._rest = b""
        self._skipping = False  # in an oversize run, until its end
        self.bytes = 0
        self.frames = 0  # good ones
        self.crc_errors = 0
        self.malformed = 0
        self.oversize = 0

    @property
    def counters(self) -> dict[str, int]:
        """The counters under their names in `LinkStatistics`."""
        return {name: getattr(self, name) for name in ("bytes", "frames", "crc_errors", "malformed", "oversize")}

    def state(self) -> dict[str, Any]:
        """Return the decoder's memory of the bytes so far, without the counters, ready for JSON."""
        return {"rest": self._rest.hex(), "skipping": self._skipping}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from the `state` of another reader."""
        self._rest, self._skipping = bytes.fromhex(state["rest"]), bool(state["skipping"])


class FrameReader(ByteReader):
    """Bytes in, good frames out. Malformed: not COBS, or a wrong length; oversize: over 210 bytes without a 00."""

    def receive(self, data: bytes) -> list[Frame]:
        """Return the frames that `data` completes, in order."""
        return [Frame(body[0], body[1], body[2:-4]) for body in self.receive_bodies(data)]

    def receive_bodies(self, data: bytes, ends: list[int] | None = None) -> list[bytes]:
        """Return the good bodies (type, seq, payload, CRC) that `data` completes; `ends` receives their ends in it."""
        self.bytes += len(data)
        start = 0
        if self._skipping:
            start = data.find(b"\0") + 1
            if not start:
                return []
            self._skipping = False
        runs = (self._rest + data[start:]).split(b"\0")
        offsets = None if ends is None else list(accumulate(map(len, runs), lambda end, length: end + length + 1))
        shift = start - len(self._rest) + 1
        self._rest = runs.pop()
        if len(self._rest) > COLLECT_MAX:
            self._rest, self._skipping = b"", True
            self.oversize += 1
        good, bodies = self._good_bodies(runs)
        if ends is not None and offsets is not None:
            ends += [offset + shift for offset in compress(offsets, good)]
        self.frames += len(bodies)
        return bodies

    def _good_bodies(self, runs: list[bytes]) -> tuple[list[bool] | list[bytes], list[bytes]]:
        """Return which runs are good frames (as truth values), and the bodies of those."""
        if runs and all(runs):  # else there are empty frames, which are legal and ignored
            try:
                bodies = list(map(cobs.decode, runs))
            except cobs.DecodeError:
                return self._good_among(runs)
            lengths = set(map(len, bodies))
            if min(lengths) >= BODY_MIN and max(lengths) <= BODY_MAX and set(map(crc32, bodies)) == {RESIDUE}:
                return runs, bodies
        return self._good_among(runs)

    def _good_among(self, runs: list[bytes]) -> tuple[list[bool], list[bytes]]:
        """Return the same for runs that are not all good, and count the others."""
        tested = [self._test(run) if run else None for run in runs]
        return [body is not None for body in tested], [body for body in tested if body is not None]

    def _test(self, run: bytes) -> bytes | None:
        if len(run) > COLLECT_MAX:
            self.oversize += 1
            return None
        try:
            body = bytes(cobs.decode(run))
        except cobs.DecodeError:
            self.malformed += 1
            return None
        if not BODY_MIN <= len(body) <= BODY_MAX:
            self.malformed += 1
            return None
        if crc32(body) != RESIDUE:
            self.crc_errors += 1
            return None
        return body
