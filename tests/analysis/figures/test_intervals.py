"""Intervals of figures against values worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from analysis import analyse
from analysis.figures.figure import Figure, Reason
from analysis.figures.intervals import bootstrap_figure, combined_error, with_full_scale
from analysis.segmentation.loops import LoopWidth
from tests.analysis.boat_builder import Plant, Staircase


def width(mean: float = 5.0, shared: float = 1.0, void: str = "") -> LoopWidth:
    """Return a loop of 5 mV with replicates from 4.5 to 5.5."""
    flat = np.zeros(3)
    return LoopWidth(np.full(3, mean), mean, np.linspace(0.9 * mean, 1.1 * mean, 201), flat, flat, flat, void, shared)


@pytest.mark.parametrize(
    ("unit", "value", "expected"),
    [
        ("dB", 40.0, (20 * math.log10(2), 20 * math.log10(1.5))),
        ("% FSO", 6.0, (2.0, 6.0)),  # of a full scale 1.5 times as large, and of one half as large
        ("% FSO", 3.5, (3.5 / 3.0, 3.5)),
        ("% FSO/100 cycles", -6.0, (6.0, 2.0)),
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
    assert bootstrap_figure(5.0, np.linspace(0.0, 10.0, 9), "mV/mm", 2, "d").low < 0.0


def test_an_interval_of_a_spread_does_not_go_below_zero() -> None:
    """Three cycles: the interval of a standard deviation, a width or a span starts at zero at least."""
    plan = Staircase(Plant(loop_mm=0.25), cycles=3)
    for sensor in analyse(plan.recording(), mcmc=False).sensors:
        for figure in sensor.figures.values():
            if figure.unit in ("mV", "% FSO"):
                assert not figure.low < 0
