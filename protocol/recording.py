"""The recording's schema: what a `.boat` file holds, described once for writer and readers.

One SQLite file a session. The raw bytes as they came and, in the same transaction, the samples decoded from them, so
that every number can be derived again from the bytes. Changes are additive only: a column or a table may be added
(and `SCHEMA_VERSION` raised), none renamed or given another meaning.

Samples are kept in blocks: one row of table `block` holds many samples as little-endian records of `sample_dtype`.
Fifteen lines read them in any language:

    import json, sqlite3, numpy as np
    db = sqlite3.connect("file:RUN.boat?mode=ro", uri=True)
    meta = {key: json.loads(value) for key, value in db.execute("SELECT key, value FROM session")}
    dtype = np.dtype([(name, code, *([tuple(shape)] if shape else [])) for name, code, shape in meta["sample_dtype"]])
    rows = db.execute("SELECT samples FROM block ORDER BY id")
    samples = np.concatenate([np.frombuffer(blob, dtype) for (blob,) in rows])

Three clocks, never mixed: `time_us` is the board's, unwrapped, and is the time of every analysis; `host_ns` is the
host's monotonic clock at the arrival of the bytes; UTC with its offset names the session and stands in `session`.
"""

from __future__ import annotations

import enum
import json
import sqlite3
import struct
from contextlib import closing
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from protocol.errors import RecordingError

APPLICATION_ID = 0x424F4154  # "BOAT": SQLite's `application_id`, so that `file` and we know the file for ours
SCHEMA_VERSION = 1  # SQLite's `user_version`
SUFFIX = ".boat"

SampleKind = Literal["counts", "signal"]


class BoardState(enum.IntEnum):
    """State of the board's pressure control, as each sample carries it."""

    IDLE = 0
    RAMPING = 1
    HOLDING = 2
    VENTED = 3
    FAULT = 4


class SampleFlag(enum.IntFlag):
    """What is known of a sample: the low byte as the board sent it, the high byte set by the host."""

    SATURATED = 0x0001
    ESTOP = 0x0002
    WATCHDOG_ARMED = 0x0004
    PRESSURE_INVALID = 0x0008
    DROPPED_BEFORE = 0x0010
    IMPLAUSIBLE = 0x0100  # good checksum, absurd value: kept, and left out of every figure
    GAP_BEFORE = 0x0200  # samples are missing between the one before and this one


NOT_FOR_FIGURES = SampleFlag.SATURATED | SampleFlag.PRESSURE_INVALID | SampleFlag.IMPLAUSIBLE


def sample_dtype(n_sensors: int, kind: SampleKind = "counts") -> np.dtype[np.void]:
    """Return the record of one sample.

    Parameters
    ----------
    n_sensors : number of sensors, 1 to 4.
    kind : "counts" where the board sends ADC counts with the emitter on and off; "signal" where a text
        profile gives a signal in mV and there is nothing to subtract.

    Returns
    -------
    Packed little-endian dtype with fields `index` (sampling instant, counted from START), `time_us` (board clock,
    unwrapped), `host_ns` (host monotonic clock at arrival), `pressure_pa` (gauge), `state`, `flags`, and for each
    sensor `lit` and `dark` (counts), or `signal_mv`.
    """
    head: list[Any] = [
        ("index", "<u4"),
        ("time_us", "<i8"),
        ("host_ns", "<i8"),
        ("pressure_pa", "<f8"),
        ("state", "u1"),
        ("flags", "<u2"),
    ]
    if kind == "counts":
        return np.dtype([*head, ("lit", "<u2", (n_sensors,)), ("dark", "<u2", (n_sensors,))])
    return np.dtype([*head, ("signal_mv", "<f8", (n_sensors,))])


def describe_dtype(dtype: np.dtype[np.void]) -> list[tuple[str, str, tuple[int, ...]]]:
    """Return `dtype` as (name, code, shape) rows, the form kept in `session`."""
    assert dtype.fields is not None
    return [(name, field[0].base.str, field[0].shape) for name, field in dtype.fields.items()]


def dtype_from_description(rows: list[Any]) -> np.dtype[np.void]:
    """Return the dtype that `describe_dtype` described; anything but plain numbers is refused.

    Raises
    ------
    ValueError : a field is not a plain little-endian number.
    """
    fields: list[Any] = []
    for name, code, shape in rows:
        if np.dtype(code).kind not in "iuf" or any(int(n) < 1 or int(n) > 64 for n in shape):
            raise ValueError(f"field {name!r} has the unusable type {code!r}")
        fields.append((str(name), code, tuple(int(n) for n in shape)) if shape else (str(name), code))
    return np.dtype(fields)


# `session` is key -> JSON value. Keys that every recording has:
SESSION_KEYS = (
    "uuid",  # of this recording
    "status",  # "recording", "closed", "recovered"; "recording" in a file nobody writes = a killed session
    "simulated",  # true for the virtual board
    "program_version",
    "started_utc",  # ISO 8601 with offset
    "started_host_ns",  # the monotonic clock at that instant
    "ended_utc",  # null until closed
    "ended_host_ns",
    "stop_reason",  # "finished", "stopped", "aborted: ...", null while recording
    "operator",
    "unit",  # SA1 ..
    "note",
    "port",
    "board_id",
    "profile",  # the text profile's TOML, or null for the binary protocol
    "n_sensors",
    "sample_kind",  # "counts" or "signal"
    "sample_dtype",  # rows of describe_dtype
    "vref_mv",
    "adc_bits",
    "polarity",  # +1 where the board's voltage rises with light, -1 where its stage inverts
    "rate_hz",  # as asked for
    "limits_pa",  # [min, max]: the tightest of board, unit and plan
    "settings",  # snapshot
    "plan",  # snapshot of the plan, or null
)

TABLES = """
CREATE TABLE session (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;

-- bytes as they came (direction 0) and as they were sent (direction 1)
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

TABLE_NAMES = (
    "session", "chunk", "segment", "block", "overview", "event", "health", "step", "reading", "result",
)  # fmt: skip

# `step.branch`: "unloading" from elongation to compression, "loading" back, "start" and "end" outside the cycles.
BRANCHES = ("start", "unloading", "loading", "end")

MAX_VALUE_BYTES = 64 * 2**20  # no honest text or blob of ours comes near; a larger one is refused by SQLite itself
_HEADER: Final = struct.Struct(">16s44xI4xI28x")  # magic, user_version, application_id of SQLite's 100-byte header


def open_recording(path: Path | str) -> sqlite3.Connection:
    """Open a recording for reading, trusting nothing in it.

    The file may come from anywhere: it is opened read-only, its schema is not run (no views, triggers or virtual
    tables), and no value larger than `MAX_VALUE_BYTES` is read. A recording that is being written, or was left by a
    killed program, is read up to its last commit. Close the connection soon: while it is open the writer's log grows.

    Raises
    ------
    RecordingError : the file is missing, is not a recording, or its schema is not ours.
    """
    path = Path(path)
    _check_header(path)
    uri = f"{path.absolute().as_uri()}?mode=ro"
    try:
        connection = sqlite3.connect(uri, uri=True, isolation_level=None, check_same_thread=False, timeout=5.0)
    except sqlite3.Error as error:
        raise RecordingError(f"{path} cannot be opened: {error}", "Copy it to a folder that can be written.") from error
    try:
        for pragma in ("trusted_schema=OFF", "query_only=ON", "cell_size_check=ON", "mmap_size=0"):
            connection.execute(f"PRAGMA {pragma}")
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_VALUE_BYTES)
        connection.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)
        _check_schema(path, connection)
    except sqlite3.Error as error:
        connection.close()
        raise RecordingError(f"{path} cannot be read: {error}", f"Try: boat-daq recover {path}") from error
    except RecordingError:
        connection.close()
        raise
    return connection


def _check_header(path: Path) -> None:
    """Refuse what is not a recording by the first 100 bytes, before SQLite looks at it."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEADER.size)
    except FileNotFoundError:
        raise RecordingError(f"there is no file {path}") from None
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from error
    if not head:
        raise RecordingError(f"{path} is empty (0 bytes)", "Nothing was recorded in it.")
    if len(head) < _HEADER.size or not head.startswith(b"SQLite format 3\0"):
        raise RecordingError(
            f"{path} is not a recording", f"Recordings end in {SUFFIX} and are made by boat-daq record."
        )
    _, version, application = _HEADER.unpack(head)
    if application != APPLICATION_ID or version < 1:
        raise RecordingError(f"{path} is a database of another program, not a recording")


def _check_schema(path: Path, connection: sqlite3.Connection) -> None:
    """Refuse a file whose tables are missing, are something else, or would run something when read."""
    rows = connection.execute("SELECT type, name, sql FROM sqlite_schema LIMIT 1000").fetchall()
    active = [name for kind, name, sql in rows if kind in {"view", "trigger"} or "VIRTUAL" in str(sql).upper()[:20]]
    if active:
        raise RecordingError(
            f"{path} holds something that runs when read ({active[0]!r})", "It was not made by boat-daq."
        )
    missing = set(TABLE_NAMES) - {name for kind, name, _ in rows if kind == "table"}
    if missing:
        raise RecordingError(
            f"{path} is not a whole recording: no table {min(missing)!r}", f"Try: boat-daq recover {path}"
        )
    with closing(sqlite3.connect(":memory:")) as reference:
        reference.executescript(TABLES)
        for table in TABLE_NAMES:
            query = f"SELECT name FROM pragma_table_info('{table}')"  # noqa: S608 - names are ours
            ours, theirs = ({row[0] for row in db.execute(query)} for db in (reference, connection))
            if not ours <= theirs:
                raise RecordingError(f"{path}: table {table!r} has no column {min(ours - theirs)!r}")


def read_session(connection: sqlite3.Connection) -> dict[str, Any]:
    """Return the table `session` as a dictionary of decoded JSON values.

    Raises
    ------
    RecordingError : a value is not JSON, or a key that every recording has is missing.
    """
    try:
        meta = {str(key): json.loads(value) for key, value in connection.execute("SELECT key, value FROM session")}
    except (sqlite3.Error, ValueError, TypeError, RecursionError) as error:
        raise RecordingError(f"the session's description cannot be read: {error}") from error
    missing = [key for key in SESSION_KEYS if key not in meta]
    if missing:
        raise RecordingError(f"the session's description has no {missing[0]!r}")
    return meta
