"""Errors of the program: each names its cause and, where there is one, the remedy.

BoatDaqError
+-- OperatorError      what was asked for cannot be done as asked (a path, a plan, a limit)
+-- DeviceError        the port or the board does not do its part
+-- StorageError       the disk or the file does not do its part
"""

from __future__ import annotations


class BoatDaqError(Exception):
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


class OperatorError(BoatDaqError):
    """What was asked for cannot be done as asked."""


class DeviceError(BoatDaqError):
    """The port or the board does not do its part."""


class StorageError(BoatDaqError):
    """The disk or the file does not do its part."""
