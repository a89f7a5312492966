"""An actuator's parameters from a TOML file: the names of `ActuatorParameters`, each optional.

Rule: an unknown name is rejected, with the nearest known one; no default replaces a misspelt name.
"""

from __future__ import annotations

import difflib
import tomllib
from dataclasses import fields
from pathlib import Path

from analysis.errors import FileError, RequestError
from analysis.shadow.fem.parameters import ActuatorParameters

MAX_BYTES = 10_000  # some thirty values; `tomllib` takes memory with the square of a long key's length


def read_parameters(path: Path) -> ActuatorParameters:
    """Read the parameters of an actuator.

    Raises
    ------
    FileError
        If the file cannot be read as TOML.
    RequestError
        If a name is unknown or a value impossible.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise FileError(f"{path} is larger than {MAX_BYTES // 1000} kB", "choose the file with the parameters")
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileError(f"{path} cannot be read: {error.strerror}", "check the name") from error
    except (ValueError, RecursionError) as error:  # no UTF-8, no TOML, a number of too many digits
        raise FileError(f"{path} is not a TOML file: {error}", "write lines like wall_mm = 2.2") from error
    known = {f.name: f.type for f in fields(ActuatorParameters)}
    for name in values:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            raise RequestError(
                f"{path.name} has '{name:.60}', which is not a parameter of the actuator",
                f"did you mean {near[0]}?" if near else f"known are {', '.join(known)}",
            )
    return ActuatorParameters(**values)
