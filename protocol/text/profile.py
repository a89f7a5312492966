"""Text profiles: a TOML description of firmware that does not implement the BOAT protocol.

    name = "Two sensors over Serial.println"
    kind = "lines"                           # or "rx8"

    [device]
    n_sensors = 2
    rate_hz = 100
    vref_mv = 5000                           # with adc_bits: for readings in counts
    adc_bits = 10
    polarity = 1                             # -1 where the voltage falls with light
    simulated = false                        # true for a simulator of such a device: its runs are marked
    pressure_min_kpa = -60                   # limits: without them no pressure is commanded
    pressure_max_kpa = 80

    [lines]
    delimiter = ","
    comments = ["#"]
    checksum = "none"                        # or "nmea" ($...*hh), or of a last field in hexadecimal digits: "xor",
                                             # "sum" (modulo 256), "crc16" (CCITT, from FFFF), "crc16_modbus"
    fields = [{ name = "time", unit = "ms" }, "index", { name = "pressure", unit = "kPa" },
              "s1_lit", "s1_dark", "s2_lit", "s2_dark", { name = "temperature", unit = "degC" }, "_"]
    style = "columns"                        # or "labels" (p=12.5 s1=420), "json", "width" (nothing between the fields)
    assign = "="                             # between label and number; "labels" only

    [commands]
    set_pressure = "P{kpa:.1f}\\n"
    vent = "V\\n"

Names of fields are time, index, pressure, and for each sensor sN_lit and sN_dark (counts) or sN_signal. Any other name
is an extra channel, recorded in its unit, which may be any text; a field without a name or with one that begins with
`_` is left out. A field may have a `label` if it is printed with another name, a `suffix` behind its number, such as a
unit, and `base = 16` for hexadecimal digits (`signed = true` for two's complement). A value is `field * scale + offset`
in `unit`; that of a channel is NaN where the field is no number.

A profile is untrusted: an unknown key, a wrong type or a missing part is refused by name, and a limit has no default. A
field of a command template, such as `{kpa:.1f}`, is a name listed for its command and an optional number format.
Templates are rendered once on loading, so that a faulty one is found before a session.
"""

from __future__ import annotations

import re
import string
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, get_args

from protocol.base.errors import ProfileError
from protocol.base.regular_file import read_regular
from protocol.base.toml_file import read_toml
from protocol.base.units import KPA_PER_UNIT, find_unit
from protocol.link import messages
from protocol.link.messages import Command
from protocol.recording import CHANNELS_MAX, ExtraChannel, SampleKind, channels_of
from protocol.text.packets import PacketFormat, parse_format
from protocol.text.readers import CHECKSUMS, LINE_MAX, FieldText, LineFormat, LineStyle

PA_PER_UNIT = {unit: 1000 * KPA_PER_UNIT[unit.lower()] for unit in ("Pa", "hPa", "mbar", "kPa", "bar", "psi")}

Values = dict[str, float | int]
Template = Callable[[Command], bytes]

_FORMAT = re.compile(r"0?\d{0,2}(\.\d{1,2})?[dfgeXx]?")
_TEMPLATE_MAX = 200  # characters


def _pressures(prefix: str, pascal: int) -> Values:
    return {prefix + unit.lower(): pascal / pa if pa != 1 else pascal for unit, pa in PA_PER_UNIT.items()}


def _ramps(pascal_per_s: int) -> Values:
    return {f"ramp_{name}_per_s": value for name, value in _pressures("", pascal_per_s).items()}


def _values(command: Command) -> Values:
    """Return the values of the fields of a command's template."""
    match command:
        case messages.SetPressure():
            return {**_pressures("", command.target_pa), **_ramps(command.ramp_pa_per_s)}
        case messages.SetLimits():
            return {**_pressures("min_", command.min_pa), **_pressures("max_", command.max_pa)}
        case messages.Start():
            return {"rate_hz": command.rate_hz, "period_ms": 1000 / max(command.rate_hz, 1)}
        case messages.Heartbeat():
            return {"timeout_ms": command.timeout_ms}
    return {}


COMMANDS: dict[str, Command] = {  # key of the profile -> an example of its command
    "identify": messages.Identify(),
    "start": messages.Start(100),
    "stop": messages.Stop(),
    "set_pressure": messages.SetPressure(-40_000, 10_000),
    "vent": messages.Vent(),
    "heartbeat": messages.Heartbeat(1000),
    "clear_fault": messages.ClearFault(),
    "set_limits": messages.SetLimits(-50_000, 60_000),
}


def compile_template(key: str, text: str) -> Template:
    """Return the function that renders the template of one of `COMMANDS`. ProfileError: it is refused."""
    example = COMMANDS[key]
    _check(key, text, _values(example))

    def render(command: Command) -> bytes:
        return text.format_map(_values(command)).encode("ascii")

    try:
        render(example)
    except (ValueError, UnicodeEncodeError) as error:
        raise ProfileError(f"commands.{key}: {error}", "use ASCII text and number formats such as {kpa:.1f}") from None
    return render


def _check(key: str, text: str, values: Values) -> None:
    if len(text) > _TEMPLATE_MAX:
        raise ProfileError(f"commands.{key} is longer than {_TEMPLATE_MAX} characters", "shorten it")
    try:
        fields = [field for _, *field in string.Formatter().parse(text) if field[0] is not None]
    except ValueError as error:
        raise ProfileError(f"commands.{key}: {error}", "write {{ and }} for literal braces") from None
    for name, spec, conversion in fields:
        if name not in values:
            allowed = ", ".join(values) or "no fields"
            raise ProfileError(f"commands.{key} names the unknown field {{{name}}}", f"allowed here: {allowed}")
        if conversion or not _FORMAT.fullmatch(spec or ""):
            raise ProfileError(f"commands.{key}: {{{name}}} has an unusable format", "use one such as {kpa:.1f}")


_RECORDED = {  # field -> its quantity, the recording's unit in the quantity's stored unit, and usual units
    "time": ("time", 1e6, "s, ms, us"),
    "pressure": ("pressure", 1e3, ", ".join(PA_PER_UNIT)),
    "signal": ("voltage", 1.0, "mV, V, uV, counts"),
}
_SENSOR = re.compile(r"s([1-9])_(lit|dark|signal)")
_FILE_MAX = 100_000  # bytes of a file, characters of a text
_FIELDS_MAX = LINE_MAX // 2  # a longer line is none
_COMMENTS_MAX = 20
_NUMBER = int | float

Rules = dict[str, Any]  # key -> its type, where it is required (with None: may be left out); else its default
_TOP: Rules = {"name": str, "kind": str, "device": dict, "lines": {}, "rx8": {}, "commands": {}}
_DEVICE: Rules = {"n_sensors": int, "rate_hz": _NUMBER, "vref_mv": 0, "adc_bits": 0, "polarity": 1, "simulated": False}
_DEVICE |= dict.fromkeys(("pressure_min_kpa", "pressure_max_kpa"), _NUMBER | None)
_LINES: Rules = {"delimiter": ",", "line_end": "\n", "decimal": ".", "comments": [], "checksum": "none", "fields": list}
_LINES |= {"style": "columns", "assign": "="}
_RX8: Rules = {"format": str, "variables": dict}
_FIELD: Rules = {"name": str, "unit": str | None, "scale": 1.0, "offset": 0.0, "wraps_at": int | None, "signed": False}
_FIELD |= {"label": str | None, "base": 10, "suffix": ""}


@dataclass(frozen=True, slots=True)
class ProfileColumn:
    """One field that is used: its value in the unit of the recording is `raw * factor + offset`."""

    name: str
    factor: float
    offset: float
    wraps_at: int | None  # the raw number at which it begins again at 0


@dataclass(frozen=True, slots=True)
class TextProfile:
    """A checked profile. `columns` are in the order in which the reader gives their numbers, the channels last."""

    name: str
    toml: str
    n_sensors: int
    rate_hz: float
    vref_mv: int
    adc_bits: int
    polarity: int
    simulated: bool  # such a device sends no HELLO that tells it
    limits_pa: tuple[int, int] | None
    sample_kind: SampleKind
    columns: tuple[ProfileColumn, ...]
    channels: tuple[ExtraChannel, ...]
    format: LineFormat | PacketFormat
    signed: tuple[bool, ...]  # of the columns; RX8 only
    templates: dict[str, Template] = field(hash=False)

    def column(self, name: str) -> ProfileColumn | None:
        """Return the column of a name, None if the device does not send it."""
        used = self.columns[: len(self.columns) - len(self.channels)]
        return next((column for column in used if column.name == name), None)

    def without_channels(self) -> TextProfile:
        """Return the profile as it was read before there were extra channels."""
        n = len(self.channels)
        if not n:
            return self
        if isinstance(self.format, LineFormat):
            format_: LineFormat | PacketFormat = replace(self.format, channels=())
        else:
            format_ = replace(self.format, variables=self.format.variables[:-n])
        return replace(self, columns=self.columns[:-n], signed=self.signed[:-n], format=format_, channels=())

    @property
    def cannot_command_reason(self) -> str:
        """Why pressure cannot be commanded; empty if it can."""
        missing = [f"no `commands.{key}`" for key in ("set_pressure", "vent") if key not in self.templates]
        if self.limits_pa is None:
            missing.append("no pressure limits under `device`")
        return f"the profile {self.name!r} has {' and '.join(missing)}" if missing else ""


def load_profile(source: str | Path) -> TextProfile:
    """Return the profile in a file, or in TOML text of more than one line. ProfileError: names the key."""
    text = source if isinstance(source, str) and "\n" in source else _read(Path(source))
    if len(text) > _FILE_MAX:
        raise ProfileError(f"the profile has more than {_FILE_MAX} characters", "shorten it")
    try:
        content = read_toml(text)
    except ValueError as error:
        raise ProfileError(f"the profile is not TOML: {error}", "correct that line") from None
    top = _table(content, "", _TOP)
    device = _table(top["device"], "device.", _DEVICE)
    _check_device(device)
    format_: LineFormat | PacketFormat
    match top["kind"]:
        case "lines":
            fields, format_ = _lines(_table(top["lines"], "lines.", _LINES))
        case "rx8":
            fields, format_ = _rx8(_table(top["rx8"], "rx8.", _RX8))
        case kind:
            raise ProfileError(f"unknown kind = {kind!r:.60}", 'write kind = "lines" or kind = "rx8"')
    used = [entry for entry in fields if _is_used(entry["name"])]
    sample_kind = _sample_kind([entry["name"] for entry in used], device)
    others = fields[len(used) :]
    if len(others) > CHANNELS_MAX:
        cause = f"the profile has {len(others)} fields beside those with a meaning, more than {CHANNELS_MAX}"
        raise ProfileError(cause, 'name those that are not needed "_"')
    commands = _table(top["commands"], "commands.", dict.fromkeys(COMMANDS, str | None))
    return TextProfile(
        name=top["name"],
        toml=text,
        rate_hz=float(device["rate_hz"]),
        **{key: device[key] for key in ("n_sensors", "vref_mv", "adc_bits", "polarity", "simulated")},
        limits_pa=_limits(device),
        sample_kind=sample_kind,
        columns=(
            *(_column(entry, device) for entry in used),
            *(ProfileColumn(entry["name"], entry["scale"], entry["offset"], None) for entry in others),
        ),
        channels=channels_of((entry["name"], entry["unit"] or "") for entry in others),
        format=format_,
        signed=tuple(entry["signed"] for entry in fields),
        templates={key: compile_template(key, template) for key, template in commands.items() if template is not None},
    )


def _read(path: Path) -> str:
    try:
        return read_regular(path, _FILE_MAX).decode("utf-8").replace("\r\n", "\n")
    except (OSError, UnicodeDecodeError) as error:
        raise ProfileError(f"the profile {path} cannot be read: {error}", "give the path of a TOML file") from None


def _table(content: Any, prefix: str, rules: Rules) -> dict[str, Any]:
    """Return a table with its defaults filled in; unknown keys, wrong types and missing keys are refused by name."""
    if not isinstance(content, dict):
        raise ProfileError(f"{prefix.rstrip('.')} is not a table", "see the example profiles of boat-daq")
    for key, value in content.items():
        if key not in rules:
            raise ProfileError(f"unknown key {prefix}{key:.60}", f"allowed here: {', '.join(rules)}")
        expected = _type_of(rules[key])
        if not isinstance(value, expected) or (isinstance(value, bool) and expected is not bool):
            kinds = [kind for kind in get_args(expected) or (expected,) if kind is not NoneType]
            names = " or ".join(kind.__name__ for kind in kinds)
            raise ProfileError(f"{prefix}{key} is {value!r:.60}, not of type {names}", f"write a value of type {names}")
    for key, rule in rules.items():
        if rule is _type_of(rule) and key not in content and not isinstance(None, rule):
            raise ProfileError(f"the key {prefix}{key} is missing", "add it; see the example profiles of boat-daq")
    return {key: content.get(key, None if rule is _type_of(rule) else rule) for key, rule in rules.items()}


def _type_of(rule: Any) -> Any:
    """Return the type that a rule accepts: itself, or that of its default."""
    if isinstance(rule, type | UnionType):
        return rule
    return _NUMBER if isinstance(rule, float) else type(rule)


def _check_device(device: dict[str, Any]) -> None:
    ranges = {
        "n_sensors": (1, messages.SENSORS_MAX), "rate_hz": (0.01, 65_535), "vref_mv": (0, 65_535), "adc_bits": (0, 16),
    }  # fmt: skip
    for key, (low, high) in ranges.items():
        if not low <= device[key] <= high:
            raise ProfileError(f"device.{key} = {device[key]} is outside {low} to {high}", "correct it")
    if device["polarity"] not in (1, -1):
        raise ProfileError(f"device.polarity = {device['polarity']}", "write 1 or -1")


def _limits(device: dict[str, Any]) -> tuple[int, int] | None:
    low, high = device["pressure_min_kpa"], device["pressure_max_kpa"]
    if low is None and high is None:
        return None
    if low is None or high is None:
        raise ProfileError("only one of device.pressure_min_kpa and pressure_max_kpa is given", "give both, or none")
    if not -101.325 <= low < high <= 1000:
        raise ProfileError(f"pressure limits of {low} to {high} kPa", "give the lower first, from -101.325 to 1000 kPa")
    return round(low * 1000), round(high * 1000)


def _lines(table: dict[str, Any]) -> tuple[list[dict[str, Any]], LineFormat]:
    entries = [_field(entry, f"lines.fields[{at}].") for at, entry in enumerate(table["fields"], 1)]
    if len(table["delimiter"]) != 1 or table["decimal"] not in (".", ",") or table["delimiter"] == table["decimal"]:
        raise ProfileError("lines.delimiter must be one character, lines.decimal another one: . or ,", "correct them")
    if table["line_end"] not in ("\n", "\r", "\r\n") or table["checksum"] not in ("none", *CHECKSUMS):
        cause = f"lines.line_end = {table['line_end']!r} with lines.checksum = {table['checksum']!r}"
        raise ProfileError(cause, rf'line ends are "\n", "\r\n" or "\r", checksums none, {", ".join(CHECKSUMS)}')
    if table["style"] not in get_args(LineStyle) or len(table["assign"].encode()) != 1:
        cause = f"lines.style = {table['style']!r:.60} with lines.assign = {table['assign']!r:.60}"
        raise ProfileError(cause, f"styles are {', '.join(get_args(LineStyle))}; assign is one character such as =")
    comments = table["comments"]
    if not all(isinstance(comment, str) and comment for comment in comments):
        raise ProfileError(f"lines.comments = {comments!r:.60}", 'write a list of prefixes such as ["#"]')
    for key, most in (("fields", _FIELDS_MAX), ("comments", _COMMENTS_MAX)):
        if len(table[key]) > most:
            raise ProfileError(f"lines.{key} has {len(table[key])} entries, more than {most}", "shorten it")
    used = [at for at, entry in enumerate(entries) if _is_used(entry["name"])]
    channels = [at for at, entry in enumerate(entries) if _is_channel(entry["name"])]
    format_ = LineFormat(
        delimiter=table["delimiter"].encode(),
        line_end=table["line_end"].encode(),
        decimal=table["decimal"].encode(),
        comments=tuple(comment.encode() for comment in comments),
        checksum="" if table["checksum"] == "none" else table["checksum"],
        n_fields=len(entries),
        columns=tuple(used),
        channels=tuple(channels),
        style=table["style"],
        assign=table["assign"].encode(),
        texts=_texts(entries, table["style"]),
    )
    return [entries[at] for at in (*used, *channels)], format_


def _texts(entries: list[dict[str, Any]], style: str) -> tuple[FieldText, ...]:
    """Return how each field is printed; empty where all are plain numbers in their order."""
    if bad := next((entry for entry in entries if entry["base"] not in (10, 16)), None):
        raise ProfileError(f"the field {bad['name']} has the base {bad['base']}", "write 10 or 16")
    labels = [entry["name"] if entry["label"] is None else entry["label"] for entry in entries]
    if style in ("labels", "json") and len(set(labels)) != len(labels):
        twice = next(label for label in labels if labels.count(label) > 1)
        raise ProfileError(f"the label {twice:.60} is given twice", "give each field the label that it is printed with")
    texts = tuple(
        FieldText(label.encode(), entry["base"], entry["suffix"].encode(), entry["signed"])
        for label, entry in zip(labels, entries, strict=True)
    )
    plain = style in ("columns", "width") and all(text.base == 10 and not text.suffix for text in texts)
    return () if plain else texts


def _rx8(table: dict[str, Any]) -> tuple[list[dict[str, Any]], PacketFormat]:
    format_ = parse_format(table["format"])
    sizes = {name: len(places) for name, places in format_.variables}
    fields = {}
    for variable, entry in table["variables"].items():
        if variable not in sizes:
            raise ProfileError(f"rx8.variables.{variable} is not in rx8.format", f"it has {', '.join(sizes)}")
        entry = _field(entry, f"rx8.variables.{variable}.")
        wraps = entry["name"] in ("time", "index") and entry["wraps_at"] is None
        fields[variable] = {**entry, "wraps_at": 1 << 8 * sizes[variable] if wraps else entry["wraps_at"]}
    for variable in sizes:  # one without a stated meaning is a channel under its own name
        fields.setdefault(variable, _field(f"{variable} (raw)" if _is_used(variable) else variable, ""))
    used = [variable for variable, entry in fields.items() if _is_used(entry["name"])]
    kept = [*used, *(variable for variable, entry in fields.items() if _is_channel(entry["name"]))]
    places = dict(format_.variables)
    return [fields[name] for name in kept], replace(format_, variables=tuple((name, places[name]) for name in kept))


def _field(entry: Any, prefix: str) -> dict[str, Any]:
    """Return a field's table; its name alone is one too."""
    return _table({"name": entry} if isinstance(entry, str) else entry, prefix, _FIELD)


def _is_used(name: str) -> bool:
    return name in ("time", "index", "pressure") or _SENSOR.fullmatch(name) is not None


def _is_channel(name: str) -> bool:
    return name.strip() != "" and not name.startswith("_") and not _is_used(name)


def _sample_kind(names: list[str], device: dict[str, Any]) -> SampleKind:
    """Return "counts" or "signal"; refuse names that are missing, given twice or do not fit together."""
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ProfileError(f"the field {twice} is given twice", "give each name once")
    sensors = range(1, device["n_sensors"] + 1)
    counts = {f"s{n}_{which}" for n in sensors for which in ("lit", "dark")}
    signal = {f"s{n}_signal" for n in sensors}
    given = {name for name in names if _SENSOR.fullmatch(name)}
    if "pressure" not in names:
        raise ProfileError("no field is named pressure", "name the field that carries the pressure")
    if given == counts:
        if not (device["vref_mv"] and device["adc_bits"]):
            raise ProfileError("device.vref_mv or device.adc_bits is missing", "readings in counts need both")
        return "counts"
    if given == signal:
        return "signal"
    remedy = f"give {', '.join(sorted(counts))}, or {', '.join(sorted(signal))}, and no other"
    raise ProfileError(f"the sensors' fields are {', '.join(sorted(given)) or 'missing'}", remedy)


def _column(entry: dict[str, Any], device: dict[str, Any]) -> ProfileColumn:
    name, unit = entry["name"], entry["unit"]
    if entry["wraps_at"] is not None and (name not in ("time", "index") or entry["wraps_at"] < 256):
        raise ProfileError(f"wraps_at = {entry['wraps_at']} for {name}", "only time and index wrap, at 256 or more")
    per_unit = _per_unit(name, unit, device)
    scale, offset = entry["scale"], entry["offset"]
    measured = name == "pressure" or name.endswith("signal")
    if not measured and (offset or scale <= 0 or (scale != 1 and name != "time")):
        raise ProfileError(f"{name} has scale {scale} and offset {offset}", "time may have a scale, counts neither")
    return ProfileColumn(name, scale * per_unit, offset * per_unit, entry["wraps_at"])


def _per_unit(name: str, unit: str | None, device: dict[str, Any]) -> float:
    """Return what one unit of a field is in the unit of the recording: us, Pa or mV; 1 for counts and the index."""
    kind = "signal" if name.endswith("signal") else name
    if kind not in _RECORDED:
        if unit is None:
            return 1.0
        raise ProfileError(f"{name} has the unit {unit!r:.60}", "leave it out")
    quantity, factor, examples = _RECORDED[kind]
    if kind == "signal" and unit == "counts" and device["adc_bits"] and device["vref_mv"]:
        return float(device["vref_mv"] / (1 << device["adc_bits"]))
    found = find_unit(unit or "")
    if found is None or found.quantity != quantity or found.symbol != (unit or "").replace("µ", "u"):
        raise ProfileError(f"{name} has the unit {unit!r:.60}", f"write one of {examples}")
    return float(found.factor * factor)
