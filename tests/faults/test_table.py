"""The table of faults: each has a test in CI."""

from __future__ import annotations

import pytest

from tests.faults.table import faults, injections, page


def test_faults_are_listed_once() -> None:
    """In the order of their numbers, each with a fault and the required outcome."""
    numbers = [fault.number for fault in faults()]
    assert numbers == sorted(set(numbers)) and len(numbers) >= 54
    assert all(fault.happens and fault.demanded for fault in faults())


@pytest.mark.parametrize("number", [fault.number for fault in faults()])
def test_every_fault_has_a_test_that_injects_it(number: int) -> None:
    """At least one with every change, not only at night; each states how and how many times."""
    marks = [mark for mark in injections() if mark.number == number]
    assert any(not mark.nightly for mark in marks)
    assert all(mark.how and mark.times > 0 for mark in marks)


def test_page_lists_every_fault_and_every_injection() -> None:
    lines = page().splitlines()
    assert len([line for line in lines if line.startswith("**")]) == len(faults())
    assert len([line for line in lines if line.endswith(("| CI |", "| nightly |"))]) == len(injections())
