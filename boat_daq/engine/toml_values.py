"""Values from the tables of a TOML file, refused by key.

An unknown key, a missing one, a wrong type or a number that is not finite is an error that names its key; no default
silently takes its place.
"""

from __future__ import annotations

import dataclasses
import json
import math
from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

from protocol.base.errors import RequestError
from protocol.base.regular_file import read_regular
from protocol.base.toml_file import read_toml
from protocol.base.units import UnitText

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

T = TypeVar("T")

TOML_MAX_BYTES = 1_000_000  # a plan or a settings file has a few kilobytes


class BadValue(RequestError):
    """A value that its key cannot have."""

    def __init__(self, where: str, key: str, why: str, remedy: str = "") -> None:
        super().__init__(UnitText(f"{where}: '{key:.60}' ", why), remedy)
        self.key, self.why = key, why


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Return the table in `text`. RequestError: not TOML; names the line."""
    try:
        return read_toml(text)
    except ValueError as error:
        raise RequestError(f"{where} is not a readable TOML file: {error}", "correct that line") from error


def read_text(path: Path, most_bytes: int = TOML_MAX_BYTES) -> str:
    """Return a small text file's content, in bounded memory."""
    try:
        return read_regular(path, most_bytes).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except OSError as error:
        raise RequestError(f"{path} cannot be read: {error.strerror}", "check the path and its permissions") from error
    except UnicodeDecodeError as error:
        raise RequestError(f"{path} is not a text file in UTF-8", "save it as UTF-8") from error


def read_json(path: Path, most_bytes: int = TOML_MAX_BYTES) -> Any:
    """Return the content of a JSON file, in bounded memory."""
    try:
        return json.loads(read_text(path, most_bytes))
    except (ValueError, RecursionError) as error:
        raise RequestError(f"{path.name} is not a JSON file", "choose the right file") from error


def _plain(value: Any, kind: type, where: str, key: str) -> Any:
    """Return `value` as `kind`; an integer is accepted for a float."""
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not kind:
        raise BadValue(where, key, f"must be of type {kind.__name__}, not {type(value).__name__} ({value!r:.40})")
    if isinstance(value, float) and not math.isfinite(value):
        raise BadValue(where, key, f"must be a finite number, not {value}")
    return value


def build(cls: type[T], table: Mapping[str, Any], where: str, **converted: Any) -> T:
    """Return a dataclass filled from a table."""
    fields = {f.name: f for f in dataclasses.fields(cls) if f.name not in converted}  # type: ignore[arg-type]
    kinds = get_type_hints(cls)
    for key in table:
        if key not in fields:
            raise BadValue(where, key, "is not a known key", "known are " + ", ".join(fields))
    for name, field in fields.items():
        if name not in table and field.default is dataclasses.MISSING:
            raise BadValue(where, name, "is missing")
    return cls(**{key: _plain(value, kinds[key], where, key) for key, value in table.items()}, **converted)
