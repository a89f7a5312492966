"""Delimited lines: bytes in, rows of numbers out, one for each good line.

Rules of this file:

- A line has exactly the profile's fields. A line with one more or less, a wrong checksum or an invalid number is
  counted, never an error: two lines run together must not pass for one.
- Comments and empty lines are ignored.
- The first line may be incomplete: unless a checksum or a start command protects it, it is dropped, since half a number
  is still a number.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from operator import xor

from protocol.link.framing import ByteReader

LINE_MAX = 1000  # bytes; a longer run without a line end is not text


@dataclass(frozen=True, slots=True)
class LineFormat:
    """The syntax of a line; `columns` are the fields of a row, in its order."""

    delimiter: bytes
    line_end: bytes
    decimal: bytes
    comments: tuple[bytes, ...]
    checksum: bool  # NMEA 0183: the XOR of the characters between $ and *, as two hexadecimal digits
    n_fields: int
    columns: tuple[int, ...]


class LineReader(ByteReader):
    """Bytes in, rows of numbers out.

    Parameters
    ----------
    format_ : of the lines.
    first_is_whole : whether the first line is received from its beginning.
    """

    def __init__(self, format_: LineFormat, *, first_is_whole: bool) -> None:
        super().__init__()
        self._format = format_
        self._skipping = not (first_is_whole or format_.checksum)

    def receive(self, data: bytes) -> list[list[float]]:
        """Return the values of the good lines that `data` completes."""
        self.bytes += len(data)
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
        """Return a number as a device prints it; Python's own 1_000 is refused."""
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
