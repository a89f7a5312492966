"""Errors of the analysis, by whose fault they are.

AnalysisError
+-- DataError          the data cannot carry the figure that was asked for
+-- RequestError       a parameter is outside what the method is defined for
+-- FileError          the file is not what it was taken for
+-- ConvergenceError   the method did not reach its own criterion
"""

from __future__ import annotations


class AnalysisError(Exception):
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


class DataError(AnalysisError):
    """The data cannot carry the figure that was asked for."""


class RequestError(AnalysisError):
    """A parameter is outside what the method is defined for."""


class FileError(AnalysisError):
    """The file is not what it was taken for."""


class ConvergenceError(AnalysisError):
    """The method did not reach its own criterion."""
