"""The map from a table's columns to ours, with units: by the usual titles, or as the user maps them; kept as a profile.

Rules: a guess is named in `warnings`; a unit that is not known is refused, with the option that maps it. A hint names
columns by their titles, or by their content; an option in it can be typed as it is.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.arrays import FloatArray
from analysis.data.csv_table import Table
from analysis.errors import FileError, RequestError
from analysis.warning import Warning, WarningCode
from protocol.pressure_units import KPA_PER_UNIT

UNITS: dict[str, dict[str, float]] = {
    "time_s": {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "min": 60.0, "h": 3600.0},
    "pressure_kpa": KPA_PER_UNIT,
    "target_kpa": KPA_PER_UNIT,
    "signal": {"mv": 1.0, "v": 1e3, "uv": 1e-3, "µv": 1e-3, "μv": 1e-3},
    "elongation_mm": {"mm": 1.0, "m": 1e3, "cm": 10.0, "um": 1e-3, "µm": 1e-3},
}  # fmt: skip
ALL_UNITS = frozenset().union(*UNITS.values())
WORDS = {
    "time_s": ("time", "t", "tijd", "zeit", "temps", "tempo", "timestamp", "elapsed", "seconds", "millis", "micros"),
    "pressure_kpa": ("pressure", "p", "druk", "druck", "pression", "pressione", "press", "gauge"),
    "target_kpa": ("target", "setpoint", "set point", "target pressure", "pressure target"),
}
SENSOR = re.compile(r"^(?:s|sensor|signal|ch|channel|sig|y)[\s_]*([1-9])(?:[\s_]*(?:mv|v|uv|signal|voltage))?$")
SIGNAL_WORDS = ("signal", "voltage", "sensor", "mv", "v", "output", "light")
COUNTS = re.compile(r"^s([1-9])_(lit|dark)$")
PLAIN = ("index", "state", "flags", "segment")
MAX_PROFILE_BYTES = 1_000_000
MOST_LISTED = 20
USUAL_UNITS = {"time_s": "ms", "pressure_kpa": "bar", "s1_mv": "V"}


@dataclass(frozen=True, slots=True)
class Column:
    """One column of the map: its position in the file, its unit, the factor to ours."""

    position: int
    unit: str
    factor: float


@dataclass(frozen=True, slots=True)
class ColumnMap:
    """Which column is what. Keys are our names: time_s, pressure_kpa, s1_mv, ... `warnings` name every guess."""

    columns: Mapping[str, Column]
    warnings: tuple[Warning, ...]

    def as_profile(self, table: Table) -> dict[str, str]:
        """Return the map as NAME -> COLUMN:UNIT, the form that a profile keeps and `--map` takes."""
        profile = {}
        for name, column in self.columns.items():
            title = table.names[column.position]
            unique = table.names.count(title) == 1 and ":" not in title
            profile[name] = f"{title if unique else column.position + 1}" + (f":{column.unit}" if column.unit else "")
        return profile


def map_columns(table: Table, columns: Mapping[str, str] | None = None) -> ColumnMap:
    """Map the columns: as `columns` gives them, else by title and unit."""
    chosen: dict[str, Column] = {}
    warnings: list[Warning] = []
    for name, text in (columns or {}).items():
        chosen[_our_name(name)] = _mapped(table, _our_name(name), text)
    taken = {column.position for column in chosen.values()}
    mapped_signals = any(map(is_signal, chosen))
    for position, (title, unit) in enumerate(zip(table.names, table.units, strict=True)):
        seen = recognised(title)
        if seen is None or position in taken or seen in chosen or position in table.text:
            continue
        if mapped_signals and is_signal(seen):
            continue  # signals were mapped explicitly: no others are added
        chosen[seen] = _with_unit(table, seen, position, unit or _unit_of_name(title), warnings)
        taken.add(position)
    found = time_without_header(table) if columns and "time_s" not in chosen else None
    if found is not None and found not in taken:
        text = f"no header: column {found + 1} never falls, taken as time"
        warnings.append(Warning(WarningCode.TIME_GUESSED, "", text))
        chosen["time_s"] = _with_unit(table, "time_s", found, table.units[found], warnings)
    return ColumnMap(dict(sorted(chosen.items(), key=lambda item: item[1].position)), tuple(warnings))


def save_profile(path: str | Path, mapping: ColumnMap, table: Table) -> None:
    """Keep a column map as JSON, to be used again for files of the same kind.

    Parameters
    ----------
    path : of the JSON file.
    mapping : to store.
    table : that the mapping is of.
    """
    text = json.dumps({"boat_daq_import": 1, "columns": mapping.as_profile(table)}, indent=2, ensure_ascii=False)
    Path(path).write_text(text + "\n", encoding="utf-8")


def load_profile(path: str | Path) -> dict[str, str]:
    """Read a column map that `save_profile` kept.

    Raises
    ------
    FileError : not such a file.
    """
    try:
        if Path(path).stat().st_size > MAX_PROFILE_BYTES:
            raise ValueError(f"larger than {MAX_PROFILE_BYTES} bytes")
        content = json.loads(Path(path).read_text(encoding="utf-8"))
        columns = content["columns"]
        if content["boat_daq_import"] != 1 or not all(isinstance(v, str) for v in columns.values()):
            raise ValueError("unknown version or a column that is no text")
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise FileError(f"{path} is not an import profile ({error})", "Create one with --save-profile.") from error
    return dict(columns)


def is_signal(name: str) -> bool:
    """Return whether a column of our name holds a sensor's signal or counts."""
    return name.endswith("_mv") or COUNTS.match(name) is not None


def _our_name(name: str) -> str:
    name = name.strip().lower()
    sensor = SENSOR.match(name)
    if sensor:
        return f"s{sensor[1]}_mv"
    short = {"time": "time_s", "pressure": "pressure_kpa", "target": "target_kpa", "signal": "s1_mv"}.get(name, name)
    if short in UNITS or short in PLAIN or COUNTS.match(short) or short == "s1_mv":
        return short
    raise RequestError(
        f"{name!r} is not a name that a column can be mapped to",
        "Map time_s, pressure_kpa, target_kpa, s1_mv, s2_mv, s1_lit, s1_dark, ...",
    )


def _kind(name: str) -> str:
    return "signal" if name.endswith("_mv") else name


def _mapped(table: Table, name: str, text: str) -> Column:
    column, _, unit = text.rpartition(":") if ":" in text else (text, "", "")
    try:
        position = table.position(column)
    except RequestError:
        if not column or column == text:
            raise
        position, unit = table.position(text), ""  # a colon that belongs to the column's name
    unit = unit or table.units[position] or _unit_of_name(table.names[position])
    known = UNITS.get(_kind(name), {})
    if not unit or not known:
        return Column(position, "", 1.0)
    if unit.lower() not in known:
        if ":" in text:
            raise RequestError(f"unit {unit!r} is not known for {name}", f"Known: {', '.join(known)}.")
        return Column(position, "", 1.0)  # mapped explicitly without a unit: taken as it is
    return Column(position, unit, known[unit.lower()])


def recognised(title: str) -> str | None:
    """Return our name of a column by its title; None where it is not recognised."""
    plain = " ".join(re.sub(r"[_,;]", " ", title.lower()).split())
    exact = plain.replace(" ", "_")
    if exact in PLAIN or (exact in UNITS and exact != "signal") or COUNTS.match(exact):
        return exact
    words = plain.split()
    if len(words) > 1 and words[-1] in ALL_UNITS:
        words = words[:-2] if words[-2] == "in" and len(words) > 2 else words[:-1]  # "Druck in kPa"
    sensor = SENSOR.match(plain) or SENSOR.match(" ".join(words))
    if sensor:
        return f"s{sensor[1]}_mv"
    plain = " ".join(words)
    for name in ("target_kpa", "time_s", "pressure_kpa"):
        if plain in WORDS[name] or (words and words[0] in WORDS[name] and len(words[0]) > 1):
            return name
    return "s1_mv" if plain in SIGNAL_WORDS else None


def _unit_of_name(title: str) -> str:
    tail = re.split(r"[\s_,;]+", title.strip())[-1]
    return tail if tail.lower() in ALL_UNITS and tail.lower() != title.strip().lower() else ""


def _with_unit(table: Table, name: str, position: int, unit: str, warnings: list[Warning]) -> Column:
    known = UNITS.get(_kind(name))
    if known is None:
        return Column(position, "", 1.0)
    if unit.lower() in known:
        return Column(position, unit, known[unit.lower()])
    if unit:
        raise RequestError(
            f"unit {unit!r} of column {table.names[position]!r} is not known for {name}",
            f"Map it: --map {name}={position + 1}:UNIT with one of {', '.join(known)}.",
        )
    guessed = guess_unit(name, table.columns[position])
    text = f"column {table.names[position]!r} has no unit: taken as {guessed}"
    warnings.append(Warning(WarningCode.UNIT_GUESSED, "", text))
    return Column(position, guessed, known[guessed.lower()])


def time_without_header(table: Table) -> int | None:
    """Return the first column of a file without header that never falls and is no mere count of the rows."""
    if table.dialect.header:
        return None
    for position, values in enumerate(table.columns):
        if position in table.text or values.size < 3 or not np.isfinite(values).all():
            continue
        steps = np.diff(values)
        if (steps >= 0).all() and steps.any() and not (steps == 1).all():
            return position
    return None


def guess_unit(name: str, values: FloatArray) -> str:
    """Return the unit that the magnitude of the numbers suggests."""
    finite = values[np.isfinite(values)]
    if name == "time_s":
        step = float(np.median(np.abs(np.diff(finite)))) if finite.size > 1 else 0.0
        return "s" if step < 2 else ("ms" if step < 1500 else "us")
    if name.endswith("_mv"):
        return "V" if finite.size and np.abs(finite).max() <= 10 else "mV"
    largest = float(np.abs(finite).max()) if finite.size else 0.0
    return "kPa" if largest < 1000 else "Pa"


def unmapped(name: str, missing: list[str], mapping: ColumnMap, table: Table) -> RequestError:
    """Return the refusal of a file whose columns were not all recognised.

    Parameters
    ----------
    name : of the file.
    missing : our names that no column was mapped to.
    mapping, table : what was recognised, and of which table.
    """
    options = f"Map it by the numbers of the columns: {_map_options(missing, mapping, table)}"
    remedy = "Give --rate HZ, or --map time_s=COLUMN:ms" if missing == ["time_s"] else options
    found = [_text_in(table, i) for i in table.text if recognised(table.names[i]) in missing]
    cause = "; ".join([f"{name}: no column was recognised as {', '.join(missing)}", *found])
    return RequestError(cause, f"{remedy}. Columns: {_listed(table)}.")


def _listed(table: Table) -> str:
    """Return the columns as a message names them: by their titles, or by their content."""
    if table.dialect.header:
        return ", ".join(f"{i + 1} {name}" for i, name in enumerate(table.names[:MOST_LISTED]))
    shown = []
    for i, column in enumerate(table.columns[:MOST_LISTED]):
        known = column[np.isfinite(column)]
        shown.append(f"{i + 1} ({known.min():g} to {known.max():g})" if known.size else f"{i + 1} (text)")
    return ", ".join(shown)


def _map_options(missing: list[str], mapping: ColumnMap, table: Table) -> str:
    """Return the options that map what is missing, beside those that were recognised."""
    known = [
        f"--map {name}={column.position + 1}:{column.unit}" for name, column in mapping.columns.items() if column.unit
    ]
    wanted = {name: f"COLUMN:{USUAL_UNITS[name]}" for name in missing}
    time = time_without_header(table)
    if time is not None and "time_s" in wanted:
        wanted["time_s"] = f"{time + 1}:{guess_unit('time_s', table.columns[time])}"
    return " ".join([*known, *(f"--map {name}={column}" for name, column in wanted.items())])


def _text_in(table: Table, position: int) -> str:
    """Return that a column holds text, with the first of it."""
    first = next((cell for cell in table.text[position] if cell), "")
    return f"column {table.names[position]!r} holds text like {first[:30]!r}, not numbers"
