"""Delimited lines: bytes in, rows of numbers out, one for each good line.

Rules of this file:

- A line has exactly the profile's fields. A line that lost or gained one, whose checksum is wrong or whose number is
  none is counted, never an error: two lines run together must not pass for one.
- Comments and empty lines mean nothing.
- A line begun before we listened is not a line: where neither a checksum nor a start command vouches for the first
  one, it is dropped, since half a number is a number.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import Any

LINE_MAX = 1000  # bytes; a run without a line end beyond this is no text


@dataclass(frozen=True, slots=True)
class LineFormat:
    """How a line is written; `columns` says which fields are wanted, in the order of a row."""

    delimiter: bytes
    line_end: bytes
    decimal: bytes
    comments: tuple[bytes, ...]
    checksum: bool  # NMEA 0183: the XOR of the characters between $ and *, as two hexadecimal digits
    n_fields: int
    columns: tuple[int, ...]


class LineReader:
    """Bytes in, rows of numbers out.

    Parameters
    ----------
    format_ : of the lines.
    first_is_whole : whether the first line was listened to from its begin.
    """

    def __init__(self, format_: LineFormat, *, first_is_whole: bool) -> None:
        self._format = format_
        self._rest = b""
        self._skipping = not (first_is_whole or format_.checksum)
        self.frames = 0
        self.malformed = 0
        self.crc_errors = 0
        self.oversize = 0

    def state(self) -> dict[str, Any]:
        """Return what is remembered of the bytes so far, without the counters, ready for JSON."""
        return {"rest": self._rest.hex(), "skipping": self._skipping}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on where another reader's `state` was taken."""
        self._rest, self._skipping = bytes.fromhex(state["rest"]), bool(state["skipping"])

    def receive(self, data: bytes) -> list[list[float]]:
        """Return the values of the good lines that `data` completes."""
        lines = (self._rest + data).split(self._format.line_end)
        self._rest = lines.pop()
        if lines and self._skipping:
            del lines[0]
            self._skipping = False
        if len(self._rest) > LINE_MAX:
            self.oversize += not self._skipping
            self._rest, self._skipping = b"", True
        rows = [row for line in lines if (row := self._row(line)) is not None]
        self.frames += len(rows)
        return rows

    def _row(self, line: bytes) -> list[float] | None:
        line = line.strip()
        if not line or line.startswith(self._format.comments):
            return None
        if len(line) > LINE_MAX:
            self.oversize += 1
            return None
        if self._format.checksum:
            line, good = self._checked(line)
            if not good:
                self.crc_errors += 1
                return None
        fields = line.split(None if self._format.delimiter == b" " else self._format.delimiter)
        if len(fields) != self._format.n_fields:
            self.malformed += 1
            return None
        try:
            return [self._number(fields[at]) for at in self._format.columns]
        except ValueError:
            self.malformed += 1
            return None

    def _number(self, text: bytes) -> float:
        """Return a number as a device prints it; Python's own 1_000 is none."""
        if b"_" in text:
            raise ValueError
        return float(text.replace(self._format.decimal, b"."))

    @staticmethod
    def _checked(line: bytes) -> tuple[bytes, bool]:
        """Return the line between $ and *, and whether its checksum is right."""
        text, star, digits = line.removeprefix(b"$").rpartition(b"*")
        try:
            return text, bool(star) and len(digits) == 2 and reduce(xor, text, 0) == int(digits, 16)
        except ValueError:
            return text, False
