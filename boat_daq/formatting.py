"""Numbers as text: constant decimals, a real minus sign, the units of the lab; an unknown one is an en dash."""

from __future__ import annotations

import math
import re

from protocol.base.units import MINUS, NOTHING, STORED_UNITS, ShownUnits, as_text, in_shown_units

THIN = "\u2009"  # between thousands and before units
_SI = ((1.0, "s"), (1e-3, "ms"), (1e-6, "\u00b5s"), (1e-9, "ns"))
TYPED = str.maketrans({MINUS: "-", "\u2013": "-", ",": ".", THIN: ""})
SUBSCRIPT = str.maketrans("0123456789", "\u2080\u2081\u2082\u2083\u2084\u2085\u2086\u2087\u2088\u2089")
SUPERSCRIPT = str.maketrans("-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079")


def number(value: float | None, decimals: int, *, sign: bool = False) -> str:
    """Return `value` with `decimals`, thousands parted; an en dash where it is unknown or not finite."""
    if value is None or not math.isfinite(value):
        return NOTHING
    rounded = round(value, decimals) + 0.0  # no minus before a rounded zero
    text = f"{abs(rounded):,.{decimals}f}".replace(",", THIN)
    if rounded < 0:
        return MINUS + text
    return f"+{text}" if sign and rounded > 0 else text


def in_units(units: ShownUnits, stored: str, value: float, decimals: int, *, band: float = -1.0) -> str:
    """Return a value with its unit as shown, and a half band unless negative; `decimals` apply to the `stored` unit."""
    shown = units.shown(stored)
    places = shown.decimals(decimals)
    text = number(shown.value(value), places, sign=stored in ("mm", "kPa"))
    width = f" \u00b1{number(shown.factor * band, places)}" if band >= 0 else ""
    return f"{text}{width} {as_text(shown.symbol)}".rstrip()


def typographic(text: str) -> str:
    """Return a text whose negative numbers have a minus sign."""
    return re.sub(r"(?<![\w.])-(?=\d)", MINUS, text)


def as_shown(text: str, units: ShownUnits) -> str:
    """Return a text of engine or analysis with quantities in `units` and the window's minus."""
    return typographic(in_shown_units(text, units))


def pressure(kpa: float | None) -> str:
    """Return a pressure with its unit, signed, e.g. `+30.0 kPa`."""
    return f"{number(kpa, 1, sign=True)} kPa"


def target(kpa: float, units: ShownUnits = STORED_UNITS) -> str:
    """Return a plan's pressure, e.g. `+30 kPa`, `+2.5 kPa` or `+300 mbar`."""
    shown = units.shown("kPa")
    value = round(shown.value(kpa), places := shown.decimals(1))
    return f"{number(value, 0 if value.is_integer() else places, sign=True)} {as_text(shown.symbol)}"


def duration(seconds: float | None) -> str:
    """Return a duration as `3:12` or `1:03:12`."""
    if seconds is None or not math.isfinite(seconds):
        return NOTHING
    whole = max(0, round(seconds))
    hours, rest = divmod(whole, 3600)
    minutes, left = divmod(rest, 60)
    return f"{hours}:{minutes:02d}:{left:02d}" if hours else f"{minutes}:{left:02d}"


def clock(seconds: float) -> str:
    """Return an instant of the plots as `3:12.4` or `1:03:12.4`."""
    minutes, tenths = divmod(round(10 * abs(seconds)), 600)
    hours = f"{minutes // 60}:{minutes % 60:02d}" if minutes >= 60 else f"{minutes}"
    return f"{MINUS if seconds < 0 else ''}{hours}:{tenths // 10:02d}.{tenths % 10}"


def size_text(size: float) -> str:
    """Return a size in bytes as `12.3 MB`."""
    scale, unit = next(((s, u) for s, u in ((1e12, "TB"), (1e9, "GB"), (1e6, "MB")) if size >= s), (1e6, "MB"))
    return f"{number(size / scale, 0 if size >= 100 * scale else 1)} {unit}"


def span(seconds: float) -> str:
    """Return a window's length in words, e.g. `10 s`, `2 min`, `1 h`."""
    size, unit = (1, "s") if seconds < 60 else (60, "min") if seconds < 3600 else (3600, "h")
    return f"{seconds / size:g} {unit}"


def duration_text(seconds: float, digits: int = 3) -> str:
    """Return a short time with its unit, e.g. `12.3 \u00b5s`."""
    if not math.isfinite(seconds):
        return NOTHING
    scale, unit = next(((s, u) for s, u in _SI if abs(seconds) >= s * 0.9995), _SI[-1])
    return f"{float(f'{seconds / scale:.{digits}g}'):g}{THIN}{unit}"


def power_text(value: float, digits: int = 1) -> str:
    """Return a number that spans decades: plain near 1, `2\u00b710\u207b\u2076` far from it."""
    if value == 0:
        return "0"
    value = float(f"{value:.{digits - 1}e}")  # rounded before its decade is taken
    power = math.floor(math.log10(abs(value)) + 1e-9)
    if -3 <= power <= 4:
        return number(value, max(0, digits - 1 - power))
    mantissa, raised = value / 10.0**power, f"10{str(power).translate(SUPERSCRIPT)}"
    text = f"{mantissa:.{digits - 1}f}"
    return raised if digits == 1 and text == "1" else f"{text}\u00b7{raised}"


def quantity(value: float, unit: str) -> str:
    """Return a value of any order of magnitude with its unit, two digits."""
    return f"{power_text(value, 2)} {unit}".strip()


def count(n: int, singular: str, plural: str = "") -> str:
    """Return `1 sample`, `2 samples`, `1 204 samples`."""
    return f"{number(n, 0)} {singular if n == 1 else plural or singular + 's'}"


def plain_number(text: str) -> float:
    """Return the number a person typed: comma or point, typographic minus, spaces. ValueError: not a finite number."""
    value = float(text.strip().translate(TYPED).removesuffix("mm"))
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def stored_number(text: str, units: ShownUnits, stored: str) -> float:
    """Return the value in a stored unit of what was typed in the shown one. ValueError: not a finite number."""
    shown = units.shown(stored)
    text = text.strip().removesuffix(as_text(shown.symbol)).removesuffix(shown.symbol)
    return (plain_number(text) - shown.offset) / shown.factor


def sensor_words(name: str) -> str:
    """Return `s1` or `s1_mv` as `Sensor 1`."""
    found = re.fullmatch(r"s(\d+)(_mv)?", name)
    return f"Sensor {found[1]}" if found else name
