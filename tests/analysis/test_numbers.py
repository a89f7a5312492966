"""Numbers as printed: two digits of their uncertainty, a dash where there is none."""

from __future__ import annotations

import math

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


@pytest.mark.parametrize(
    ("value", "digits", "up"),
    [(6.31e-6, 2, 6.4e-6), (0.0032, 2, 0.0032), (0.0996, 2, 0.1), (123.4, 2, 130.0), (1.2001, 3, 1.21),
     (-1.29, 2, -1.2), (2.0, 1, 2.0), (0.0, 2, 0.0), (math.inf, 2, math.inf)],
)  # fmt: skip
def test_an_allowance_is_rounded_up(value: float, digits: int, up: float) -> None:
    """To significant digits, never below the value; a value of so many digits stays."""
    assert rounded_up(value, digits) == up


@given(value=st.floats(min_value=0.0, max_value=1e300), digits=st.integers(2, 6))
def test_a_value_rounded_up_is_near_and_not_below(value: float, digits: int) -> None:
    """Within 10 % above it; printed with as many digits and read again it is the same, and rounded up it stays."""
    found = rounded_up(value, digits)
    assert value <= found <= value * 1.1 + 5e-324
    assert rounded_up(found, digits) == found
    if value >= 1e-300:
        assert float(f"{found:.{digits}g}") == found
