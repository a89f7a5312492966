"""The stability atlas on the trade-off page: where a method works, where only with a reservation, where it refuses.

Rules: maps are swept in a helper process and kept beside the window's preferences, each with the date it was made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from boat_daq.errors import OperatorError
from boat_daq.viewmodels.common.formatting import count, quantity
from boat_daq.viewmodels.common.measured_result import MeasuredResult
from boat_daq.viewmodels.common.work import Bench, Work
from boat_daq.viewmodels.models.tradeoff_report import error_text

OUTCOMES = ("works", "degraded", "refused", "quiet wrong")
LETTERS = {"works": "", "degraded": "d", "refused": "r", "quiet wrong": "!"}
LEGEND = {
    "works": "works",
    "degraded": "d  with a reservation",
    "refused": "r  refused",
    "quiet wrong": "!  wrong and silent",
}
FILE = "atlas.json"


@dataclass(frozen=True, slots=True)
class Place:
    """One place of a map: its outcome, its error in the map's unit, what the user was told."""

    outcome: str
    error: float
    said: str


@dataclass(frozen=True, slots=True)
class MapShown:
    """One map; `places` [y][x]."""

    name: str
    title: str
    truth: str
    unit: str
    tolerance: float
    x_title: str
    y_title: str
    x_ticks: tuple[str, ...]
    y_ticks: tuple[str, ...]
    places: tuple[tuple[Place, ...], ...]

    def words(self, column: int, row: int) -> str:
        """Return a place in words; empty beside the map."""
        if not (0 <= column < len(self.x_ticks) and 0 <= row < len(self.y_ticks)):
            return ""
        place = self.places[row][column]
        error = f", error {error_text(place.error)} {self.unit}" if place.error == place.error else ""
        said = f": {place.said}" if place.said else ""
        where = f"{self.x_title} {self.x_ticks[column]}, {self.y_title} {self.y_ticks[row]}"
        return f"{where} \u2013 {place.outcome}{error}{said}"

    @property
    def summary(self) -> str:
        """Return how many places ended how."""
        found = [place.outcome for row in self.places for place in row]
        parts = [f"{name} in {found.count(name)}" for name in OUTCOMES if name in found]
        return f"{', '.join(parts)} of {count(len(found), 'place')}; tolerance {quantity(self.tolerance, self.unit)}"


def read_maps(content: Any) -> dict[str, list[MapShown]]:
    """Return the maps of an atlas, by method.

    Raises
    ------
    OperatorError : it is not a result of `boat-daq atlas`.
    """
    maps: dict[str, list[MapShown]] = {}
    try:
        for m in content["maps"]:
            maps.setdefault(str(m["method"]), []).append(_map(m))
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise OperatorError(
            "this file holds no stability atlas", "Choose an atlas.json that this page or the command wrote."
        ) from error
    return maps


def _map(m: Mapping[str, Any]) -> MapShown:
    x, y = m["x"], m["y"]
    places = tuple(tuple(_place(cell) for cell in row) for row in m["cells"])
    return MapShown(
        str(m["name"]), str(m["title"]), str(m["truth"]), str(m["unit"]), float(m["tolerance"]), _title(x), _title(y),
        _ticks(x), _ticks(y), places,
    )  # fmt: skip


def _place(cell: Mapping[str, Any]) -> Place:
    outcome = str(cell["outcome"])
    if outcome not in OUTCOMES:
        raise ValueError(outcome)
    error = cell["error"]
    return Place(outcome, float("nan") if error is None else float(error), str(cell["said"]))


def _title(axis: Mapping[str, Any]) -> str:
    return f"{axis['name']} ({axis['unit']})" if axis["unit"] else str(axis["name"])


def _ticks(axis: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(str(t) for t in axis.get("labels") or ()) or tuple(f"{float(v):g}" for v in axis["values"])


class AtlasModel(MeasuredResult):
    """State of the atlas.

    Parameters
    ----------
    bench : where maps are swept.
    folder : where they are kept.
    """

    name, noun, again = "atlas", "maps", "sweep again"

    def __init__(self, bench: Bench, folder: Path) -> None:
        self.maps: dict[str, list[MapShown]] = {}
        super().__init__(bench, folder / FILE)

    def toggle(self, method: str) -> None:
        """Start sweeping a method's maps, or stop."""
        if self.work is not None:
            self.bench.cancel(self.name)
            return
        self._start(
            Work("Mapping where it works", "boat_daq.viewmodels.models.tradeoff_jobs:sweep_method", method, report=True)
        )

    def _read(self, content: Any) -> None:
        self.maps = read_maps(content)

    def _joined(self, fresh: dict[str, Any]) -> dict[str, Any]:
        swept = {m["method"] for m in fresh["maps"]}
        kept = [m for m in (self.content or {"maps": []})["maps"] if m["method"] not in swept]
        return {**fresh, "maps": [*kept, *fresh["maps"]]}

    def status(self, method: str) -> str:
        """Return what is going on, in a line."""
        return self._going_on("mapping") or ("" if self.maps.get(method) else "not mapped yet")
