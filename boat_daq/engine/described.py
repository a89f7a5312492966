"""Descriptions of stored values: forms, commands, documents and the check of a file are made from them.

A field of a dataclass is described where it is declared (`stated`): label, meaning, unit, range, and when a new value
takes effect. What is typed becomes a value here, and what changed when is kept beside the values in their file.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import StrEnum
from itertools import accumulate
from typing import Any, TypeVar

from boat_daq.engine.toml_values import BadValue, build
from protocol.base.errors import one_of
from protocol.base.units import MINUS

D = TypeVar("D")  # a dataclass

CHANGES = "changes"  # key of their list in a file
MOST_CHANGES = 500  # in one file: the newest, and no more letters than
MOST_LETTERS = 100_000
LONGEST = 20_000  # letters of a text
_KEY = "described"
_BOOLS = {"on": True, "true": True, "yes": True, "1": True, "off": False, "false": False, "no": False, "0": False}


class Applies(StrEnum):
    """When a new value takes effect."""

    NOW = "at once"
    CONNECTION = "at the next connection"
    RECORDING = "with the next recording"
    START = "at the next start"


@dataclass(frozen=True, slots=True)
class Described:
    """A value that the operator can set."""

    key: str  # in the file
    label: str  # in a form
    meaning: str
    default: int | float | bool | str
    unit: str = ""
    lowest: float = -math.inf  # of a number
    highest: float = math.inf
    above: bool = False
    choices: tuple[tuple[int | str, str], ...] = ()  # values and their texts, where there are no others
    applies: Applies = Applies.CONNECTION  # when a new value takes effect

    @property
    def range_text(self) -> str:
        """Return what the value may be, such as "1 to 65535 Hz"; empty for any text."""
        unit = f" {self.unit}" if self.unit else ""
        if self.choices:
            return " or ".join(f"{value} ({text})" for value, text in self.choices)
        if isinstance(self.default, bool):
            return "on or off"
        if isinstance(self.default, str):
            return ""
        if self.above:
            return f"above {self.lowest:g} and at most {self.highest:g}{unit}"
        return f"{_number(self.lowest)} to {_number(self.highest)}{unit}"

    def check(self, value: object, where: str) -> None:
        """Refuse a value outside its range. BadValue: names the key."""
        if self.choices:
            good = any(value == choice for choice, _ in self.choices)
        elif isinstance(value, int | float) and not isinstance(value, bool):
            good = (self.lowest < value if self.above else self.lowest <= value) and value <= self.highest
        else:
            good = True
        if not good:
            raise BadValue(where, self.key, f"must be {self.range_text}, not {value}")
        if isinstance(value, str) and len(value) > LONGEST:
            raise BadValue(where, self.key, f"must have at most {LONGEST} letters, not {len(value)}")

    def value_of(self, text: str, where: str) -> int | float | bool | str:
        """Return the value that was typed. BadValue: names the key."""
        text = text.strip()
        if isinstance(self.default, str):
            return text
        if isinstance(self.default, bool):
            if text.lower() not in _BOOLS:
                raise BadValue(where, self.key, f"must be on or off, not {text!r:.40}")
            return _BOOLS[text.lower()]
        try:
            number = float(text.replace(",", ".").replace(MINUS, "-"))
        except ValueError:
            number = math.nan
        if not math.isfinite(number) or (isinstance(self.default, int) and number != int(number)):
            kind = "a whole number" if isinstance(self.default, int) else "a number"
            raise BadValue(where, self.key, f"must be {kind}, {self.range_text}, not {text!r:.40}")
        return int(number) if isinstance(self.default, int) else number


def stated(default: Any, label: str, meaning: str, unit: str = "", **more: Any) -> Any:
    """Return a described field of a dataclass. `default`, `label`, `meaning`, `unit`: as in `Described`."""
    described = Described("", label, meaning, default, unit, **more)
    return dataclasses.field(default=default, metadata={_KEY: described})


def described(cls: Any) -> dict[str, Described]:
    """Return the descriptions of a dataclass's fields by key, in their order."""
    found = ((f.name, f.metadata.get(_KEY)) for f in dataclasses.fields(cls))
    return {key: dataclasses.replace(about, key=key) for key, about in found if about is not None}


def check_ranges(values: object, where: str) -> None:
    """Refuse a value outside its described range. BadValue: the first one; names its key."""
    for key, about in described(values).items():
        about.check(getattr(values, key), where)


def with_typed(values: D, typed: Mapping[str, str], where: str) -> D:
    """Return the dataclass with values that were typed, by key."""
    known = described(values)
    for key in typed:
        if key not in known:
            raise BadValue(where, key, "is not a known key", one_of(key, known))
    new = {key: known[key].value_of(text, where) for key, text in typed.items()}
    return dataclasses.replace(values, **new)  # type: ignore[type-var]


def with_defaults(values: D, keys: Iterable[str], where: str) -> D:
    """Return the dataclass with the defaults of some keys; of all where none is given. BadValue: an unknown key."""
    known = described(values)
    typed = {key: text_of(known[key].default) if key in known else "" for key in list(keys) or known}
    return with_typed(values, typed, where)


def text_of(value: object) -> str:
    """Return a value as text that `Described.value_of` reads; a table as its keys and values."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, Mapping):
        return ", ".join(f"{key} = {text_of(inner)}" for key, inner in value.items())
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def texts_of(values: object) -> dict[str, str]:
    """Return the texts of a dataclass's described values, by key."""
    return {key: text_of(getattr(values, key)) for key in described(values)}


def _number(value: float) -> str:
    return f"{value:.0f}" if value == round(value) else f"{value:g}"


@dataclass(frozen=True, slots=True)
class StoredChange:
    """A value that was changed: when, its key, and its texts before and after."""

    utc: str
    key: str
    before: str
    after: str


def take_changes(table: dict[str, Any], where: str) -> tuple[StoredChange, ...]:
    """Take the changes out of a file's table, oldest first. BadValue: they are no list of changes."""
    rows = table.pop(CHANGES, [])
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise BadValue(where, CHANGES, "must be a list of tables")
    return tuple(build(StoredChange, row, f"{where}, {CHANGES}") for row in rows)


def with_changes(
    stored: tuple[StoredChange, ...], before: Mapping[str, str], after: Mapping[str, str]
) -> list[dict[str, str]]:
    """Return the changes to store in a file: those it has, and what differs now."""
    utc = datetime.now(UTC).isoformat(timespec="milliseconds")  # also the name of one step, for undo
    pairs = ((key, before.get(key, ""), after.get(key, "")) for key in dict.fromkeys((*before, *after)))
    new = [StoredChange(utc, key, old, text) for key, old, text in pairs if old != text]
    rows = [dataclasses.asdict(change) for change in (*stored, *new)][-MOST_CHANGES:]
    letters = accumulate(sum(map(len, row.values())) for row in reversed(rows))
    return rows[len(rows) - sum(total <= MOST_LETTERS for total in letters) :]
