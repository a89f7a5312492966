"""How a text file of numbers is written: encoding, separator, decimal sign, header, units.

The encoding follows from the first bytes: a byte-order mark, NUL bytes and valid UTF-8 decide for themselves; else it
is cp1252, in which a unit such as µm or °C is a single high byte, unless the bytes contradict it: then
charset-normalizer ranks the usual ones, and one that spells time, pressure or signal wins. Separator and decimal sign
are those that make the most rows numeric with one number of columns; the header is what is above the first such row.
A line above 1 MB or more than 1,000 columns are refused.
"""

from __future__ import annotations

import codecs
import csv
import io
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

from analysis.data.clocks import is_stamp
from analysis.data.column_names import known_unit, quantity_of, recognised, split_unit
from protocol.base.errors import FileError

MAX_LINE_BYTES = 1 << 20
MAX_COLUMNS = 1000
HEAD_LINES = 300
_BODY = 100  # last rows of the head that tell which columns hold numbers
_MOSTLY = 0.8  # share of them
MAX_QUOTED_LINES = 20  # a longer quoted cell is a lone quotation mark

# in order of preference where two explain a file equally well
DIALECTS = (
    (",", "."), (";", "."), ("\t", "."), ("|", "."), (" ", "."),
    (";", ","), ("\t", ","), ("|", ","), (" ", ","), (",", ","),
)  # fmt: skip
MISSING = {"", "nan", "na", "n/a", "null", "-", "#n/a"}
COMMENTS = ("#", "%")
_NOTES = ("comment", "comments", "note", "notes", "remark", "remarks")
_COUNTED = ("sequence", "sample", "point")
_OF_UNITS = ("unit", "units", "einheit", "einheiten")
_INTERVALS = ("increment", "wf_increment", "delta_x", "delta t", "dt", "interval")  # between rows, s
_LVM = "LabVIEW Measurement"
_LVM_HEAD_ENDS = "***End_of_Header***"
# a group sign is believed only beside a decimal part or a second group: 1,650 alone may be a decimal comma
_GROUPED = {
    ".": re.compile(r"^[+-]?[0-9]{1,3}(?:(?:,[0-9]{3})+\.[0-9]*|(?:,[0-9]{3}){2,})$"),
    ",": re.compile(r"^[+-]?[0-9]{1,3}(?:(?:\.[0-9]{3})+,[0-9]*|(?:\.[0-9]{3}){2,})$"),
}
_GROUPS = re.compile(r"(?<=\d)['\u2019\u00a0\u202f ](?=\d{3}(?:\D|$))")  # no decimal sign
_MEASURED = re.compile(r"^([+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?)\s*([^\d\s].*)$")
# the stamp of a terminal program or serial monitor before a line of the board
LOGGED = re.compile(
    r"^\[?((?:\d{4}-\d\d-\d\d[ T])?\d{1,2}:\d\d:\d\d(?:[.,:]\d{1,6})?)\]?(?:\s*->?\s*|\s*>\s*|[\t ]+)(?=\S)", re.M
)
_MINUS = str.maketrans({"\u2212": "-", "\u2013": "-"})
_NUMBERED = re.compile(r'\ufeff?"?#"?[,;\t]\s*"?\w')  # a title # of the rows' numbers
_LINE_END = re.compile(r"\r\n|\r|\n")
_NUL_INSIDE = re.compile(r"\x00(?=[^\x00\r\n])")


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a file is written. `separator` " " means any white space."""

    encoding: str
    separator: str
    decimal: str
    data_line: int
    header: tuple[str, ...]
    units: tuple[str, ...]
    comments: tuple[str, ...]
    columns: int
    nuls: bool = False  # NUL bytes at the ends of lines, or of the file, are left out
    description: str = ""  # JSON in an export of ours
    form: str = ""  # of a file that is no text: Excel, MATLAB, ...
    logged: bool = False  # a stamp of another program is before each line
    interval_s: float = 0.0  # between rows without a column of the time, as the head says
    noted: bool = False  # few rows have a comment behind the last column


def sniff(path: Path, separator: str | None = None, skip: int = 0) -> Dialect:
    """Find encoding, decimal sign, header below the lines to `skip`, and the separator if it is not given.

    Raises FileError if the file is empty, binary, holds an endless line, or no row of numbers; OSError if unreadable.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):  # a pipe would be waited for, a device never ends
        raise FileError(f"{path} is not a regular file", "Choose a table of numbers.")
    with path.open("rb") as file:
        _refuse_endless_lines(path.name, file)
        file.seek(0)
        head = file.read(4 * MAX_LINE_BYTES)
    encoding = encoding_of(head, whole=len(head) < 4 * MAX_LINE_BYTES)
    text = head.decode(encoding, errors="replace")
    if not text.strip("\ufeff \r\n\t"):
        raise FileError(f"{path.name} is empty", "Export it again.")
    nuls = "\x00" in text
    if nuls and _NUL_INSIDE.search(text):
        raise FileError(f"{path.name} is a binary file of an unknown kind, not text", "Export it as CSV.")
    split = _LINE_END.split(text.replace("\x00", ""))
    heads = [at + 1 for at, line in enumerate(split) if line.startswith(_LVM_HEAD_ENDS)]
    skip = max(skip, *heads[:2][-1:], 0)  # of the file and of its first segment; later segments have theirs
    lines = list(records(enumerate(split[skip : skip + HEAD_LINES], skip)))
    dialects = [dialect for dialect in DIALECTS if separator in (None, dialect[0])]
    scores = [_score([line for _, line in lines], *dialect) for dialect in dialects]
    best = max(scores)
    stamped = best[0] < 1.0 and any(LOGGED.match(line) for _, line in lines)
    bare = [
        _score([LOGGED.sub(rf"\1{sep}", line) for _, line in lines], sep, sign) for sep, sign in dialects if stamped
    ]
    if logged := bool(bare) and max(bare) > best:
        best, scores = max(bare), bare
    (score, width), (found, decimal) = best, dialects[scores.index(best)]
    if logged:
        lines = [(at, LOGGED.sub(rf"\1{found}", line)) for at, line in lines]
    if score <= 0:
        raise FileError(
            f"{path.name} holds no rows of numbers in columns",
            "Choose a table with at least two columns of numbers; what a board prints with words between its numbers "
            "is read through a text profile.",
        )
    if width > MAX_COLUMNS:
        raise FileError(f"{path.name} has {width} columns, more than {MAX_COLUMNS}", "Check that it is the right file.")
    dialect = replace(_dialect(lines, encoding, found, decimal, width), nuls=nuls, logged=logged)
    return _of_labview(dialect, split[:skip]) if split[0].startswith(_LVM) else dialect


def _of_labview(dialect: Dialect, head: list[str]) -> Dialect:
    """Return the dialect with the units that the head of a LabVIEW measurement states, and the interval of its rows."""
    rows = [cells_of(line, dialect.separator) or [""] for line in head]
    stated = {cells[0]: [cell.strip() for cell in cells[1:]] for cells in rows}
    time = "s" if stated.get("X_Dimension", [""])[0] in ("Time", "") else ""
    labels = iter(stated.get("Y_Unit_Label", []))
    titles = (*dialect.header, *[""] * dialect.columns)[: dialect.columns]
    units = [time if title.startswith("X_Value") else next(labels, "") for title in titles]
    given = (*dialect.units, *[""] * dialect.columns)
    units = [own or unit for own, unit in zip(given, units, strict=False)]
    if stated.get("X_Columns", ["One"])[0] != "No":
        return replace(dialect, units=tuple(units))
    intervals = {number(cell, dialect.decimal) or 0.0 for cell in stated.get("Delta_X", []) if cell}
    if len(intervals) > 1:
        cause = "the channels have different intervals (" + ", ".join(f"{step:g} s" for step in sorted(intervals)) + ")"
        raise FileError(f"{cause} and no columns of their times", "Save it with X columns (Multi), or one file a rate.")
    return replace(dialect, units=tuple(units), interval_s=next(iter(intervals), 0.0))


def without_heads(lines: Iterable[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    """Yield numbered lines without the heads of further segments of a LabVIEW measurement."""
    inside = False
    for at, line in lines:
        ends = inside and line.startswith(_LVM_HEAD_ENDS)
        inside = (inside or line.startswith("Channels\t")) and not ends
        if not (inside or ends or line.startswith("X_Value\t")):
            yield at, line


def number(cell: str, decimal: str) -> float | None:
    """Return a cell as a number, NaN where it is empty or a missing value, None where it is something else."""
    cell = cell.strip().strip('"').strip().translate(_MINUS)
    if cell.lower() in MISSING:
        return math.nan
    if "_" in cell:
        return None
    cell = _GROUPS.sub("", cell)
    if cell[:1] in ("+", "-"):
        cell = cell[0] + cell[1:].lstrip()
    if _GROUPED[decimal].match(cell):
        cell = cell.replace("," if decimal == "." else ".", "")
    if decimal == ",":
        if "." in cell:
            return None
        cell = cell.replace(",", ".")
    try:
        return float(cell)
    except ValueError:
        return None


def records(lines: Iterable[tuple[int, str]]) -> Iterator[tuple[int, str]]:
    """Join lines that one quoted cell spans; each record keeps the number of its first line."""
    held: list[tuple[int, str]] = []
    for at, line in lines:
        held.append((at, line))
        whole = "\n".join(text for _, text in held)
        if whole.count('"') % 2 == 0:
            yield held[0][0], whole
            held = []
        elif len(held) > MAX_QUOTED_LINES:
            yield from held
            held = []
    yield from held


def _refuse_endless_lines(name: str, file: BinaryIO) -> None:
    longest = f"{name} has a line longer than {MAX_LINE_BYTES >> 20} MB"
    rest = b""
    while chunk := file.read(MAX_LINE_BYTES):
        lines = (rest + chunk.replace(b"\0", b"")).replace(b"\r", b"\n").split(b"\n")
        if max(map(len, lines)) > MAX_LINE_BYTES:
            raise FileError(longest, "It is not a table of numbers.")
        rest = lines[-1]


def cells_of(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    try:
        return next(csv.reader(io.StringIO(line), delimiter=separator), [])
    except csv.Error:  # a cell beyond csv's limit: one text, no number
        return [line]


def is_comment(line: str) -> bool:
    """Return whether a line is blank or a comment."""
    return not line.strip() or (line.lstrip('\ufeff" \t').startswith(COMMENTS) and not _NUMBERED.match(line))


def _score(lines: list[str], separator: str, decimal: str) -> tuple[float, int]:
    """Share of the cells that are numbers in rows of the commonest width (at least two columns), and that width."""
    rows = [cells_of(line, separator) for line in lines if not is_comment(line)]
    data = [cells for cells in rows if _is_data(cells, decimal)]
    if not data:
        return 0.0, 0
    widths = Counter(map(len, data))
    width = max(widths, key=lambda w: (widths[w], w))
    shares = (sum(_is_value(cell, decimal) for cell in cells) / width for cells in data if len(cells) == width)
    return round(sum(shares) / len(rows), 3), width


def measured(cell: str, decimal: str) -> tuple[float, str] | None:
    """Return number and unit of a cell such as `0.02 sec`; None where it is something else."""
    parts = _MEASURED.match(cell.strip())
    value = number(parts[1], decimal) if parts and known_unit(parts[2]) else None
    return None if parts is None or value is None else (value, parts[2])


def _is_value(cell: str, decimal: str) -> bool:
    return number(cell, decimal) is not None or is_stamp(cell) or measured(cell, decimal) is not None


def _is_data(cells: list[str], decimal: str) -> bool:
    """True where most cells are numbers or stamps: a text column (a branch, a note) is allowed beside them."""
    values = [number(cell, decimal) for cell in cells]
    stamps = sum(v is None and _is_value(cell, decimal) for v, cell in zip(values, cells, strict=True))
    numeric = stamps + sum(v is not None and not math.isnan(v) for v in values)
    words = sum(v is None for v in values) - stamps
    return len(cells) >= 2 and numeric >= 1 and numeric >= words


def _dialect(lines: list[tuple[int, str]], encoding: str, separator: str, decimal: str, width: int) -> Dialect:
    above: list[list[str]] = []
    comments: list[str] = []
    data_line, bare_end, noted = 0, False, False
    body = _body([line for _, line in lines], separator, decimal, width)
    for number_of, (at, line) in enumerate(lines):
        if is_comment(line):
            if line.strip():
                bare = line.lstrip("\ufeff")
                whole = (cells_of(bare, ",") or [""])[0] if line.startswith('"') else bare
                comments.append(whole.strip().lstrip("".join(COMMENTS)).strip())
            continue
        cells = cells_of(line.lstrip("\ufeff"), separator)
        noted = any(len(titles) == width + 1 and titles[-1].strip().lower() in _NOTES for titles in above)
        if (
            len(cells) in (width, width + noted)
            and _is_data(cells, decimal)
            and _goes_on(width, lines[number_of + 1 :], separator, decimal)
            and not _is_preamble(cells[:width], body, decimal, titled=any(map(_has_titles, above)))
        ):
            data_line, bare_end = at, not cells[-1].strip()
            break
        above.append(cells)
    titles = [_fitted(cells, width, bare_end) for cells in above if abs(len(cells) - width) <= 1]
    titles = [cells for cells in titles if any(cell.strip() for cell in cells)]
    commented = [cells for text in comments if len(cells := _cells_of_comment(text, separator, width)) == width]
    if not titles or not any(map(_recognised, titles)):
        titles = [cells for cells in commented if any(number(cell, decimal) is None for cell in cells)] or titles
    header, units = _header(titles)
    steps = [number(unit, decimal) for title, unit in zip(header, units, strict=False) if title.lower() == "increment"]
    stated = [{*filter(None, row[1:])} for row in above if row and row[0].strip(' []()"').lower() in _INTERVALS]
    steps += [number(row.pop(), decimal) for row in stated if len(row) == 1]
    interval_s = next((step for step in steps if step and step > 0), 0.0)
    return Dialect(
        encoding,
        separator,
        decimal,
        data_line,
        header,
        units,
        tuple(comments),
        width,
        noted=noted,
        interval_s=interval_s,
    )


def _goes_on(width: int, below: Sequence[tuple[int, str]], separator: str, decimal: str) -> bool:
    """Return whether one of the next two rows has numbers too: a lone row above titles is part of a preamble."""
    rows = [cells_of(line, separator) for _, line in below if not is_comment(line)][:2]
    return not rows or any(len(row) == width and _is_data(row, decimal) for row in rows)


def _body(lines: list[str], separator: str, decimal: str, width: int) -> list[bool | None]:
    """Return which columns hold numbers or stamps in most of the last rows of the head; None for an empty one."""
    rows = [cells_of(line, separator) for line in lines[-min(_BODY, (len(lines) + 1) // 2) :] if not is_comment(line)]
    rows = [row for row in rows if len(row) == width and _is_data(row, decimal)]
    filled = [[row[k] for row in rows if row[k].strip()] for k in range(width)]
    return [sum(_is_value(cell, decimal) for cell in c) >= _MOSTLY * len(c) if c else None for c in filled]


def _is_preamble(cells: list[str], body: list[bool | None], decimal: str, *, titled: bool) -> bool:
    """Return whether a row with numbers has words where the rows of the table have numbers: a title such as 3.

    Or a word in the first column, where that is empty. Below titles a word such as OVLD is expected, but not in the
    first column or in half of them.
    """
    values = [bool(cell.strip()) and _is_value(cell, decimal) for cell in cells]
    words = [bool(cell.strip()) and not value for cell, value in zip(cells, values, strict=True)]
    wrong = any(word and of_table for word, of_table in zip(words, body, strict=True))
    right = sum(value and of_table is True for value, of_table in zip(values, body, strict=True))
    if words[0] and body[0] is None:
        return True
    return wrong and (not titled or 2 * right <= sum(map(bool, body)) or (words[0] and body[0] is True))


def _cells_of_comment(text: str, separator: str, width: int) -> list[str]:
    """Return the cells of a header behind # or %; of words between blanks where the separator does not occur."""
    cells = cells_of(text, separator)
    return cells if len(cells) == width else text.split()


def _fitted(titles: list[str], width: int, bare_end: bool) -> list[str]:
    """Titles for every column: one too few leaves the empty last column bare, or the first one, of the rows' names."""
    if len(titles) < width:
        return [*titles, ""] if bare_end else ["", *titles]
    return titles[:width]


def _recognised(titles: list[str]) -> int:
    """Return the number of known titles, and of units behind titles."""
    split = [split_unit(cell) for cell in titles if not known_unit(cell)]
    return sum((recognised(*one) is not None) + (quantity_of(one[1]) != "") for one in split)


def _has_titles(titles: list[str]) -> bool:
    return any(recognised(*split_unit(cell)) is not None and not known_unit(cell) for cell in titles)


def _header(titles: list[list[str]]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return titles and units: of the row with the most known titles, and of a row of units above or below it."""
    bare = [[cell.strip(' []()"') for cell in cells] for cells in titles]
    are_units = [_are_units([cell for cell in cells if cell]) for cells in bare]
    rows = [at for at in range(len(titles)) if not are_units[at]] or list(range(len(titles)))
    if not rows:
        return (), ()
    best = max(rows, key=lambda at: (_recognised(titles[at]), at))
    if best and not (_recognised(titles[best]) or any(are_units)) and all(len(cell) <= 6 for cell in bare[best]):
        best -= 1  # titles and units that are not known
        return tuple(split_unit(c)[0] for c in titles[best]), tuple(bare[best + 1])
    split = [split_unit(cell) for cell in titles[best]]
    units = [unit for _, unit in split]
    found = [at for at in range(len(titles)) if at != best and are_units[at]]
    if not found and best + 1 < len(titles):
        below = bare[best + 1]
        if sum(map(known_unit, below)) > 1:  # beside other words
            bare[best + 1], found = [cell if known_unit(cell) else "" for cell in below], [best + 1]
        elif all(len(cell) <= 6 for cell in below):
            found = [best + 1]
    for at in found[:1]:
        stated = ["" if cell.lower() in _OF_UNITS else cell for cell in bare[at]]
        units = [unit or below for unit, below in zip(units, stated, strict=True)]
    names = [name for name, _ in split]
    for at in [at for at in rows if at < best][::-1]:  # a title that is blank is in a row above
        names = [name or above for name, above in zip(names, bare[at], strict=True)]
    return tuple(names), tuple(units)


def _are_units(cells: list[str]) -> bool:
    """Return whether a row is one of units; an oscilloscope has the count of the rows and its interval beside them."""
    known = sum(map(known_unit, cells))
    return known == len(cells) or (cells[0].lower() in (*_COUNTED, *_OF_UNITS) and known > 0)


_MARKS = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
_SAMPLE = 200  # bytes in which NULs are counted
_MOST = 64_000  # bytes of lines with other than ASCII that are compared with the habits of languages
_RUN = re.compile(rb"[\x80-\xff]{2}")  # hardly ever in western text, in nearly every word of the others
_WORDS = (
    "时间", "压力", "信号", "電圧", "時間", "時刻", "圧力", "壓力", "訊號", "信號", "시간", "압력", "신호",
    "время", "давление", "сигнал", "χρόνος", "πίεση", "σήμα", "זמן", "לחץ", "אות", "الوقت", "الزمن", "الضغط", "الإشارة",
)  # fmt: skip
_ESCAPE = b"\x1b$"  # shifts ISO 2022 to Japanese
_WESTERN = "cp1252"
_CENTRAL_EUROPEAN = ["cp1250", "cp1257", "cp1254"]
_OTHERS = ["cp932", "euc_jp", "cp949", "gb18030", "big5", "cp1251", "koi8_r", "cp866", "cp1253", "cp1255", "cp1256"]


def encoding_of(head: bytes, *, whole: bool = True) -> str:
    """Return the name of the encoding by the first bytes; the last character may be cut if they are not the `whole`."""
    for mark, name in _MARKS:
        if head.startswith(mark):
            return name
    if head[:_SAMPLE].count(0) > len(head[:_SAMPLE]) // 4:  # every other byte of plain text in UTF-16
        return "utf-16-be" if head[:1] == b"\0" else "utf-16-le"
    if _ESCAPE in head:
        return "iso2022_jp"
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head, final=whole)
    except UnicodeDecodeError:
        return _of_bytes(b"\n".join(line for line in head.splitlines() if not line.isascii())[:_MOST])
    return "utf-8"


def _of_bytes(lines: bytes) -> str:
    """Return the encoding of lines that are no UTF-8."""
    if _RUN.search(lines):
        return _likeliest(lines, _OTHERS)
    if _is_western(lines):
        return _WESTERN
    return _likeliest(lines, _CENTRAL_EUROPEAN)


def _is_western(lines: bytes) -> bool:
    """Whether every high byte is a character of cp1252, and none a symbol between the letters of a word."""
    try:
        text = lines.decode(_WESTERN)
    except UnicodeDecodeError:
        return False
    return not any(
        not now.isascii() and not now.isalpha() and before.isalpha() and after.isalpha()
        for before, now, after in zip(text, text[1:], text[2:], strict=False)
    )


def _likeliest(lines: bytes, among: list[str]) -> str:
    from charset_normalizer import from_bytes  # only such a file needs it

    ranked = list(from_bytes(lines, cp_isolation=among, threshold=0.5))
    best = max(ranked, key=lambda match: sum(word in str(match).lower() for word in _WORDS), default=None)
    return best.encoding if best is not None else _WESTERN
