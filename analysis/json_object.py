"""Results as JSON objects: their fields and properties, arrays as lists, enumerations by value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from operator import attrgetter
from typing import Any

import numpy as np


def json_object(result: object, *keys: str) -> dict[str, Any]:
    """Return a result as JSON object with NaN; `keys` are "name" or "key=name.of.attribute", by default all fields."""
    if not keys:
        assert is_dataclass(result)
        keys = tuple(field.name for field in fields(result))
    named = ((key.partition("=")[0], attrgetter(key.rpartition("=")[2])) for key in keys)
    return {key: _plain(value(result)) for key, value in named}


def _plain(value: Any) -> Any:
    if hasattr(value, "as_json"):
        return value.as_json()
    if is_dataclass(value):
        return json_object(value)
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return str(value) if isinstance(value, Enum) else value
