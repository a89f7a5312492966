"""Readers of delimited lines of other firmware: bytes in, rows of numbers out, one for each good line.

A line has exactly the profile's fields, in order, with labels in any order (`p=12.5 s1=420`), as JSON, or of one width
with nothing between. A line with one more or less, a wrong checksum or an invalid number is counted, never an error:
two lines run together must not pass for one. Comments and empty lines are ignored. The first line may be incomplete: it
is dropped unless a checksum or a start command protects it, since half a number is still a number.
"""

from __future__ import annotations

import json
import math
from binascii import crc_hqx
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import Any, Literal

from protocol.link.framing import ByteReader

LineStyle = Literal["columns", "labels", "json", "width"]
LINE_MAX = 1000  # bytes; a longer run without a line end is not text


@dataclass(frozen=True, slots=True)
class FieldText:
    """How a field is printed: its label, the base of its number, what follows the number."""

    label: bytes = b""
    base: int = 10
    suffix: bytes = b""
    signed: bool = False  # whether a hexadecimal number is a two's complement of its digits


@dataclass(frozen=True, slots=True)
class LineFormat:
    """The syntax of a line; `columns` are the fields of a row, in its order."""

    delimiter: bytes
    line_end: bytes
    decimal: bytes
    comments: tuple[bytes, ...]
    checksum: str  # one of `CHECKSUMS`, or empty
    n_fields: int
    columns: tuple[int, ...]
    channels: tuple[int, ...] = ()  # after them; text there is no error, but NaN
    style: LineStyle = "columns"
    assign: bytes = b"="  # between label and number
    texts: tuple[FieldText, ...] = ()  # of every field; empty where all are plain decimal numbers without a label


class LineReader(ByteReader):
    """Bytes in, rows of numbers out; `first_is_whole` if the first line is received from its beginning."""

    def __init__(self, format_: LineFormat, *, first_is_whole: bool) -> None:
        super().__init__()
        self._format = format_
        self._skipping = not (first_is_whole or format_.checksum)
        self._places = {text.label: at for at, text in enumerate(format_.texts)}
        self._split = {"labels": self._by_label, "json": self._of_json, "width": self._by_width}.get(format_.style)

    def receive(self, data: bytes) -> list[list[float]]:
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
            line, good = checked(line, self._format.checksum, self._format.delimiter)
            if not good:
                self.crc_errors += 1
                return None
        if self._split is not None:
            try:
                fields = self._split(line)
            except ValueError:
                fields = []
        else:
            fields = line.split(None if self._format.delimiter == b" " else self._format.delimiter)
        if len(fields) != self._format.n_fields:
            self.malformed += 1
            return None
        try:
            row = [self._read(fields[at], at) for at in self._format.columns]
        except ValueError:
            self.malformed += 1
            return None
        return row + [self._channel(fields[at], at) for at in self._format.channels] if self._format.channels else row

    def _by_label(self, line: bytes) -> list[bytes]:
        """Return the fields in the order of the profile; none where a label is unknown, missing or given twice.

        A number alone is the field whose label is empty.
        """
        assign, delimiter = self._format.assign, self._format.delimiter
        line = assign.join(part.strip() for part in line.split(assign))
        parts = line.split(None if delimiter == b" " else delimiter)
        pairs = [part.partition(assign) for part in parts]
        return self._in_order([(label.strip(), text) if found else (b"", label) for label, found, text in pairs])

    def _of_json(self, line: bytes) -> list[bytes]:
        """Return the values of a line of JSON in the order of the profile; those inside others by `outer.inner`."""
        try:
            return self._in_order([(label.encode(), text.encode()) for label, text in json_values(line)])
        except RecursionError:
            raise ValueError from None

    def _in_order(self, pairs: list[tuple[bytes, bytes]]) -> list[bytes]:
        found = dict(pairs)
        if len(found) != len(pairs) or found.keys() != self._places.keys():
            return []
        return [found[label] for label in self._places]

    def _by_width(self, line: bytes) -> list[bytes]:
        """Return the fields of a line of equally wide ones; none where its length differs."""
        width, rest = divmod(len(line), self._format.n_fields)
        return [] if rest or not width else [line[at : at + width] for at in range(0, len(line), width)]

    def _read(self, text: bytes, at: int) -> float:
        """Return the number of a field, as its text is described."""
        if not self._format.texts:
            return self._number(text)
        printed, text = self._format.texts[at], text.strip()
        if printed.suffix:
            if not text.endswith(printed.suffix):
                raise ValueError
            text = text[: -len(printed.suffix)]
        return self._number(text) if printed.base == 10 else hexadecimal(text, signed=printed.signed)

    def _channel(self, text: bytes, at: int) -> float:
        try:
            return self._read(text, at)
        except ValueError:
            return math.nan

    def _number(self, text: bytes) -> float:
        """Return a number as a device prints it; Python's own 1_000 is refused."""
        if b"_" in text:
            raise ValueError
        return float(text.replace(self._format.decimal, b"."))


def _modbus_table() -> list[int]:
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = byte >> 1 ^ (0xA001 if byte & 1 else 0)
        table.append(byte)
    return table


_MODBUS = _modbus_table()


def crc16_modbus(data: bytes) -> int:
    """Return the CRC-16 of Modbus: polynomial 0x8005, reflected, from 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc = crc >> 8 ^ _MODBUS[(crc ^ byte) & 0xFF]
    return crc


CHECKSUMS: dict[str, tuple[Callable[[bytes], int], int]] = {  # name -> of the characters before it, its digits
    "nmea": (lambda data: reduce(xor, data, 0), 2),
    "xor": (lambda data: reduce(xor, data, 0), 2),
    "sum": (lambda data: sum(data) & 0xFF, 2),
    "crc16": (lambda data: crc_hqx(data, 0xFFFF), 4),
    "crc16_modbus": (crc16_modbus, 4),
}


def checked(line: bytes, kind: str, delimiter: bytes) -> tuple[bytes, bool]:
    """Return the line without its hexadecimal checksum (behind *, or the last field), and whether it is right."""
    of, length = CHECKSUMS[kind]
    text, found, digits = line.removeprefix(b"$").rpartition(b"*") if kind == "nmea" else line.rpartition(delimiter)
    try:
        return text, bool(found) and len(digits) == length and of(text) == int(digits, 16)
    except ValueError:
        return text, False


def hexadecimal(text: bytes, *, signed: bool) -> float:
    """Return a hexadecimal number, with 0x or without; `signed` is two's complement. ValueError: not one."""
    digits = text.strip().lower().removeprefix(b"0x")
    if not digits.isalnum():  # no sign, no 12_34
        raise ValueError
    value = int(digits, 16)
    return float(value - (1 << 4 * len(digits)) if signed and value >> (4 * len(digits) - 1) else value)


def json_values(line: bytes | str) -> Iterator[tuple[str, str]]:
    """Yield (label, text) of the values in JSON, a nested one as `outer.inner`. ValueError: no JSON object or list."""
    content = json.loads(line)
    if not isinstance(content, dict | list):
        raise ValueError("not an object")  # noqa: TRY004 - as json reports what is not JSON

    def flat(inside: Any, label: str) -> Iterator[tuple[str, str]]:
        if isinstance(inside, dict | list):
            entries = inside.items() if isinstance(inside, dict) else enumerate(inside)
            for name, value in entries:
                yield from flat(value, f"{label}.{name}" if label else str(name))
        else:
            yield label, str(inside)

    yield from flat(content, "")
