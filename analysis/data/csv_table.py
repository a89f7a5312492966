"""A table of numbers from a text file as it is found.

`analysis.data.csv_dialect` finds how the file is written; pandas reads the body at speed; only if that fails is the
file read line by line, to name the lines. A column of clock times becomes seconds since its first row: ISO 8601,
day.month.year, and hours:minutes:seconds; 3/4/2026 is ambiguous and stays text. A time of day that falls by more than
twelve hours passed midnight. Every cell that is not a number is counted, and the first ones are named by line.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from analysis.data.csv_dialect import MISSING, Dialect, cells_of, is_comment, number, records, sniff
from analysis.warning import Warning, WarningCode
from protocol.base.errors import FileError, RequestError

MOST_WARNINGS = 10
MAX_BAD_SHARE = 0.05  # more broken rows than this and the file was not understood
MOST_BROKEN = 10_000  # and more of them than whole rows: the rest is not read
DAY_S = 86_400.0
SHOWN_WORDS = 100  # cells of a text column that are tried as grouped numbers
# pandas 3 reads decimals to the nearest double by itself and deprecates the option that older ones need for it
_EXACT: dict[str, Any] = {} if int(pd.__version__.split(".")[0]) >= 3 else {"float_precision": "round_trip"}

_TIME = r"\d{1,2}:\d{2}:\d{2}(?:[.,]\d+)?"
_OF_DAY = re.compile(rf"^{_TIME}$")
_ISO = re.compile(rf"^\d{{4}}-\d{{2}}-\d{{2}}[T ]{_TIME}(?:Z|[+-]\d{{2}}:?\d{{2}})?$")
_DOTTED = re.compile(rf"^(\d{{1,2}})\.(\d{{1,2}})\.(\d{{4}}) ({_TIME})$")


@dataclass(frozen=True, slots=True)
class Table:
    """A read table: numeric columns by position, text columns apart.

    `names` are as in the header without units, or "1", "2", ... without one. `warnings` name lines, at most
    `MOST_WARNINGS` of them; `broken` counts all rows left out and `masked` all cells that are no number.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: tuple[npt.NDArray[np.float64], ...]
    text: dict[int, list[str]]
    dialect: Dialect
    warnings: tuple[Warning, ...]
    broken: int
    masked: int

    @property
    def rows(self) -> int:
        """Number of rows read."""
        return self.columns[0].size if self.columns else 0

    def labels(self, wanted: str) -> list[str]:
        """Return a column as names, whether its cells are numbers or text; raises as `position`."""
        at = self.position(wanted)
        return list(self.text[at]) if at in self.text else [str(value) for value in self.columns[at]]

    def position(self, wanted: str) -> int:
        """Return the position of a column by its name (case and blanks aside) or its number from 1.

        Raises RequestError if there is no such column, or the name occurs twice.
        """
        plain = [_plain(name) for name in self.names]
        raw = [_plain(f"{n} ({u})") if u else _plain(n) for n, u in zip(self.names, self.units, strict=True)]
        hits = [i for i in range(len(plain)) if _plain(wanted) in (plain[i], raw[i])]
        if not hits and wanted.strip().isdigit() and 1 <= int(wanted) <= len(self.names):
            return int(wanted) - 1
        if len(hits) == 1:
            return hits[0]
        having = ", ".join(self.names[:20])
        if hits:
            raise RequestError(f"column {wanted!r} occurs {len(hits)} times", "Give its number, counted from 1.")
        raise RequestError(f"there is no column {wanted!r}", f"The columns are: {having}.")


def read_table(path: str | Path, separator: str | None = None) -> Table:
    """Read a table of numbers; raises FileError if it is none, or too broken to be one, with the lines."""
    path = Path(path)
    try:
        dialect = sniff(path, separator)
        frame = _fast(path, dialect)
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}", "Check name and permissions.") from error
    if frame is None:
        return _with_clocks(_slow(path, dialect))
    text = {
        position: [str(v).strip() if isinstance(v, str) else "" for v in frame[position]]
        for position in range(frame.shape[1])
        if not pd.api.types.is_numeric_dtype(frame[position])
    }
    empty = np.full(len(frame), np.nan)
    columns = tuple(empty if at in text else frame[at].to_numpy(np.float64) for at in range(frame.shape[1]))
    return _with_clocks(_table(dialect, columns, text))


def _with_clocks(table: Table) -> Table:
    """Turn columns of clock times into seconds since the first, with a warning."""
    columns, units, text, warnings = list(table.columns), list(table.units), dict(table.text), list(table.warnings)
    for position, words in table.text.items():
        clock = seconds_of(words)
        if clock is None:
            continue
        (columns[position], kind), units[position] = clock, "s"
        del text[position]
        cause = f"column {table.names[position]!r} holds {kind}: taken as seconds since its first"
        warnings.append(Warning(WarningCode.CLOCK_COLUMN, "", cause))
    return replace(table, columns=tuple(columns), units=tuple(units), text=text, warnings=tuple(warnings))


def _plain(name: str) -> str:
    return " ".join(name.lower().split())


def _table(
    dialect: Dialect,
    columns: tuple[npt.NDArray[np.float64], ...],
    text: dict[int, list[str]],
    warnings: Sequence[Warning] = (),
    broken: int = 0,
) -> Table:
    """Name the columns, and count the cells that are no number."""
    masked = int(sum((~np.isfinite(c)).sum() for i, c in enumerate(columns) if i not in text))
    units = dialect.units or ("",) * dialect.columns
    return Table(_names(dialect), units, columns, text, dialect, tuple(warnings[:MOST_WARNINGS]), broken, masked)


def _names(dialect: Dialect) -> tuple[str, ...]:
    titles = itertools.zip_longest(dialect.header[: dialect.columns], range(1, dialect.columns + 1))
    return tuple(title or str(number) for title, number in titles)


def _fast(path: Path, dialect: Dialect) -> pd.DataFrame | None:
    """Read with pandas' C parser; None where rows are ragged or a cell is neither number nor clean text."""
    try:
        with path.open(encoding=dialect.encoding) as file:
            for _ in range(dialect.data_line):  # by lines: a lone quotation mark above the data ends nothing
                next(file)
            frame = pd.read_csv(
                file, sep=r"\s+" if dialect.separator == " " else dialect.separator, decimal=dialect.decimal,
                header=None, names=list(range(dialect.columns)), index_col=False, skipinitialspace=True,
                low_memory=False, on_bad_lines="error", na_values=list(MISSING), **_EXACT,
            )  # fmt: skip
    except (ValueError, pd.errors.ParserError, pd.errors.ParserWarning, UnicodeError):
        return None
    mixed = [c for c in frame if frame[c].dtype == object or pd.api.types.is_string_dtype(frame[c])]
    for column in mixed:
        values = pd.to_numeric(frame[column], errors="coerce")
        if values.notna().any():  # numbers with some text between: the slow path names the lines
            return None
        shown = frame[column].dropna().astype(str).head(SHOWN_WORDS)
        if any(math.isfinite(number(cell, dialect.decimal) or math.nan) for cell in shown):
            return None  # grouped thousands, another minus sign
    if frame.iloc[:, -1].isna().any() and not frame.iloc[:, -1].isna().all():
        return None  # perhaps rows too short: the slow path counts the fields
    return pd.DataFrame(frame)


def _lines(path: Path, dialect: Dialect) -> Iterator[tuple[int, str]]:
    with path.open(encoding=dialect.encoding, errors="replace", newline=None) as file:
        for at, line in enumerate(file):
            if at >= dialect.data_line and not is_comment(line):
                yield at + 1, line.rstrip("\n")


def _slow(path: Path, dialect: Dialect) -> Table:
    width = dialect.columns
    rows: list[list[float]] = []
    words: list[list[str]] = []
    places: list[int] = []
    warnings: list[Warning] = []
    broken = 0
    for line_number, line in records(_lines(path, dialect)):
        cells = cells_of(line, dialect.separator)
        if len(cells) == width + 1 and not cells[-1].strip():
            cells = cells[:width]  # a separator at the end of the line
        if len(cells) != width:
            broken += 1
            if len(warnings) < MOST_WARNINGS:
                ragged = f"line {line_number}: {len(cells)} fields where the others have {width}"
                warnings.append(Warning(WarningCode.RAGGED_ROW, "", ragged))
            if broken > MOST_BROKEN and broken > len(rows):
                break  # whatever follows, this is no table of so many columns
            continue
        values = [number(cell, dialect.decimal) for cell in cells]
        rows.append([math.nan if v is None else v for v in values])
        words.append([cell.strip() if v is None else "" for cell, v in zip(cells, values, strict=True)])
        places.append(line_number)
    if not rows or broken > MAX_BAD_SHARE * (len(rows) + broken) + 2:
        first = "; ".join(warning.text for warning in warnings[:3])
        raise FileError(f"{path.name}: {broken} rows do not fit the columns; {first}", "Correct the file.")
    table = np.asarray(rows)
    columns = tuple(np.ascontiguousarray(table[:, i]) for i in range(width))
    text = {i: [row[i] for row in words] for i in range(width) if all(row[i] for row in words)}
    names = _names(dialect)
    warnings += [
        Warning(WarningCode.NOT_A_NUMBER, "", f"line {place}: {cell[:30]!r} in column {names[i]!r} is not a number")
        for place, row in zip(places, words, strict=True)
        for i, cell in enumerate(row)
        if cell and i not in text
    ]
    return _table(dialect, columns, text, warnings, broken)


def line_of_row(path: Path, dialect: Dialect, row: int) -> int:
    """Return the line, counted from 1, of data row `row`, counted from 0."""
    for at, (line_number, _) in enumerate(records(_lines(path, dialect))):
        if at == row:
            return line_number
    return dialect.data_line + row + 1


def seconds_of(cells: Sequence[str]) -> tuple[npt.NDArray[np.float64], str] | None:
    """Return clock times as seconds since the first [n], and their kind; None where any cell is something else."""
    if not cells:
        return None
    if all(_OF_DAY.match(cell) for cell in cells):
        seconds = np.asarray([_of_day(cell) for cell in cells])
        midnights = np.cumsum(np.diff(seconds, prepend=seconds[0]) < -DAY_S / 2)
        over = f", over midnight {midnights[-1]} time{'s' if midnights[-1] > 1 else ''}" if midnights[-1] else ""
        return np.round(seconds + DAY_S * midnights - seconds[0], 9), f"times of day{over}"
    dated = [_two_digits(_DOTTED.sub(r"\3-\2-\1 \4", cell).replace(",", ".")) for cell in cells]
    if not all(_ISO.match(cell) for cell in dated):
        return None
    try:
        instants = pd.to_datetime(dated, format="ISO8601", utc=True)
    except (ValueError, OverflowError):
        return None  # the 31st of February
    return (instants - instants[0]).total_seconds().to_numpy(dtype=np.float64), "dates and times"


def _of_day(cell: str) -> float:
    hours, minutes, seconds = cell.replace(",", ".").split(":")
    return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds)


def _two_digits(cell: str) -> str:
    """Write 2026-3-1 9:00:00 as 2026-03-01 09:00:00."""
    return re.sub(r"(?<=[-T ])(\d)(?=[-: ])", r"0\1", cell)
