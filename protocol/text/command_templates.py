"""Command templates of a text profile: a value in, a line out.

A template is text with fields such as `{kpa:.1f}`. Rules of this file:

- A field is one of the names listed for its command and an optional number format. Attributes, indices, conversions
  and nested fields are refused: a profile is untrusted input.
- A template is rendered once when it is loaded, so that a faulty one is found before a session and not during it.
"""

from __future__ import annotations

import re
import string
from collections.abc import Callable

from protocol.errors import ProfileError
from protocol.link.messages import ClearFault, Command, Heartbeat, Identify, SetLimits, SetPressure, Start, Stop, Vent

PA_PER_UNIT = {"pa": 1.0, "hpa": 100.0, "mbar": 100.0, "kpa": 1e3, "bar": 1e5, "psi": 6894.757293168}

Values = dict[str, float | int]
Template = Callable[[Command], bytes]

_FORMAT = re.compile(r"0?\d{0,2}(\.\d{1,2})?[dfgeXx]?")
_TEMPLATE_MAX = 200  # characters


def _pressures(prefix: str, pascal: int) -> Values:
    return {prefix + unit: pascal / factor if factor != 1 else pascal for unit, factor in PA_PER_UNIT.items()}


def _ramps(pascal_per_s: int) -> Values:
    return {f"ramp_{name}_per_s": value for name, value in _pressures("", pascal_per_s).items()}


def _values(command: Command) -> Values:
    """Return the values of the fields of a command's template."""
    match command:
        case SetPressure():
            return {**_pressures("", command.target_pa), **_ramps(command.ramp_pa_per_s)}
        case SetLimits():
            return {**_pressures("min_", command.min_pa), **_pressures("max_", command.max_pa)}
        case Start():
            return {"rate_hz": command.rate_hz, "period_ms": 1000 / max(command.rate_hz, 1)}
        case Heartbeat():
            return {"timeout_ms": command.timeout_ms}
    return {}


COMMANDS: dict[str, Command] = {  # key of the profile -> an example of its command
    "identify": Identify(),
    "start": Start(100),
    "stop": Stop(),
    "set_pressure": SetPressure(-40_000, 10_000),
    "vent": Vent(),
    "heartbeat": Heartbeat(1000),
    "clear_fault": ClearFault(),
    "set_limits": SetLimits(-50_000, 60_000),
}


def compile_template(key: str, text: str) -> Template:
    """Return the function that renders a command's template.

    Parameters
    ----------
    key : of the profile, one of `COMMANDS`.
    text : the template.

    Raises
    ------
    ProfileError : a field or format that is not allowed; names the key.
    """
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
        fields = [
            (name, spec, conversion) for _, name, spec, conversion in string.Formatter().parse(text) if name is not None
        ]
    except ValueError as error:
        raise ProfileError(f"commands.{key}: {error}", "write {{ and }} for literal braces") from None
    for name, spec, conversion in fields:
        if name not in values:
            allowed = ", ".join(values) or "no fields"
            raise ProfileError(f"commands.{key} names the unknown field {{{name}}}", f"allowed here: {allowed}")
        if conversion or not _FORMAT.fullmatch(spec or ""):
            raise ProfileError(f"commands.{key}: {{{name}}} has an unusable format", "use one such as {kpa:.1f}")
