"""Read the rows in single pages of an SQLite database, without the tree that leads to them.

The format: sqlite.org/fileformat2.html. Rows of a recording are added and never removed, so an older image of a page
holds rows that are still true. To which table a row belongs follows from the number and the types of its values.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import Any

from protocol.recording import schema
from protocol.recording.checks import MAX_VALUE_BYTES, value_fits

Row = tuple[Any, ...]
PageImage = Callable[[int], bytes | None]

_LEAF = 0x0D
_WHOLE_BYTES = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8}  # of an integer, by its serial type


def rows_of_page(page: bytes, image: PageImage, done: set[int]) -> Iterator[tuple[str, Row]]:
    """Give table and row of each cell that can be read; nothing where the page is not a leaf of a table.

    `image`: returns the content of another page, for long rows. `done`: first overflow pages of the long rows that were
    given; they are not read again.
    """
    if page[:1] != bytes([_LEAF]):
        return
    last = None
    for at in struct.unpack_from(f">{min(int.from_bytes(page[3:5], 'big'), len(page) // 4)}H", page, 8):
        try:
            found = _row(page, at, image, done)
        except (ValueError, IndexError, struct.error):  # not a cell
            continue
        if found is None:
            continue
        if last is not None and found[1][0] <= last:
            return
        last = found[1][0]
        yield found


def _row(page: bytes, at: int, image: PageImage, done: set[int]) -> tuple[str, Row] | None:
    size, at = _varint(page, at)
    number, at = _varint(page, at)
    content, overflow = _payload(page, at, size, image, done)
    found = _identified(number, _values(content))
    if found is not None and overflow:
        done.add(overflow)
    return found


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value = 0
    for n in range(8):
        value = value << 7 | data[at + n] & 0x7F
        if data[at + n] < 0x80:
            return value, at + n + 1
    value = value << 8 | data[at + 8]
    return value - (value >> 63 << 64), at + 9


def _payload(page: bytes, at: int, size: int, image: PageImage, done: set[int]) -> tuple[bytes, int]:
    """Return the content of a cell, joined from its overflow pages, and the first of these; 0 without."""
    usable = len(page)
    if not 0 < size <= MAX_VALUE_BYTES:
        raise ValueError
    if size <= usable - 35:
        return _exactly(page[at : at + size], size), 0
    least = (usable - 12) * 32 // 255 - 23
    here = least + (size - least) % (usable - 4)
    here = here if here <= usable - 35 else least
    parts, left = [page[at : at + here]], size - here
    first = following = int.from_bytes(page[at + here : at + here + 4], "big")
    if first in done:
        raise ValueError
    while left > 0:
        overflow = image(following) if following else None
        if overflow is None:
            raise ValueError
        following = int.from_bytes(overflow[:4], "big")
        parts.append(overflow[4 : 4 + left])
        left -= len(parts[-1])
    return _exactly(b"".join(parts), size), first


def _exactly(content: bytes, size: int) -> bytes:
    if len(content) != size:
        raise ValueError
    return content


def _values(content: bytes) -> list[Any]:
    end, at = _varint(content, 0)
    kinds = []
    while at < end:
        kind, at = _varint(content, at)
        kinds.append(kind)
    values: list[Any] = []
    for kind in kinds:
        n = 8 if kind == 7 else _WHOLE_BYTES.get(kind, max(0, (kind - 12) // 2))
        piece = _exactly(content[at : at + n], n)
        at += n
        if kind in _WHOLE_BYTES:
            values.append(int.from_bytes(piece, "big", signed=True))
        elif kind == 7:
            values.append(struct.unpack(">d", piece)[0])
        elif kind >= 12:
            values.append(piece.decode() if kind % 2 else piece)
        else:
            values.append({0: None, 8: 0, 9: 1}[kind] if kind in (0, 8, 9) else _exactly(b"", 1))
    return values


def _identified(number: int, values: list[Any]) -> tuple[str, Row] | None:
    """Return the table whose columns the values fit, and the row with its key."""
    if not values or values[0] is not None or number < 1:  # the key stands for the first column
        return None
    for table, columns in {**schema.layout(), **schema.optional_layout()}.items():
        kinds = list(columns.values())
        added = sum(name == table for since in schema.ADDED.values() for name, _, _ in since)
        if not len(kinds) - added <= len(values) <= len(kinds):
            continue
        row = [number, *values[1:], *[None] * (len(kinds) - len(values))]
        pairs = zip(kinds, row, strict=True)
        row = [float(value) if kind == "REAL" and isinstance(value, int) else value for (kind, _), value in pairs]
        if next(iter(columns)) == "id" and all(map(value_fits, kinds, row)):
            return table, tuple(row)
    return None
