"""Read untrusted TOML: the standard library's reader with the bounds that it lacks.

`tomllib` needs memory in proportion to the square of a dotted key's parts (tens of gigabytes for a key of 100 kB),
raises a plain ValueError for a number of more digits than Python converts, and accepts integers beyond the 64 bits of
TOML, which later can neither become a float nor be printed.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from typing import Any

KEY_PARTS_MAX = 50
_PART = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""
_LONG_KEY = re.compile(rf"""(?<![\w"'-])(?:{_PART}){{{KEY_PARTS_MAX}}}""")


def read_toml(text: str) -> dict[str, Any]:
    """Return the table in `text`.

    Raises
    ------
    ValueError : not TOML, or beyond these bounds; names the line where there is one.
    """
    if found := _LONG_KEY.search(text):
        line = text.count("\n", 0, found.start()) + 1
        raise ValueError(f"a key of more than {KEY_PARTS_MAX} parts (at line {line})")
    try:
        table = tomllib.loads(text)
    except RecursionError:
        raise ValueError("its tables are nested too deeply") from None
    if not all(-(2**63) <= number < 2**63 for number in _integers(table)):
        raise ValueError("a whole number of more than 64 bits")
    return table


def _integers(value: object) -> Iterator[int]:
    """Yield every integer in a table."""
    match value:
        case int():
            yield value
        case dict():
            for entry in value.values():
                yield from _integers(entry)
        case list():
            for entry in value:
                yield from _integers(entry)
