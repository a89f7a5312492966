"""Deformation curves from CSV: x and z in mm, 7 points or more a guide, two guides a state, 1 or 15 states.

Accepted, in this order of preference (METHODS.md, "Curve files"):

1. **Named columns**: `x` and `z` (or x_mm, z_mm), with a column for the guide (guide, waveguide, curve, side; any two
   labels) and one for the state (state, frame, step, elongation_mm, pressure_kpa; any 15 numbers, sorted upwards:
   compressed first).
2. **Side by side**: x1, z1, x2, z2 (also x1_mm, ...), with or without a state column.
3. **Plain**: two columns x, z, with or without a header. Guides follow one another, separated by a blank line or
   recognised by the jump from the end of one to the start of the next; 2 runs are one state, 30 runs are 15 states, the
   two guides of a state together. A single run is one guide, and the other is its mirror image in the line through its
   ends.
4. **A folder** of 15 such files with one state each, in the order of their names.

Separators: comma, semicolon, tab or spaces; decimal commas where the separator is not a comma; `#` begins a comment.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from analysis.optics.scene.curves import POINTS, checked_curves, default_curves, parametric_curves
from analysis.optics.scene.parameters import STATES
from protocol.base.arrays import FloatArray
from protocol.base.errors import FileError

_STATE = ("state", "frame", "step", "elongation_mm", "elongation", "pressure_kpa", "pressure")
_GUIDE = ("guide", "waveguide", "curve", "side", "sensor", "boat")
_FORM = "give CSV with x and z in mm, 7 points or more for each of the two guides, for 1 state or 15"
_JUMP = 3.0
_MAX_BYTES = 16_000_000  # 15 states of two guides with a thousand points take 2 MB
_MAX_LINE = 10_000  # characters; a row has five cells
_MAX_LINES = 400_000  # of 16 MB, blank ones too: a list for each row
_MIRROR_FLAT = 1e-6


def curves_named(name: str) -> FloatArray:
    """Return the curves of `default`, `parametric` or a file; see `read_curves`."""
    packaged = {"default": default_curves, "parametric": parametric_curves}
    return packaged[name]() if name in packaged else read_curves(Path(name))


def read_curves(path: Path) -> FloatArray:
    """Read the curves of 1 or 15 states, (states, 2, points, 2) in mm; a guide with fewer points is rejected."""
    files = sorted(path.glob("*.csv"), key=_natural) if path.is_dir() else [path]
    if len(files) not in (1, STATES):
        raise FileError(f"{path} holds {len(files)} CSV files", f"put {STATES} into it, one for each state")
    return checked_curves(_stack([state for file in files for state in _states(file)], path))


def _natural(path: Path) -> tuple[list[int], str]:
    return [int(part) for part in re.findall(r"\d+", path.stem)], path.stem


def _stack(states: list[list[FloatArray]], path: Path) -> FloatArray:
    _check_states(len(states), path)
    lengths = {len(guide) for state in states for guide in state}
    if min(lengths) < POINTS:
        raise FileError(f"{path}: a guide has {min(lengths)} points", f"give {POINTS} points or more for each guide")
    if len(lengths) > 1:
        cause = f"{path}: guides have {', '.join(map(str, sorted(lengths)))} points"
        raise FileError(cause, "give every guide the same number of points")
    return np.array(states)


def _states(path: Path) -> list[list[FloatArray]]:
    rows = _rows(path)
    first = next((at for at, row in enumerate(rows) if row), 0)
    head = [cell.strip().lower() for cell in rows[first]] if rows else []
    if not head:
        raise FileError(f"{path} holds no points", _FORM)
    if all(_number(cell) is not None for cell in head):
        return _plain(_table(rows, path), path)
    body = rows[first + 1 :]
    head = [re.sub(r"\s*[\[(]\s*mm\s*[\])]$|_mm$", "", cell) if cell not in _STATE else cell for cell in head]
    _check_units(head, path)
    if {"x1", "z1", "x2", "z2"} <= set(head):
        return _side_by_side(head, _table(body, path, len(head)), path)
    if {"x", "z"} <= set(head):
        return _named(head, body, path)
    raise FileError(f"{path} has the columns {', '.join(head)}, but no x and z", _FORM)


def _rows(path: Path) -> list[list[str]]:
    """Return the cells of every line; an empty list for a blank line."""
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for, a device never ends
            raise FileError(f"{path} is not a regular file", "choose the file with the curves")
        if path.stat().st_size > _MAX_BYTES:
            raise FileError(f"{path} is larger than {_MAX_BYTES // 1_000_000} MB", "choose the file with the curves")
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise FileError(f"there is no curve file {path}", "check its name and folder") from error
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}", "choose the file with the curves") from error
    except UnicodeDecodeError as error:
        raise FileError(f"{path} cannot be read as text: {error}", _FORM) from error
    lines = text.splitlines()
    if len(lines) > _MAX_LINES:
        raise FileError(f"{path} has more than {_MAX_LINES} lines", "give fewer points for each guide")
    if max(map(len, lines), default=0) > _MAX_LINE:
        raise FileError(f"{path} has a line of more than {_MAX_LINE} characters", _FORM)
    lines = [line.split("#")[0].strip() for line in lines if not line.lstrip().startswith("#")]
    full = [line for line in lines if line]
    separator = next((s for s in (";", "\t", ",") if full and all(s in line for line in full[:3])), None)
    comma = separator in (";", "\t") or (separator is None and not any("." in line for line in full))
    return [
        [c.strip().replace(",", ".") if comma else c.strip() for c in line.split(separator)]
        if line.strip(",;\t ")
        else []
        for line in lines
    ]


def _check_units(head: list[str], path: Path) -> None:
    other = [cell for cell in head if re.fullmatch(r"[xz][12]?[_ \[(]+(m|cm|um|µm|in|inch)[\])]?", cell)]
    if other:
        raise FileError(f"{path}: column '{other[0]}' is not in mm", "convert the curves to mm")


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _table(rows: Sequence[list[str]], path: Path, width: int = 2) -> FloatArray:
    """Return the numbers of all rows; a blank line becomes a row of NaN."""
    out = []
    for line, row in enumerate(rows, start=1):
        values = [_number(cell) for cell in row]
        if row and (len(row) < width or any(v is None or not np.isfinite(v) for v in values[:width])):
            raise FileError(f"{path}: row {line} is '{', '.join(row)}', which is not {width} numbers", _FORM)
        out.append([v if v is not None else np.nan for v in values[:width]] if row else [np.nan] * width)
    if not out:
        raise FileError(f"{path} holds a header but no points", _FORM)
    return np.array(out, dtype=float)


def _column(head: list[str], names: Sequence[str]) -> int | None:
    """Return the column of the first of some names; None without one."""
    return next((head.index(name) for name in names if name in head), None)


def _named(head: list[str], body: list[list[str]], path: Path) -> list[list[FloatArray]]:
    guide, state = _column(head, _GUIDE), _column(head, _STATE)
    wanted = [head.index("x"), head.index("z"), *([state] if state is not None else [])]
    if any(row and len(row) <= max(*wanted, guide or 0) for row in body):
        raise FileError(f"{path}: a row has fewer cells than the header", _FORM)
    table = _table([[row[i] for i in wanted] if row else [] for row in body], path, len(wanted))
    kept = np.isfinite(table[:, 0])
    labels = np.array([row[guide] if row and guide is not None else "" for row in body])
    if state is None and guide is None:
        return _plain(table, path)
    values = np.unique(table[kept, 2]) if state is not None else np.zeros(1)
    _check_states(len(values), path)
    states = [kept & (table[:, 2] == value) for value in values] if state is not None else [kept]
    if guide is None:
        return [_pair(_runs(table[rows, :2], path), path) for rows in states]
    return [[table[rows & (labels == label), :2] for label in _two(labels[rows], path)] for rows in states]


def _two(labels: np.ndarray[tuple[int], np.dtype[np.str_]], path: Path) -> list[str]:
    found = list(dict.fromkeys(labels.tolist()))
    if len(found) != 2:
        cause = f"{path}: a state has {len(found)} guides ({', '.join(found)})"
        raise FileError(cause, "name two guides in every state")
    return found


def _side_by_side(head: list[str], table: FloatArray, path: Path) -> list[list[FloatArray]]:
    table = table[np.isfinite(table[:, 0])]
    columns = [[head.index(f"x{n}"), head.index(f"z{n}")] for n in (1, 2)]
    state = _column(head, _STATE)
    if state is None:
        groups = np.split(table, STATES if len(table) % STATES == 0 and len(table) >= STATES * POINTS else 1)
    else:
        values = np.unique(table[:, state])
        _check_states(len(values), path)
        groups = [table[table[:, state] == value] for value in values]
    return [[group[:, pair] for pair in columns] for group in groups]


def _check_states(number: int, path: Path) -> None:
    if number not in (1, STATES):
        raise FileError(f"{path} holds {number} states", f"give one state, or {STATES}")


def _plain(table: FloatArray, path: Path) -> list[list[FloatArray]]:
    runs = _runs(table[:, :2], path)
    if len(runs) <= 2:
        return [_pair(runs, path)]
    if len(runs) % 2:
        cause = f"{path} holds {len(runs)} guides"
        raise FileError(cause, f"give two guides for one state, or {2 * STATES} for {STATES}")
    return [runs[i : i + 2] for i in range(0, len(runs), 2)]


def _pair(runs: list[FloatArray], path: Path) -> list[FloatArray]:
    if len(runs) == 1:
        return [runs[0], mirrored(runs[0], path)]
    if len(runs) != 2:
        cause = f"{path}: a state has {len(runs)} guides"
        raise FileError(cause, "separate two guides by a blank line, or name them in a column")
    return runs


def _runs(xz: FloatArray, path: Path) -> list[FloatArray]:
    """Split points into guides: at blank lines, else where the points jump, repeat or turn back."""
    blank = ~np.isfinite(xz[:, 0])
    parts = [part[np.isfinite(part[:, 0])] for part in np.split(xz, np.flatnonzero(blank))]
    if sum(len(part) > 0 for part in parts) > 1:
        return [part for part in parts if len(part)]
    xz = xz[~blank]
    if len(xz) < POINTS:
        raise FileError(f"{path} holds {len(xz)} points", _FORM)
    step = np.diff(xz, axis=0)
    length = np.hypot(step[:, 0], step[:, 1])
    usual = float(np.median(length))
    dot = np.sum(step[1:] * step[:-1], axis=1)
    back = np.concatenate([[False], dot < -0.5 * length[1:] * length[:-1]])
    apart = (length > _JUMP * usual) | (length < 1e-6 * usual) | back
    cuts = [int(c) + 1 for i, c in enumerate(np.flatnonzero(apart)) if i == 0 or not apart[c - 1]]
    return np.split(xz, cuts)


def mirrored(guide: FloatArray, path: Path) -> FloatArray:
    """Return the mirror image of a guide (n, 2) in the line through its two ends."""
    chord = guide[-1] - guide[0]
    span = float(np.hypot(*chord))
    if span == 0.0:
        raise FileError(f"{path}: the only guide ends where it begins", "give two guides, separated by a blank line")
    normal = np.array([-chord[1], chord[0]]) / span
    height = (guide - guide[0]) @ normal
    if np.max(np.abs(height)) < _MIRROR_FLAT * span:
        raise FileError(f"{path}: the only guide is straight, so that its mirror image is itself", "give both guides")
    return np.asarray(guide - 2 * height[:, None] * normal)
