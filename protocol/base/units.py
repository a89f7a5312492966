"""Units of measurement with SI prefixes, and conversion between them.

Each quantity is stored and computed in one unit (kPa, mV, mm, s, degC, mA, L/min ...); a `MeasurementUnit` is a factor
and an offset to it. Values are converted on input and display only. Factors are exact, or those of NIST SP 811.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Final, NamedTuple

COVERAGE_FACTOR = 2.0  # about 95 % of a normal distribution


MINUS = "\u2212"
NOTHING = "\u2013"  # in place of a value that is not known
NO_BREAK = "\u00a0"  # a space at which no line ends

KPA_PER_UNIT = {
    "kpa": 1.0, "pa": 1e-3, "hpa": 0.1, "mpa": 1e3, "bar": 100.0, "mbar": 0.1, "psi": 6.894757293168361,
    "mmhg": 0.13332236842105263, "torr": 0.13332236842105263, "atm": 101.325,
}  # fmt: skip

_PREFIXES: Final = {
    "G": 1e9, "M": 1e6, "k": 1e3, "h": 1e2, "d": 1e-1, "c": 1e-2, "m": 1e-3, "u": 1e-6, "n": 1e-9, "p": 1e-12,
}  # fmt: skip
# name -> quantity, and its value in the quantity's stored unit; those of the first table take prefixes
_PREFIXED: Final = {
    "Pa": ("pressure", 1e-3), "bar": ("pressure", 100.0), "V": ("voltage", 1e3), "A": ("current", 1e3),
    "m": ("length", 1e3), "s": ("time", 1.0), "L": ("volume", 1.0), "g": ("mass", 1.0), "N": ("force", 1.0),
    "W": ("power", 1.0), "Hz": ("frequency", 1.0), "ohm": ("resistance", 1.0), "K": ("temperature", 1.0),
    "lx": ("illuminance", 1.0), "J": ("energy", 1.0), "T": ("flux density", 1.0),
}  # fmt: skip
_PLAIN: Final = {
    "psi": ("pressure", KPA_PER_UNIT["psi"]), "mmHg": ("pressure", KPA_PER_UNIT["mmhg"]),
    "Torr": ("pressure", KPA_PER_UNIT["torr"]), "atm": ("pressure", KPA_PER_UNIT["atm"]),
    "cmH2O": ("pressure", 0.0980665), "mmH2O": ("pressure", 0.00980665), "inH2O": ("pressure", 0.24908891),
    "inHg": ("pressure", 3.386389), "mH2O": ("pressure", 9.80665), "ftH2O": ("pressure", 2.98898),
    "ozf/in2": ("pressure", KPA_PER_UNIT["psi"] / 16), "kgf/cm2": ("pressure", 98.0665), "in": ("length", 25.4),
    "min": ("time", 60.0), "h": ("time", 3600.0), "d": ("time", 86400.0), "pF": ("capacitance", 1.0),
    "nF": ("capacitance", 1e3), "uF": ("capacitance", 1e6), "m3": ("volume", 1000.0), "%": ("ratio", 1.0),
    "ppm": ("ratio", 1e-4),
    "degC": ("temperature", 1.0), "degF": ("temperature", 5 / 9), "deg": ("angle", 1.0), "rpm": ("rotation", 1.0),
}  # fmt: skip
_OFFSETS: Final = {"K": -273.15, "degF": -160 / 9}  # of temperatures, in degC
_SPELT: Final = {  # other spellings, in small letters
    "c": "degC", "celsius": "degC", "deg c": "degC", "f": "degF", "fahrenheit": "degF", "deg f": "degF",
    "kelvin": "K", "ampere": "A", "percent": "%", "%rh": "%", "%rf": "%", "vdc": "V", "mvdc": "mV",
    "volt": "V", "volts": "V", "millivolt": "mV", "millivolts": "mV", "microvolt": "uV", "microvolts": "uV",
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "sekunde": "s", "sekunden": "s", "seconde": "s",
    "seconden": "s", "secondes": "s", "segundos": "s", "msec": "ms", "millisecond": "ms", "milliseconds": "ms",
    "usec": "us", "microsecond": "us", "microseconds": "us", "nanosecond": "ns", "nanoseconds": "ns", "mins": "min",
    "minute": "min", "minutes": "min", "minuten": "min", "hr": "h", "hrs": "h", "hour": "h", "hours": "h",
    "day": "d", "days": "d", "tage": "d", "pascal": "Pa", "pascals": "Pa", "kilopascal": "kPa", "kilopascals": "kPa",
    "millibar": "mbar", "bars": "bar", "kg/cm2": "kgf/cm2", "kgf/cm^2": "kgf/cm2", "kg/cm^2": "kgf/cm2",
    "lbf/in2": "psi", "pounds per square inch": "psi", "inches h2o": "inH2O", "inwc": "inH2O",
    "in wc": "inH2O", "inches of water": "inH2O",
    "mmws": "mmH2O", "mws": "mH2O", "oz/in2": "ozf/in2", "dyn/cm2": "dPa", "kp/cm2": "kgf/cm2", "newton": "N",
    "newtons": "N", "ohms": "ohm", "kiloohm": "kohm", "kiloohms": "kohm", "millimeter": "mm", "millimeters": "mm",
    "millimetre": "mm", "millimetres": "mm", "micrometer": "um", "micrometre": "um", "micron": "um", "microns": "um",
    "n/mm2": "MPa", "n/m2": "Pa", "kn/m2": "kPa",
    "picofarad": "pF", "nanometer": "nm", "nanometre": "nm",
    "inch": "in", "l": "L", "slpm": "L/min", "lpm": "L/min", "ml/min": "mL/min", "sccm": "mL/min", "µ": "um",
}  # fmt: skip
_CASELESS: Final = (  # what a name in the wrong case means
    "Pa", "hPa", "kPa", "MPa", "bar", "mbar", "psi", "mmHg", "Torr", "atm", "V", "mV", "uV", "A", "mA", "m", "cm", "mm",
    "um", "s", "ms", "us", "min", "h", "degC", "degF", "K", "N", "mN", "kN", "Hz", "kHz", "W", "mW", "ohm", "kohm", "g",
    "kg", "L/min", "mL/min", "lx", "mL", "ns", "cmH2O", "mmH2O", "inH2O", "mH2O", "ftH2O", "inHg", "pF", "nF", "nm",
    "kgf/cm2",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class MeasurementUnit:
    """A unit: `value * factor + offset` is the value in the stored unit of its quantity."""

    symbol: str
    quantity: str
    factor: float
    offset: float = 0.0


_LETTERS = str.maketrans({"µ": "u", "μ": "u", "°": "deg", "Ω": "ohm", "³": "3", "²": "2"})


@cache
def find_unit(text: str) -> MeasurementUnit | None:
    """Return the unit of a name, with a prefix or spelt in another case too; None where it is not known."""
    name = text.strip().translate(_LETTERS).strip("[]() ")
    if name.lower().endswith(("h2o", "hg")):
        name = re.sub(r"[ .]", "", name)  # mm Hg, in. H2O
    found = _exact(name) or _exact(_SPELT.get(name.lower(), ""))
    if found is None:
        found = next((_exact(known) for known in _CASELESS if known.lower() == name.lower()), None)
    return found


def _exact(name: str) -> MeasurementUnit | None:
    if name in _PLAIN or name in _PREFIXED:
        quantity, factor = (_PLAIN if name in _PLAIN else _PREFIXED)[name]
        return MeasurementUnit(name, quantity, factor, _OFFSETS.get(name, 0.0))
    if name[:1] in _PREFIXES and name[1:] in _PREFIXED and name[1:] != "K":
        quantity, factor = _PREFIXED[name[1:]]
        return MeasurementUnit(name, quantity, _PREFIXES[name[0]] * factor)
    above, slash, below = name.partition("/")
    if slash and (top := _exact(above)) and (bottom := _exact(below)) and not (top.offset or bottom.offset):
        return MeasurementUnit(name, f"{top.quantity} by {bottom.quantity}", top.factor / bottom.factor)
    return None


def conversion(given: str, wanted: str) -> tuple[float, float] | None:
    """Return (factor, offset): `value * factor + offset` is in `wanted`; None if the quantities differ."""
    if given == wanted:
        return 1.0, 0.0
    one, other = find_unit(given), find_unit(wanted)
    if one is None or other is None or one.quantity != other.quantity:
        return None
    return one.factor / other.factor, (one.offset - other.offset) / other.factor


def in_a_name(symbol: str) -> str:
    """Return a unit as the end of a column's name: L/min becomes l_per_min; empty where there is none."""
    found = find_unit(symbol)
    text = (found.symbol if found else symbol).replace("%", "percent").replace("/", "_per_")
    return re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_").lower()


@dataclass(frozen=True, slots=True)
class Shown:
    """How values of one stored unit are shown: `value * factor + offset`, in `symbol`."""

    symbol: str
    factor: float = 1.0
    offset: float = 0.0

    def value(self, stored: float) -> float:
        """Return a stored value as it is shown."""
        return stored * self.factor + self.offset

    def decimals(self, stored: int) -> int:
        """Return the decimals that show as much as so many of the stored unit."""
        return max(0, stored - round(math.log10(self.factor)))


CHOICES: Final = {  # quantity -> the units in which it can be shown, the stored one first
    "pressure": ("kPa", "bar", "mbar", "psi", "MPa", "Pa", "mmHg"),
    "voltage": ("mV", "V", "uV"),
    "length": ("mm", "%", "um", "cm", "in"),
    "temperature": ("degC", "degF", "K"),
}


@dataclass(frozen=True, slots=True)
class ShownUnits:
    """The units in which values are shown, by quantity; an elongation in % is relative to `rest_length_mm`."""

    pressure: str = "kPa"
    voltage: str = "mV"
    length: str = "mm"
    temperature: str = "degC"
    rest_length_mm: float = 75.0

    @classmethod
    def of(cls, text: str) -> ShownUnits:
        """Return the units in a text such as `bar,V,%`; others are the default. ValueError: not in `CHOICES`."""
        chosen: dict[str, Any] = {}
        for part in filter(None, (part.strip() for part in text.split(","))):
            found = find_unit(part)
            quantities = [name for name, units in CHOICES.items() if found is not None and found.symbol in units]
            if found is None or not quantities:
                known = ", ".join(unit for units in CHOICES.values() for unit in units)
                raise ValueError(f"{part!r:.40} is none of the units {known}")
            chosen[quantities[0]] = found.symbol
        return replace(STORED_UNITS, **chosen)

    def of_signals_in(self, unit: str) -> ShownUnits:
        """Return the units for a run whose signals are in `unit`: where that is not mV, they are shown in it."""
        return self if unit == STORED_UNITS.voltage else replace(self, voltage=unit)

    def shown(self, stored: str) -> Shown:
        """Return how values of a unit such as kPa, mV/mm or degC are shown."""
        return _shown(self, stored)

    def _part(self, stored: str) -> Shown:
        found = find_unit(stored)
        if found is None or found.quantity not in CHOICES:
            return Shown(stored)
        own, wanted = CHOICES[found.quantity][0], getattr(self, found.quantity)
        if wanted == own:  # a channel in another unit keeps it until one is chosen
            return Shown(stored)
        if wanted == "%":
            return Shown("%", 100.0 * found.factor / self.rest_length_mm)
        factor, offset = conversion(stored, wanted) or (1.0, 0.0)
        return Shown(wanted, factor, offset)


STORED_UNITS: Final = ShownUnits()


@cache
def _shown(units: ShownUnits, stored: str) -> Shown:
    above, slash, below = stored.partition("/")
    if not slash:
        return Shown("") if stored == "1" else units._part(stored)  # a ratio has no unit
    (top, high), (bottom, low) = ((units._part(part.rstrip("²³")), part) for part in (above, below))
    factor = top.factor ** _power(high) / bottom.factor ** _power(low)
    return Shown(f"{top.symbol}{_exponent(high)}/{bottom.symbol}{_exponent(low)}", factor)


def _exponent(text: str) -> str:
    return text[-1] if text[-1:] in ("²", "³") else ""


def _power(text: str) -> int:
    return {"²": 2, "³": 3}.get(_exponent(text), 1)


_AFTER_NUMBER = re.compile(r"(?<=\d) ([^\s,;:.)]+)")


class Quantity(NamedTuple):
    """A value in a stored unit, within a text; `form` is its format, `named` whether its unit follows it."""

    value: float
    unit: str
    form: str = "g"
    named: bool = True

    def text(self, shown: Shown) -> str:
        """Return it in the unit `shown`, with as many decimals as in the stored one, or four digits."""
        form = self.form
        other = self.unit.startswith("mV") and shown.symbol.partition("/")[0] not in CHOICES["voltage"]
        if other and form.endswith("f"):  # of signals in another unit than mV
            form = f"{form.partition('.')[0]}.3g"
        elif shown.symbol != self.unit and form.endswith("f"):
            form = f"{form.partition('.')[0]}.{shown.decimals(int(form[:-1].partition('.')[2]))}f"
        elif shown.symbol != self.unit and "." not in form:
            form = f"{form[:-1]}.4g"
        form = form.replace("+", "+z") if form.startswith("+") else f"z{form}"
        number = f"{shown.value(self.value):{form}}"
        number = number if float(number) else number.removeprefix("+")  # a rounded zero has no sign
        return f"{number}{f' {as_text(shown.symbol)}' if self.named else ''}"


class UnitText(str):
    """A text with quantities: in stored units as a string, in those of a window by `shown`."""

    __slots__ = ("pieces",)
    pieces: tuple[str | Quantity, ...]

    def __new__(cls, *pieces: str | Quantity) -> UnitText:
        """Return the text of some pieces; those of another such text are taken over."""
        flat = [part for piece in pieces for part in (piece.pieces if isinstance(piece, UnitText) else (piece,))]
        made = super().__new__(cls, "".join(_piece(part, STORED_UNITS) for part in flat))
        made.pieces = tuple(flat)
        return made

    @classmethod
    def filled(cls, template: str, **pieces: str | Quantity) -> UnitText:
        """Return a template with each `{name}` replaced by the piece of that name."""
        parts = re.split(r"\{(\w+)\}", template)
        return cls(*(pieces[part] if k % 2 else part for k, part in enumerate(parts)))

    def __reduce__(self) -> tuple[type[UnitText], tuple[str | Quantity, ...]]:
        """Keep the pieces in a pickle, as from a helper process."""
        return UnitText, self.pieces

    def joined(self, texts: Iterable[str]) -> UnitText:
        """Return texts with this one between them."""
        return UnitText(*[part for k, text in enumerate(texts) for part in ((self, text) if k else (text,))])


def _piece(part: str | Quantity, units: ShownUnits) -> str:
    return part.text(units.shown(part.unit)) if isinstance(part, Quantity) else part


def in_shown_units(text: str, units: ShownUnits) -> str:
    """Return a text with its quantities in `units`; any other text unchanged."""
    return "".join(_piece(part, units) for part in text.pieces) if isinstance(text, UnitText) else text


def unbroken(text: str) -> str:
    """Return a sentence in which no line ends between a value and its unit, or beside an equals sign."""
    joined = _AFTER_NUMBER.sub(lambda found: (NO_BREAK if find_unit(found[1]) else " ") + found[1], text)
    return joined.replace("% FSO", f"%{NO_BREAK}FSO").replace(" = ", f"{NO_BREAK}={NO_BREAK}")


def in_signal_unit(text: str, unit: str) -> str:
    """Return a text about signals in another unit than mV, the numbers of which are in it already."""
    if unit == STORED_UNITS.voltage:
        return text
    if isinstance(text, UnitText):
        return UnitText(*(_stated_in(part, unit) for part in text.pieces))
    return re.sub(r"\bmV\b", as_text(unit), text)


def _stated_in(part: str | Quantity, unit: str) -> str | Quantity:
    if isinstance(part, str):
        return in_signal_unit(part, unit)
    form = f"{part.form.partition('.')[0]}.4g" if "mV" in part.unit and part.form.endswith("f") else part.form
    return part._replace(unit=part.unit.replace("mV", unit), form=form)


def as_text(symbol: str) -> str:
    """Return a unit as it is printed: degC as °C, um as µm."""
    return re.sub(r"\bu(?=[A-Zm])", "µ", symbol.replace("deg", "°").replace("ohm", "Ω")) if symbol != "deg" else "°"
