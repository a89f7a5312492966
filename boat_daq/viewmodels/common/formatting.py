"""How a number becomes words: fixed decimals, a real minus sign, the lab's units.

Rules: a measured value keeps its number of decimals so that it stands still; what is not known is an en dash, never 0.
"""

from __future__ import annotations

import math

MINUS = "\u2212"
NOTHING = "\u2013"
THIN = "\u2009"  # between thousands and before units


def number(value: float | None, decimals: int, *, sign: bool = False) -> str:
    """Return `value` with `decimals`, thousands parted; an en dash where it is unknown or not finite."""
    if value is None or not math.isfinite(value):
        return NOTHING
    rounded = round(value, decimals) + 0.0  # no minus before a rounded zero
    text = f"{abs(rounded):,.{decimals}f}".replace(",", THIN)
    if rounded < 0:
        return MINUS + text
    return f"+{text}" if sign and rounded > 0 else text


def pressure(kpa: float | None) -> str:
    """Return a pressure with its unit, signed, e.g. `+30.0 kPa`."""
    return f"{number(kpa, 1, sign=True)} kPa"


def target(kpa: float) -> str:
    """Return a plan's pressure, e.g. `+30 kPa` or `+2.5 kPa`."""
    return f"{number(kpa, 0 if float(kpa).is_integer() else 1, sign=True)} kPa"


def duration(seconds: float | None) -> str:
    """Return a duration as `3:12` or `1:03:12`."""
    if seconds is None or not math.isfinite(seconds):
        return NOTHING
    whole = max(0, round(seconds))
    hours, rest = divmod(whole, 3600)
    minutes, left = divmod(rest, 60)
    return f"{hours}:{minutes:02d}:{left:02d}" if hours else f"{minutes}:{left:02d}"


def span(seconds: float) -> str:
    """Return a window's length in words, e.g. `10 s`, `2 min`, `1 h`."""
    if seconds < 60:
        return f"{seconds:g} s"
    if seconds < 3600:
        return f"{seconds / 60:g} min"
    return f"{seconds / 3600:g} h"


def count(n: int, singular: str, plural: str = "") -> str:
    """Return `1 sample`, `2 samples`, `1 204 samples`."""
    return f"{number(n, 0)} {singular if n == 1 else plural or singular + 's'}"


def plain_number(text: str) -> float:
    """Return the number a person typed: comma or point, a typographic minus, spaces around.

    Raises
    ------
    ValueError : it is not one finite number.
    """
    cleaned = (
        text.strip().replace(MINUS, "-").replace("\u2013", "-").replace(",", ".").replace(THIN, "").removesuffix("mm")
    )
    value = float(cleaned)
    if not math.isfinite(value):
        raise ValueError(text)
    return value
