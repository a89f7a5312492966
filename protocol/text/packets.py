"""Packets of the PSoC 'Bridge Control Panel', as its RX8 format string describes them: bytes in, rows of numbers out.

    RX8 [h=43] @1P @0P @1S1 @0S1 @1S2 @0S2 [t=00]

`[h=...]` are the header's bytes in hexadecimal, `[t=...]` the tail's (one may be missing); between them one mark a
byte: `@nNAME` is byte n of variable NAME, 0 the lowest, and `x` a byte to skip. A variable has 1 to 4 bytes in any
order. Case matters in names only.

There is no checksum: only a lost or added byte is detected. So a packet counts when its header and tail fit and the
next packet's header follows (the whole next packet until synchronised): samples are one period late, and the last is
not delivered. After a misfit the search continues one byte after the failed start, so that a header byte among the data
costs no packet.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from protocol.base.errors import ProfileError
from protocol.link.framing import ByteReader

_FORMAT = re.compile(r"\s*rx8\s+(?:\[h=(?P<head>[^\]]*)\])?(?P<body>[^\[\]]*)(?:\[t=(?P<tail>[^\]]*)\])?\s*", re.I)
_MARK = re.compile(r"@(\d)([A-Za-z_]\w*)")
_PACKET_MAX = 200  # bytes


@dataclass(frozen=True, slots=True)
class PacketFormat:
    """A parsed format string; `variables` are (name, offsets of its bytes, lowest first)."""

    head: bytes
    tail: bytes
    length: int
    variables: tuple[tuple[str, tuple[int, ...]], ...]


def parse_format(text: str) -> PacketFormat:
    """Return the packet of an RX8 format string. ProfileError: invalid, or a byte is missing or given twice."""
    match = _FORMAT.fullmatch(text)
    if match is None:
        remedy = "write it like RX8 [h=43] @1P @0P @1S1 @0S1 @1S2 @0S2 [t=00]"
        raise ProfileError(f"rx8.format is not an RX8 format: {text!r:.60}", remedy)
    head, tail = _hex("h", match["head"]), _hex("t", match["tail"])
    if not head + tail:
        raise ProfileError("rx8.format has neither a header nor a tail", "add [h=..] or [t=..] to find packets by")
    places: dict[str, dict[int, int]] = {}
    marks = match["body"].split()
    for offset, mark in enumerate(marks, len(head)):
        if mark in ("x", "X"):
            continue
        byte = _MARK.fullmatch(mark)
        if byte is None:
            raise ProfileError(f"rx8.format has the unknown mark {mark!r:.60}", "marks are @nNAME and x")
        if places.setdefault(byte[2], {}).setdefault(int(byte[1]), offset) != offset:
            raise ProfileError(f"rx8.format gives {mark:.60} twice", "give each byte of a variable once")
    for name, bytes_ in places.items():
        if sorted(bytes_) != list(range(len(bytes_))) or len(bytes_) > 4:
            remedy = "a variable has one byte @0 to four, @0 to @3"
            raise ProfileError(f"rx8.format leaves out a byte of {name:.60}", remedy)
    length = len(head) + len(marks) + len(tail)
    if not places or length > _PACKET_MAX:
        cause = f"rx8.format has no variable, or more than {_PACKET_MAX} bytes"
        raise ProfileError(cause, "give one @nNAME or more, in shorter packets")
    variables = tuple((name, tuple(bytes_[n] for n in sorted(bytes_))) for name, bytes_ in places.items())
    return PacketFormat(head, tail, length, variables)


def _hex(which: str, text: str | None) -> bytes:
    try:
        return bytes.fromhex(text or "")
    except ValueError:
        cause = f"rx8.format: [{which}={text:.60}] is not hexadecimal"
        raise ProfileError(cause, "write bytes like 43 or 0D 0A") from None


class PacketReader(ByteReader):
    """Bytes in, a row of the variables for each packet out; malformed are stretches of bytes that are not a packet."""

    def __init__(self, format_: PacketFormat, signed: tuple[bool, ...]) -> None:
        super().__init__()
        self._format = format_
        self._columns = [(places, is_signed) for (_, places), is_signed in zip(format_.variables, signed, strict=True)]
        self._in_step = False
        self._searching = False

    def state(self) -> dict[str, Any]:
        """Return the decoder's memory of the bytes so far, without the counters, ready for JSON."""
        return {"rest": self._rest.hex(), "in_step": self._in_step, "searching": self._searching}

    def restore(self, state: dict[str, Any]) -> None:
        self._rest = bytes.fromhex(state["rest"])
        self._in_step, self._searching = bool(state["in_step"]), bool(state["searching"])

    def receive(self, data: bytes) -> list[list[float]]:
        """Return the values of the packets that `data` completes."""
        self.bytes += len(data)
        data = self._rest + data
        format_, at, rows = self._format, 0, []
        while True:
            # how many bytes of the next packet are needed to accept this one
            confirm = len(format_.head) if self._in_step else format_.length
            if len(data) - at < format_.length + confirm:
                break
            behind = at + format_.length
            if self._fits(data[at:behind]) and (not confirm or self._fits(data[behind : behind + confirm])):
                rows.append([float(self._value(data, at, *column)) for column in self._columns])
                self._in_step, self._searching = True, False
                at = behind
                continue
            self.malformed += not self._searching
            self._in_step, self._searching = False, True
            at += 1
        self._rest = data[at:]
        self.frames += len(rows)
        return rows

    def _fits(self, packet: bytes) -> bool:
        """Return whether a packet, or its first bytes, has the header and tail."""
        whole = len(packet) == self._format.length
        return packet.startswith(self._format.head) and (not whole or packet.endswith(self._format.tail))

    @staticmethod
    def _value(data: bytes, at: int, offsets: tuple[int, ...], signed: bool) -> int:
        return int.from_bytes(bytes(data[at + offset] for offset in offsets), "little", signed=signed)
