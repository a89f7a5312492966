"""The table of faults: all 54, each with a test in CI, and the page as the tests say it."""

from __future__ import annotations

import pytest

from tests.faults.table import PAGE, faults, injections, page


def test_the_54_are_there_once() -> None:
    """Numbered 1 to 54, each with what happens and what must come of it."""
    assert [fault.number for fault in faults()] == list(range(1, 55))
    assert all(fault.happens and fault.demanded for fault in faults())


@pytest.mark.parametrize("number", range(1, 55))
def test_every_fault_has_a_test_that_injects_it(number: int) -> None:
    """At least one with every change, not only at night; each says how and how often."""
    marks = [mark for mark in injections() if mark.number == number]
    assert any(not mark.nightly for mark in marks)
    assert all(mark.how and mark.times > 0 for mark in marks)


def test_the_page_is_what_the_tests_say() -> None:
    """`make faults` was run after the last change of a mark."""
    assert PAGE.read_text(encoding="utf-8") == page()
