"""The recording's schema: the content of a `.boat` file, described once for writer and readers.

One SQLite file a session: the raw bytes as received and, in the same transaction, the samples decoded from them, so
that every number can be derived again. Changes are additive: a column or a table may be added (and `SCHEMA_VERSION`
raised), none renamed or redefined. So a newer file can be read, though not extended, and NULLs replace the columns that
an older one lacks (`ADDED`). Samples are stored in blocks of little-endian records of `sample_dtype`;
docs/how-to/script.md reads them in six lines.

Three clocks, never mixed: `time_us` is the board's, unwrapped, and the time of every analysis; `host_ns` is the host's
monotonic clock at arrival; UTC with its offset names the session and is stored in `session`.
"""

from __future__ import annotations

import enum
import json
import os
import re
import sqlite3
import struct
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from protocol.base.arrays import FloatArray
from protocol.base.errors import RecordingError, damaged
from protocol.recording import checks
from protocol.recording.writer_lock import is_being_written

APPLICATION_ID = 0x424F4154  # "BOAT": SQLite's `application_id`, by which `file` and boat-daq identify a recording
SCHEMA_VERSION = 2  # SQLite's `user_version`
SCHEMA_BREAK = 100  # a version from here on is no longer additive: this program cannot read it
SUFFIX = ".boat"
MARK_EVENT = "mark"  # of a note at a time, by the user, during a run or afterwards
NOTE_EVENT = "note"  # `event.kind` of a note on the whole recording, by the user; the newest counts

SampleKind = Literal["counts", "signal"]


class RunEnd(enum.StrEnum):
    """How a run ended, or a recording without one: `session.run_end`."""

    FINISHED = "finished"
    STOPPED = "stopped"  # by the operator
    ABORTED = "aborted"  # vented by the operator, a step that timed out, a disk that failed
    FAULT = "fault"  # the interlock tripped and latched
    INTERRUPTED = "interrupted"  # the program was killed


class BoardState(enum.IntEnum):
    """State of the board's pressure control, as each sample carries it."""

    IDLE = 0
    RAMPING = 1
    HOLDING = 2
    VENTED = 3
    FAULT = 4


class SampleFlag(enum.IntFlag):
    """Flags of a sample: the low byte as the board sent it, the high byte set by the host."""

    SATURATED = 0x0001
    ESTOP = 0x0002
    WATCHDOG_ARMED = 0x0004
    PRESSURE_INVALID = 0x0008
    DROPPED_BEFORE = 0x0010
    IMPLAUSIBLE = 0x0100  # good checksum, impossible value: kept, and left out of every figure
    GAP_BEFORE = 0x0200  # samples are missing between the one before and this one


NOT_FOR_FIGURES = SampleFlag.SATURATED | SampleFlag.PRESSURE_INVALID | SampleFlag.IMPLAUSIBLE


def sample_dtype(n_sensors: int, kind: SampleKind = "counts", n_channels: int = 0) -> np.dtype[np.void]:
    """Return the packed little-endian record of one sample, for 1 to 4 sensors and 0 to `CHANNELS_MAX` extra channels.

    Fields: `index` (sampling instant, counted from START), `time_us` (board clock, unwrapped), `host_ns` (host
    monotonic clock at arrival), `pressure_pa` (gauge), `state`, `flags`; for each sensor `lit` and `dark` (counts; kind
    "counts") or `signal_mv` (kind "signal": a text profile with nothing to subtract); `channel`, each in its own unit.
    """
    head: list[Any] = [
        ("index", "<u4"),
        ("time_us", "<i8"),
        ("host_ns", "<i8"),
        ("pressure_pa", "<f8"),
        ("state", "u1"),
        ("flags", "<u2"),
    ]
    extra: list[Any] = [("channel", "<f8", (n_channels,))] if n_channels else []
    if kind == "counts":
        return np.dtype([*head, ("lit", "<u2", (n_sensors,)), ("dark", "<u2", (n_sensors,)), *extra])
    return np.dtype([*head, ("signal_mv", "<f8", (n_sensors,)), *extra])


def fitted(samples: np.ndarray[Any, np.dtype[np.void]], dtype: np.dtype[np.void]) -> np.ndarray[Any, np.dtype[np.void]]:
    """Return samples without the fields that a recording of an older layout does not have."""
    names = dtype.names or ()
    if samples.dtype == dtype or any(name not in (samples.dtype.names or ()) for name in names):
        return samples
    kept = np.empty(len(samples), dtype)
    for name in names:
        if samples.dtype[name] != dtype[name]:
            return samples
        kept[name] = samples[name]
    return kept


def overview_extremes(samples: np.ndarray[Any, np.dtype[np.void]], mv_per_count: float) -> tuple[Any, ...]:
    """Return pressure_min_kpa to flags of one row of `overview`; implausible samples enter the flags only."""
    good = samples[(samples["flags"] & SampleFlag.IMPLAUSIBLE) == 0]
    counts = "lit" in (samples.dtype.names or ())
    signal_mv = (good["lit"].astype(float) - good["dark"]) * mv_per_count if counts else good["signal_mv"]

    def ends(values: FloatArray) -> tuple[float, float] | tuple[None, None]:
        finite = values[np.isfinite(values)]
        return (float(finite.min()), float(finite.max())) if finite.size else (None, None)

    low, high = zip(*map(ends, signal_mv.T), strict=True)
    flags = int(np.bitwise_or.reduce(samples["flags"]))
    return *ends(good["pressure_pa"] / 1000.0), json.dumps(low), json.dumps(high), flags


def describe_dtype(dtype: np.dtype[np.void]) -> list[tuple[str, str, tuple[int, ...]]]:
    """Return `dtype` as (name, code, shape) rows, as stored in `session`."""
    assert dtype.fields is not None
    return [(name, field[0].base.str, field[0].shape) for name, field in dtype.fields.items()]


def dtype_from_description(rows: list[Any]) -> np.dtype[np.void]:
    """Return the dtype that `describe_dtype` described. ValueError: a field is not a plain little-endian number."""
    fields: list[Any] = []
    for name, code, shape in rows:
        if np.dtype(code).kind not in "iuf" or any(int(n) < 1 or int(n) > 64 for n in shape):
            raise ValueError(f"field {name!r} has the unusable type {code!r}")
        fields.append((str(name), code, tuple(int(n) for n in shape)) if shape else (str(name), code))
    return np.dtype(fields)


def session_dtype(meta: Mapping[str, Any]) -> np.dtype[np.void]:
    """Return the record of a session's samples: `sample_dtype` and fields of newer versions. RecordingError: not so."""
    try:
        dtype = dtype_from_description(meta["sample_dtype"])
        ours = sample_dtype(meta["n_sensors"], meta["sample_kind"], len(meta.get("channels") or ()))
    except (KeyError, ValueError, TypeError) as error:
        raise RecordingError(f"the session does not describe its samples: {error}") from error
    for name in ours.names or ():
        if name not in (dtype.names or ()) or dtype[name] != ours[name]:
            raise RecordingError(f"the session's samples have no usable {name!r}", "The file is damaged.")
    return dtype


# of every recording
SESSION_KEYS = tuple(
    key
    for key in checks.SESSION_VALUES
    if key not in ("run_end", "resumptions", "missing", "metadata", "channels", "derived", "camera", "video")
)
# Beside `stop_reason`, for people, its code "run_end" (`RunEnd`), for programs; files before November 2026 lack it.
# Only in a resumed run: "resumptions", a list in order, one object for each break: utc and host_ns of the resumption,
# cause ("interrupted", "stopped", "aborted: ..."), break_s, the first segment, chunk, step and cycle after it,
# complete_cycles before it, last_result (id of the newest result of less than the whole run)

TABLES = """
CREATE TABLE session (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;

-- bytes as received (direction 0) and as sent (direction 1)
CREATE TABLE chunk (
    id INTEGER PRIMARY KEY, host_ns INTEGER NOT NULL, direction INTEGER NOT NULL, raw BLOB NOT NULL,
    crc32 INTEGER NOT NULL);

-- a stretch of unbroken board time: a new one at START, after a reset, a reconnection, a pause; decoder is what the
-- link remembered of the bytes before first_chunk (JSON), where a link began to be recorded, else null
CREATE TABLE segment (
    id INTEGER PRIMARY KEY, host_ns INTEGER NOT NULL, first_chunk INTEGER NOT NULL, reason TEXT NOT NULL,
    paused INTEGER NOT NULL DEFAULT 0, decoder TEXT);

-- samples of one commit: little-endian records of session.sample_dtype; crc32 is theirs, null where none was kept
CREATE TABLE block (
    id INTEGER PRIMARY KEY, segment INTEGER NOT NULL, last_chunk INTEGER NOT NULL, n INTEGER NOT NULL,
    first_time_us INTEGER NOT NULL, last_time_us INTEGER NOT NULL, samples BLOB NOT NULL, crc32 INTEGER);

-- extremes of about 1,000 consecutive samples, so that a day is seen in a second
CREATE TABLE overview (
    id INTEGER PRIMARY KEY, segment INTEGER NOT NULL, first_block INTEGER NOT NULL, last_block INTEGER NOT NULL,
    n INTEGER NOT NULL, first_time_us INTEGER NOT NULL, last_time_us INTEGER NOT NULL,
    pressure_min_kpa REAL, pressure_max_kpa REAL, signal_min_mv TEXT, signal_max_mv TEXT, flags INTEGER NOT NULL);

-- what happened: source is board, host, user or sequencer; value in the unit that kind's name ends in
CREATE TABLE event (
    id INTEGER PRIMARY KEY, host_ns INTEGER NOT NULL, segment INTEGER, time_us INTEGER, source TEXT NOT NULL,
    kind TEXT NOT NULL, value REAL, text TEXT NOT NULL DEFAULT '');

-- cumulative counters of the link, one row a second
CREATE TABLE health (
    id INTEGER PRIMARY KEY, host_ns INTEGER NOT NULL, segment INTEGER, time_us INTEGER, bytes INTEGER NOT NULL,
    frames INTEGER NOT NULL, samples INTEGER NOT NULL, lost INTEGER NOT NULL, crc_errors INTEGER NOT NULL,
    malformed INTEGER NOT NULL, oversize INTEGER NOT NULL, duplicates INTEGER NOT NULL, unknown INTEGER NOT NULL,
    rate_hz REAL, lag_ms REAL);

-- the sequencer's own marks: one row a step, in board time; status is running, reached, timeout or aborted
CREATE TABLE step (
    id INTEGER PRIMARY KEY, segment INTEGER NOT NULL, number INTEGER NOT NULL, cycle INTEGER NOT NULL,
    branch TEXT NOT NULL, target_kpa REAL NOT NULL, ramp_kpa_per_s REAL NOT NULL, started_us INTEGER NOT NULL,
    arrived_us INTEGER, settled_us INTEGER, ended_us INTEGER, status TEXT NOT NULL, detail TEXT NOT NULL DEFAULT '{}');

-- readings of elongation, never changed: a correction is a newer row for the same step, the last one counts
CREATE TABLE reading (
    id INTEGER PRIMARY KEY, utc TEXT NOT NULL, step INTEGER NOT NULL, elongation_mm REAL, resolution_mm REAL,
    source TEXT NOT NULL, reader TEXT NOT NULL DEFAULT '', note TEXT NOT NULL DEFAULT '');

-- results of analyses; content and parameters are JSON
CREATE TABLE result (
    id INTEGER PRIMARY KEY, utc TEXT NOT NULL, kind TEXT NOT NULL, program_version TEXT NOT NULL, seed INTEGER,
    parameters TEXT NOT NULL, content TEXT NOT NULL);
"""

# Only in a recording with a camera: the elongation of each frame, null where there is none and `fault` says why;
# `dropped` frames are missing before it.
CAMERA_TABLE = """
CREATE TABLE IF NOT EXISTS camera (
    id INTEGER PRIMARY KEY, host_ns INTEGER NOT NULL, segment INTEGER, elongation_mm REAL, u_mm REAL,
    fault TEXT NOT NULL DEFAULT '', dropped INTEGER NOT NULL DEFAULT 0)"""

# Only in a recording that was analysed with a video taken elsewhere: the same of its frames, in microseconds of the
# recording's time; session key "video" says which. They count before those of a camera.
VIDEO_TABLE = """
CREATE TABLE IF NOT EXISTS video (
    id INTEGER PRIMARY KEY, time_us INTEGER NOT NULL, elongation_mm REAL, u_mm REAL,
    fault TEXT NOT NULL DEFAULT '', dropped INTEGER NOT NULL DEFAULT 0)"""
OPTIONAL_TABLES = {"camera": CAMERA_TABLE, "video": VIDEO_TABLE}

TABLE_NAMES = tuple(re.findall(r"^CREATE TABLE (\w+)", TABLES, re.MULTILINE))

# `step.branch`: "unloading" from elongation to compression, "loading" back, "start" and "end" outside the cycles.
BRANCHES = ("start", "unloading", "loading", "end")

# What a version added: (table, column, declared type). Files of version 1 may have them or not.
ADDED: dict[int, tuple[tuple[str, str, str], ...]] = {
    2: (("segment", "decoder", "TEXT"), ("block", "crc32", "INTEGER")),
}
LONG_TABLES = ("chunk", "block", "health")  # their values are checked only where they are read whole

_LOG_HEADER_BYTES = 32
LOG_MAGIC = 0x377F0682  # its last bit is set where the checksums are of big-endian words
PAGE_SIZES = tuple(1 << power for power in range(9, 17))
_HEADER: Final = struct.Struct(">16s44xI4xI28x")  # magic, user_version, application_id of SQLite's 100-byte header


def open_recording(path: Path | str) -> sqlite3.Connection:
    """Open a recording for reading, as an untrusted file. RecordingError: missing, no recording, or another schema.

    Read-only; its schema is not executed, no value larger than `checks.MAX_VALUE_BYTES` is read, and the short tables
    are checked (`check_long_tables` checks the others). A recording that is being written, or was left by a killed
    program, is read up to its last commit. Close the connection soon: while it is open the writer's log grows.
    """
    path = Path(path)
    version = layout_version(path)
    if version >= SCHEMA_BREAK:
        raise RecordingError(f"{path} has layout {version}, this program reads {SCHEMA_VERSION}", "Update boat-daq.")
    try:
        connection = sqlite3.connect(
            _read_only_uri(path), uri=True, isolation_level=None, check_same_thread=False, timeout=5.0
        )
    except sqlite3.Error as error:
        raise RecordingError(f"{path} cannot be opened: {error}", "Copy it to a folder that can be written.") from error
    try:
        checks.harden(connection)
        may_lack = {(table, name) for since in ADDED if since > version for table, name, _ in ADDED[since]}
        checks.check_layout(path, connection, layout(), may_lack)
        connection.execute("PRAGMA query_only=ON")
        checks.check_values(path, connection, {name: layout()[name] for name in TABLE_NAMES if name not in LONG_TABLES})
    except checks.DAMAGE as error:
        connection.close()
        raise _unreadable(path, error) from error
    except RecordingError:
        connection.close()
        raise
    return connection


def _read_only_uri(path: Path) -> str:
    """Return how SQLite opens a file: without a log of another one, or one that it cannot read with this -shm.

    The -shm of a killed program is not changed: recovery compares it with -wal.
    """
    log, shared, journal = (path.with_name(path.name + suffix) for suffix in ("-wal", "-shm", "-journal"))
    uri = f"{path.absolute().as_uri()}?mode=ro"
    if is_being_written(path):
        return uri
    if log.is_file() and not journal.exists() and not (needs_log(path) and _has_frames(log)):
        return uri + "&immutable=1"
    return uri + ("&readonly_shm=1" if shared.is_file() else "")


def needs_log(path: Path) -> bool:
    """Return whether a database was not closed into one file."""
    with path.open("rb") as file:
        return file.read(19)[18:] != b"\x01"


def _has_frames(log: Path) -> bool:
    """Return whether SQLite would look for frames in a log."""
    try:
        with log.open("rb") as file:
            head = file.read(_LOG_HEADER_BYTES + 1)
    except PermissionError:
        return True  # SQLite reports it
    magic, size = int.from_bytes(head[:4], "big"), int.from_bytes(head[8:12], "big")
    return len(head) > _LOG_HEADER_BYTES and magic & ~1 == LOG_MAGIC and size in PAGE_SIZES


def _unreadable(path: Path, error: Exception) -> RecordingError:
    """Return the error for a recording that SQLite cannot read."""
    log, journal = (path.with_name(path.name + suffix) for suffix in ("-wal", "-journal"))
    if log.exists() and not os.access(path.parent, os.W_OK):
        cause = f"{path} was not closed, and its log cannot be read in a read-only folder"
        return RecordingError(
            cause, f"Copy it with {log.name} and {path.name}-shm into a writable folder, and recover it there."
        )
    if journal.exists():
        return damaged(path, "was left in the middle of a change")
    return damaged(path, f"cannot be read: {error}")


@cache
def layout() -> checks.Columns:
    """Return the columns that `TABLES` declares."""
    return checks.declared(TABLES, TABLE_NAMES)


@cache
def optional_layout() -> checks.Columns:
    """Return the columns of the tables that only some recordings have."""
    return checks.declared(";".join(OPTIONAL_TABLES.values()), tuple(OPTIONAL_TABLES))


def optional_rows(path: Path | str, connection: sqlite3.Connection, table: str) -> list[tuple[Any, ...]]:
    """Return all columns but `id` of one of `OPTIONAL_TABLES`; no rows without it. RecordingError: it does not fit."""
    if not checks.columns_of(connection, (table,))[table]:
        return []
    layout = {table: optional_layout()[table]}
    checks.check_layout(Path(path), connection, layout, set())
    checks.check_values(Path(path), connection, layout)
    columns = ", ".join(name for name in layout[table] if name != "id")
    return connection.execute(f"SELECT {columns} FROM {table} ORDER BY id").fetchall()  # noqa: S608 - names are ours


def check_long_tables(path: Path | str, connection: sqlite3.Connection) -> None:
    """Check the tables that grow with time, before they are read. RecordingError: a value does not fit."""
    checks.check_values(Path(path), connection, {name: layout()[name] for name in LONG_TABLES})


def layout_version(path: Path) -> int:
    """Return the layout version, from the first 100 bytes, without SQLite. RecordingError: no recording."""
    if path.exists() and not (path.is_file() or path.is_dir()):  # reading a pipe would block
        raise RecordingError(f"{path} is not a regular file", "Check the name.")
    try:
        with path.open("rb") as file:
            head = file.read(_HEADER.size)
    except FileNotFoundError:
        raise RecordingError(f"there is no file {path}", "Check the name.") from None
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}", "Check its permissions.") from error
    if not head:
        raise RecordingError(f"{path} is empty (0 bytes)", "Nothing was recorded in it.")
    if len(head) < _HEADER.size or not head.startswith(b"SQLite format 3\0"):
        raise RecordingError(f"{path} is not a boat-daq recording, or the copy is incomplete", "Copy the file again.")
    _, version, application = _HEADER.unpack(head)
    if application != APPLICATION_ID or version < 1:
        raise RecordingError(f"{path} is a database of another program, not a recording")
    return int(version)


def refuse_newer(path: Path) -> None:
    """Refuse to extend a recording of a newer layout: it could become inconsistent. RecordingError: both versions."""
    version = layout_version(path)
    if version > SCHEMA_VERSION:
        cause = f"{path} has layout {version}, this program writes {SCHEMA_VERSION} and can only read it"
        raise RecordingError(cause, "Update boat-daq to add to it.")


def run_end_of(meta: Mapping[str, Any]) -> RunEnd | None:
    """Return how a recording ended; None while it is under way or where its program was killed."""
    code = meta.get("run_end") or str(meta["stop_reason"]).partition(":")[0]  # older files have the sentence alone
    return RunEnd.STOPPED if code == "disconnected" else next((end for end in RunEnd if end == code), None)


def breaks_of(meta: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the session's `resumptions`, oldest first. RecordingError: they are not a list of breaks."""
    entries = meta.get("resumptions", [])
    if not checks.are_breaks(entries):
        raise RecordingError("the session's 'resumptions' are not a list of breaks", checks.FOREIGN)
    return list(entries)


def note_of(connection: sqlite3.Connection, meta: Mapping[str, Any]) -> str | None:
    """Return the note of a recording: the newest that was added after it was closed, else that of its start."""
    sql = "SELECT text FROM event WHERE kind = ? AND source = 'user' ORDER BY id DESC LIMIT 1"
    added = connection.execute(sql, (NOTE_EVENT,)).fetchone()
    return meta.get("note") if added is None else str(added[0])


def read_session(connection: sqlite3.Connection) -> dict[str, Any]:
    """Return the table `session`, decoded from JSON. RecordingError: not JSON, or a required key is missing."""
    try:
        rows = connection.execute("SELECT key, value FROM session").fetchall()
        if sum(len(value) for _, value in rows) > checks.MAX_TEXT:
            raise RecordingError(f"the session's description is longer than {checks.MAX_TEXT} bytes", checks.FOREIGN)
        meta = {str(key): json.loads(value) for key, value in rows}
    except (*checks.DAMAGE, ValueError, TypeError, RecursionError) as error:
        raise RecordingError(f"the session's description cannot be read: {error}") from error
    missing = [key for key in SESSION_KEYS if key not in meta]
    if missing:
        raise RecordingError(f"the session's description has no {missing[0]!r}")
    checks.check_session(meta)
    return meta
