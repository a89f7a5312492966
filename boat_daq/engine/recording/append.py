"""What is added to a closed recording: readings entered later, results of analyses. Nothing in it is ever changed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from boat_daq.engine.recording.file import RecordingFile, Statement
from boat_daq.engine.recording.rows import reading_row, result_row
from boat_daq.errors import OperatorError
from protocol.recording import open_recording


def append_reading(
    path: Path,
    step_id: int,
    elongation_mm: float | None,
    *,
    resolution_mm: float | None = None,
    source: str,
    reader: str = "",
    note: str = "",
) -> None:
    """Add a reading to a closed recording; it corrects an earlier one for the same step, which stays.

    Raises
    ------
    OperatorError : the recording has no such step, or it is no length.
    StorageError : the recording is under way, or cannot be written. RecordingError : it is none.
    """
    statement = reading_row(step_id, elongation_mm, resolution_mm, source=source, reader=reader, note=note)
    connection = open_recording(path)
    known = connection.execute("SELECT count(*) FROM step WHERE id = ?", (step_id,)).fetchone()[0]
    connection.close()
    if not known:
        raise OperatorError(f"{path} has no step {step_id}", "boat-daq info lists the steps of a recording.")
    _append(path, statement)


def append_result(
    path: Path, kind: str, *, parameters: Mapping[str, Any], content: Mapping[str, Any], seed: int | None = None
) -> None:
    """Add the result of an analysis to a closed recording; earlier ones stay.

    Raises
    ------
    StorageError : the recording is under way, or cannot be written. RecordingError : it is none.
    """
    _append(path, result_row(kind, parameters=parameters, content=content, seed=seed))


def _append(path: Path, statement: Statement) -> None:
    file = RecordingFile.reopen(path)
    try:
        file.commit([statement])
    finally:
        file.abandon()
