"""The trade-off page: time against error of each method on this computer, and the stability atlas of each.

Rules: methods are measured, and maps swept, in a helper process. The last results are kept beside the window's
preferences and shown at the next start; methods that were not measured again keep theirs, with their own date and
computer. A file that is not such a result is refused. Points are numbered from the cheapest; the error of a setting
that failed is infinite and not drawn. The setting for any tolerance is found by the rule of the defaults. A map shows
where a method works, where only with a warning, where it refuses.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from analysis.machine import machine
from analysis.studies.tradeoff.measure import MARGIN, CostPoint, choose, part_of_tolerance
from boat_daq.engine.toml_values import read_json
from boat_daq.formatting import count, duration_text, power_text, quantity
from boat_daq.viewmodels.common import tables
from boat_daq.viewmodels.common.measured_result import MAX_BYTES, MeasuredResult
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.viewmodels.common.services import Change, UndoHistory
from boat_daq.workflows.jobs import Job, JobRunner
from boat_daq.workflows.measured_methods import measure_methods, sweep_method
from protocol.base.errors import RequestError

FRONT = "front"
CHOICE = "the rule's choice"
SYMBOLS = {"default": "\u25cb", "chosen": "\u25a1"}
USES = {"chosen": CHOICE}
METHODS = {
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
MAPPED = {"fit": "Fit of the calibration", "figures": "SNR and hysteresis", "alarms": "Alarms of the shadow"}
"""Methods that have a map of where they fail, but no chart of time against error."""
ENTRIES = METHODS | MAPPED
OVERVIEW = "overview"
ROWS = {OVERVIEW: "All methods"} | ENTRIES
"""What the page can show, by name."""
JOBS = ("calibration", "report", "sweep", "shadow")
"""Methods that are whole jobs, from the input to the result."""
MAPPED_BY = {
    "ranking": ("tracer",),
    "bootstrap": ("figures",),
    "decimation": (),
    "tracking": (),
    "calibration": ("segmentation", "fit", "posterior", "figures"),
    "report": ("segmentation", "fit", "posterior", "figures"),
    "sweep": ("tracer",),
    "shadow": ("full-fem", "reduced-fem"),
}
"""Methods and jobs that have no map of their own, and the methods they rest on, which have."""
Measurer = Callable[[Sequence[str], bool], dict[str, Any]]
FILE = "tradeoff.json"
CHOSEN, QUICK, SHOWN, ASKED = "tradeoff_methods", "tradeoff_quick", "tradeoff_shown", "tradeoff_tolerances"
CODES = {"works": "works", "degraded": "degraded", "refused": "refused", "quiet wrong": "unwarned"}  # of `atlas --json`
OUTCOMES = {  # code -> letter in a cell, text
    "works": ("", "works"),
    "degraded": ("d", "works with a warning"),
    "refused": ("r", "refuses"),
    "unwarned": ("!", "wrong without warning"),
}
ATLAS_FILE = "atlas.json"


@dataclass(frozen=True, slots=True)
class TradeoffPoint:
    """One setting: processor time (s) with the range of its repeats, error with its range, and its marks.

    Marks are the program's uses of it ("default", "chosen" by the rule, the levels of precision other than the default
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

    @property
    def uses_text(self) -> str:
        """Its uses as its label; a default that the rule chooses is the default."""
        return ", ".join(USES.get(use, use) for use in self.uses if use != "chosen" or "default" not in self.uses)


@dataclass(frozen=True, slots=True)
class MethodChart:
    """One measured method; the rule accepts a setting whose error, times `margin`, is within a tolerance."""

    name: str
    reference: str
    consumer: str
    tolerance: float
    margin: float
    unit: str
    per: str
    default: str
    chosen: str | None
    when: str
    processor: str
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

    def choice(self, tolerance: float) -> TradeoffPoint | None:
        """Return what the rule chooses for a tolerance; None where no setting is accepted."""
        drawn = {p.setting: p for p in self.points if p.drawn}
        costs = [
            CostPoint(p.setting, p.seconds, p.error, p.spread_s, p.seconds, p.error_spread, p.repeats)
            for p in drawn.values()
        ]
        chosen = choose(costs, tolerance, self.default, self.margin)
        return None if chosen is None else drawn[chosen]

    def asked_text(self, tolerance: float) -> str:
        """Return what a tolerance costs on the computer of the measurement."""
        asked, found = quantity(tolerance, self.unit), self.choice(tolerance)
        if found is not None:
            return f"Tolerance {asked}: {duration_text(found.seconds, 2)} with {found.setting}"
        best = min((p.error for p in self.points if p.drawn), default=math.nan)
        return f"Tolerance {asked}: no setting is accepted, the least error is {quantity(best, self.unit)}"

    @property
    def part(self) -> str:
        """What of a tolerance the error of an accepted setting may be, as text."""
        return part_of_tolerance(self.margin)

    @property
    def explanation(self) -> str:
        """Where an error is noticed, the rule, and its choice for that tolerance."""
        limit = quantity(self.tolerance, self.unit)
        chosen = f"{self.chosen or 'none'}; the default is {self.default}"
        if self.default_is_chosen:
            chosen = f"the default, {self.default}"
        return (
            f"An error is noticeable above {limit}: {self.consumer}.\n"
            f"The rule chooses the fastest setting whose error is at most {self.part}: {chosen}.\n"
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
    """Return the methods of a result, by name.

    Raises
    ------
    RequestError : it is not a result of `boat-daq tradeoff`.
    """
    try:
        return {str(m["name"]): _method(m) for m in _dated(content)}
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise RequestError(
            "this file is not a measured trade-off", "Choose a tradeoff.json that this page or the command wrote."
        ) from error


def _method(m: Mapping[str, Any]) -> MethodChart:
    rows = sorted(m["points"], key=lambda p: float(p.get("cpu_seconds", p["seconds"])))
    when = f"{'quick' if m['quick'] else 'full'}, {str(m['measured_utc'])[:10]}"
    return MethodChart(
        str(m["name"]), str(m["reference"]), str(m["consumer"]), float(m["tolerance"]), float(m["margin"]),
        str(m["unit"]), str(m.get("per", "a call")), str(m["default"]), m.get("chosen"), when, str(m["processor"]),
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
    """Return a new result with the methods that only the old one has; each keeps its date, extent and processor."""
    fresh, kept = _dated(new), _dated(old) if old is not None else []
    names = {m["name"] for m in fresh}
    return {**new, "methods": [*fresh, *(m for m in kept if m["name"] not in names)]}


def _dated(content: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the methods of a result, each with where, when and how it was measured and judged."""
    by = content["machine"]
    own = {
        "measured_utc": by.get("date_utc", ""),
        "quick": bool(content.get("quick")),
        "margin": content.get("margin", MARGIN),
        "processor": by.get("processor", "unknown processor"),
    }
    return [{**own, **m} for m in content["methods"]]


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


class TradeoffModel(MeasuredResult):
    """State of the page.

    Parameters
    ----------
    undo : takes the opening of a file.
    """

    name, noun, again = "tradeoff", "result", "measure again"

    def __init__(self, jobs: JobRunner, folder: Path, preferences: Preferences, undo: UndoHistory) -> None:
        self.preferences, self._undo = preferences, undo
        self.measurer: Measurer = measure_methods  # the window has one that paints, too
        self.charts: dict[str, MethodChart] = {}
        self.processor = str(machine()["processor"])
        super().__init__(jobs, folder / FILE)

    # ---- what is chosen ------------------------------------------------------------------------------------------

    @property
    def chosen(self) -> tuple[str, ...]:
        """Names of the methods that a measurement takes."""
        kept = self.preferences.get(CHOSEN, list(METHODS))
        return tuple(name for name in METHODS if name in kept)

    def choose(self, name: str, on: bool) -> None:
        """Include a method in the next measurement, or not."""
        self.preferences.set(CHOSEN, [n for n in METHODS if (on if n == name else n in self.chosen)])

    @property
    def quick(self) -> bool:
        """Whether the next measurement is the quick one."""
        return bool(self.preferences.get(QUICK, True))

    def set_quick(self, on: bool) -> None:
        """Choose the quick measurement or the full one."""
        self.preferences.set(QUICK, on)

    @property
    def shown(self) -> str:
        """Name of the method that is shown, or `OVERVIEW`."""
        name = str(self.preferences.get(SHOWN, ""))
        return name if name in ROWS else OVERVIEW

    def show(self, name: str) -> None:
        """Show a method, or all of them."""
        self.preferences.set(SHOWN, name)
        self.revision += 1

    @property
    def chart(self) -> MethodChart | None:
        """The chart of the shown method, where it was measured."""
        return self.charts.get(self.shown)

    @property
    def defaults(self) -> list[DefaultPoint]:
        """The default of each method, for the overview."""
        charts = {name: self.charts.get(name) for name in METHODS}
        return [DefaultPoint(name, chart, chart.default_point if chart else None) for name, chart in charts.items()]

    def tolerance(self, chart: MethodChart) -> float:
        """Return the operator's tolerance of a method, in its unit: what is noticeable until another is chosen."""
        asked = self.preferences.get(ASKED, {}).get(chart.name)
        return asked if isinstance(asked, float) and 0 < asked < math.inf else chart.tolerance

    def ask(self, chart: MethodChart, tolerance: float) -> None:
        """Choose the tolerance of a method."""
        self.preferences.set_later(ASKED, self.preferences.get(ASKED, {}) | {chart.name: tolerance})

    def where(self, chart: MethodChart) -> str:
        """Return the computer that a method was measured on."""
        here = chart.processor == self.processor
        return f"this computer ({chart.processor})" if here else f"another computer ({chart.processor})"

    # ---- measuring -----------------------------------------------------------------------------------------------

    def toggle(self) -> None:
        """Start measuring the chosen methods, or stop.

        Raises
        ------
        RequestError : no method is chosen.
        """
        if self.job is None and not self.chosen:
            raise RequestError("no method is chosen", "Tick one or more in the list of methods.")
        label = f"Measuring {count(len(self.chosen), 'method')}"
        self._toggle(Job(label, self.measurer, self.chosen, self.quick))

    def _read(self, content: Any) -> None:
        self.charts = read_report(content)

    def _joined(self, fresh: dict[str, Any]) -> dict[str, Any]:
        return merged(self.content, fresh)

    # ---- files ---------------------------------------------------------------------------------------------------

    def load(self, path: Path) -> None:
        """Show the result in a file, undoably, and keep it with the methods that it does not have.

        Raises
        ------
        RequestError : it cannot be read, or is no such result.
        """
        content = read_json(path, MAX_BYTES)
        read_report(content)  # refused before it is merged
        change = partial(self._open, content), partial(self._close, content, self.content)
        self._undo.push(Change("the opened trade-off", *change))

    def _open(self, content: dict[str, Any]) -> None:
        self.take(merged(self.content, content))
        self._store()

    def _close(self, content: dict[str, Any], before: dict[str, Any] | None) -> None:
        """Show the result before a file was opened, with what was measured since."""
        now, opened = self.content or content, _dated(content)
        others = [method for method in now["methods"] if method not in opened]
        self.take(merged(before, {**now, "methods": others}))
        self._store()

    def save(self, path: Path) -> None:
        """Write the result by the suffix of `path`: .json as the command, .csv with a row for each point.

        Raises
        ------
        RequestError : nothing has been measured.
        OSError : the path cannot be written.
        """
        if self.content is None:
            raise RequestError("nothing has been measured yet", "Press Measure, or open a result.")
        if path.suffix == ".csv":
            tables.save_csv(path, report_columns(self.charts))
        else:
            self._write_json(path)

    # ---- texts ---------------------------------------------------------------------------------------------------

    def entry(self, name: str) -> str:
        """Return the second line of a method in the list."""
        chart = self.charts.get(name)
        if name in MAPPED:
            return "map only"
        if name == OVERVIEW:
            return "default of each: time, error"
        if chart is None:
            return "not measured yet"
        if chart.processor != self.processor:
            return "\u25c7 of another computer"
        return "\u25cf default confirmed" if chart.default_is_chosen else "\u25b2 the rule chose another"

    def status(self) -> str:
        """Return the progress of the measurement, or what went wrong, in a line."""
        return self._progress_text()


class MapCell(NamedTuple):
    """One case of a map: its outcome (a key of `OUTCOMES`), its error in the map's unit, the message to the user."""

    outcome: str
    error: float
    message: str


class MapAxis(NamedTuple):
    """One axis of a map: its quantity with the unit, and the value of each row or column of cells."""

    title: str
    ticks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class MapView:
    """One map; `axes` x and y, `cells` [y][x]."""

    title: str
    unit: str
    tolerance: float
    axes: tuple[MapAxis, MapAxis]
    cells: tuple[tuple[MapCell, ...], ...]

    def cell_text(self, column: int, row: int) -> str:
        """Return a case as text; empty outside the map."""
        x, y = self.axes
        if not (0 <= column < len(x.ticks) and 0 <= row < len(y.ticks)):
            return ""
        cell = self.cells[row][column]
        error = f", error {error_text(cell.error)} {self.unit}" if cell.error == cell.error else ""
        message = f": {cell.message}" if cell.message else ""
        at = f"{x.title} {x.ticks[column]}, {y.title} {y.ticks[row]}"
        return f"{at} \u2013 {OUTCOMES[cell.outcome][1]}{error}{message}"

    @property
    def summary(self) -> str:
        """The number of cases of each outcome."""
        found = [cell.outcome for row in self.cells for cell in row]
        parts = [f"{text} in {found.count(name)}" for name, (_, text) in OUTCOMES.items() if name in found]
        return f"{', '.join(parts)} of {count(len(found), 'case')}; tolerance {quantity(self.tolerance, self.unit)}"


def read_maps(content: Any) -> dict[str, list[MapView]]:
    """Return the maps of an atlas, by method.

    Raises
    ------
    RequestError : it is not a result of `boat-daq atlas`.
    """
    maps: dict[str, list[MapView]] = {}
    try:
        for m in content["maps"]:
            maps.setdefault(str(m["method"]), []).append(_map(m))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise RequestError(
            "this file is not a stability atlas", "Choose an atlas.json that this page or the command wrote."
        ) from error
    return maps


def _map(m: Mapping[str, Any]) -> MapView:
    cells = tuple(tuple(_cell(cell) for cell in row) for row in m["cells"])
    return MapView(str(m["title"]), str(m["unit"]), float(m["tolerance"]), (_axis(m["x"]), _axis(m["y"])), cells)


def _cell(cell: Mapping[str, Any]) -> MapCell:
    outcome, error = CODES[str(cell["outcome"])], cell["error"]
    return MapCell(outcome, float("nan") if error is None else float(error), str(cell["said"]))


def _axis(axis: Mapping[str, Any]) -> MapAxis:
    title = f"{axis['name']} ({axis['unit']})" if axis["unit"] else str(axis["name"])
    return MapAxis(title, tuple(str(t) for t in axis.get("labels") or ()) or tuple(f"{v:g}" for v in axis["values"]))


class AtlasModel(MeasuredResult):
    """State of the atlas."""

    name, noun, again = "atlas", "maps", "sweep again"

    def __init__(self, jobs: JobRunner, folder: Path) -> None:
        self.maps: dict[str, list[MapView]] = {}
        super().__init__(jobs, folder / ATLAS_FILE)

    def toggle(self, method: str) -> None:
        """Start sweeping a method's maps, or stop.

        Raises
        ------
        RequestError : all methods are shown, not one.
        """
        if self.job is None and method == OVERVIEW:
            raise RequestError("no method is shown whose map could be made", "Choose one in the list of methods.")
        self._toggle(Job("Mapping where it works", sweep_method, method))

    @staticmethod
    def no_map(method: str) -> str:
        """Return why there is no map of a method, and where to look; empty where there is one."""
        if method not in MAPPED_BY:
            return ""
        others = ", ".join(f"\u201c{ENTRIES[name]}\u201d" for name in MAPPED_BY[method])
        return "No map of its own" + (f": see {others}." if others else ", nor of a method that it rests on.")

    def _read(self, content: Any) -> None:
        self.maps = read_maps(content)

    def _joined(self, fresh: dict[str, Any]) -> dict[str, Any]:
        swept = {m["method"] for m in fresh["maps"]}
        kept = [m for m in (self.content or {"maps": []})["maps"] if m["method"] not in swept]
        return {**fresh, "maps": [*kept, *fresh["maps"]]}

    def status(self, method: str) -> str:
        """Return the progress of the sweep, or why there is no map, in a line."""
        known = bool(self.maps.get(method)) or method in MAPPED_BY
        return self._progress_text("mapping") or ("" if known else "not mapped yet")
