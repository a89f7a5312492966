"""Read untrusted TOML: the standard library's reader with limits that it lacks.

`tomllib` needs memory quadratic in the parts of a dotted key (tens of gigabytes for 100 kB), raises a plain ValueError
for a number with too many digits, and accepts integers beyond 64 bits, which can become neither a float nor text.
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
    """Return the table in `text`. ValueError: not TOML, or beyond these limits; names the line where there is one."""
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
