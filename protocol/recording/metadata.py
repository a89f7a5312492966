"""Metadata of a recording: operator, customer, item, note, ambient conditions, and free fields.

They are stored with the session; a later entry is a new event. The newest counts, older ones stay.
"""

from __future__ import annotations

import difflib
import json
import math
import sqlite3
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from protocol.base.errors import ChoiceError, RecordingError
from protocol.recording.checks import FOREIGN
from protocol.recording.schema import note_of

METADATA_EVENT = "metadata"  # `event.kind` of metadata, as JSON; the newest counts
MOST = 20_000  # letters of one text
_TEXTS = ("operator", "customer", "item", "serial_number", "note")
RANGES = {"ambient_temperature_c": (-90.0, 200.0), "ambient_humidity_percent": (0.0, 100.0)}
OF_A_UNIT = ("operator", "customer", "item", "serial_number")
"""The keys that stay the same from recording to recording of a unit; its free fields do, too."""


@dataclass(frozen=True, slots=True)
class Metadata:
    """Metadata of a recording; an empty text and None are not stated."""

    operator: str = ""
    customer: str = ""
    item: str = ""
    serial_number: str = ""
    note: str = ""
    ambient_temperature_c: float | None = None
    ambient_humidity_percent: float | None = None
    fields: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, values: Mapping[str, Any], most: float = math.inf) -> Metadata:
        """Return the metadata in values; other keys are left out. ValueError: names a value of another type or range.

        `most` limits a text to be stored, in characters; a recording with a longer note opens all the same.
        """
        texts: dict[str, Any] = {key: values.get(key) or "" for key in _TEXTS}
        numbers: dict[str, Any] = {key: values.get(key) for key in RANGES}
        fields = values.get("fields") or {}
        for key, text in texts.items():
            if not isinstance(text, str) or len(text) > most:
                raise ValueError(f"{key} is not a text of at most {most:g} letters")
        for key, number in numbers.items():
            low, high = RANGES[key]
            usual = isinstance(number, int | float) and not isinstance(number, bool) and low <= number <= high
            if number is not None and not usual:
                raise ValueError(f"{key} is not a number from {low:g} to {high:g}")
        if not isinstance(fields, dict) or not all(isinstance(text, str) for text in (*fields, *fields.values())):
            raise ValueError("fields is not a table of texts")
        if sum(map(len, (*fields, *fields.values()))) > most:
            raise ValueError(f"fields is longer than {most:g} letters")
        return cls(**texts, **numbers, fields=dict(fields))

    def changed(self, values: Mapping[str, str]) -> Metadata:
        """Return the metadata with typed values by key; an empty one removes. RequestError: names the key."""
        known: dict[str, str | float | None] = {}
        fields = dict(self.fields)
        for key, text in values.items():
            if key in RANGES:
                known[key] = _number(key, text.strip())
            elif key in _TEXTS:
                known[key] = text.strip()
            elif meant := difflib.get_close_matches(key.strip().lower(), [*RANGES, *_TEXTS], 1, 0.8):
                remedy = f"write {meant[0]}={text.strip():.40}, or give your own field a less similar name"
                raise ChoiceError(f"{key.strip():.40} is not a known key: did you mean {meant[0]}?", remedy)
            elif key.strip():
                fields[key.strip()] = text.strip()
        stated = {key: text for key, text in fields.items() if text}
        try:
            return Metadata.of({**asdict(replace(self, fields=stated)), **known}, MOST)
        except ValueError as error:
            raise ChoiceError(str(error), "Correct the value.") from error

    def of_unit(self) -> Metadata:
        """Return what the next recording of the same unit states, too: neither its note nor its ambient conditions."""
        return Metadata(**{key: getattr(self, key) for key in OF_A_UNIT}, fields=self.fields)

    def lines(self) -> tuple[tuple[str, str], ...]:
        """Return label and text of what is stated, in the order of a form."""
        stated: Iterable[tuple[str, Any, str]] = (
            ("Operator", self.operator, ""),
            ("Customer", self.customer, ""),
            ("Item", self.item, ""),
            ("Serial no.", self.serial_number, ""),
            ("Ambient temperature", self.ambient_temperature_c, " °C"),
            ("Relative humidity", self.ambient_humidity_percent, " %"),
            *((name, text, "") for name, text in self.fields.items()),
            ("Note", self.note, ""),
        )
        return tuple(
            (label, f"{value:g}{unit}" if isinstance(value, float | int) else value)
            for label, value, unit in stated
            if value not in ("", None)
        )


def _number(key: str, text: str) -> float | None:
    if not text:
        return None
    try:
        number = float(text.replace(",", "."))
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise ChoiceError(f"{key} is {text!r:.40}, not a number", "Give a number without its unit.")
    return number


def metadata_of(connection: sqlite3.Connection, meta: Mapping[str, Any]) -> Metadata:
    """Return a recording's newest metadata, with its newest note. RecordingError: they are unusable."""
    sql = "SELECT text FROM event WHERE kind = ? AND source = 'user' ORDER BY id DESC LIMIT 1"
    added = connection.execute(sql, (METADATA_EVENT,)).fetchone()
    stated = meta.get("metadata") or {}
    try:
        stated = stated if added is None else json.loads(str(added[0]))
        operators = stated.get("operator"), meta.get("operator")  # that of the session counts before a remembered one
        operator = next(filter(None, operators if added is not None else operators[::-1]), "")
        return Metadata.of({**stated, "operator": operator, "note": note_of(connection, meta)})
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise RecordingError(f"the recording's metadata cannot be read: {error}", FOREIGN) from error
