"""One family of errors for the whole product, by whose fault it is; each names its cause and, where known, the remedy.

    BoatDaqError
    +-- RequestError            the caller: a request or a parameter cannot be met as given
    |   +-- ChoiceError         a wrong call: a value is none of those allowed, or outside its range
    +-- DataError               the data: they cannot carry the requested figure
    +-- ConvergenceError        the method: it did not reach its own criterion
    +-- FileError               a file: of another kind, or damaged
    |   +-- ProfileError        a text profile is not usable as written
    |   +-- RecordingError      no recording, or one that cannot be read
    |       +-- DamagedRecordingError   its rows may still be readable one by one
    +-- DeviceError             the port or the board
    |   +-- RemoteError         the board violated the contract of the link
    +-- StorageError            the disk

Damaged bytes of a link are not errors: they are counted, and the stream continues.
"""

from __future__ import annotations

import difflib
import errno
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path


class BoatDaqError(Exception):
    """Base of the family: cause in the operator's terms, remedy (may be empty), and the remedy on the command line."""

    def __init__(self, cause: str, remedy: str = "", *, command: str = "") -> None:
        super().__init__(cause)
        self.cause = cause
        self.remedy = remedy
        self.command = command


class RequestError(BoatDaqError):
    """A request or a parameter cannot be met as given."""


class ChoiceError(RequestError):
    """A wrong call: a value is none of those allowed, or outside its range."""


class DataError(BoatDaqError):
    """The data cannot carry the requested figure."""


class ConvergenceError(BoatDaqError):
    """The method did not reach its own criterion."""


class FileError(BoatDaqError):
    """The file is of another kind, or damaged."""


class ProfileError(FileError):
    """A text profile is not usable as written."""


class RecordingError(FileError):
    """A file is not a recording, or cannot be read as one."""


class DamagedRecordingError(RecordingError):
    """A recording is damaged, and its rows may still be readable one by one: it can be recovered."""


class DeviceError(BoatDaqError):
    """The port or the board failed."""


class RemoteError(DeviceError):
    """The board violated the contract of the link."""


class StorageError(BoatDaqError):
    """The disk failed."""


def one_of(name: str, known: Iterable[str]) -> str:
    """Return the remedy for a name that is not known: the one that is probably meant, else all of them."""
    names = list(known)
    close = difflib.get_close_matches(name.lower(), names, 1, 0.75)
    return f"did you mean {close[0]}?" if close else f"choose one of {', '.join(names)}"


def cause_and_remedy(error: BaseException) -> tuple[str, str] | None:
    """Return cause and remedy of an error of the family; None for another."""
    return (error.cause, error.remedy) if isinstance(error, BoatDaqError) else None


def damaged(path: Path, what: str) -> DamagedRecordingError:
    """Return the error for a recording that can be recovered."""
    return DamagedRecordingError(f"{path} {what}", "Recover the recording.", command=f"boat-daq recover {path}")


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn what the system reports while a file or folder is written into a `StorageError`."""
    try:
        yield
    except OSError as error:
        raise StorageError(f"{path} cannot be written: {error.strerror or error}", _remedy(path, error)) from error


def _remedy(path: Path, error: OSError) -> str:
    if error.errno == errno.ENOSPC:
        return "free disk space, or choose another disk"
    if error.errno == errno.ENOENT and not path.parent.is_dir():
        return f"make the folder {path.parent}, or choose another"
    return "choose another folder"
