"""Errors of the analysis, by their cause.

AnalysisError
+-- DataError          the data cannot carry the requested figure
+-- RequestError       a parameter is outside what the method is defined for
+-- FileError          the file is of another kind, or damaged
+-- ConvergenceError   the method did not reach its own criterion
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class AnalysisError(Exception):
    """Base of the family.

    Parameters
    ----------
    cause : what happened, in the operator's terms.
    remedy : what to do about it; may be empty.
    command : the remedy on the command line, which the window does not show; may be empty.
    """

    def __init__(self, cause: str, remedy: str = "", *, command: str = "") -> None:
        super().__init__(cause)
        self.cause = cause
        self.remedy = remedy
        self.command = command


class DataError(AnalysisError):
    """The data cannot carry the requested figure."""


class RequestError(AnalysisError):
    """A parameter is outside what the method is defined for."""


class FileError(AnalysisError):
    """The file is of another kind, or damaged."""


class ConvergenceError(AnalysisError):
    """The method did not reach its own criterion."""


@contextmanager
def writing(path: Path, remedy: str = "choose another folder") -> Iterator[None]:
    """Turn what the system reports while a file is written into a `FileError`."""
    try:
        yield
    except OSError as error:
        raise FileError(f"{path} cannot be written: {error.strerror or error}", remedy) from error
