"""What the importer tells of a file whose columns it does not recognise, and what it may still tell by itself.

Rules: a hint names columns by their titles, or by what stands in them; an option it gives can be typed as it is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analysis.arrays import FloatArray
from analysis.data.csv_table import Table

if TYPE_CHECKING:
    from analysis.data.csv_columns import ColumnMap

MOST_LISTED = 20
USUAL_UNITS = {"time_s": "ms", "pressure_kpa": "bar", "s1_mv": "V"}


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
    """Return the unit that the size of the numbers speaks for."""
    finite = values[np.isfinite(values)]
    if name == "time_s":
        step = float(np.median(np.abs(np.diff(finite)))) if finite.size > 1 else 0.0
        return "s" if step < 2 else ("ms" if step < 1500 else "us")
    if name.endswith("_mv"):
        return "V" if finite.size and np.abs(finite).max() <= 10 else "mV"
    largest = float(np.abs(finite).max()) if finite.size else 0.0
    return "kPa" if largest < 1000 else "Pa"


def listed(table: Table) -> str:
    """Return the columns as a message names them: by their titles, or by what stands in them."""
    if table.dialect.header:
        return ", ".join(f"{i + 1} {name}" for i, name in enumerate(table.names[:MOST_LISTED]))
    shown = []
    for i, column in enumerate(table.columns[:MOST_LISTED]):
        known = column[np.isfinite(column)]
        shown.append(f"{i + 1} ({known.min():g} to {known.max():g})" if known.size else f"{i + 1} (text)")
    return ", ".join(shown)


def map_by_hand(missing: list[str], mapping: ColumnMap, table: Table) -> str:
    """Return the options that would map what is missing; what was recognised stands in full."""
    known = [
        f"--map {name}={column.position + 1}:{column.unit}" for name, column in mapping.columns.items() if column.unit
    ]
    wanted = {name: f"COLUMN:{USUAL_UNITS[name]}" for name in missing}
    time = time_without_header(table)
    if time is not None and "time_s" in wanted:
        wanted["time_s"] = f"{time + 1}:{guess_unit('time_s', table.columns[time])}"
    return " ".join([*known, *(f"--map {name}={column}" for name, column in wanted.items())])


def words_in(table: Table, position: int) -> str:
    """Say that a column holds text, with the first of it."""
    first = next((cell for cell in table.text[position] if cell), "")
    return f"column {table.names[position]!r} holds text like {first[:30]!r}, not numbers"
