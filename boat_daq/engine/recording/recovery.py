"""Recover what a killed session or a bad disk left: close it properly, or save elsewhere what is readable.

Rules: a recording that a living program writes is left alone. The file is checked read-only first: SQLite replays its
log up to the last whole commit, so a torn or zeroed tail costs nothing that was acknowledged. A sound file is closed in
place. A damaged one is never touched: all rows that can be read go into a new file beside it, and what could not be
read is named.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from boat_daq.engine.recording.file import RecordingFile, Statement, set_meta, storage_error
from boat_daq.engine.recording.rows import INSERT_EVENT, OverviewRows
from boat_daq.engine.recording.writer_lock import WriterLock, is_being_written
from boat_daq.engine.sample_columns import mv_per_count
from protocol.base.errors import DamagedRecordingError, RecordingError, RequestError, StorageError
from protocol.recording import schema
from protocol.recording.checks import DAMAGE, bytes_of, harden, refuse_active, value_fits

Progress = Callable[[float, float], None]
_ROWS = 1_000  # of one transaction
_BYTES = 16 * 2**20
_KEYS_MAX = 1 << 40
_NAMES_ANOTHER = bytes.fromhex("d9d505f920a163d7")  # how a journal ends that belongs to a change of several files


@dataclass(frozen=True, slots=True)
class Recovery:
    """What a recovery did."""

    status: str  # "recovered", "salvaged" (into another file), or "closed" (there was nothing to do)
    path: Path  # the file to use from now on
    samples: int
    chunks: int
    damaged: tuple[str, ...] = ()


def find_interrupted(folder: Path) -> list[Path]:
    """Return the recordings of a folder that a killed program left open."""
    return [path for path in sorted(folder.glob(f"*{schema.SUFFIX}")) if _is_interrupted(path)]


def recover(path: Path, *, progress: Progress | None = None) -> Recovery:
    """Close properly what a killed session left, or save what a damaged file holds."""
    if is_being_written(path):
        raise StorageError(f"{path} is being written by another program", "Close it there first.")
    schema.refuse_newer(path)
    _roll_back(path)
    faults, structural = _check(path, progress)
    if structural:
        return _salvage(path, faults, progress)
    with closing(schema.open_recording(path)) as db:
        status = schema.read_session(db)["status"]
        counts = _counts(db)
    if status == "recording":
        _close_in_place(path)
        status = "recovered"
    elif path.with_name(path.name + "-wal").exists():  # its log is left
        RecordingFile.reopen(path).close()
    return Recovery(status, path, *counts, tuple(faults))


def _roll_back(path: Path) -> None:
    """Undo what a killed program had half added to a closed recording.

    A journal that names another file was not left by this program: SQLite would open that file, and may delete it.
    """
    journal = path.with_name(path.name + "-journal")
    if not os.path.lexists(journal):
        return
    if journal.is_symlink() or not journal.is_file() or _end_of(journal) == _NAMES_ANOTHER:
        raise RecordingError(f"{journal} leads to another file, and is not boat-daq's", "Move it elsewhere.")
    try:
        with closing(WriterLock(path)), closing(sqlite3.connect(path, isolation_level=None)) as db:
            harden(db)
            db.execute("SELECT count(*) FROM sqlite_schema").fetchone()
    except DAMAGE as error:
        raise storage_error(path, error) from error


def _end_of(journal: Path) -> bytes:
    with journal.open("rb") as file:
        file.seek(-min(len(_NAMES_ANOTHER), journal.stat().st_size), os.SEEK_END)
        return file.read()


def _is_interrupted(path: Path) -> bool:
    with suppress(RecordingError), closing(schema.open_recording(path)) as db:
        return bool(schema.read_session(db)["status"] == "recording") and not is_being_written(path)
    return False


def _check(path: Path, progress: Progress | None) -> tuple[list[str], bool]:
    """Look for damage without writing anything.

    Return what is damaged, and whether it is the tree of pages and not a value in it.
    """
    try:
        with closing(schema.open_recording(path)) as db:
            found = [text for (text,) in db.execute("PRAGMA quick_check(10)")]
            if found != ["ok"]:
                return [str(text) for text in found], True
            schema.check_long_tables(path, db)
            return list(_wrong_checksums(db, progress)), False
    except (*DAMAGE, RecordingError) as error:
        if not _looks_like_ours(path):
            remedy = error.remedy if isinstance(error, RecordingError) else ""
            if isinstance(error, DamagedRecordingError):  # whose remedy, recovery, was just tried
                remedy = "Nothing in it can be read; use another copy."
            raise RecordingError(str(error), remedy) from error
        return [str(error)], True


def _looks_like_ours(path: Path) -> bool:
    """Whether a file that cannot be opened as a recording may still hold one."""
    with suppress(OSError, *DAMAGE), closing(_open_damaged(path)) as db:
        return bool(db.execute("SELECT count(*) FROM session").fetchone()[0])
    return False


def _wrong_checksums(db: sqlite3.Connection, progress: Progress | None) -> Iterator[str]:
    for table, column, what in (("chunk", "raw", "raw bytes of chunk"), ("block", "samples", "samples of block")):
        sql = f"SELECT id, {column}, crc32 FROM {table} ORDER BY id"  # noqa: S608 - names are ours
        total = db.execute(f"SELECT coalesce(max(id), 0) FROM {table}").fetchone()[0]  # noqa: S608
        for number, content, checksum in db.execute(sql):
            if checksum is not None and crc32(content) != checksum:
                yield f"the {what} {number} do not match their checksum"
            if progress is not None and number % _ROWS == 0:
                progress(number, total)
    size = schema.session_dtype(schema.read_session(db)).itemsize
    for number, n, length in db.execute("SELECT id, n, length(samples) FROM block ORDER BY id"):
        if length != n * size:
            yield f"block {number} is for {n} samples and holds {length} bytes"


def _counts(db: sqlite3.Connection) -> tuple[int, int]:
    """Return how many samples and chunks are there, whatever the counts of the blocks."""
    size = schema.session_dtype(schema.read_session(db)).itemsize
    samples, chunks = db.execute(
        "SELECT (SELECT coalesce(sum(length(samples) / ?), 0) FROM block), (SELECT count(*) FROM chunk)", (size,)
    ).fetchone()
    return int(samples), int(chunks)


def _close_in_place(path: Path) -> None:
    """Complete the overview, mark the recording, and close it into one file."""
    with closing(schema.open_recording(path)) as db:
        meta = schema.read_session(db)
        statements = [*_missing_overview(db, meta), *_end(db, meta)]
    file = RecordingFile.reopen(path)
    try:
        file.commit(statements)
    except StorageError:
        file.abandon()
        raise
    file.close()


def _missing_overview(db: sqlite3.Connection, meta: dict[str, Any]) -> Iterator[Statement]:
    newest = "SELECT coalesce(max(id), 0), coalesce(max(last_block), 0) FROM overview"
    last_row, last_block = db.execute(newest).fetchone()
    dtype = schema.session_dtype(meta)
    overview = OverviewRows(mv_per_count(meta), next_id=last_row + 1)
    for number, segment, blob in db.execute(
        "SELECT id, segment, samples FROM block WHERE id > ? AND n > 0 AND length(samples) = n * ? ORDER BY id",
        (last_block, dtype.itemsize),
    ):
        yield from overview.add(number, segment, np.frombuffer(blob, dtype))
    yield from overview.finish()


def _end(db: sqlite3.Connection, meta: dict[str, Any]) -> Iterator[Statement]:
    """Give what the killed program could not write. When it ended, and that it was killed."""
    first = {"utc": meta["started_utc"], "host_ns": meta["started_host_ns"], "first_chunk": 1}
    begun = [first, *schema.breaks_of(meta)][-1]  # the monotonic clock may have restarted since the first start
    sql = "SELECT host_ns FROM chunk WHERE id >= ? ORDER BY id DESC LIMIT 1"
    last_ns = db.execute(sql, (begun["first_chunk"],)).fetchone()
    ended_ns, ended_utc = last_ns[0] if last_ns else begun["host_ns"], None
    if None not in (ended_ns, begun["host_ns"], begun["utc"]):
        passed = timedelta(microseconds=(ended_ns - begun["host_ns"]) / 1000)
        ended_utc = (datetime.fromisoformat(begun["utc"]) + passed).isoformat(timespec="milliseconds")
    ended = {"ended_host_ns": ended_ns, "ended_utc": ended_utc, "status": "recovered"}
    ended |= {"stop_reason": schema.RunEnd.INTERRUPTED, "run_end": schema.RunEnd.INTERRUPTED}
    yield from set_meta(ended)
    number = db.execute("SELECT coalesce(max(id), 0) + 1 FROM event").fetchone()[0]
    text = "the session ended here without closing"
    yield INSERT_EVENT, (number, ended_ns or 0, None, None, "host", "recovered", None, text)


def _open_damaged(path: Path) -> sqlite3.Connection:
    """Open read-only what SQLite would refuse. With this pragma it reads a file that is shorter than it should be."""
    connection = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, isolation_level=None)
    harden(connection, damaged=True)
    for pragma in ("query_only=ON", "writable_schema=ON"):
        connection.execute(f"PRAGMA {pragma}")
    try:
        refuse_active(path, connection)
    except (RecordingError, *DAMAGE):
        connection.close()
        raise
    return connection


def _salvage(path: Path, faults: list[str], progress: Progress | None) -> Recovery:
    """Copy all rows that can be read into a new file."""
    target = _free_name(path)
    with closing(_open_damaged(path)) as db:
        meta = schema.read_session(db)
        schema.session_dtype(meta)  # refuses a file whose bytes nothing describes
        file = RecordingFile.create(target, meta)
        reader = _RowReader(db, bytes_of(path))
        try:
            file.commit(set_meta(meta))
            optional = [name for name in schema.OPTIONAL_TABLES if reader.columns(name)]
            file.commit([(schema.OPTIONAL_TABLES[name], ()) for name in optional])
            tables = [*(name for name in schema.TABLE_NAMES if name not in {"session", "overview"}), *optional]
            for done, table in enumerate(tables):
                _copy(reader, file, table)
                if progress is not None:
                    progress(done + 1, len(tables))
        except BaseException:
            file.abandon()
            target.unlink(missing_ok=True)
            raise
        file.abandon()
    _close_in_place(target)
    with closing(schema.open_recording(target)) as copy:
        counts = _counts(copy)
    return Recovery("salvaged", target, *counts, (*faults, *reader.lost))


def _free_name(path: Path) -> Path:
    for number in range(1, 1000):
        target = path.with_name(f"{path.stem}.salvaged{'' if number == 1 else number}{schema.SUFFIX}")
        if not target.exists():
            return target
    raise RequestError(f"there are a thousand salvaged files of {path.name} already")


def _copy(reader: _RowReader, file: RecordingFile, table: str) -> None:
    batch: list[Statement] = []
    size = 0
    present = reader.columns(table)
    names = [name for name in file.columns(table) if name in present]
    if names[:1] != ["id"]:
        reader.lost.append(f"{table}: cannot be read at all")
        return
    marks = ", ".join("?" * len(names))
    sql = f"INSERT OR IGNORE INTO {table} ({', '.join(names)}) VALUES ({marks})"  # noqa: S608 - names are the schema's
    for row in reader.rows(table, names):
        batch.append((sql, row))
        size += _length(row)
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
