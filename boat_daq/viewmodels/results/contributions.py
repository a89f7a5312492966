"""The form of a unit's type B contributions: what grid, parallax, gauge and temperature add to an uncertainty.

Rules: `analysis.calibration.type_b` alone reads and refuses the tables of the unit's file; the form turns texts into
such a table and back. A contribution that is not entered is not assessed; zero is an entry.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from analysis.calibration.type_b import (
    EXPECTED,
    ContributionError,
    Distribution,
    Traceability,
    TypeBContribution,
    contributions,
    traceability,
)
from boat_daq.engine.settings import UnitLibrary
from boat_daq.formatting import plain_number
from boat_daq.viewmodels.common.services import Change, UndoHistory
from protocol.base.errors import RequestError

NOT_ASSESSED = "not assessed"
STATED = (("Half width", "half_width"), ("Expanded uncertainty", "expanded"), ("Standard uncertainty", "u"))
MEASURES = (("mm", "mm"), ("% of elongation", "percent"), ("kPa", "kpa"), ("K", "k"))
DISTRIBUTIONS = tuple((str(one).capitalize(), str(one)) for one in Distribution)
OF_PRESSURE_OR_TEMPERATURE = ("kpa", "k")
REMEDIES = {
    "distribution": "A normal distribution has no half width: state the expanded or standard uncertainty.",
    "k": "Give a number above 0.",
}
"""Key of a table -> what to enter in the form, where the library's remedy names keys of the file."""


@dataclass(frozen=True, slots=True)
class ContributionFields:
    """One contribution as the form shows it: names of choices, and texts as they are typed."""

    stated: str = "half_width"
    value: str = ""
    unit: str = "mm"
    distribution: str = "rectangular"
    k: str = "2"
    sensitivity: str = ""
    dof: str = ""
    certificate: str = ""
    source: str = ""

    @classmethod
    def of(cls, table: Mapping[str, Any]) -> ContributionFields:
        """Return the fields of a table that the library accepts."""
        key = next(key for key in table if key.partition("_")[0] in ("half", "expanded", "u"))
        stated, _, unit = key.rpartition("_")
        texts = {name: _text(table[name]) for name in ("k", "dof", "certificate", "source") if name in table}
        sensitivity = _text(table.get(f"sensitivity_mm_per_{unit}", ""))
        distribution = str(table.get("distribution", "normal"))
        return cls(stated, _text(table[key]), unit, distribution, sensitivity=sensitivity, **texts)

    def table(self) -> dict[str, Any]:
        """Return the table of the file; a text that is no number stays one, for the library to refuse."""
        table: dict[str, Any] = {f"{self.stated}_{self.unit}": _number(self.value), "distribution": self.distribution}
        if self.stated == "expanded":
            table["k"] = _number(self.k)
        if self.unit in OF_PRESSURE_OR_TEMPERATURE:
            table[f"sensitivity_mm_per_{self.unit}"] = _number(self.sensitivity)
        if self.dof.strip():
            table["dof"] = _number(self.dof)
        return table | {key: text for key in ("certificate", "source") if (text := getattr(self, key).strip())}


PRESETS: Mapping[str, ContributionFields] = {
    "scale": ContributionFields("expanded", unit="percent", distribution="normal"),
    "parallax": ContributionFields(),
    "pressure_gauge": ContributionFields(unit="kpa"),
    "temperature": ContributionFields(unit="k", distribution="arcsine"),
    "reference_standard": ContributionFields("expanded", distribution="normal"),
}
"""The contributions that the form offers, each as it is usually stated."""


class Refusal(NamedTuple):
    """Why fields are not a contribution: the field, and what to enter there."""

    field: str
    text: str


class ContributionsModel:
    """State of the form."""

    def __init__(self, units: UnitLibrary, unit: str, undo: UndoHistory, changed: Callable[[], None]) -> None:
        self.units, self.unit, self._undo, self._changed = units, unit, undo, changed

    def tables(self) -> dict[str, Mapping[str, Any]]:
        """Return the tables of the unit's file, by name."""
        return dict(self.units.load(self.unit).type_b)

    def rows(self) -> list[tuple[str, str, str]]:
        """Return each contribution that is offered or stated: its key, its name, and its statement."""
        stated = {one.name: one for one in contributions(self.tables())}
        names = dict.fromkeys((*PRESETS, *stated))
        return [(n, label(n), stated[n].statement if n in stated else NOT_ASSESSED) for n in names]

    def fields(self, name: str) -> ContributionFields:
        """Return the fields of a contribution: as stated, else as it is usually stated."""
        table = self.tables().get(name)
        return PRESETS.get(name, ContributionFields()) if table is None else ContributionFields.of(table)

    def traceability(self) -> Traceability:
        """Return whether an elongation is traceable with what is stated, and why not."""
        return traceability(contributions(self.tables()))

    def check(self, name: str, fields: ContributionFields, *, new: bool = False) -> TypeBContribution | Refusal:
        """Return the contribution of the fields, or why there is none; a `new` one needs a new name."""
        if not key_of(name):
            return Refusal("name", "Give a name.")
        if new and key_of(name) in (*PRESETS, *self.tables()):
            return Refusal("name", "Choose it in the list, or give another name.")
        try:
            return contributions({key_of(name): fields.table()})[0]
        except ContributionError as error:
            key = error.key
            field = next((f.name for f in dataclasses.fields(fields) if key.startswith(f.name)), "value")
            return Refusal(field, REMEDIES.get(key, error.remedy))

    def state(self, name: str, fields: ContributionFields) -> None:
        """Store a contribution in the unit's file, undoably."""
        found = self.check(name, fields)
        if isinstance(found, Refusal):
            raise RequestError(f"the contribution {label(name)!r:.60} is not stated", found.text)
        tables = self.tables()
        if tables.get(found.name) != fields.table():
            self._change(tables, tables | {found.name: fields.table()}, found.label)

    def withdraw(self, name: str) -> None:
        """Remove a contribution from the unit's file, undoably: it is then not assessed."""
        tables = self.tables()
        if name in tables:
            self._change(tables, {key: table for key, table in tables.items() if key != name}, label(name))

    def _change(self, before: Mapping[str, Any], after: Mapping[str, Any], what: str) -> None:
        redo, undo = partial(self._store, after), partial(self._store, before)
        self._undo.push(Change(f"the contribution of {what}", redo, undo))

    def _store(self, tables: Mapping[str, Any]) -> None:
        self.units.save(dataclasses.replace(self.units.load(self.unit), type_b=tables))
        self._changed()


def traceability_text(found: Traceability | None) -> str:
    """Return whether an elongation is traceable, as a sentence with its mark; empty where it is not known."""
    mark = "\u25cf" if found is not None and found.traceable else "\u25b2"
    return f"{mark} An elongation is {found.text}." if found is not None else ""


def label(name: str) -> str:
    """Return the name of a contribution as a budget has it, with a capital."""
    text = EXPECTED.get(name, name.replace("_", " "))
    return text[:1].upper() + text[1:]


def key_of(name: str) -> str:
    """Return the key in a file of a name that was typed."""
    return "_".join(name.lower().split())


def _number(text: str) -> float | str:
    try:
        return plain_number(text)
    except ValueError:
        return text.strip()


def _text(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)
