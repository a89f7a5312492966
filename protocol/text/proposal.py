"""Propose a text profile from what a device prints: separator, fields, checksum, rate, and meanings.

What names or units in the text give is *stated*; what only the numbers suggest (a column that grows by a constant step
is a time) is *guessed*, to be confirmed by the operator. A proposal is tried by the decoder itself, through
`load_profile`. Reference voltage and bits of an ADC are proposed from the largest count.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from statistics import median
from typing import Any

import numpy as np

from protocol.base.clock_wraps import usual_wraps, wrap_between
from protocol.base.errors import ProfileError
from protocol.base.units import find_unit
from protocol.text.readers import CHECKSUMS, LINE_MAX, checked, hexadecimal, json_values

_LINES_MAX = 2000  # of the text, the first ones
PACKET_LENGTHS = range(4, 41)  # bytes
PACKETS_FEWEST = 8
PACKET_BYTES_MAX = 20_000
CONSTANT = 0.98  # of the packets have the same byte there
ENOUGH = 0.8  # of the lines, that a syntax must fit
LEAST_WRAP = 256  # that a profile may state
LONG_STEP = 5  # medians: a longer step of time is a gap
NEARLY_ALL = 0.95  # of the texts of a column
_FEWEST = 3  # lines from which a syntax can be told
DELIMITERS = (",", ";", "\t", "|", " ")
_SENSORS_MAX = 4
_ADC_BITS = (10, 12, 14, 16)
_VREF_MV = {10: 5000}  # of an Arduino; others have 3.3 V
VREF_USUAL_MV = 3300
SIGNAL_UNITS = ("mV", "V", "uV", "counts")
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_HEX = re.compile(r"(?:0x)?[0-9a-fA-F]+")
_NAMES: tuple[tuple[str, re.Pattern[str]], ...] = (
    ("time", re.compile(r"t|time|timestamp|millis|micros|ticks?|clock|elapsed|zeit", re.I)),
    ("index", re.compile(r"i|n|no|nr|idx|index|count(?:er)?|seq(?:uence)?|sample|frame|packet", re.I)),
    ("pressure", re.compile(r"p\d?|press(?:ure)?|druck|kpa|p_?act(?:ual)?|p_?meas(?:ured)?", re.I)),
)
_SIGNAL = re.compile(
    r"(?:s|sens(?:or)?|sig(?:nal)?|ch(?:an(?:nel)?)?|a|adc|pd|photo(?:diode)?|light|opt(?:ical)?|v|u)"
    r"[ _.\[-]*(\d)\]?(?:[ _.-]*(lit|on|bright|dark|off|signal|raw|counts?))?",
    re.I,
)
_SET = re.compile("set|targ|soll|ref|amb", re.I)  # a pressure that is not that of the actuator
_PARTS = {"lit": "lit", "on": "lit", "bright": "lit", "dark": "dark", "off": "dark"}
_WITH_UNIT = re.compile(r"(.+?)(?:\s*[(\[](?P<inside>[^)\]]+)[)\]]|[ _](?P<behind>[A-Za-z%]+(?:/[a-z]+)?))")
_UNIT_BY_NAME = {"millis": "ms", "micros": "us", "kpa": "kPa"}


@dataclass(frozen=True, slots=True)
class ProposedField:
    """A field of a line, or a variable of a packet.

    `name`: meaning as in a profile; `_` if left out, another text for an extra channel. `base`, `suffix`, `signed`:
    printed form of its number. `scale`: factor from the number to `unit`. `guessed`: whether the meaning is suggested
    by its numbers alone.
    """

    label: str
    name: str
    unit: str = ""
    base: int = 10
    suffix: str = ""
    signed: bool = False
    scale: float = 1.0
    wraps_at: int | None = None
    guessed: bool = False
    examples: tuple[str, ...] = ()

    def table(self, *, labelled: bool) -> dict[str, Any]:
        """Return the field as a table of a profile, without what is usual."""
        usual = ProposedField("", "")
        keys = ("unit", "base", "suffix", "signed", "scale", "wraps_at")
        stated = {key: getattr(self, key) for key in keys if getattr(self, key) != getattr(usual, key)}
        return {"name": self.name, **({"label": self.label} if labelled else {}), **stated}


@dataclass(frozen=True, slots=True)
class Proposal:
    """A profile to be confirmed; `content` is its TOML.

    `lines`: keys of the profile's table `lines` beside the fields; empty for packets. `rx8`: the format string of
    packets; empty for lines. `vref_mv`, `adc_bits`: reference and bits of counts; 0 if no signal is in counts.
    `fitting`, `seen`: number of lines with this syntax, and of all but comments; packets and bytes for packets.
    """

    fields: tuple[ProposedField, ...]
    lines: dict[str, Any]
    rx8: str = ""
    rate_hz: float = 100.0
    vref_mv: int = 0
    adc_bits: int = 0
    fitting: int = 0
    seen: int = 0

    @property
    def missing(self) -> str:
        """What keeps it from being a profile; empty where nothing does."""
        names = [field.name for field in self.fields]
        sensors = {name for name in names if name.startswith("s") and name.endswith(("_signal", "_lit", "_dark"))}
        if "pressure" not in names:
            return "no field is the pressure"
        return "" if sensors else "no field is the signal of a sensor"

    @property
    def summary(self) -> str:
        if self.rx8:
            return f"{self.fitting} packets in {self.seen} bytes"
        style = self.lines.get("style", "columns")
        names = {",": "comma", ";": "semicolon", "\t": "tab", "|": "bar", " ": "space"}
        between = f", separated by {names[self.lines['delimiter']]}" if "delimiter" in self.lines else ""
        words = {"columns": "columns", "labels": "fields with labels", "json": "JSON", "width": "fields of one width"}
        checksum = f", checksum {self.lines['checksum']}" if "checksum" in self.lines else ""
        decimal = ", decimal comma" if self.lines.get("decimal") else ""
        return f"{len(self.fields)} {words[style]}{between}{decimal}{checksum}: {self.fitting} of {self.seen} lines"

    def content(self, name: str) -> dict[str, Any]:
        """Return the profile as it is written in TOML."""
        sensors = {field.name.partition("_")[0] for field in self.fields if re.match(r"s\d_", field.name)}
        device: dict[str, Any] = {"n_sensors": len(sensors), "rate_hz": self.rate_hz, "polarity": 1}
        if self.adc_bits:
            device |= {"vref_mv": self.vref_mv, "adc_bits": self.adc_bits}
        top = {"name": name, "kind": "rx8" if self.rx8 else "lines", "device": device}
        if self.rx8:
            variables = {field.label: field.table(labelled=False) for field in self.fields}
            return {**top, "rx8": {"format": self.rx8, "variables": variables}}
        labelled = self.lines.get("style") in ("labels", "json")
        fields = [field.table(labelled=labelled) for field in self.fields]
        return {**top, "lines": {**self.lines, "fields": fields}}


@dataclass(frozen=True, slots=True)
class _Syntax:
    """A reading of the lines: rows of (label, text), and the keys of the profile that make it."""

    keys: dict[str, Any]
    rows: list[list[tuple[str, str]]]
    decimal: str = "."

    @property
    def numbers(self) -> int:
        return sum(_is_number(text, self.decimal) for row in self.rows for _, text in row)


def propose(data: bytes, seconds: float = 0.0) -> Proposal:
    """Return the profile that lines sent in `seconds` (0: unknown) suggest. ProfileError: no syntax fits most."""
    line_end = "\n" if 2 * data.count(b"\n") >= data.count(b"\r") else "\r"
    pieces = data.decode("latin-1").split(line_end)
    raw = [line.strip() for line in pieces[1:-1] if line.strip() and len(line) <= LINE_MAX][:_LINES_MAX]
    comments = _comment_prefixes(raw)
    lines = [line for line in raw if not line.startswith(tuple(comments))] if comments else raw
    if len(lines) < _FEWEST:
        cause = f"there are only {len(lines)} whole lines of text"
        raise ProfileError(cause, "wait for more, or check the baud rate; packets of bytes are an RX8 format")
    seen, (checksum, lines) = len(lines), _checksum(lines)
    syntax = _syntax(lines)
    keys = {**syntax.keys, **({"line_end": "\r"} if line_end == "\r" else {})}
    keys |= ({"comments": comments} if comments else {}) | ({"checksum": checksum} if checksum else {})
    count = Counter(len(row) for row in syntax.rows).most_common(1)[0][0]
    rows = _without_damage([row for row in syntax.rows if len(row) == count], syntax.decimal)
    headings = _headings([pieces[0].strip(), *raw], syntax, count, comments)
    columns = [[row[at] for row in rows] for at in range(count)]
    fields = [_described(column, headings[at], syntax.decimal) for at, column in enumerate(columns)]
    values = [_values(field, column, syntax.decimal) for field, column in zip(fields, columns, strict=True)]
    rate_by_host = len(raw) / seconds if seconds > 0 else 0.0
    fields = _named(fields, values, rate_by_host)
    result = Proposal(tuple(fields), keys, fitting=len(rows), seen=seen)
    return _with_device(result, values, rate_by_host)


def propose_any(data: bytes, seconds: float = 0.0) -> Proposal:
    """Return the profile that lines or else packets suggest; `seconds` as in `propose`. ProfileError: neither fits."""
    printable = sum(byte in b"\t\r\n" or 32 <= byte < 127 for byte in data[:PACKET_BYTES_MAX])
    is_text = printable >= ENOUGH * min(len(data), PACKET_BYTES_MAX)
    return propose(data, seconds) if is_text else propose_packets(data, seconds)


def _checksum(lines: list[str]) -> tuple[str, list[str]]:
    """Return the checksum that most lines have, and the good lines without it; empty, and all lines, for none."""
    for kind in CHECKSUMS:
        for delimiter in DELIMITERS if kind != "nmea" else DELIMITERS[:1]:
            checks = [checked(line.encode("latin-1"), kind, delimiter.encode()) for line in lines]
            if sum(good for _, good in checks) >= ENOUGH * len(lines):
                return kind, [text.decode("latin-1") for text, good in checks if good]
    return "", lines


def _comment_prefixes(lines: Sequence[str]) -> list[str]:
    """Return the characters with which lines begin that are no data."""
    found = Counter(line[0] for line in lines if line[0] in "#%;/!>'")
    return sorted({"/": "//"}.get(first, first) for first, n in found.items() if n < (1 - ENOUGH) * len(lines))


def _syntax(lines: Sequence[str]) -> _Syntax:
    """Return the first syntax that fits most of the lines, the stricter ones first. ProfileError: none does."""
    found = [_Syntax({"style": "json"}, list(_json_rows(lines))), _equally_wide(lines)]
    for delimiter, decimal in ((a, b) for a in DELIMITERS for b in ".," if a != b):
        found += [_labelled(lines, assign, delimiter, decimal) for assign in "=:"]
        found.append(_in_columns(lines, delimiter, decimal))
    best = max(found, key=lambda syntax: _fit(syntax, len(lines)))
    if _fit(best, len(lines))[0] < ENOUGH:
        cause = "neither a separator nor labels, JSON or a fixed width fit most of the lines"
        raise ProfileError(cause, "check the baud rate, or write the profile by hand")
    return best


def _fit(syntax: _Syntax, n: int) -> tuple[float, bool, int, int]:
    """Return the share of the lines with the commonest number of fields, labels before columns, numbers, fields."""
    counts = Counter(len(row) for row in syntax.rows)
    fields, most = counts.most_common(1)[0] if counts else (0, 0)
    labelled = syntax.keys.get("style") in ("json", "labels")
    return round(most / n, 1) if fields > 1 or labelled else 0.0, labelled, syntax.numbers, fields


def _json_rows(lines: Iterable[str]) -> Iterable[list[tuple[str, str]]]:
    for line in lines:
        try:
            yield list(json_values(line))
        except (ValueError, RecursionError):
            continue


def _labelled(lines: Sequence[str], assign: str, delimiter: str, decimal: str) -> _Syntax:
    """Return the lines as labels with numbers; those that are not so are left out."""
    rows = []
    for line in lines:
        parts = assign.join(part.strip() for part in line.split(assign)).split(None if delimiter == " " else delimiter)
        found = [part.strip().partition(assign) for part in parts]
        pairs = [(label.strip(), text.strip()) if sign else ("", label.strip()) for label, sign, text in found]
        alone = sum(not label for label, _ in pairs)  # a time before the labels
        if alone <= min(1, len(pairs) - 1) and all(_is_number(text, decimal) for _, text in pairs):
            rows.append(pairs)
    order = {label: None for row in rows[:1] for label, _ in row}
    rows = [sorted(row, key=lambda pair: list(order).index(pair[0])) for row in rows if {p[0] for p in row} == {*order}]
    keys = {"style": "labels", "assign": assign, "delimiter": delimiter}
    return _with_decimal(keys, rows, decimal)


def _with_decimal(keys: dict[str, Any], rows: list[list[tuple[str, str]]], decimal: str) -> _Syntax:
    """Return the syntax; one with a decimal comma that no line has is none: the point fits as well."""
    if decimal == ".":
        return _Syntax(keys, rows)
    used = any("," in text for row in rows for _, text in row)
    return _Syntax({**keys, "decimal": ","}, rows if used else [], decimal)


def _in_columns(lines: Sequence[str], delimiter: str, decimal: str) -> _Syntax:
    """Return the lines as columns; those where no field is a number are left out."""
    rows = []
    for line in lines:
        parts = [part.strip() for part in line.split(None if delimiter == " " else delimiter)]
        numbers = [_is_number(part, decimal) or (_HEX.fullmatch(part) is not None and len(part) > 1) for part in parts]
        text_allowed = sum(numbers) >= max(1, len(parts) - 1)  # an identity or a state may be among them
        if text_allowed and not any(decimal == "," and "." in part for part in parts):
            rows.append([("", part) for part in parts])
    return _with_decimal({"delimiter": delimiter}, rows, decimal)


def _equally_wide(lines: Sequence[str]) -> _Syntax:
    """Return the lines as groups of four hexadecimal digits."""
    rows = [line for line in lines if len(line) % 4 == 0 and len(line) >= 8 and _HEX.fullmatch(line)]
    return _Syntax({"style": "width"}, [[("", line[at : at + 4]) for at in range(0, len(line), 4)] for line in rows])


def _is_number(text: str, decimal: str) -> bool:
    """Return whether a text is a decimal number, with letters behind it or without."""
    found = _NUMBER.match(text.replace(decimal, "."))
    return found is not None and not any(letter.isdigit() for letter in text[found.end() :])


def _without_damage(rows: list[list[tuple[str, str]]], decimal: str) -> list[list[tuple[str, str]]]:
    """Return the rows without damaged ones: text in a column of numbers, or a hexadecimal among decimals."""

    kept = list(range(len(rows)))
    for column in zip(*([text for _, text in row] for row in rows), strict=True):
        decimals = [_is_number(text, decimal) for text in column]
        numbers = [(_is_number(text, decimal) or _HEX.fullmatch(text) is not None) for text in column]
        if sum(decimals) >= NEARLY_ALL * len(rows) and not _padded(column):
            kept = [at for at in kept if decimals[at]]
        elif sum(numbers) >= ENOUGH * len(rows):
            kept = [at for at in kept if numbers[at]]
    return [rows[at] for at in kept]


def _headings(raw: Sequence[str], syntax: _Syntax, count: int, comments: Sequence[str]) -> list[str]:
    """Return the heading of each column, from a line of words; empty without one."""
    if syntax.keys.get("style") in ("json", "labels", "width"):
        return [""] * count
    delimiter = syntax.keys["delimiter"]
    for line in raw:
        for prefix in comments:
            line = line.removeprefix(prefix)
        words = [word.strip() for word in line.split(None if delimiter == " " else delimiter)]
        if len(words) == count and not any(_NUMBER.match(word) for word in words) and all(words):
            return words
    return [""] * count


def _described(column: Sequence[tuple[str, str]], heading: str, decimal: str) -> ProposedField:
    """Return how the texts of a column are printed: base, suffix, examples."""
    texts = [text for _, text in column]
    label = column[0][0] or heading
    examples = tuple(dict.fromkeys(texts))[:3]
    letters = any(re.search("[a-fA-F]", text) for text in texts)
    if all(_HEX.fullmatch(text) for text in texts) and (letters or _padded(texts)):
        return ProposedField(label, "_", base=16, examples=examples)
    behind = {text[found.end() :] for text in texts if (found := _NUMBER.match(text.replace(decimal, ".")))}
    suffix = behind.pop() if len(behind) == 1 else ""
    return ProposedField(label, "_", suffix=suffix.strip(), examples=examples)


def _padded(texts: Sequence[str]) -> bool:
    """Return whether all texts have one length, and zeros in front where their number is small: `03E8`."""
    return len({len(text) for text in texts}) == 1 and any(len(text) > 1 and text.startswith("0") for text in texts)


def _values(field: ProposedField, column: Sequence[tuple[str, str]], decimal: str) -> np.ndarray[Any, Any] | None:
    """Return the numbers of a column; None where it holds text."""
    try:
        if field.base == 16:
            return np.array([hexadecimal(text.encode(), signed=False) for _, text in column])
        return np.array([float(text.removesuffix(field.suffix).replace(decimal, ".")) for _, text in column])
    except ValueError:
        return None


def split_unit(label: str) -> tuple[str, str]:
    """Return name and unit of a label such as `p_kPa`, `Pressure (kPa)` or `temp[C]`; the unit may be empty."""
    found = _WITH_UNIT.fullmatch(label.strip())
    unit = (found["inside"] or found["behind"]) if found else ""
    if found and (found["inside"] or (find_unit(unit) and len(unit) > 1)):
        known = find_unit(unit)
        return found[1].strip(), known.symbol if known else unit
    return label.strip(), _UNIT_BY_NAME.get(label.strip().lower(), "")


def _named(
    fields: Sequence[ProposedField], values: Sequence[np.ndarray[Any, Any] | None], rate_hz: float
) -> list[ProposedField]:
    """Return the fields with their meanings: those that labels state first, then those that the numbers suggest."""
    result = [_by_label(field) for field in fields]
    numbers = [int(match[1]) for field in fields if (match := _SIGNAL.fullmatch(split_unit(field.label)[0]))]
    order = {number: at for at, number in enumerate(sorted(set(numbers)), 1)}  # ch0 and ch1 are 1 and 2, S2 alone is 1
    for at, field in enumerate(result):
        if re.match(r"s\d_", field.name):
            number = order.get(int(field.name[1]), int(field.name[1]))
            result[at] = replace(field, name=f"s{number}{field.name[2:]}")
    taken: set[str] = set()
    for at, field in enumerate(result):
        if values[at] is None or field.name in taken or re.match(r"s[5-90]_", field.name):
            text = "_" if values[at] is None else field.label or "_"
            result[at] = replace(field, name=text, guessed=False)
        taken.add(result[at].name)
    no_label = [not field.label or field.label.isdigit() for field in result]  # a list in JSON has places alone
    open_ = [at for at, value in enumerate(values) if no_label[at] and value is not None]
    for at, name, unit in _guesses({at: v for at in open_ if (v := values[at]) is not None}, taken, rate_hz):
        result[at] = replace(result[at], name=name, unit=unit or result[at].unit, guessed=True)
    return [_with_units(field, value, rate_hz) for field, value in zip(result, values, strict=True)]


def _by_label(field: ProposedField) -> ProposedField:
    """Return a field with the meaning that its label states, else as an extra channel."""
    name, unit = split_unit(field.label.lstrip(">$# "))
    inner = name.rpartition(".")[2]
    if "." in name and not inner.isdigit() and not _SET.search(name):  # of JSON: the name inside tells it
        unit = unit or _UNIT_BY_NAME.get(inner.lower(), "")
        name = inner
    known = find_unit(field.suffix)
    unit = unit or (known.symbol if known else field.suffix)
    if match := _SIGNAL.fullmatch(name):
        part = _PARTS.get((match[2] or "").lower(), "signal")
        return replace(field, name=f"s{match[1]}_{part}", unit=unit if part == "signal" else "")
    meaning = next((known_name for known_name, pattern in _NAMES if pattern.fullmatch(name)), "")
    found = find_unit(unit)
    if not meaning and found is not None and found.quantity == "pressure" and not _SET.search(name):
        meaning = "pressure"
    return replace(field, name=meaning or name or "_", unit="" if meaning == "index" else unit)


def _guesses(
    values: dict[int, np.ndarray[Any, Any]], taken: set[str], rate_hz: float
) -> Iterable[tuple[int, str, str]]:
    """Yield (column, name, unit) of the columns without a label, by their numbers."""
    left = dict(values)
    for at, column in values.items():
        steps = np.diff(column)
        if len(steps) < 2 or not (steps > 0).all():
            continue
        if "index" not in taken and (steps == 1).all() and not _is_time(steps, rate_hz):
            yield at, "index", ""
            taken.add("index")
            left.pop(at)
        elif "time" not in taken and np.ptp(steps) <= max(2.0, 0.5 * float(np.median(steps))):
            yield at, "time", _time_unit(float(np.median(steps)), rate_hz)
            taken.add("time")
            left.pop(at)
    if "pressure" not in taken and left:
        negative = [at for at, column in left.items() if (column < 0).any()]
        at = negative[0] if negative else next(iter(left))
        yield at, "pressure", ""
        left.pop(at)
    free = [n for n in range(1, _SENSORS_MAX + 1) if not any(name.startswith(f"s{n}_") for name in taken)]
    for at, n in zip(left, free, strict=False):
        yield at, f"s{n}_signal", ""


def _is_time(steps: np.ndarray[Any, Any], rate_hz: float) -> bool:
    """Return whether a step of 1 is one of time: where a thousand lines come in a second."""
    return rate_hz > 500


def _time_unit(step: float, rate_hz: float) -> str:
    """Return the unit in which a step is the time between two lines; without a known rate the usual one."""
    if rate_hz > 0:
        return min(TIME_UNITS, key=lambda unit: abs(np.log(step * TIME_UNITS[unit] * rate_hz)))
    return "s" if step < 1 else "ms" if step < 500 else "us"


def _with_units(field: ProposedField, values: np.ndarray[Any, Any] | None, rate_hz: float) -> ProposedField:
    """Return a field with the unit that its number needs, and its sign."""
    if values is None or not len(values):
        return field
    unit, guessed = field.unit, field.guessed
    if field.name == "time" and unit not in TIME_UNITS:
        unit, guessed = _time_unit(abs(median(np.diff(values).tolist())) or 1.0, rate_hz), True
    elif field.name == "pressure" and not unit:
        unit, guessed = "kPa", True
    elif field.name.endswith("_signal") and unit not in SIGNAL_UNITS:
        whole = bool((values == np.rint(values)).all())
        unit = "counts" if whole else "V" if np.abs(values).max() < 20 else "mV"
        guessed = True
    digits = max((len(text.lower().removeprefix("0x")) for text in field.examples), default=0)
    signed = field.base == 16 and field.name == "pressure" and bool((values >= 1 << 4 * digits - 1).any())
    wraps_at = _wraps_at(unit, values) if field.name == "time" else None
    return replace(field, unit=unit, guessed=guessed, signed=signed, wraps_at=wraps_at)


def _wraps_at(unit: str, values: np.ndarray[Any, Any]) -> int | None:
    """Return the number at which a time began again, or a counter of 32 bits will; None where it has no such."""
    steps = np.diff(values)
    interval = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    for at in np.flatnonzero(steps < 0):
        wraps = [wrap / TIME_UNITS[unit] for wrap in usual_wraps(TIME_UNITS[unit], decimals=True)]
        wrap = wrap_between(float(values[at]), float(values[at + 1]), interval, wraps)
        if wrap is not None and wrap >= LEAST_WRAP:
            return round(wrap)
    counter = unit in ("ms", "us") and bool((values == np.rint(values)).all()) and values.max() < 1 << 32
    return 1 << 32 if counter else None


def _with_device(proposal: Proposal, values: Sequence[np.ndarray[Any, Any] | None], rate_by_host: float) -> Proposal:
    """Return the proposal with its rate, and with reference and bits where signals are in counts."""
    rate_hz = rate_by_host or proposal.rate_hz
    counts = 0.0
    for field, column in zip(proposal.fields, values, strict=True):
        if column is None:
            continue
        if field.name == "time" and len(column) > 2:
            steps = np.diff(column)
            steps = steps[(steps > 0) & (steps <= LONG_STEP * np.median(steps))]  # neither a restart nor a gap
            rate_hz = 1 / (float(steps.mean()) * TIME_UNITS[field.unit]) if steps.size else rate_hz
        if field.unit == "counts" or field.name.endswith(("_lit", "_dark")):
            counts = max(counts, float(column.max()))
    bits = next((n for n in _ADC_BITS if counts < 1 << n), _ADC_BITS[-1]) if counts else 0
    rate_hz = min(max(float(f"{rate_hz:.3g}"), 0.01), 65_535.0)
    return replace(proposal, rate_hz=rate_hz, adc_bits=bits, vref_mv=_VREF_MV.get(bits, VREF_USUAL_MV) if bits else 0)


def propose_packets(data: bytes, seconds: float = 0.0) -> Proposal:
    """Return the profile that packets sent in `seconds` (0: unknown) suggest. ProfileError: no byte repeats."""
    content = np.frombuffer(data[:PACKET_BYTES_MAX], np.uint8)
    length, start = _packet(content)
    packets = content[start : start + (len(content) - start) // length * length].reshape(-1, length)
    fixed = _constant(packets)
    head = next((at for at, same in enumerate(fixed) if not same), length)
    tail = length - next((at for at, same in enumerate(fixed[::-1]) if not same), 0)
    first = [int(np.bincount(column).argmax()) for column in packets.T]  # of each place
    marks, fields = _variables(packets[:, head:tail])
    ends = [f"[{key}={' '.join(f'{byte:02X}' for byte in part)}]" if part else "" for key, part in
            (("h", first[:head]), ("t", first[tail:]))]  # fmt: skip
    rate_hz = len(content) / length / seconds if seconds > 0 else 100.0
    bits = 12 if any(field.unit == "counts" for field in fields) else 0
    return Proposal(
        tuple(fields),
        {},
        rx8=" ".join(filter(None, ("RX8", ends[0], *marks, ends[1]))),
        rate_hz=float(f"{rate_hz:.3g}"),
        vref_mv=VREF_USUAL_MV if bits else 0,
        adc_bits=bits,
        fitting=len(packets),
        seen=len(content),
    )


def _constant(packets: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Return which places of the packets have the same byte in nearly all of them."""
    return np.array([np.bincount(column).max() >= CONSTANT * len(packets) for column in packets.T])


def _packet(content: np.ndarray[Any, Any]) -> tuple[int, int]:
    """Return the length of the packets and where the first whole one begins.

    It is the shortest length at which a byte stays the same. A packet begins with its longest run of such bytes other
    than 0, the first of which is the header; those at its end are the tail.
    """
    for length in PACKET_LENGTHS:
        n = len(content) // length
        if n < PACKETS_FEWEST:
            break
        packets = content[: n * length].reshape(-1, length)
        fixed = _constant(packets) & (packets[n // 2] != 0)
        if not fixed.any() or fixed.all():
            continue
        return length, _begin(fixed, packets)
    cause = f"no byte comes back at a constant distance of {PACKET_LENGTHS[0]} to {PACKET_LENGTHS[-1]} bytes"
    raise ProfileError(cause, "wait for more data, check the baud rate, or write the RX8 format by hand")


def _begin(fixed: np.ndarray[Any, Any], packets: np.ndarray[Any, Any]) -> int:
    """Return where a packet begins: after a line end among its constant bytes, else at the first of a run of them.

    A high byte that never changes looks like a header: preferred is the place from which the bytes make variables of
    one byte order, then the one with the longest run.
    """
    length, packet = len(fixed), packets[len(packets) // 2]

    def run(start: int) -> int:
        return next(n for n in range(length) if not fixed[(start + n) % length])

    def score(start: int) -> tuple[float, int]:
        inside = np.roll(packets, -start, axis=1)[:-1, run(start) :]
        moves = np.abs(np.diff(inside.astype(float), axis=0)).mean(axis=0)
        pairs = moves[: len(moves) // 2 * 2].reshape(-1, 2)
        high_first = float((pairs[:, 0] <= pairs[:, 1]).mean()) if len(pairs) else 0.0
        return max(high_first, 1 - high_first), run(start)

    start = max((at for at in range(length) if fixed[at] and not fixed[at - 1]), key=score)
    for n in range(run(start) - 1):
        if packet[(start + n) % length] in (0x0A, 0x0D) and packet[(start + n + 1) % length] not in (0x0A, 0x0D):
            return (start + n + 1) % length
    return start


def _variables(packets: np.ndarray[Any, Any]) -> tuple[list[str], list[ProposedField]]:
    """Return the marks of the bytes and the variables; the slower byte of a pair is the high one.

    A packet with an odd number of bytes has a counter or a state at its end or its beginning.
    """
    n = packets.shape[1]
    moves = [float(np.abs(np.diff(column.astype(float))).mean()) for column in packets.T]
    steps = [np.bincount(np.diff(column.astype(np.int64)) % 256).argmax() for column in packets.T]
    marks: list[str] = []
    at, fields, numbers = 0, [], 0
    names = iter(["P", *(f"S{k}" for k in range(1, _SENSORS_MAX + 1))])
    if n % 2 and steps[0] == 1:
        marks, at = ["@0I"], 1
        fields.append(ProposedField("I", "index", guessed=True))
    while at + 1 < n:
        numbers += 1
        name = next(names, f"X{numbers}")
        high_first = moves[at] <= moves[at + 1]
        marks += [f"@1{name}", f"@0{name}"] if high_first else [f"@0{name}", f"@1{name}"]
        if name == "P":
            fields.append(ProposedField(name, "pressure", "kPa", signed=True, scale=0.01, guessed=True))
        elif name.startswith("S"):
            fields.append(ProposedField(name, f"s{name[1:]}_signal", "counts", guessed=True))
        else:
            fields.append(ProposedField(name, name, guessed=True))
        at += 2
    if at < n:
        marks.append("@0I" if steps[at] == 1 else "x")
        if steps[at] == 1:
            fields.append(ProposedField("I", "index", guessed=True))
    return marks, fields
