"""Contributions to the uncertainty of an elongation that no run shows: type B evaluations (GUM 4.3).

A certificate or a data sheet states a half width with its distribution, an expanded or a standard uncertainty, the
sensitivity of the elongation and degrees of freedom. The four `EXPECTED` are named as not assessed if they are missing.
An elongation is traceable (VIM 2.41) if its scale has a certificate and all four are assessed. A contribution in % is
relative to the elongation itself. Keys end in their unit.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
import numpy.typing as npt

from protocol.base.arrays import FloatArray
from protocol.base.errors import RequestError

SCALE = "scale"
EXPECTED: Mapping[str, str] = {
    SCALE: "scale of grid or photograph",
    "parallax": "parallax",
    "pressure_gauge": "pressure gauge",
    "temperature": "temperature",
}
"""Name in a file -> name in a budget, of the contributions that a calibration is not complete without."""


STAND_INS = ("repeatability", "hysteresis")
"""Contributions that stand in for what a run did not show, and do not count where it did."""
NO_SPREAD = "one cycle gives no uncertainty"
ONE_CYCLE = f"{NO_SPREAD}: run two or more"


class Distribution(StrEnum):
    """The distribution of an influence quantity within its half width, or about its estimate."""

    NORMAL = "normal"
    RECTANGULAR = "rectangular"
    TRIANGULAR = "triangular"
    ARCSINE = "arcsine"


_DIVISORS = {
    Distribution.RECTANGULAR: math.sqrt(3.0),
    Distribution.TRIANGULAR: math.sqrt(6.0),
    Distribution.ARCSINE: math.sqrt(2.0),
}
"""Half width over standard deviation (GUM 4.3.7 and 4.3.9; arcsine: a cycling temperature)."""
_UNITS = ("mm", "percent", "kpa", "k")
_STATED = ("half_width", "expanded", "u")
_PLAIN = ("distribution", "k", "dof", "certificate", "source", "sensitivity_mm_per_kpa", "sensitivity_mm_per_k")


@dataclass(frozen=True, slots=True)
class TypeBContribution:
    """One contribution, named by its influence quantity, `EXPECTED` or free.

    `u` is in `unit` (mm, percent of the elongation, kpa, k), `sensitivity` in mm per unit (|x| / 100 for percent);
    `dof` is infinite if the statement is certain.
    """

    name: str
    u: float
    unit: str
    sensitivity: float
    dof: float
    distribution: Distribution
    certificate: str = ""
    source: str = ""

    @property
    def label(self) -> str:
        return EXPECTED.get(self.name, self.name.replace("_", " "))

    def u_mm(self, x_mm: npt.ArrayLike) -> FloatArray:
        """Return the standard uncertainty that it makes of an elongation, mm."""
        x = np.asarray(x_mm, dtype=np.float64)
        per_unit = np.abs(x) / 100.0 if self.unit == "percent" else np.full(x.shape, self.sensitivity)
        return np.asarray(self.u * per_unit, dtype=np.float64)

    @property
    def statement(self) -> str:
        """What it rests on as text."""
        unit = {"percent": "% of x", "kpa": "kPa", "k": "K"}.get(self.unit, self.unit)
        parts = [f"u = {self.u:.3g} {unit}, {self.distribution}"]
        parts += [f"certificate {self.certificate}"] if self.certificate else []
        return ", ".join([*parts, *([self.source] if self.source else [])])

    def as_table(self) -> dict[str, Any]:
        """Return the contribution as a table that `contributions` reads again."""
        table: dict[str, Any] = {f"u_{self.unit}": self.u, "distribution": str(self.distribution)}
        if self.unit in ("kpa", "k"):
            table[f"sensitivity_mm_per_{self.unit}"] = self.sensitivity
        if math.isfinite(self.dof):
            table["dof"] = self.dof
        return table | {key: value for key in ("certificate", "source") if (value := getattr(self, key))}


def counted(given: Sequence[TypeBContribution], missing: Collection[str]) -> tuple[TypeBContribution, ...]:
    """Return the contributions that count for a sensor of which the run did not show `missing`."""
    return tuple(one for one in given if one.name not in STAND_INS or one.name in missing)


def stand_in_text(given: Sequence[TypeBContribution], missing: Collection[str]) -> str:
    """Return what U rests on instead of the run, as a sentence; "" where it rests on the run."""
    used = [f"{one.name} ({one.statement})" for one in counted(given, missing) if one.name in STAND_INS]
    return f"U includes a stated value for what the run did not show: {'; '.join(used)}" if used else ""


class ContributionError(RequestError):
    """A contribution is refused."""

    def __init__(self, name: str, key: str, cause: str, remedy: str) -> None:
        super().__init__(f"type_b.{name:.60}: {cause}", remedy)
        self.key = key


def contributions(tables: Mapping[str, Any]) -> tuple[TypeBContribution, ...]:
    """Return the contributions in a file's tables. ContributionError: names table and key.

    Each has one of `half_width_UNIT`, `expanded_UNIT` (with `k`) and `u_UNIT`, UNIT being mm, percent, kpa or k; a
    `distribution`; and may have `dof`, `certificate`, `source`. A kpa or k needs `sensitivity_mm_per_kpa` or `_k`.
    """
    return tuple(_contribution(name, table) for name, table in tables.items())


def _contribution(name: str, table: Any) -> TypeBContribution:
    if not isinstance(table, Mapping):
        raise ContributionError(name, "", "must be a table", "Write [type_b.NAME] and its keys below it.")
    known = [f"{stated}_{unit}" for stated in _STATED for unit in _UNITS]
    unknown = [key for key in table if key not in known and key not in _PLAIN]
    if unknown:
        known_keys = f"Known: {', '.join([*known, *_PLAIN])}."
        raise ContributionError(name, unknown[0], f"{unknown[0]!r:.60} is not a known key", known_keys)
    given = [key for key in known if key in table]
    if len(given) != 1:
        found = " and ".join(given) or "none of them"
        remedy = "Give one of half_width_, expanded_ or u_ with its unit."
        raise ContributionError(name, found, f"gives {found}", remedy)
    stated, _, unit = given[0].rpartition("_")
    value = _number(name, table, given[0], least=0.0)
    distribution = _distribution(name, table, stated)
    k = _number(name, table, "k", least=0.0) if "k" in table else math.nan
    if (stated == "expanded") != ("k" in table) or k == 0:
        cause = "'k' belongs to an expanded uncertainty, and is above 0"
        raise ContributionError(name, "k", cause, "Give expanded_UNIT with k.")
    sensitivity = 1.0
    if unit in ("kpa", "k"):
        sensitivity = abs(_number(name, table, f"sensitivity_mm_per_{unit}"))
    u = {"u": value, "expanded": value / k}.get(stated, math.nan)
    if stated == "half_width":
        u = value / _DIVISORS[distribution]
    dof = _number(name, table, "dof", least=1.0) if "dof" in table else math.inf
    texts = {key: str(table.get(key, "")) for key in ("certificate", "source")}
    return TypeBContribution(name, u, unit, sensitivity, dof, distribution, **texts)


def _distribution(name: str, table: Mapping[str, Any], stated: str) -> Distribution:
    text = table.get("distribution", "" if stated == "half_width" else "normal")
    try:
        distribution = Distribution(text)
    except ValueError:
        known = ", ".join(Distribution)
        cause = f"'distribution' is {text!r:.40}"
        raise ContributionError(name, "distribution", cause, f"Give one of {known}.") from None
    if stated == "half_width" and distribution is Distribution.NORMAL:
        cause = "a normal distribution has no half width"
        raise ContributionError(name, "distribution", cause, "Give u_ or expanded_ with k.")
    return distribution


def _number(name: str, table: Mapping[str, Any], key: str, least: float = -math.inf) -> float:
    value = table.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or value < least:
        at_least = f" of at least {least:g}" if math.isfinite(least) else ""
        given = "is missing" if key not in table else f"is {value!r:.40}"
        raise ContributionError(name, key, f"{key!r} {given}", f"Give a number{at_least}.")
    return float(value)


@dataclass(frozen=True, slots=True)
class Traceability:
    """Whether an elongation is metrologically traceable, and to what or why not."""

    traceable: bool
    text: str
    missing: tuple[str, ...] = ()  # labels of the expected contributions that are not given


def not_assessed(given: Sequence[TypeBContribution]) -> tuple[str, ...]:
    """Return the labels of the expected contributions that are not given."""
    names = {one.name for one in given}
    return tuple(label for name, label in EXPECTED.items() if name not in names)


def traceability(given: Sequence[TypeBContribution]) -> Traceability:
    """State whether an elongation with these contributions is traceable (VIM 2.41)."""
    missing = not_assessed(given)
    certificates = [one.certificate for one in given if one.name == SCALE and one.certificate]
    reasons = [f"no uncertainty is given for {', '.join(missing)}"] if missing else []
    if not certificates and EXPECTED[SCALE] not in missing:
        reasons.append(f"the {EXPECTED[SCALE]} has no certificate")
    if reasons:
        return Traceability(False, f"not traceable: {'; '.join(reasons)}", missing)
    return Traceability(True, f"traceable to {certificates[0]}")


def reference_terms(given: Sequence[TypeBContribution]) -> tuple[float, float]:
    """Return the standard uncertainty of all contributions together: a constant, mm, and a share of the elongation."""
    relative = math.sqrt(sum((one.u / 100.0) ** 2 for one in given if one.unit == "percent"))
    return math.sqrt(sum((one.u * one.sensitivity) ** 2 for one in given if one.unit != "percent")), relative
