"""Recover what a killed session or a bad disk left: close it properly, or save elsewhere what is readable.

Rules: a recording that a living program writes is left alone. The log is checked first: against -shm, which says how
much of which log was committed, and frame by frame, because SQLite ignores all behind a damaged one; then the file,
read-only. A sound file with its whole log is closed in place. Else file and log are never touched (`salvage`): a new
file beside them gets what can be read, and says what is missing.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from boat_daq.engine.recording.file import RecordingFile, Statement, set_meta, storage_error
from boat_daq.engine.recording.rows import INSERT_EVENT, OverviewRows
from boat_daq.engine.recording.salvage.salvaged_file import Progress, fault_of, open_damaged, salvage
from boat_daq.engine.sample_columns import mv_per_count
from protocol.base.errors import DamagedRecordingError, RecordingError, StorageError
from protocol.recording import schema
from protocol.recording.checks import DAMAGE, harden
from protocol.recording.damaged_log import (
    OTHERS_LOG,
    LogCheck,
    LogState,
    WriteAheadLog,
    check_log,
    open_alone,
    read_log,
)
from protocol.recording.missing import Missing, end_hole, missing_of
from protocol.recording.writer_lock import WriterLock, is_being_written

_ROWS = 1_000  # between two reports of progress
_NAMES_ANOTHER = bytes.fromhex("d9d505f920a163d7")  # how a journal ends that belongs to a change of several files


@dataclass(frozen=True, slots=True)
class Recovery:
    """What a recovery did."""

    status: str  # "recovered", "salvaged" (into another file), or "closed" (there was nothing to do)
    path: Path  # the file to use from now on
    samples: int
    chunks: int
    damaged: tuple[str, ...] = ()
    missing: Missing = field(default_factory=Missing)
    log: LogState = LogState.NONE
    missing_pages: int | None = 0  # of the log; None where it is unknown how many
    kept: tuple[Path, ...] = ()  # the originals, where anything is or may be missing


def find_interrupted(folder: Path) -> list[Path]:
    """Return the recordings of a folder that a killed program left open."""
    return [path for path in sorted(folder.glob(f"*{schema.SUFFIX}")) if _is_interrupted(path)]


def recover(path: Path, *, progress: Progress | None = None) -> Recovery:
    """Close properly what a killed session left, or save what a damaged file holds."""
    if is_being_written(path):
        raise StorageError(f"{path} is being written by another program", "Close it there first.")
    if not path.is_file() or not os.access(path, os.R_OK):
        schema.refuse_newer(path)  # names what is wrong
    log = read_log(path)
    checked = check_log(path, log)  # before SQLite opens the file, which changes -shm
    fault = [text] if (text := checked.fault(path.name)) else []
    used = None if checked.state is LogState.FOREIGN or not checked.usable else log
    changed = schema.needs_log(path) or os.path.lexists(path.with_name(path.name + "-journal"))
    if changed and (fault or (log is not None and log.damage)):
        return _salvage(path, used, [*fault, *([] if used is None else used.damage)], progress, checked)
    schema.refuse_newer(path)
    _roll_back(path)
    faults, structural = _check(path, progress)
    if structural and used is not None and used.committed() and _is_sound_alone(path):
        return _salvage(path, None, [OTHERS_LOG.fault(path.name)], progress, OTHERS_LOG)
    if structural:
        return _salvage(path, used, [*fault, *faults], progress, checked)
    with closing(schema.open_recording(path)) as db:
        meta = schema.read_session(db)
        counts = _counts(db)
    status = meta["status"]
    found = [*fault, *faults]
    if (found and status == "recording") or any("block" in text for text in faults):
        return _salvage(path, used, found, progress, replace(checked, end_known=checked.missing == 0))
    del log, used  # Windows cannot remove a mapped file
    kept: tuple[Path, ...] = ()
    if status == "recording":
        if checked.state is LogState.ABSENT:
            kept = (_copy_unclosed(path),)
        meta |= _close_in_place(path, end_known=checked.missing == 0)
        status = "recovered"
    elif path.with_name(path.name + "-wal").exists() and not fault:  # its log is left
        RecordingFile.reopen(path).close()
    elif checked.state is LogState.ABSENT:
        checked = LogCheck(LogState.NONE)
    return Recovery(status, path, *counts, tuple(found), missing_of(meta), checked.state, checked.missing, kept)


def _salvage(
    path: Path, log: WriteAheadLog | None, faults: list[str], progress: Progress | None, checked: LogCheck
) -> Recovery:
    target, lost, missing = salvage(path, log, end_known=checked.end_known, progress=progress)
    _close_in_place(target)
    with closing(schema.open_recording(target)) as copy:
        counts = _counts(copy)
    kept = tuple(file for file in (path, path.with_name(path.name + "-wal")) if file.exists() and file.stat().st_size)
    damaged = tuple(dict.fromkeys([*faults, *lost]))
    return Recovery("salvaged", target, *counts, damaged, missing, checked.state, checked.missing, kept)


def _is_sound_alone(path: Path) -> bool:
    with suppress(*DAMAGE), closing(open_alone(path)) as alone:
        return bool(alone.execute("PRAGMA quick_check(1)").fetchone() == ("ok",))
    return False


def _copy_unclosed(path: Path) -> Path:
    """Keep a file as it is beside the one that is closed: its log, if it is found, completes only that."""
    names = (path.with_name(f"{path.name}-unclosed{number or ''}") for number in range(1000))
    target = next(name for name in names if not name.exists())
    try:
        shutil.copyfile(path, target)
    except OSError as error:
        target.unlink(missing_ok=True)
        raise storage_error(target, error) from error
    return target


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
            return list(_wrong_rows(db, progress)), False
    except (*DAMAGE, RecordingError) as error:
        if not _looks_like_ours(path):
            remedy = error.remedy if isinstance(error, RecordingError) else ""
            if isinstance(error, DamagedRecordingError):  # whose remedy, recovery, was just tried
                remedy = "Nothing in it can be read; use another copy."
            raise RecordingError(str(error), remedy) from error
        return [str(error)], True


def _looks_like_ours(path: Path) -> bool:
    """Whether a file that cannot be opened as a recording may still hold one."""
    with suppress(OSError, *DAMAGE), closing(open_damaged(path)) as db:
        return bool(db.execute("SELECT count(*) FROM session").fetchone()[0])
    return False


def _wrong_rows(db: sqlite3.Connection, progress: Progress | None) -> Iterator[str]:
    dtype = schema.session_dtype(schema.read_session(db))
    for table in ("chunk", "block"):
        names = ", ".join(schema.layout()[table])
        total = db.execute(f"SELECT coalesce(max(id), 0) FROM {table}").fetchone()[0]  # noqa: S608 - names are ours
        for row in db.execute(f"SELECT {names} FROM {table} ORDER BY id"):  # noqa: S608
            if fault := fault_of(table, row, dtype):
                yield fault
            if progress is not None and row[0] % _ROWS == 0:
                progress(row[0], total)


def _counts(db: sqlite3.Connection) -> tuple[int, int]:
    """Return how many samples and chunks are there, whatever the counts of the blocks."""
    size = schema.session_dtype(schema.read_session(db)).itemsize
    samples, chunks = db.execute(
        "SELECT (SELECT coalesce(sum(length(samples) / ?), 0) FROM block), (SELECT count(*) FROM chunk)", (size,)
    ).fetchone()
    return int(samples), int(chunks)


def _close_in_place(path: Path, *, end_known: bool = True) -> dict[str, Any]:
    """Complete the overview, mark the recording, and close it into one file. Return what is added to its session."""
    added: dict[str, Any] = {}
    with closing(schema.open_recording(path)) as db:
        meta = schema.read_session(db)
        if not end_known:
            added["missing"] = asdict(Missing((end_hole(db, meta),)))
        statements = [*_missing_overview(db, meta), *_end(db, meta), *set_meta(added)]
    file = RecordingFile.reopen(path)
    try:
        file.commit(statements)
    except StorageError:
        file.abandon()
        raise
    file.close()
    return added


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
