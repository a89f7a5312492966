"""Checks of layout and values, for recordings from untrusted sources.

SQLite stores any type in any column, and executes what a schema holds: views, triggers, virtual tables, generated
columns. So the schema is compared before a row is read, and values are checked where they are used. Nothing is
repaired: a file that does not fit is refused by name.
"""

from __future__ import annotations

import math
import sqlite3
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from datetime import datetime
from pathlib import Path
from typing import Any

from protocol.base.errors import RecordingError, damaged
from protocol.recording.channels import are_channels

Columns = Mapping[str, Mapping[str, tuple[str, bool]]]  # table -> column -> (declared type, whether it is required)

# what sqlite3 raises on a damaged file; an invalid name in SQLite's own message cannot be decoded
DAMAGE = (sqlite3.Error, UnicodeDecodeError, MemoryError)
MAX_VALUE_BYTES = 64 * 2**20  # far above every text or blob of a recording; a larger one is refused by SQLite itself
MAX_TEXT = 8 * 2**20  # bytes; as JSON it may take 25 times as many
FOREIGN = "The file is damaged, or was not made by boat-daq."
MAX_ROWS = {"segment": 200_000, "step": 200_000, "reading": 200_000, "result": 10_000}  # a plan has 100,000 steps
_STEPS_A_CALL = 10_000  # of SQLite's virtual machine
_BYTES_A_CALL = 300  # a row of 15 columns takes some 150 steps, and no less than 5 bytes of the file
_FEWEST_CALLS = 100
_WHOLE_MAX = 2**62  # differences of two such still fit 64 bits
_TYPES = {
    "INTEGER": f"typeof({{0}}) = 'integer' AND {{0}} BETWEEN -{_WHOLE_MAX} AND {_WHOLE_MAX}",
    "REAL": "typeof({0}) = 'real' AND abs({0}) <= 1.7e308",
    "TEXT": "typeof({0}) = 'text'",
    "BLOB": "typeof({0}) = 'blob'",
}


def harden(connection: sqlite3.Connection, *, damaged: bool = False) -> None:
    """Set a connection to execute nothing that its file holds. sqlite3.Error: not a database."""
    for pragma in ("trusted_schema=OFF", "cell_size_check=ON", "mmap_size=0", "temp_store=MEMORY"):
        connection.execute(f"PRAGMA {pragma}")
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_VALUE_BYTES)
    connection.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)
    if sys.version_info >= (3, 12) and not damaged:
        connection.setconfig(sqlite3.SQLITE_DBCONFIG_DEFENSIVE, True)


def columns_of(connection: sqlite3.Connection, tables: Sequence[str]) -> Columns:
    """Return what the tables of a database declare; generated columns are not among them."""
    return {
        table: {
            name: (kind.upper(), bool(not_null or key))
            for _, name, kind, not_null, _, key in connection.execute(f"PRAGMA main.table_info({table})")
        }
        for table in tables
    }


def declared(sql: str, tables: Sequence[str]) -> Columns:
    """Return what the statements `sql` declare."""
    with closing(sqlite3.connect(":memory:")) as reference:
        reference.executescript(sql)
        return columns_of(reference, tables)


def refuse_active(path: Path, connection: sqlite3.Connection) -> set[str]:
    """Return the names of the tables. RecordingError: there is a view, a trigger or a virtual table."""
    rows = connection.execute("SELECT type, name, sql FROM main.sqlite_schema LIMIT 1000").fetchall()
    for kind, name, sql in rows:
        if kind in {"view", "trigger"} or "VIRTUAL" in str(sql).upper()[:20]:
            remedy = "It was not made by boat-daq."
            raise RecordingError(f"{path} contains code that would run when it is read ({name!s:.60})", remedy)
    return {str(name) for kind, name, _ in rows if kind == "table"}


def check_layout(path: Path, connection: sqlite3.Connection, ours: Columns, may_lack: set[tuple[str, str]]) -> None:
    """Refuse a file without the columns `ours`, except `may_lack` (table, column). RecordingError: names it."""
    missing = set(ours) - refuse_active(path, connection)
    if missing:
        raise damaged(path, f"is an incomplete recording: it has no table {min(missing)!r}")
    theirs = columns_of(connection, tuple(ours))
    for table, columns in ours.items():
        absent = [name for name in columns if name not in theirs[table]]
        for name in absent:
            if (table, name) not in may_lack:
                raise RecordingError(f"{path}: table {table!r} has no column {name!r}")
        if absent:
            kept = ", ".join(name for name in columns if name not in absent)
            nulls = ", ".join(f"NULL AS {name}" for name in absent)
            connection.execute(f"CREATE TEMP VIEW {table} AS SELECT {kept}, {nulls} FROM main.{table}")  # noqa: S608


def check_values(path: Path, connection: sqlite3.Connection, columns: Columns) -> None:
    """Refuse values of another type than their column's or out of bounds, and too many rows.

    A forged file may link its pages in a ring, or share those of one long value among many rows: reading is aborted
    after more steps than a file of that size needs, and texts and blobs together may not be longer than the file.
    RecordingError: names table and column. sqlite3.Error: the rows cannot be read.
    """
    size = bytes_of(path)
    left = _FEWEST_CALLS + size // _BYTES_A_CALL

    def give_up() -> bool:
        nonlocal left
        left -= 1
        return left < 0

    connection.set_progress_handler(give_up, _STEPS_A_CALL)
    try:
        for table, kinds in columns.items():
            _check_number(path, connection, table)
            _check_table(path, connection, table, kinds)
            _check_lengths(path, connection, table, kinds, size)
    finally:
        connection.set_progress_handler(None, 0)


def _check_number(path: Path, connection: sqlite3.Connection, table: str) -> None:
    most = MAX_ROWS.get(table)
    if most is not None and connection.execute(f"SELECT 1 FROM {table} LIMIT 1 OFFSET {most}").fetchone():  # noqa: S608
        raise RecordingError(f"{path}: table {table!r} has more than {most} rows", FOREIGN)


def bytes_of(path: Path) -> int:
    """Return the size of a recording and its log."""
    files = (path, path.with_name(path.name + "-wal"))
    return sum(file.stat().st_size for file in files if file.exists())


def _check_table(path: Path, connection: sqlite3.Connection, table: str, kinds: Mapping[str, tuple[str, bool]]) -> None:
    tests = {
        name: f"({_TYPES[kind].format(name)}{'' if needed else f' OR {name} IS NULL'})"
        for name, (kind, needed) in kinds.items()
    }
    sql = f"SELECT {', '.join(tests.values())} FROM {table} WHERE NOT ({' AND '.join(tests.values())}) LIMIT 1"  # noqa: S608
    row = connection.execute(sql).fetchone()
    if row is not None:
        column = next(name for name, fits in zip(tests, row, strict=True) if not fits)
        raise RecordingError(f"{path}: table {table!r} has an impossible value in column {column!r}", FOREIGN)


def _check_lengths(
    path: Path, connection: sqlite3.Connection, table: str, kinds: Mapping[str, tuple[str, bool]], size: int
) -> None:
    held, longest = 0, 0
    if blobs := [f"sum(length({name}))" for name, (kind, _) in kinds.items() if kind == "BLOB"]:
        held = connection.execute(f"SELECT {' + '.join(blobs)} FROM {table}").fetchone()[0] or 0  # noqa: S608
    if texts := [f"coalesce(length(CAST({name} AS BLOB)), 0)" for name, (kind, _) in kinds.items() if kind == "TEXT"]:
        for lengths in connection.execute(f"SELECT {', '.join(texts)} FROM {table}"):  # noqa: S608
            held, longest = held + sum(lengths), max(longest, *lengths)
            if held > size or longest > MAX_TEXT:  # each was read to be measured: stop here
                break
    if held > size or longest > MAX_TEXT:
        what = "more than the file can" if held > size else f"a text of more than {MAX_TEXT} bytes"
        raise RecordingError(f"{path}: table {table!r} claims to hold {what}", FOREIGN)


def value_fits(declared_as: tuple[str, bool], value: object) -> bool:
    """Return whether one value that was read passes the test of `check_values`."""
    kind, needed = declared_as
    if value is None:
        return not needed
    if kind == "INTEGER":
        return isinstance(value, int) and abs(value) <= _WHOLE_MAX
    if kind == "REAL":
        return isinstance(value, float) and math.isfinite(value)
    return isinstance(value, str if kind == "TEXT" else bytes)


Check = Callable[[Any], bool]


def _of(kind: type) -> Check:
    return lambda v: isinstance(v, kind)


def _among(*values: object) -> Check:
    return lambda v: v in values


def _number(low: float, high: float) -> Check:
    return lambda v: isinstance(v, int | float) and not isinstance(v, bool) and low <= v <= high


def _whole(low: int, high: int) -> Check:
    return lambda v: isinstance(v, int) and not isinstance(v, bool) and low <= v <= high


def _time(value: Any) -> bool:
    """Return whether it is an ISO 8601 time of the years 1900 to 2999."""
    try:
        return isinstance(value, str) and 1900 <= datetime.fromisoformat(value).year < 3000
    except ValueError:
        return False


def _limits(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_number(-1e9, 1e9), value))


_TEXT, _COUNT = _of(str), _whole(0, _WHOLE_MAX)
_COUNTS = ("host_ns", "first_segment", "first_chunk", "first_step", "first_cycle", "complete_cycles", "last_result")
_BREAK_VALUES: dict[str, Check] = {
    **{"utc": _time, "cause": _TEXT, "break_s": lambda v: v is None or _number(-1e12, 1e12)(v)},
    **dict.fromkeys(_COUNTS, _COUNT),
}


def are_breaks(value: Any) -> bool:
    """Return whether a session's `resumptions` are a list of breaks."""
    return isinstance(value, list) and all(
        isinstance(entry, dict) and all(fits(entry.get(key)) for key, fits in _BREAK_VALUES.items()) for entry in value
    )


_TIME_S, _INDEX = _number(-1e15, 1e15), _whole(0, 1 << 32)
_HOLE_VALUES: dict[str, Check] = {
    **dict.fromkeys(("after_index", "before_index", "samples"), lambda v: v is None or _INDEX(v)),
    **dict.fromkeys(("after_s", "before_s"), lambda v: v is None or _TIME_S(v)),
    "segment": _COUNT,
}


def are_missing(value: Any) -> bool:
    """Return whether a session's `missing` names holes in the samples, and tables with first and last id."""
    return (
        isinstance(value, dict)
        and all(isinstance(value.get(key), list) for key in ("samples", "rows"))
        and all(
            isinstance(hole, dict) and all(key in hole and fits(hole[key]) for key, fits in _HOLE_VALUES.items())
            for hole in value["samples"]
        )
        and all(
            isinstance(row, list) and len(row) == 3 and isinstance(row[0], str) and all(map(_COUNT, row[1:]))
            for row in value["rows"]
        )
    )


# The table `session` is key -> JSON value, null where unknown.
SESSION_VALUES: dict[str, Check] = {
    "uuid": _TEXT,  # of this recording
    "status": _TEXT,  # "recording", "closed", "recovered"; "recording" in a file that no program writes = killed
    "simulated": _of(bool),  # true for the virtual board
    "program_version": _TEXT,
    "started_utc": _time,  # with offset
    "started_host_ns": _COUNT,  # the monotonic clock at that instant
    "ended_utc": _time,  # null until closed
    "ended_host_ns": _COUNT,
    "stop_reason": _TEXT,  # "finished", "stopped", "aborted: ...", null while recording
    "operator": _TEXT,
    "unit": _TEXT,  # SA1 ..
    "note": _TEXT,
    "port": _TEXT,
    "board_id": _TEXT,
    "profile": _TEXT,  # the text profile's TOML, or null for the binary protocol
    "n_sensors": _whole(1, 4),
    "sample_kind": _among("counts", "signal"),
    "sample_dtype": _of(list),  # rows of describe_dtype
    "vref_mv": _number(0, 1e9),
    "adc_bits": _whole(0, 32),  # 0 where the samples are signals
    "polarity": _among(-1, 1),  # +1 where the board's voltage rises with light, -1 where its stage inverts
    "rate_hz": _number(0, 1e9),  # as requested
    "limits_pa": _limits,  # [min, max]: the tightest of board, unit and plan
    "settings": _of(dict),  # snapshot
    "plan": _of(dict),  # snapshot of the plan, or null
    "run_end": _among("finished", "stopped", "aborted", "fault", "interrupted"),  # the code of stop_reason; newer files
    "resumptions": are_breaks,  # of a resumed run
    "missing": are_missing,  # what a recovery did not find; of salvaged recordings
    "channels": are_channels,  # [name, unit] of each column of the samples' `channel`; newer files
    "derived": lambda value: isinstance(value, list),  # of older programs; no longer read
    "camera": _of(dict),  # source, mark_mm, u_scale ...; of recordings with a camera
    "video": _of(dict),  # the same of a video taken elsewhere, with its utc and sha256
    "metadata": _of(dict),  # as stated when it began, see `protocol.recording.metadata`; newer files
}


def check_session(meta: Mapping[str, Any]) -> None:
    """Refuse a session with a value that its key cannot have; null means unknown. RecordingError: names the key."""
    for key, fits in SESSION_VALUES.items():
        if meta.get(key) is not None and not fits(meta[key]):
            raise RecordingError(f"the session's description has an unusable {key!r}: {meta[key]!r:.60}", FOREIGN)
    if meta.get("sample_kind") == "counts" and (meta.get("vref_mv") is None or not meta.get("adc_bits")):
        raise RecordingError("the session's description lacks the scale of its counts (vref_mv, adc_bits)")
