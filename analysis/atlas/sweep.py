"""Where a method breaks down: a sweep over two of its parameters, judged in every place against a truth of its own.

Strategy: a study asks the method, through the door its users take, at every place of a grid; what comes back is an
error against a truth that does not come from the method, and whatever the user was told. Four outcomes follow:

    works        a number within the tolerance, and nothing was said against it
    degraded     a number with a reservation: a flag, a note, a fallback
    refused      no number, and the reason
    quiet wrong  a number beyond the tolerance, or no number, and not a word: a bug

Rules: the outcome is decided once, in `judged`; a tolerance is what the reader of the number was promised. An error
outside the analysis' own family is no refusal and ends the sweep.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from analysis.errors import AnalysisError

Progress = Callable[[float, float], None]


class Outcome(StrEnum):
    """What a user gets in one place of a map."""

    WORKS = "works"
    DEGRADED = "degraded"
    REFUSED = "refused"
    QUIET_WRONG = "quiet wrong"


@dataclass(frozen=True, slots=True)
class Axis:
    """One parameter of a sweep.

    Parameters
    ----------
    name, unit : as the map writes them; no unit is "".
    values : in their order along the axis, evenly drawn whatever they are.
    labels : how the map writes the values, where the plain number would not do.
    """

    name: str
    unit: str
    values: tuple[float, ...]
    labels: tuple[str, ...] = ()

    @property
    def ticks(self) -> tuple[str, ...]:
        """One label a value."""
        return self.labels or tuple(f"{value:g}" for value in self.values)

    @property
    def title(self) -> str:
        """Name and unit."""
        return f"{self.name}, {self.unit}" if self.unit else self.name


@dataclass(frozen=True, slots=True)
class Answer:
    """What the method gave in one place.

    Parameters
    ----------
    error : against the study's truth, in its unit; NaN where no number was given.
    said : what the user was told about it: flag, note or reason; "" if nothing.
    """

    error: float
    said: str = ""


@dataclass(frozen=True, slots=True)
class Cell:
    """One place of a map."""

    x: float
    y: float
    outcome: Outcome
    error: float
    said: str


@dataclass(frozen=True, slots=True)
class Study:
    """One map to be made.

    Parameters
    ----------
    name : of the map. method : whose it is, as `boat-daq tradeoff` names methods; several maps may share one.
    title : in plain words. truth : what the error is measured against.
    unit, tolerance : of the error; beyond the tolerance a number is wrong.
    x, y : the two parameters.
    ask : asks the method at (x, y); an error of the analysis is a refusal.
    """

    name: str
    method: str
    title: str
    truth: str
    unit: str
    tolerance: float
    x: Axis
    y: Axis
    ask: Callable[[float, float], Answer]

    @property
    def places(self) -> int:
        """How many places the grid has."""
        return len(self.x.values) * len(self.y.values)

    def at(self, x: float, y: float) -> Cell:
        """Ask in one place, on the grid or off it."""
        try:
            answer = self.ask(x, y)
        except AnalysisError as error:
            answer = Answer(math.nan, error.cause)
        return Cell(x, y, judged(answer, self.tolerance), answer.error, answer.said)


@dataclass(frozen=True, slots=True)
class Map:
    """A study, swept. `cells` [y][x]."""

    study: Study
    cells: tuple[tuple[Cell, ...], ...] = field(repr=False)

    def __iter__(self) -> Iterator[Cell]:
        return (cell for row in self.cells for cell in row)

    def found(self, outcome: Outcome) -> tuple[Cell, ...]:
        """Return the cells of one outcome."""
        return tuple(cell for cell in self if cell.outcome is outcome)

    @property
    def counts(self) -> dict[str, int]:
        """Number of cells of each outcome."""
        return {outcome.value: len(self.found(outcome)) for outcome in Outcome}

    @property
    def verdict(self) -> str:
        """One sentence about the map."""
        parts = [f"{name} in {count}" for name, count in self.counts.items() if count or name == Outcome.QUIET_WRONG]
        return f"{self.study.title}: {', '.join(parts)} of {self.study.places} places"

    def as_json(self) -> dict[str, Any]:
        """Return the map as plain values; an error that is no number is null."""
        study = self.study
        return {
            "name": study.name,
            "method": study.method,
            "title": study.title,
            "truth": study.truth,
            "unit": study.unit,
            "tolerance": study.tolerance,
            "x": _axis_json(study.x),
            "y": _axis_json(study.y),
            "counts": self.counts,
            "cells": [[_cell_json(cell) for cell in row] for row in self.cells],
        }


def judged(answer: Answer, tolerance: float) -> Outcome:
    """Decide what an answer is worth to the user who got it."""
    if math.isnan(answer.error):
        return Outcome.REFUSED if answer.said else Outcome.QUIET_WRONG
    if answer.said:
        return Outcome.DEGRADED
    return Outcome.WORKS if answer.error <= tolerance else Outcome.QUIET_WRONG


def sweep(study: Study, progress: Progress | None = None) -> Map:
    """Ask in every place of a study's grid.

    Parameters
    ----------
    progress : called with (places done, places) after each; raising from it cancels.
    """
    done, rows = 0, []
    for y in study.y.values:
        row = []
        for x in study.x.values:
            row.append(study.at(x, y))
            done += 1
            if progress is not None:
                progress(done, study.places)
        rows.append(tuple(row))
    return Map(study, tuple(rows))


def joined(said: Sequence[str]) -> str:
    """Join what was said to one line."""
    return "; ".join(dict.fromkeys(text for text in said if text))


def _axis_json(axis: Axis) -> dict[str, Any]:
    return {"name": axis.name, "unit": axis.unit, "values": list(axis.values), "labels": list(axis.ticks)}


def _cell_json(cell: Cell) -> dict[str, Any]:
    error = cell.error if math.isfinite(cell.error) else None
    return {"x": cell.x, "y": cell.y, "outcome": cell.outcome.value, "error": error, "said": cell.said}
