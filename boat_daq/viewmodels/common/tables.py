"""Columns of a plot as a CSV file: text cells that a spreadsheet would run as a formula are neutralised."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

from analysis.numbers import neutral
from protocol.base.whole_file import write_whole


def cell(value: Any) -> str:
    """Return `value` as a CSV cell: numbers at full precision, text that begins like a formula behind an apostrophe."""
    if isinstance(value, str):
        return neutral(value)
    if value is None or value != value:
        return ""
    return repr(float(value)) if isinstance(value, float) or hasattr(value, "dtype") else str(value)


def by_column(names: Sequence[str], rows: Sequence[Sequence[Any]]) -> dict[str, list[Any]]:
    """Return rows as columns, name -> values; none without rows."""
    return {name: [row[i] for row in rows] for i, name in enumerate(names)} if rows else {}


def csv_text(columns: Mapping[str, Sequence[Any]]) -> str:
    """Return `columns` (name -> values) as CSV; shorter columns end in empty cells."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([cell(name) for name in columns])
    writer.writerows(map(cell, row) for row in zip_longest(*columns.values()))
    return out.getvalue()


def save_csv(path: Path, columns: Mapping[str, Sequence[Any]]) -> None:
    """Write `columns` to `path`."""
    write_whole(path, csv_text(columns))
