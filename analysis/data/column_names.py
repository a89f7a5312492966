"""Titles of columns in tables of other programs: the quantity that a title names, and its unit of measurement.

Pressures are gauge: a `g`, `(g)` or "gauge" behind a unit is dropped, an absolute unit is refused. The unit of a signal
may be of any quantity; voltages become mV, others stay as they are.
"""

from __future__ import annotations

import re

import numpy as np

from protocol.base.arrays import FloatArray
from protocol.base.errors import RequestError
from protocol.base.units import MeasurementUnit, find_unit

SENSORS_IN_A_RECORDING = 8
_QUANTITY = {"time_s": "time", "pressure_kpa": "pressure", "target_kpa": "pressure", "elongation_mm": "length"}
_WORDS = {
    "time_s": (
        "time", "t", "tijd", "zeit", "temps", "tempo", "tiempo", "timestamp", "datetime", "date time", "date",
        "elapsed", "x", "seconds", "second", "millis", "micros", "nanos", "milliseconds", "microseconds", "datenum",
        "x_value", "x value", "x-axis", "clock", "ts", "date/time", "time*", "uhrzeit", "zeitstempel", "prüfzeit",
        "messzeit", "laufzeit", "heure", "hora", "test time", "running time", "run time", "total time", "start time",
        "時間", "時刻", "日時", "时间", "date&time",
    ),
    "pressure_kpa": (
        "pressure", "p", "druk", "druck", "pression", "pressione", "presion", "presión", "press", "gauge", "istdruck",
        "圧力", "压力",
    ),
    "target_kpa": ("target", "setpoint", "set point", "solldruck"),
    "elongation_mm": (
        "elongation", "displacement", "extension", "laser", "lvdt", "deflection", "weg", "auslenkung", "verplaatsing",
        "déplacement", "deplacement", "stroke", "standardweg", "変位", "位移",
    ),
}  # fmt: skip
_SENSOR = re.compile(
    r"^(?:s|sensor|signal|ch|channel|kanal|ai|sig|y|voltage)[\s_]*(\d{1,2}|[a-h])(?:[\s_]*(?:mv|v|uv|signal|voltage))?$"
)
_SIGNAL_WORDS = ("signal", "voltage", "sensor", "mv", "v", "output", "light")
OTHER_SIGNALS = re.compile(r"\b(force|load|resistance|capacitance|wavelength|frequency|counts?|adc|\w*kraft)\b")
_NO_TIME = frozenset(("cycle", "cycles", "count", "counts", "number", "points"))  # "Elapsed Cycles"
COUNTS = re.compile(r"^s([1-9]\d?)_(lit|dark)$")
PLAIN = ("index", "state", "flags", "segment", "simulated")
_WANTED = frozenset((  # of a pressure that is not measured
    "set", "setpoint", "sp", "soll", "sollwert", "target", "command", "commanded", "cmd", "demand", "desired", "ref",
    "reference", "consigne",
))  # fmt: skip
_MEASURED = frozenset(("actual", "act", "measured", "meas", "ist", "istwert", "pv", "feedback"))
_OWN_UNIT = {"millis": "ms", "micros": "us", "nanos": "ns", "seconds": "s", "second": "s", "milliseconds": "ms",
             "microseconds": "us", "datenum": "d"}  # fmt: skip
_NO_QUANTITY = frozenset(("counts", "count", "lsb", "digits", "raw", "a.u.", "au", "adu", "arb.", "1"))
_ABSOLUTE = re.compile(r"[\s_]*\(?(?:a|abs\.?|absolute)\)?$", re.IGNORECASE)
_GAUGE = re.compile(r"[\s_]*\(?(?:g|gauge|ga|rel\.?|relative|d|diff\.?)\)?$", re.IGNORECASE)
_SHOWN = ("s, ms, us, ns, min, h, d", "kPa, Pa, hPa, MPa, bar, mbar, psi, mmHg, kgf/cm2, cmH2O", "mm, um, cm, m, in")
_USUAL = {"time": _SHOWN[0], "pressure": _SHOWN[1], "length": _SHOWN[2]}
_EXCEL_DAYS, _MATLAB_DAYS = (20_000.0, 80_000.0), (6e5, 9e5)  # of the years 1954 to 2119; 1643 to 2464
_EPOCHS = ((1e9, 4.1e9, "s"), (1e12, 4.1e12, "ms"), (1e15, 4.1e15, "us"), (1e18, 4.1e18, "ns"))  # from 1970 or 1904


def is_signal(name: str) -> bool:
    """Return whether a column of our name holds a sensor's signal or counts."""
    return name.endswith("_mv") or COUNTS.match(name) is not None


def our_name(text: str) -> str:
    """Return our name of a column, also for a short form of it; RequestError for another."""
    name = text.strip().lower()
    sensor = _SENSOR.match(name)
    if sensor and sensor[1].isdigit() and 1 <= int(sensor[1]) <= SENSORS_IN_A_RECORDING:
        return f"s{int(sensor[1])}_mv"
    short = {"time": "time_s", "pressure": "pressure_kpa", "target": "target_kpa", "signal": "s1_mv",
             "elongation": "elongation_mm"}.get(name, name)  # fmt: skip
    if short in _QUANTITY or short in PLAIN or COUNTS.match(short) or short == "s1_mv":
        return short
    raise RequestError(
        f"{text!r} is not a name that a column can be mapped to",
        "Map time_s, pressure_kpa, target_kpa, elongation_mm, "
        f"s1_mv to s{SENSORS_IN_A_RECORDING}_mv, s1_lit, s1_dark, ...",
    )


def unit_for(name: str, text: str) -> MeasurementUnit | None:
    """Return a unit that a column of our name may have, its factor to the stored unit; None for another."""
    found = _gauge_unit(text) if name in ("pressure_kpa", "target_kpa") else find_unit(text)
    if is_signal(name):
        plain = MeasurementUnit("counts", "counts", 1.0) if text.strip().lower() in _NO_QUANTITY else None
        return found if found is not None and found.quantity != "time" else plain
    return found if found is not None and found.quantity == _QUANTITY.get(name) else None


def quantity_of(unit: str) -> str:
    """Return the quantity of a unit, of absolute pressures too; "" of none."""
    found = _gauge_unit(unit) if unit.strip() else None
    return found.quantity if found is not None else "pressure" if absolute_unit(unit) else ""


def units_of(name: str) -> tuple[str, ...]:
    """Return the usual units that a column of our name may have."""
    quantity = _QUANTITY.get(name)
    return ("mV", "V", "uV", "N", "ohm", "pF", "nm", "counts") if quantity is None else tuple(
        _USUAL[quantity].split(", ")
    )  # fmt: skip


def known_unit(text: str) -> bool:
    """Return whether a text is a unit of measurement."""
    return bool(text.strip()) and (_gauge_unit(text) is not None or text.strip().lower() in _NO_QUANTITY)


def absolute_unit(text: str) -> str:
    """Return the unit of an absolute pressure, as psi of psia, bar(a) or kPa abs; empty for any other text."""
    bare = _ABSOLUTE.sub("", text.strip())
    found = find_unit(bare) if bare != text.strip() and find_unit(text) is None else None
    return found.symbol if found is not None and found.quantity == "pressure" else ""


def _gauge_unit(text: str) -> MeasurementUnit | None:
    found = find_unit(text)
    bare = _GAUGE.sub("", text.strip())
    if found is None and bare != text.strip():
        found = find_unit(bare)
        return found if found is not None and found.quantity == "pressure" else None
    return found


def split_unit(title: str) -> tuple[str, str]:
    """Split "Pressure [kPa]", "Druck in bar(g)" or "time_ms" into name and unit, "" where it has none."""
    text = " ".join(title.strip().strip('"').split())
    for close, opening in ((")", "("), ("]", "["), ("}", "{"), (">", "<")):
        if not text.endswith(close):
            continue
        depth = 0
        for at in range(len(text) - 1, -1, -1):
            depth += (text[at] == close) - (text[at] == opening)
            if depth == 0:
                name, unit = text[:at].strip(), text[at + 1 : -1].strip()
                gauge = unit.lower() in ("g", "gauge", "a", "abs", "absolute", "rel")  # "Pressure bar (g)"
                if name and gauge:
                    return _split_tail(name + f"({unit})")
                if name and not quantity_of(unit) and (inner := _split_tail(name))[1]:
                    return inner  # "Pressure, kPa (LGR S/N: 2034)"
                return (name, unit) if name else (text, "")
    inside = re.search(r"[(\[]([^()\[\]]+)[)\]]", text)
    if inside and quantity_of(inside[1]):  # "102 (kPa)- Pressure"
        return " ".join(f"{text[: inside.start()]}{text[inside.end() :]}".split()), inside[1]
    return text, ""


def unit_in_title(title: str) -> str:
    """Return the unit at the end of a title without brackets: "Druck in kPa", "time_ms", "p/bar"; "" for none."""
    tail = _split_tail(title)[1]
    if len(tail) == 1 and _SENSOR.match(" ".join(title.lower().split())):
        return ""  # "Sensor A" is no current
    return tail or _OWN_UNIT.get(title.strip().lower(), "")


def _split_tail(title: str) -> tuple[str, str]:
    text = title.strip()
    parts = re.split(r"[\s_,;]+|(?<=[a-z])/(?=[a-zA-Z])", text)
    for n in (2, 1):
        if len(parts) <= n:
            continue
        tail = text[text.rindex(parts[-n]) :]
        if known_unit(tail) or absolute_unit(tail):
            head = text[: -len(tail)].rstrip(" _,;/")
            return re.sub(r"\s+in$", "", head), tail
    return text, ""


def recognised(title: str, unit: str = "") -> str | None:
    """Return our name of a column by its title and unit; None where it is not recognised."""
    plain = " ".join(re.sub(r"[_,;]", " ", title.lower()).split())
    exact = plain.replace(" ", "_")
    if exact in PLAIN or exact in _QUANTITY or COUNTS.match(exact):
        return exact
    bare = " ".join(_split_tail(plain)[0].split()) if plain not in _OWN_UNIT else plain
    sensor = _SENSOR.match(plain) or _SENSOR.match(bare)
    if sensor:
        number = int(sensor[1]) if sensor[1].isdigit() else "abcdefgh".index(sensor[1]) + 1
        return f"s{number}_mv"
    words = bare.replace("-", " ").split()
    if len(words) > 1 and (others := set(words) - set(_WORDS["pressure_kpa"])) < set(words):
        if others & _WANTED:
            return "target_kpa"
        if others <= _MEASURED:
            return "pressure_kpa"
    for name in ("target_kpa", "time_s", "pressure_kpa", "elongation_mm"):
        if name == "time_s" and unit_for("time_s", unit) is None and (bare == "x" or _NO_TIME & set(words)):
            continue
        if bare in _WORDS[name] or (words and words[0] in _WORDS[name] and len(words[0]) > 1):
            return name
    return "s1_mv" if bare in _SIGNAL_WORDS else None


def guess_unit(name: str, values: FloatArray, title: str = "") -> str:
    """Return the unit that the title, or else the magnitude of the numbers suggests."""
    finite = values[np.isfinite(values)]
    if name == "time_s":
        return _OWN_UNIT.get(title.strip().lower(), "") or _unit_of_time(finite)
    if name == "elongation_mm":
        return "mm"
    if is_signal(name):
        return "V" if finite.size and np.abs(finite).max() <= 10 else "mV"
    largest = float(np.abs(finite).max()) if finite.size else 0.0
    return "kPa" if largest < 1000 else "Pa"


def _unit_of_time(values: FloatArray) -> str:
    steps = np.abs(np.diff(values))
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    first = float(values[0]) if values.size else 0.0
    for low, high, unit in _EPOCHS:
        if low <= first < high and step < 1e-5 * first:
            return unit
    days = any(low < first < high for low, high in (_EXCEL_DAYS, _MATLAB_DAYS))
    if days and step < 0.01:
        return "d"
    return "s" if step < 2 else "ms" if step < 1500 else "us" if step < 3e6 else "ns"
