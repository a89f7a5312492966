"""Results as JSON objects."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field

import numpy as np

from analysis.json_object import json_object


class Verdict(enum.Enum):
    """A verdict."""

    GOOD = "good"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True)
class Inner:
    """A part."""

    value: float


@dataclass(frozen=True)
class Result:
    """A result with every kind of field."""

    verdict: Verdict = Verdict.GOOD
    array: np.ndarray = field(default_factory=lambda: np.arange(3.0))
    count: np.int64 = field(default_factory=lambda: np.int64(4))
    parts: tuple[Inner, ...] = (Inner(1.0),)
    table: dict[str, Inner] = field(default_factory=lambda: {"a": Inner(2.0)})

    @property
    def twice(self) -> float:
        """A property."""
        return 2.0 * self.parts[0].value


def test_fields_become_json_types() -> None:
    """Arrays, tuples and nested results become lists and objects; an enumeration its text."""
    expected = {"verdict": "good", "array": [0.0, 1.0, 2.0], "count": 4, "parts": [{"value": 1.0}]}
    found = json_object(Result())
    assert found == expected | {"table": {"a": {"value": 2.0}}}
    assert type(found["count"]) is int


def test_chosen_attributes_are_renamed_and_ordered() -> None:
    """Properties and attributes of attributes count; the keys are in the order given."""
    found = json_object(Result(), "twice", "first=table", "name=verdict.name")
    assert list(found.items()) == [("twice", 2.0), ("first", {"a": {"value": 2.0}}), ("name", "GOOD")]


def test_nan_is_left_for_the_writer() -> None:
    """So that a caller can still compute with the object."""
    assert math.isnan(json_object(Inner(math.nan))["value"])
