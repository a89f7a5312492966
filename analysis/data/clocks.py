"""Clocks of other programs: stamps as text, clocks that begin again, coarse stamps, and values of another clock.

Stamps of one column have one form; a date whose day and month could be exchanged is none until their order is stated. A
clock that begins again at a usual value (60 s, 3,600 s, 2^16 or 2^32 of ms or us, ...)
within a few sampling intervals wrapped; any other fall of time is none.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from protocol.base.arrays import BoolArray, FloatArray
from protocol.base.clock_wraps import NEAR_WRAP, usual_wraps, wrap_between

DAY_S = 86_400.0
FASTEST_HZ = 1e6
LONGEST_RUN_S = 366 * DAY_S
FEWEST = 10  # samples by which a clock can be judged
COARSE = 0.5  # share of the rows that repeat a stamp, from which it is coarser than the sampling
SPARSE = 0.67  # share of the rows with a value, up to which a column has a lower rate
REGULAR = 0.9  # share of its intervals that are alike

_TIME = r"(?P<h>\d{1,2}):(?P<m>\d{2})(?::(?P<s>\d{2}(?:[.,:]\d+)?))?(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?"
_PACKED = r"(?P<h>\d{2})(?P<m>\d{2})(?P<s>\d{2}(?:[.,]\d+)?)"
_DASHED = r"(?P<h>\d{2})-(?P<m>\d{2})-(?P<s>\d{2}(?:[.,]\d+)?)"
_ZONE = r"\s*(?P<zone>Z|UTC|GMT|[+-]\d{2}:?\d{2})?"
_MONTH = r"(?P<word>[A-Za-zäéû]{3,9})\.?"
_FORMS = tuple(
    re.compile(form)
    for form in (
        rf"(?P<y>\d{{4}})[-/.:年](?P<a>\d{{1,2}})[-/.:月](?P<d>\d{{1,2}})日?[T ,_]\s*{_TIME}{_ZONE}",
        rf"(?P<y>\d{{4}})-(?P<a>\d{{2}})-(?P<d>\d{{2}})[T _]{_DASHED}{_ZONE}",
        rf"(?P<y>\d{{4}})(?P<a>\d{{2}})(?P<d>\d{{2}})T{_PACKED}{_ZONE}",
        rf"(?P<y>\d{{4}})(?P<a>\d{{2}})(?P<d>\d{{2}})[T _-]{_TIME}{_ZONE}",
        rf"(?P<d>\d{{1,2}})\.(?P<a>\d{{1,2}})\.(?P<y>\d{{4}}|\d{{2}})[T ,]\s*{_TIME}{_ZONE}",
        rf"(?P<one>\d{{1,2}})(?:/|-)(?P<two>\d{{1,2}})(?:/|-)(?P<y>\d{{4}}|\d{{2}})[T ,]\s*{_TIME}{_ZONE}",
        rf"(?P<d>\d{{1,2}})[-/ .]\s*{_MONTH}[-/ ,]\s*(?P<y>\d{{4}}|\d{{2}})[T ,]\s*{_TIME}{_ZONE}",
        rf"(?:[A-Za-z]{{3}},? )?{_MONTH} (?P<d>\d{{1,2}}),? (?P<y>\d{{4}})[T ,]\s*{_TIME}{_ZONE}",
        rf"[A-Za-z]{{3}} {_MONTH} (?P<d>\d{{1,2}}) {_TIME} (?P<y>\d{{4}})",
        rf"(?P<days>\d+) days?,? {_TIME}",
        rf"(?P<days>\d+)\.{_TIME}",
        _TIME,
        r"(?P<m>\d{1,2}):(?P<s>\d{2}[.,]\d+)",
    )
)
_MONTH_WORDS = {
    "jan": 1, "feb": 2, "fév": 2, "fev": 2, "mar": 3, "mär": 3, "mrz": 3, "maa": 3, "mrt": 3, "apr": 4, "avr": 4,
    "may": 5, "mai": 5, "mei": 5, "jun": 6, "jui": 6, "jul": 7, "aug": 8, "aoû": 8, "sep": 9, "oct": 10, "okt": 10,
    "nov": 11, "dec": 12, "dez": 12, "déc": 12,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Stamps:
    """Stamps as seconds [n], of the day of the first date or of midnight; `zone` is True where they name their own."""

    seconds: FloatArray
    kind: str
    midnight: str = ""  # of the first date, ISO 8601
    zone: bool = False


def is_stamp(cell: str) -> bool:
    """Return whether a cell is a date with time, or a time of day."""
    text = _tidy(cell)
    return any(sign in text for sign in ":-T") and any(form.fullmatch(text) for form in _FORMS)


def _tidy(cell: str) -> str:
    return " ".join(cell.strip().strip("[]'\"").split())


def read_stamps(cells: Sequence[str], order: str = "") -> Stamps | None:
    """Return a column of stamps, NaN where a cell is empty; None where one is something else, or ambiguous.

    `order` is "dmy" or "mdy" where day and month are stated.
    """
    first = next((_tidy(cell) for cell in cells if cell), "")
    forms = [form for form in _FORMS if form.fullmatch(first)]
    if not forms:
        return None
    fast = _iso(cells) if forms[0] is _FORMS[0] else None
    if fast is not None:
        return fast
    text = pd.Series(cells, dtype=object).str.strip().str.strip("[]'\"").str.replace(r"\s+", " ", regex=True)
    empty = (text == "").to_numpy()
    for form in forms:
        parts = text[~empty].str.extract(rf"^{form.pattern}$")
        core = next(name for name in ("m", "h", "d") if name in parts)
        if parts[core].notna().all():
            seconds = _seconds(parts, order)
            return None if seconds is None else _spread_out(seconds, empty)
    return None


def _spread_out(found: Stamps, empty: BoolArray) -> Stamps:
    if not empty.any():
        return found
    seconds = np.full(empty.size, np.nan)
    seconds[~empty] = found.seconds
    return Stamps(seconds, found.kind, found.midnight, found.zone)


def _iso(cells: Sequence[str]) -> Stamps | None:
    """Return stamps of ISO 8601, which pandas reads at speed; None where it does not read all."""
    try:
        instants = pd.to_datetime(pd.Series(cells, dtype=object).replace("", None), format="ISO8601", utc=True)
    except (ValueError, OverflowError):
        return None
    known = instants.dropna()
    if known.empty:
        return None
    midnight = known.iloc[0].normalize()
    seconds = (instants - midnight).dt.total_seconds().to_numpy(dtype=np.float64)
    first = next(cell for cell in cells if cell).strip()
    zone = re.search(r"(?:Z|[+-]\d{2}:?\d{2})$", first[10:]) is not None
    return Stamps(np.asarray(seconds, np.float64), "dates and times", midnight.date().isoformat(), zone)


def _seconds(parts: pd.DataFrame, order: str) -> Stamps | None:
    """Return the seconds in the parts of stamps; None for a date that is none, or is ambiguous."""
    number = {
        name: pd.to_numeric(parts[name], errors="coerce").to_numpy(np.float64)
        for name in ("h", "m", "d", "a", "y", "one", "two", "days")
        if name in parts and parts[name].notna().any()
    }
    shown = parts["s"].fillna("0") if "s" in parts else pd.Series("0", index=parts.index)
    seconds = pd.to_numeric(shown.str.replace(r"[,:]", ".", regex=True)).to_numpy(np.float64)
    hours = number.get("h", np.zeros(len(parts)))
    if "half" in parts and parts["half"].notna().any():
        hours = hours % 12 + 12 * (parts["half"].str.lower() == "p").to_numpy()
    if (hours > 24).any() or (number["m"] > 59).any() or (seconds >= 61).any():
        return None
    seconds = np.round(3600.0 * hours + 60.0 * number["m"] + seconds, 9)
    if "days" in number:
        return Stamps(seconds + DAY_S * number["days"], "times with days")
    date = _dates(parts, number, order)
    if date is None:
        midnights = np.cumsum(np.diff(seconds, prepend=seconds[0]) < -DAY_S / 2) if "y" not in number else None
        if midnights is None:
            return None
        over = f", over midnight {midnights[-1]} time{'s' if midnights[-1] > 1 else ''}" if midnights[-1] else ""
        return Stamps(np.round(seconds + DAY_S * midnights, 9), f"times of day{over}")
    day, midnight = date
    zone = parts["zone"].fillna("") if "zone" in parts else pd.Series("", index=parts.index)
    if (zone != "").any():
        sign = np.where(zone.str.startswith("-"), -1.0, 1.0)
        digits = zone.str.replace(r"\D", "", regex=True).str.zfill(4)
        offset = pd.to_numeric(digits.str[:2]) * 3600.0 + pd.to_numeric(digits.str[2:]) * 60.0
        seconds = seconds - sign * offset.to_numpy()
    return Stamps(seconds + DAY_S * day, "dates and times", midnight, bool((zone != "").all()))


def _dates(parts: pd.DataFrame, number: dict[str, FloatArray], order: str) -> tuple[FloatArray, str] | None:
    """Return days since the first date [n], and that date; None where it is none or may be read in two ways."""
    if "y" not in number:
        return None
    year = number["y"] + np.where(number["y"] < 100, 2000.0, 0.0)
    if "one" in number:
        one, two = number["one"], number["two"]
        if one.max() > 12 or two.max() > 12:
            day, month = (one, two) if one.max() > 12 else (two, one)
        elif (one == two).all():
            day, month = one, two
        elif order:
            day, month = (one, two) if order == "dmy" else (two, one)
        else:
            return None
    else:
        day = number["d"]
        words = parts["word"].str.lower().str[:3].map(_MONTH_WORDS) if "word" in parts else None
        month = number["a"] if words is None else np.asarray(words, np.float64)
    frame = pd.DataFrame({"year": year, "month": month, "day": day})
    dates = pd.to_datetime(frame.drop_duplicates(), errors="coerce")
    if dates.isna().any():
        return None
    whole = frame.merge(frame.drop_duplicates().assign(date=dates), how="left")["date"]
    first = whole.iloc[0]
    return (whole - first).dt.days.to_numpy(np.float64), first.date().isoformat()


def resolution(seconds: FloatArray) -> float:
    """Return the step of stamps, s: the largest power of ten from 1 s to 1 us of which all are multiples."""
    known = seconds[np.isfinite(seconds)]
    return next((10.0**-k for k in range(6) if np.allclose(np.round(known, k), known, rtol=0.0, atol=1e-7)), 1e-6)


def unwrapped(time_s: FloatArray, factor: float) -> tuple[FloatArray, float] | None:
    """Return a clock that fell as one that only rises, and where it begins again, s; None where it did not wrap.

    `factor` is the seconds of a tick of the file. Rows without a time are NaN.
    """
    known = np.flatnonzero(np.isfinite(time_s))
    steps = np.diff(time_s[known])
    falls = np.flatnonzero(steps < 0)
    rising = steps[steps > 0]
    if not falls.size or not rising.size:
        return None
    interval = float(np.median(rising))
    pairs = list(zip(time_s[known[falls]].tolist(), time_s[known[falls + 1]].tolist(), strict=True))
    for wrap in usual_wraps(factor, decimals=True):
        if all(wrap_between(before, after, interval, (wrap,)) for before, after in pairs):
            result = time_s.copy()
            result[known] += wrap * np.concatenate(([0], np.cumsum(steps < 0)))
            return result, wrap
    return None


def without_summer_time(time_s: FloatArray, first_s: float) -> tuple[FloatArray, bool]:
    """Return times without a step of one hour to a full hour, as summer time makes, and whether there was one.

    `first_s` is the time of day at zero, s.
    """
    known = np.flatnonzero(np.isfinite(time_s))
    steps = np.diff(time_s[known])
    near = NEAR_WRAP * float(np.median(steps)) if steps.size else 0.0
    past = np.mod(time_s[known[1:]] + first_s + 1e-6, 3600.0)
    jumps = (steps > 3600.0) & (steps <= 3600.0 + near) & (past <= near)
    result = time_s.copy()
    result[known] -= 3600.0 * np.concatenate(([0], np.cumsum(jumps)))
    return result, bool(jumps.any())


def spread(time_s: FloatArray) -> FloatArray | None:
    """Return coarse stamps spread evenly until the next one; None where they do not repeat as coarse ones do.

    The first and the last stamp may have fewer rows; they have the usual interval.
    """
    edges = np.flatnonzero(np.diff(time_s) > 0) + 1
    if edges.size < 2 or (np.diff(time_s) < 0).any() or time_s.size - edges.size - 1 < COARSE * time_s.size:
        return None
    starts = np.concatenate(([0], edges))
    counts = np.diff(np.append(starts, time_s.size))
    ticks = np.diff(time_s[starts])
    tick = float(np.median(ticks))
    usual = float(np.median(counts[1:-1])) if counts.size > 2 else float(counts.max())
    steps = np.append(ticks, tick)
    long = steps > 1.5 * tick  # a pause: its rows are of one tick
    steps[long] = tick
    per_row = steps / np.where(long, usual, counts)
    per_row[[0, -1]] = np.minimum(per_row[[0, -1]], tick / usual)
    within = np.arange(time_s.size) - np.repeat(starts, counts)
    result = np.repeat(time_s[starts], counts) + within * np.repeat(per_row, counts)
    result[: counts[0]] += max(0.0, (usual - counts[0]) * per_row[0])  # the run began within the first tick
    return np.asarray(result, np.float64)


def refusal(time_s: FloatArray) -> str:
    """Return why rising times are no clock of a run; empty where they may be."""
    if time_s.size < FEWEST:
        return ""
    steps = np.diff(time_s)
    interval = float(np.median(steps))
    if interval <= 0:
        return ""
    if interval < 0.999 / FASTEST_HZ:
        return f"its samples would be {interval:.3g} s apart, {1e-6 / interval:.3g} MHz"
    if time_s[-1] - time_s[0] > LONGEST_RUN_S:
        return f"the run would take {(time_s[-1] - time_s[0]) / DAY_S:,.0f} days"
    return ""


def sparse_period(values: FloatArray) -> int:
    """Return every how many rows a column has a value, the others empty; 0 where it is not so."""
    rows = np.flatnonzero(np.isfinite(values))
    if not 3 <= rows.size <= SPARSE * values.size:
        return 0
    periods = np.diff(rows)
    usual = int(np.median(periods))
    return usual if usual > 1 and (periods == usual).mean() >= REGULAR else 0


def onto(time_s: FloatArray, own_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return values of another clock interpolated at `time_s` [n]; NaN outside, and where they are missing."""
    known = np.isfinite(own_s) & np.isfinite(values)
    own_s, values = own_s[known], values[known]
    if own_s.size < 2:
        return np.full(time_s.size, np.nan)
    longest = NEAR_WRAP * float(np.median(np.diff(own_s)))
    after = np.clip(np.searchsorted(own_s, time_s), 1, own_s.size - 1)
    near = (own_s[after] - own_s[after - 1] <= longest) & (time_s >= own_s[0]) & (time_s <= own_s[-1])
    return np.where(near, np.interp(time_s, own_s, values), np.nan)


def interpolated_holds(time_s: FloatArray, values: FloatArray, period: int) -> FloatArray:
    """Return a column that holds each value for `period` rows, interpolated between the rows where it may change."""
    changes = np.flatnonzero(np.diff(values) != 0) + 1
    phase = int(np.bincount(changes % period).argmax())
    kept = np.where(np.arange(values.size) % period == phase, values, np.nan)
    return np.where(np.arange(values.size) < phase, values, onto(time_s, time_s, kept))


def held_period(values: npt.NDArray[np.float64]) -> int:
    """Return for how many rows a column holds each value where it should change at every row; 0 where it does not."""
    known = values[np.isfinite(values)]
    changes = np.flatnonzero(np.diff(known) != 0)
    if changes.size < 10 or changes.size > known.size / 2:
        return 0
    periods = np.diff(changes)
    usual = int(np.median(periods))
    return usual if usual > 1 and (periods % usual == 0).mean() >= REGULAR else 0
