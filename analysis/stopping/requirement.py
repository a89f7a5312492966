"""The uncertainty that is asked of a run: its unit, and its check without loading the analysis."""

from __future__ import annotations

import math

from protocol.base.errors import RequestError

UNIT_OF_REQUIREMENT = {"staircase": "mm", "continuous": "% FSO"}
"""Units of the uncertainty at which a run ends, by the kind of its plan: plans of other kinds have none."""
FEWEST_REPEATS = 10
"""Cycles of a repeatability run before it may end: fewer leave the widths of the intervals themselves uncertain."""
EXAMPLES = {"mm": "0.08", "% FSO": "0.5"}


def check_asked(asked: float, unit: str) -> None:
    """Reject an uncertainty that is no number above 0; `unit` is mm or % FSO. RequestError: it is none."""
    if not 0.0 < asked < math.inf:
        remedy = f"give a number of {unit} above 0, as {EXAMPLES[unit]}"
        raise RequestError(f"an uncertainty of {asked:g} {unit}", remedy)
