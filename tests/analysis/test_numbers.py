"""Numbers as printed: two digits of their uncertainty, a dash where there is none."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.numbers import rounded, rounded_up, with_uncertainty


@pytest.mark.parametrize(
    ("value", "u", "text"),
    [(1651.9842, 0.15, "1651.98 ± 0.15"), (0.012345, 0.00067, "0.01235 ± 0.00067"), (12345.6, 250.0, "12350 ± 250"),
     (1.0, 0.0995, "1.00 ± 0.10")],
)  # fmt: skip
def test_numbers_carry_the_digits_their_uncertainty_warrants(value: float, u: float, text: str) -> None:
    """Two significant digits of the uncertainty (GUM 7.2.6)."""
    assert with_uncertainty(value, u) == text


def test_a_void_number_is_a_dash() -> None:
    """NaN prints a dash, infinity its sign."""
    assert rounded(float("nan"), 1.0) == "–"
    assert rounded(float("inf"), 1.0) == "∞"


@given(st.floats(1e-9, 1e9))
def test_a_number_rounded_up_is_no_smaller(value: float) -> None:
    """It has two significant digits, and is less than one of the second above."""
    found = rounded_up(value)
    assert value <= found <= 1.1 * value * (1 + 1e-12)
    assert float(f"{found:.2g}") == found


def test_what_has_two_digits_is_not_rounded() -> None:
    """Nor is what is no positive number."""
    assert [rounded_up(each) for each in (0.0027, 6.3e-6, 120.0, 0.0)] == [0.0027, 6.3e-6, 120.0, 0.0]
    assert rounded_up(0.00271) == 0.0028
