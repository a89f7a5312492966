"""Errors of the link, by the side that caused them.

    ProtocolError
    +-- LocalError     a request of this side is not allowed by the contract
    +-- RemoteError    the other side violated the contract
    +-- ProfileError   a text profile is not usable as written
    +-- RecordingError a file is not a recording, or cannot be read as one
        +-- DamagedRecordingError  its rows may still be readable one by one

Damaged bytes are not errors: they are counted, and the stream continues.
"""

from __future__ import annotations

from pathlib import Path


class ProtocolError(Exception):
    """Base of the family.

    Parameters
    ----------
    cause : what happened, in the terms of the lab.
    remedy : what the user can do about it; may be empty.
    command : the remedy on the command line, which the window does not show; may be empty.
    """

    def __init__(self, cause: str, remedy: str = "", *, command: str = "") -> None:
        super().__init__(cause)
        self.cause = cause
        self.remedy = remedy
        self.command = command


class LocalError(ProtocolError):
    """A request of this side is not allowed by the contract."""


class RemoteError(ProtocolError):
    """The other side violated the contract."""


class ProfileError(ProtocolError):
    """A text profile is not usable as written."""


class RecordingError(ProtocolError):
    """A file is not a recording, or cannot be read as one."""


class DamagedRecordingError(RecordingError):
    """A recording is damaged, and its rows may still be readable one by one: it can be recovered."""


def damaged(path: Path, what: str) -> DamagedRecordingError:
    """Return the error for a recording that can be recovered."""
    return DamagedRecordingError(f"{path} {what}", "Recover the recording.", command=f"boat-daq recover {path}")
