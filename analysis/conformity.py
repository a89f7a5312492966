"""Conformity of a measured value with a limit: pass, conditional pass, conditional fail or fail, and how probable.

The non-binary rule with a guard band of ILAC-G8:09/2019, 4.2.3: the expanded uncertainty U on the side of the limit, of
which a false acceptance is at most 2.5 % probable. The probability is that of JCGM 106:2012, 7.2 to 7.4, formulas (8)
to (13). An interval may be asymmetric: the half that faces a limit counts. Without an uncertainty a statement is
conditional, and has no probability.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from scipy import stats

from analysis.json_object import json_object

RULE = "ILAC-G8:09/2019, 4.2.3: guard band w = U (95 %)"
_ONE_SIDED = 0.975  # share of a distribution below the upper end of a two-sided 95 % interval


class Conformity(StrEnum):
    """Where a value is: inside the limit by the guard band or within it, beyond the limit within it or by it."""

    PASS = "pass"  # noqa: S105 - no password
    CONDITIONAL_PASS = "conditional_pass"  # noqa: S105 - no password
    CONDITIONAL_FAIL = "conditional_fail"
    FAIL = "fail"
    UNDETERMINED = "undetermined"

    @property
    def label(self) -> str:
        return self.value.replace("_", " ")


@dataclass(frozen=True, slots=True)
class ConformityStatement:
    """A statement of conformity: probability, and guard band of the limit nearest in uncertainties; NaN without U."""

    conformity: Conformity
    probability: float
    guard_band: float

    def as_json(self) -> dict[str, Any]:
        return json_object(self) | {"rule": RULE}


def conformity_statement(
    value: float, expanded: tuple[float, float], limits: tuple[float, float]
) -> ConformityStatement:
    """Return the statement of conformity of a value, undetermined for NaN, with its limits.

    `expanded`: expanded uncertainty (95 %) below and above the value; NaN where it is not known. `limits`: infinite
    where there is none.
    """
    if math.isnan(value):
        return ConformityStatement(Conformity.UNDETERMINED, math.nan, math.nan)
    inside = [side for side in (value - limits[0], limits[1] - value) if math.isfinite(side)]  # negative beyond it
    facing = [expanded[int(limit > value)] for limit in limits if math.isfinite(limit)]
    if math.isinf(value) or not all(math.isfinite(half) for half in facing):
        kept = limits[0] <= value <= limits[1]
        within = Conformity.CONDITIONAL_PASS if kept else Conformity.CONDITIONAL_FAIL
        return ConformityStatement(within, math.nan, math.nan)
    coverage, sides = float(stats.norm.ppf(_ONE_SIDED)), list(zip(inside, facing, strict=True))
    beyond = sum(_beyond(side, half / coverage) for side, half in sides)
    # the limit that decides is the one that is nearest less its guard band
    side, band = min(sides, key=lambda pair: pair[0] - pair[1], default=(math.inf, 0.0))
    return ConformityStatement(_statement(side, band), max(1.0 - beyond, 0.0), band)


def _beyond(inside: float, u: float) -> float:
    """Probability that the measurand is beyond a limit `inside` away from the value."""
    if not u > 0:
        return 0.0 if inside >= 0 else 1.0
    return float(stats.norm.sf(inside / u))


def _statement(inside: float, band: float) -> Conformity:
    if inside >= 0:
        return Conformity.PASS if inside >= band else Conformity.CONDITIONAL_PASS
    return Conformity.FAIL if -inside > band else Conformity.CONDITIONAL_FAIL
