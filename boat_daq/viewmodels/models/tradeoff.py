"""The trade-off page: time against error of each method, as shipped or as measured on this computer.

The shipped measurement is shown until this computer has one of its own, which is kept beside the window's preferences.
Points are numbered from the cheapest; the error of a setting that failed is infinite and not drawn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from analysis.studies.tradeoff.measure import MARGIN, part_of_tolerance
from analysis.studies.tradeoff.references import load
from boat_daq.formatting import power_text, quantity
from boat_daq.viewmodels.common.measured_result import MeasuredResult
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.workflows import measured_methods
from boat_daq.workflows.jobs import Job, JobRunner
from protocol.base.errors import RequestError

FRONT = "front"
CHOICE = "the rule's choice"
_SYMBOLS = {"default": "\u25cb", "chosen": "\u25a1"}
METHOD_NAMES = {
    "tracer": "Ray tracer",
    "ranking": "Ranking of the designs",
    "full-fem": "Full model of actuator",
    "reduced-fem": "Fast model of actuator",
    "posterior": "Uncertainty (posterior)",
    "inverse": "Signal to elongation",
    "segmentation": "Plateaus and cycles",
    "bootstrap": "Intervals (bootstrap)",
    "decimation": "Live plot",
    "tracking": "Camera",
    "calibration": "Job: calibration",
    "report": "Job: report",
    "sweep": "Job: the paper's sweep",
    "shadow": "Job: digital shadow",
}
"""Every method that can be measured, by its name in the command; a test compares it with the command's list."""
JOB_NAMES = ("calibration", "report", "sweep", "shadow")
"""Methods that are whole jobs, from the input to the result."""
MAPPED = {"fit": "Fit of the calibration", "figures": "SNR and hysteresis", "alarms": "Alarms of the shadow"}
"""Methods that have a map of where they fail, but no chart of time against error."""
ENTRIES = METHOD_NAMES | MAPPED
OVERVIEW = "overview"
ROWS = {OVERVIEW: "All methods"} | ENTRIES
"""Entries of the page's list, by name."""
_FILE = "tradeoff.json"
_SHOWN = "tradeoff_shown"


@dataclass(frozen=True, slots=True)
class TradeoffPoint:
    """One setting: processor time (s) and error with the ranges of their repeats, and its marks.

    Marks are "default", "chosen" by the rule, levels of precision, and "front" on the Pareto front.
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
        return " ".join(_SYMBOLS.get(mark, mark[0].upper()) for mark in self.marks if mark != FRONT)


@dataclass(frozen=True, slots=True)
class MethodChart:
    """One measured method; the rule accepts a setting whose error, times `margin`, is within the tolerance."""

    name: str
    reference: str
    consumer: str
    tolerance: float
    margin: float
    unit: str
    per: str
    default: str
    chosen: str | None
    points: tuple[TradeoffPoint, ...]

    @property
    def floor(self) -> float:
        """Where an error of zero is drawn: below everything else."""
        return min([p.error for p in self.points if p.error > 0 and p.drawn] + [self.tolerance / self.margin]) / 3

    @property
    def default_is_chosen(self) -> bool:
        """Whether the rule chooses the default."""
        return self.chosen == self.default

    @property
    def default_point(self) -> TradeoffPoint | None:
        """The setting that the program uses by default; None where it was not measured or failed."""
        return next((p for p in self.points if p.setting == self.default and p.drawn), None)

    @property
    def explanation(self) -> str:
        """Where an error is noticed, the rule, and its choice."""
        chosen = f"{self.chosen or 'none'}; the default is {self.default}"
        if self.default_is_chosen:
            chosen = f"the default, {self.default}"
        return (
            f"An error is noticeable above {quantity(self.tolerance, self.unit)}: {self.consumer}.\n"
            f"The rule chooses the fastest setting whose error is at most {part_of_tolerance(self.margin)}: {chosen}.\n"
            f"Errors are against {self.reference}."
        )


class DefaultPoint(NamedTuple):
    """The default of one method in the overview; without `point` it was not measured."""

    name: str
    chart: MethodChart | None
    point: TradeoffPoint | None

    @property
    def share(self) -> float:
        """Its error divided by the least that is noticed; NaN without a measurement, never zero."""
        if self.chart is None or self.point is None:
            return math.nan
        return max(self.point.error, self.chart.floor) / self.chart.tolerance


def read_report(content: Any) -> dict[str, MethodChart]:
    """Return the methods of a result, by name."""
    try:
        margin = float(content.get("margin", MARGIN))
        return {str(m["name"]): _method(m, margin) for m in content["methods"]}
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise RequestError("this file is not a measured trade-off", "Measure this computer again.") from error


def _method(m: Mapping[str, Any], margin: float) -> MethodChart:
    rows = sorted(m["points"], key=lambda p: float(p["cpu_seconds"]))
    return MethodChart(
        str(m["name"]), str(m["reference"]), str(m["consumer"]), float(m["tolerance"]), margin, str(m["unit"]),
        str(m["per"]), str(m["default"]), m["chosen"], tuple(_point(i, p, m) for i, p in enumerate(rows, 1)),
    )  # fmt: skip


def _point(place: int, p: Mapping[str, Any], m: Mapping[str, Any]) -> TradeoffPoint:
    levels = {level: at["in_code"] for level, at in m.get("fidelity", {}).items() if level != "normal"}
    uses = {"default": m["default"], "chosen": m["chosen"], **levels}
    marks = [use for use, setting in uses.items() if setting == p["setting"]]
    return TradeoffPoint(
        place, str(p["setting"]), float(p["cpu_seconds"]), float(p["cpu_spread"]),
        math.inf if p["error"] is None else float(p["error"]), float(p["error_spread"] or 0.0), int(p["repeats"]),
        (*marks, *[FRONT] * (p["setting"] in m["front"])),
    )  # fmt: skip


def error_text(error: float) -> str:
    """Return an error at two digits; `failed` where the setting has none."""
    return power_text(error, digits=2) if math.isfinite(error) else "failed"


class TradeoffModel(MeasuredResult):
    """State of the page."""

    name, noun, again = "tradeoff", "result", "measure again"

    def __init__(self, jobs: JobRunner, folder: Path, preferences: Preferences) -> None:
        self.preferences = preferences
        self.measurer: Callable[..., dict[str, Any]] = (
            measured_methods.measure_methods
        )  # the window has one that paints, too
        self.charts: dict[str, MethodChart] = {}
        super().__init__(jobs, folder / _FILE)
        self.own = self.content is not None
        if not self.own:
            problem = self.problem
            self.take(load("measured"))
            self.problem = problem

    @property
    def shown(self) -> str:
        """Name of the method that is shown, or `OVERVIEW`."""
        name = str(self.preferences.get(_SHOWN, ""))
        return name if name in ROWS else OVERVIEW

    def show(self, name: str) -> None:
        """Show a method, or all of them."""
        self.preferences.set(_SHOWN, name)
        self.revision += 1

    @property
    def chart(self) -> MethodChart | None:
        """The chart of the shown method, where it was measured."""
        return self.charts.get(self.shown)

    @property
    def defaults(self) -> list[DefaultPoint]:
        """The default of each method, for the overview."""
        charts = {name: self.charts.get(name) for name in METHOD_NAMES}
        return [DefaultPoint(name, chart, chart.default_point if chart else None) for name, chart in charts.items()]

    @property
    def measured(self) -> str:
        """The computer and the date of the measurement, in a line."""
        machine = (self.content or {}).get("machine", {})
        where = "this computer" if self.own else "the computer of the shipped measurement"
        return f"Measured on {where} ({machine.get('processor')}), {str(machine.get('date_utc'))[:10]}"

    def entry(self, name: str) -> str:
        """Return the second line of a method in the list."""
        chart = self.charts.get(name)
        if name in MAPPED:
            return "map only"
        if name == OVERVIEW:
            return "default of each: time, error"
        if chart is None:
            return "not measured"
        return "\u25cf default confirmed" if chart.default_is_chosen else "\u25b2 the rule chose another"

    def toggle(self) -> None:
        """Start measuring this computer, or stop."""
        self._toggle(Job("Measuring this computer", self.measurer))

    def status(self) -> str:
        """Return the progress of the measurement, or what went wrong, in a line."""
        return self._progress_text()

    def _read(self, content: Any) -> None:
        self.charts = read_report(content)

    def _joined(self, fresh: dict[str, Any]) -> dict[str, Any]:
        self.own = True
        return fresh
