"""Upgrade an older recording to the present layout. The original stays beside it, unchanged to the last byte.

Strategy: a copy gets the columns that it lacks and is checked; then the original takes the name of a backup and the
copy the original's name, each in one step of the file system. Whatever stops it in between, the original's name leads
to a whole file, and no byte of the original was written.

Rules: only columns are added (`ADDED`), so every value reads as before; what an older program did not keep stays
unknown (NULL). A recording that is in progress, interrupted or damaged is refused: recover it first.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from boat_daq.engine.recording.file import storage_error
from protocol.base.errors import RequestError, StorageError
from protocol.base.whole_file import written_whole
from protocol.recording import ADDED, SCHEMA_VERSION, layout_version, open_recording, read_session, refuse_newer
from protocol.recording.checks import DAMAGE, columns_of, harden
from protocol.recording.writer_lock import WriterLock


@dataclass(frozen=True, slots=True)
class Upgrade:
    """What an upgrade did."""

    status: str  # "upgraded", or "current" where there was nothing to do
    path: Path
    version_before: int
    version: int
    backup: Path | None = None


def upgrade(path: Path) -> Upgrade:
    """Upgrade a closed recording to the present layout."""
    refuse_newer(path)
    version = layout_version(path)
    with closing(open_recording(path)) as db:
        status = read_session(db)["status"]
    if version == SCHEMA_VERSION:
        return Upgrade("current", path, version, version)
    with closing(WriterLock(path)):
        if status == "recording" or path.with_name(path.name + "-wal").exists():
            raise RequestError(f"{path} was not closed", "Recover the recording.", command=f"boat-daq recover {path}")
        try:
            return Upgrade("upgraded", path, version, SCHEMA_VERSION, _exchange(path, version))
        except (OSError, *DAMAGE) as error:
            raise storage_error(path, error) from error


def _exchange(path: Path, version: int) -> Path:
    """Put an upgraded copy in the file's place, and return where the file went."""
    with written_whole(path) as copy:
        shutil.copyfile(path, copy)
        _add_columns(copy, version)
        open_recording(copy).close()
        return _keep(path, version)


def _add_columns(path: Path, version: int) -> None:
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        harden(db)
        db.execute("PRAGMA synchronous=FULL")
        db.execute("BEGIN IMMEDIATE")
        for since in sorted(since for since in ADDED if since > version):
            for table, name, kind in ADDED[since]:
                if name not in columns_of(db, (table,))[table]:
                    db.execute(f"ALTER TABLE {table} ADD COLUMN {name} {kind}")
        db.execute(f"PRAGMA user_version={SCHEMA_VERSION}")
        db.execute("COMMIT")
        checks = db.execute("PRAGMA integrity_check(1)").fetchall()
        if checks != [("ok",)]:
            cause = f"{path.stem} is damaged: {checks[0][0]}"
            raise StorageError(cause, "Recover the recording first.", command="boat-daq recover")


def _keep(path: Path, version: int) -> Path:
    """Give the file a second name, that of its backup. Nothing that has such a name is overwritten."""
    for number in range(1, 1000):
        backup = path.with_name(f"{path.name}.v{version}{'' if number == 1 else f'.{number}'}.bak")
        try:
            os.link(path, backup)
        except FileExistsError:
            continue
        except OSError:  # a file system without links
            with path.open("rb") as original, backup.open("xb") as second:
                shutil.copyfileobj(original, second)
                os.fsync(second.fileno())
        return backup
    raise RequestError(f"there are a thousand backups of {path.name} already", "Remove some of them.")
