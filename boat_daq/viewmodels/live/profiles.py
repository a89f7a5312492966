"""A profile from pasted text: TOML, the path of one, or the RX8 line of a Bridge Control Panel.

An RX8 line names its variables but not their meaning. As in the profile that is shipped, S1, S2 .. are signals in
counts, T is milliseconds, P is hundredths of a kPa with a sign, I is the index; every other variable is skipped. Other
units need a profile in TOML.
"""

from __future__ import annotations

import re

from boat_daq.errors import OperatorError
from protocol.text.rx8 import parse_format

_SENSOR = re.compile(r"(?:s|sensor|ch)_?([1-4])(?:_?(signal|lit|dark|on|off))?", re.IGNORECASE)
_PARTS = {None: "signal", "signal": "signal", "lit": "lit", "on": "lit", "dark": "dark", "off": "dark"}
_OTHERS = (
    (re.compile(r"p|press(?:ure)?", re.IGNORECASE), '{ name = "pressure", unit = "kPa", scale = 0.01, signed = true }'),
    (re.compile(r"t|time|tick", re.IGNORECASE), '{ name = "time", unit = "ms" }'),
    (re.compile(r"i|index|count(?:er)?", re.IGNORECASE), '"index"'),
)


def profile_text(pasted: str) -> str:
    """Return the profile for the session: an RX8 line as TOML, any other text unchanged.

    Raises
    ------
    ProfileError : the RX8 line is invalid.
    OperatorError : it names no sensor, or no pressure.
    """
    line = pasted.strip()
    if not line.lower().startswith("rx8"):
        return line
    variables = [name for name, _ in parse_format(line).variables]
    entries = {name: entry for name in variables if (entry := meaning(name))}
    sensors = {match[1] for name in variables if (match := _SENSOR.fullmatch(name))}
    if not sensors:
        raise OperatorError(
            f"the RX8 line has no sensor: {', '.join(variables)}", "Name the signals S1 and S2 in the RX8 line."
        )
    if not any('"pressure"' in entry for entry in entries.values()):
        raise OperatorError(
            "the RX8 line has no pressure, which every recording needs",
            "Name its bytes P, such as @1P @0P: hundredths of a kPa, with a sign. Other units: a profile in TOML.",
        )
    rows = "\n".join(f"{name} = {entry}" for name, entry in entries.items())
    return f"""name = "Pasted RX8 line"
kind = "rx8"

[device]
n_sensors = {len(sensors)}
rate_hz = 100
vref_mv = 3300
adc_bits = 12
polarity = -1

[rx8]
format = "{line}"

[rx8.variables]
{rows}
"""


def meaning(variable: str) -> str:
    """Return the TOML entry of a variable by its name; empty for an unknown one."""
    match = _SENSOR.fullmatch(variable)
    if match is not None:
        part = _PARTS[match[2].lower() if match[2] else None]
        return f'{{ name = "s{match[1]}_{part}", unit = "counts" }}' if part == "signal" else f'"s{match[1]}_{part}"'
    return next((entry for pattern, entry in _OTHERS if pattern.fullmatch(variable)), "")
