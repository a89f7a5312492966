"""The readings of an older, closed recording: the same table and the same rules as on the live page.

What is entered is added to the file as a newer row; the rows before it stay. So undo is a newer row, too.
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from boat_daq.engine.plan import StepMark
from boat_daq.engine.recording.append import append_reading
from boat_daq.engine.recording.file import now_utc
from boat_daq.engine.snapshot import Reading
from protocol.recording import open_recording


class ClosedRun:
    """Steps and readings of a recording, for a `ReadingsModel`.

    Parameters
    ----------
    path : a closed recording.

    Raises
    ------
    RecordingError : it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._steps: tuple[StepMark, ...] = ()
        self._readings: tuple[Reading, ...] = ()
        self.read()

    def read(self) -> None:
        """Read steps and readings from the file."""
        with closing(open_recording(self.path)) as db:
            steps = db.execute("SELECT id, cycle, branch, target_kpa, started_us, status FROM step ORDER BY id")
            self._steps = tuple(
                StepMark(number, cycle, branch, target, 0.0, started, status=status)
                for number, cycle, branch, target, started, status in steps
            )
            readings = db.execute(
                "SELECT step, elongation_mm, resolution_mm, source, utc, reader, note FROM reading ORDER BY id"
            )
            self._readings = tuple(Reading(*row) for row in readings)

    def steps(self) -> tuple[StepMark, ...]:
        """Return the plateaus of the run."""
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
    ) -> None:
        """Add a reading to the file.

        Raises
        ------
        OperatorError, StorageError : as `boat_daq.engine.recording.append.append_reading`.
        """
        append_reading(self.path, Reading(step_id, elongation_mm, resolution_mm, source, now_utc(), reader))
        self.read()
