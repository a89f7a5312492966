"""The Settings page without Qt: what is stored of the program and of each unit, and what changed when.

Rules: rows, ranges and meanings come from the descriptions of the stored fields. A value is stored as it is entered and
is one step of the window's history. A settings file that is refused leaves the defaults in use (safe mode) until other
settings are stored; the file is kept.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from boat_daq.engine.described import (
    Applies,
    Described,
    StoredChange,
    described,
    text_of,
    texts_of,
    with_defaults,
    with_typed,
)
from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import (
    Settings,
    Unit,
    UnitLibrary,
    load_settings,
    read_settings,
    read_unit,
    recordings_folder,
    save_settings,
    settings_path,
    settings_text,
    stored_settings,
)
from boat_daq.engine.toml_values import read_text
from boat_daq.formatting import count, typographic
from boat_daq.viewmodels.common.services import Change, UndoHistory
from boat_daq.viewmodels.results.metadata import MetadataModel
from protocol.base.errors import RequestError
from protocol.base.units import NOTHING
from protocol.base.whole_file import write_whole

PROGRAM = ""  # in place of the name of a unit
CALIBRATION_CHANGED = "Calibration"  # in place of a key, for what changed


@dataclass(frozen=True, slots=True)
class StoredValues:
    """What the page shows: texts by key, what changed when, newest first, and a unit's calibrations."""

    texts: Mapping[str, str]
    changes: tuple[StoredChange, ...]
    calibrations: str = ""


def in_force(about: Described) -> str:
    """Return what an empty field of the program stands for; empty where it stands for nothing."""
    known = {
        "recordings": str(recordings_folder(Settings())).replace(str(Path.home()), "~"),
        "file_name": "date-time_unit",
        "operator": "not stated",
        "unit": "SA1",
        "port": "none",
        "profile": "none: a BOAT board",
    }
    return known.get(about.key, "")


class SettingsModel:
    """State of the page; a subject is the program or the name of a unit."""

    def __init__(self, session: Session, units: UnitLibrary, folder: Path, undo: UndoHistory) -> None:
        self._session, self._units, self._folder, self._undo = session, units, folder, undo
        self.refused: RequestError | None = None  # why the settings file was not used
        self.revision = 0  # grows with every change from this page

    def subjects(self, in_use: str) -> list[tuple[str, str]]:
        """Return (text, subject): the program, the stored units, and the unit in use, which may not be stored yet."""
        names = sorted({*self._units.names(), *([in_use] if in_use else [])})
        return [("This program", PROGRAM), *((f"Unit {name}", name) for name in names)]

    def stored(self, subject: str) -> Settings | Unit:
        if subject != PROGRAM:
            return self._units.load(subject)
        return Settings() if self.refused is not None else load_settings(self._folder)

    def shown(self, subject: str) -> StoredValues:
        """Return what the page shows of a subject; its file is read once."""
        if subject == PROGRAM:
            settings, changes = (Settings(), ()) if self.refused is not None else stored_settings(self._folder)
            return StoredValues(texts_of(settings), changes[::-1])
        unit = self._units.load(subject)
        calibrations = (
            StoredChange(
                entry.utc, CALIBRATION_CHANGED, "", entry.recording or "accepted" if entry.accepted else "withdrawn"
            )
            for entry in unit.history
        )
        changes = tuple(sorted((*unit.changes, *calibrations), key=lambda change: change.utc))[::-1]
        simulated = self._units.of(simulated=True).load(subject)
        lines = (f"Real unit: {_calibrations(unit)}", f"Simulated unit: {_calibrations(simulated)}")
        return StoredValues(texts_of(unit), changes, "\n".join(lines))

    def stamp(self, subject: str) -> int:
        """Return a number that changes with the file of a subject; 0 without a file."""
        try:
            return self.file(subject).stat().st_mtime_ns
        except OSError:
            return 0

    def file(self, subject: str) -> Path:
        return settings_path(self._folder) if subject == PROGRAM else self._units.folder / f"{subject}.toml"

    def metadata(self, unit: str) -> MetadataModel:
        """Return the form of what the unit's next recordings state."""
        return MetadataModel.of_unit(self._units, unit, self._undo)

    def enter(self, subject: str, typed: Mapping[str, str]) -> None:
        """Store values that were typed, undoably; nothing where they are those that are stored."""
        before = self.stored(subject)
        self._change(subject, before, with_typed(before, typed, _where(subject)))

    def reset(self, subject: str, *keys: str) -> None:
        """Store the defaults of some values, of all where none is named, undoably."""
        before = self.stored(subject)
        self._change(subject, before, with_defaults(before, keys, _where(subject)))

    def add_unit(self, name: str) -> None:
        if name in self._units.names():
            raise RequestError(f"there is a unit {name} already", "Choose another name.")
        self._units.save(Unit(name))
        self._grown()

    def export(self, subject: str, path: Path) -> None:
        """Write the values of a subject to a file; OSError where it cannot be written."""
        text = settings_text(load_settings(self._folder)) if subject == PROGRAM else self._units.text(subject)
        write_whole(path, text)

    def import_(self, path: Path) -> str:
        """Take settings or a unit from a file; return the subject. Values of a stored subject are undone by undo."""
        text = read_text(path)
        if _is_unit(text):
            found = read_unit(path)
            if found.name in self._units.names():
                before = self._units.load(found.name)
                stored = _with_values(found, before)  # calibrations, metadata and contributions
                self._session.unit_under_test.store(stored)
                self._change(found.name, stored, found)
            else:
                self._session.unit_under_test.store(found)
            self._grown()
            return found.name
        self._change(PROGRAM, self.stored(PROGRAM), read_settings(text, path.name)[0])
        return PROGRAM

    def _change(self, subject: str, before: Any, after: Any) -> None:
        """Store the values of `after`, and those of `before` again where that is undone."""
        new, old = _texts(before, after), _texts(after, before)
        if not new and self.refused is None:
            return
        known, of_unit = described(type(after)), f" of unit {subject}" if subject != PROGRAM else ""
        values = "; ".join(f"{known[key].label} {value or NOTHING}" for key, value in list(new.items())[:2])
        text = (values or "the settings") + (f" and {len(new) - 2} more" if len(new) > 2 else "") + of_unit
        self._undo.push(Change(text, partial(self._store, subject, new), partial(self._store, subject, old)))

    def _store(self, subject: str, typed: Mapping[str, str]) -> None:
        after = with_typed(self.stored(subject), typed, _where(subject))
        if isinstance(after, Unit):
            self._session.unit_under_test.store(after)
        else:
            save_settings(after, self._folder)
            self.refused = None
            used = {key: getattr(after, key) for key in typed}
            self._session.settings = dataclasses.replace(self._session.settings, **used)
        self._grown()

    def _grown(self) -> None:
        self.revision += 1


def refusal(about: Described, text: str) -> str:
    """Return why a typed value is refused; empty where it is not."""
    try:
        about.check(about.value_of(text, ""), "")
    except RequestError as error:
        return typographic(f"It {getattr(error, 'why', error.cause)}.")
    return ""


def note(about: Described) -> str:
    text = next((text for value, text in about.choices if value == about.default), text_of(about.default))
    shown = "" if about.choices or isinstance(about.default, bool) else about.range_text
    effect = f"applies {about.applies}" if about.applies is not Applies.NOW else ""
    parts = "; ".join(filter(None, (shown, f"default {text}" if text else "", effect)))
    return typographic(f"{parts[:1].upper()}{parts[1:]}.") if parts else ""


def _where(subject: str) -> str:
    return "settings" if subject == PROGRAM else f"unit {subject}"


def _is_unit(text: str) -> bool:
    return any(line.partition("=")[0].strip() == "min_kpa" for line in text.splitlines())


def _texts(before: Any, after: Any) -> dict[str, str]:
    """Return the texts of the values that differ, as they are after."""
    old = texts_of(before)
    return {key: text for key, text in texts_of(after).items() if text != old[key]}


def _with_values(unit: Unit, other: Unit) -> Unit:
    return dataclasses.replace(unit, **{key: getattr(other, key) for key in described(other)})


def _calibrations(unit: Unit) -> str:
    """Return how many calibrations a unit has, and which is in force."""
    date = f"in force since {unit.calibration.utc[:10]}" if unit.calibration is not None else "none in force"
    return f"{count(len(unit.history), 'calibration')}, {date}"
