"""A CSV as it is found into a `Recording`.

Strategy: `analysis.csv_table` reads the numbers; this file says which column is what and in which unit. Our own export
needs no map: its names are known. Others are recognised by the usual words, or mapped by hand (NAME=COLUMN[:UNIT]);
a map can be kept as a profile and used again.

Rules: a guess is told in `notes`; what cannot be told is refused, with the line or the column. Units are converted
once, here. Time must not fall; rows that repeat a time are left out and counted.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.csv_hints import guess_unit, listed, map_by_hand, time_without_header, words_in
from analysis.csv_table import Table, line_of_row, read_table
from analysis.errors import DataError, FileError, RequestError
from analysis.recording import FloatArray, Recording

UNITS: dict[str, dict[str, float]] = {
    "time_s": {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "min": 60.0, "h": 3600.0},
    "pressure_kpa": {
        "kpa": 1.0, "pa": 1e-3, "hpa": 0.1, "mpa": 1e3, "bar": 100.0, "mbar": 0.1, "psi": 6.894757293168361,
        "mmhg": 0.13332236842105263, "torr": 0.13332236842105263, "atm": 101.325,
    },
    "signal": {"mv": 1.0, "v": 1e3, "uv": 1e-3, "µv": 1e-3, "μv": 1e-3},
    "elongation_mm": {"mm": 1.0, "m": 1e3, "cm": 10.0, "um": 1e-3, "µm": 1e-3},
}  # fmt: skip
UNITS["target_kpa"] = UNITS["pressure_kpa"]
WORDS = {
    "time_s": ("time", "t", "tijd", "zeit", "temps", "tempo", "timestamp", "elapsed", "seconds", "millis", "micros"),
    "pressure_kpa": ("pressure", "p", "druk", "druck", "pression", "pressione", "press", "gauge"),
    "target_kpa": ("target", "setpoint", "set point", "target pressure", "pressure target"),
}
SENSOR = re.compile(r"^(?:s|sensor|signal|ch|channel|sig|y)[\s_]*([1-9])(?:[\s_]*(?:mv|v|uv|signal|voltage))?$")
SIGNAL_WORDS = ("signal", "voltage", "sensor", "mv", "v", "output", "light")
COUNTS = re.compile(r"^s([1-9])_(lit|dark)$")
PLAIN = ("index", "state", "flags", "segment")
KNOWN_META = (
    "simulated",
    "unit",
    "operator",
    "note",
    "rate_hz",
    "vref_mv",
    "adc_bits",
    "board_id",
    "started_utc",
    "polarity",
)
MAX_SENSORS = 9
MAX_COUNT = 65535


MAX_PROFILE_BYTES = 1_000_000


@dataclass(frozen=True, slots=True)
class Column:
    """One column of the map: its position in the file, its unit, the factor to ours."""

    position: int
    unit: str
    factor: float


@dataclass(frozen=True, slots=True)
class ColumnMap:
    """Which column is what. Keys are our names: time_s, pressure_kpa, s1_mv, ... `notes` tell every guess."""

    columns: Mapping[str, Column]
    notes: tuple[str, ...]

    def as_profile(self, table: Table) -> dict[str, str]:
        """Return the map as NAME -> COLUMN:UNIT, the form that a profile keeps and `--map` takes."""
        profile = {}
        for name, column in self.columns.items():
            title = table.names[column.position]
            unique = table.names.count(title) == 1 and ":" not in title
            profile[name] = f"{title if unique else column.position + 1}" + (f":{column.unit}" if column.unit else "")
        return profile


def import_csv(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    profile: str | Path | None = None,
    rate_hz: float | None = None,
) -> Recording:
    """Import a CSV as a recording.

    Parameters
    ----------
    path : the file.
    columns : NAME -> "COLUMN" or "COLUMN:UNIT"; COLUMN is a name or a number from 1.
    profile : a saved map (`save_profile`); `columns` overrides it.
    rate_hz : where the file has no time.

    Raises
    ------
    FileError : not a table of numbers.
    RequestError : a column or unit of the map does not exist; no pressure, signal or time could be told.
    DataError : time falls; the message names the line.
    """
    path = Path(path)
    table = read_table(path)
    wanted = {**(load_profile(profile) if profile else {}), **(columns or {})}
    mapping = map_columns(table, wanted)
    return _recording(path, table, mapping, rate_hz)


def map_columns(table: Table, columns: Mapping[str, str] | None = None) -> ColumnMap:
    """Say which column is what: by hand where `columns` says so, else by name and unit."""
    chosen: dict[str, Column] = {}
    notes: list[str] = []
    for name, text in (columns or {}).items():
        chosen[_our_name(name)] = _by_hand(table, _our_name(name), text)
    taken = {column.position for column in chosen.values()}
    by_hand = any(name.endswith("_mv") or COUNTS.match(name) for name in chosen)
    for position, (title, unit) in enumerate(zip(table.names, table.units, strict=True)):
        seen = _recognise(title)
        if seen is None or position in taken or seen in chosen or position in table.text:
            continue
        if by_hand and (seen.endswith("_mv") or COUNTS.match(seen)):
            continue  # signals were mapped by hand: no others are added
        chosen[seen] = _with_unit(table, seen, position, unit or _unit_of_name(title), notes)
        taken.add(position)
    found = time_without_header(table) if columns and "time_s" not in chosen else None
    if found is not None and found not in taken:
        notes.append(f"no header: column {found + 1} never falls, taken as time")
        chosen["time_s"] = _with_unit(table, "time_s", found, table.units[found], notes)
    return ColumnMap(dict(sorted(chosen.items(), key=lambda item: item[1].position)), tuple(notes))


def save_profile(path: str | Path, mapping: ColumnMap, table: Table) -> None:
    """Keep a column map as JSON, to be used again for files of the same kind."""
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
        raise FileError(f"{path} is no import profile ({error})", "Make one with --save-profile.") from error
    return dict(columns)


def preview(path: str | Path, columns: Mapping[str, str] | None = None, rows: int = 5) -> dict[str, Any]:
    """Return what the importer sees: dialect, columns, map, first rows, issues. Nothing is refused but nonsense."""
    table = read_table(path)
    mapping = map_columns(table, columns)
    by_position = {column.position: (name, column.unit) for name, column in mapping.columns.items()}
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
        "notes": list(mapping.notes),
        "issues": list(table.issues),
        "broken_rows": table.broken,
        "masked_cells": table.masked,
    }  # fmt: skip


def _our_name(name: str) -> str:
    name = name.strip().lower()
    sensor = SENSOR.match(name)
    if sensor:
        return f"s{sensor[1]}_mv"
    short = {"time": "time_s", "pressure": "pressure_kpa", "target": "target_kpa", "signal": "s1_mv"}.get(name, name)
    if short in UNITS or short in PLAIN or COUNTS.match(short) or short == "s1_mv":
        return short
    raise RequestError(
        f"{name!r} is nothing that can be mapped",
        "Map time_s, pressure_kpa, target_kpa, s1_mv, s2_mv, s1_lit, s1_dark, ...",
    )


def _kind(name: str) -> str:
    return "signal" if name.endswith("_mv") else name


def _by_hand(table: Table, name: str, text: str) -> Column:
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
        return Column(position, "", 1.0)  # mapped by hand without a unit: taken as it is
    return Column(position, unit, known[unit.lower()])


def _recognise(title: str) -> str | None:
    plain = " ".join(re.sub(r"[_,;]", " ", title.lower()).split())
    exact = plain.replace(" ", "_")
    if exact in PLAIN or (exact in UNITS and exact != "signal") or COUNTS.match(exact):
        return exact
    sensor = SENSOR.match(plain)
    if sensor:
        return f"s{sensor[1]}_mv"
    words = plain.split()
    if words and words[-1] in {u for kind in UNITS.values() for u in kind} and len(words) > 1:
        words = words[:-1]
    plain = " ".join(words)
    for name in ("target_kpa", "time_s", "pressure_kpa"):
        if plain in WORDS[name] or (words and words[0] in WORDS[name] and len(words[0]) > 1):
            return name
    return "s1_mv" if plain in SIGNAL_WORDS else None


def _unit_of_name(title: str) -> str:
    tail = re.split(r"[\s_,;]+", title.strip())[-1]
    units = {u for kind in UNITS.values() for u in kind}
    return tail if tail.lower() in units and tail.lower() != title.strip().lower() else ""


def _with_unit(table: Table, name: str, position: int, unit: str, notes: list[str]) -> Column:
    known = UNITS.get(_kind(name))
    if known is None:
        return Column(position, "", 1.0)
    if unit.lower() in known:
        return Column(position, unit, known[unit.lower()])
    if unit:
        raise RequestError(
            f"unit {unit!r} of column {table.names[position]!r} is not known for {name}",
            f"Map it by hand: --map {name}={position + 1}:UNIT with one of {', '.join(known)}.",
        )
    guessed = guess_unit(name, table.columns[position])
    notes.append(f"column {table.names[position]!r} has no unit: taken as {guessed}")
    return Column(position, guessed, known[guessed.lower()])


def _missing(mapping: ColumnMap) -> list[str]:
    have = set(mapping.columns)
    missing = [name for name in ("time_s", "pressure_kpa") if name not in have]
    if not any(name.endswith("_mv") or COUNTS.match(name) for name in have):
        missing.append("s1_mv")
    return missing


def _recording(path: Path, table: Table, mapping: ColumnMap, rate_hz: float | None) -> Recording:
    missing = [name for name in _missing(mapping) if name != "time_s" or rate_hz is None]
    if missing:
        by_hand = f"Map it by hand, with the numbers of its columns: {map_by_hand(missing, mapping, table)}"
        remedy = "Give --rate HZ, or --map time_s=COLUMN:ms" if missing == ["time_s"] else by_hand
        words = [words_in(table, i) for i in table.text if _recognise(table.names[i]) in missing]
        raise RequestError(
            "; ".join([f"{path.name}: no column was recognised as {', '.join(missing)}", *words]),
            f"{remedy}. Columns: {listed(table)}.",
        )
    meta = _meta(table, mapping, path)
    if "time_s" not in mapping.columns:
        meta["import_rate_hz"] = rate_hz
    values = {name: table.columns[c.position] * c.factor for name, c in mapping.columns.items()}
    if "time_s" in values:
        keep = _increasing(path, table, values["time_s"], values.get("segment"))
    else:
        values["time_s"] = np.arange(table.rows) / float(rate_hz or 1.0)
        keep = np.ones(table.rows, dtype=bool)
    if not keep.any():
        raise DataError(f"{path.name} holds no row with a time", "Check the column map; nothing could be imported.")
    repeated = int((~keep).sum())
    if repeated:
        meta["repeated_times"] = repeated
        meta["import_notes"] = [
            *meta.get("import_notes", ()), f"{repeated} rows left out: no time, or that of the row before"
        ]  # fmt: skip
    values = {name: column[keep] for name, column in values.items()}
    signal, lit, dark = _signals(values, meta)
    whole = {name: _integers(values[name]) for name in PLAIN if name in values and np.isfinite(values[name]).all()}
    return Recording.from_arrays(
        values["time_s"] - values["time_s"][0], values["pressure_kpa"], signal, lit=lit, dark=dark,
        **({"target_kpa": values["target_kpa"]} if "target_kpa" in values else {}), **whole, meta=meta,
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
    counts = all(f"s{i}_lit" in values and f"s{i}_dark" in values for i in numbers)
    lit = np.stack([values[f"s{i}_lit"] for i in numbers], axis=1) if counts else None
    dark = np.stack([values[f"s{i}_dark"] for i in numbers], axis=1) if counts else None
    scale = _counts_scale(meta) if counts else None
    signals = []
    for i in numbers:
        if f"s{i}_mv" in values:
            signals.append(values[f"s{i}_mv"])
        elif scale is not None:
            signals.append((values[f"s{i}_lit"] - values[f"s{i}_dark"]) * scale)
        else:
            raise RequestError(
                f"sensor {i} has counts, but no signal in mV", f"Map s{i}_mv, or give vref_mv and adc_bits."
            )
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
    """Millivolts per count, None where the file does not say."""
    if "vref_mv" not in meta or "adc_bits" not in meta:
        return None
    try:
        return float(meta["vref_mv"]) / 2.0 ** int(meta["adc_bits"])
    except (TypeError, ValueError, OverflowError) as error:
        raise RequestError(
            f"vref_mv {meta['vref_mv']!r} and adc_bits {meta['adc_bits']!r} are no numbers", "Mend the file's head."
        ) from error


def _integers(values: FloatArray) -> np.ndarray[Any, Any]:
    return values.astype(np.int64)


def _meta(table: Table, mapping: ColumnMap, path: Path) -> dict[str, Any]:
    meta: dict[str, Any] = {"imported_from": path.name, "import_map": mapping.as_profile(table)}
    if mapping.notes:
        meta["import_notes"] = list(mapping.notes)
    if table.issues:
        meta["import_issues"] = list(table.issues)
    if table.broken:
        meta["broken_rows"] = table.broken
    for comment in table.dialect.comments:
        key, _, value = comment.partition(":")
        if key.strip() in KNOWN_META:
            try:
                said = json.loads(value)
            except (ValueError, RecursionError):
                said = None
            meta[key.strip()] = said if isinstance(said, str | int | float) else value.strip()
    return meta
