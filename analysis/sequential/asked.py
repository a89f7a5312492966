"""The uncertainty that is asked of a run, checked without loading the analysis."""

from __future__ import annotations

import math

from analysis.errors import RequestError


def check_asked(asked: float, unit: str) -> None:
    """Reject an uncertainty that is no number above 0; `unit` is mm or % FSO.

    Raises
    ------
    RequestError : it is none.
    """
    if not 0.0 < asked < math.inf:
        raise RequestError(f"an uncertainty of {asked:g} {unit}", f"give a number of {unit} above 0, as 0.08")
