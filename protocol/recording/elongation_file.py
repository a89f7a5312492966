"""Files of readings, as `record --elongation` and `analyze --elongation` accept them.

One row a plateau with the columns `pressure_kpa,elongation_mm`, in the order of the run; or in any order with `cycle`
and `branch` ("unloading", "loading", "start") as well. The separator is a comma, semicolon, tab or bar; decimals may be
commas unless it is the comma. A column `confirmed` holds the reason of a reading that was checked and confirmed. Lines
that begin with # and other columns are ignored. Encoding: UTF-8, UTF-16 or
Windows-1252. A row that is not two finite numbers is refused with its line: in a file by order a lost row would shift
every later reading to another plateau.
"""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

from protocol.base.errors import RequestError
from protocol.base.regular_file import read_regular

_MAX_BYTES = 4_000_000
_SEPARATORS = ";\t|,"
_BRANCHES = (None, "start", "unloading", "loading")
CONFIRMED = "confirmed: "  # before the reason, in the note of a reading of a recording
_HEADER = "the first line must be: pressure_kpa,elongation_mm"


@dataclass(frozen=True, slots=True)
class ElongationRow:
    """One row and its line; `cycle` and `branch` are None in a file by order."""

    line: int
    pressure_kpa: float
    elongation_mm: float
    cycle: int | None = None
    branch: str | None = None
    confirmed: str = ""


def reason_of(note: object) -> str:
    """Return the reason in the note of a reading that was confirmed; empty for any other note."""
    text = str(note or "")
    return text.removeprefix(CONFIRMED).strip() if text.startswith(CONFIRMED) else ""


def read_elongation_rows(path: Path) -> tuple[ElongationRow, ...]:
    """Return the rows of a file of readings. RequestError: unreadable, or names the missing column or the line."""
    lines = [(n, line) for n, line in enumerate(_text(path).splitlines(), 1) if line.strip(' ,;|\t"')]
    lines = [(n, line) for n, line in lines if not line.lstrip(' "\t').startswith("#")]
    if not lines:
        raise RequestError(f"{path.name} is empty", _HEADER)
    header = lines[0][1]
    separator = next((s for s in _SEPARATORS if s in header), ",")
    names = [name.strip().lower() for name in _cells(header, separator)]
    missing = [name for name in ("pressure_kpa", "elongation_mm") if name not in names]
    if missing or ("cycle" in names) != ("branch" in names):
        wrong = f"has no column {missing[0]!r}" if missing else "has only one of the columns cycle and branch"
        raise RequestError(f"{path.name} {wrong}", _HEADER)
    if len(lines) == 1:
        raise RequestError(f"{path.name} has no rows", _HEADER)
    return tuple(_row(path.name, n, dict(zip(names, _cells(line, separator), strict=False))) for n, line in lines[1:])


def _text(path: Path) -> str:
    try:
        content = read_regular(path, _MAX_BYTES)
    except OSError as error:
        raise RequestError(f"{path} cannot be read: {error.strerror}", "choose the file of elongations") from error
    text = _decoded(content)
    if "\0" in text:
        raise RequestError(f"{path.name} is a binary file, not text", "export it as CSV")
    return text


def _decoded(content: bytes) -> str:
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return content.decode("utf-16", errors="replace")
    head = content[:200]
    if head.count(0) > len(head) // 4:  # every other byte of plain text in UTF-16
        return content.decode("utf-16-be" if head[:1] == b"\0" else "utf-16-le", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def _cells(line: str, separator: str) -> list[str]:
    try:
        cells = next(csv.reader(io.StringIO(line), delimiter=separator), [])
    except csv.Error:  # a cell beyond csv's limit, or a NUL: not a number either
        return []
    return [cell.strip().strip('"') for cell in cells]


def _number(cell: str) -> float:
    return float(cell.replace(",", ".") if cell.count(",") == 1 else cell)


def _row(name: str, line: int, cells: dict[str, str]) -> ElongationRow:
    try:
        pressure_kpa, elongation_mm = _number(cells["pressure_kpa"]), _number(cells["elongation_mm"])
        cycle = int(_number(cells["cycle"])) if "cycle" in cells else None
        if cycle is not None and cycle != _number(cells["cycle"]):
            raise ValueError
    except (KeyError, ValueError, OverflowError):
        raise RequestError(f"{name}, line {line}: a number is missing or invalid", "correct that line") from None
    branch = cells["branch"].lower() if "branch" in cells else None
    if not (math.isfinite(pressure_kpa) and math.isfinite(elongation_mm)):
        raise RequestError(f"{name}, line {line}: not a finite number", "correct or delete that line")
    if branch not in _BRANCHES:
        raise RequestError(f"{name}, line {line}: unknown branch {branch!r:.40}", "write unloading or loading")
    return ElongationRow(line, pressure_kpa, elongation_mm, cycle, branch, cells.get("confirmed", ""))
