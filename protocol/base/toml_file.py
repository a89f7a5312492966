"""Read untrusted TOML, and small files of named values such as an actuator's parameters.

`tomllib` needs memory quadratic in the parts of a dotted key (tens of gigabytes for 100 kB), raises a plain ValueError
for a number with too many digits, and accepts integers beyond 64 bits, which can become neither a float nor text.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from protocol.base.errors import FileError, RequestError
from protocol.base.regular_file import read_regular

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


_MAX_BYTES = 10_000  # some thirty values


def read_values(path: Path, known: Collection[str], *, of: str, example: str) -> dict[str, Any]:
    """Return the values of a TOML file by name; `of` and `example` are for messages. RequestError: unknown name."""
    choose = f"choose the file with the values of {of}"
    try:
        values = read_toml(read_regular(path, _MAX_BYTES).decode("utf-8-sig"))
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}", choose) from error
    except ValueError as error:  # no UTF-8, no TOML
        raise FileError(f"{path} is not a TOML file: {error}", f"write lines like {example}") from error
    for name in values:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            remedy = f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}"
            raise RequestError(f"{path.name} has '{name:.60}', which is not a parameter of {of}", remedy)
    return values
