"""A measured trade-off as the page shows it, read and checked from the dictionary of `boat-daq tradeoff --json`.

Rules: a file that is not such a result is refused. Points are numbered from the cheapest; the error of a setting that
failed is infinite and not drawn.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from boat_daq.errors import OperatorError
from boat_daq.viewmodels.common import tables
from boat_daq.viewmodels.common.formatting import power_text, quantity

FRONT = "front"
SYMBOLS = {"default": "\u25cb", "chosen": "\u25a1"}


@dataclass(frozen=True, slots=True)
class TradeoffPoint:
    """One setting: processor time (s) with the range of its repeats, error with its range, and its marks.

    Marks are the program's uses of it ("default", "chosen" by the rule, the levels of fidelity other than the default
    one), and "front" where it is on the Pareto front.
    """

    number: int
    setting: str
    seconds: float
    spread_s: float
    error: float
    error_spread: float
    repeats: int
    marks: tuple[str, ...]

    @property
    def drawn(self) -> bool:
        """Whether it has a place in the chart."""
        return math.isfinite(self.error) and self.seconds > 0

    @property
    def symbols(self) -> str:
        """Its uses as in the chart."""
        return " ".join(SYMBOLS.get(use, use[0].upper()) for use in self.uses)

    @property
    def uses(self) -> tuple[str, ...]:
        """The program's uses of this setting."""
        return tuple(mark for mark in self.marks if mark != FRONT)


@dataclass(frozen=True, slots=True)
class MethodChart:
    """One measured method; below the error `sufficient` the rule accepts a setting."""

    name: str
    title: str
    reference: str
    consumer: str
    tolerance: float
    sufficient: float
    unit: str
    per: str
    verdict: str
    default_is_chosen: bool
    measured: str
    points: tuple[TradeoffPoint, ...]

    @property
    def floor(self) -> float:
        """Where an error of zero is drawn: below everything else."""
        return min([p.error for p in self.points if p.error > 0 and p.drawn] + [self.sufficient]) / 3

    @property
    def mark(self) -> str:
        """The verdict as a shape."""
        return "\u25cf" if self.default_is_chosen else "\u25b2"

    @property
    def explanation(self) -> str:
        """The tolerance, the rule and its choice."""
        verdict = self.verdict[:1].upper() + self.verdict[1:]
        return (
            f"Tolerance: {self.consumer} ({quantity(self.tolerance, self.unit)}).\n"
            f"Rule: the cheapest setting with an error below {quantity(self.sufficient, self.unit)}.\n"
            f"{verdict.rstrip('.')}.\n"
            f"Error against: {self.reference}."
        )


def read_report(content: Any) -> dict[str, MethodChart]:
    """Return the methods of a result, by name.

    Raises
    ------
    OperatorError : it is not a result of `boat-daq tradeoff`.
    """
    try:
        margin = float(content.get("margin", 2.0))
        machine = content["machine"]
        return {str(m["name"]): _method(m, margin, machine, bool(content.get("quick"))) for m in content["methods"]}
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise OperatorError(
            "this file is not a measured trade-off", "Choose a tradeoff.json that this page or the command wrote."
        ) from error


def _method(m: Mapping[str, Any], margin: float, machine: Mapping[str, Any], quick: bool) -> MethodChart:
    chosen = m.get("chosen")
    rows = sorted(m["points"], key=lambda p: float(p.get("cpu_seconds", p["seconds"])))
    tolerance = float(m["tolerance"])
    when = str(m.get("measured_utc", machine.get("date_utc", "")))[:10]
    how = "quick" if m.get("quick", quick) else "full"
    return MethodChart(
        str(m["name"]), str(m.get("title", m["name"])), str(m["reference"]), str(m["consumer"]), tolerance,
        tolerance / margin, str(m["unit"]), str(m.get("per", "a call")), str(m.get("verdict", "")),
        chosen is not None and chosen == m["default"], f"{how}, {when}, {machine.get('processor', 'unknown machine')}",
        tuple(_point(i, p, m) for i, p in enumerate(rows, 1)),
    )  # fmt: skip


def _point(place: int, p: Mapping[str, Any], m: Mapping[str, Any]) -> TradeoffPoint:
    name, spread = str(p["setting"]), p.get("cpu_spread", p.get("spread"))
    levels = {level: at["in_code"] for level, at in m.get("fidelity", {}).items() if level != "normal"}
    uses = {"default": m["default"], "chosen": m.get("chosen"), **levels}
    marks = [use for use, setting in uses.items() if setting == name] + [FRONT] * (name in m["front"])
    return TradeoffPoint(
        place, name, float(p.get("cpu_seconds", p["seconds"])), float(spread or 0.0),
        math.inf if p["error"] is None else float(p["error"]), float(p.get("error_spread") or 0.0),
        int(p.get("repeats", 1)), tuple(marks),
    )  # fmt: skip


def merged(old: Mapping[str, Any] | None, new: Mapping[str, Any]) -> dict[str, Any]:
    """Return a new result with the methods that only the old one has; each method keeps its date and kind."""
    fresh = [
        {**m, "measured_utc": m.get("measured_utc", new["machine"].get("date_utc", "")), "quick": new.get("quick")}
        for m in new["methods"]
    ]
    names = {m["name"] for m in fresh}
    same = old is not None and old["machine"].get("processor") == new["machine"].get("processor")
    kept = [m for m in old["methods"] if m["name"] not in names] if old is not None and same else []
    return {**new, "methods": [*fresh, *kept]}


def report_columns(charts: Mapping[str, MethodChart]) -> dict[str, list[Any]]:
    """Return every point of every method as columns, for a CSV."""
    names = (
        "method", "setting", "cpu_seconds", "spread_seconds", "error", "error_spread", "unit", "tolerance", "repeats",
    )  # fmt: skip
    marks = {"on_front": FRONT, "default": "default", "chosen": "chosen"}
    rows = [
        (
            c.name, p.setting, p.seconds, p.spread_s, p.error, p.error_spread, c.unit, c.tolerance, p.repeats,
            *(int(mark in p.marks) for mark in marks.values()),
        )
        for c in charts.values()
        for p in c.points
    ]  # fmt: skip
    return tables.by_column((*names, *marks), rows)


def error_text(error: float) -> str:
    """Return an error at two digits; `failed` where the setting has none."""
    return power_text(error, digits=2) if math.isfinite(error) else "failed"
