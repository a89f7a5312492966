"""Intervals of figures against values worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from analysis import analyse
from analysis.figures.figure import Figure, Reason
from analysis.figures.intervals import (
    at_least,
    bootstrap_figure,
    combined_error,
    unsettled,
    with_full_scale,
    with_reach,
    with_shared_error,
)
from tests.analysis.boat_builder import Plant, Staircase


@pytest.mark.parametrize(
    ("unit", "value", "expected"),
    [
        ("dB", 40.0, (20 * math.log10(2), 20 * math.log10(1.5))),
        ("% FSO", 6.0, (2.0, 6.0)),  # of a full scale 1.5 times as large, and of one half as large
        ("% FSO", 3.5, (3.5 / 3.0, 3.5)),
        ("% FSO/100 cycles", -6.0, (6.0, 2.0)),
        ("% FSO/100 cycles", -0.6, (0.6, 0.2)),
        ("% FSO", 0.6, (0.2, 0.6)),
    ],
)
def test_interval_takes_in_that_of_the_full_scale(unit: str, value: float, expected: tuple[float, float]) -> None:
    """Full scale 100 (50 to 150): its part and the figure's own, 3 and 4, add in squares."""
    full_scale = Figure(100.0, "mV", 5, 50.0, 150.0)
    found = with_full_scale(Figure(value, unit, 5, value - 3.0, value + 4.0), full_scale)
    low = value - math.hypot(3.0, expected[0])
    assert found.low == pytest.approx(max(low, 0.0) if unit == "% FSO" else low)
    assert found.high == pytest.approx(value + math.hypot(4.0, expected[1]))
    same = Figure(value, "mV", 5, value - 3.0, value + 4.0)
    assert with_full_scale(same, full_scale) is same
    assert with_full_scale(Figure(value, unit, 5, value - 3.0, value + 4.0), Figure(1.0, "mV", 5, 0.5, 1.5)) == found
    unknown = Figure(value, unit, 5, value - 3.0, value + 4.0)
    assert with_full_scale(unknown, Figure(100.0, "mV", 5, 0.0, 150.0)) is unknown


def test_combined_error_by_hand() -> None:
    """3, 4 and 12 %: 13 %; an end of a part moves it by that part's share of the whole."""
    parts = [Figure(3.0, "% FSO", 9, 2.0, 5.0), Figure(4.0, "% FSO", 5, 3.0, 4.5), Figure(12.0, "% FSO", 7, 11.0, 12.2)]
    found = combined_error(parts)
    assert (found.value, found.n) == (13.0, 5)
    assert found.low == pytest.approx(13.0 - math.sqrt(3.0**2 + 4.0**2 + 12.0**2) / 13.0)
    assert found.high == pytest.approx(13.0 + math.sqrt(6.0**2 + 2.0**2 + 2.4**2) / 13.0)
    small = combined_error([replace(p, value=p.value / 100, low=p.low / 100, high=p.high / 100) for p in parts])
    assert (small.value, small.low, small.high) == pytest.approx((0.13, found.low / 100, found.high / 100))
    zero = Figure(0.0, "% FSO", 5, 0.0, 0.0)
    assert (combined_error([zero, zero]).low, combined_error([zero, zero]).high) == (0.0, 0.0)
    void = Figure.nothing("% FSO", Reason.FEW_CYCLES, "few")
    assert combined_error([*parts, void]).reason is Reason.FEW_CYCLES


def test_one_cycle_gives_no_interval() -> None:
    """A value with its reason, and two cycles with an interval, never below zero of what is never negative."""
    one = bootstrap_figure(5.0, np.full(9, 5.0), "mV", 1, "d")
    assert (one.value, one.reason, math.isnan(one.low)) == (5.0, Reason.ONE_CYCLE, True)
    two = bootstrap_figure(5.0, np.linspace(0.0, 10.0, 9), "mV", 2, "d")
    assert (two.reason, two.low) == (Reason.NONE, pytest.approx(0.0, abs=1e-6))
    assert bootstrap_figure(5.0, np.full(9, np.nan), "mV", 2, "d").reason is Reason.NONE
    assert bootstrap_figure(5.0, np.linspace(0.0, 10.0, 9), "mV/mm", 2, "d").low < 0.0


def test_an_interval_of_a_spread_does_not_go_below_zero() -> None:
    """Three cycles: the interval of a standard deviation, a width or a span starts at zero at least."""
    plan = Staircase(Plant(loop_mm=0.25), cycles=3)
    for sensor in analyse(plan.recording(), mcmc=False).sensors:
        for figure in sensor.figures.values():
            if figure.unit in ("mV", "% FSO"):
                assert not figure.low < 0


def test_independent_part_widens_an_interval_in_squares() -> None:
    """3 below and 4 above the value, a part of 4 and of 3: 5 on that side; nothing is known of a void interval."""
    figure = Figure(10.0, "mV", 5, 7.0, 14.0)
    assert with_reach(figure, 4.0).low == pytest.approx(5.0)
    assert with_reach(figure, 3.0).high == pytest.approx(15.0)
    assert with_reach(figure, 0.04).high == pytest.approx(10.0 + math.hypot(4.0, 0.04))
    assert with_reach(replace(figure, value=0.5, low=0.2, high=0.8), 4.0).low == 0.0
    for nothing in (0.0, -4.0):
        assert with_reach(figure, nothing) is figure
    for unknown in (replace(figure, low=math.nan), replace(figure, value=math.nan)):
        assert with_reach(unknown, 4.0) is unknown
    shared = with_shared_error(figure, 0.5)  # of the difference of two means, at 95 %
    assert shared.low == pytest.approx(10.0 - math.sqrt(3.0**2 + 1.96**2 * (0.5**2 + 0.5**2)))


def test_interval_reaches_at_least_so_far() -> None:
    """A reach moves an end that is nearer, and no span below zero."""
    figure = Figure(2.0, "mV", 5, 1.5, 5.0)
    assert (at_least(figure, 1.0).low, at_least(figure, 1.0).high) == (1.0, 5.0)
    assert (at_least(figure, 4.0).low, at_least(figure, 4.0).high) == (0.0, 6.0)
    assert at_least(replace(figure, unit="mV/mm"), 4.0).low == -2.0
    unknown = replace(figure, high=math.nan)
    assert at_least(unknown, 4.0) is unknown


def test_figure_of_holds_not_settled_holds_that_at_rest() -> None:
    """Both intervals in one, with a note and a reason, but not those that the figure has already."""
    figure, rest = Figure(5.0, "mV", 5, 4.0, 6.0), Figure(7.0, "mV", 5, 6.5, 7.5)
    found = unsettled(figure, rest, 3.0)
    assert (found.value, found.low, found.high, found.reason) == (5.0, 4.0, 7.5, Reason.NOT_SETTLED)
    assert found.note == "at 3 s: the holds are not settled"
    noted = unsettled(replace(figure, note="few", reason=Reason.FEW_CYCLES), rest, 3.0)
    assert (noted.note, noted.reason) == ("at 3 s: the holds are not settled; few", Reason.FEW_CYCLES)
    unknown = unsettled(figure, replace(rest, high=math.nan), 3.0)
    assert (unknown.low, unknown.high, unknown.reason) == (4.0, 6.0, Reason.NOT_SETTLED)
    for same in (replace(figure, unit="dB"), replace(figure, value=math.nan)):
        assert unsettled(same, rest, 3.0) is same
