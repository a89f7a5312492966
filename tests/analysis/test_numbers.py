"""Numbers as printed: two digits of their uncertainty, a dash where there is none."""

from __future__ import annotations

import pytest

from analysis.numbers import rounded, with_uncertainty


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
