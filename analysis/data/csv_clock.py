"""Columns of clock times: times of day, and dates with times, as seconds since their first row.

Rules: only what can be read in one way: ISO 8601, day.month.year, and hours:minutes:seconds; 3/4/2026 is nobody's date
and stays text. A time of day that falls by more than twelve hours went over midnight.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

DAY_S = 86_400.0
_TIME = r"\d{1,2}:\d{2}:\d{2}(?:[.,]\d+)?"
_OF_DAY = re.compile(rf"^{_TIME}$")
_ISO = re.compile(rf"^\d{{4}}-\d{{2}}-\d{{2}}[T ]{_TIME}(?:Z|[+-]\d{{2}}:?\d{{2}})?$")
_DOTTED = re.compile(rf"^(\d{{1,2}})\.(\d{{1,2}})\.(\d{{4}}) ({_TIME})$")


@dataclass(frozen=True, slots=True)
class Clock:
    """Seconds since the first row [n], and what the cells are, in words."""

    seconds: npt.NDArray[np.float64]
    said: str


def seconds_of(cells: Sequence[str]) -> Clock | None:
    """Return clock times as seconds since the first; None where any cell is something else."""
    if not cells:
        return None
    if all(_OF_DAY.match(cell) for cell in cells):
        seconds = np.asarray([_of_day(cell) for cell in cells])
        midnights = np.cumsum(np.diff(seconds, prepend=seconds[0]) < -DAY_S / 2)
        over = f", over midnight {midnights[-1]} time{'s' if midnights[-1] > 1 else ''}" if midnights[-1] else ""
        return Clock(np.round(seconds + DAY_S * midnights - seconds[0], 9), f"times of day{over}")
    dated = [_two_digits(_DOTTED.sub(r"\3-\2-\1 \4", cell).replace(",", ".")) for cell in cells]
    if not all(_ISO.match(cell) for cell in dated):
        return None
    try:
        instants = pd.to_datetime(dated, format="ISO8601", utc=True)
    except (ValueError, OverflowError):
        return None  # the 31st of February
    return Clock((instants - instants[0]).total_seconds().to_numpy(dtype=np.float64), "dates and times")


def _of_day(cell: str) -> float:
    hours, minutes, seconds = cell.replace(",", ".").split(":")
    return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds)


def _two_digits(cell: str) -> str:
    """Write 2026-3-1 9:00:00 as 2026-03-01 09:00:00."""
    return re.sub(r"(?<=[-T ])(\d)(?=[-: ])", r"0\1", cell)
