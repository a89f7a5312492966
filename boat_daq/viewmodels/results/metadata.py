"""The form of the metadata of a recording, or of the next recordings of a unit.

Rules: `protocol.recording.Metadata` alone refuses a value. An entry is added to the file and remembered for its unit;
undo adds a newer one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path

from boat_daq.engine.recording.metadata_entry import (
    read_metadata,
    remember,
    remembered,
    state_metadata,
)
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import UnitLibrary
from boat_daq.viewmodels.common.services import Change, UndoHistory
from protocol.recording import Metadata
from protocol.recording.metadata import OF_A_UNIT

FIELDS = (
    ("operator", "Operator"),
    ("customer", "Customer"),
    ("item", "Item"),
    ("serial_number", "Serial number"),
    ("ambient_temperature_c", "Temperature, °C"),
    ("ambient_humidity_percent", "Relative humidity, %"),
    ("note", "Note"),
)
"""Key and label of each field, in the order of the form."""
_ALL = tuple(key for key, _ in FIELDS)


class MetadataModel:
    """State of the form of `subject`, a recording or unit."""

    def __init__(
        self,
        subject: str,
        read: Callable[[], Metadata],
        write: Callable[[Metadata], None],
        undo: UndoHistory,
        keys: tuple[str, ...] = _ALL,
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        self.subject, self.keys = subject, keys
        self._read, self._write, self._undo, self._changed = read, write, undo, changed

    @classmethod
    def of_recording(
        cls, path: Path, units: UnitLibrary, unit: str, undo: UndoHistory, changed: Callable[[], None] = lambda: None
    ) -> MetadataModel:

        def write(stated: Metadata) -> None:
            state_metadata(path, stated)
            remember(units, unit, stated)

        return cls(path.name, partial(read_metadata, path), write, undo, changed=changed)

    @classmethod
    def of_session(
        cls, session: Session, path: Path, units: UnitLibrary, unit: str, undo: UndoHistory
    ) -> MetadataModel:
        """Return the form of a session's recording, in progress or closed since; its unit remembers the entries."""

        def write(stated: Metadata) -> None:
            session.recording.state(path, stated)
            remember(units, unit, stated)

        return cls(path.name, partial(session.recording.metadata, path), write, undo)

    @classmethod
    def of_unit(cls, units: UnitLibrary, unit: str, undo: UndoHistory) -> MetadataModel:
        """Return the form of what the next recordings of a unit state."""
        return cls(unit, partial(remembered, units, unit), partial(remember, units, unit), undo, OF_A_UNIT)

    def stated(self) -> Metadata:
        return self._read()

    def texts(self, stated: Metadata) -> dict[str, str]:
        values = asdict(stated)
        return {key: "" if values[key] is None else _text(values[key]) for key in self.keys}

    def state(self, typed: Mapping[str, str], lines: str | None = None) -> Metadata:
        """Add what was typed and free lines `name = value` (None leaves them), undoably; return the metadata then."""
        before = self.stated()
        free = {} if lines is None else dict.fromkeys(before.fields, "") | free_fields(lines)
        after = before.changed({**free, **typed})
        if after != before:
            redo, undo = partial(self._store, after), partial(self._store, before)
            self._undo.push(Change(f"the metadata of {self.subject}", redo, undo))
        return after

    def _store(self, stated: Metadata) -> None:
        self._write(stated)
        self._changed()


def free_fields(lines: str) -> dict[str, str]:
    """Return the free fields of `name = value` lines; a line without a sign has an empty value, and is left out."""
    pairs = (line.partition("=") for line in lines.splitlines())
    return {name.strip(): value.strip() for name, _, value in pairs if name.strip()}


def free_lines(stated: Metadata) -> str:
    """Return the free fields as `name = value` lines."""
    return "\n".join(f"{name} = {text}" for name, text in stated.fields.items())


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
