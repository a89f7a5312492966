"""Read SQLite's write-ahead log beyond a damaged frame, which ends it for SQLite, and tell whether it is whole.

The formats: sqlite.org/fileformat2.html#walformat and sqlite.org/walformat.html. The checksum of a frame continues that
of the frame before, which is stored in the latter's header. So each frame can be checked by itself, and what follows a
damaged one is used.
"""

from __future__ import annotations

import enum
import re
import sqlite3
import struct
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from protocol.base.arrays import BoolArray, IntArray
from protocol.base.errors import damaged
from protocol.recording.checks import DAMAGE, harden
from protocol.recording.page_rows import PageImage, Row, rows_of_page
from protocol.recording.schema import LOG_MAGIC, PAGE_SIZES, needs_log

_HEADER_BYTES, _FRAME_BYTES = 32, 24
_OLDER = 1 << 20  # the first salt grows by one where the log begins again over its older frames
_INDEX_VERSION, _INDEX_HEADER = 3007000, 48
_UUID = re.compile(rb'uuid("[0-9a-f-]{36}")')  # a row of the table `session`, whose leaves begin with this byte:
_KEY_LEAF = b"\n"
_RESTARTS = 64  # of the log, between what a computer that lost its power had kept of -shm and of -wal

Words = NDArray[np.uint32]


@dataclass(frozen=True, slots=True, eq=False)
class WriteAheadLog:
    """The full-length frames of a log since it last began, and apart from them those that are left of before."""

    frames: NDArray[np.uint8]  # a row each: header and page
    pages: IntArray  # number of the page in each frame
    sizes: IntArray  # pages of the database after a commit, 0 in a frame that ends none
    valid: BoolArray
    sound: BoolArray  # valid, with a header that is intact, without which SQLite reads no further
    unproven: BoolArray  # not valid where nothing but the header of the frame before may be damaged
    header_valid: bool
    salts: tuple[int, int] | None  # None where no frame tells
    older: NDArray[np.uint8]  # verified frames of before, whose pages went into the database

    @property
    def damage(self) -> list[str]:
        """What a killed program does not leave; empty for a sound log."""
        found = [] if self.header_valid or not len(self.frames) else ["the header of the log is damaged"]
        return found + [f"frame {k + 1} of the log cannot be verified" for k in np.flatnonzero(~self.sound)]

    @property
    def first_behind_damage(self) -> int:
        """Number of the first frame behind the commit in which the last damaged frame may be."""
        bad, ends = np.flatnonzero(~self.valid), np.flatnonzero(self.valid & (self.sizes > 0))
        last = bad[-1] if len(bad) else -1
        return next((int(end) + 1 for end in ends if end > last), len(self.frames)) if len(bad) else 0

    @property
    def page_size(self) -> int:
        """Bytes of a page."""
        return int(self.frames.shape[1]) - _FRAME_BYTES

    def image(self, frame: int) -> bytes:
        """Return the page in a frame."""
        return self.frames[frame, _FRAME_BYTES:].tobytes()

    def committed(self) -> int:
        """Return the number of frames up to the last valid one that ends a commit."""
        ends = np.flatnonzero(self.valid & (self.sizes > 0))
        return int(ends[-1]) + 1 if len(ends) else 0

    def newest(self, database: NDArray[np.uint8]) -> dict[int, int]:
        """Return the frame of the newest valid image of each page, where it may be newer than the database's.

        Parameters
        ----------
        database : the database's pages, a row each.
        """
        valid = [k for k in range(self.committed()) if self.valid[k]]
        copied = self._copied(database, valid)
        return {int(self.pages[k]): k for k in valid if k >= copied}

    def _copied(self, database: NDArray[np.uint8], valid: list[int]) -> int:
        """Return how many frames are in the database already: it may hold images whose frames are damaged."""

        def is_there(k: int) -> bool:
            page = int(self.pages[k]) - 1
            return 0 <= page < len(database) and bool((database[page] == self.frames[k, _FRAME_BYTES:]).all())

        upto = next((k + 1 for k in reversed(valid) if is_there(k)), 0)
        last = {int(self.pages[k]): k for k in valid if k < upto}
        return upto if all(map(is_there, last.values())) else 0


def read_log(database: Path) -> WriteAheadLog | None:
    """Return the log beside a database; None where there is none, or one without a header."""
    path = database.with_name(database.name + "-wal")
    if path.is_symlink() or not path.is_file() or path.stat().st_size < _HEADER_BYTES:
        return None
    content: NDArray[np.uint8] = np.memmap(path, np.uint8, "r")
    head = content[:_HEADER_BYTES].view(">u4").astype(np.int64)
    magic, _, size = head[:3]
    header_valid = magic & ~1 == LOG_MAGIC and size in PAGE_SIZES
    if header_valid:
        order = ">u4" if magic & 1 else "<u4"
        none = np.zeros((1, 2), np.uint32)
        header_valid = bool((_checksums(content[None, :24], order, none) == head[6:].astype(np.uint32)).all())
    if not header_valid:
        size = page_size_of(database)
    n = (len(content) - _HEADER_BYTES) // (_FRAME_BYTES + int(size))
    frames = content[_HEADER_BYTES : _HEADER_BYTES + n * (_FRAME_BYTES + int(size))].reshape(
        n, _FRAME_BYTES + int(size)
    )
    heads = frames[:, :_FRAME_BYTES].copy().view(">u4").astype(np.int64).reshape(n, 6)
    seeds = np.concatenate([head[None, 6:], heads[:-1, 4:]]).astype(np.uint32)[:n]
    orders = (order,) if header_valid else ("<u4", ">u4")
    verified = (_verified(frames, heads, seeds, order) for order in orders)
    ok, proven = max(verified, key=lambda found: np.count_nonzero(found[0]))
    salts = head[4:6] if header_valid else _first_salts(heads, ok)
    n = _current(heads, salts)
    n -= _never_committed(heads[:n], salts, ok[:n])
    behind = np.concatenate([[not header_valid], ~ok[:-1]])[: len(ok)]
    sound = ok & ~proven & (heads[:, 2:4] == salts).all(axis=1)
    unproven = ~ok & behind & (heads[:, 2:4] == salts).all(axis=1)
    known = None if salts[0] < 0 else (int(salts[0]), int(salts[1]))
    return WriteAheadLog(
        frames[:n],
        heads[:n, 0],
        heads[:n, 1],
        ok[:n],
        sound[:n],
        unproven[:n],
        bool(header_valid),
        known,
        frames[n:][ok[n:]],
    )


class LogState(enum.StrEnum):
    """What the -shm and the database say of a log."""

    NONE = "none"  # there is none, and none is needed
    WHOLE = "whole"
    UNPROVEN = "unproven"  # no -shm shows that it is whole
    SHORT = "short"
    ABSENT = "absent"
    FOREIGN = "foreign"  # of another recording, or of another state of this one


@dataclass(frozen=True, slots=True)
class LogCheck:
    """How much of a recording's log is there."""

    state: LogState
    missing: int | None = 0  # committed pages; None where it is unknown how many
    usable: bool = True  # whether the database is not newer than the log
    end_known: bool | None = None  # whether nothing is lost at the end; None where the rows tell

    def fault(self, name: str) -> str:
        """Return cause and remedy for the recording of this name; empty where nothing is known to be missing."""
        count = "1 committed page is" if self.missing == 1 else f"{self.missing} committed pages are"
        pages = f": {count} missing" if self.missing else ""
        remedy = f"Put {name}-wal of this recording beside {name}, and recover {name} again."
        if self.state is LogState.FOREIGN:
            remedy = remedy if self.missing != 0 else "Move it elsewhere; none is needed."
            return f"{name}-wal does not belong to {name}, and nothing of it is used{pages}. {remedy}"
        if self.state is LogState.SHORT:
            return f"{name}-wal is incomplete{pages}. {remedy}"
        if self.state is LogState.ABSENT and self.missing:
            return f"{name}-wal is absent{pages}. {remedy}"
        return ""


OTHERS_LOG = LogCheck(LogState.FOREIGN, None, end_known=False)


def check_log(database: Path, log: WriteAheadLog | None) -> LogCheck:
    """Compare a log with the -shm of the program that wrote it, and with the database, before SQLite changes them."""
    checked = _check_extent(database, log)
    if log is not None and checked.state in (LogState.WHOLE, LogState.UNPROVEN) and _is_anothers(database, log):
        return OTHERS_LOG
    return checked


def open_alone(database: Path) -> sqlite3.Connection:
    """Open a database without its log."""
    connection = sqlite3.connect(f"{database.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
    harden(connection)
    return connection


def _is_anothers(database: Path, log: WriteAheadLog) -> bool:
    """Return whether a log is another recording's: by its name, its chunks, or pages that would have to be in it."""
    pages = pages_of(database, log.page_size)
    newest = log.newest(pages)
    images = {page: log.image(frame) for page, frame in newest.items()}
    unproven = (log.image(int(frame)) for frame in np.flatnonzero(log.unproven))
    with suppress(*DAMAGE), closing(open_alone(database)) as alone:
        own = alone.execute("SELECT value FROM session WHERE key = 'uuid'").fetchone() or ("",)
        agree = {name in own for name in _named(images.values())} | {
            _is_stored(alone, row)
            for row in _chunks(images, lambda page: images.get(page) or pages[page - 1 : page].tobytes())
        }
        agree = (agree - {None}) or {name in own for name in _named(unproven)}
        if agree:
            return False in agree
    written = int(log.sizes[log.committed() - 1]) if log.committed() else 0
    absent = set(range(len(pages) + 1, written + 1)).difference(log.pages.tolist())
    whole = int.from_bytes(pages[0, 28:32].tobytes(), "big") == len(pages)
    return whole and len(absent) > int(np.count_nonzero(~log.valid))


def _named(pages: Iterable[bytes]) -> Iterator[str]:
    """Give the identifiers of recordings in pages of `session`."""
    for page in pages:
        yield from (found[1].decode() for found in _UUID.finditer(page if page[:1] == _KEY_LEAF else b""))


def _chunks(images: Mapping[int, bytes], image: PageImage) -> Iterator[Row]:
    """Give the rows of `chunk` in single pages that match their checksums."""
    done: set[int] = set()
    for page in images.values():
        found = rows_of_page(page, image, done)
        yield from (row for table, row in found if table == "chunk" and crc32(row[3]) == row[4])


def _is_stored(alone: sqlite3.Connection, row: Row) -> bool | None:
    """Return whether a file holds a chunk under its number; None where it holds none that can be compared."""
    sql = "SELECT id, host_ns, direction, raw, crc32 FROM chunk WHERE id = ?"
    stored = alone.execute(sql, (row[0],)).fetchone()
    return None if stored is None or crc32(stored[3]) != stored[4] else stored == row


def _check_extent(database: Path, log: WriteAheadLog | None) -> LogCheck:
    """Compare the length of a log with what -shm says of it."""
    committed = 0 if log is None else log.committed()
    if not needs_log(database):
        empty = log is None or (log.header_valid and not len(log.frames))
        return LogCheck(LogState.NONE if empty else LogState.FOREIGN)
    index = _read_index(database)
    if index is None:
        return (
            LogCheck(LogState.UNPROVEN, None, end_known=False)
            if committed
            else LogCheck(LogState.ABSENT, None, end_known=False)
        )
    frames, copied, salts = index
    if log is not None and log.salts not in (None, salts):
        restarts = (log.salts[0] - salts[0] + _RESTARTS) % (1 << 32) - _RESTARTS
        if 0 < restarts <= _RESTARTS:  # the index is older: the computer lost its power
            return LogCheck(LogState.UNPROVEN, None, end_known=False)
        if restarts != -1 or frames:  # else the log is about to begin again, and all of it is in the database
            return LogCheck(LogState.FOREIGN, frames - copied, end_known=frames == copied)
    if committed >= frames or (log is None and copied >= frames):
        return LogCheck(LogState.WHOLE if committed else LogState.NONE)
    state = LogState.SHORT if log is not None else LogState.ABSENT
    missing = frames - max(committed, copied)
    return LogCheck(state, missing, committed >= copied, end_known=not missing)


def _read_index(database: Path) -> tuple[int, int, tuple[int, int]] | None:
    """Return how many frames were committed, how many of them are in the database, and the salts of the log.

    None where there is no -shm that was written with a commit; a reader builds one from whatever log it finds.
    """
    path = database.with_name(database.name + "-shm")
    if path.is_symlink() or not path.is_file():
        return None
    with path.open("rb") as file:
        content = file.read(2 * _INDEX_HEADER + 4)
    for start in (_INDEX_HEADER, 0):  # the second is written first
        head = content[start : start + _INDEX_HEADER]
        for order in "<>" if len(content) == 2 * _INDEX_HEADER + 4 else "":
            version, _, change, *_ = words = struct.unpack(f"{order}12I", head)
            summed = _checksums(np.frombuffer(head[:40], np.uint8)[None], f"{order}u4", np.zeros((1, 2), np.uint32))
            if version == _INDEX_VERSION and change and head[12] == 1 and summed[0].tolist() == list(words[10:]):
                (copied,) = struct.unpack(f"{order}I", content[-4:])
                return words[4], min(copied, words[4]), struct.unpack(">2I", head[32:40])
    return None


def fault_of_log(database: Path) -> str:
    """Return why SQLite would not read all of the log of a recording that no program writes; empty if it would."""
    log = read_log(database)
    fault = check_log(database, log).fault(database.name) if database.is_file() else ""
    if not fault and log is not None and log.damage:
        return f"{log.damage[0]}; what follows is not read without recovery"
    return fault


def end_may_be_missing(database: Path) -> bool:
    """Return whether a reader of a recording that no program writes may not see its end; raise if it sees another's."""
    log = read_log(database)
    checked = check_log(database, log)
    if checked.state is LogState.FOREIGN:
        raise damaged(database, f"was not closed: {checked.fault(database.name)}")
    return (log is not None and bool(log.damage)) or checked.end_known is False


def pages_of(database: Path, size: int) -> NDArray[np.uint8]:
    """Return the whole pages of a database, a row each."""
    content: NDArray[np.uint8] = np.memmap(database, np.uint8, "r")
    return content[: len(content) // size * size].reshape(-1, size)


def page_size_of(database: Path) -> int:
    """Return the size of a database's pages; SQLite's usual one where its header does not tell."""
    with database.open("rb") as file:
        size = int.from_bytes(file.read(18)[16:18], "big")
    size = 65536 if size == 1 else size
    return size if size in PAGE_SIZES else 4096


def _verified(frames: NDArray[np.uint8], heads: IntArray, seeds: Words, order: str) -> tuple[BoolArray, BoolArray]:
    """Return which frames match their checksum, by the stored one of the frame before, or by its computed one.

    And of which frames the stored checksum is damaged.
    """
    stored = heads[:, 4:].astype(np.uint32)
    computed = np.empty_like(stored)
    for start in range(0, len(frames), 1000):
        rows = slice(start, start + 1000)
        summed = np.concatenate([frames[rows, :8], frames[rows, _FRAME_BYTES:]], axis=1)
        computed[rows] = _checksums(summed, order, seeds[rows])
    ok: BoolArray = (computed == stored).all(axis=1)
    proven = np.zeros(len(ok), bool)
    for k in np.flatnonzero(~ok[:-1]):  # where only its stored checksum is damaged, the next frame proves it
        summed = np.concatenate([frames[k + 1, :8], frames[k + 1, _FRAME_BYTES:]])[None]
        if (_checksums(summed, order, computed[k : k + 1]) == stored[k + 1]).all():
            ok[k : k + 2], proven[k] = True, True
    ok &= heads[:, 0] > 0  # zeros match the checksum of zeros
    return ok, proven


def _checksums(content: NDArray[np.uint8], order: str, seeds: Words) -> Words:
    """Return the two checksums of each row: s0 += x0 + s1; s1 += x1 + s0 for each two words (modulo 2^32).

    That is linear in the words and in the seed, so that all rows are summed at once.
    """
    words = np.ascontiguousarray(content).view(order).astype(np.uint32)
    a, b = 1, 0  # weights of s0, s1 before the remaining pairs in s0 behind them
    c, d = 0, 1  # and in s1
    weights = np.empty((words.shape[1], 2), np.uint32)
    for at in range(words.shape[1] - 2, -1, -2):
        weights[at] = (a + b) & 0xFFFFFFFF, (c + d) & 0xFFFFFFFF
        weights[at + 1] = b, d
        a, b = (a + b) & 0xFFFFFFFF, (a + 2 * b) & 0xFFFFFFFF
        c, d = (c + d) & 0xFFFFFFFF, (c + 2 * d) & 0xFFFFFFFF
    return words @ weights + seeds @ np.array([[a, c], [b, d]], np.uint32)


def _first_salts(heads: IntArray, ok: BoolArray) -> Any:
    """Return the salts of the first verified frame that shares them with the frame before."""
    for k in np.flatnonzero(ok):
        if k == 0 or (heads[k, 2:4] == heads[k - 1, 2:4]).all():
            return heads[k, 2:4]
    return np.array([-1, -1])


def _never_committed(heads: IntArray, salts: IntArray, ok: BoolArray) -> int:
    """Return how many frames at the end belong to a commit whose last frame was not begun.

    The page of the last one may be of before: a killed program had written its header only.
    """
    ends = np.flatnonzero(ok & (heads[:, 1] > 0))
    rest = heads[int(ends[-1]) + 1 if len(ends) else 0 :]
    begun = (rest[:, 1] == 0).all() and (rest[:, 2:4] == salts).all()
    return len(rest) if begun and len(ends) else 0


def _current(heads: IntArray, salts: IntArray) -> int:
    """Return the number of frames before those that an earlier beginning of the log left."""
    ours = np.flatnonzero((heads[:, 2:4] == salts).all(axis=1))
    n = int(ours[-1]) + 1 if len(ours) else 0
    while n < len(heads) and not 0 < (salts[0] - heads[n, 2]) % (1 << 32) < _OLDER:
        n += 1
    return n
