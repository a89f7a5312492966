"""A table before its import: the quantity and unit of measurement of each column, the separator, the rate.

Strategy: a helper process proposes a map from the titles; the operator corrects it. The choice is kept for files with
the same columns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from boat_daq.engine.file_names import path_in
from boat_daq.engine.recording.file import check_recording_name
from boat_daq.formatting import count, plain_number
from boat_daq.viewmodels.common.preferences import Preferences
from boat_daq.workflows.jobs import Job, JobFailure, JobRunner
from boat_daq.workflows.run_files import import_tables, preview_table
from protocol.base.errors import RequestError
from protocol.recording import SUFFIX

SENSORS_MOST = 8
ROLES = {
    "time_s": "Time", "pressure_kpa": "Pressure", "target_kpa": "Target pressure",
    "elongation_mm": "Elongation",
    **{f"s{n}_mv": f"Sensor {n}" for n in range(1, SENSORS_MOST + 1)},
}  # fmt: skip
SIGNALS = tuple(role for role in ROLES if role.endswith("_mv"))
SEPARATORS = (("automatic", ""), ("comma", ","), ("semicolon", ";"), ("tab", "\t"), ("bar", "|"), ("space", " "))
UNIT_TEXTS = {
    "kpa": "kPa", "pa": "Pa", "mpa": "MPa", "hpa": "hPa", "mmhg": "mmHg", "mv": "mV", "v": "V",
    "uv": "\u00b5V", "us": "\u00b5s", "n": "N", "pf": "pF", "um": "\u00b5m", "cmh2o": "cmH2O",
    "kgf/cm2": "kgf/cm\u00b2", "ohm": "\u03a9",
}  # fmt: skip
KINDS_KEPT = 20  # kinds of files whose columns are remembered
PREFERENCE = "csv columns"


class Source(NamedTuple):
    """The column that a quantity is read from, counted from 1, and its unit; column 0 is none."""

    column: int
    unit: str


NONE = Source(0, "")


@dataclass(frozen=True, slots=True)
class FileColumn:
    """A column of the file: its title, and its first values as texts."""

    title: str
    first: tuple[str, ...]


class CsvImport:
    def __init__(
        self, folder: Path, jobs: JobRunner, preferences: Preferences, imported: Callable[[Path, Sequence[str]], None]
    ) -> None:
        self._folder, self._jobs, self._preferences, self._imported = folder, jobs, preferences, imported
        self.path = Path()
        self.second: Path | None = None  # file of the same run
        self.profile: Path | None = None  # text profile of a captured serial text
        self.separator = ""  # empty: automatic
        self.name, self.rate = "", ""
        self.sources: dict[str, Source] = {}
        self.failure: JobFailure | None = None
        self.finished = False  # whether the file is imported
        self.revision = 0
        self._seen: Mapping[str, Any] = {}  # what the importer sees in the file
        self._found: dict[str, Source] = {}  # by the titles

    def open(self, path: Path) -> None:
        """Read a file in the background; the columns are then proposed."""
        self.path, self.separator, self.rate, self._seen = path, "", "", {}
        self.second = self.profile = None
        self.name = self._free_name(path.stem)
        self._read()

    def join(self, path: Path) -> None:
        if path == self.path:
            raise RequestError(f"{path.name} is the first file", "Choose the other file of the run.")
        self.second, self.profile = path, None
        self.revision += 1

    def read_through(self, profile: Path) -> None:
        """Read captured serial text through a text profile."""
        self.profile, self.second, self.failure = profile, None, None
        self.revision += 1

    def separate(self, separator: str) -> None:
        """Read the file again with another separator; empty: the one that is found."""
        if separator != self.separator:
            self.separator = separator
            self._read()

    def _read(self) -> None:
        self.failure, self.sources, self._found, self.finished = None, {}, {}, False
        self.revision += 1
        job = Job(f"Reading {self.path.name}", preview_table, self.path, self.separator or None)
        self._jobs.start("csv", job, self._take)

    def _take(self, job: Job) -> None:
        self.failure, self._seen = job.failure, job.result or {}
        self.revision += 1
        self._found = {c["taken_as"]: Source(c["number"], c["taken_unit"].lower()) for c in self._columns()}
        self.sources = {role: self._found.get(role, NONE) for role in ROLES}
        kept = self._kept().get(self._kind())
        if kept is None or not self.columns:
            return
        if kept["separator"] != self.separator and not self.separator:
            self.separate(kept["separator"])
            return
        self.sources |= {role: Source(*source) for role, source in kept["columns"].items() if role in ROLES}
        self.rate = str(kept["rate"])

    def _columns(self) -> Sequence[Mapping[str, Any]]:
        columns: Sequence[Mapping[str, Any]] = self._seen.get("columns", ())
        return columns

    @property
    def reading(self) -> bool:
        return self._jobs.get("csv") is not None

    @property
    def columns(self) -> tuple[FileColumn, ...]:
        return tuple(
            FileColumn(
                f"{c['name']} ({c['unit']})" if c["unit"] else str(c["name"]),
                tuple(v if isinstance(v, str) else f"{v:.6g}" for v in c["first"]),
            )
            for c in self._columns()
        )

    def heading(self, column: int) -> str:
        """Return what a column of the file, counted from 1, is imported as; empty where it is left out."""
        found = next((ROLES[role] for role, source in self.sources.items() if source.column == column), "")
        extra = any(c["taken_as"] == "channel" for c in self._columns() if c["number"] == column)
        return found or ("Extra channel" if extra else "")

    def units(self, role: str) -> tuple[str, ...]:
        """Return the units that a quantity may have, that of the file among them."""
        usual, unit = tuple(self._seen.get("units", {}).get(role, ())), self.sources[role].unit
        return usual if unit in usual or not unit else (*usual, unit)

    def summary(self) -> str:
        """Return how the file is written, in a line; why it cannot be read."""
        seen = self._seen
        if self.profile is not None:
            return f"Captured serial text, read through {self.profile.name}"
        if self.failure is not None:
            return self.failure.text
        if not seen:
            return f"Reading {self.path.name} \u2026"
        names = {value: name for name, value in SEPARATORS if value} | {"white space": "space"}
        size = f"{count(seen['rows'], 'row')}, {count(len(self.columns), 'column')}"
        if self.second is not None:
            size += f"; joined with {self.second.name} by date, or by a signal in both"
        if not seen["separator"]:
            return f"{size}; {seen['encoding']}"
        sign = {".": "point", ",": "comma"}[seen["decimal"]]
        separator = names.get(seen["separator"], seen["separator"])
        return f"{size}; separator {separator}, decimal {sign}, {seen['encoding']}"

    def warnings(self) -> tuple[str, ...]:
        """Return what the importer had to guess, or could not read."""
        return (*self._seen.get("notes", ()), *self._seen.get("issues", ()))

    def choose(self, role: str, source: Source) -> None:
        """Read a quantity from another column, or in another unit; a column is read as one quantity only."""
        if source.column:
            taken = [other for other, at in self.sources.items() if at.column == source.column and other != role]
            self.sources |= dict.fromkeys(taken, NONE)
            source = source._replace(unit=source.unit or next(iter(self.units(role)), ""))
        self.sources[role] = source
        self.revision += 1

    def obstacle(self) -> str:
        """Return what is missing for an import; empty where nothing is."""
        if self.profile is not None:
            return ""
        if not self.sources:
            return "The file is not read yet."
        if self.second is not None:  # has what the first has not
            return "" if self.sources["time_s"].column else "Choose the column of the time."
        if not self.sources["pressure_kpa"].column:
            return "Choose the column of the pressure."
        if not any(self.sources[role].column for role in SIGNALS):
            return "Choose the column of at least one sensor."
        if not self.sources["time_s"].column and self._rate_hz() is None and "time_s" in self._seen.get("missing", ()):
            return "Choose the column of the time, or type the sampling rate."
        return ""

    def _rate_hz(self) -> float | None:
        try:
            rate_hz = plain_number(self.rate)
        except ValueError:
            return None
        return rate_hz if rate_hz > 0 else None

    def map(self) -> dict[str, str]:
        """Return the map for the importer: what differs from its own; with a changed signal, all signals."""
        changed = {role for role, source in self.sources.items() if source != self._found.get(role, NONE)}
        if changed & set(SIGNALS):
            changed |= {role for role in SIGNALS if self.sources[role].column}
        wanted = {role: self._text(source) for role, source in self.sources.items()}
        return {role: text for role, text in wanted.items() if role in changed or not text}

    def _text(self, source: Source) -> str:
        """Return a source as the importer takes it: by its title where that is unique, else by its number."""
        if not source.column:
            return ""
        names = [str(c["name"]) for c in self._columns()]
        title = names[source.column - 1]
        column = title if names.count(title) == 1 and ":" not in title else str(source.column)
        return f"{column}:{source.unit}" if source.unit else column

    def start(self, name: str) -> None:
        if obstacle := self.obstacle():
            raise RequestError(f"{self.path.name} cannot be imported yet", obstacle)
        target = path_in(self._folder, f"{name.strip().removesuffix(SUFFIX)}{SUFFIX}")
        check_recording_name(target)
        if target.exists():
            raise RequestError(f"{target.name} exists already", "Choose another name; no recording is overwritten.")
        self._remember()
        self._folder.mkdir(parents=True, exist_ok=True)
        label = f"Importing {self.path.name}"
        if self.profile is not None:
            job = Job(label, import_tables, [self.path], target, {}, text_profile=self.profile)
        elif self.second is not None:
            job = Job(label, import_tables, [self.path, self.second], target, self.map())
        else:
            rate_hz = None if self.sources["time_s"].column else self._rate_hz()
            options = {"rate_hz": rate_hz, "separator": self.separator or None}
            job = Job(label, import_tables, [self.path], target, self.map(), **options)
        job.target = target
        self._jobs.start("csv", job, lambda job: self._ended(job, target))
        self.revision += 1

    def _ended(self, job: Job, target: Path) -> None:
        self.failure = job.failure
        self.revision += 1
        if job.failure is None and job.result is not None:
            self.finished = True
            self._imported(target, job.result)

    def _free_name(self, stem: str) -> str:
        taken = {path.stem for path in self._folder.glob(f"*{SUFFIX}")}
        names = (stem, *(f"{stem}-{n}" for n in range(2, len(taken) + 3)))
        return next(name for name in names if name not in taken)

    def _kind(self) -> str:
        """Return what files of one kind share: their titles and units."""
        return "|".join(column.title for column in self.columns)[:1000]

    def _kept(self) -> dict[str, Any]:
        kept: dict[str, Any] = self._preferences.get(PREFERENCE, {})
        return kept

    def _remember(self) -> None:
        others = {kind: entry for kind, entry in self._kept().items() if kind != self._kind()}
        columns = {role: list(source) for role, source in self.sources.items()}
        entry = {"columns": columns, "separator": self.separator, "rate": self.rate}
        self._preferences.set(PREFERENCE, dict([*others.items(), (self._kind(), entry)][-KINDS_KEPT:]))
