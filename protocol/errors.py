"""Errors of the link, by whose fault they are.

    ProtocolError
    +-- LocalError     this side was asked for something the contract does not allow
    +-- RemoteError    the other side broke the contract
    +-- ProfileError   a text profile cannot be used as it is written
    +-- RecordingError a file is not a recording, or cannot be read as one
        +-- DamagedRecordingError  its rows may still be readable one by one

Damaged bytes are not errors: they are counted, and the stream goes on.
"""

from __future__ import annotations


class ProtocolError(Exception):
    """Base of the family.

    Parameters
    ----------
    cause : what happened, in the words of the lab.
    remedy : what the reader can do about it; may be empty.
    """

    def __init__(self, cause: str, remedy: str = "") -> None:
        super().__init__(cause)
        self.cause = cause
        self.remedy = remedy


class LocalError(ProtocolError):
    """This side was asked for something the contract does not allow."""


class RemoteError(ProtocolError):
    """The other side broke the contract."""


class ProfileError(ProtocolError):
    """A text profile cannot be used as it is written."""


class RecordingError(ProtocolError):
    """A file is not a recording, or cannot be read as one."""


class DamagedRecordingError(RecordingError):
    """A recording is damaged, and its rows may still be readable one by one; the remedy is `boat-daq recover`."""
