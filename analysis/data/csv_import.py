"""A CSV as it is found into a `Recording`.

Strategy: `analysis.data.csv_table` reads the numbers, `analysis.data.csv_columns` maps the columns and their units. The
columns of our own export are recognised by their names.

Rules: what is not recognised is refused, with the line or the column. Units are converted once, here. Time must not
fall; rows that repeat a time are left out and counted.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from analysis.arrays import FloatArray, IntArray
from analysis.data.csv_columns import PLAIN, ColumnMap, is_signal, load_profile, map_columns, unmapped
from analysis.data.csv_table import Table, line_of_row, read_table
from analysis.data.recording import META_KEYS, Recording
from analysis.errors import DataError, RequestError
from protocol.recording import SampleFlag

MAX_COUNT = 65535
WHOLE_MAX = 2.0**53  # beyond it a float has no whole numbers of its own


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
    RequestError : a column or unit of the map does not exist; no pressure, signal or time was recognised.
    DataError : time falls; the message names the line.
    """
    path = Path(path)
    table = read_table(path)
    wanted = {**(load_profile(profile) if profile else {}), **(columns or {})}
    return _recording(path, table, map_columns(table, wanted), rate_hz)


def preview(path: str | Path, columns: Mapping[str, str] | None = None, rows: int = 5) -> dict[str, Any]:
    """Return what the importer sees: dialect, columns, map, first rows, warnings; an incomplete map is no error.

    Parameters
    ----------
    path : the file.
    columns : as `import_csv` takes them.
    rows : how many of the first rows to show.
    """
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
        "notes": [warning.text for warning in mapping.warnings],
        "issues": [warning.text for warning in table.warnings],
        "warnings": [warning.as_json() for warning in (*mapping.warnings, *table.warnings)],
        "broken_rows": table.broken,
        "masked_cells": table.masked,
    }  # fmt: skip


def _missing(mapping: ColumnMap) -> list[str]:
    missing = [name for name in ("time_s", "pressure_kpa") if name not in mapping.columns]
    return missing if any(map(is_signal, mapping.columns)) else [*missing, "s1_mv"]


def _recording(path: Path, table: Table, mapping: ColumnMap, rate_hz: float | None) -> Recording:
    missing = [name for name in _missing(mapping) if name != "time_s" or rate_hz is None]
    if missing:
        raise unmapped(path.name, missing, mapping, table)
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
        raise DataError(f"{path.name} holds no row with a time", "Check the column map.")
    repeated = int((~keep).sum())
    if repeated:
        meta["repeated_times"] = repeated
        _note(meta, f"{repeated} rows left out: no time, or that of the row before")
    values = {name: column[keep] for name, column in values.items()}
    signal, lit, dark = _signals(values, meta)
    whole = _whole_numbers(values, meta)
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
    columns = {name: values[name] for name in PLAIN if name in values}
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
