"""Read a small TOML file of named values, such as an actuator's parameters; an unknown name is refused."""

from __future__ import annotations

import difflib
from collections.abc import Collection
from pathlib import Path
from typing import Any

from protocol.base.errors import FileError, RequestError
from protocol.base.regular_file import read_regular
from protocol.base.toml_text import read_toml

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
