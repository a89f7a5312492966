"""Errors of the program: each names its cause and, where there is one, the remedy.

BoatDaqError
+-- OperatorError      a request cannot be met as given (a path, a plan, a limit)
+-- DeviceError        the port or the board failed
+-- StorageError       the disk or the file failed
"""

from __future__ import annotations


class BoatDaqError(Exception):
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


class OperatorError(BoatDaqError):
    """A request cannot be met as given."""


class DeviceError(BoatDaqError):
    """The port or the board failed."""


class StorageError(BoatDaqError):
    """The disk or the file failed."""


def cause_and_remedy(error: BaseException) -> tuple[str, str] | None:
    """Return cause and remedy of an error of any of our packages; None for another.

    By its attributes: the engine, which uses this, must not need the analysis.
    """
    cause = getattr(error, "cause", None)
    return None if cause is None else (str(cause), str(getattr(error, "remedy", "")))
