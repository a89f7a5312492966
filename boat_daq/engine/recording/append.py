"""Readings that are entered after a recording was closed: added, while nothing in the file is ever changed."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from boat_daq.engine.recording.file import RecordingFile
from boat_daq.engine.recording.rows import reading_row
from boat_daq.engine.snapshot import Reading
from boat_daq.errors import OperatorError
from protocol.recording import open_recording


def append_reading(path: Path, reading: Reading) -> None:
    """Add a reading to a closed recording.

    It corrects an earlier one for the same step, which stays.

    Raises
    ------
    OperatorError : the recording has no such step, or it is not an elongation.
    StorageError : the recording is in progress, or cannot be written. RecordingError : not a recording.
    """
    statement = reading_row(reading)
    with closing(open_recording(path)) as db:
        known = db.execute("SELECT count(*) FROM step WHERE id = ?", (reading.step_id,)).fetchone()[0]
    if not known:
        raise OperatorError(f"{path} has no step {reading.step_id}", "boat-daq info lists the steps of a recording.")
    file = RecordingFile.reopen(path)
    try:
        file.commit([statement])
    finally:
        file.abandon()
