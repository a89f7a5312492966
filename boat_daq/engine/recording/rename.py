"""Rename a closed recording with the files beside it that belong to it; note what the operator knows of it.

Rules: nothing is overwritten. All files are renamed or none: what was renamed before an error gets its name back. A
note is a newer event of the recording, so what was noted before stays, and the bytes and samples are not touched.
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from boat_daq.engine.file_names import path_in
from boat_daq.engine.recording.file import RecordingFile, check_recording_name, storage_error
from boat_daq.engine.recording.rows import INSERT_EVENT
from protocol.base.errors import RequestError
from protocol.recording import MARK_EVENT, NOTE_EVENT, open_recording, read_session
from protocol.recording.writer_lock import WriterLock

_BESIDE = (".elongation.csv",)  # what NAME.boat has beside it, after NAME
NOTE_MOST = 2000  # letters


def companions(path: Path) -> tuple[Path, ...]:
    """Return the names of the files that belong to a recording, whether they exist or not."""
    return tuple(path.with_name(path.stem + ending) for ending in _BESIDE)


def rename(path: Path, name: str) -> Path:
    """Give a closed recording and its companions another name in the same folder; return its new path."""
    target = path_in(path.parent, name.strip())
    check_recording_name(target)
    with closing(open_recording(path)) as db:
        status = read_session(db)["status"]
    if status == "recording":
        raise RequestError(f"{path.name} is not closed", "Close or recover the recording first.")
    pairs = [(path, target), *zip(companions(path), companions(target), strict=True)]
    pairs = [(old, new) for old, new in pairs if old.exists()]
    for old, new in pairs:
        if new.exists() and not new.samefile(old):
            raise RequestError(f"{new.name} exists already", "Choose another name; no file is overwritten.")
    done: list[tuple[Path, Path]] = []
    with closing(WriterLock(path)):
        try:
            for old, new in pairs:
                old.rename(new)
                done.append((old, new))
        except OSError as error:
            for old, new in reversed(done):
                new.rename(old)
            raise storage_error(path, error) from error
    return target


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
