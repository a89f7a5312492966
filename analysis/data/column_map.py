"""The map from the columns of a table to ours: by the usual titles, or as the user maps them.

A guess is named in `warnings`. A text NAME=COLUMN[*SCALE][+OFFSET][:UNIT] maps a column: a number is a column's number,
anything else its name; the value is `cell * SCALE + OFFSET` in the unit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.data.clocks import read_stamps
from analysis.data.column_names import (
    OTHER_SIGNALS,
    PLAIN,
    SENSORS_IN_A_RECORDING,
    absolute_unit,
    guess_unit,
    is_signal,
    our_name,
    quantity_of,
    recognised,
    unit_for,
    unit_in_title,
    units_of,
)
from analysis.data.csv_table import Table, since_first
from analysis.warning import Warning, WarningCode
from protocol.base.arrays import FloatArray
from protocol.base.errors import RequestError
from protocol.base.units import conversion, find_unit
from protocol.recording import CHANNELS_MAX, RESERVED, ExtraChannel, channels_of

CHANNEL = "channel "  # before the position of an extra channel among the names of columns
MOST_LISTED = 20
_ALIKE = 0.01  # of the greatest pressure, by which the same pressure in two columns may differ
_STORED_UNITS = {"time_s": "s", "pressure_kpa": "kPa", "target_kpa": "kPa", "elongation_mm": "mm"}
_USUAL_UNITS = {"time_s": "ms", "pressure_kpa": "bar", "s1_mv": "V"}
_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_SCALED = re.compile(rf"^(?P<column>.+?)(?:\*(?P<scale>[+-]?{_NUMBER}))?(?P<offset>[+-]{_NUMBER})?$")
_ORDERS = ("dmy", "mdy")  # of day, month and year in stamps


@dataclass(frozen=True, slots=True)
class Column:
    """One column of the map: its position in the file; `cell * scale + offset` is in `unit`, times `factor` in ours."""

    position: int
    unit: str = ""
    factor: float = 1.0
    scale: float = 1.0
    offset: float = 0.0

    def values(self, table: Table) -> FloatArray:
        """Return the column in our unit [n]."""
        cells = table.columns[self.position]
        if self.scale != 1.0 or self.offset:
            cells = cells * self.scale + self.offset
        return cells * self.factor


@dataclass(frozen=True, slots=True)
class ColumnMap:
    """Which column is time_s, pressure_kpa, s1_mv, ...; `warnings` name every guess, `declined` what is not mapped."""

    columns: Mapping[str, Column]
    warnings: tuple[Warning, ...]
    declined: tuple[str, ...] = ()
    channels: Mapping[int, ExtraChannel] = field(default_factory=dict)  # by position: columns of other quantities
    clocks: Mapping[str, Column] = field(default_factory=dict)  # by name: the clock of columns that have another one
    signal_unit: str = "mV"
    interval_s: float = 0.0  # between rows that have no time, as the file says
    time_stated: bool = False  # the time is mapped: the clock of all columns if they cannot be on their own

    def as_profile(self, table: Table) -> dict[str, str]:
        """Return the map as NAME -> COLUMN[*SCALE][+OFFSET][:UNIT], the form that a profile keeps and `--map` takes."""
        profile = dict.fromkeys(self.declined, "")
        for name, column in self.columns.items():
            title = table.names[column.position]
            unique = table.names.count(title) == 1 and ":" not in title and not title.strip().isdigit()
            scale = f"*{column.scale:.17g}" if column.scale != 1.0 else ""
            offset = f"{column.offset:+.17g}" if column.offset else ""
            unit = f":{column.unit}" if column.unit else ""
            profile[name] = f"{title if unique else column.position + 1}{scale}{offset}{unit}"
        return profile

    @property
    def missing(self) -> list[str]:
        """Names without which there is no run."""
        needed = ("pressure_kpa",) if self.interval_s else ("time_s", "pressure_kpa")
        missing = [name for name in needed if name not in self.columns]
        return missing if any(map(is_signal, self.columns)) else [*missing, "s1_mv"]


def map_columns(table: Table, columns: Mapping[str, str] | None = None, *, tolerant: bool = False) -> ColumnMap:
    """Map the columns as `columns` gives them ("" for none), else by title; `tolerant` of unknown units."""
    warnings: list[Warning] = []
    given = {our_name(name): text for name, text in (columns or {}).items()}
    chosen = {name: _mapped(table, name, text, warnings) for name, text in given.items() if text}
    stated = _stated_channels(table)
    taken = {column.position for column in chosen.values()} | set(stated)
    clocks: list[Column] = []
    others: list[tuple[str, Column]] = []
    sought = set(given) - {"time_s"} if given.get("time_s") else set(given)
    taken -= {chosen["time_s"].position} if "time_s" in chosen else set()
    recognised_here = _by_title(table, taken, sought, signals_mapped=any(map(is_signal, chosen)))
    for name, position, unit in [*recognised_here, *_by_unit(table, taken, sought, recognised_here, warnings)]:
        try:
            column = _with_unit(table, name, position, unit, warnings)
        except RequestError as error:
            if not tolerant:
                raise
            warnings.append(Warning(WarningCode.UNIT_UNKNOWN, "", error.cause))
            continue
        if name == "time_s":
            clocks.append(chosen.get(name, column) if chosen.get(name, column).position == position else column)
        if name in chosen and name != "time_s":
            others.append((name, column))
        chosen.setdefault(name, column)
    _refuse_others(table, chosen, others, warnings, tolerant=tolerant)
    found = time_without_header(table) if given and "time_s" not in {*chosen, *given} else None
    if found is not None and found not in {column.position for column in chosen.values()}:
        text = f"no header: column {found + 1} never falls, taken as time"
        warnings.append(Warning(WarningCode.TIME_GUESSED, "", text))
        chosen["time_s"] = _with_unit(table, "time_s", found, table.units[found], warnings)
    stamps = [position for position in table.stamps if position not in {column.position for column in chosen.values()}]
    if "time_s" not in {*chosen, *given} and len(stamps) == 1:
        text = f"column {table.names[stamps[0]]!r} holds stamps: taken as time"
        warnings.append(Warning(WarningCode.TIME_GUESSED, "", text))
        chosen["time_s"] = Column(stamps[0], "s")
    interval_s = 0.0 if given.get("time_s") else _interval_without_times(table, chosen, warnings)
    channels = _channels(table, {column.position for column in (*chosen.values(), *clocks)}, stated)
    own_clocks: dict[str, Column] = {}
    if "time_s" in given and chosen.get("time_s") not in clocks:
        clocks = []  # a column with another title
    if len(clocks) > 1:
        others = [(f"{CHANNEL}{position}", Column(position)) for position in channels]
        main, own_clocks = _assigned(table, {**chosen, **dict(others)}, clocks)
        if "time_s" in given and chosen["time_s"] != main:
            own_clocks = {}  # the one clock of all, as it is mapped
        chosen["time_s"] = chosen["time_s"] if "time_s" in given else main
    chosen = dict(sorted(chosen.items(), key=lambda item: item[1].position))
    unit, chosen = _one_signal_unit(table, chosen)
    declined = tuple(name for name, text in given.items() if not text)
    stated_time = bool(given.get("time_s"))
    return ColumnMap(chosen, tuple(warnings), declined, channels, own_clocks, unit, interval_s, stated_time)


def _interval_without_times(table: Table, chosen: dict[str, Column], warnings: list[Warning]) -> float:
    """Return the interval of the rows that the file states, s, where no column has times; 0 otherwise."""
    column, interval_s = chosen.get("time_s"), table.dialect.interval_s
    if not interval_s or (column is not None and np.isfinite(table.columns[column.position]).any()):
        return 0.0
    chosen.pop("time_s", None)
    text = f"no column of the time: rows {interval_s:g} s apart, as the file says"
    warnings.append(Warning(WarningCode.TIME_GUESSED, "", text))
    return interval_s


def _refuse_others(
    table: Table,
    chosen: Mapping[str, Column],
    others: list[tuple[str, Column]],
    warnings: list[Warning],
    *,
    tolerant: bool,
) -> None:
    """Refuse a second column of the pressure that differs from the first; name one of another quantity."""
    for name, column in others:
        first = chosen[name]
        title, other = table.names[first.position], table.names[column.position]
        one, two = first.values(table), column.values(table)
        if title == name or np.nanmax(np.abs(one - two), initial=0.0) <= _ALIKE * np.nanmax(np.abs(one), initial=0.0):
            continue
        number = column.position + 1
        text = f"columns {first.position + 1} ({title}) and {number} ({other}) may both be {name}"
        if name == "pressure_kpa" and not tolerant:
            raise RequestError(text, f"Choose one: --map {name}={first.position + 1}, or --map {name}={number}.")
        warnings.append(Warning(WarningCode.TABLE_CHOSEN, "", f"{text}: the first is taken"))


def _by_title(table: Table, taken: Set[int], mapped: Set[str], *, signals_mapped: bool) -> list[tuple[str, int, str]]:
    """Return (our name, position, unit) of the columns whose titles are known, beside those that are mapped."""
    found = []
    for position, (title, unit) in enumerate(zip(table.names, table.units, strict=True)):
        by_title = "" if unit else unit_in_title(title)
        name = recognised(title, unit or by_title)
        if name is not None and len(by_title) == 1 and unit_for(name, by_title) is None:
            by_title = ""  # Time A
        unit = unit or by_title
        if name is not None and is_signal(name) and quantity_of(unit) in ("pressure", "temperature"):
            continue  # a channel of a logger, no sensor
        if name is not None and name not in mapped and position not in taken and position not in table.text:
            found.append((name, position, unit))
    computed = "elongation_valid" in table.names  # by a calibration, in an export of ours
    found = [entry for entry in found if entry[0] != "elongation_mm" or not (computed or _is_constant(table, entry[1]))]
    if signals_mapped:  # signals were mapped explicitly: no others are added
        return [entry for entry in found if not is_signal(entry[0])]
    if any(name == "s0_mv" for name, _, _ in found):  # numbered from 0
        found = [(f"s{int(name[1:-3]) + 1}_mv" if name.endswith("_mv") else name, at, unit) for name, at, unit in found]
    if not any(is_signal(name) for name, _, _ in found):
        free = [
            (position, unit)
            for position, unit in enumerate(table.units)
            if position not in taken and position not in table.text
        ]
        others = [(at, unit) for at, unit in free if OTHER_SIGNALS.search(table.names[at].lower())]
        volts = [(at, unit) for at, unit in free if (known := find_unit(unit)) and known.quantity == "voltage"]
        others = others or (volts if len(volts) == 1 else [])
        found += [(f"s{n}_mv", *other) for n, other in enumerate(others[:SENSORS_IN_A_RECORDING], 1)]
    return found


def _by_unit(
    table: Table, taken: Set[int], mapped: Set[str], found: list[tuple[str, int, str]], warnings: list[Warning]
) -> list[tuple[str, int, str]]:
    """Return the one column in a unit of pressure, and of time, where no title is known; each is said."""
    known = {name for name, _, _ in found} | mapped
    free = set(range(len(table.names))) - taken - set(table.text) - set(table.stamps) - {at for _, at, _ in found}
    more = []
    for name, quantity in (("pressure_kpa", "pressure"), ("time_s", "time")):
        units = {at: table.units[at] or unit_in_title(table.names[at]) for at in sorted(free)}
        alone = [at for at, unit in units.items() if quantity_of(unit) == quantity]
        if name in known or len(alone) != 1 or (name == "time_s" and table.stamps):
            continue
        text = f"column {table.names[alone[0]]!r} is the only one in a unit of {quantity}: taken as {name}"
        warnings.append(Warning(WarningCode.UNIT_GUESSED, "", text))
        more.append((name, alone[0], units[alone[0]]))
    return more


def _is_constant(table: Table, position: int) -> bool:
    known = table.columns[position][np.isfinite(table.columns[position])]
    return not known.size or bool(np.ptp(known) == 0)


def too_many_sensors(table: Table, mapping: ColumnMap) -> tuple[ColumnMap, str]:
    """Return the map with as many sensors as a recording has, and which are left out; "" for none."""
    numbers = sorted({int(name[1:].partition("_")[0]) for name in mapping.columns if is_signal(name)})
    if len(numbers) <= SENSORS_IN_A_RECORDING and all(number <= SENSORS_IN_A_RECORDING for number in numbers):
        return mapping, ""
    taken = numbers[:SENSORS_IN_A_RECORDING]
    renamed = {}
    for name, column in mapping.columns.items():
        if not is_signal(name):
            renamed[name] = column
            continue
        number, _, tail = name[1:].partition("_")
        if int(number) in taken:
            renamed[f"s{taken.index(int(number)) + 1}_{tail}"] = column
    left = [
        table.names[column.position]
        for name, column in mapping.columns.items()
        if is_signal(name) and int(name[1:].partition("_")[0]) not in taken
    ]
    text = (
        f"{len(numbers)} sensors, of which a recording holds {SENSORS_IN_A_RECORDING}: {', '.join(left)} left out; "
        f"choose others by --map s1_mv=COLUMN --map s2_mv=COLUMN ..."
    )
    return replace(mapping, columns=renamed), text


def _assigned(table: Table, chosen: Mapping[str, Column], clocks: list[Column]) -> tuple[Column, dict[str, Column]]:
    """Return the clock of the run, that of its signals, and the clocks of columns that have another one.

    A clock is that of the columns on its right, up to the next clock. Of clocks beside one another, the finest counts.
    """
    measured = {name: c for name, c in chosen.items() if name not in (*PLAIN, "time_s")}
    owners: dict[int, list[Column]] = {}
    own: dict[str, int] = {}
    for name, column in measured.items():
        before = [clock for clock in clocks if clock.position < column.position] or clocks[:1]
        group = next(k for k, clock in enumerate(clocks) if clock is before[-1])
        first = group
        positions = {c.position for c in measured.values()}
        while first and not any(clocks[first - 1].position < p < clocks[first].position for p in positions):
            first -= 1
        owners[group] = clocks[first : group + 1]
        own[name] = group
    if not own:
        return clocks[0], {}
    finest = {
        group: max(beside, key=lambda clock: np.unique(table.columns[clock.position]).size)
        for group, beside in owners.items()
    }
    main = next(
        (own[name] for name in (*filter(is_signal, own), "pressure_kpa") if name in own), next(iter(own.values()))
    )
    return finest[main], {name: finest[group] for name, group in own.items() if group != main}


def _one_signal_unit(table: Table, chosen: Mapping[str, Column]) -> tuple[str, dict[str, Column]]:
    """Return the unit of the signals, and the map with their factors to it; voltages are in mV."""
    columns = dict(chosen)
    wanted = ""
    for name, column in chosen.items():
        if not name.endswith("_mv"):
            continue
        found = unit_for(name, column.unit) if column.unit else None
        symbol = "mV" if found is None or found.quantity == "voltage" else found.symbol
        wanted = wanted or symbol
        factor = conversion(found.symbol if found is not None else "mV", wanted)
        if factor is None:
            cause = f"column {table.names[column.position]!r} is in {column.unit}, another signal in {wanted}"
            raise RequestError(cause, "Signals of one recording have one unit: map those of one kind by --map.")
        columns[name] = replace(column, factor=factor[0])
    return wanted or "mV", columns


def _stated_channels(table: Table) -> dict[int, tuple[str, str]]:
    """Return name and unit of the columns that comments of our own export call extra channels."""
    stated = {}
    for comment in table.dialect.comments:
        key, _, text = comment.partition(":")
        column = key.removeprefix("channel ").strip()
        if key.startswith("channel ") and column in table.names:
            name, bracket, unit = text.strip().partition(" [")
            stated[table.names.index(column)] = name, unit.removesuffix("]") if bracket else ""
    return stated


def _channels(table: Table, taken: Set[int], stated: Mapping[int, tuple[str, str]]) -> dict[int, ExtraChannel]:
    """Return the columns that are extra channels: stated as such, or of another quantity with a known unit."""
    found = {}
    for position, (title, unit) in enumerate(zip(table.names, table.units, strict=True)):
        tail = re.split(r"[\s_,;]+", title.strip())[-1]
        name, symbol = (title, unit) if unit or tail == title else (title.strip()[: -len(tail)].strip(" _,;"), tail)
        known = find_unit(symbol)
        if position in taken or position in table.text or not np.isfinite(table.columns[position]).any():
            continue
        if position in stated:
            found[position] = stated[position]
        elif known is not None and table.dialect.header and not RESERVED.fullmatch(ExtraChannel(name, symbol).column):
            found[position] = name, symbol if unit else known.symbol
    return dict(zip(found, channels_of(found.values()), strict=True)) if len(found) <= CHANNELS_MAX else {}


def _mapped(table: Table, name: str, text: str, warnings: list[Warning]) -> Column:
    position, unit, scale, offset = _parsed(table, text)
    if position in table.text and name == "time_s":
        return _ordered_stamps(table, position, unit)
    stated = unit
    unit = unit or table.units[position] or unit_in_title(table.names[position])
    if not unit:
        if stored := _STORED_UNITS.get(name, "mV" if name.endswith("_mv") else ""):
            told = f"column {table.names[position]!r} is mapped without a unit: taken as {stored}"
            warnings.append(Warning(WarningCode.UNIT_GUESSED, "", told))
        return Column(position, "", 1.0, scale, offset)
    known = unit_for(name, unit)
    if known is None:
        if stated:
            raise RequestError(f"unit {unit!r} is not known for {name}", f"Known: {', '.join(units_of(name))}.")
        return Column(position, "", 1.0, scale, offset)  # mapped explicitly without a unit: taken as it is
    return Column(position, unit, known.factor, scale, offset)


def _parsed(table: Table, text: str) -> tuple[int, str, float, float]:
    """Return position, unit, scale and offset of COLUMN[*SCALE][+OFFSET][:UNIT]; the longest name that exists wins."""
    column, colon, unit = text.rpartition(":")
    refused: RequestError | None = None
    for name, symbol in ((column, unit), (text, "")) if colon and column else ((text, ""),):
        try:
            return table.position(name), symbol, 1.0, 0.0
        except RequestError as error:
            refused = refused or error
        scaled = _SCALED.match(name)
        if scaled and (scaled["scale"] or scaled["offset"]):
            try:
                position = table.position(scaled["column"].strip())
            except RequestError:
                continue
            return position, symbol, float(scaled["scale"] or 1.0), float(scaled["offset"] or 0.0)
    assert refused is not None
    raise refused


def has_column(table: Table, text: str) -> bool:
    """Return whether a table has the column of a text COLUMN[*SCALE][+OFFSET][:UNIT]."""
    try:
        _parsed(table, text)
    except RequestError:
        return False
    return True


def _ordered_stamps(table: Table, position: int, order: str) -> Column:
    """Return a column of stamps whose order of day and month is stated, which the table then holds as seconds."""
    stamps = read_stamps(table.text[position], order) if order in _ORDERS else None
    if stamps is None:
        cause = _text_in(table, position)
        raise RequestError(cause, f"Map --map time_s={position + 1}:dmy if the day is first, or :mdy.")
    seconds = since_first(stamps)
    table.columns[position][:] = seconds
    return Column(position, order)


def _with_unit(table: Table, name: str, position: int, unit: str, warnings: list[Warning]) -> Column:
    known = unit_for(name, unit)
    if known is not None:
        return Column(position, unit, known.factor)
    if not (is_signal(name) or name.endswith(("_kpa", "_s", "_mm"))) or name.endswith(("_lit", "_dark")):
        return Column(position)
    if unit and name.endswith("_kpa") and absolute_unit(unit):
        remedy = f"Map it less the ambient pressure: --map {name}={position + 1}-AMBIENT:{absolute_unit(unit)}."
        raise RequestError(f"column {table.names[position]!r} is an absolute pressure ({unit})", remedy)
    if unit:
        cause = f"unit {unit!r} of column {table.names[position]!r} is not known for {name}"
        raise RequestError(cause, f"Map it: --map {name}={position + 1}:UNIT with one of {', '.join(units_of(name))}.")
    guessed = guess_unit(name, table.columns[position], table.names[position])
    text = f"column {table.names[position]!r} has no unit: taken as {guessed}"
    warnings.append(Warning(WarningCode.UNIT_GUESSED, "", text))
    found = unit_for(name, guessed)
    return Column(position, guessed, found.factor if found else 1.0)


def time_without_header(table: Table) -> int | None:
    """Return the first column of a file without header that never falls and is no mere count of the rows."""
    if table.dialect.header:
        return None
    for position, values in enumerate(table.columns):
        if position in table.text or values.size < 3 or not np.isfinite(values).all():
            continue
        steps = np.diff(values)
        if (steps >= 0).all() and steps.any() and not (steps == 1).all():
            return position
    return None


def unmapped(name: str, missing: list[str], mapping: ColumnMap, table: Table, *, alone: bool) -> RequestError:
    """Return the refusal of a table in which no column was mapped to the names `missing`; `alone` of one file."""
    options = f"Map it by the numbers of the columns: {_map_options(missing, mapping, table)}"
    remedy = (
        f"Add --map time_s=COLUMN:ms{', or import it with --rate HZ' * alone}" if missing == ["time_s"] else options
    )
    stamps = [i for i in table.text if recognised(table.names[i]) in missing]
    found = [_text_in(table, i) for i in stamps]
    found += [warning.text for warning in table.warnings if warning.code is WarningCode.TABLE_CHOSEN]
    if "time_s" in missing and any("/" in text or "-" in text for text in found):
        remedy += f"; of dates, --map time_s={stamps[0] + 1}:dmy (day first) or :mdy"
    cause = "; ".join([f"{name}: no column was recognised as {', '.join(missing)}", *found])
    return RequestError(cause, f"{remedy}. Columns: {_listed(table)}.")


def _listed(table: Table) -> str:
    """Return the columns as a message names them: by their titles, or by their content."""
    if table.dialect.header:
        return ", ".join(f"{i + 1} {name}" for i, name in enumerate(table.names[:MOST_LISTED]))
    shown = []
    for i, column in enumerate(table.columns[:MOST_LISTED]):
        known = column[np.isfinite(column)]
        shown.append(f"{i + 1} ({known.min():g} to {known.max():g})" if known.size else f"{i + 1} (text)")
    return ", ".join(shown)


def _map_options(missing: list[str], mapping: ColumnMap, table: Table) -> str:
    """Return the options that map what is missing, beside those that were recognised."""
    known = [
        f"--map {name}={column.position + 1}:{column.unit}" for name, column in mapping.columns.items() if column.unit
    ]
    wanted = {name: f"COLUMN:{_USUAL_UNITS[name]}" for name in missing}
    time = time_without_header(table)
    if time is not None and "time_s" in wanted:
        wanted["time_s"] = f"{time + 1}:{guess_unit('time_s', table.columns[time])}"
    return " ".join([*known, *(f"--map {name}={column}" for name, column in wanted.items())])


def _text_in(table: Table, position: int) -> str:
    """Return that a column holds text, with the first of it."""
    first = next((cell for cell in table.text[position] if cell), "")
    return f"column {table.names[position]!r} holds text like {first[:30]!r}, not numbers"
