"""The table of faults: all 54, each with a test in CI."""

from __future__ import annotations

import pytest

from tests.faults.table import faults, injections, page


def test_54_faults_are_listed_once() -> None:
    """Numbered 1 to 54, each with a fault and the required outcome."""
    assert [fault.number for fault in faults()] == list(range(1, 55))
    assert all(fault.happens and fault.demanded for fault in faults())


@pytest.mark.parametrize("number", range(1, 55))
def test_every_fault_has_a_test_that_injects_it(number: int) -> None:
    """At least one with every change, not only at night; each states how and how many times."""
    marks = [mark for mark in injections() if mark.number == number]
    assert any(not mark.nightly for mark in marks)
    assert all(mark.how and mark.times > 0 for mark in marks)


def test_page_lists_every_fault_and_every_injection() -> None:
    lines = page().splitlines()
    assert len([line for line in lines if line.startswith("**")]) == len(faults())
    assert len([line for line in lines if line.endswith(("| CI |", "| nightly |"))]) == len(injections())
