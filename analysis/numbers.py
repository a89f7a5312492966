"""Numbers as printed, with two significant digits of their uncertainty (GUM 7.2.6), and as JSON holds them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from decimal import ROUND_CEILING, Context, Decimal
from pathlib import Path
from typing import Any

import numpy as np

from protocol.base.units import MINUS, NOTHING, Shown

NUMBER = r"(?<![\w.])[-+\u2212]?\d+(?:\u2009\d{3})*(?:\.\d+)?(?![\w.]*\w)"  # thin spaces part thousands
_NUMBERS = re.compile(NUMBER)
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")


def neutral(text: str) -> str:
    """Return a text cell that no spreadsheet runs: a leading = + - @ TAB CR gets an apostrophe before it (OWASP)."""
    return f"'{text}" if text.startswith(FORMULA_STARTS) else text


def decimals_for(uncertainty: float) -> int:
    """Return the decimal places that show two significant digits of an uncertainty; negative before the point."""
    if not (math.isfinite(uncertainty) and uncertainty > 0):
        return 3
    # 0.0995 rounds to 0.10, not to 0.100: round first, then count
    return 1 - math.floor(math.log10(float(f"{uncertainty:.1e}")))


def rounded(value: float, uncertainty: float) -> str:
    """Return a value rounded to the place of two significant digits of its uncertainty."""
    if math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    places = decimals_for(uncertainty)
    return f"{round(value, places) + 0.0:.{max(places, 0)}f}"  # no -0.00


def rounded_up(value: float, digits: int = 2) -> float:
    """Return a value rounded up to `digits` significant ones, for an allowance; 0, NaN and infinities are unchanged."""
    if value == 0.0 or not math.isfinite(value):
        return value
    exact = Decimal(value)  # of the binary number: no product of floats rounds below it
    place = exact.adjusted() - digits + 1
    up = float(exact.quantize(Decimal(1).scaleb(place), rounding=ROUND_CEILING, context=Context(prec=digits + 1)))
    nearest = float(f"{value:.{digits - 1}e}")  # a value of so many digits, whose binary number is just above them
    return nearest if nearest >= value else up


def percent(share: float, places: int = 0) -> str:
    """Return "68 %"."""
    return f"{100.0 * share:.{places}f} %"


def with_uncertainty(value: float, uncertainty: float) -> str:
    """Return "1651.98 ± 0.15"; the value alone where there is no uncertainty."""
    if not math.isfinite(uncertainty) or not math.isfinite(value):
        return rounded(value, uncertainty)
    return f"{rounded(value, uncertainty)} ± {rounded(uncertainty, uncertainty)}"


def in_unit(text: str, shown: Shown) -> str:
    """Return a text with each of its numbers converted to another unit, to as many significant digits."""

    def one(found: re.Match[str]) -> str:
        number = re.sub(r"\s", "", found[0].replace(MINUS, "-"))
        places = shown.decimals(len(number.partition(".")[2]))
        sign = "+" if number.startswith("+") else ""
        converted = f"{shown.value(float(number)):{sign}.{places}f}"
        return converted.replace("-", MINUS) if MINUS in found[0] else converted

    return _NUMBERS.sub(one, text)


def finite(value: Any) -> Any:
    """Return `value` in JSON's own types: arrays as lists, NaN and infinities as None."""
    if is_dataclass(value) and not isinstance(value, type):
        return finite(asdict(value))
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [finite(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return finite(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value
