"""The trade-off page: time against error of each method on this computer, and the stability atlas of each.

Rules: methods are measured, and maps swept, in a helper process. The last results are kept beside the window's
preferences and shown at the next start; methods that were not measured again keep theirs, with their own date. A file
that is not such a result is refused. Points are numbered from the cheapest; the error of a setting that failed is
infinite and not drawn. A map shows where a method works, where only with a warning, where it refuses.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from analysis.arrays import FloatArray
from analysis.progress import Progress
from boat_daq.engine.display.ring_buffer import MinMaxPyramid, fold_columns
from boat_daq.engine.simulator.picture import CameraScene, Picture, Renderer
from boat_daq.engine.toml_values import read_json
from boat_daq.errors import OperatorError
from boat_daq.viewmodels.common import tables
from boat_daq.viewmodels.common.formatting import count, duration_text, power_text, quantity
from boat_daq.viewmodels.common.jobs import Job, JobRunner
from boat_daq.viewmodels.common.measured_result import MAX_BYTES, MeasuredResult
from boat_daq.viewmodels.common.preferences import Preferences

if TYPE_CHECKING:
    from analysis.tradeoff.decimation import Curve, Paint
    from analysis.tradeoff.measure import Method

FRONT = "front"
SYMBOLS = {"default": "\u25cb", "chosen": "\u25a1"}
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
CHOSEN, QUICK, SHOWN = "tradeoff_methods", "tradeoff_quick", "tradeoff_shown"
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

    def cheapest(self, tolerance: float) -> TradeoffPoint | None:
        """Return the cheapest setting whose error is within a tolerance; None where no setting is."""
        within = [p for p in self.points if p.drawn and p.error <= tolerance]
        return min(within, key=lambda p: p.seconds, default=None)

    def asked_text(self, tolerance: float) -> str:
        """Return what a tolerance costs on the computer of the measurement."""
        asked, found = quantity(tolerance, self.unit), self.cheapest(tolerance)
        if found is None:
            best = min((p.error for p in self.points if p.drawn), default=math.nan)
            return f"{asked}: no setting meets it, the best has {quantity(best, self.unit)}"
        return f"{asked}: {duration_text(found.seconds, 2)}, by {found.setting}"

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


def live_plot(paint: Paint | None = None) -> Method:
    """Return the method of the live plot, with what `paint` takes where it is given."""
    from analysis.tradeoff.decimation import decimation

    return decimation(_stored, paint)


def _stored(record: FloatArray) -> Curve:
    from analysis.tradeoff.decimation import WIDTH_PX

    pyramid = MinMaxPyramid(*record.shape)
    pyramid.append(record)
    return lambda end_s, points: fold_columns(pyramid.draw(0.0, end_s, points), end_s / WIDTH_PX)


def camera_tracker() -> Method:
    """Return the method of the camera's tracker, on pictures of the virtual camera."""
    from analysis.tradeoff.tracking import tracking

    def render(width: int, elongations_mm: Sequence[float]) -> list[Picture]:
        scene = CameraScene(width=width, height=3 * width // 4, px_per_mm=width / 32.0)
        renderer = Renderer(scene)
        return [renderer.frame(n, np.array([x]), n / 30.0) for n, x in enumerate(elongations_mm)]

    return tracking(render)


def measure_methods(
    names: Sequence[str], quick: bool, paint: Paint | None = None, *, progress: Progress | None = None
) -> dict[str, Any]:
    """Measure methods one after the other; return what `boat-daq tradeoff --json` prints.

    Parameters
    ----------
    names : of methods, as the command takes them.
    quick : fewer settings and repeats.
    paint : paints a curve of the live plot; without it the curve is fetched only.
    progress : is called with what is done and the total.
    """
    from analysis.tradeoff.measure import measure_all
    from analysis.tradeoff.methods import METHODS
    from analysis.tradeoff.report import report_json

    known = METHODS | {"decimation": live_plot(paint), "tracking": camera_tracker()}
    results = measure_all([known[name] for name in names], quick=quick, progress=progress)
    return report_json(results, quick=quick)


def sweep_method(name: str, *, progress: Progress | None = None) -> dict[str, Any]:
    """Sweep every map of a method; return what `boat-daq atlas --json` prints.

    Raises
    ------
    RequestError : there is no such method.
    """
    from analysis.atlas.methods import chosen_studies
    from analysis.atlas.report import atlas_json
    from analysis.atlas.sweep import sweep_all

    return atlas_json(sweep_all(chosen_studies([name]), progress))


class TradeoffModel(MeasuredResult):
    """State of the page.

    Parameters
    ----------
    jobs : where methods are measured.
    folder : where the last result is kept.
    preferences : keep the choices.
    """

    name, noun, again = "tradeoff", "result", "measure again"

    def __init__(self, jobs: JobRunner, folder: Path, preferences: Preferences) -> None:
        self.preferences = preferences
        self.measurer: Measurer = measure_methods  # the window has one that paints, too
        self.charts: dict[str, MethodChart] = {}
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
        """Name of the method that is shown."""
        name = str(self.preferences.get(SHOWN, ""))
        return name if name in ENTRIES else next(iter(ENTRIES))

    def show(self, name: str) -> None:
        """Show a method."""
        self.preferences.set(SHOWN, name)
        self.revision += 1

    @property
    def chart(self) -> MethodChart | None:
        """The chart of the shown method, where it was measured."""
        return self.charts.get(self.shown)

    # ---- measuring -----------------------------------------------------------------------------------------------

    def toggle(self) -> None:
        """Start measuring the chosen methods, or stop.

        Raises
        ------
        OperatorError : no method is chosen.
        """
        if self.job is None and not self.chosen:
            raise OperatorError("no method is chosen", "Tick one or more in the list of methods.")
        label = f"Measuring {count(len(self.chosen), 'method')}"
        self._toggle(Job(label, self.measurer, self.chosen, self.quick))

    def _read(self, content: Any) -> None:
        self.charts = read_report(content)

    def _joined(self, fresh: dict[str, Any]) -> dict[str, Any]:
        return merged(self.content, fresh)

    # ---- files ---------------------------------------------------------------------------------------------------

    def load(self, path: Path) -> None:
        """Show the result in a file, and keep it.

        Raises
        ------
        OperatorError : it cannot be read, or is no such result.
        """
        self.take(read_json(path, MAX_BYTES))
        self._store()

    def save(self, path: Path) -> None:
        """Write the result by the suffix of `path`: .json as the command, .csv with a row for each point.

        Raises
        ------
        OperatorError : nothing has been measured.
        OSError : the path cannot be written.
        """
        if self.content is None:
            raise OperatorError("nothing has been measured yet", "Press Measure, or open a result.")
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
        if chart is None:
            return "not measured yet"
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
    OperatorError : it is not a result of `boat-daq atlas`.
    """
    maps: dict[str, list[MapView]] = {}
    try:
        for m in content["maps"]:
            maps.setdefault(str(m["method"]), []).append(_map(m))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise OperatorError(
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
    """State of the atlas.

    Parameters
    ----------
    jobs : where maps are swept.
    folder : where they are kept.
    """

    name, noun, again = "atlas", "maps", "sweep again"

    def __init__(self, jobs: JobRunner, folder: Path) -> None:
        self.maps: dict[str, list[MapView]] = {}
        super().__init__(jobs, folder / ATLAS_FILE)

    def toggle(self, method: str) -> None:
        """Start sweeping a method's maps, or stop."""
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
