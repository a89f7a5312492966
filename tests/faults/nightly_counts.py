"""Parameters of tests that inject a fault a few times with every change and many times at night."""

from __future__ import annotations

from typing import Any

import pytest


def few_and_many(fault: int, how: str, few: int, many: int, *, timeout_s: int = 1800) -> list[Any]:
    """Return the parameters `few` (CI) and `many` (nightly), each marked as so many injections of `fault`.

    `table.py` reads its call from the source: all arguments are literals.
    """
    at_night = (pytest.mark.nightly, pytest.mark.timeout(timeout_s))
    return [
        pytest.param(few, marks=pytest.mark.fault(fault, how=how, times=few)),
        pytest.param(many, marks=[*at_night, pytest.mark.fault(fault, how=how, times=many)]),
    ]
