"""What the importer tells of a file whose columns it does not recognise, and what it may still tell by itself.

Rules: a hint names columns by their titles, or by what stands in them; an option it gives can be typed as it is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analysis.csv_table import Table

if TYPE_CHECKING:
    from analysis.csv_import import ColumnMap

MOST_LISTED = 20
USUAL_UNITS = {"time_s": "ms", "pressure_kpa": "bar", "s1_mv": "V"}


def runs_like_time(table: Table, position: int) -> bool:
    """True for a column of numbers that never falls and is no mere count of the rows."""
    values = table.columns[position]
    if position in table.text or values.size < 3 or not np.isfinite(values).all():
        return False
    steps = np.diff(values)
    return bool((steps >= 0).all() and steps.any() and not (steps == 1).all())


def listed(table: Table) -> str:
    """Return the columns as a message names them: by their titles, or by what stands in them."""
    if table.dialect.header:
        return ", ".join(f"{i + 1} {name}" for i, name in enumerate(table.names[:MOST_LISTED]))
    shown = []
    for i, column in enumerate(table.columns[:MOST_LISTED]):
        known = column[np.isfinite(column)]
        shown.append(f"{i + 1} ({known.min():g} to {known.max():g})" if known.size else f"{i + 1} (text)")
    return ", ".join(shown)


def map_by_hand(missing: list[str], mapping: ColumnMap) -> str:
    """Return the options that would map what is missing; what was recognised stands in full."""
    known = [
        f"--map {name}={column.position + 1}:{column.unit}" for name, column in mapping.columns.items() if column.unit
    ]
    return " ".join([*known, *(f"--map {name}=COLUMN:{USUAL_UNITS[name]}" for name in missing)])


def words_in(table: Table, position: int) -> str:
    """Say that a column holds text, with the first of it."""
    first = next((cell for cell in table.text[position] if cell), "")
    return f"column {table.names[position]!r} holds text like {first[:30]!r}, not numbers"
