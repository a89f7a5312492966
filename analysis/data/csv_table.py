"""A table of numbers from a text file as it is found.

`analysis.data.csv_dialect` finds how the file is written; pandas reads the body at speed; only if that fails is the
file read line by line, to name the lines. A column of stamps (`analysis.data.clocks`) becomes seconds since its first
row; 3/4/2026 is ambiguous and stays text. Every cell that is not a number is counted, and the first ones are named by
line.
"""

from __future__ import annotations

import io
import itertools
import math
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TextIO
from warnings import catch_warnings, simplefilter

import numpy as np
import numpy.typing as npt
import pandas as pd

from analysis.data.clocks import Stamps, is_stamp, read_stamps
from analysis.data.column_names import known_unit, split_unit
from analysis.data.csv_dialect import (
    LOGGED,
    MAX_LINE_BYTES,
    MISSING,
    Dialect,
    cells_of,
    is_comment,
    measured,
    number,
    records,
    sniff,
    without_heads,
)
from analysis.data.table_files import FileColumns, kind_of, read_columns, sheet_text
from analysis.warning import Warning, WarningCode
from protocol.base.errors import FileError, RequestError

MOST_WARNINGS = 10
MAX_BAD_SHARE = 0.05  # more broken rows than this and the file was not understood
MOST_BROKEN = 10_000  # and more of them than whole rows: the rest is not read
SHOWN_WORDS = 100  # cells of a text column that are tried as grouped numbers
_FRACTIONS = {("ms", "msec", "millisecond", "milliseconds"): 1e3, ("us", "usec", "microsecond", "microseconds"): 1e6}
_ONE_GROUP = {sign: re.compile(rf"[+-]?[1-9]\d{{0,2}}[{other}]\d{{3}}") for sign, other in ((".", ","), (",", "."))}
# pandas 3 reads decimals to the nearest double by itself and deprecates the option that older ones need for it
_EXACT: dict[str, Any] = {} if int(pd.__version__.split(".")[0]) >= 3 else {"float_precision": "round_trip"}


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
    stamps: Mapping[int, Stamps] = field(default_factory=dict)  # columns that were stamps

    @property
    def rows(self) -> int:
        return self.columns[0].size if self.columns else 0

    def labels(self, wanted: str) -> list[str]:
        """Return a column as names, whether its cells are numbers or text; raises as `position`."""
        at = self.position(wanted)
        return list(self.text[at]) if at in self.text else [str(value) for value in self.columns[at]]

    def position(self, wanted: str) -> int:
        """Return the position of a column by its number from 1, or by its name (case and blanks aside).

        Digits alone are a number. Raises RequestError if there is no such column, or the name occurs twice.
        """
        if wanted.strip().isdigit():
            if 1 <= int(wanted) <= len(self.names):
                return int(wanted) - 1
            raise RequestError(f"there is no column {int(wanted)}", f"Columns are numbered 1 to {len(self.names)}.")
        plain = [_plain(name) for name in self.names]
        raw = [_plain(f"{n} ({u})") if u else _plain(n) for n, u in zip(self.names, self.units, strict=True)]
        hits = [i for i in range(len(plain)) if _plain(wanted) in (plain[i], raw[i])]
        if len(hits) == 1:
            return hits[0]
        having = ", ".join(self.names[:20])
        if hits:
            raise RequestError(f"column {wanted!r} occurs {len(hits)} times", "Give its number, counted from 1.")
        raise RequestError(f"there is no column {wanted!r}", f"Choose one of {having}.")


def read_table(path: str | Path, separator: str | None = None, *, skip: int = 0, whole_lines: bool = False) -> Table:
    """Read a table of numbers; raises FileError if it is none, or too broken to be one, with the lines.

    `skip`: lines above header and numbers. `whole_lines`: leave out a last line without an end, which may be cut off
    within its last number.
    """
    path = Path(path)
    try:
        kind = kind_of(path) if path.is_file() else ""
        if kind:
            return _from_sheet(path, skip) if kind == "Excel" else _from_columns(read_columns(path, kind))
        dialect = sniff(path, separator, skip)
        torn = whole_lines and _is_torn(path, dialect)
        frame = _fast(path, dialect)
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}", "Check name and permissions.") from error
    if frame is None:
        return _with_clocks(_slow(path, dialect, torn=torn))
    warnings = []
    if torn:
        frame = frame.iloc[:-1]
        warnings.append(_torn(line_of_row(path, dialect, len(frame))))
    if dialect.nuls:
        warnings.append(_nuls(path))
    text = {
        position: [str(v).strip() if isinstance(v, str) else "" for v in frame[position]]
        for position in range(frame.shape[1])
        if not pd.api.types.is_numeric_dtype(frame[position])
    }
    columns = tuple(
        np.full(len(frame), np.nan) if at in text else frame[at].to_numpy(np.float64) for at in range(frame.shape[1])
    )
    return _with_clocks(_table(dialect, columns, text, warnings))


def _from_sheet(path: Path, skip: int) -> Table:
    """Return the table of a workbook, read as the text that its sheet shows."""
    text, sheet = sheet_text(path)
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / path.name  # whose name is that of the errors
        copy.write_text(text, encoding="utf-8")
        table = read_table(copy, ",", skip=skip)
    said = [Warning(WarningCode.TABLE_CHOSEN, "", f"sheet {sheet!r} has the most numbers: taken")] if sheet else []
    return replace(table, dialect=replace(table.dialect, form="Excel"), warnings=(*said, *table.warnings))


def _from_columns(found: FileColumns) -> Table:
    dialect = Dialect("", "", ".", 0, found.names, found.units, (), len(found.names), form=found.kind)
    dialect = replace(dialect, description=found.description, interval_s=found.interval_s)
    said = [Warning(WarningCode.TABLE_CHOSEN, "", found.left_out)] if found.left_out else []
    return replace(_table(dialect, found.values, {}, said), stamps=found.stamps)


def _is_torn(path: Path, dialect: Dialect) -> bool:
    """Return whether the last line, if it is no comment, has no end: its last number may be cut off."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - MAX_LINE_BYTES))
        last = file.read()
    if dialect.encoding == "utf-16":
        tail = last[len(last) % 2 :].decode("utf-16-be" if last[-2:-1] == b"\0" else "utf-16-le", errors="replace")
    else:
        tail = last.decode(dialect.encoding, errors="replace").rstrip("\0")
    return not is_comment(re.split(r"[\r\n]", tail)[-1])


def _torn(line: int) -> Warning:
    return Warning(WarningCode.RAGGED_ROW, "", f"line {line}, the last one, has no line end: left out as incomplete")


def _nuls(path: Path) -> Warning:
    return Warning(WarningCode.RAGGED_ROW, "", f"{path.read_bytes().count(0)} NUL bytes left out")


def _with_clocks(table: Table) -> Table:
    """Turn columns of stamps into seconds since the first, `0.02 sec` into numbers, units into those of values."""
    columns, units, text, warnings = list(table.columns), list(table.units), dict(table.text), list(table.warnings)
    found: dict[int, Stamps] = {}
    for position, words in table.text.items():
        stamps = read_stamps(words)
        if stamps is not None:
            found[position] = stamps
            stamps, at = _with_fraction(table, position, stamps), position + 1
            if stamps is not found[position]:  # it is no column of its own
                found[position], text[at] = stamps, [""] * table.rows
            columns[position], units[position] = since_first(stamps), "s"
            del text[position]
            cause = f"column {table.names[position]!r} holds {stamps.kind}: taken as seconds since its first"
            warnings.append(Warning(WarningCode.CLOCK_COLUMN, "", cause))
        elif (column := _plain_numbers(words, table.dialect.decimal)) is not None:
            columns[position], unit = column
            units[position] = units[position] or unit
            del text[position]
        elif position - 1 not in table.text and len(set(words)) == 1 and known_unit(words[0]):
            units[position - 1] = units[position - 1] or words[0]  # a column of the unit behind that of the values
    warned = tuple(warnings)
    return replace(table, columns=tuple(columns), units=tuple(units), text=text, warnings=warned, stamps=found)


def _with_fraction(table: Table, position: int, stamps: Stamps) -> Stamps:
    """Return stamps of whole seconds with the milli- or microseconds in the column behind them."""
    at = position + 1
    if at >= len(table.columns) or at in table.text:
        return stamps
    titles = {" ".join(text.lower().split()) for text in (table.names[at], table.units[at])}
    per_s = next((n for words, n in _FRACTIONS.items() if titles & set(words)), 0.0)
    part, known = table.columns[at], np.isfinite(stamps.seconds)
    if not per_s or not known.any() or (np.mod(stamps.seconds[known], 1.0) != 0).any():
        return stamps
    if not ((part >= 0) & (part < per_s)).all():
        return stamps
    return replace(stamps, seconds=stamps.seconds + part / per_s)


def _plain_numbers(words: Sequence[str], decimal: str) -> tuple[npt.NDArray[np.float64], str] | None:
    """Return a column of cells such as `0.02 sec` as numbers, and their unit; None where one is something else."""
    if measured(next(filter(None, words), ""), decimal) is None:
        return None
    parts = [measured(word, decimal) if word else (np.nan, "") for word in words]
    known = [part for part in parts if part is not None]
    units = {unit for _, unit in known if unit}
    return (
        None if len(known) < len(parts) or len(units) != 1 else (np.array([value for value, _ in known]), units.pop())
    )


def since_first(stamps: Stamps) -> npt.NDArray[np.float64]:
    """Return the seconds of stamps since the first one [n]."""
    first = np.flatnonzero(np.isfinite(stamps.seconds))[0]
    return np.asarray(np.round(stamps.seconds - stamps.seconds[first], 9), np.float64)


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
    units = (*dialect.units, *("",) * dialect.columns)[: dialect.columns]
    return Table(_names(dialect), units, columns, text, dialect, tuple(warnings[:MOST_WARNINGS]), broken, masked)


def _names(dialect: Dialect) -> tuple[str, ...]:
    titles = itertools.zip_longest(dialect.header[: dialect.columns], range(1, dialect.columns + 1))
    return tuple(title or str(number) for title, number in titles)


def _fast(path: Path, dialect: Dialect) -> pd.DataFrame | None:
    """Read with pandas' C parser; None where rows are ragged or a cell is neither number nor clean text."""
    try:
        with _opened(path, dialect, "strict") as file, catch_warnings():
            simplefilter("error", pd.errors.ParserWarning)  # longer rows are cut
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
    last_empty = frame.iloc[:, -1].isna()
    if last_empty.any() and not last_empty.all() and not _is_rectangular(path, dialect, len(frame)):
        return None  # rows too short: the slow path counts the fields
    return pd.DataFrame(frame)


def _is_rectangular(path: Path, dialect: Dialect, rows: int) -> bool:
    """Return whether the separators of unquoted rows are as many as those of full rows."""
    if dialect.separator == " ":
        return False
    with _opened(path, dialect, "strict") as file:
        body = "".join(itertools.islice(file, dialect.data_line, None))
    return '"' not in body and body.count(dialect.separator) == rows * (dialect.columns - 1)


def _opened(path: Path, dialect: Dialect, errors: str) -> TextIO:
    """Return the text of a file, without NUL bytes; a separator behind the stamp of another program."""
    if not (dialect.nuls or dialect.logged):
        return path.open(encoding=dialect.encoding, errors=errors, newline=None)
    text = path.read_bytes().decode(dialect.encoding, errors).replace("\0", "")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    return io.StringIO(LOGGED.sub(rf"\1{dialect.separator}", text) if dialect.logged else text)


def _lines(path: Path, dialect: Dialect) -> Iterator[tuple[int, str]]:
    with _opened(path, dialect, "replace") as file:
        for at, line in enumerate(file):
            if at >= dialect.data_line and not is_comment(line):
                yield at + 1, line.rstrip("\n")


def _slow(path: Path, dialect: Dialect, *, torn: bool) -> Table:
    width = dialect.columns
    rows: list[list[float]] = []
    words: list[list[str]] = []
    places: list[int] = []
    warnings: list[Warning] = []
    broken = repeated = line_number = 0
    for line_number, line in records(without_heads(_lines(path, dialect))):
        cells = cells_of(line, dialect.separator)
        if len(cells) == width + 1 and (dialect.noted or not cells[-1].strip()):
            cells = cells[:width]  # a comment, or a separator at the end of the line
        if [split_unit(cell)[0] for cell in cells] == [*dialect.header]:
            repeated += 1
            continue
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
    if torn:
        if places and line_number == places[-1]:
            del rows[-1], words[-1], places[-1]
        else:  # one of the broken rows
            broken -= 1
        warnings = [*(one for one in warnings if not one.text.startswith(f"line {line_number}:")), _torn(line_number)]
    if dialect.nuls:
        warnings.append(_nuls(path))
    if repeated:
        warnings.append(Warning(WarningCode.RAGGED_ROW, "", f"{repeated} rows repeat the header: left out"))
    if not rows or broken > MAX_BAD_SHARE * (len(rows) + broken) + 2:
        first = "; ".join(warning.text for warning in warnings[:3])
        raise FileError(f"{path.name}: {broken} rows do not fit the columns; {first}", "Correct the file.")
    table = _with_groups(np.asarray(rows), words, dialect.decimal)
    columns = tuple(np.ascontiguousarray(table[:, i]) for i in range(width))
    text = {i: [row[i] for row in words] for i in range(width) if _is_text([row[i] for row in words], columns[i])}
    names = _names(dialect)
    warnings += [
        Warning(WarningCode.NOT_A_NUMBER, "", f"line {place}: {cell[:30]!r} in column {names[i]!r} is not a number")
        for place, row in zip(places, words, strict=True)
        for i, cell in enumerate(row)
        if cell and i not in text
    ]
    return _table(dialect, columns, text, warnings, broken)


def _with_groups(table: npt.NDArray[np.float64], words: list[list[str]], decimal: str) -> npt.NDArray[np.float64]:
    """Return a table with 1.000 read as 1000 where the decimal sign is a comma and all other numbers are whole."""
    group = _ONE_GROUP[decimal]
    for i, column in enumerate(table.T):
        at = [k for k, row in enumerate(words) if row[i]]
        known = column[np.isfinite(column)]
        if at and known.size and (known % 1 == 0).all() and all(group.fullmatch(words[k][i]) for k in at):
            column[at] = [float(re.sub(r"[.,]", "", words[k][i])) for k in at]
            for k in at:
                words[k][i] = ""
    return table


def _is_text(words: list[str], values: npt.NDArray[np.float64]) -> bool:
    """Return whether a column is text: all of its cells, or all that are not empty are stamps."""
    if all(words):
        return True
    return not np.isfinite(values).any() and is_stamp(next(filter(None, words), ""))


def line_of_row(path: Path, dialect: Dialect, row: int) -> int:
    """Return the line, counted from 1, of data row `row`, counted from 0."""
    if dialect.form:
        return dialect.data_line + row + 1
    for at, (line_number, _) in enumerate(records(without_heads(_lines(path, dialect)))):
        if at == row:
            return line_number
    return dialect.data_line + row + 1
