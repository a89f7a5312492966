"""A table of numbers from a text file as it is found.

Strategy: the encoding is read from the first bytes, separator and decimal sign are those that make the most rows
numeric with one number of columns, the header is what stands above the first such row. pandas then reads the body at
speed; only if it stumbles is the file walked line by line, to name the lines.

Rules: nothing is guessed silently: `Table` says the dialect, every cell that is no number is counted and the first
ones are named by line; memory is bounded (a line above 1 MB or more than 1,000 columns are refused). No value is ever
evaluated: cells are numbers or text.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from analysis.errors import FileError, RequestError

MAX_LINE_BYTES = 1 << 20
MAX_COLUMNS = 1000
HEAD_LINES = 300
NAMED_ISSUES = 10
MAX_BAD_SHARE = 0.05  # more broken rows than this and the file was not understood

# in order of preference where two explain a file equally well
DIALECTS = (
    (",", "."), (";", "."), ("\t", "."), ("|", "."), (" ", "."),
    (";", ","), ("\t", ","), ("|", ","), (" ", ","), (",", ","),
)  # fmt: skip
MISSING = {"", "nan", "na", "n/a", "null", "-", "#n/a"}
# pandas 3 reads decimals to the nearest double by itself and deprecates the option that older ones need for it
_EXACT: dict[str, Any] = {} if int(pd.__version__.split(".")[0]) >= 3 else {"float_precision": "round_trip"}
_IN_NAME = re.compile(r"^(?P<name>.*?)\s*[\[(]\s*(?P<unit>[^\])]*?)\s*[\])]\s*$")


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a file is written. `separator` " " stands for any white space."""

    encoding: str
    separator: str
    decimal: str
    data_line: int
    header: tuple[str, ...]
    units: tuple[str, ...]
    comments: tuple[str, ...]
    columns: int


@dataclass(frozen=True, slots=True)
class Table:
    """A read table: numeric columns by position, text columns apart.

    `names` are as in the header without units, or "1", "2", ... without one. `issues` are sentences with line
    numbers, at most `NAMED_ISSUES`; `broken` counts all rows left out and `masked` all cells that are no number.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    columns: tuple[npt.NDArray[np.float64], ...]
    text: dict[int, list[str]]
    dialect: Dialect
    issues: tuple[str, ...]
    broken: int
    masked: int

    @property
    def rows(self) -> int:
        """Number of rows read."""
        return self.columns[0].size if self.columns else 0

    def position(self, wanted: str) -> int:
        """Return the position of a column by its name (case and blanks aside) or its number from 1.

        Raises
        ------
        RequestError : no such column, or the name stands twice.
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
            raise RequestError(f"column {wanted!r} stands {len(hits)} times", "Give its number, counted from 1.")
        raise RequestError(f"there is no column {wanted!r}", f"The columns are: {having}.")


def read_table(path: str | Path) -> Table:
    """Read a table of numbers.

    Raises
    ------
    FileError : not a table of numbers, or too broken to be one; the message names lines.
    """
    path = Path(path)
    try:
        dialect = sniff(path)
        frame = _fast(path, dialect)
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}", "Check name and permissions.") from error
    if frame is None:
        return _slow(path, dialect)
    columns, text = _as_columns(frame)
    return Table(_names(dialect), _units(dialect), columns, text, dialect, (), 0, _count_masked(columns, text))


def sniff(path: Path) -> Dialect:
    """Find encoding, separator, decimal sign and header.

    Raises
    ------
    FileError : the file is empty, binary, holds an endless line, or no row of numbers.
    """
    _refuse_endless_lines(path)
    with path.open("rb") as file:
        head = file.read(4 * MAX_LINE_BYTES)
    encoding = _encoding(head)
    text = head.decode(encoding, errors="replace")
    if not text.strip("\ufeff \r\n\t"):
        raise FileError(f"{path.name} is empty", "Export it again.")
    if "\x00" in text:
        raise FileError(f"{path.name} is a binary file, not text", "Export it as CSV.")
    lines = text.splitlines()[:HEAD_LINES]
    best = max((_score(lines, sep, dec), -i) for i, (sep, dec) in enumerate(DIALECTS))
    separator, decimal = DIALECTS[-best[1]]
    score, width = best[0]
    if score <= 0:
        raise FileError(
            f"{path.name} holds no rows of numbers in columns",
            "Look at its first lines with `boat-daq import --preview`.",
        )
    if width > MAX_COLUMNS:
        raise FileError(f"{path.name} has {width} columns, more than {MAX_COLUMNS}", "Is it the right file?")
    return _dialect(lines, encoding, separator, decimal, width)


def number(cell: str, decimal: str) -> float | None:
    """Return a cell as a number, NaN where it is empty or says so, None where it is something else."""
    cell = cell.strip().strip('"').strip()
    if cell.lower() in MISSING:
        return math.nan
    if "_" in cell:
        return None
    try:
        return float(cell.replace(",", ".") if decimal == "," else cell)
    except ValueError:
        return None


def split_name(cell: str) -> tuple[str, str]:
    """Split "pressure [kPa]" or "Tijd (s)" into name and unit."""
    cell = cell.strip().strip('"').strip()
    match = _IN_NAME.match(cell)
    return (match["name"].strip(), match["unit"]) if match and match["name"].strip() else (cell, "")


def _plain(name: str) -> str:
    return " ".join(name.lower().split())


def _refuse_endless_lines(path: Path) -> None:
    run = 0
    with path.open("rb") as file:
        while chunk := file.read(1 << 20):
            first, last = chunk.find(b"\n"), chunk.rfind(b"\n")
            if first < 0 and b"\r" in chunk:
                first, last = chunk.find(b"\r"), chunk.rfind(b"\r")
            if first < 0:
                run += len(chunk)
            else:
                if run + first > MAX_LINE_BYTES:
                    break
                run = len(chunk) - last - 1
            if run > MAX_LINE_BYTES:
                break
        else:
            return
    raise FileError(f"{path.name} has a line longer than {MAX_LINE_BYTES >> 20} MB", "It is not a table of numbers.")


def _encoding(head: bytes) -> str:
    for mark, name in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if head.startswith(mark):
            return name
    if head[:200].count(b"\x00") > len(head[:200]) // 4:
        return "utf-16-be" if head[:1] == b"\x00" else "utf-16-le"
    try:
        head[: max(len(head) - 3, 0) if len(head) == 4 * MAX_LINE_BYTES else len(head)].decode("utf-8")
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8"


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    return next(csv.reader(io.StringIO(line), delimiter=separator), [])


def _is_comment(line: str) -> bool:
    return not line.strip() or line.lstrip('\ufeff" \t').startswith("#")


def _score(lines: list[str], separator: str, decimal: str) -> tuple[float, int]:
    """Share of the cells that are numbers in rows of the commonest width (at least two columns), and that width."""
    widths: dict[int, int] = {}
    numeric: dict[int, float] = {}
    total = 0
    for line in lines:
        if _is_comment(line):
            continue
        total += 1
        cells = _cells(line, separator)
        if _is_data(cells, decimal):
            width = len(cells)
            widths[width] = widths.get(width, 0) + 1
            share = sum(number(cell, decimal) is not None for cell in cells) / width
            numeric[width] = numeric.get(width, 0.0) + share
    if not widths:
        return 0.0, 0
    width = max(widths, key=lambda w: (widths[w], w))
    return round(numeric[width] / total, 3), width


def _is_data(cells: list[str], decimal: str) -> bool:
    """True where most cells are numbers: a text column (a branch, a note) is allowed beside them."""
    values = [number(cell, decimal) for cell in cells]
    numeric = sum(v is not None and not math.isnan(v) for v in values)
    words = sum(v is None for v in values)
    return len(cells) >= 2 and numeric >= 1 and numeric >= words


def _dialect(lines: list[str], encoding: str, separator: str, decimal: str, width: int) -> Dialect:
    above: list[list[str]] = []
    comments: list[str] = []
    data_line = 0
    for at, line in enumerate(lines):
        if _is_comment(line):
            if line.strip():
                whole = (
                    next(csv.reader([line.lstrip("\ufeff")]), [""]) if line.startswith('"') else [line.lstrip("\ufeff")]
                )
                comments.append(whole[0].strip().lstrip("#").strip())
            continue
        cells = _cells(line.lstrip("\ufeff"), separator)
        if len(cells) == width and _is_data(cells, decimal):
            data_line = at
            break
        above.append(cells)
    titles = [cells for cells in above if len(cells) in (width, width + 1) and any(c.strip() for c in cells)]
    titles = [cells[:width] for cells in titles]
    header, units = _header(titles)
    return Dialect(encoding, separator, decimal, data_line, header, units, tuple(comments), width)


def _header(titles: list[list[str]]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    if not titles:
        return (), ()
    last = titles[-1]
    if len(titles) > 1 and all(len(cell.strip(' []()"')) <= 6 for cell in last):
        return tuple(split_name(c)[0] for c in titles[-2]), tuple(c.strip(' []()"') for c in last)
    return tuple(split_name(c)[0] for c in last), tuple(split_name(c)[1] for c in last)


def _names(dialect: Dialect) -> tuple[str, ...]:
    return tuple(
        dialect.header[i] if i < len(dialect.header) and dialect.header[i] else str(i + 1)
        for i in range(dialect.columns)
    )


def _units(dialect: Dialect) -> tuple[str, ...]:
    return dialect.units if dialect.units else ("",) * dialect.columns


def _fast(path: Path, dialect: Dialect) -> pd.DataFrame | None:
    """Read with pandas' C parser; None where rows are ragged or a cell is neither number nor clean text."""
    try:
        frame = pd.read_csv(
            path, sep=r"\s+" if dialect.separator == " " else dialect.separator, decimal=dialect.decimal,
            header=None, names=list(range(dialect.columns)), index_col=False, skiprows=dialect.data_line,
            comment="#", encoding=dialect.encoding, skipinitialspace=True, low_memory=False, memory_map=False,
            on_bad_lines="error", na_values=list(MISSING), **_EXACT,
        )  # fmt: skip
    except (ValueError, pd.errors.ParserError, pd.errors.ParserWarning, UnicodeError):
        return None
    mixed = [c for c in frame if frame[c].dtype == object or pd.api.types.is_string_dtype(frame[c])]
    for column in mixed:
        values = pd.to_numeric(frame[column], errors="coerce")
        if values.notna().any():  # numbers with some words between: the slow way names the lines
            return None
    if frame.iloc[:, -1].isna().any() and not frame.iloc[:, -1].isna().all():
        return None  # perhaps rows too short: the slow way counts the fields
    return pd.DataFrame(frame)


def _as_columns(frame: pd.DataFrame) -> tuple[tuple[npt.NDArray[np.float64], ...], dict[int, list[str]]]:
    columns: list[npt.NDArray[np.float64]] = []
    text: dict[int, list[str]] = {}
    for position in range(frame.shape[1]):
        series = frame.iloc[:, position]
        if pd.api.types.is_numeric_dtype(series):
            columns.append(series.to_numpy(dtype=np.float64))
        else:
            columns.append(np.full(len(series), np.nan))
            text[position] = [str(v).strip() if isinstance(v, str) else "" for v in series]
    return tuple(columns), text


def _count_masked(columns: tuple[npt.NDArray[np.float64], ...], text: dict[int, list[str]]) -> int:
    return int(sum((~np.isfinite(c)).sum() for i, c in enumerate(columns) if i not in text))


def _lines(path: Path, dialect: Dialect) -> Iterator[tuple[int, str]]:
    with path.open(encoding=dialect.encoding, errors="replace", newline=None) as file:
        for at, line in enumerate(file):
            if at >= dialect.data_line and not _is_comment(line):
                yield at + 1, line.rstrip("\n")


def _slow(path: Path, dialect: Dialect) -> Table:
    width = dialect.columns
    rows: list[list[float]] = []
    words: list[list[str]] = []
    places: list[int] = []
    issues: list[str] = []
    broken = 0
    for line_number, line in _lines(path, dialect):
        cells = _cells(line, dialect.separator)
        if len(cells) == width + 1 and not cells[-1].strip():
            cells = cells[:width]  # a separator at the end of the line
        if len(cells) != width:
            broken += 1
            issues.append(f"line {line_number}: {len(cells)} fields where the others have {width}")
            continue
        values = [number(cell, dialect.decimal) for cell in cells]
        rows.append([math.nan if v is None else v for v in values])
        words.append([cell.strip() if v is None else "" for cell, v in zip(cells, values, strict=True)])
        places.append(line_number)
    if not rows or broken > MAX_BAD_SHARE * (len(rows) + broken) + 2:
        raise FileError(f"{path.name}: {broken} rows do not fit the columns; {'; '.join(issues[:3])}", "Mend the file.")
    table = np.asarray(rows)
    columns = tuple(np.ascontiguousarray(table[:, i]) for i in range(width))
    text = {i: [row[i] for row in words] for i in range(width) if all(row[i] for row in words)}
    for place, row in zip(places, words, strict=True):
        issues += [
            f"line {place}: {cell[:30]!r} in column {_names(dialect)[i]!r} is not a number"
            for i, cell in enumerate(row)
            if cell and i not in text
        ]
    return Table(
        _names(dialect), _units(dialect), columns, text, dialect, tuple(issues[:NAMED_ISSUES]), broken,
        _count_masked(columns, text),
    )  # fmt: skip


def line_of_row(path: Path, dialect: Dialect, row: int) -> int:
    """Return the line, counted from 1, on which data row `row`, counted from 0, stands."""
    for at, (line_number, _) in enumerate(_lines(path, dialect)):
        if at == row:
            return line_number
    return dialect.data_line + row + 1
