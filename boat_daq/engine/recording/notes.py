"""Notes and markers of a closed recording.

Each is a newer event of the recording: what was noted before stays, and the bytes and samples are not touched.
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from boat_daq.engine.recording.file import RecordingFile
from boat_daq.engine.recording.rows import INSERT_EVENT
from protocol.base.errors import RequestError
from protocol.recording import MARK_EVENT, NOTE_EVENT, open_recording

NOTE_MOST = 2000  # letters


def add_note(path: Path, text: str) -> None:
    """Add a note to a closed recording; the newest one counts, an empty one withdraws it."""
    _add_event(path, NOTE_EVENT, text)


def add_mark(path: Path, segment: int, after_s: float, text: str) -> None:
    """Add a marker to a closed recording, `after_s` after the first sample of a segment."""
    with closing(open_recording(path)) as db:
        (first_us,) = db.execute("SELECT min(first_time_us) FROM block WHERE segment = ?", (segment,)).fetchone()
    _add_event(path, MARK_EVENT, text, segment, int(first_us) + round(1e6 * after_s))


def has_marks(path: Path) -> bool:
    """Return whether a recording has a marker."""
    with closing(open_recording(path)) as db:
        return db.execute("SELECT 1 FROM event WHERE kind = ? LIMIT 1", (MARK_EVENT,)).fetchone() is not None


def _add_event(path: Path, kind: str, text: str, segment: int | None = None, time_us: int | None = None) -> None:
    if len(text) > NOTE_MOST:
        raise RequestError(f"the note is longer than {NOTE_MOST} letters", "Shorten it.")
    with closing(open_recording(path)) as db:
        number = db.execute("SELECT coalesce(max(id), 0) + 1 FROM event").fetchone()[0]
        last_ns = db.execute("SELECT coalesce(max(host_ns), 0) FROM event").fetchone()[0]
    file = RecordingFile.reopen(path)
    try:
        file.commit([(INSERT_EVENT, (number, last_ns, segment, time_us, "user", kind, None, text))])
    finally:
        file.abandon()
