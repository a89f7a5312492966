"""A table as it is found into a `Recording`, by the map of `analysis.data.column_map`.

Units are converted once, here. Time is one rising clock: one that begins again at a usual value is unwrapped, segments
follow one another, coarse stamps are spread, columns of a lower rate or of another clock are interpolated, and each is
said; a clock that falls otherwise is refused. Rows that repeat a time are left out and counted.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import date, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from analysis.data import clocks
from analysis.data.column_map import CHANNEL, Column, ColumnMap, has_column, map_columns, too_many_sensors, unmapped
from analysis.data.column_names import PLAIN, is_signal
from analysis.data.csv_table import Table, line_of_row, read_table
from analysis.data.recording import META_KEYS, Recording
from analysis.json_object import json_object
from protocol.base.arrays import BoolArray, FloatArray, IntArray
from protocol.base.errors import DataError, FileError, RequestError
from protocol.base.regular_file import read_regular
from protocol.base.whole_file import write_whole
from protocol.recording import ExtraChannel, SampleFlag

MAX_PROFILE_BYTES = 1_000_000
MAX_SIDECAR_BYTES = 1 << 28
MAX_COUNT = 65535
_SINCE_1970 = (1e9, 4.1e9)  # s
WHOLE_MAX = 2.0**53  # beyond it a float has no whole numbers of its own


def save_profile(path: str | Path, mapping: ColumnMap, table: Table) -> None:
    """Keep a column map as JSON, to be used again for files of the same kind."""
    text = json.dumps({"boat_daq_import": 1, "columns": mapping.as_profile(table)}, indent=2, ensure_ascii=False)
    write_whole(Path(path), text + "\n")


def load_profile(path: str | Path) -> dict[str, str]:
    """Read a column map that `save_profile` kept; raises FileError if it is none."""
    try:
        content = json.loads(read_regular(Path(path), MAX_PROFILE_BYTES).decode("utf-8"))
        columns = content["map"] if "map" in content else content["columns"]
        if content.get("boat_daq_import", 1) != 1 or not all(isinstance(v, str) for v in columns.values()):
            raise ValueError("unknown version or a column that is not text")
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        cause = f"{path} is not an import profile ({error})"
        raise FileError(cause, "Keep the output of import --preview --json.") from error
    return dict(columns)


Place = Callable[[Mapping[str, FloatArray], Mapping[str, FloatArray]], tuple[float, float]]


def import_csv(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    profile: str | Path | None = None,
    rate_hz: float | None = None,
    separator: str | None = None,
    skip: int | None = None,
    signals_only: bool = False,
    stated: Mapping[str, Any] | None = None,
) -> Recording:
    """Import a table as a recording.

    Parameters
    ----------
    columns : NAME -> "COLUMN[*SCALE][+OFFSET][:UNIT]"; COLUMN is a name or a number from 1; "" for no column.
    rate_hz : sampling rate in place of a column of the time.
    profile : a saved map (`save_profile`); `columns` overrides it.
    separator : column separator, " " for white space; found when None.
    skip : lines above the table.
    signals_only : allow a file without pressure, which is NaN then.
    stated : metadata of an export of ours, where its sidecar is not beside it.

    Raises
    ------
    FileError : not a table of numbers.
    RequestError : a column or unit of the map does not exist; no pressure, signal or time was recognised.
    DataError : time falls, or is none; the message names the line.
    """
    path = Path(path)
    wanted = {**(load_profile(profile) if profile else {}), **(columns or {})}
    if rate_hz is not None and wanted.get("time_s"):
        raise RequestError("both a rate and a column of the time are given", "Omit one of them.")
    if rate_hz is not None:
        wanted["time_s"] = ""
    spared = ({"time_s"} if rate_hz is not None else set()) | ({"pressure_kpa"} if signals_only else set())
    values, meta = _run_values(path, wanted, spared, rate_hz, separator, skip, stated)
    return _assembled(values, meta | {"import_columns": wanted}, path)


def import_two(
    first: Path,
    second: Path,
    *,
    columns: Mapping[str, str] | None = None,
    place: Place | None = None,
    offset_s: float | None = None,
) -> Recording:
    """Import two files of one run, at the times of that with the signals, the other interpolated.

    `columns`: mapping of `import_csv`; each name is sought in both files, a number is a column of the first. `place`:
    function of the values of both that returns when the second begins, in the first's time, and its standard
    uncertainty; used where the stamps of both files do not tell. `offset_s`: begin of the second file in the first's
    time, where it is known.
    """
    found, refused = [], []
    for path, numbers in ((first, True), (second, False)):
        try:
            wanted = _of_this_file(path, columns or {}, numbers=numbers)
            found.append(_run_values(path, wanted, {"pressure_kpa", "s1_mv"}, None, None, None, None))
        except RequestError as error:
            refused.append(error)
    if refused:
        causes, remedies = zip(*((error.cause, error.remedy) for error in refused), strict=True)
        raise RequestError("; ".join(causes), " ".join(dict.fromkeys(remedies)))
    (one, meta), (two, second_meta) = found
    both = f"{first.name} and {second.name}"
    if not ("pressure_kpa" in {*one, *two} and any(map(is_signal, {*one, *two}))):
        issues = [issue for each in (meta, second_meta) for issue in each.get("import_issues", ())]
        raise DataError("; ".join([f"{both} have not both a pressure and a signal", *issues]), "Map the columns.")
    u_s, how = 0.0, "as stated"
    if offset_s is None and (offset_s := _absolute_offset(meta, second_meta)) is not None:
        u_s = float(np.hypot(meta["import_stamps_s"], second_meta["import_stamps_s"]) / np.sqrt(12.0))
        how = "by their stamps, of which only the resolution is assessed, not how far the two clocks differ"
    if offset_s is None:
        if place is None:
            raise DataError(f"{both} have no common clock", "Give files with dates.")
        (offset_s, u_s), how = place(one, two), "by cross-correlation"
    two["time_s"] = two["time_s"] - two["time_s"][0] + offset_s
    one["time_s"] = one["time_s"] - one["time_s"][0]
    values = _joined(one, two, both)
    notes = [*meta.pop("import_notes", ()), *second_meta.get("import_notes", ())]
    text = f"{second.name} begins {offset_s:+z.4f} s after {first.name}, {how}, standard uncertainty {u_s:.2g} s"
    issues = [*meta.pop("import_issues", ()), *second_meta.get("import_issues", ())]
    meta |= {
        "imported_from": f"{first.name}, {second.name}", "import_files": [first.name, second.name],
        "import_columns": dict(columns or {}), "import_offset_s": offset_s, "import_offset_u_s": u_s,
        "import_notes": [text, *notes], **({"import_issues": issues} if issues else {}),
    }  # fmt: skip
    return _assembled(values, meta, first)


def _of_this_file(path: Path, columns: Mapping[str, str], *, numbers: bool) -> dict[str, str]:
    """Return the entries of a map whose columns a file has; a number is of the first file."""
    table = read_table(path, whole_lines=True)
    return {
        name: text
        for name, text in columns.items()
        if has_column(table, text) and (numbers or not text.partition(":")[0].strip().isdigit())
    }


def _absolute_offset(first: Mapping[str, Any], second: Mapping[str, Any]) -> float | None:
    """Return when the second file begins after the first by their dates or seconds since 1970, s; None without."""
    begins = [meta.get("import_begins") for meta in (first, second)]
    if None in begins:
        return None
    one, two = (datetime.fromisoformat(str(begin)) for begin in begins)
    return (two - one).total_seconds()


def _joined(one: dict[str, FloatArray], two: dict[str, FloatArray], both: str) -> dict[str, FloatArray]:
    """Return the columns of both files at the times of that which has signals, the first where both have."""
    main, other = (one, two) if any(map(is_signal, one)) else (two, one)
    values, number = dict(main), 1 + sum(name.endswith("_mv") for name in main)
    for name, column in other.items():
        if (
            name in (*PLAIN, "time_s")
            or (name == "pressure_kpa" and name in values)
            or name.endswith(("_lit", "_dark"))
        ):
            continue
        own = name
        if name.endswith("_mv") and name in values:
            own, number = f"s{number}_mv", number + 1
        values[own] = clocks.onto(main["time_s"], other["time_s"], column)
    added = [np.isfinite(values[name]) for name in values if name not in main]
    rows = np.logical_or.reduce(added) if added else np.zeros(main["time_s"].size, bool)
    if not rows.any() or "pressure_kpa" not in values or not any(map(is_signal, values)):
        missing = "no time in common" if added and not rows.any() else "not both a pressure and a signal"
        raise DataError(f"{both} have {missing}", "Map the columns, or give the files of one run.")
    return {name: column[rows] for name, column in values.items()}


def preview(
    path: str | Path,
    columns: Mapping[str, str] | None = None,
    rows: int = 5,
    *,
    separator: str | None = None,
    skip: int = 0,
) -> dict[str, Any]:
    """Return what the importer sees: dialect, columns, map, first rows, warnings; an incomplete map is no error."""
    table = _described(Path(path), read_table(path, separator, skip=skip, whole_lines=True), None)
    mapping, left_out = too_many_sensors(table, map_columns(table, columns, tolerant=True))
    by_position = {column.position: (name, column.unit) for name, column in mapping.columns.items()}
    by_position |= {position: ("channel", channel.unit) for position, channel in mapping.channels.items()}
    return {
        "encoding": table.dialect.form or table.dialect.encoding,
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
        "missing": mapping.missing,
        "notes": [*(warning.text for warning in mapping.warnings), *filter(None, [left_out])],
        "issues": [warning.text for warning in table.warnings],
        "warnings": [json_object(warning) for warning in (*mapping.warnings, *table.warnings)],
        "broken_rows": table.broken,
        "masked_cells": table.masked,
    }  # fmt: skip


def _run_values(
    path: Path,
    columns: Mapping[str, str],
    spared: set[str],
    rate_hz: float | None,
    separator: str | None,
    skip: int | None,
    stated: Mapping[str, Any] | None,
) -> tuple[dict[str, FloatArray], dict[str, Any]]:
    """Return the columns of a file in our units, on one rising clock, and its metadata; `spared` need not be there."""
    table = _described(path, read_table(path, separator, skip=skip or 0, whole_lines=True), stated)
    mapping = map_columns(table, columns)
    missing = [name for name in mapping.missing if name not in spared]
    if missing:
        raise unmapped(path.name, missing, mapping, table, alone="s1_mv" not in spared)
    mapping, left_out = too_many_sensors(table, mapping)
    options = {"import_separator": separator, "import_skip": skip}
    meta = _meta(table, mapping, path) | {key: value for key, value in options.items() if value}
    if left_out:
        _note(meta, left_out)
    values = {name: column.values(table) for name, column in mapping.columns.items()}
    values |= {f"{CHANNEL}{at}": table.columns[at] for at in mapping.channels}
    if "time_s" in values:
        values, keep = _on_one_clock(path, table, mapping, values, meta)
        if begins := _begins(table, column := mapping.columns["time_s"], values["time_s"][keep]):
            meta["import_begins"] = begins
            stamps = table.stamps.get(column.position)
            meta["import_stamps_s"] = clocks.resolution(column.values(table) if stamps is None else stamps.seconds)
    else:
        meta["import_rate_hz"] = rate_hz = rate_hz or (1.0 / mapping.interval_s if mapping.interval_s else None)
        values["time_s"] = np.arange(table.rows) / float(rate_hz or 1.0)
        keep = np.ones(table.rows, dtype=bool)
    if not keep.any():
        raise DataError(f"{path.name} holds no row with a time", "Check the column map.")
    if mapping.channels:
        meta["channels"] = [list(channel) for channel in mapping.channels.values()]
    return _filled({name: column[keep] for name, column in values.items()}, table, mapping, meta), meta


def _begins(table: Table, column: Column, time_s: FloatArray) -> str:
    """Return the date and time of the first row where stamps or seconds since 1970 tell it, else ""."""
    stamps = table.stamps.get(column.position)
    if stamps is not None and stamps.midnight:
        first = float(stamps.seconds[np.isfinite(stamps.seconds)][0] + time_s[0])
        return (datetime.fromisoformat(stamps.midnight) + timedelta(seconds=first)).isoformat()
    if stamps is None and time_s.size and _SINCE_1970[0] < time_s[0] < _SINCE_1970[1]:
        return (datetime(1970, 1, 1) + timedelta(seconds=float(time_s[0]))).isoformat()
    return ""


def _assembled(values: dict[str, FloatArray], meta: dict[str, Any], path: Path) -> Recording:
    """Return the recording of columns in our units."""
    if "simulated" in values:
        meta["simulated"] = bool(np.nanmax(values["simulated"]) > 0)
    channels = [column for name, column in values.items() if name.startswith(CHANNEL)]
    if "elongation_mm" in values:
        stated = ExtraChannel("displacement", "mm")
        meta |= {"elongation_channel": stated.column, "channels": [*meta.get("channels", ()), list(stated)]}
        channels.append(values["elongation_mm"])
        _note(meta, "the displacement column is the elongation: means of the plateaus, no readings are needed")
    signal, lit, dark = _signals(values, meta)
    whole = _whole_numbers(values, meta)
    pressure = values.get("pressure_kpa", np.full(signal.shape[0], np.nan))
    return Recording.from_arrays(
        values["time_s"] - values["time_s"][0], pressure, signal, lit=lit, dark=dark,
        **({"target_kpa": values["target_kpa"]} if "target_kpa" in values else {}), **whole, meta=meta,
        channel=np.stack(channels, axis=1) if channels else None,
        source=str(path),
    )  # fmt: skip


def _on_one_clock(
    path: Path, table: Table, mapping: ColumnMap, values: dict[str, FloatArray], meta: dict[str, Any]
) -> tuple[dict[str, FloatArray], BoolArray]:
    """Return the columns with one clock that never falls, and the rows to keep: with a time, each once."""
    column = mapping.columns["time_s"]
    time_s = _rising(path, table, column, values.get("segment"), meta)
    for own, names in {
        own: [name for name, clock in mapping.clocks.items() if clock == own] for own in mapping.clocks.values()
    }.items():
        try:
            values |= _from_other_clock(table, column, own, {name: values[name] for name in names}, time_s, meta)
        except (DataError, RequestError):
            if not mapping.time_stated:
                raise
    known = np.flatnonzero(np.isfinite(time_s))
    steps = np.diff(time_s[known])
    coarse = clocks.spread(time_s[known]) if _differ_where_time_stands(steps, known, values) else None
    if coarse is not None:
        time_s = time_s.copy()
        time_s[known] = coarse
        apart = float(np.median(steps[steps > 0]))
        _note(meta, f"stamps of column {table.names[column.position]!r} are {apart:g} s apart: "
                    "rows spread evenly between them; --rate HZ states the rate")  # fmt: skip
    keep = np.isfinite(time_s)
    keep[known[1:][np.diff(time_s[known]) == 0]] = False
    if reason := clocks.refusal(time_s[keep]):
        cause = f"{path.name}: column {table.names[column.position]!r} is not the clock of a run: {reason}"
        raise DataError(cause, f"State its unit: --map time_s={column.position + 1}:UNIT, or map another column.")
    repeated = int((~keep).sum())
    if repeated:
        meta["repeated_times"] = repeated
        _note(meta, f"{repeated} rows left out: no time, or that of the row before")
    if not (moved := [values[name] for name in mapping.clocks if name == "pressure_kpa" or is_signal(name)]):
        return values | {"time_s": time_s}, keep
    inside = np.logical_and.reduce([np.isfinite(values) for values in moved])
    rows = np.flatnonzero(inside)
    if rows.size:  # before and after the other clock nothing is known
        keep[: rows[0]] = keep[rows[-1] + 1 :] = False
    return values | {"time_s": time_s}, keep


def _rising(path: Path, table: Table, column: Column, segment: FloatArray | None, meta: dict[str, Any]) -> FloatArray:
    """Return the times of a column, unwrapped, its segments end to end; refused where it falls otherwise."""
    time_s = column.values(table)
    rows = np.flatnonzero(np.isfinite(time_s))
    if not rows.size:
        remedy = "Map another column, or state the rate of the rows (--rate HZ)."
        raise DataError(f"{path.name}: the time column holds no numbers", remedy)
    title = table.names[column.position]
    stamps = table.stamps.get(column.position)
    if stamps is not None and stamps.midnight and not stamps.zone:
        time_s, jumps = clocks.without_summer_time(time_s, float(stamps.seconds[np.isfinite(stamps.seconds)][0]))
        if jumps:
            _note(meta, f"the clock {title!r} jumps by an hour at a full hour, as where summer time begins: taken out")
    begins = np.flatnonzero(np.diff(segment[rows]) != 0) + 1 if segment is not None else np.zeros(0, np.int64)
    fallen = [at for at in begins if time_s[rows[at]] < time_s[rows[at - 1]]]
    if fallen:
        time_s, steps = time_s.copy(), np.diff(time_s[rows])
        interval = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
        for at in fallen:
            time_s[rows[at:]] += time_s[rows[at - 1]] + interval - time_s[rows[at]]
        _note(meta, f"the clock {title!r} begins again in {len(fallen)} segments: laid end to end")
    steps = np.diff(time_s[rows])
    falling = np.flatnonzero(steps < 0)
    if not falling.size:
        return time_s
    found = clocks.unwrapped(time_s, column.factor)
    if found is None:
        row = int(rows[falling[0] + 1])
        raise DataError(
            f"{path.name}, line {line_of_row(path, table.dialect, row)}: time falls from {time_s[rows[falling[0]]]:g} "
            f"to {time_s[row]:g} s ({falling.size} times in all)",
            "Split the file where the clock restarts, or map another column as time.",
        )
    _note(meta, f"the clock {title!r} begins again at {found[1]:.10g} s: unwrapped, {falling.size} times")
    return found[0]


def _from_other_clock(
    table: Table, main: Column, own: Column, values: Mapping[str, FloatArray], time_s: FloatArray, meta: dict[str, Any]
) -> dict[str, FloatArray]:
    """Return columns of another clock, interpolated at the times of the run; refused where the clocks have no overlap.

    Stamps are compared as such; numbers as they are.
    """
    titles = [table.names[column.position] for column in (main, own)]
    what = f"clocks in columns {main.position + 1} ({titles[0]}) and {own.position + 1} ({titles[1]})"
    remedy = f"Map one of them: --map time_s={main.position + 1}, or import the halves apart and together as two files."
    stamps = [table.stamps.get(column.position) for column in (main, own)]
    if (stamps[0] is None) != (stamps[1] is None):
        raise RequestError(f"two {what} of different kinds", remedy)
    own_s = own.values(table)
    if stamps[0] is not None and stamps[1] is not None:
        days = _days_between(stamps[0].midnight, stamps[1].midnight)
        firsts = [float(s.seconds[np.isfinite(s.seconds)][0]) for s in stamps if s is not None]
        own_s = own_s + firsts[1] - firsts[0] + clocks.DAY_S * days
    order = np.isfinite(own_s)
    if (np.diff(own_s[order]) < 0).any():
        raise DataError(f"of the two {what} the second falls", remedy)
    moved = {name: clocks.onto(time_s, own_s, column) for name, column in values.items()}
    if not all(np.isfinite(column).any() for column in moved.values()):
        raise DataError(f"the two {what} have no time in common", remedy)
    known = order & np.isfinite(time_s)
    if known.any() and np.array_equal(own_s[known], time_s[known]):
        return dict(values)
    moved_titles = [
        table.names[int(name.removeprefix(CHANNEL))] if name.startswith(CHANNEL) else name for name in values
    ]
    _note(meta, f"two {what}: {', '.join(moved_titles)} interpolated at the times of the first")
    return moved


def _days_between(first: str, second: str) -> int:
    return (date.fromisoformat(second) - date.fromisoformat(first)).days if first and second else 0


def _differ_where_time_stands(steps: FloatArray, rows: IntArray, values: Mapping[str, FloatArray]) -> bool:
    """Return whether rows that repeat a time have other signals than the row before: then they are no repeats."""
    same = np.flatnonzero(steps == 0)
    if not same.size:
        return False
    signals = [column[rows] for name, column in values.items() if is_signal(name)]
    differ = np.logical_or.reduce([column[same + 1] != column[same] for column in signals])
    return float(differ.mean()) > clocks.COARSE


def _filled(
    values: dict[str, FloatArray], table: Table, mapping: ColumnMap, meta: dict[str, Any]
) -> dict[str, FloatArray]:
    """Return the columns with those of a lower rate interpolated; only their rows, where all have the same ones."""
    measured = [name for name in values if name == "pressure_kpa" or name.endswith("_mv")]
    periods = {name: clocks.sparse_period(values[name]) for name in measured}
    known = {name: np.isfinite(values[name]) for name in measured}
    time_s = values["time_s"]
    if measured and all(periods.values()) and all(np.array_equal(known[name], known[measured[0]]) for name in measured):
        _note(meta, f"{int((~known[measured[0]]).sum())} rows without values left out")
        return {name: column[known[measured[0]]] for name, column in values.items()}
    for name in measured:
        title = table.names[mapping.columns[name].position]
        if periods[name]:
            values[name] = clocks.onto(time_s, time_s, values[name])
            _note(meta, f"column {title!r} has a value in one row of {periods[name]} only: interpolated between them")
        elif held := clocks.held_period(values[name]):
            text = f"column {title!r} holds each value for {held} rows: its rate is lower than that of the file"
            if name == "pressure_kpa":
                values[name] = clocks.interpolated_holds(time_s, values[name], held)
                text += "; interpolated between them"
            _note(meta, text)
    return values


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
        cause = f"vref_mv {meta['vref_mv']!r} and adc_bits {meta['adc_bits']!r} are not numbers"
        raise RequestError(cause, "Correct the head of the file.") from error


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
    if mapping.signal_unit != "mV":
        meta["signal_unit"] = mapping.signal_unit
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


def _described(path: Path, table: Table, stated: Mapping[str, Any] | None) -> Table:
    """Return the table of an export of ours with the metadata in or beside it, or stated, as comments."""
    dialect, beside = table.dialect, path.with_suffix(".json")
    if stated is not None:
        text = json.dumps({"session": {key: stated.get(key) for key in (*META_KEYS, "channels")}})
    elif not dialect.form and "index" in table.names and beside.is_file():
        text = read_regular(beside, MAX_SIDECAR_BYTES).decode("utf-8", errors="replace")
    else:
        text = dialect.description
    return replace(table, dialect=replace(dialect, comments=(*dialect.comments, *own_comments(text))))


def own_comments(text: str) -> tuple[str, ...]:
    """Return session and channels of the description in or beside an export of ours as comments of a text file."""
    try:
        session = dict(json.loads(text)["session"]) if text else {}
        channels = [ExtraChannel(*channel) for channel in session.get("channels") or ()]
    except (ValueError, TypeError, KeyError):
        return ()
    stated = [f"{key}: {json.dumps(value)}" for key, value in session.items() if isinstance(value, str | int | float)]
    return (*stated, *(f"channel {channel.column}: {channel.quantity}" for channel in channels))
