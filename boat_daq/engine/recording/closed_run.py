"""Steps and readings of a closed recording, and the readings that are added to it.

Rules: a reading is never changed: a correction is a newer row for the same step.
"""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from dataclasses import fields
from pathlib import Path
from typing import Any

from boat_daq.engine.plan import StepMark
from boat_daq.engine.recording.file import RecordingFile, now_utc
from boat_daq.engine.recording.rows import reading_row
from boat_daq.engine.snapshot import Reading
from protocol.base.errors import RequestError
from protocol.recording import open_recording

_STEP_COLUMNS = ("id", *(field.name for field in fields(StepMark) if field.name != "number"))


def read_steps(db: sqlite3.Connection) -> tuple[StepMark, ...]:
    """Return the steps of a run in order."""
    rows = db.execute(f"SELECT {', '.join(_STEP_COLUMNS)} FROM step ORDER BY id")  # noqa: S608 - names are ours
    return tuple(StepMark(*(*row[:-1], _detail(row[-1]))) for row in rows)


def read_readings(db: sqlite3.Connection) -> tuple[Reading, ...]:
    """Return all readings, corrections included, in order of entry."""
    sql = "SELECT step, elongation_mm, resolution_mm, source, utc, reader, note FROM reading ORDER BY id"
    return tuple(Reading(*row) for row in db.execute(sql))


def append_reading(path: Path, reading: Reading) -> None:
    statement = reading_row(reading)
    with closing(open_recording(path)) as db:
        known = db.execute("SELECT count(*) FROM step WHERE id = ?", (reading.step_id,)).fetchone()[0]
    if not known:
        raise RequestError(f"{path} has no step {reading.step_id}", "Choose a step of it.", command="boat-daq info")
    file = RecordingFile.reopen(path)
    try:
        file.commit([statement])
    finally:
        file.abandon()


def _detail(text: str) -> dict[str, Any]:
    """Return the detail of a step; nothing where a damaged file holds no table."""
    try:
        found = json.loads(text)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


class ClosedRun:
    """Steps and readings of a closed recording. RecordingError: it cannot be read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.read()

    def read(self) -> None:
        """Read steps and readings from the file."""
        with closing(open_recording(self.path)) as db:
            self._steps, self._readings = read_steps(db), read_readings(db)

    def steps(self) -> tuple[StepMark, ...]:
        return self._steps

    def readings(self) -> tuple[Reading, ...]:
        """Return all readings, corrections included, in order of entry."""
        return self._readings

    def add_reading(
        self,
        step_id: int,
        elongation_mm: float | None,
        source: str,
        *,
        resolution_mm: float | None = None,
        reader: str = "",
        note: str = "",
    ) -> None:
        """Add a reading to the file; raises as `append_reading`."""
        append_reading(self.path, Reading(step_id, elongation_mm, resolution_mm, source, now_utc(), reader, note))
        self.read()
