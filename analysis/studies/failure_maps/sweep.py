"""Where a method breaks down: a sweep over two of its parameters, each result compared with a truth of its own.

Strategy: a study calls the method, through the interface that its users call, at every point of a grid; the result is
an error against a truth that does not come from the method, and the message that the user gets. Four outcomes follow:

    works                  a number within the tolerance, and no message
    works with a warning   a number, with a warning or from a fallback
    refuses                no number, and the reason
    wrong without warning  a number beyond the tolerance, or no number, and no message: a bug

Rules: the outcome is decided once, in `outcome_of`; a tolerance is what the reader of the number was promised. An error
outside the analysis' own family is no refusal and ends the sweep.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from analysis.json_object import json_object
from analysis.progress import Progress
from analysis.studies.harness import run_all
from protocol.base.errors import BoatDaqError


class CellOutcome(StrEnum):
    """Outcome for the user at one point of a map; the values are those of atlas.json."""

    WORKS = "works"
    WARNS = "degraded"
    REFUSES = "refused"
    WRONG_UNWARNED = "quiet wrong"

    @property
    def label(self) -> str:
        """Return the outcome in words."""
        words = {"degraded": "works with a warning", "refused": "refuses", "quiet wrong": "wrong without warning"}
        return words.get(self.value, self.value)


@dataclass(frozen=True, slots=True)
class Axis:
    """One parameter of a sweep."""

    name: str
    unit: str
    values: tuple[float, ...]
    labels: tuple[str, ...] = ()

    @property
    def ticks(self) -> tuple[str, ...]:
        return self.labels or tuple(f"{value:g}" for value in self.values)

    @property
    def title(self) -> str:
        return f"{self.name}, {self.unit}" if self.unit else self.name

    def as_json(self) -> dict[str, Any]:
        return json_object(self, "name", "unit", "values", "labels=ticks")


@dataclass(frozen=True, slots=True)
class StudyResult:
    """The result of the method at one point."""

    error: float  # against the study's truth, in its unit; NaN where no number was given
    message: str = ""  # warning or reason that the user gets; "" if none


@dataclass(frozen=True, slots=True)
class Cell:
    """One point of a map."""

    x: float
    y: float
    outcome: CellOutcome
    error: float
    message: str

    def as_json(self) -> dict[str, Any]:
        """Return the cell as plain values; an error that is no number is null."""
        error = self.error if math.isfinite(self.error) else None
        return {"x": self.x, "y": self.y, "outcome": self.outcome.value, "error": error, "said": self.message}


@dataclass(frozen=True, slots=True)
class Study:
    """One map to be made."""

    name: str
    method: str  # it belongs to, as `boat-daq tradeoff` names methods; several maps may share one
    title: str
    truth: str  # what the error is measured against
    unit: str
    tolerance: float
    x: Axis
    y: Axis
    run: Callable[[float, float], StudyResult]  # calls the method at (x, y); an error of the analysis is a refusal

    @property
    def size(self) -> int:
        """Return how many points the grid has."""
        return len(self.x.values) * len(self.y.values)

    def at(self, x: float, y: float) -> Cell:
        """Run the method at one point, on the grid or off it."""
        try:
            result = self.run(x, y)
        except BoatDaqError as error:
            result = StudyResult(math.nan, error.cause)
        return Cell(x, y, outcome_of(result, self.tolerance), result.error, result.message)


@dataclass(frozen=True, slots=True)
class StudyMap:
    """A study, swept. `cells` [y][x]."""

    study: Study
    cells: tuple[tuple[Cell, ...], ...] = field(repr=False)

    def __iter__(self) -> Iterator[Cell]:
        return (cell for row in self.cells for cell in row)

    def found(self, outcome: CellOutcome) -> tuple[Cell, ...]:
        return tuple(cell for cell in self if cell.outcome is outcome)

    @property
    def counts(self) -> dict[CellOutcome, int]:
        return {outcome: len(self.found(outcome)) for outcome in CellOutcome}

    @property
    def verdict(self) -> str:
        """Return one sentence about the map."""
        parts = [f"{o.label} at {n}" for o, n in self.counts.items() if n or o is CellOutcome.WRONG_UNWARNED]
        return f"{self.study.title}: {', '.join(parts)} of {self.study.size} points"

    def as_json(self) -> dict[str, Any]:
        study = self.study
        described = {name: getattr(study, name) for name in ("name", "method", "title", "truth", "unit", "tolerance")}
        cells = [[cell.as_json() for cell in row] for row in self.cells]
        return {**described, "x": study.x.as_json(), "y": study.y.as_json(), "counts": self.counts, "cells": cells}


def outcome_of(result: StudyResult, tolerance: float) -> CellOutcome:
    """Return the outcome of a result for its user."""
    if math.isnan(result.error):
        return CellOutcome.REFUSES if result.message else CellOutcome.WRONG_UNWARNED
    if result.message:
        return CellOutcome.WARNS
    return CellOutcome.WORKS if result.error <= tolerance else CellOutcome.WRONG_UNWARNED


def sweep(study: Study, progress: Progress | None = None) -> StudyMap:
    """Run the method at every point of a study's grid; `progress` is called with (points done, points)."""
    columns, cells = len(study.x.values), []
    for y, x in itertools.product(study.y.values, study.x.values):
        cells.append(study.at(x, y))
        if progress is not None:
            progress(len(cells), study.size)
    return StudyMap(study, tuple(tuple(cells[i : i + columns]) for i in range(0, len(cells), columns)))


def sweep_all(studies: Sequence[Study], progress: Progress | None = None) -> list[StudyMap]:
    """Sweep several studies; `progress` is called with (points done, points) of all."""
    return run_all(studies, sweep, progress, lambda study: study.size)


def joined(messages: Sequence[str]) -> str:
    """Join messages to one line, each once."""
    return "; ".join(dict.fromkeys(text for text in messages if text))
