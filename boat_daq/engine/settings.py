"""Stored settings and the library of units, each a small TOML file.

Rules. A file is replaced whole or not at all: written beside, flushed to the disk, renamed; the one before stays as
`.bak`. An edited file with an error is refused by key (`toml_values`), and no default silently replaces a limit. Files
carry a version; a newer one than this program's is refused, so that an older program never cuts it down. The folders
are the system's own (platformdirs), or the one in the environment variable BOAT_DAQ_HOME. A file that a disk destroyed
(gone, empty, no text) is replaced by its backup, with a warning (`take_warnings`); one that editing made unreadable is
refused instead, because its backup would undo the edit, a tighter limit perhaps.

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
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar

import platformdirs
import tomli_w

from boat_daq.engine.file_names import is_device_name, path_in
from boat_daq.engine.toml_values import MAX_BYTES, BadValue, build, parse_toml, read_text
from boat_daq.errors import OperatorError, StorageError
from protocol.regular_file import read_regular
from protocol.whole_file import write_whole, written_whole

T = TypeVar("T")

VERSION = 1
HOME_VARIABLE = "BOAT_DAQ_HOME"
BACKUP = ".bak"
SIMULATED = "simulated"  # folder of the calibrations of simulated boards
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 _.-]{0,39}")


@dataclass(frozen=True, slots=True)
class Settings:
    """What the operator can set.

    Parameters
    ----------
    rate_hz : samples per second requested of a board.
    baud : of a serial port.
    zero_tolerance_kpa : of the pressure sensor on a vented unit, before the first pressure.
    resolution_mm : of the grid that elongation is read from.
    allow_remote : whether a board may be reached beyond this computer.
    recordings : folder of the window's recordings; empty for `boat-daq` in the user's documents.
    operator, unit, port, profile : as last used.
    """

    version: int = VERSION
    rate_hz: int = 100
    baud: int = 115_200
    zero_tolerance_kpa: float = 1.0
    resolution_mm: float = 0.5
    allow_remote: bool = False
    recordings: str = ""
    operator: str = ""
    unit: str = ""
    port: str = ""
    profile: str = ""

    def __post_init__(self) -> None:
        _check_version("settings", self.version)
        if not 1 <= self.rate_hz <= 65_535:
            raise BadValue("settings", "rate_hz", f"must be 1 to 65535, not {self.rate_hz}")
        if not 300 <= self.baud <= 12_000_000:
            raise BadValue("settings", "baud", f"must be 300 to 12000000, not {self.baud}")
        for key in ("zero_tolerance_kpa", "resolution_mm"):
            if not 0 < getattr(self, key) <= 10:
                raise BadValue("settings", key, f"must be above 0 and at most 10, not {getattr(self, key)}")


@dataclass(frozen=True, slots=True)
class StoredCalibration:
    """One entry of a unit's history.

    `content` is what the analysis made, as plain JSON values.
    """

    utc: str
    accepted: bool
    content: Mapping[str, Any]
    recording: str = ""
    operator: str = ""
    note: str = ""
    program_version: str = ""


@dataclass(frozen=True, slots=True)
class Unit:
    """A sensorized actuator.

    Its limits, how its stage is wired, and its calibrations, oldest first.

    `polarity` is +1 where the board's voltage rises with light, -1 where its stage inverts. `type_b` are tables of
    contributions to the uncertainty of an elongation, as `analysis.calibration.type_b` reads them. `metadata` are those
    that its next recording states, too (`protocol.recording.Metadata`). `usb_serial` is the serial number of the USB
    device of the board that it was last used with, by which that board is found.
    """

    name: str
    min_kpa: float = -40.0
    max_kpa: float = 50.0
    polarity: int = -1
    note: str = ""
    usb_serial: str = ""
    version: int = VERSION
    type_b: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    metadata: Mapping[str, Any] = field(default_factory=dict)
    history: tuple[StoredCalibration, ...] = field(default=())

    def __post_init__(self) -> None:
        where = f"unit {self.name!r:.60}"
        _check_version(where, self.version)
        if not _NAME.fullmatch(self.name) or self.name.strip(" .") != self.name or is_device_name(self.name):
            raise BadValue(where, "name", "must be 1 to 40 letters, digits, spaces, or any of _ . -")
        if not self.min_kpa <= 0 <= self.max_kpa or not self.min_kpa < self.max_kpa:
            raise BadValue(where, "min_kpa", "and 'max_kpa' must enclose 0 kPa, the lower one first", "swap the two?")
        if self.polarity not in (-1, 1):
            raise BadValue(where, "polarity", f"must be 1 or -1, not {self.polarity}")

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
    """Return the stored settings, the defaults where nothing was stored yet.

    Raises
    ------
    OperatorError : the file is refused, by key.
    """
    path = (folder or home()) / "settings.toml"
    return _read_whole(path, lambda text: build(Settings, parse_toml(text, str(path)), str(path))) or Settings()


def save_settings(settings: Settings, folder: Path | None = None) -> None:
    """Store the settings.

    Raises
    ------
    StorageError : the folder cannot be written.
    """
    write_stored((folder or home()) / "settings.toml", tomli_w.dumps(dataclasses.asdict(settings)))


class UnitLibrary:
    """The stored units, one file each.

    Parameters
    ----------
    folder : of the units; the stored ones when None.
    simulated : whether the calibrations are those of simulated boards.
    """

    def __init__(self, folder: Path | None = None, *, simulated: bool = False) -> None:
        self._units = folder or home("data") / "units"
        self.simulated = simulated
        self.folder = self._units / SIMULATED if simulated else self._units

    def of(self, *, simulated: bool) -> UnitLibrary:
        """Return the library of simulated boards, or that of real ones."""
        return self if simulated is self.simulated else UnitLibrary(self._units, simulated=simulated)

    def names(self) -> list[str]:
        """Return the names of the stored units, sorted."""
        folders = {self._units, self.folder}  # an older version kept simulated calibrations with the real ones
        files = (path.name.removesuffix(BACKUP) for folder in folders for path in folder.glob("[!.]*.toml*"))
        return sorted({name.removesuffix(".toml") for name in files if name.endswith(".toml")})

    def load(self, name: str) -> Unit:
        """Return a unit; one never stored has the default limits and no calibration.

        Raises
        ------
        OperatorError : no usable name, or the file is refused, by key.
        """
        unit = Unit(name)
        unit = self._read(self._units, name) or unit
        history = _of_kind(unit.history, simulated=self.simulated, first=False)
        own = self._read(self.folder, name) if self.simulated else None
        if self.simulated:
            unit = dataclasses.replace(unit, metadata=own.metadata if own is not None else {})
        if own is not None:  # limits and wiring are those of the real unit, the rest is its own
            history += _of_kind(own.history, simulated=True, first=True)
            unit = dataclasses.replace(unit, type_b=own.type_b)
        return dataclasses.replace(unit, history=history)

    def boards(self) -> dict[str, str]:
        """Return the unit by the USB serial number of its board; of several units with that board, their names."""
        found: dict[str, str] = {}
        for name in self.names():
            with contextlib.suppress(OperatorError):  # a unit whose file is refused is reported where it is used
                serial = self.load(name).usb_serial
                found |= {serial: ", ".join(filter(None, (found.get(serial), name)))} if serial else {}
        return found

    def _read(self, folder: Path, name: str) -> Unit | None:
        """Return the unit of a folder's file with every entry of it; None without a file."""
        path = path_in(folder, f"{name}.toml")
        return _read_whole(path, lambda text: self._parse(name, text, path))

    @staticmethod
    def _parse(name: str, text: str, path: Path) -> Unit:
        """Return the unit of a file's text."""
        table = parse_toml(text, str(path))
        entries = table.pop("history", [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise BadValue(str(path), "history", "must be a list of tables")
        type_b = table.pop("type_b", {})
        if not isinstance(type_b, dict) or not all(isinstance(entry, dict) for entry in type_b.values()):
            raise BadValue(str(path), "type_b", "must hold tables", "write [type_b.scale] and its keys below it")
        metadata = table.pop("metadata", {})
        if not isinstance(metadata, dict):
            raise BadValue(str(path), "metadata", "must be a table")
        for key in _UNIT_KEYS:  # no default replaces a limit
            if key not in table:
                raise BadValue(str(path), key, "is missing")
        history = tuple(_entry(entry, str(path)) for entry in entries)
        found = build(Unit, table, str(path), history=history, type_b=type_b, metadata=metadata)
        if found.name != name:
            raise BadValue(str(path), "name", f"is {found.name!r}, the file's is {name!r}")
        return found

    def save(self, unit: Unit) -> None:
        """Store a unit.

        Raises
        ------
        OperatorError : entries of its history would be lost.
        StorageError : the folder cannot be written.
        """
        stored = self.load(unit.name)
        if unit.history[: len(stored.history)] != stored.history:
            remedy = "keep the entries of the stored history and add to them"
            raise OperatorError(f"unit {unit.name}: a stored calibration is missing", remedy)
        own, new = self._read(self.folder, unit.name), unit.history[len(stored.history) :]
        kept = own.history if own is not None else ()
        table = dataclasses.asdict(dataclasses.replace(unit, history=(*kept, *new)))
        table["history"] = [{**entry, "content": json.dumps(dict(entry["content"]))} for entry in table["history"]]
        write_stored(path_in(self.folder, f"{unit.name}.toml"), tomli_w.dumps(table))

    def add_calibration(self, name: str, content: Mapping[str, Any], *, accepted: bool = True, **more: str) -> Unit:
        """Add a calibration to a unit's history, store it, and return the unit.

        Parameters
        ----------
        name : of the unit.
        content : plain JSON values; it is read back as it was.
        accepted : False for the withdrawal of the one before.
        more : recording, operator, note, program_version.

        Raises
        ------
        OperatorError : its content is of the other kind of board, or as `load` and `save`. StorageError : as `save`.
        """
        if bool(content.get("simulated", self.simulated)) is not self.simulated:
            kinds = ("a simulated board", "a real board")
            made, stored = kinds if not self.simulated else kinds[::-1]
            remedy = f"calibrate the unit {name} on {stored}"
            raise OperatorError(f"a calibration of {made} is not one of {stored}", remedy)
        unit = self.load(name)
        plain = json.loads(json.dumps(dict(content), allow_nan=False))
        entry = StoredCalibration(datetime.now(UTC).isoformat(timespec="seconds"), accepted, plain, **more)
        unit = dataclasses.replace(unit, history=(*unit.history, entry))
        self.save(unit)
        return unit


def _of_kind(history: tuple[StoredCalibration, ...], *, simulated: bool, first: bool) -> tuple[StoredCalibration, ...]:
    """Return the entries of one kind of board.

    Parameters
    ----------
    history : of a file; a withdrawal that does not name its kind is of the kind of the entry before it.
    simulated : the kind.
    first : the kind of an accepted entry that does not name it.
    """
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
    if not 1 <= version <= VERSION:
        raise BadValue(where, "version", f"is {version}; this program reads up to {VERSION}", "update boat-daq")


_warnings: list[tuple[str, str]] = []


def take_warnings() -> list[tuple[str, str]]:
    """Return cause and remedy for every backup used since the last call."""
    taken = _warnings.copy()
    _warnings.clear()
    return taken


def read_stored(path: Path) -> str | None:
    """Return the text of a stored file, or of its backup where a disk destroyed it.

    None where nothing was stored.

    Raises
    ------
    OperatorError : neither can be read.
    """
    backup = path.with_name(path.name + BACKUP)
    if not is_destroyed(path) or not backup.exists():
        return read_text(path) if path.exists() else None
    text = read_text(backup)
    if "\0" in text or not text.strip():
        raise OperatorError(f"{path} and its backup are destroyed", "write the file again; check the disk")
    warning = (f"{path} was destroyed; its backup is used", "check its contents, store it again, and check the disk")
    if warning not in _warnings:
        _warnings.append(warning)
    return text


def _read_whole(path: Path, parse: Callable[[str], T]) -> T | None:
    """Return what is stored in a file; None where nothing is.

    Raises
    ------
    OperatorError : the file is refused; the remedy names its backup, where that one would be taken.
    """
    text = read_stored(path)
    if text is None:
        return None
    try:
        return parse(text)
    except OperatorError as error:
        backup = path.with_name(path.name + BACKUP)
        if is_destroyed(path) or not _is_good(backup, parse):
            raise
        way_out = f"correct it, or restore its backup: copy {backup} over {path.name}"
        raise OperatorError(error.cause, f"{error.remedy}; {way_out}" if error.remedy else way_out) from error


def _is_good(path: Path, parse: Callable[[str], object]) -> bool:
    try:
        parse(read_text(path))
    except OperatorError:
        return False
    return True


def is_destroyed(path: Path) -> bool:
    """Whether a file is gone or holds what no editor leaves.

    Nothing at all, NUL bytes, or no UTF-8.
    """
    try:
        content = read_regular(path, MAX_BYTES)
        return not content.strip() or b"\0" in content or not content.decode("utf-8-sig").strip()
    except (FileNotFoundError, UnicodeDecodeError):
        return True
    except OSError:
        return False  # present but unreadable or too large: `read_text` raises the reason


def write_stored(path: Path, text: str) -> None:
    """Replace a file at once, the one before kept as `.bak`.

    Raises
    ------
    StorageError : the folder or the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if not is_destroyed(path):  # else the backup is the better one
            with written_whole(path.with_name(path.name + BACKUP)) as kept:
                shutil.copy2(path, kept)
        write_whole(path, text)
    except OSError as error:
        raise StorageError(f"{path} cannot be written: {error.strerror}", "check the folder and the disk") from error
