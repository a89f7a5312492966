"""Tables in files that are no text: Excel, MATLAB, HDF5, Parquet, told by their first bytes.

A sheet is read as the text that it shows. Of the arrays in other files those of the commonest length are the columns,
named by variable, field or dataset; a matrix has a column for each of its narrow side.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from analysis.data.clocks import Stamps, read_stamps
from analysis.data.column_names import recognised, split_unit
from protocol.base.errors import FileError, RequestError
from protocol.base.optional import optional
from protocol.base.units import conversion

_HEAD_BYTES = 600
_HDF5 = b"\x89HDF\r\n\x1a\n"
_KINDS = ((b"PK\x03\x04", "Excel"), (b"\xd0\xcf\x11\xe0", "Excel"), (b"PAR1", "Parquet"), (_HDF5, "HDF5"),
          (b"MATLAB 5.0 MAT-file", "MATLAB"), (b"MATLAB 7.3 MAT-file", "HDF5"))  # fmt: skip
_WIDEST = 64  # columns of a matrix
FEWEST_ROWS = 3
_NUMBER = re.compile(r"[+-]?[\d.,']*\d[\d.,']*(?:[eE][+-]?\d+)?")
_SINCE = re.compile(r"(\w+) since (\d{4}-\d\d-\d\d(?:[T ]\d\d:\d\d(?::\d\d(?:\.\d+)?)?)?).*")  # CF conventions
_UNIT_KEYS = ("units", "unit", "Units", "Unit", "unit_string")
_LABEL_KEYS = ("columns", "column_names", "channel_names", "channels", "labels", "names", "header", "fields")
_RATE_KEYS = ("sample_rate", "sampling_rate", "sample_rate_hz", "SampleRate", "rate_hz", "fs")
_INTERVAL_KEYS = ("wf_increment", "dt", "interval_s", "sample_interval")
_VALUE_NAMES = ("value", "values", "data")  # of an array in a group that is named by the quantity


@dataclass(frozen=True)
class FileColumns:
    """Columns of a file: titles, units, values [n]; stamps by position; the description of an export of ours."""

    kind: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[npt.NDArray[np.float64], ...]
    stamps: Mapping[int, Stamps] = field(default_factory=dict)
    description: str = ""  # JSON of an export of ours
    left_out: str = ""  # arrays of another length
    interval_s: float = 0.0  # between rows, of a file without times


def kind_of(path: Path) -> str:
    """Return the kind of a file that is no text: Excel, MATLAB, HDF5 or Parquet; empty for any other."""
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    return next((kind for mark, kind in _KINDS if head.startswith(mark)), "")


def sheet_text(path: Path) -> tuple[str, str]:
    """Return the sheet with the most numbers as comma separated text, and its name where there are others."""
    calamine = optional("python_calamine")
    try:
        book = calamine.CalamineWorkbook.from_path(str(path))
        sheets = {name: book.get_sheet_by_name(name).to_python(skip_empty_area=False) for name in book.sheet_names}
    except (calamine.CalamineError, OSError, ValueError) as error:
        raise FileError(f"{path.name} is not a readable workbook: {error}", "Save it again as .xlsx.") from error
    numbers = {name: sum(_is_number(cell) for row in rows for cell in row) for name, rows in sheets.items()}
    name = max(numbers, key=lambda sheet: numbers[sheet], default="")
    if not numbers.get(name):
        raise FileError(f"{path.name} holds no sheet with numbers", "Choose another workbook.")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([_shown(cell) for cell in row] for row in sheets[name])
    return text.getvalue(), name if len(sheets) > 1 else ""


def _is_number(cell: Any) -> bool:
    return isinstance(cell, float | int) or (isinstance(cell, str) and _NUMBER.fullmatch(cell.strip()) is not None)


def _shown(cell: Any) -> str:
    if isinstance(cell, datetime):
        return cell.isoformat(" ", "microseconds")
    if isinstance(cell, timedelta):
        return repr(cell.total_seconds())
    if isinstance(cell, time | date):
        return cell.isoformat()
    return repr(cell) if isinstance(cell, float) else str(cell).replace("\n", " ")


def read_columns(path: Path, kind: str) -> FileColumns:
    """Return the columns of a file of MATLAB, HDF5 or Parquet. FileError: it holds none, or cannot be read."""
    try:
        content = {"MATLAB": _mat, "HDF5": _hdf5, "Parquet": _parquet}[kind](path)
    except RequestError:
        raise
    except Exception as error:  # of a damaged file these libraries raise whatever comes
        cause = f"{path.name} cannot be read as {kind}: {error}"
        raise FileError(cause, "Save it again, or export it as CSV.") from error
    columns = {name: part for title, array in content.arrays for name, part in content.split(title, array)}
    names, n = _of_one_run(columns)
    if not names:
        cause = f"{path.name} holds no arrays of numbers; tables and objects of MATLAB cannot be read"
        raise FileError(cause, "Save the columns as arrays, or the table as CSV.")
    chosen = {name: _padded(columns[name], n) for name in names}
    titles, stated = zip(*map(split_unit, _short(names)), strict=True)
    stamps = {at: _stamps(c) for at, c in enumerate(chosen.values()) if np.issubdtype(c.dtype, np.datetime64)}
    values = tuple(
        stamps[at].seconds - stamps[at].seconds[0] if at in stamps else np.asarray(column, np.float64)
        for at, column in enumerate(chosen.values())
    )
    by_title = tuple(
        "s" if at in stamps else content.units.get(name, "") or in_title
        for at, (name, in_title) in enumerate(zip(chosen, stated, strict=True))
    )
    left = [f"{name} ({column.size})" for name, column in columns.items() if name not in chosen]
    out = f"arrays of another length than {n}, without times of their own, left out: {', '.join(left)}" if left else ""
    return FileColumns(kind, titles, by_title, values, stamps, content.description, out, content.interval_s)


def _of_one_run(columns: Mapping[str, npt.NDArray[Any]]) -> tuple[list[str], int]:
    """Return the names of the arrays of a run, the times of a group first, and the number of rows.

    They are those of the commonest length, or of all groups that have times of their own if these have several rates.
    """
    lengths = Counter(column.size for column in columns.values() if column.size >= FEWEST_ROWS)
    if not lengths:
        return [], 0
    n = max(lengths, key=lambda size: (lengths[size], size))
    clocks = {_group(name): column.size for name, column in columns.items() if "/" in name and _is_time(name)}
    names = [name for name, column in columns.items() if column.size == n]
    if len(set(clocks.values())) > 1:
        names = [name for name, column in columns.items() if clocks.get(_group(name)) == column.size]
    names.sort(key=lambda name: (_group(name), not _is_time(name)) if "/" in name else ("", False))
    return names, max(columns[name].size for name in names)


def _group(name: str) -> str:
    return name.rpartition("/")[0]


def _padded(column: npt.NDArray[Any], n: int) -> npt.NDArray[Any]:
    """Return a column of n rows, the last ones without a value."""
    if column.size == n:
        return column
    stamps = np.issubdtype(column.dtype, np.datetime64)
    return np.concatenate([column, np.full(n - column.size, np.datetime64("NaT") if stamps else np.nan)])


def _stamps(column: npt.NDArray[Any]) -> Stamps:
    midnight = column[0].astype("datetime64[D]")
    seconds = (column - midnight) / np.timedelta64(1, "ns") * 1e-9
    return Stamps(np.asarray(seconds, np.float64), "dates and times", str(midnight))


def _short(names: list[str]) -> tuple[str, ...]:
    """Return the last parts of names such as `out/signals/values`, whole where they would not differ but for clocks."""
    split = [name.split("/") for name in names]
    last = [parts[-2] if parts[-1] in _VALUE_NAMES and len(parts) > 1 else parts[-1] for parts in split]
    pairs = zip(last, names, strict=True)
    return tuple(short if last.count(short) == 1 or _is_time(name) else name for short, name in pairs)


def _is_time(name: str) -> bool:
    """Return whether a name such as `run/pressure/time` is that of a clock, of the columns in its group."""
    return recognised(*split_unit(name.rpartition("/")[2])) == "time_s"


@dataclass
class Content:
    """Arrays of a file by title, labels of the columns of matrices, units by title or label."""

    arrays: list[tuple[str, npt.NDArray[Any]]] = field(default_factory=list)
    units: dict[str, str] = field(default_factory=dict)
    labels: dict[str, list[str]] = field(default_factory=dict)
    description: str = ""
    interval_s: float = 0.0

    def split(self, title: str, array: npt.NDArray[Any]) -> Iterator[tuple[str, npt.NDArray[Any]]]:
        """Yield an array as columns: a vector, or the narrow side of a matrix, named by its labels."""
        array = np.squeeze(array)
        numeric = np.issubdtype(array.dtype, np.number) or array.dtype == bool or array.dtype.kind == "M"
        if array.dtype.names:
            for name in array.dtype.names:
                yield from self.split(f"{title}/{name}", array[name])
        elif array.ndim == 1 and numeric and not np.iscomplexobj(array):
            yield title, array
        elif array.ndim == 2 and numeric and min(array.shape) <= _WIDEST and not np.iscomplexobj(array):
            names = self.labels.get(title, [])
            columns = array.T if array.shape[0] >= array.shape[1] else array
            if len(names) != len(columns):
                names = [f"{title}_{k}" for k in range(1, len(columns) + 1)]
            else:
                names = [f"{_group(title)}/{name}".lstrip("/") for name in names]
            yield from zip(names, columns, strict=True)


def _mat(path: Path) -> Content:
    from scipy.io import loadmat

    content = loadmat(str(path), squeeze_me=True, struct_as_record=False)
    units = {name: str(unit) for name, unit in vars(content.pop("units", object())).items()} if (
        hasattr(content.get("units"), "_fieldnames")) else {}  # fmt: skip
    found = Content(units=units, description=str(content.pop("boat_daq", "")))
    _of_fields(found, "", {name: value for name, value in content.items() if not name.startswith("__")})
    return found


def _of_fields(found: Content, name: str, fields: Mapping[str, Any]) -> None:
    """Add the arrays of a structure; those of Simulink's signals are named by their label."""
    stated = fields.get("label", "")
    label = stated.strip() if isinstance(stated, str) else ""  # an empty one is an empty array
    texts = [np.asarray(fields[key]) for key in _LABEL_KEYS if key in fields]
    labels = [[str(text) for text in array] for array in texts if array.dtype.kind in "UO" and array.ndim == 1]
    for key, value in fields.items():
        own = f"{name}/{label if key == 'values' and label else key}".lstrip("/")
        if labels and isinstance(value, np.ndarray) and value.ndim == 2:
            found.labels[own] = labels[0]
        _of_struct(found, own, value)


def _of_struct(found: Content, name: str, value: Any) -> None:
    names = getattr(value, "_fieldnames", None)
    if names is not None:
        _of_fields(found, name, {key: getattr(value, key) for key in names})
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for k, part in enumerate(value.ravel(), 1):
            _of_struct(found, f"{name}{k}", part)
    elif isinstance(value, np.ndarray) and value.dtype.kind not in "USO":
        found.arrays.append((name, value))


def _hdf5(path: Path) -> Content:
    h5py = optional("h5py")
    found = Content()
    intervals: dict[str, float] = {}
    with h5py.File(path, "r") as file:

        def visit(name: str, item: Any) -> None:
            if not isinstance(item, h5py.Dataset) or "#refs#" in name:
                return
            if name == "boat_daq" and item.shape == ():
                found.description = item.asstr()[()]
            elif item.dtype.kind in "iufbV" and item.size >= FEWEST_ROWS and item.attrs.get("MATLAB_class") != b"char":
                _of_dataset(found, name, item, file.get(name.removesuffix("values") + "items"))
                if interval := _interval(item.attrs):
                    intervals[name] = interval
            elif item.dtype == h5py.ref_dtype:  # cells and structures of MATLAB 7.3
                for k, ref in enumerate(item[()].ravel(), 1):
                    inner = file[ref]
                    if isinstance(inner, h5py.Dataset) and inner.dtype.kind in "iuf":
                        found.arrays.append((f"{name}{k}", inner[()]))

        file.visititems(visit)
    if intervals and not any(_is_time(name) for name, _ in found.arrays):
        _with_intervals(found, intervals)
    return found


def _of_dataset(found: Content, name: str, item: Any, items: Any) -> None:
    """Add a dataset with units and labels; `items` are the titles that pandas keeps beside the values of a frame."""
    values, attrs = item[()], item.attrs
    texts = [np.atleast_1d(attrs[key]) for key in _LABEL_KEYS if key in attrs] + (
        [items[()]] if items is not None else []
    )
    labels = next(([_word(text) for text in array] for array in texts if array.ndim == 1), [])
    units = np.atleast_1d(next((attrs[key] for key in _UNIT_KEYS if key in attrs), ""))
    if name.endswith("axis1") and "axis0" in item.parent:  # the index of a frame
        if _word(attrs.get("kind", "")).startswith("datetime64"):
            name, values = f"{_group(name)}/time", values.astype("int64").view("datetime64[ns]")
        else:
            name = f"{_group(name)}/{_word(attrs['name']) if attrs.get('name') is not None else 'axis1'}"
    elif since := _SINCE.fullmatch(_word(units[0])):
        factor = conversion(since[1], "s")
        if factor is not None and values.dtype.kind in "iuf":
            values = np.datetime64(since[2], "ns") + np.round(values * (factor[0] * 1e9)).astype("timedelta64[ns]")
    found.arrays.append((name, values))
    found.labels[name] = labels
    if len(units) == len(labels):
        found.units |= {f"{_group(name)}/{label}".lstrip("/"): _word(u) for label, u in zip(labels, units, strict=True)}
    else:
        found.units[name] = _word(units[0])


def _interval(attrs: Mapping[str, Any]) -> float:
    """Return the interval of the rows of a dataset that its attributes state, s; 0 without one."""
    rates = [1.0 / float(attrs[key]) for key in _RATE_KEYS if key in attrs and np.size(attrs[key]) == 1]
    return next(iter([*rates, *(float(attrs[key]) for key in _INTERVAL_KEYS if key in attrs)]), 0.0)


def _with_intervals(found: Content, intervals: Mapping[str, float]) -> None:
    """Give each dataset the times of its rate; the one interval of all is that of the rows."""
    if len(set(intervals.values())) == 1:
        found.interval_s = next(iter(intervals.values()))
        return
    for at, (name, values) in enumerate(found.arrays):
        if name in intervals:
            found.arrays[at] = (f"{name}/value", values)
            found.units[f"{name}/value"], found.units[f"{name}/time"] = found.units.get(name, ""), "s"
            found.arrays.append((f"{name}/time", np.arange(len(values)) * intervals[name]))


def _word(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _numbers(column: pd.Series[Any]) -> npt.NDArray[Any]:
    """Return a column of a frame with stamps of a zone and as text as those of UTC, and durations in s."""
    if isinstance(column.dtype, pd.DatetimeTZDtype):
        column = column.dt.tz_convert("UTC").dt.tz_localize(None)
    elif column.dtype.kind == "m":
        column = column.dt.total_seconds()
    elif column.dtype.kind not in "iufbM":
        stamps = read_stamps([str(cell) for cell in column])
        if stamps is not None and stamps.midnight:
            return np.datetime64(stamps.midnight, "ns") + np.round(stamps.seconds * 1e9).astype("timedelta64[ns]")
    return np.asarray(column.to_numpy())


def _parquet(path: Path) -> Content:
    parquet = optional("pyarrow.parquet")
    try:
        table = parquet.read_table(path)
    except optional("pyarrow").ArrowException as error:
        raise ValueError(str(error)) from error
    metadata = {_word(key): _word(value) for key, value in (table.schema.metadata or {}).items()}
    found = Content(description=metadata.get("boat_daq", ""))
    for column, entry in zip(table.columns, table.schema, strict=True):
        series = column.to_pandas()
        values, name = _numbers(series), entry.name
        if name.startswith("__index_level") and series.dtype.kind == "m":
            name = "time"  # an index of durations that has no name
        if values.dtype.kind in "iufbM":
            found.arrays.append((name, values))
        stated = {_word(key): _word(value) for key, value in (entry.metadata or {}).items()}
        found.units[name] = next((stated[key] for key in _UNIT_KEYS if key in stated), "")
        if series.dtype.kind == "m":
            found.units[name] = "s"
    return found
