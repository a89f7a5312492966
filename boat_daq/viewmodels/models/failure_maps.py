"""The maps of where a method works, where only with a warning, where it refuses: swept on request, and kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from boat_daq.formatting import count, quantity
from boat_daq.viewmodels.common.measured_result import MeasuredResult
from boat_daq.viewmodels.models.tradeoff import ENTRIES, OVERVIEW, error_text
from boat_daq.workflows import measured_methods
from boat_daq.workflows.jobs import Job, JobRunner
from protocol.base.errors import RequestError

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
CODES = {"works": "works", "degraded": "degraded", "refused": "refused", "quiet wrong": "unwarned"}  # of `atlas --json`
OUTCOMES = {  # code -> letter in a cell, text
    "works": ("", "works"),
    "degraded": ("d", "works with a warning"),
    "refused": ("r", "refuses"),
    "unwarned": ("!", "wrong without warning"),
}
ATLAS_FILE = "atlas.json"


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
    """Return the maps of an atlas, by method."""
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
        """Start sweeping a method's maps, or stop."""
        if self.job is None and method == OVERVIEW:
            raise RequestError("no method is shown whose map could be made", "Choose one in the list of methods.")
        self._toggle(Job("Mapping where it works", measured_methods.sweep_method, method))

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
