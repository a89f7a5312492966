"""A CSV as it is found into a `Recording`: the map from its columns to ours, with units, and the recording by that map.

`analysis.data.csv_table` reads the numbers; columns are mapped by the usual titles, or as the user maps them, which can
be kept as a profile. The columns of our own export are recognised by their names. A guess is named in `warnings`; what
is not recognised is refused, with the line or the column, and the option that maps it. Units are converted once, here.
Time must not fall; rows that repeat a time are left out and counted.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from analysis.data.csv_table import Table, line_of_row, read_table
from analysis.data.recording import META_KEYS, Recording
from analysis.warning import Warning, WarningCode
from protocol.base.arrays import FloatArray, IntArray
from protocol.base.errors import DataError, FileError, RequestError
from protocol.base.regular_file import read_regular
from protocol.base.units import KPA_PER_UNIT, find_unit
from protocol.base.whole_file import write_whole
from protocol.recording import CHANNELS_MAX, RESERVED, ExtraChannel, SampleFlag, channels_of

_UNITS: dict[str, dict[str, float]] = {
    "time_s": {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "min": 60.0, "h": 3600.0},
    "pressure_kpa": KPA_PER_UNIT,
    "target_kpa": KPA_PER_UNIT,
    "signal": {"mv": 1.0, "v": 1e3, "uv": 1e-3, "µv": 1e-3, "μv": 1e-3},
    "elongation_mm": {"mm": 1.0, "m": 1e3, "cm": 10.0, "um": 1e-3, "µm": 1e-3},
}  # fmt: skip
ALL_UNITS = frozenset().union(*_UNITS.values())
WORDS = {
    "time_s": ("time", "t", "tijd", "zeit", "temps", "tempo", "timestamp", "elapsed", "seconds", "millis", "micros"),
    "pressure_kpa": ("pressure", "p", "druk", "druck", "pression", "pressione", "press", "gauge"),
    "target_kpa": ("target", "setpoint", "set point", "target pressure", "pressure target"),
}
SENSOR = re.compile(r"^(?:s|sensor|signal|ch|channel|sig|y)[\s_]*([1-9])(?:[\s_]*(?:mv|v|uv|signal|voltage))?$")
SIGNAL_WORDS = ("signal", "voltage", "sensor", "mv", "v", "output", "light")
_COUNTS = re.compile(r"^s([1-9])_(lit|dark)$")
_PLAIN = ("index", "state", "flags", "segment")
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
    """Which column is time_s, pressure_kpa, s1_mv, ...; `warnings` name every guess, `declined` what is not mapped."""

    columns: Mapping[str, Column]
    warnings: tuple[Warning, ...]
    declined: tuple[str, ...] = ()
    channels: Mapping[int, ExtraChannel] = field(default_factory=dict)  # by position: columns of other quantities

    def as_profile(self, table: Table) -> dict[str, str]:
        """Return the map as NAME -> COLUMN:UNIT, the form that a profile keeps and `--map` takes."""
        profile = dict.fromkeys(self.declined, "")
        for name, column in self.columns.items():
            title = table.names[column.position]
            unique = table.names.count(title) == 1 and ":" not in title
            profile[name] = f"{title if unique else column.position + 1}" + (f":{column.unit}" if column.unit else "")
        return profile


def map_columns(table: Table, columns: Mapping[str, str] | None = None, *, tolerant: bool = False) -> ColumnMap:
    """Map the columns as `columns` gives them ("" for none), else by title; `tolerant` of unknown units."""
    chosen: dict[str, Column] = {}
    warnings: list[Warning] = []
    given = {_our_name(name): text for name, text in (columns or {}).items()}
    for name, text in given.items():
        if text:
            chosen[name] = _mapped(table, name, text)
    taken = {column.position for column in chosen.values()}
    stated = _stated_channels(table)
    mapped_signals = any(map(is_signal, chosen))
    for position, (title, unit) in enumerate(zip(table.names, table.units, strict=True)):
        seen = recognised(title)
        if (
            seen is None
            or position in taken
            or position in stated
            or seen in (*chosen, *given)
            or position in table.text
        ):
            continue
        if mapped_signals and is_signal(seen):
            continue  # signals were mapped explicitly: no others are added
        try:
            chosen[seen] = _with_unit(table, seen, position, unit or _unit_of_name(title), warnings)
        except RequestError as error:
            if not tolerant:
                raise
            warnings.append(Warning(WarningCode.UNIT_UNKNOWN, "", error.cause))
            continue
        taken.add(position)
    found = time_without_header(table) if given and "time_s" not in {*chosen, *given} else None
    if found is not None and found not in taken:
        text = f"no header: column {found + 1} never falls, taken as time"
        warnings.append(Warning(WarningCode.TIME_GUESSED, "", text))
        chosen["time_s"] = _with_unit(table, "time_s", found, table.units[found], warnings)
    declined = tuple(name for name, text in given.items() if not text)
    by_position = dict(sorted(chosen.items(), key=lambda item: item[1].position))
    taken = {column.position for column in chosen.values()}
    return ColumnMap(by_position, tuple(warnings), declined, _channels(table, taken, stated))


def _stated_channels(table: Table) -> dict[int, tuple[str, str]]:
    """Return name and unit of the columns that comments of our own export call extra channels."""
    stated = {}
    for comment in table.dialect.comments:
        key, _, text = comment.partition(":")
        column = key.removeprefix("channel ").strip()
        if key.startswith("channel ") and column in table.names:
            name, bracket, unit = text.strip().partition(" [")
            stated[table.names.index(column)] = name, unit.removesuffix("]") if bracket else ""
    return stated


def _channels(table: Table, taken: Set[int], stated: Mapping[int, tuple[str, str]]) -> dict[int, ExtraChannel]:
    """Return the columns that are extra channels: stated as such, or of another quantity with a known unit."""
    found = {}
    for position, (title, unit) in enumerate(zip(table.names, table.units, strict=True)):
        tail = re.split(r"[\s_,;]+", title.strip())[-1]
        name, symbol = (title, unit) if unit or tail == title else (title.strip()[: -len(tail)].strip(" _,;"), tail)
        known = find_unit(symbol)
        if position in taken or position in table.text or not np.isfinite(table.columns[position]).any():
            continue
        if position in stated:
            found[position] = stated[position]
        elif known is not None and table.dialect.header and not RESERVED.fullmatch(ExtraChannel(name, symbol).column):
            found[position] = name, symbol if unit else known.symbol
    return dict(zip(found, channels_of(found.values()), strict=True)) if len(found) <= CHANNELS_MAX else {}


def save_profile(path: str | Path, mapping: ColumnMap, table: Table) -> None:
    """Keep a column map as JSON, to be used again for files of the same kind."""
    text = json.dumps({"boat_daq_import": 1, "columns": mapping.as_profile(table)}, indent=2, ensure_ascii=False)
    write_whole(Path(path), text + "\n")


def load_profile(path: str | Path) -> dict[str, str]:
    """Read a column map that `save_profile` kept; raises FileError if it is none."""
    try:
        content = json.loads(read_regular(Path(path), MAX_PROFILE_BYTES).decode("utf-8"))
        columns = content["columns"]
        if content["boat_daq_import"] != 1 or not all(isinstance(v, str) for v in columns.values()):
            raise ValueError("unknown version or a column that is no text")
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise FileError(f"{path} is not an import profile ({error})", "Create one with --save-profile.") from error
    return dict(columns)


def is_signal(name: str) -> bool:
    """Return whether a column of our name holds a sensor's signal or counts."""
    return name.endswith("_mv") or _COUNTS.match(name) is not None


def _our_name(name: str) -> str:
    name = name.strip().lower()
    sensor = SENSOR.match(name)
    if sensor:
        return f"s{sensor[1]}_mv"
    short = {"time": "time_s", "pressure": "pressure_kpa", "target": "target_kpa", "signal": "s1_mv"}.get(name, name)
    if short in _UNITS or short in _PLAIN or _COUNTS.match(short) or short == "s1_mv":
        return short
    raise RequestError(
        f"{name!r} is not a name that a column can be mapped to",
        "Map time_s, pressure_kpa, target_kpa, s1_mv, s2_mv, s1_lit, s1_dark, ...",
    )


def _kind(name: str) -> str:
    return "signal" if name.endswith("_mv") else name


def units_of(name: str) -> tuple[str, ...]:
    """Return the units that a column mapped to `name` may have, one spelling of each."""
    return tuple({factor: unit for unit, factor in reversed(_UNITS[_kind(name)].items())}.values())[::-1]


def _mapped(table: Table, name: str, text: str) -> Column:
    column, _, unit = text.rpartition(":") if ":" in text else (text, "", "")
    try:
        position = table.position(column)
    except RequestError:
        if not column or column == text:
            raise
        position, unit = table.position(text), ""  # a colon that belongs to the column's name
    unit = unit or table.units[position] or _unit_of_name(table.names[position])
    known = _UNITS.get(_kind(name), {})
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
    if exact in _PLAIN or (exact in _UNITS and exact != "signal") or _COUNTS.match(exact):
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
    known = _UNITS.get(_kind(name))
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
    """Return the refusal of a table in which no column was mapped to the names `missing`."""
    options = f"Map it by the numbers of the columns: {_map_options(missing, mapping, table)}"
    remedy = "Add --map time_s=COLUMN:ms, or import it with --rate HZ" if missing == ["time_s"] else options
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


MAX_COUNT = 65535
WHOLE_MAX = 2.0**53  # beyond it a float has no whole numbers of its own


def import_csv(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    profile: str | Path | None = None,
    rate_hz: float | None = None,
    separator: str | None = None,
    signals_only: bool = False,
) -> Recording:
    """Import a CSV as a recording.

    Parameters
    ----------
    columns : NAME -> "COLUMN" or "COLUMN:UNIT"; COLUMN is a name or a number from 1; "" for no column.
    profile : a saved map (`save_profile`); `columns` overrides it.
    separator : column separator, " " for white space; found when None.
    signals_only : allow a file without pressure, which is NaN then.

    Raises
    ------
    FileError : not a table of numbers.
    RequestError : a column or unit of the map does not exist; no pressure, signal or time was recognised.
    DataError : time falls; the message names the line.
    """
    path = Path(path)
    table = read_table(path, separator)
    wanted = {**(load_profile(profile) if profile else {}), **(columns or {})}
    return _recording(path, table, map_columns(table, wanted), rate_hz, separator, signals_only)


def preview(
    path: str | Path, columns: Mapping[str, str] | None = None, rows: int = 5, *, separator: str | None = None
) -> dict[str, Any]:
    """Return what the importer sees: dialect, columns, map, first rows, warnings; an incomplete map is no error."""
    table = read_table(path, separator)
    mapping = map_columns(table, columns, tolerant=True)
    by_position = {column.position: (name, column.unit) for name, column in mapping.columns.items()}
    by_position |= {position: ("channel", channel.unit) for position, channel in mapping.channels.items()}
    return {
        "encoding": table.dialect.encoding,
        "separator": {" ": "white space", "\t": "tab"}.get(table.dialect.separator, table.dialect.separator),
        "decimal": table.dialect.decimal,
        "first_data_line": table.dialect.data_line + 1,
        "rows": table.rows,
        "columns": [
            {
                "number": i + 1, "name": table.names[i], "unit": table.units[i],
                "taken_as": by_position.get(i, ("", ""))[0], "taken_unit": by_position.get(i, ("", ""))[1],
                "first": table.text[i][:rows] if i in table.text else table.columns[i][:rows].tolist(),
            }
            for i in range(len(table.names))
        ],
        "map": mapping.as_profile(table),
        "missing": _missing(mapping),
        "notes": [warning.text for warning in mapping.warnings],
        "issues": [warning.text for warning in table.warnings],
        "warnings": [warning.as_json() for warning in (*mapping.warnings, *table.warnings)],
        "broken_rows": table.broken,
        "masked_cells": table.masked,
    }  # fmt: skip


def _missing(mapping: ColumnMap) -> list[str]:
    missing = [name for name in ("time_s", "pressure_kpa") if name not in mapping.columns]
    return missing if any(map(is_signal, mapping.columns)) else [*missing, "s1_mv"]


def _recording(
    path: Path, table: Table, mapping: ColumnMap, rate_hz: float | None, separator: str | None, signals_only: bool
) -> Recording:
    spared = {"time_s"} if rate_hz is not None else set()
    spared |= {"pressure_kpa"} if signals_only else set()
    missing = [name for name in _missing(mapping) if name not in spared]
    if missing:
        raise unmapped(path.name, missing, mapping, table)
    meta = _meta(table, mapping, path) | ({"import_separator": separator} if separator else {})
    if "time_s" not in mapping.columns:
        meta["import_rate_hz"] = rate_hz
    values = {name: table.columns[c.position] * c.factor for name, c in mapping.columns.items()}
    if "time_s" in values:
        keep = _increasing(path, table, values["time_s"], values.get("segment"))
    else:
        values["time_s"] = np.arange(table.rows) / float(rate_hz or 1.0)
        keep = np.ones(table.rows, dtype=bool)
    if not keep.any():
        raise DataError(f"{path.name} holds no row with a time", "Check the column map.")
    repeated = int((~keep).sum())
    if repeated:
        meta["repeated_times"] = repeated
        _note(meta, f"{repeated} rows left out: no time, or that of the row before")
    values = {name: column[keep] for name, column in values.items()}
    channel = None
    if mapping.channels:
        meta["channels"] = [list(channel) for channel in mapping.channels.values()]
        channel = np.stack([table.columns[position][keep] for position in mapping.channels], axis=1)
    signal, lit, dark = _signals(values, meta)
    whole = _whole_numbers(values, meta)
    pressure = values.get("pressure_kpa", np.full(signal.shape[0], np.nan))
    return Recording.from_arrays(
        values["time_s"] - values["time_s"][0], pressure, signal, lit=lit, dark=dark,
        **({"target_kpa": values["target_kpa"]} if "target_kpa" in values else {}), **whole, meta=meta,
        channel=channel,
        source=str(path),
    )  # fmt: skip


def _increasing(path: Path, table: Table, time_s: FloatArray, segment: FloatArray | None) -> np.ndarray[Any, Any]:
    """Rows to keep: those whose time is a number and not that of the row before. Falling time is refused."""
    keep = np.isfinite(time_s)
    rows = np.flatnonzero(keep)
    if not rows.size:
        raise DataError(f"{path.name}: the time column holds no numbers", "Map another column.")
    steps = np.diff(time_s[rows])
    same = np.ones(steps.size, bool) if segment is None else np.diff(segment[rows]) == 0
    falling = np.flatnonzero((steps < 0) & same)
    if falling.size:
        row = int(rows[falling[0] + 1])
        raise DataError(
            f"{path.name}, line {line_of_row(path, table.dialect, row)}: time falls from {time_s[rows[falling[0]]]:g} "
            f"to {time_s[row]:g} s ({falling.size} times in all)",
            "Split the file where the clock restarts, or map another column as time.",
        )
    keep[rows[1:][(steps == 0) & same]] = False
    return keep


def _signals(values: Mapping[str, FloatArray], meta: dict[str, Any]) -> tuple[FloatArray, Any, Any]:
    numbers = sorted({int(name[1]) for name in values if re.match(r"^s[1-9]_", name)})
    lit = dark = scale = None
    if all(f"s{i}_lit" in values and f"s{i}_dark" in values for i in numbers):
        lit, dark = (np.stack([values[f"s{i}_{kind}"] for i in numbers], axis=1) for kind in ("lit", "dark"))
        scale = _counts_scale(meta)
    signals = []
    for i in numbers:
        if f"s{i}_mv" in values:
            signals.append(values[f"s{i}_mv"])
        elif scale is not None:
            signals.append((values[f"s{i}_lit"] - values[f"s{i}_dark"]) * scale)
        else:
            cause = f"sensor {i} has counts, but no signal in mV"
            raise RequestError(cause, f"Map s{i}_mv, or give vref_mv and adc_bits.")
    signal = np.stack(signals, axis=1)
    if lit is None or dark is None:
        return signal, None, None
    good = _are_counts(lit) & _are_counts(dark)
    if good.all():
        return signal, lit, dark
    return np.where(good, signal, np.nan), None, None  # counts with holes are no integers: the signal carries the NaN


def _are_counts(values: FloatArray) -> np.ndarray[Any, Any]:
    return (values >= 0) & (values <= MAX_COUNT)  # False for NaN


def _counts_scale(meta: Mapping[str, Any]) -> float | None:
    """Millivolts per count, None where the file does not give them."""
    if not {"vref_mv", "adc_bits"} <= meta.keys():
        return None
    try:
        return float(meta["vref_mv"]) / 2.0 ** int(meta["adc_bits"])
    except (TypeError, ValueError, OverflowError) as error:
        raise RequestError(
            f"vref_mv {meta['vref_mv']!r} and adc_bits {meta['adc_bits']!r} are not numbers",
            "Correct the head of the file.",
        ) from error


def _whole_numbers(values: Mapping[str, FloatArray], meta: dict[str, Any]) -> dict[str, IntArray]:
    """Index, state, flags and segment; a row whose cell is no such number is flagged and follows the one before."""
    columns = {name: values[name] for name in _PLAIN if name in values}
    good = {name: np.abs(column) <= WHOLE_MAX for name, column in columns.items()}  # False for NaN
    gone = [name for name, rows in good.items() if not rows.any() or (name == "index" and not rows.all())]
    invalid = np.zeros(values["time_s"].size, dtype=bool)
    whole: dict[str, IntArray] = {}
    for name in columns.keys() - gone:
        rows = np.maximum.accumulate(np.where(good[name], np.arange(invalid.size), int(np.argmax(good[name]))))
        whole[name] = columns[name][rows].astype(np.int64)
        invalid |= ~good[name]
    if invalid.any():
        flags = whole.get("flags", np.zeros(invalid.size, dtype=np.int64))
        whole["flags"] = np.where(invalid, flags | int(SampleFlag.IMPLAUSIBLE), flags)
    if gone:
        _note(meta, f"not used, because cells are not whole numbers: {', '.join(sorted(gone))}")
    return whole


def _note(meta: dict[str, Any], text: str) -> None:
    meta["import_notes"] = [*meta.get("import_notes", ()), text]


def _meta(table: Table, mapping: ColumnMap, path: Path) -> dict[str, Any]:
    meta: dict[str, Any] = {"imported_from": path.name, "import_map": mapping.as_profile(table)}
    if mapping.warnings:
        meta["import_notes"] = [warning.text for warning in mapping.warnings]
    if table.warnings:
        meta["import_issues"] = [warning.text for warning in table.warnings]
    if table.broken:
        meta["broken_rows"] = table.broken
    for comment in table.dialect.comments:
        key, _, value = comment.partition(":")
        if key.strip() in META_KEYS:
            try:
                content = json.loads(value)
            except (ValueError, RecursionError):
                content = None
            meta[key.strip()] = content if isinstance(content, str | int | float) else value.strip()
    return meta
