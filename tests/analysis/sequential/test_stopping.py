"""When a calibration run has enough cycles."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from analysis.atlas.runs import Stairs, analysed
from analysis.errors import RequestError
from analysis.figures.pipeline import Analysis
from analysis.sequential.stopping import (
    DRIFT,
    FEWEST_REPEATS,
    SPREAD,
    Enough,
    check_asked,
    enough,
    enough_repeats,
    more_cycles,
)


@pytest.fixture(scope="module")
def run() -> Analysis:
    """Return two cycles of a staircase with exact readings, analysed."""
    return analysed(Stairs(cycles=2, rate_hz=30.0, dwell_s=1.0))


def test_a_run_ends_at_its_u(run: Analysis) -> None:
    """U above the asked one ends nothing; below it ends the run. One sensor alone has the U of its budget."""
    assert run.budgets is not None
    u_mm = enough(run, 1.0).u_mm
    assert u_mm == pytest.approx(run.budgets.budgets[0].expanded, rel=0.02)
    assert enough(run, 1.01 * u_mm).reached
    assert not enough(run, 0.5 * u_mm).reached
    assert "at best" in enough(run, 0.5 * u_mm).text


def test_further_cycles_follow_from_what_falls_with_them() -> None:
    """A part of 0.2 mm that falls as the root of the cycles beside 0.1 mm that stays; never before the second cycle."""
    u_mm = math.hypot(0.2, 0.1)
    assert more_cycles(u_mm, 0.04, 2, 0.15) == math.ceil(0.04 * 2 / (0.15**2 - 0.01)) - 2
    assert more_cycles(u_mm, 0.04, 2, 0.099) is None
    assert more_cycles(u_mm, 0.04, 2, 0.23) == 0
    assert more_cycles(u_mm, 0.04, 1, 0.23) == 1
    assert "3 cycles more" in Enough(2, 0.2, 0.1, 0.05, 3).text


def test_the_next_reading_is_at_an_end_of_the_range(run: Analysis) -> None:
    """A cubic is known least at the ends of its range (G-optimality)."""
    found = enough(run, 0.05).next_kpa
    assert min(abs(found - end) for end in run.loops.level_kpa[[0, -1]]) < 1e-6


def test_a_run_without_readings_says_why_u_is_unknown() -> None:
    """Without elongations there is no calibration, and no end to the run."""
    found = enough(analysed(Stairs(cycles=2, rate_hz=30.0, dwell_s=1.0), readings=False), 0.1)
    assert not found.reached
    assert np.isnan(found.u_mm)
    assert "not known" in found.text
    assert not Enough(2, 0.1, 0.2, 0.1, None).as_json()["reached"]


def with_intervals(run: Analysis, drift: float, spread: float, void: str = "") -> Analysis:
    """Return the run with other half widths of the intervals of drift and repeatability."""
    sensor = run.sensors[0]
    figures = dict(sensor.figures)
    for name, half in ((DRIFT, drift), (SPREAD, spread)):
        figures[name] = replace(figures[name], low=1.0 - half, high=1.0 + half, void=void)
    return replace(run, sensors=(replace(sensor, figures=figures),))


def test_a_repeatability_run_ends_when_drift_and_spread_are_known(run: Analysis) -> None:
    """Never before ten cycles; the drift's interval falls faster with the cycles than that of the repeatability."""
    assert enough_repeats(with_intervals(run, 0.05, 0.05), 0.1).more_cycles == FEWEST_REPEATS - 2
    assert enough_repeats(with_intervals(run, 6.39, 0.1), 0.1).more_cycles == 2 * 16 - 2
    wide = enough_repeats(with_intervals(run, 0.1, 0.2999), 0.1)
    assert wide.more_cycles == 2 * 9 - 2
    assert "16 cycles more" in wide.text
    assert not wide.reached
    unknown = enough_repeats(with_intervals(run, 0.1, 0.1, "one cycle only"), 0.1)
    assert "one cycle only" in unknown.text
    assert not unknown.as_json()["reached"]


@pytest.mark.parametrize("asked_mm", [0.0, -1.0, math.nan, math.inf])
def test_an_impossible_uncertainty_is_refused(asked_mm: float) -> None:
    """Only a length above 0 can be asked for."""
    with pytest.raises(RequestError):
        check_asked(asked_mm, "mm")
