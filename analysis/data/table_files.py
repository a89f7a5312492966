"""Tables in files that are no text: Excel, MATLAB, HDF5, Parquet, told by their first bytes.

A sheet is read as the text that it shows. Of the arrays in other files those of the commonest length are the columns,
named by variable, field or dataset; a matrix has a column for each of its narrow side.
"""

from __future__ import annotations

import csv
import io
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

_HEAD_BYTES = 600
_HDF5 = b"\x89HDF\r\n\x1a\n"
_KINDS = ((b"PK\x03\x04", "Excel"), (b"\xd0\xcf\x11\xe0", "Excel"), (b"PAR1", "Parquet"), (_HDF5, "HDF5"),
          (b"MATLAB 5.0 MAT-file", "MATLAB"), (b"MATLAB 7.3 MAT-file", "HDF5"))  # fmt: skip
_WIDEST = 64  # columns of a matrix
FEWEST_ROWS = 3
_UNIT_KEYS = ("units", "unit", "Units", "Unit", "unit_string")


@dataclass(frozen=True)
class FileColumns:
    """Columns of a file: titles, units, values [n]; stamps by position; the description of an export of ours."""

    kind: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[npt.NDArray[np.float64], ...]
    stamps: Mapping[int, Stamps] = field(default_factory=dict)
    description: str = ""  # JSON of an export of ours
    left_out: int = 0  # arrays of another length


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
        raise FileError(f"{path.name} is no readable workbook: {error}", "Save it again as .xlsx.") from error
    numbers = {name: sum(isinstance(c, float | int) for row in rows for c in row) for name, rows in sheets.items()}
    name = max(numbers, key=lambda sheet: numbers[sheet], default="")
    if not numbers.get(name):
        raise FileError(f"{path.name} holds no sheet with numbers", "Choose another workbook.")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([_shown(cell) for cell in row] for row in sheets[name])
    return text.getvalue(), name if len(sheets) > 1 else ""


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
        found, units, description = {"MATLAB": _mat, "HDF5": _hdf5, "Parquet": _parquet}[kind](path)
    except RequestError:
        raise
    except Exception as error:  # of a damaged file these libraries raise whatever comes
        cause = f"{path.name} cannot be read as {kind}: {error}"
        raise FileError(cause, "Save it again, or export it as CSV.") from error
    columns = {name: part for title, array in found for name, part in _split(title, array)}
    lengths = Counter(column.size for column in columns.values() if column.size >= FEWEST_ROWS)
    if not lengths:
        cause = f"{path.name} holds no arrays of numbers; tables and objects of MATLAB cannot be read"
        raise FileError(cause, "Save the columns as arrays, or the table as CSV.")
    n = max(lengths, key=lambda size: (lengths[size], size))
    names = [name for name, column in columns.items() if column.size == n]
    names.sort(key=lambda name: (name.rpartition("/")[0], not _is_time(name)) if "/" in name else ("", False))
    chosen = {name: columns[name] for name in names}
    titles, stated = zip(*map(split_unit, _short(list(chosen))), strict=True)
    stamps = {at: _stamps(c) for at, c in enumerate(chosen.values()) if np.issubdtype(c.dtype, np.datetime64)}
    values = tuple(
        stamps[at].seconds - stamps[at].seconds[0] if at in stamps else np.asarray(column, np.float64)
        for at, column in enumerate(chosen.values())
    )
    by_title = tuple(
        "s" if at in stamps else units.get(name, "") or in_title
        for at, (name, in_title) in enumerate(zip(chosen, stated, strict=True))
    )
    return FileColumns(kind, titles, by_title, values, stamps, description, len(columns) - len(chosen))


def _stamps(column: npt.NDArray[Any]) -> Stamps:
    midnight = column[0].astype("datetime64[D]")
    seconds = (column - midnight) / np.timedelta64(1, "ns") * 1e-9
    return Stamps(np.asarray(seconds, np.float64), "dates and times", str(midnight))


def _short(names: list[str]) -> tuple[str, ...]:
    """Return the last parts of names such as `out/signals/values`, whole where they would not differ but for clocks."""
    last = [name.rpartition("/")[2] for name in names]
    pairs = zip(last, names, strict=True)
    return tuple(short if last.count(short) == 1 or _is_time(name) else name for short, name in pairs)


def _is_time(name: str) -> bool:
    """Return whether a name such as `run/pressure/time` is that of a clock, of the columns in its group."""
    return recognised(*split_unit(name.rpartition("/")[2])) == "time_s"


def _split(title: str, array: npt.NDArray[Any]) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield an array as columns: a vector, or the narrow side of a matrix."""
    array = np.squeeze(array)
    numeric = np.issubdtype(array.dtype, np.number) or array.dtype == bool or array.dtype.kind == "M"
    if array.dtype.names:
        for name in array.dtype.names:
            yield from _split(f"{title}/{name}", array[name])
    elif array.ndim == 1 and numeric and not np.iscomplexobj(array):
        yield title, array
    elif array.ndim == 2 and numeric and min(array.shape) <= _WIDEST and not np.iscomplexobj(array):
        for k, column in enumerate(array.T if array.shape[0] >= array.shape[1] else array, 1):
            yield f"{title}_{k}", column


Found = tuple[list[tuple[str, npt.NDArray[Any]]], dict[str, str], str]


def _mat(path: Path) -> Found:
    from scipy.io import loadmat

    content = loadmat(str(path), squeeze_me=True, struct_as_record=False)
    units = {name: str(unit) for name, unit in vars(content.pop("units", object())).items()} if (
        hasattr(content.get("units"), "_fieldnames")) else {}  # fmt: skip
    description = str(content.pop("boat_daq", ""))
    found = [pair for name, value in content.items() if not name.startswith("__") for pair in _of_struct(name, value)]
    return found, units, description


def _of_struct(name: str, value: Any) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield the arrays of a structure; those of Simulink's signals are named by their label."""
    fields = getattr(value, "_fieldnames", None)
    if fields is not None:
        stated = getattr(value, "label", "")
        label = stated.strip() if isinstance(stated, str) else ""  # an empty one is an empty array
        for key in fields:
            named = label if key == "values" and label else key
            yield from _of_struct(f"{name}/{named}", getattr(value, key))
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for k, part in enumerate(value.ravel(), 1):
            yield from _of_struct(f"{name}{k}", part)
    elif isinstance(value, np.ndarray) and value.dtype.kind not in "USO":
        yield name, value


def _hdf5(path: Path) -> Found:
    h5py = optional("h5py")
    found: list[tuple[str, npt.NDArray[Any]]] = []
    units: dict[str, str] = {}
    own = ""
    with h5py.File(path, "r") as file:

        def visit(name: str, item: Any) -> None:
            nonlocal own
            if not isinstance(item, h5py.Dataset) or "#refs#" in name:
                return
            if name == "boat_daq" and item.shape == ():
                own = item.asstr()[()]
            elif item.dtype.kind in "iufbV" and item.size >= FEWEST_ROWS and item.attrs.get("MATLAB_class") != b"char":
                found.append((name, item[()]))
                units[name] = next((_word(item.attrs[key]) for key in _UNIT_KEYS if key in item.attrs), "")
            elif item.dtype == h5py.ref_dtype:  # cells and structures of MATLAB 7.3
                for k, ref in enumerate(item[()].ravel(), 1):
                    inner = file[ref]
                    if isinstance(inner, h5py.Dataset) and inner.dtype.kind in "iuf":
                        found.append((f"{name}{k}", inner[()]))

        file.visititems(visit)
    return found, units, own


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


def _parquet(path: Path) -> Found:
    parquet = optional("pyarrow.parquet")
    try:
        table = parquet.read_table(path)
    except optional("pyarrow").ArrowException as error:
        raise ValueError(str(error)) from error
    metadata = {_word(key): _word(value) for key, value in (table.schema.metadata or {}).items()}
    found: list[tuple[str, npt.NDArray[Any]]] = []
    units: dict[str, str] = {}
    for column, entry in zip(table.columns, table.schema, strict=True):
        values = _numbers(column.to_pandas())
        if values.dtype.kind in "iufbM":
            found.append((entry.name, values))
        stated = {_word(key): _word(value) for key, value in (entry.metadata or {}).items()}
        units[entry.name] = next((stated[key] for key in _UNIT_KEYS if key in stated), "")
    return found, units, metadata.get("boat_daq", "")
