"""Copy what can be read of a damaged recording into a new file beside it, and say what is missing.

Rules: the damaged file and its log are not touched, nor opened for writing. Rows are read by their tables first; then
from single pages, of the file and of each frame of its log, also where the tree that leads to them is damaged. Chunks
and blocks carry checksums: no byte of them that does not match is copied. Samples whose rows are lost are derived again
from the raw bytes.
"""

from __future__ import annotations

import enum
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from boat_daq.engine.recording.file import RecordingFile, Statement, set_meta, storage_error
from boat_daq.engine.recording.salvage.derive_again import derive_missing
from protocol.base.errors import RecordingError, RequestError
from protocol.recording import schema
from protocol.recording.checks import DAMAGE, bytes_of, harden, refuse_active, value_fits
from protocol.recording.damaged_log import WriteAheadLog, page_size_of, pages_of
from protocol.recording.missing import Missing
from protocol.recording.page_rows import Row, rows_of_page

Progress = Callable[[float, float], None]
_ROWS = 1_000  # of one transaction
_BYTES = 16 * 2**20
_KEYS_MAX = 1 << 40
_CHECKED = ("chunk", "block")  # tables whose rows carry a checksum
_REBUILT = ("session", "overview")


def salvage(
    path: Path, log: WriteAheadLog | None, *, end_known: bool | None, progress: Progress | None
) -> tuple[Path, list[str], Missing]:
    """Copy all that can be read into a new file; return it, what could not be read, and what is missing.

    Parameters
    ----------
    log : None where there is none, or none of it is used.
    end_known : whether nothing can be lost at the end; None where the rows tell.
    """
    target = _free_name(path)
    copy = target.with_name(target.name + "-pages")
    try:
        if log is not None:
            _write_pages(path, log, copy)
        with closing(open_damaged(path, alone=True) if log is None else open_damaged(copy)) as db:
            meta = schema.read_session(db)
            schema.session_dtype(meta)  # refuses a file whose bytes nothing describes
            file = RecordingFile.create(target, meta)
            try:
                return target, *_fill(file, db, path, log, meta, end_known, progress)
            except BaseException:
                file.abandon()
                target.unlink(missing_ok=True)
                raise
            finally:
                file.abandon()
    except DAMAGE as error:
        raise RecordingError(f"{path} cannot be read: {error}", "Use another copy.") from error
    except OSError as error:
        raise storage_error(target, error) from error
    finally:
        copy.unlink(missing_ok=True)


def _fill(
    file: RecordingFile,
    db: sqlite3.Connection,
    path: Path,
    log: WriteAheadLog | None,
    meta: dict[str, Any],
    end_known: bool | None,
    progress: Progress | None,
) -> tuple[list[str], Missing]:
    reader, dtype = _RowReader(db, bytes_of(path)), schema.session_dtype(meta)
    file.commit(set_meta(meta))
    optional = [name for name in schema.OPTIONAL_TABLES if reader.columns(name)]
    file.commit([(schema.OPTIONAL_TABLES[name], ()) for name in optional])
    tables = [*(name for name in schema.TABLE_NAMES if name not in _REBUILT), *optional]
    for done, table in enumerate(tables):
        _commit(file, _sound_rows(reader, file, table, dtype))
        if progress is not None:
            progress(done + 1, len(tables))
    pages = _Pages(path, log)
    with closing(schema.open_recording(file.path)) as kept:
        found = _scattered(kept, pages, {table: _ids(kept, table) for table in tables}, dtype)
        _commit(file, ((_insertion(table, file.columns(table)), row) for table, row in found))
        if end_known is None:
            end_known = _reaches_end(db, kept, pages)
        elif end_known:
            end_known = _is_end_kept(db, kept)
        statements, holes, blocks = derive_missing(kept, meta, end_known=end_known)
        file.commit(statements)
        rows = [(table, *gap) for table in tables if table != "block" for gap in _gaps(_ids(kept, table))]
    missing = Missing(tuple(holes), (*(("block", *keys) for keys in blocks), *rows))
    if missing:
        file.commit(set_meta({"missing": asdict(missing)}))
    return reader.lost, missing


def _insertion(table: str, names: list[str]) -> str:
    marks = ", ".join("?" * len(names))
    return f"INSERT OR IGNORE INTO {table} ({', '.join(names)}) VALUES ({marks})"  # noqa: S608 - names are the schema's


def _ids(db: sqlite3.Connection, table: str) -> set[int]:
    return {number for (number,) in db.execute(f"SELECT id FROM {table}")}  # noqa: S608 - names are ours


def _gaps(ids: set[int]) -> Iterator[tuple[int, int]]:
    """Give first and last of the keys that are missing between 1 and the last."""
    before = 0
    for number in sorted(ids):
        if number > before + 1:
            yield before + 1, number - 1
        before = number


def _reaches_end(db: sqlite3.Connection, kept: sqlite3.Connection, pages: _Pages) -> bool:
    """Return whether the last chunk and the last block that were recorded are known to be kept."""
    last = [kept.execute(f"SELECT coalesce(max(id), 0) FROM {table}").fetchone()[0] for table in _CHECKED]  # noqa: S608
    if last == pages.last_committed():
        return True
    with suppress(*DAMAGE, RecordingError):
        (in_overview,) = db.execute("SELECT max(last_block) FROM overview").fetchone()
        return bool(schema.read_session(db)["status"] != "recording" and in_overview == last[1] and not pages.has_log)
    return False


def _is_end_kept(db: sqlite3.Connection, kept: sqlite3.Connection) -> bool:
    """Return whether the last block of a readable recording is kept, or the raw bytes that its end is derived from."""
    with suppress(*DAMAGE):
        last = db.execute("SELECT id, last_chunk FROM block ORDER BY id DESC LIMIT 1").fetchone()
        sql = "SELECT EXISTS (SELECT 1 FROM block WHERE id = ?) OR EXISTS (SELECT 1 FROM chunk WHERE id = ?)"
        return last is None or bool(kept.execute(sql, last).fetchone()[0])
    return True


def _write_pages(path: Path, log: WriteAheadLog, copy: Path) -> None:
    """Write the database as the log completes it, without its log."""
    shutil.copyfile(path, copy)
    size = log.page_size
    database = pages_of(path, size)
    with copy.open("r+b") as file:
        for page, frame in log.newest(database).items():
            file.seek((page - 1) * size)
            file.write(log.image(frame))
        n = -(-file.seek(0, 2) // size)
        if committed := log.committed():
            n = max(int(log.sizes[committed - 1]), len(database))
        file.truncate(n * size)
        file.seek(18)
        file.write(b"\x01\x01")  # no log
        file.seek(28)
        file.write(n.to_bytes(4, "big"))


class _Trust(enum.Enum):
    """Which pages rows are taken from; from the last two only rows that carry a checksum."""

    VERIFIED = "verified"
    UNPROVEN = "unproven"  # intact as far as known
    DAMAGED = "damaged"


class _Pages:
    """The pages of a damaged database and of its log, and the rows in them."""

    def __init__(self, path: Path, log: WriteAheadLog | None) -> None:
        self._log = log
        self._database = pages_of(path, page_size_of(path) if log is None else log.page_size)
        self._budget = 8 * bytes_of(path) + _BYTES  # of long rows: in a forged file many share their pages
        self._newest: dict[int, int] = {}
        self._doubtful: dict[int, int] = {}
        self._older: dict[int, bytes] = {}
        if log is not None:
            self._older = {int.from_bytes(frame[:4], "big"): frame[24:].tobytes() for frame in log.older}
            for k in range(len(log.frames)):
                (self._newest if log.valid[k] else self._doubtful)[int(log.pages[k])] = k

    @property
    def has_log(self) -> bool:
        """Whether there is a log with frames."""
        return bool(self._newest or self._doubtful)

    def last_committed(self) -> list[int] | None:
        """Return the last chunk and block in commits behind all damage; None where there are none."""
        if self._log is None:
            return None
        last, done = dict.fromkeys(_CHECKED, 0), set[int]()
        for k in range(self._log.first_behind_damage, self._log.committed()):
            for table, row in rows_of_page(self._log.image(k), self._image, done):
                if table in last:
                    last[table] = max(last[table], row[0])
        return list(last.values())

    def rows(self, trust: _Trust) -> Iterator[tuple[str, Row]]:
        """Give the rows in single pages, newest first: in verified ones, then in those that are less to be trusted.

        What is left of earlier frames has gone into the database, and is read in case that is damaged.
        """
        log, done = self._log, set[int]()
        image = self._image if trust is _Trust.VERIFIED else self._any_image
        if log is not None and log.damage:
            damaged = ~log.valid & ~log.unproven
            which = {_Trust.VERIFIED: log.valid, _Trust.UNPROVEN: log.valid | log.unproven, _Trust.DAMAGED: damaged}
            for k in np.flatnonzero(which[trust])[::-1]:
                yield from rows_of_page(log.image(k), image, done)
        if trust is _Trust.VERIFIED:
            for page in self._database:
                yield from rows_of_page(page.tobytes(), self._image, done)
            for frame in () if log is None else log.older[::-1]:
                yield from rows_of_page(frame[24:].tobytes(), self._older_image, done)

    def _image(self, page: int) -> bytes | None:
        """Return the newest verified image of a page."""
        self._budget -= self._database.shape[1]
        if self._budget < 0:
            return None
        if self._log is not None and page in self._newest:
            return self._log.image(self._newest[page])
        return self._database[page - 1].tobytes() if 0 < page <= len(self._database) else None

    def _older_image(self, page: int) -> bytes | None:
        """Return what is left of a page in the frames of before, else the newest image."""
        return self._older.get(page) or self._image(page)

    def _any_image(self, page: int) -> bytes | None:
        """Return an image of a page that may not be verified, for rows that carry a checksum."""
        if self._log is not None and page in self._doubtful and page not in self._newest:
            return self._log.image(self._doubtful[page])
        return self._image(page)


def _scattered(
    kept: sqlite3.Connection, pages: _Pages, known: dict[str, set[int]], dtype: np.dtype[np.void]
) -> Iterator[tuple[str, Row]]:
    """Give the rows that no table leads to; `known` is extended by them."""
    for trust in _Trust:
        hosts = _host_times(kept, dtype) if trust is _Trust.DAMAGED and pages.has_log else set()
        for table, row in pages.rows(trust):
            if table not in known or row[0] in known[table] or fault_of(table, row, dtype, strict=True):
                continue
            if table not in _CHECKED:
                fits = trust is _Trust.VERIFIED
            elif table == "block":
                fits = _fits_between(kept, row, dtype)
            else:
                fits = _arrived_between(kept, row) and (trust is not _Trust.DAMAGED or row[1] in hosts)
            if fits:
                known[table].add(row[0])
                yield table, row


def _arrived_between(kept: sqlite3.Connection, row: Row) -> bool:
    """Return whether a chunk's time is between those of its neighbours; a resumed run may have another clock."""
    sql = "SELECT (SELECT host_ns FROM chunk WHERE id = ? - 1), (SELECT host_ns FROM chunk WHERE id = ? + 1)"
    before, after = kept.execute(sql, (row[0], row[0])).fetchone()
    if None not in (before, after) and before > after:
        return True
    return row[2] in (0, 1) and (before is None or before <= row[1]) and (after is None or row[1] <= after)


def _host_times(kept: sqlite3.Connection, dtype: np.dtype[np.void]) -> set[int]:
    """Return the arrival times of the chunks that the samples came in."""
    blobs = kept.execute("SELECT samples FROM block")
    return {int(time) for (blob,) in blobs for time in np.unique(np.frombuffer(blob, dtype)["host_ns"])}


def _fits_between(kept: sqlite3.Connection, row: Row, dtype: np.dtype[np.void]) -> bool:
    """Return whether a block's key, segment and times fit those of its neighbours."""
    number, segment, last_chunk, _, first_us, last_us, samples, _ = row
    sql = "SELECT id, segment, last_chunk, first_time_us, last_time_us, samples FROM block WHERE id"
    before = kept.execute(f"{sql} < ? ORDER BY id DESC LIMIT 1", (number,)).fetchone()
    after = kept.execute(f"{sql} > ? ORDER BY id LIMIT 1", (number,)).fetchone()
    if before is not None:
        if before[1:3] > (segment, last_chunk) or before[2] > last_chunk:
            return False
        if before[1] == segment:
            last, first = np.frombuffer(before[5], dtype)[-1], np.frombuffer(samples, dtype)[0]
            follows = last["index"] + 1 == first["index"]
            if before[4] >= first_us or (follows and before[0] + 1 != number):
                return False
    if after is None:
        return True
    in_order = (segment, last_chunk) <= after[1:3] and last_chunk <= after[2]
    return bool(in_order and (after[1] != segment or last_us < after[3]))


def fault_of(table: str, row: Row, dtype: np.dtype[np.void], *, strict: bool = False) -> str:
    """Return what is wrong with a chunk or a block; empty where nothing is.

    Parameters
    ----------
    strict : whether a block without a checksum, of an older recording, is wrong.
    """
    if table == "chunk":
        return "" if crc32(row[3]) == row[4] else f"the raw bytes of chunk {row[0]} do not match their checksum"
    if table != "block":
        return ""
    number, _, _, n, first_us, last_us, blob, *checksum = row
    if checksum and checksum[0] is not None:
        if crc32(blob) != checksum[0]:
            return f"the samples of block {number} do not match their checksum"
    elif strict:
        return f"block {number} has no checksum"
    if not n or len(blob) != n * dtype.itemsize:
        return f"block {number} is for {n} samples and holds {len(blob)} bytes"
    times = np.frombuffer(blob, dtype)["time_us"]
    return (
        "" if (first_us, last_us) == (times[0], times[-1]) else f"the times of block {number} differ from its samples"
    )


def open_damaged(path: Path, *, alone: bool = False) -> sqlite3.Connection:
    """Open read-only what SQLite would refuse, `alone` without its log.

    With `writable_schema` SQLite reads a file that is shorter than it should be.
    """
    uri = f"{path.absolute().as_uri()}?mode=ro{'&immutable=1' if alone else ''}"
    connection = sqlite3.connect(uri, uri=True, isolation_level=None)
    harden(connection, damaged=True)
    for pragma in ("query_only=ON", "writable_schema=ON"):
        connection.execute(f"PRAGMA {pragma}")
    try:
        refuse_active(path, connection)
    except (RecordingError, *DAMAGE):
        connection.close()
        raise
    return connection


def _free_name(path: Path) -> Path:
    for number in range(1, 1000):
        target = path.with_name(f"{path.stem}.salvaged{'' if number == 1 else number}{schema.SUFFIX}")
        if not target.exists():
            return target
    raise RequestError(f"there are a thousand salvaged files of {path.name} already")


def _sound_rows(reader: _RowReader, file: RecordingFile, table: str, dtype: np.dtype[np.void]) -> Iterator[Statement]:
    """Give the statements that copy a table's readable rows."""
    present = reader.columns(table)
    names = [name for name in file.columns(table) if name in present]
    if names[:1] != ["id"]:
        reader.lost.append(f"{table}: cannot be read at all")
        return
    sql = _insertion(table, names)
    for row in reader.rows(table, names):
        if fault := fault_of(table, row, dtype):
            reader.lost.append(fault)
        else:
            yield sql, row


def _commit(file: RecordingFile, statements: Iterator[Statement]) -> None:
    """Commit statements in transactions of bounded size."""
    batch: list[Statement] = []
    size = 0
    for statement in statements:
        batch.append(statement)
        size += _length(statement[1])
        if len(batch) >= _ROWS or size > _BYTES:
            file.commit(batch)
            batch, size = [], 0
    file.commit(batch)


def _length(row: tuple[Any, ...]) -> int:
    """Return the bytes, or letters, of a row's long values."""
    return sum(len(value) for value in row if isinstance(value, bytes | str))


@dataclass(slots=True)
class _RowReader:
    """Reads tables by their keys and continues behind what cannot be read.

    `left` is how many bytes the file can still hold: in a forged one many rows may share the pages of one long value.
    """

    db: sqlite3.Connection
    left: int
    lost: list[str] = field(default_factory=list)

    def columns(self, table: str) -> set[str]:
        """Return the names of a table's columns in the damaged file."""
        return {row[1] for row in self.db.execute(f"PRAGMA table_info({table})")}

    def rows(self, table: str, names: list[str]) -> Iterator[tuple[Any, ...]]:
        """Give the readable rows in order, without those that do not fit the schema."""
        kinds = [{**schema.layout(), **schema.optional_layout()}[table][name] for name in names]
        for row in self._readable(table, names):
            self.left -= _length(row)
            if self.left < 0:
                self.lost.append(f"{table}: from row {row[0]} on more than a file of this size can hold")
                return
            if all(map(value_fits, kinds, row)):
                yield row
            else:
                self.lost.append(f"{table}: row {row[0]} does not fit the schema")

    def _readable(self, table: str, names: list[str]) -> Iterator[tuple[Any, ...]]:
        last = 0
        where = "typeof(id) = 'integer' AND id > ? ORDER BY id"
        sql = f"SELECT {', '.join(names)} FROM {table} WHERE {where}"  # noqa: S608 - names are the schema's
        while True:
            try:
                for row in self.db.execute(sql, (last,)):
                    if row[0] <= last:  # pages that lead back to pages before them would be read for ever
                        raise sqlite3.DatabaseError("its keys are out of order")
                    last = row[0]
                    yield row
            except DAMAGE as error:
                behind = self._readable_behind(sql, last)
                if behind is None or behind[0] > last + 1:
                    upto = "to the end" if behind is None else f"to {behind[0] - 1}"
                    self.lost.append(f"{table}: rows {last + 1} {upto} cannot be read ({error})")
                if behind is None:
                    return
                last = behind[0]
                yield behind  # by itself: sqlite3 looks one row ahead, so the loop may never give it
            else:
                return

    def _readable_behind(self, sql: str, last: int) -> tuple[Any, ...] | None:
        """Return the next readable row behind key `last`, by bisection; None at the end."""
        low, high = last, last + 1
        while self._row_from(sql, high) is _UNREADABLE:
            low, high = high, high + (high - last)
            if high - last > _KEYS_MAX:
                return None
        while high - low > 1:
            middle = (low + high) // 2
            if self._row_from(sql, middle) is _UNREADABLE:
                low = middle
            else:
                high = middle
        row = self._row_from(sql, high)
        return row if isinstance(row, tuple) else None

    def _row_from(self, sql: str, start: int) -> object:
        """Return the first row from key `start` on, None without one, or `_UNREADABLE`."""
        try:
            row = self.db.execute(f"{sql} LIMIT 1", (start - 1,)).fetchone()
            return _UNREADABLE if row is not None and row[0] < start else row
        except DAMAGE:
            return _UNREADABLE


_UNREADABLE = object()
