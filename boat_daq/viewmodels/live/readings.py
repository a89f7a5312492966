"""The readings of elongation: one row a plateau; typed, pasted, imported or from a photograph.

Rules: a reading is never changed, only corrected by a newer one, so undo adds a correction too. Text is checked before
anything is stored, and kept with the plateau that it was typed for. A reading far from the running fit, or from the
nominal actuator, is marked with a warning; it is never refused or removed.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np

from analysis.figures.outliers import outlying
from boat_daq.engine.plan import StepMark, resume_point
from boat_daq.engine.recording.closed_run import ClosedRun
from boat_daq.engine.snapshot import Progress, Reading, ReadingRequest, SessionSnapshot, SessionState
from boat_daq.formatting import count, in_units, number, stored_number, target
from boat_daq.viewmodels.common.services import Change, UndoHistory
from boat_daq.viewmodels.live.sequence import BRANCH_WORDS
from protocol.base.errors import RequestError
from protocol.base.units import NOTHING, STORED_UNITS, ShownUnits, as_text
from protocol.recording import RunEnd

PLAUSIBLE_MM = 60.0  # longer than the actuator itself
APART_KPA = 5.0  # plateaus further apart than this do not have one elongation
SOON_S = 60.0  # a wait for a reading that ends within this is marked
NOW = "now"  # remark of the plateau that waits
UNSTEADY = "unsteady"  # reached, but still drifting at the end of the longest hold
REMARKS = {  # status of a plateau -> remark, sentence
    "timeout": ("not reached", "the pressure was not reached in time"),
    "aborted": ("interrupted", "the step was interrupted; its cycle is left out"),
    UNSTEADY: ("not steady", "pressure or signal still drifted at the end of the longest hold"),
}


@dataclass(frozen=True, slots=True)
class Row:
    """One plateau of the table."""

    step: StepMark
    reading: Reading | None  # None where it was not read, or withdrawn
    current: bool
    apart_mm: float | None  # distance from the running fit, of an outlier
    far: str = ""  # the model's elongation, where the reading is far from it
    typed: str = ""  # text that was typed for it, but not entered
    units: ShownUnits = STORED_UNITS

    @property
    def elongation_mm(self) -> float | None:
        return self.reading.elongation_mm if self.reading is not None else None

    @property
    def _remark(self) -> tuple[str, str]:
        status = self.step.status if self.step.detail.get("steady", True) else UNSTEADY
        if self.typed:
            return f"{self.typed}: not entered", f"{self.typed} was typed, but not entered"
        if self.reading is None and self.step.detail.get("reading_timed_out"):
            return "no reading", "no reading was given in time, and the run continued"
        return REMARKS.get(status, (NOW if self.current else "", ""))

    @property
    def _far(self) -> str:
        """Return the model's elongation without its band, which the tooltip has."""
        nominal, _, _ = self.far.partition(" \u00b1")
        return f"{nominal}?" if nominal else ""

    @property
    def tip(self) -> str:
        """Return the remark as a sentence with plateau, cycle and value, and the source of the reading."""
        plateau, ended = place(self.step, self.units), self._remark[1]
        lines = [f"{ended}: {plateau}"] if ended else []
        if self.apart_mm is not None and self.elongation_mm is not None:
            read, fit = (self._length(mm, 2) for mm in (self.elongation_mm, self.elongation_mm - self.apart_mm))
            lines.append(f"{read} at {plateau}, the other readings give {fit}: check it; it is kept as it is")
        elif self.far and self.elongation_mm is not None:
            read = self._length(self.elongation_mm, 2)
            lines.append(f"{read} at {plateau}, {self.far}: check it; it is kept as it is")
        source = self.reading.source if self.reading is not None else ""
        return "\n".join([*lines, *([f"source: {source}"] if source else [])])

    def _length(self, mm: float, decimals: int) -> str:
        return in_units(self.units, "mm", mm, decimals)

    @property
    def cells(self) -> tuple[str, ...]:
        """Return the row as text: cycle, branch, pressure, elongation, remark."""
        mm = self.units.shown("mm")
        apart = self._length(self.apart_mm or 0.0, 1).partition(" ")[0]  # the unit is in the heading beside it
        return (
            str(self.step.cycle) if self.step.cycle else NOTHING,
            BRANCH_WORDS[self.step.branch].partition(" ")[0],
            target(self.step.target_kpa, self.units).rpartition(" ")[0],
            "" if self.elongation_mm is None else number(mm.value(self.elongation_mm), mm.decimals(2)),
            self._remark[0] or self._far if self.apart_mm is None else f"{apart}?",
        )


TABLE_COLUMNS = 5


def place(at: StepMark | ReadingRequest | Progress, units: ShownUnits = STORED_UNITS) -> str:
    """Return a plateau as text, e.g. `+30 kPa, unloading, cycle 2`."""
    where = f"{BRANCH_WORDS[at.branch]}, cycle {at.cycle}" if at.cycle else "first plateau"
    return f"{target(at.target_kpa, units)}, {where}"


def readable(steps: tuple[StepMark, ...]) -> tuple[StepMark, ...]:
    """Return the plateaus that are read: all steps but those passed and the last, which vents."""
    return tuple(step for step in steps if step.branch != "end" and not step.passed)


class ReadingStore(Protocol):
    """Storage of the readings: the session of the current run, or a closed recording."""

    def steps(self) -> tuple[StepMark, ...]:
        """Return the plateaus so far."""

    def readings(self) -> tuple[Reading, ...]:
        """Return all readings, in order of entry."""

    def add_reading(
        self, step_id: int, elongation_mm: float | None, source: str, *, resolution_mm: float | None
    ) -> object:
        """Store a reading; a second one for a plateau corrects the first."""


class ReadingsModel:
    """The table of readings and the reading that is due.

    Parameters
    ----------
    nominal : returns the elongation of the nominal actuator at a pressure and half of its band, mm; None while it is
        not known.

    Attributes
    ----------
    typed : text by the plateau that it was typed for, where it was not entered.
    """

    def __init__(
        self,
        session: ReadingStore,
        undo: UndoHistory,
        nominal: Callable[[float], tuple[float, float] | None] = lambda kpa: None,
    ) -> None:
        self.session = session
        self._undo, self._nominal = undo, nominal
        self.resolution_mm = 0.5
        self.units = STORED_UNITS  # in which elongations are typed and shown
        self.typed: dict[int, str] = {}
        self._bands: dict[float, tuple[float, float]] = {}

    @classmethod
    def of_closed(cls, path: Path, undo: UndoHistory) -> ReadingsModel:
        return cls(ClosedRun(path), undo)

    def question(self, snapshot: SessionSnapshot) -> str:
        """Return the reading that is due, or the next one of this run; empty without a run."""
        waiting, progress = snapshot.waiting_for_reading, snapshot.progress
        if waiting is not None:
            return f"At {place(waiting, self.units)}"
        if snapshot.state is SessionState.RUNNING and progress is not None:
            return f"Next: {place(progress, self.units)}"
        return "No reading while paused" if snapshot.state is SessionState.PAUSED else ""

    def taken(self) -> str:
        """Return the reading of the last plateau that has one, e.g. `+2.50 taken`; empty without."""
        latest = self.latest()
        read = [mm for step in self.session.steps() if (mm := _mm(latest.get(step.number))) is not None]
        return f"{self.text(read[-1]).rpartition(' ')[0]} taken" if read else ""

    def text(self, mm: float) -> str:
        return in_units(self.units, "mm", mm, 2)

    @property
    def unit(self) -> str:
        """Return the unit in which elongations are typed."""
        return as_text(self.units.shown("mm").symbol)

    @property
    def headings(self) -> tuple[str, ...]:
        return ("Cycle", "Branch", as_text(self.units.shown("kPa").symbol), self.unit, "State")

    def latest(self) -> dict[int, Reading]:
        return {reading.step_id: reading for reading in self.session.readings()}

    def rows(self, snapshot: SessionSnapshot) -> list[Row]:
        readings = {key: r for key, r in self.latest().items() if r.elongation_mm is not None}
        steps = readable(self.session.steps())
        read = [(step, mm) for step in steps if (mm := _mm(readings.get(step.number))) is not None]
        apart = {step.number: mm for (step, _), mm in zip(read, _outlying(read), strict=True) if mm == mm}
        far = {step.number: self._beyond_nominal(step.target_kpa, mm) for step, mm in read}
        waiting = snapshot.waiting_for_reading
        due, typed, units = waiting.step_id if waiting is not None else None, self.typed, self.units
        return [
            Row(step, readings.get(n := step.number), n == due, apart.get(n), far.get(n, ""), typed.get(n, ""), units)
            for step in steps
        ]

    def warning(self, step_id: int, text: str) -> str:
        """Return why a typed elongation is far from what pressure and model allow; empty where it is not."""
        try:
            return self.doubt(step_id, parse_mm(text, self.units))
        except RequestError:
            return ""

    def doubt(self, step_id: int, mm: float) -> str:
        """Return why an elongation is far from what pressure and model allow; empty where it is not."""
        steps = {step.number: step for step in readable(self.session.steps())}
        if step_id not in steps:
            return ""
        step, latest = steps.pop(step_id), self.latest()
        read = [(other, x) for other in steps.values() if (x := _mm(latest.get(other.number))) is not None]
        before = [(other, x) for other, x in read if other.number < step_id][-1:]
        apart_mm = _outlying([*read, (step, mm)])[-1]
        far = sum(bool(self._beyond_nominal(other.target_kpa, x)) for other, x in read)
        fits = 2 * far <= len(read)  # else the unit is not the model's
        why = self._beyond_nominal(step.target_kpa, mm) if fits else ""
        if apart_mm == apart_mm:
            why = f"other readings give {self.text(mm - apart_mm)}"
        elif not why and any(x == mm and abs(o.target_kpa - step.target_kpa) > APART_KPA for o, x in before):
            why = f"the same as at {target(before[0][0].target_kpa, self.units)}"
        return why[:1].upper() + why[1:]

    def _beyond_nominal(self, target_kpa: float, mm: float) -> str:
        """Return the model's elongation with its band where a reading is outside it; else, or while unknown, empty."""
        if target_kpa not in self._bands:
            found = self._nominal(target_kpa)
            if found is None or not all(map(math.isfinite, found)):
                return ""
            self._bands[target_kpa] = found
        nominal_mm, band_mm = self._bands[target_kpa]
        if abs(mm - nominal_mm) <= band_mm + self.resolution_mm:
            return ""
        return f"model {in_units(self.units, 'mm', nominal_mm, 1, band=band_mm)}"

    def leave(self, step_id: int, text: str) -> str:
        """Keep text with the plateau that it was typed for; return that plateau, empty where it has its reading."""
        step = next((step for step in self.session.steps() if step.number == step_id), None)
        if not text.strip() or step is None or _mm(self.latest().get(step_id)) is not None:
            return ""
        self.typed[step_id] = text.strip()
        return place(step, self.units)

    def summary(self, snapshot: SessionSnapshot, rows: list[Row] | None = None) -> str:
        """Return how many plateaus of the run were read, and how many outliers there are."""
        rows = self.rows(snapshot) if rows is None else rows
        read = sum(row.reading is not None for row in rows)
        far = sum(row.apart_mm is not None for row in rows)
        text = f"{read} of {count(self._expected(snapshot, rows), 'plateau')} read" if rows else ""
        return text + (f", {count(far, 'outlier')}" if far else "")

    def _expected(self, snapshot: SessionSnapshot, rows: list[Row]) -> int:
        """Return how many plateaus the run has: those so far, without interrupted ones, and those planned behind."""
        so_far = [row.step for row in rows if row.step.status != "aborted" or row.reading is not None]
        plan, ended = snapshot.plan, snapshot.run_ended
        steps = [step for step in self.session.steps() if step.branch != "end"]
        opened = [i for i, step in enumerate(steps) if step.branch == "start"]
        if plan is None or not opened or (ended is not None and ended.end is RunEnd.FINISHED):
            return len(so_far)
        earlier, now = steps[: opened[-1]], steps[opened[-1] :]
        before = sum(step.number < now[0].number for step in so_far)
        _, complete = resume_point(plan, earlier)
        passed = sum(step.passed for step in now)
        return max(len(so_far), before + 1 + (plan.cycles - complete) * len(plan.targets_kpa) - passed)

    def enter(self, step_id: int, text: str, source: str = "typed") -> None:
        """Enter the text typed for a plateau; an empty text withdraws its reading."""
        self.put(step_id, parse_mm(text, self.units) if text.strip() else None, source)

    def put(self, step_id: int, elongation_mm: float | None, source: str, resolution_mm: float | None = None) -> None:
        """Enter a reading, undoably.

        Parameters
        ----------
        elongation_mm : None withdraws the reading.
        source : "typed", "pasted", "photograph" or "simulated".
        resolution_mm : resolution of the reading; None for that of the grid.
        """
        before = self.latest().get(step_id)
        self.typed.pop(step_id, None)
        if (before.elongation_mm if before else None) != elongation_mm:
            step = next((step for step in self.session.steps() if step.number == step_id), None)
            at = f" at {place(step, self.units)}" if step is not None else ""
            what = f"reading {self.text(elongation_mm)}" if elongation_mm is not None else "withdrawal of the reading"
            self._push(f"{what}{at}", {step_id: elongation_mm}, source, resolution_mm)

    def _push(
        self, text: str, values: dict[int, float | None], source: str, resolution_mm: float | None = None
    ) -> None:
        """Store `values` by plateau; undo stores the readings before again, or withdraws."""
        latest, withdrawn = self.latest(), (None, source if source == "pasted" else "typed", None)
        old = {n: (r.elongation_mm, r.source, None) if (r := latest.get(n)) else withdrawn for n in values}

        def store(entries: Mapping[int, tuple[float | None, str, float | None]]) -> None:
            for n, (mm, origin, resolution) in entries.items():
                self.session.add_reading(n, mm, origin, resolution_mm=resolution or self.resolution_mm)

        new = {n: (mm, source, resolution_mm) for n, mm in values.items()}
        self._undo.push(Change(text, partial(store, new), partial(store, old)))

    def paste(self, text: str, first_step_id: int | None = None) -> int:
        """Enter a column copied from a spreadsheet, beginning at a plateau; return how many were entered.

        Without a plateau, a column of all plateaus begins at the first, a shorter one at the first without a reading.
        Of several columns the last is taken. All values are checked before any is stored.
        """
        values = column_of_lengths(text, self.units)
        first = self._first_for(len(values)) if first_step_id is None else first_step_id
        numbers = [step.number for step in readable(self.session.steps()) if step.number >= first]
        if len(values) > len(numbers):
            cause = f"{len(values)} values were pasted for {count(len(numbers), 'plateau')}"
            raise RequestError(cause, "Select the plateau of the first value, then paste again.")
        if not values:
            raise RequestError("the clipboard holds no values", f"Copy a column of elongations in {self.unit} first.")
        entered: dict[int, float | None] = dict(zip(numbers, values, strict=False))
        self._push(f"paste of {len(values)} readings", entered, "pasted")
        return len(values)

    def _first_for(self, values: int) -> float:
        """Return the plateau at which a column of `values` values begins where none is selected."""
        steps, read = [step.number for step in readable(self.session.steps())], self.latest()
        if values == len(steps):
            return 0
        unread = (n for n in steps if n not in read or read[n].elongation_mm is None)
        return next(unread, float("inf"))


def _mm(reading: Reading | None) -> float | None:
    """Return the elongation of a reading, None where it is missing or withdrawn."""
    return reading.elongation_mm if reading is not None else None


def _outlying(read: Sequence[tuple[StepMark, float]]) -> list[float]:
    """Return the distance of each (plateau, mm) from the running fit where it is an outlier, else NaN."""
    far = outlying(
        np.array([step.target_kpa for step, _ in read]),
        np.array([step.branch == "loading" for step, _ in read], dtype=bool),
        np.array([mm for _, mm in read], dtype=float),
    )
    return list(far.tolist())


def parse_mm(text: str, units: ShownUnits = STORED_UNITS) -> float:
    """Return a typed elongation, mm."""
    unit = as_text(units.shown("mm").symbol)
    try:
        value = stored_number(text, units, "mm")
    except ValueError:
        remedy = f"Type a number in {unit}, such as 2.31 or \u22120.5."
        raise RequestError(f"{text.strip()!r} is not a length", remedy) from None
    if abs(value) > PLAUSIBLE_MM:
        cause = f"{in_units(units, 'mm', value, 2)} is longer than the actuator"
        raise RequestError(cause, f"Type a number in {unit}, positive when longer.")
    return value


def column_of_lengths(text: str, units: ShownUnits = STORED_UNITS) -> list[float]:
    """Return the last column of text in mm, without a heading row."""
    lines = [line for line in text.replace("\r\n", "\n").split("\n") if line.strip() and not line.startswith("#")]
    separator = next((mark for mark in ("\t", ";") if any(mark in line for line in lines)), None)
    if separator is None and all(line.count(",") >= 1 and "." in line for line in lines[1:]):
        separator = ","
    rows = list(csv.reader(io.StringIO("\n".join(lines)), delimiter=separator)) if separator else [[x] for x in lines]
    values = []
    for i, cells in enumerate(rows):
        try:
            values.append(parse_mm(cells[-1], units))
        except RequestError as error:
            if i == 0:
                continue  # a heading
            raise RequestError(f"line {i + 1}: {error.cause}", error.remedy) from None
    return values
