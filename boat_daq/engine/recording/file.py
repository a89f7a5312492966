"""One recording on disk, written through one connection by one thread at a time.

Rules: tables and metadata are written before the file goes into WAL mode, so that even the bare file names itself. A
commit is a transaction with synchronous=FULL; inserts carry their keys and are OR IGNORE, so that a commit whose
outcome is unknown can be tried again. No other program writes (`WriterLock`) or checkpoints: SQLite up to 3.51.2 can
damage a file where two do. A clean close leaves one plain file; -wal goes after a check of the file alone.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
import sqlite3
import time
import uuid
from collections.abc import Iterable, Mapping
from datetime import datetime
from itertools import groupby
from pathlib import Path
from typing import Any, TypeAlias

from boat_daq import __version__
from boat_daq.engine.file_names import check_file_name
from protocol.base.errors import RequestError, StorageError
from protocol.recording import open_recording, refuse_newer, sample_dtype, schema
from protocol.recording.checks import harden
from protocol.recording.damaged_log import fault_of_log
from protocol.recording.writer_lock import WriterLock, is_being_written

SPACE_FLOOR_BYTES = 32 * 2**20  # below this a recording is ended while it can still be closed
_WIRE_BYTES = 26  # of a SAMPLE frame beside its sensors: COBS, head, CRC, delimiter
_ROW_BYTES = 40  # SQLite's share of a chunk row, when every sample comes in its own
_MARGIN = 1.25  # events, health, the write-ahead log


def bytes_per_second(rate_hz: float, n_sensors: int) -> float:
    """Return what a recording grows by: raw bytes, samples, and the rows around them."""
    return rate_hz * (_WIRE_BYTES + 4 * n_sensors + sample_dtype(n_sensors).itemsize + _ROW_BYTES) * _MARGIN


def check_space(folder: Path, *, rate_hz: float, duration_s: float, n_sensors: int) -> None:
    """Refuse a recording that does not fit into a folder."""
    if not folder.is_dir():
        raise StorageError(f"there is no folder {folder}", "Create it, or choose another.")
    if not os.access(folder, os.W_OK):
        raise StorageError(f"the folder {folder} cannot be written", "Choose one with write permission.")
    needed = int(bytes_per_second(rate_hz, n_sensors) * duration_s) + SPACE_FLOOR_BYTES
    free = shutil.disk_usage(folder).free
    if free < needed:
        cause = f"the recording needs about {needed / 1e6:.0f} MB and {folder} has {free / 1e6:.0f} MB free"
        raise StorageError(cause, "Free disk space, choose another disk, or record less.")


Statement: TypeAlias = tuple[str, tuple[Any, ...]]
_LOCKED = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)


def now_utc() -> str:
    """Return the time of day with its offset from UTC, ISO 8601."""
    return datetime.now().astimezone().isoformat(timespec="milliseconds")


def check_recording_name(path: Path) -> None:
    """Refuse a name that is not a recording's, or that some system cannot hold."""
    if path.suffix != schema.SUFFIX:
        remedy = f"Name it {path.stem or 'run'}{schema.SUFFIX}"
        raise RequestError(f"{path.name!r} does not end in {schema.SUFFIX}", remedy)
    check_file_name(path.name)


def storage_error(path: Path, error: Exception) -> StorageError:
    """Return the error to raise where SQLite or the system fails to write."""
    code = _sqlite_code(error)
    number = getattr(error, "errno", None)
    if code == sqlite3.SQLITE_FULL or number == errno.ENOSPC:
        return StorageError(f"the disk of {path.parent} is full", "Free disk space; what is recorded so far is kept.")
    if code == sqlite3.SQLITE_READONLY or number == errno.EROFS:
        return StorageError(f"{path} is read-only", "Change its permissions, or choose another folder.")
    if code in _LOCKED:
        return StorageError(f"{path} is locked by another program", "Close the program that has it open.")
    return StorageError(f"{path} cannot be written: {error}", "Check the disk; what is recorded so far is kept.")


def _gone(path: Path) -> StorageError:
    return StorageError(f"{path.name} was moved or removed while it was recorded", "Put it back, or start again.")


def _sqlite_code(error: Exception) -> int:
    """Return the primary code of an error of SQLite; 0 for any other."""
    return int(getattr(error, "sqlite_errorcode", 0)) & 0xFF


class RecordingFile:
    """A recording open for writing. Made by `create` or `reopen`."""

    def __init__(self, path: Path, connection: sqlite3.Connection, lock: WriterLock) -> None:
        self.path = path
        self._connection = connection
        self._lock = lock
        self._identity = _identity(path)

    @classmethod
    def create(cls, path: Path, meta: Mapping[str, Any]) -> RecordingFile:
        """Create the file and its metadata."""
        check_recording_name(path)
        if not path.parent.is_dir():
            raise StorageError(f"there is no folder {path.parent}", "Create it, or choose another.")
        lock = WriterLock(path)
        try:
            path.touch(exist_ok=False)
            connection = _connect(path)
            _lay_out(connection, meta)
            return cls(path, connection, lock)
        except FileExistsError:
            lock.close()
            remedy = "A recording is never overwritten: choose another name."
            raise RequestError(f"{path} exists already", remedy) from None
        except (OSError, sqlite3.Error) as error:
            lock.close()
            raise storage_error(path, error) from error

    @classmethod
    def reopen(cls, path: Path, *, resume: bool = False) -> RecordingFile:
        """Open an existing, closed recording to add to it; to `resume` it, with its log on."""
        if not is_being_written(path) and fault_of_log(path):  # SQLite would remove it
            cause = f"{path} has a damaged log"
            raise StorageError(cause, "Recover the recording.", command=f"boat-daq recover {path}")
        open_recording(path).close()
        refuse_newer(path)
        lock = WriterLock(path)
        try:
            connection = _connect(path)
            connection.execute("PRAGMA synchronous=FULL")
            if resume:
                _into_wal(connection)
            return cls(path, connection, lock)
        except (OSError, sqlite3.Error) as error:
            lock.close()
            raise storage_error(path, error) from error

    def commit(self, statements: Iterable[Statement]) -> None:
        """Write statements in one transaction; all of them or, when it raises, none."""
        try:
            self._connection.execute("BEGIN IMMEDIATE")
            for sql, group in groupby(statements, key=lambda statement: statement[0]):
                if sql.lstrip().startswith("CREATE"):
                    self._connection.execute(sql)
                else:
                    self._connection.executemany(sql, [values for _, values in group])
            self._connection.execute("COMMIT")
        except (sqlite3.Error, OSError) as error:
            with contextlib.suppress(sqlite3.Error):
                self._connection.rollback()
            raise self._failed(error) from error

    def columns(self, table: str) -> list[str]:
        """Return the names of a table's columns."""
        return [row[1] for row in self._connection.execute(f"PRAGMA table_info({table})")]

    def _failed(self, error: Exception) -> StorageError:
        return storage_error(self.path, error) if self.path.exists() else _gone(self.path)

    def check_place(self) -> None:
        """Detect what no write reports: that the file was moved or removed."""
        if _identity(self.path) != self._identity:
            raise _gone(self.path)

    def check_space(self) -> None:
        """Detect a disk that is nearly full, while the file can still be closed."""
        free = shutil.disk_usage(self.path.parent).free
        if free < SPACE_FLOOR_BYTES:
            raise StorageError(f"the disk of {self.path.parent} has only {free / 1e6:.1f} MB left", "Free disk space.")

    def close(self, *, check: bool = True) -> bool:
        """Close into one checked file. False where another program has it open, so that -wal stays beside it."""
        try:
            found = self._check() if check else ""
            if found:
                self._close_beside_a_reader()
                cause = f"{self.path} is damaged: {found}"
                raise StorageError(cause, "Recover the recording.", command=f"boat-daq recover {self.path}")
            self._connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            mode = self._connection.execute("PRAGMA journal_mode=DELETE").fetchone()
            return bool(mode == ("delete",))
        except sqlite3.OperationalError as error:
            if _sqlite_code(error) in _LOCKED:
                return False
            raise self._failed(error) from error
        finally:
            self.abandon()

    def _check(self) -> str:
        """Copy the log into the file, and return what is wrong with the file alone; the log is still there."""
        busy, in_log, copied = self._connection.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchone()
        if busy or in_log != copied:  # another program reads: the log stays
            return str(self._connection.execute("PRAGMA quick_check(1)").fetchone()[0]).removeprefix("ok")
        uri = f"{self.path.absolute().as_uri()}?mode=ro&immutable=1"
        with contextlib.closing(sqlite3.connect(uri, uri=True)) as alone:
            harden(alone)
            return str(alone.execute("PRAGMA quick_check(1)").fetchone()[0]).removeprefix("ok")

    def _close_beside_a_reader(self) -> None:
        """Close without removing the log, as the last connection that can write would."""
        uri = f"{self.path.absolute().as_uri()}?mode=ro"
        with contextlib.suppress(sqlite3.Error), contextlib.closing(sqlite3.connect(uri, uri=True)) as reader:
            harden(reader)
            reader.execute("PRAGMA user_version").fetchone()
            self._connection.close()

    def abandon(self) -> None:
        """Let go of the file as it is; may be called twice."""
        with contextlib.suppress(sqlite3.Error):
            self._connection.close()
        self._lock.close()


def set_meta(values: Mapping[str, Any]) -> list[Statement]:
    """Return the statements that set keys of `session`."""
    sql = "INSERT INTO session VALUES (?, ?) ON CONFLICT (key) DO UPDATE SET value = excluded.value"
    texts = {key: json.dumps(value, ensure_ascii=False) for key, value in values.items()}
    return [(sql, (key, text.encode("utf-8", "backslashreplace").decode())) for key, text in texts.items()]


def _lay_out(connection: sqlite3.Connection, meta: Mapping[str, Any]) -> None:
    """Write tables and metadata, then go into WAL mode."""
    dtype = schema.sample_dtype(int(meta["n_sensors"]), meta["sample_kind"], len(meta.get("channels") or ()))
    values = dict.fromkeys(schema.SESSION_KEYS) | dict(meta)
    values |= {
        "uuid": str(uuid.uuid4()),
        "status": "recording",
        "program_version": __version__,
        "started_utc": now_utc(),
        "started_host_ns": time.monotonic_ns(),
        "sample_dtype": schema.describe_dtype(dtype),
    }
    connection.executescript(f"BEGIN; {schema.TABLES} COMMIT;")
    connection.execute(f"PRAGMA application_id={schema.APPLICATION_ID}")
    connection.execute("BEGIN")
    for sql, row in set_meta(values):
        connection.execute(sql, row)
    connection.execute("COMMIT")
    connection.execute(f"PRAGMA user_version={schema.SCHEMA_VERSION}")
    _into_wal(connection)
    named = set_meta({"uuid": values["uuid"]})  # in the log, too, to show whose it is
    connection.execute("BEGIN")  # SQLite does not write an equal value without a deletion
    for sql, row in [("DELETE FROM session WHERE key = 'uuid'", ()), *named]:
        connection.execute(sql, row)
    connection.execute("COMMIT")


def _connect(path: Path) -> sqlite3.Connection:
    connection = sqlite3.connect(path, isolation_level=None, check_same_thread=False, timeout=2.0)
    harden(connection)
    return connection


def _into_wal(connection: sqlite3.Connection) -> None:
    """Switch the log on, and check that it is on: some file systems refuse silently."""
    mode = connection.execute("PRAGMA journal_mode=WAL").fetchone()[0]
    if mode != "wal":
        raise sqlite3.OperationalError(f"this file system cannot keep a log (journal mode {mode})")
    connection.execute("PRAGMA synchronous=FULL")


def _identity(path: Path) -> tuple[int, int] | None:
    """Return what identifies the file itself, not its name; None when it is gone."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino
