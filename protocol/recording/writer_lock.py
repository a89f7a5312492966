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
from typing import Final

from protocol.base.errors import StorageError

if sys.platform == "win32":
    import msvcrt

    def _try_lock(descriptor: int) -> bool:
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

    def _is_locked(descriptor: int) -> bool:
        return not _try_lock(descriptor)  # released with the descriptor

elif sys.platform == "linux":
    import fcntl
    import struct

    _FLOCK: Final = struct.Struct("@hhqqi4x")  # l_type, l_whence, l_start, l_len, l_pid
    _WRITE_LOCK: Final = _FLOCK.pack(fcntl.F_WRLCK, os.SEEK_SET, 0, 0, 0)

    def _try_lock(descriptor: int) -> bool:
        try:
            fcntl.fcntl(descriptor, fcntl.F_OFD_SETLK, _WRITE_LOCK)
        except (BlockingIOError, PermissionError):
            return False
        return True

    def _is_locked(descriptor: int) -> bool:
        """Look without taking the lock: for a moment it would refuse a writer."""
        found = fcntl.fcntl(descriptor, fcntl.F_OFD_GETLK, _WRITE_LOCK)
        return bool(_FLOCK.unpack(found)[0] != fcntl.F_UNLCK)

else:
    import fcntl

    def _try_lock(descriptor: int) -> bool:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def _is_locked(descriptor: int) -> bool:
        return not _try_lock(descriptor)  # released with the descriptor


def lock_path(recording: Path) -> Path:
    """Return the name of a recording's lock."""
    return recording.with_name(recording.name + "-lock")


class WriterLock:
    """The exclusive right to write a recording, until `close` or the process ends."""

    def __init__(self, recording: Path) -> None:
        self._path = lock_path(recording)
        try:
            descriptor = self._locked()
        except OSError as error:
            remedy = "Choose a local folder with write permission."
            raise StorageError(f"cannot write in {recording.parent}: {error.strerror}", remedy) from error
        if descriptor is None:
            remedy = "Wait until that program has closed it."
            raise StorageError(f"{recording} is being written by another program", remedy)
        self._descriptor: int | None = descriptor

    def _locked(self) -> int | None:
        """Return a descriptor of the locked file; None if another program has the lock.

        The file may have been removed by its last owner between the opening and the lock, which then protects
        nothing: another program could lock a new file of that name.
        """
        while True:
            descriptor = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o666)
            try:
                locked = _try_lock(descriptor)
                if locked and os.fstat(descriptor).st_nlink > 0:
                    return descriptor
            except OSError:
                os.close(descriptor)
                raise
            os.close(descriptor)
            if not locked:
                return None

    def close(self) -> None:
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
        return _is_locked(descriptor)
    finally:
        os.close(descriptor)
