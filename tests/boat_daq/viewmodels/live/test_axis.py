"""Vertical ranges and time labels of a live plot."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from boat_daq.viewmodels.live import axis


@given(st.floats(-1e4, 1e4), st.floats(1e-3, 1e4))
def test_framed_range_holds_its_data_on_the_ladder(low, span):
    """The range holds the data, is not much larger, and its tick step is 1, 2 or 5 times a power of ten."""
    high = low + span
    bottom, top = axis.framed(low, high)
    assert bottom <= low
    assert top >= high
    assert top - bottom <= 3.5 * max(high - low, 1e-9) + 1e-9 * abs(low)
    step = axis.tick_step(top - bottom)
    assert round(step / 10 ** math.floor(math.log10(step) + 1e-9)) in (1, 2, 5, 10)


@given(st.floats(-1e4, 1e4), st.floats(1e-3, 1e4), st.floats(51.0, 400.0))
def test_an_axis_has_two_labels_where_they_fit(low, span, room_px):
    """A low plot had one label, 1700, and no scale: values could not be read."""
    high, end = low + span, span / room_px
    step = axis.finer_step(low, high, axis.tick_step(span, room_px), room_px)
    ticks = [n * step for n in range(math.ceil(low / step) - 1, math.floor(high / step) + 2)]
    assert len([tick for tick in ticks if low + end <= tick <= high - end]) >= 2
    assert step * room_px / span >= 9.99


@pytest.mark.parametrize(("value", "least"), [(0.0, 0.5), (1500.0, 100.0), (-3e-13, 0.5)])
def test_framed_range_of_a_constant_shows_no_rounding(value, least):
    """One value, or the rounding of one, is no range of 1e-9 with ticks of 4e-10."""
    low, high = axis.framed(value, value + 1e-13)
    assert low < value < high
    assert high - low >= least


def test_steady_range_grows_at_once_and_shrinks_late():
    """Data that leave the range widen it now; data that need less narrow it only after the patience."""
    steady = axis.SteadyRange(smallest=1.0, patience_s=1.5)
    first = steady.update(0.0, 10.0, 0.0)
    assert steady.update(2.0, 9.0, 0.1) == first
    wide = steady.update(0.0, 100.0, 0.2)
    assert wide[1] >= 100.0
    assert steady.update(0.0, 10.0, 1.0) == wide
    assert steady.update(0.0, 10.0, 2.0) == wide
    assert steady.update(0.0, 10.0, 2.6)[1] < 20.0


def test_steady_range_without_data_is_kept():
    """Without one finite value the range stays what it was, or begins somewhere sane."""
    steady = axis.SteadyRange(smallest=2.0)
    assert steady.update(math.nan, math.nan, 0.0) == (0.0, 2.0)
    kept = steady.update(-1.0, 1.0, 1.0)
    assert steady.update(math.nan, math.nan, 2.0) == kept
    assert axis.extremes(np.array([np.nan]), np.zeros(0)) == pytest.approx((math.nan, math.nan), nan_ok=True)


@pytest.mark.parametrize(
    ("time_s", "step", "text"), [(65, 5, "1:05"), (3780, 60, "1:03:00"), (2.4, 0.2, "2.4"), (-5, 5, "\u22120:05")]
)
def test_clock_labels(time_s, step, text):
    """Tick labels are clock times; below a second, decimals."""
    assert axis.clock(time_s, step, axis.clock_unit(time_s - 8 * step, time_s)) == text


def test_all_labels_of_an_axis_show_hours_or_none():
    """An axis that reaches an hour has hours on every label."""
    unit = axis.clock_unit(3000.0, 4000.0)
    assert [axis.clock(t, 300, unit) for t in (3300.0, 3600.0, -60.0)] == ["0:55:00", "1:00:00", "\u22120:01:00"]
