"""Stored settings and the library of units, each a small TOML file.

Rules. A file is replaced whole (`stored_file`). An edited file with an error is refused by key (`toml_values`), and no
default silently replaces a limit. Files carry a version; a newer one than this program's is refused, so that an older
program never cuts it down. The folders are the system's own (platformdirs), or the one in the environment variable
BOAT_DAQ_HOME. What changed when is kept in each file, with the values.

A unit keeps its limits and every calibration that was ever stored with it. Calibrations are added, never changed: the
last accepted one is in force; a withdrawal is a newer entry that is not accepted.

Calibrations of simulated boards are a library of their own, in the folder `simulated` of the units: neither library
returns an entry of the other, because a virtual SA1 and the SA1 on the bench share nothing but the name. Files of
older versions hold both kinds; each entry belongs to the library that its content names. Limits are those of
`units/NAME.toml` in both, so that a limit set for a unit also holds while its plan is tried on a virtual board.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import platformdirs
import tomli_w

from boat_daq.engine.described import (
    CHANGES,
    Applies,
    StoredChange,
    check_ranges,
    stated,
    take_changes,
    text_of,
    texts_of,
    with_changes,
)
from boat_daq.engine.file_names import is_device_name, path_in
from boat_daq.engine.stored_file import BACKUP, read_stored, read_whole, write_stored
from boat_daq.engine.toml_values import BadValue, build, parse_toml, read_text
from protocol.base.errors import ChoiceError, RequestError, StorageError

_VERSION = 1
HOME_VARIABLE = "BOAT_DAQ_HOME"
_SIMULATED = "simulated"  # folder of the calibrations of simulated boards
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _.-]{0,39}")


@dataclass(frozen=True, slots=True)
class Settings:
    """What the operator can set, whatever the unit."""

    version: int = _VERSION
    rate_hz: int = stated(
        100, "Sampling rate", "Samples per second, requested from the board", "Hz", lowest=1, highest=65_535
    )
    baud: int = stated(115_200, "Baud rate", "Serial ports only; 8N1", "Bd", lowest=300, highest=12_000_000)
    zero_tolerance_kpa: float = stated(
        1.0,
        "Zero tolerance",
        "Largest pressure reading of a vented unit at which a run may start",
        "kPa",
        lowest=0.0,
        highest=10.0,
        above=True,
    )
    resolution_mm: float = stated(
        0.5,
        "Resolution of readings",
        "Smallest division of the grid that is read",
        "mm",
        lowest=0.0,
        highest=10.0,
        above=True,
        applies=Applies.NOW,
    )
    allow_remote: bool = stated(False, "Remote boards", "Allow boards on other computers; the link is not encrypted")
    recordings: str = stated(
        "",
        "Recordings folder",
        "Folder of the window's recordings; empty: boat-daq in your documents",
        applies=Applies.START,
    )
    file_name: str = stated(
        "",
        "File names",
        "Names of recordings: {unit} {operator} {plan} {date} {time} {number}; empty: unit and time",
        applies=Applies.RECORDING,
    )
    operator: str = stated(
        "", "Operator", "Written in recordings whose metadata name no operator", applies=Applies.RECORDING
    )
    unit: str = stated(
        "", "Proposed unit", "Unit that the window proposes before one was used; empty: SA1", applies=Applies.START
    )
    port: str = stated("", "Proposed port", "Port that the window proposes before one was used", applies=Applies.START)
    profile: str = stated(
        "",
        "Proposed profile",
        "Text profile that the window proposes before a board was connected",
        applies=Applies.START,
    )

    def __post_init__(self) -> None:
        _check_version("settings", self.version)
        check_ranges(self, "settings")


@dataclass(frozen=True, slots=True)
class StoredCalibration:
    """One entry of a unit's history. `content` is what the analysis made, as plain JSON values."""

    utc: str
    accepted: bool
    content: Mapping[str, Any]
    recording: str = ""
    operator: str = ""
    note: str = ""
    program_version: str = ""


@dataclass(frozen=True, slots=True)
class Unit:
    """A sensorized actuator: its limits, how its stage is wired, and its calibrations, oldest first.

    `type_b` are tables of contributions to the uncertainty of an elongation, as `analysis.calibration.type_b` reads
    them. `lens` is that of its camera (`analysis.tracking.lens`). `metadata` are those that its next recording states,
    too (`protocol.recording.Metadata`). `changes` are those of its limits and other values, oldest first.
    """

    name: str
    min_kpa: float = stated(
        -40.0,
        "Lowest pressure",
        "Below it the unit buckles or is damaged: a plan that goes lower is refused",
        "kPa",
        lowest=-101.325,
        highest=0.0,
        applies=Applies.NOW,
    )
    max_kpa: float = stated(
        50.0,
        "Highest pressure",
        "Above it the unit is damaged: a plan that goes higher is refused",
        "kPa",
        lowest=0.0,
        highest=1000.0,
        applies=Applies.NOW,
    )
    polarity: int = stated(
        -1,
        "Polarity",
        "Sign of the board's voltage over light",
        choices=((-1, "the voltage falls as light grows"), (1, "it rises")),
        applies=Applies.RECORDING,
    )
    note: str = stated("", "Note", "Anything about the unit", applies=Applies.NOW)
    usb_serial: str = stated(
        "", "USB serial number", "Identity of the board last used with this unit; stored automatically"
    )
    version: int = _VERSION
    type_b: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    metadata: Mapping[str, Any] = field(default_factory=dict)
    lens: Mapping[str, Any] = field(default_factory=dict)
    history: tuple[StoredCalibration, ...] = field(default=())
    changes: tuple[StoredChange, ...] = field(default=())

    def __post_init__(self) -> None:
        where = f"unit {self.name!r:.60}"
        _check_version(where, self.version)
        if not _NAME.fullmatch(self.name) or self.name.strip(" .") != self.name or is_device_name(self.name):
            raise BadValue(where, "name", "must be 1 to 40 letters, digits, spaces, or any of _ . -")
        if not self.min_kpa <= 0 <= self.max_kpa or not self.min_kpa < self.max_kpa:
            raise BadValue(where, "min_kpa", "and 'max_kpa' must enclose 0 kPa", "give the lower one first")
        check_ranges(self, where)

    @property
    def calibration(self) -> StoredCalibration | None:
        """The calibration in force: the newest entry, where it is accepted."""
        return self.history[-1] if self.history and self.history[-1].accepted else None


def home(kind: str = "config") -> Path:
    """Return the folder for "config" or "data"."""
    override = os.environ.get(HOME_VARIABLE)
    if override:
        return Path(override)
    find = platformdirs.user_config_path if kind == "config" else platformdirs.user_data_path
    return find("boat-daq", appauthor=False)


def recordings_folder(settings: Settings) -> Path:
    """Return the folder of the window's recordings."""
    if settings.recordings:
        return Path(settings.recordings).expanduser()
    override = os.environ.get(HOME_VARIABLE)
    return Path(override) / "recordings" if override else platformdirs.user_documents_path() / "boat-daq"


def load_settings(folder: Path | None = None) -> Settings:
    """Return the stored settings, the defaults where nothing was stored yet."""
    return stored_settings(folder)[0]


def stored_settings(folder: Path | None = None) -> tuple[Settings, tuple[StoredChange, ...]]:
    """Return the stored settings and what changed when, oldest first. RequestError: the file is refused, by key."""
    path = settings_path(folder)
    return read_whole(path, lambda text: read_settings(text, str(path))) or (Settings(), ())


def read_settings(text: str, where: str) -> tuple[Settings, tuple[StoredChange, ...]]:
    """Return the settings in a file's text, and their changes. RequestError: the text is refused, by key."""
    table = parse_toml(text, where)
    changes = take_changes(table, where)
    return build(Settings, table, where), changes


def save_settings(settings: Settings, folder: Path | None = None) -> None:
    """Store the settings, and what has changed; a file that is refused is kept beside."""
    path = settings_path(folder)
    try:
        before, changes = stored_settings(folder)
    except RequestError:
        before, changes = Settings(), ()
        if path.exists():
            _keep_refused(path)
    write_stored(path, settings_text(settings, with_changes(changes, texts_of(before), texts_of(settings))))


def settings_text(settings: Settings, changes: Sequence[Mapping[str, str]] = ()) -> str:
    """Return the text of a file with these settings and changes."""
    return tomli_w.dumps(dataclasses.asdict(settings) | {CHANGES: changes})


def _keep_refused(path: Path) -> None:
    """Rename a file that is refused, so that neither it nor its backup is overwritten."""
    names = (path.with_name(f"{path.name}.refused{n or ''}") for n in range(1000))
    try:
        path.replace(next(name for name in names if not name.exists()))
    except (OSError, StopIteration) as error:
        raise StorageError(f"{path} cannot be kept under another name", "move it elsewhere") from error


def settings_path(folder: Path | None = None) -> Path:
    return (folder or home()) / "settings.toml"


class UnitLibrary:
    """The stored units, one file each."""

    def __init__(self, folder: Path | None = None, *, simulated: bool = False) -> None:
        self._units = folder or home("data") / "units"
        self.simulated = simulated
        self.folder = self._units / _SIMULATED if simulated else self._units

    def of(self, *, simulated: bool) -> UnitLibrary:
        """Return the library of simulated boards, or that of real ones."""
        return self if simulated is self.simulated else UnitLibrary(self._units, simulated=simulated)

    def stamp(self, name: str) -> int:
        """Return a number that changes with the file of a unit's limits, or of its calibrations; 0 without a file."""
        stamps = [0]
        for folder in (self._units, self.folder):
            with contextlib.suppress(OSError):
                stamps.append(path_in(folder, f"{name}.toml").stat().st_mtime_ns)
        return max(stamps)

    def names(self) -> list[str]:
        folders = {self._units, self.folder}  # an older version kept simulated calibrations with the real ones
        files = (path.name.removesuffix(BACKUP) for folder in folders for path in folder.glob("[!.]*.toml*"))
        return sorted({name.removesuffix(".toml") for name in files if name.endswith(".toml")})

    def load(self, name: str) -> Unit:
        """Return a unit; one never stored has the default limits and no calibration."""
        unit = Unit(name)
        unit = self._read(self._units, name) or unit
        history = _of_kind(unit.history, simulated=self.simulated, first=False)
        own = self._read(self.folder, name) if self.simulated else None
        if self.simulated:
            unit = dataclasses.replace(unit, metadata=own.metadata if own is not None else {}, changes=())
        if own is not None:  # limits and wiring are those of the real unit, the rest is its own
            history += _of_kind(own.history, simulated=True, first=True)
            unit = dataclasses.replace(unit, type_b=own.type_b)
        return dataclasses.replace(unit, history=history)

    def boards(self) -> dict[str, str]:
        """Return the unit by the USB serial number of its board; of several units with that board, their names."""
        found: dict[str, str] = {}
        for name in self.names():
            with contextlib.suppress(RequestError):  # a unit whose file is refused is reported where it is used
                serial = self.load(name).usb_serial
                found |= {serial: ", ".join(filter(None, (found.get(serial), name)))} if serial else {}
        return found

    def _read(self, folder: Path, name: str) -> Unit | None:
        """Return the unit of a folder's file with every entry of it; None without a file."""
        path = path_in(folder, f"{name}.toml")
        return read_whole(path, lambda text: self._parse(name, text, path))

    @staticmethod
    def _parse(name: str, text: str, path: Path) -> Unit:
        """Return the unit of a file's text."""
        found = parse_unit(text, path)
        if found.name != name:
            raise BadValue(str(path), "name", f"is {found.name!r}, the file's is {name!r}")
        return found

    def stored(self, name: str) -> Unit:
        """Return a unit that is stored. RequestError: it is not, or as `load`."""
        if name not in self.names():
            known = ", ".join(self.names()) or "none"
            cause = f"no unit {name!r:.60} is stored (stored: {known})"
            raise ChoiceError(cause, "Correct the name, or add the unit.", command=f"boat-daq unit new {name:.60}")
        return self.load(name)

    def text(self, name: str) -> str:
        """Return the text of a stored unit's file. RequestError: it is not stored, or its file is refused."""
        self.stored(name)
        return read_stored(path_in(self.folder, f"{name}.toml")) or ""

    def save(self, unit: Unit) -> None:
        stored = self.load(unit.name)
        if unit.history[: len(stored.history)] != stored.history:
            remedy = "keep the entries of the stored history and add to them"
            raise RequestError(f"unit {unit.name}: a stored calibration is missing", remedy)
        own, new = self._read(self.folder, unit.name), unit.history[len(stored.history) :]
        kept = own.history if own is not None else ()
        table = dataclasses.asdict(dataclasses.replace(unit, history=(*kept, *new)))
        imported = bool(unit.changes) and not stored.changes
        changes, before = (unit.changes, unit) if imported else (stored.changes, stored)
        table[CHANGES] = with_changes(changes, _stated_texts(before), _stated_texts(unit))
        table["history"] = [{**entry, "content": json.dumps(dict(entry["content"]))} for entry in table["history"]]
        write_stored(path_in(self.folder, f"{unit.name}.toml"), tomli_w.dumps(table))

    def add_calibration(self, name: str, content: Mapping[str, Any], *, accepted: bool = True, **more: str) -> Unit:
        """Add a calibration to a unit's history, store it, and return the unit."""
        if bool(content.get("simulated", self.simulated)) is not self.simulated:
            kinds = ("a simulated board", "a real board")
            made, stored = kinds if not self.simulated else kinds[::-1]
            remedy = f"calibrate the unit {name} on {stored}"
            raise RequestError(f"a calibration of {made} is not one of {stored}", remedy)
        unit = self.load(name)
        plain = json.loads(json.dumps(dict(content), allow_nan=False))
        entry = StoredCalibration(datetime.now(UTC).isoformat(timespec="seconds"), accepted, plain, **more)
        unit = dataclasses.replace(unit, history=(*unit.history, entry))
        self.save(unit)
        return unit


def _stated_texts(unit: Unit) -> dict[str, str]:
    """Return the texts of what is stated of a unit, by key; its calibrations have dates of their own."""
    tables = {"metadata": unit.metadata, "type_b": unit.type_b}
    stated = {f"{table}.{key}": text_of(value) for table, values in tables.items() for key, value in values.items()}
    return texts_of(unit) | stated


def read_unit(path: Path) -> Unit:
    """Return the unit of an exported file. RequestError: the file is refused, by key."""
    return parse_unit(read_text(path), path)


def parse_unit(text: str, path: Path) -> Unit:
    """Return the unit of a file's text, with every entry of it. RequestError: the text is refused, by key."""
    table = parse_toml(text, str(path))
    entries = table.pop("history", [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise BadValue(str(path), "history", "must be a list of tables")
    type_b = table.pop("type_b", {})
    if not isinstance(type_b, dict) or not all(isinstance(entry, dict) for entry in type_b.values()):
        raise BadValue(str(path), "type_b", "must hold tables", "write [type_b.scale] and its keys below it")
    metadata, lens = table.pop("metadata", {}), table.pop("lens", {})
    for key, value in (("metadata", metadata), ("lens", lens)):
        if not isinstance(value, dict):
            raise BadValue(str(path), key, "must be a table")
    changes = take_changes(table, str(path))
    for key in _UNIT_KEYS:  # no default replaces a limit
        if key not in table:
            raise BadValue(str(path), key, "is missing")
    history = tuple(_entry(entry, str(path)) for entry in entries)
    return build(Unit, table, str(path), history=history, type_b=type_b, metadata=metadata, lens=lens, changes=changes)


def _of_kind(history: tuple[StoredCalibration, ...], *, simulated: bool, first: bool) -> tuple[StoredCalibration, ...]:
    """Return the entries of one kind of board."""
    found, kind = [], first
    for entry in history:
        kind = bool(entry.content.get("simulated", first if entry.accepted else kind))
        if kind is simulated:
            found.append(entry)
    return tuple(found)


_UNIT_KEYS = ("name", "min_kpa", "max_kpa", "polarity", "note", "version")  # every file has


def _entry(table: dict[str, Any], where: str) -> StoredCalibration:
    """Return an entry of a unit's history, whose `content` is JSON."""
    where = f"{where}, history"
    try:
        content = json.loads(table.pop("content", ""))
    except (TypeError, ValueError, RecursionError) as error:
        raise BadValue(where, "content", f"is not JSON: {error}") from error
    if not isinstance(content, dict):
        raise BadValue(where, "content", "must be a JSON object")
    return build(StoredCalibration, table, where, content=content)


def _check_version(where: str, version: int) -> None:
    if not 1 <= version <= _VERSION:
        raise BadValue(where, "version", f"is {version}; this program reads up to {_VERSION}", "update boat-daq")
