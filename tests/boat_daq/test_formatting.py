"""Numbers, durations and quantities as text."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from boat_daq import formatting
from boat_daq.formatting import duration_text, power_text
from tests.boat_daq.viewmodels.helpers import finite


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (0.0, "0"),
        (0.001, "0.0010"),
        (0.00094, "9.4\u00b710\u207b\u2074"),
        (0.000999, "0.0010"),  # rounds up to the border
        (12.34, "12"),
        (99_999.0, "1.0\u00b710\u2075"),
        (3.1e-14, "3.1\u00b710\u207b\u00b9\u2074"),
    ],
)
def test_power_text_over_decades(value, words):
    """Plain where it is short, a power of ten where it is not."""
    assert power_text(value, 2) == words


def test_short_durations_have_their_unit():
    """Three digits and the unit that keeps them short; NaN is a dash."""
    found = [duration_text(t) for t in (1.5, 0.0123, 4.56e-6, 7e-9, math.nan)]
    assert found == ["1.5\u2009s", "12.3\u2009ms", "4.56\u2009\u00b5s", "7\u2009ns", "\u2013"]


@pytest.mark.parametrize(
    ("value", "decimals", "sign", "text"),
    [
        (1702.42, 1, False, "1\u2009702.4"), (-0.04, 1, True, "0.0"), (-30.0, 1, True, "\u221230.0"),
        (2.0, 2, True, "+2.00"), (math.nan, 1, False, "\u2013"), (None, 1, False, "\u2013"),
        (math.inf, 1, False, "\u2013"),
    ],
)  # fmt: skip
def test_number_has_decimals_sign_and_unknown(value, decimals, sign, text):
    """Fixed decimals, a real minus, no minus before zero, an en dash for what is not known."""
    assert formatting.number(value, decimals, sign=sign) == text


@given(finite, st.integers(0, 4))
def test_shown_number_can_be_typed(value, decimals):
    """A shown number, typed back, is the number to its decimals."""
    assert formatting.plain_number(formatting.number(value, decimals)) == pytest.approx(value, abs=0.51 * 10**-decimals)


@pytest.mark.parametrize("text", ["", "abc", "1..2", "nan", "inf", "1 2"])
def test_text_without_a_number_is_refused(text):
    """What is not one finite number raises."""
    with pytest.raises(ValueError):
        formatting.plain_number(text)


@pytest.mark.parametrize(("seconds", "text"), [(0, "0:00"), (192.4, "3:12"), (3792, "1:03:12"), (math.nan, "\u2013")])
def test_duration(seconds, text):
    """Minutes and seconds, hours where there are any."""
    assert formatting.duration(seconds) == text
