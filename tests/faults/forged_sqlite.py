"""SQLite files that SQLite itself never writes, made byte by byte."""

from __future__ import annotations

import sqlite3
import struct
from contextlib import closing
from pathlib import Path

JOURNAL = bytes.fromhex("d9d505f920a163d7")  # begins SQLite's rollback journal, and ends one that names another file


def varint(number: int) -> bytes:
    """Return a number as SQLite stores it, up to 28 bits."""
    groups = [number >> shift & 127 for shift in (21, 14, 7, 0)]
    while len(groups) > 1 and not groups[0]:
        del groups[0]
    return bytes([*(group | 128 for group in groups[:-1]), groups[-1]])


def shared_pages(path: Path, rows: int) -> None:
    """Let many rows of `block` share the pages of one long value: a file of 4 MB that claims 4 MB x `rows`."""
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        db.execute("PRAGMA journal_mode=DELETE")
        db.execute("DELETE FROM block")
        db.execute(
            "INSERT INTO block VALUES (1, 1, 1, 10, 0, 1, zeroblob(4002153), NULL)"
        )  # 489 bytes of it in its cell
        (root,) = db.execute("SELECT rootpage FROM sqlite_schema WHERE name = 'block'").fetchone()
    content = bytearray(path.read_bytes())
    page = content[4096 * (root - 1) : 4096 * root]
    (at,) = struct.unpack(">H", page[8:10])
    head = next(n for n in range(1, 5) if not page[at + n - 1] & 128)
    size, payload = bytes(page[at : at + head]), bytes(page[at + head + 1 :])
    pages = 1 + rows // 7
    leaves = []
    for first in range(1, 7 * pages, 7):
        leaf, top, cells = bytearray(4096), 4096, []
        for key in range(first, first + 7):
            cell = size + varint(key) + payload
            top -= len(cell)
            leaf[top : top + len(cell)] = cell
            cells.append(top)
        leaf[:8] = struct.pack(">BHHHB", 13, 0, 7, top, 0)
        leaf[8:22] = struct.pack(">7H", *cells)
        leaves.append(bytes(leaf))
    inner, top, cells = bytearray(4096), 4096, []
    last = len(content) // 4096
    for number in range(pages - 1):
        cell = struct.pack(">I", last + 1 + number) + varint(7 * (number + 1))
        top -= len(cell)
        inner[top : top + len(cell)] = cell
        cells.append(top)
    inner[:12] = struct.pack(">BHHHBI", 5, 0, len(cells), top, 0, last + pages)
    inner[12 : 12 + 2 * len(cells)] = struct.pack(f">{len(cells)}H", *cells)
    content[4096 * (root - 1) : 4096 * root] = inner
    content += b"".join(leaves)
    content[28:32] = struct.pack(">I", len(content) // 4096)
    path.write_bytes(content)


def journal_that_names(path: Path, other: Path) -> Path:
    """Write a journal beside a database, as if a transaction over several files, `other` among them, had been cut."""
    content, nonce = path.read_bytes(), 12_345
    head = JOURNAL + struct.pack(">5I", 1, nonce, len(content) // 4096, 512, 4096)
    page = content[:4096]
    checksum = (nonce + sum(page[at] for at in range(4096 - 200, 0, -200))) & 0xFFFFFFFF
    body = head.ljust(512, b"\0") + struct.pack(">I", 1) + page + struct.pack(">I", checksum)
    name = str(other).encode()
    names = struct.pack(">I", 2**30 // 4096 + 1) + name + struct.pack(">II", len(name), sum(name)) + JOURNAL
    journal = path.with_name(path.name + "-journal")
    journal.write_bytes(body.ljust(-(-len(body) // 512) * 512, b"\0") + names)
    return journal
