"""A lock beside a recording, held for as long as its writer lives.

SQLite's own locks last only as long as a transaction, so they do not show that a recording is in progress. This one
does: an empty file NAME.boat-lock, locked by the operating system, which lets go of it when the process ends in any
way. The lock is advisory: it keeps cooperating programs from writing to one recording, and distinguishes a killed
session from a living one. (It is not on the recording itself, because closing a second descriptor of that file would
drop SQLite's own locks on it.)
"""

from __future__ import annotations

import contextlib
import os
import sys
from pathlib import Path

from boat_daq.errors import StorageError

if sys.platform == "win32":
    import msvcrt

    def _try_lock(descriptor: int) -> bool:
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

else:
    import fcntl

    def _try_lock(descriptor: int) -> bool:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True


def lock_path(recording: Path) -> Path:
    """Return the name of a recording's lock."""
    return recording.with_name(recording.name + "-lock")


class WriterLock:
    """The exclusive right to write a recording, until `release` or the process ends.

    Raises
    ------
    StorageError : another program writes it, or the folder cannot be written.
    """

    def __init__(self, recording: Path) -> None:
        self._path = lock_path(recording)
        try:
            self._descriptor: int | None = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o666)
            locked = _try_lock(self._descriptor)
        except OSError as error:
            raise StorageError(
                f"cannot write in {recording.parent}: {error.strerror}", "Choose a local folder with write permission."
            ) from error
        if not locked:
            os.close(self._descriptor)
            raise StorageError(
                f"{recording} is being written by another program",
                "Wait until that program has closed it.",
            )

    def release(self) -> None:
        """Release the lock; may be called twice."""
        if self._descriptor is None:
            return
        if sys.platform != "win32":  # Windows cannot remove an open file, and removing a closed one would race
            with contextlib.suppress(OSError):
                self._path.unlink()
        os.close(self._descriptor)
        self._descriptor = None
        if sys.platform == "win32":
            with contextlib.suppress(OSError):
                self._path.unlink()


def is_being_written(recording: Path) -> bool:
    """Return whether a living program (this one included) writes `recording`."""
    try:
        descriptor = os.open(lock_path(recording), os.O_RDWR)
    except OSError:
        return False
    try:
        return not _try_lock(descriptor)
    finally:
        os.close(descriptor)
