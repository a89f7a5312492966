"""When a run knows enough, and what its next cycle holds."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from analysis.figures.pipeline import Analysis
from analysis.segmentation.cycle_effect import CycleEffect
from analysis.stopping.criterion import (
    DRIFT,
    FEWEST_REPEATS,
    HELD_SHARE,
    SPREAD,
    StopAssessment,
    StopCriterion,
    assess_calibration,
    assess_repeats,
    held_plateaus,
    u_at_most,
)
from analysis.stopping.requirement import check_asked
from analysis.studies.failure_maps.figures import Stairs, analysed
from protocol.base.errors import RequestError


@pytest.fixture(scope="module")
def run() -> Analysis:
    """Return two cycles of a staircase with exact readings, analysed."""
    return analysed(Stairs(cycles=2, rate_hz=30.0, dwell_s=1.0))


def of_u(now: float, asked: float, least: float) -> StopAssessment:
    """Return what two of five cycles know of U."""
    return StopAssessment(2, 5, 2, (StopCriterion("U ", "mm", now, asked, least),))


def test_a_run_ends_at_its_u(run: Analysis) -> None:
    """U above the asked one ends nothing; below it ends the run. One sensor alone has the U of its budget."""
    assert run.budgets is not None
    u_mm = assess_calibration(run, 1.0, 5).criteria[0].now
    assert run.budgets.budgets[0].expanded < u_mm < 1.2 * run.budgets.budgets[0].expanded
    assert assess_calibration(run, 1.01 * u_mm, 5).reached
    assert not assess_calibration(run, 0.5 * u_mm, 5).reached


def test_further_cycles_follow_from_what_falls_with_them() -> None:
    """A part of 0.2 mm that falls as the root of the cycles beside 0.1 mm that stays."""
    u_mm = math.hypot(0.2, 0.1)
    criterion = StopCriterion("U ", "mm", u_mm, 0.15, 0.1)
    more = criterion.more_cycles(2)
    assert more == math.ceil(0.04 * 2 / (0.15**2 - 0.01)) - 2
    assert criterion.after(2, 0) == pytest.approx(u_mm)
    assert criterion.after(2, more) <= 0.15 < criterion.after(2, more - 1)
    assert criterion.after(2, 10**9) == pytest.approx(0.1)
    assert replace(criterion, asked=0.099).more_cycles(2) is None
    assert replace(criterion, asked=0.23).more_cycles(2) == 0
    assert replace(of_u(0.2, 0.23, 0.1), cycles=1).more_cycles == 1


@pytest.mark.parametrize(
    ("assessment", "end"),
    [
        (of_u(0.0784, 0.08, 0.05), "U 0.078 mm after 2 cycles, 0.08 mm asked: reached"),
        (of_u(0.1, 0.08, 0.05), "0.08 mm asked: 2 cycles more"),
        (replace(of_u(0.1, 0.08, 0.05), hold=(("loading", 50.0),) * 4), "2 cycles more, 4 plateaus each"),
        (of_u(0.1, 0.06, 0.05), "12 cycles more, the 5 cycles of the plan lead to U 0.074 mm"),
        (of_u(0.1, 0.05, 0.06), "not reached, the 5 cycles of the plan lead to U 0.078 mm"),
        (replace(of_u(0.22, 0.5, 0.1), cycles=1), "after 1 cycle, 0.5 mm asked: 1 cycle more, 2 cycles at least"),
        (replace(of_u(0.22, 0.5, 0.1), cycles=1, planned=1), "1 cycle more, 2 cycles at least"),
        (replace(of_u(0.2, 0.1, 0.0), cycles=1, planned=1), "3 cycles more, the 1 cycle of the plan leads to U 0.2 mm"),
        (of_u(0.0804, 0.08, 0.05), "U 0.0804 mm after 2 cycles, 0.08 mm asked: 1 cycle more"),
        (replace(of_u(0.1, 0.05, 0.06), criteria=(), void="no plateau"), "not known after 2 cycles: no plateau"),
    ],
)
def test_what_is_still_to_do_is_stated(assessment: StopAssessment, end: str) -> None:
    """Cycles and plateaus that are still needed; beyond the plan, the best that its cycles lead to."""
    assert assessment.text.endswith(end)
    assert assessment.as_json()["reached"] is ("reached" in end and "not" not in end)


@pytest.mark.parametrize(
    ("assessment", "end"),
    [
        (of_u(0.0784, 0.08, 0.05), "ended after cycle 2: U 0.078 mm of 0.08 mm asked"),
        (replace(of_u(0.0784, 0.08, 0.05), planned=2), "U 0.078 mm of 0.08 mm asked after all 2 cycles: reached"),
        (
            replace(of_u(0.1, 0.08, 0.05), planned=2),
            "U 0.1 mm of 0.08 mm asked after all 2 cycles: not reached, about 2 more cycles needed",
        ),
        (
            of_u(0.081, 0.08, 0.05),
            "U 0.081 mm of 0.08 mm asked after 2 of 5 cycles: not reached, about 1 more cycle needed",
        ),
        (
            of_u(0.1, 0.05, 0.06),
            "U 0.1 mm of 0.05 mm asked after 2 of 5 cycles: not reached, no number of cycles leads to it",
        ),
        (
            replace(of_u(0.22, 0.5, 0.1), cycles=1, planned=1),
            "U 0.22 mm of 0.5 mm asked after 1 cycle: 2 cycles at least",
        ),
        (
            replace(of_u(0.1, 0.05, 0.06), criteria=(), void="no plateau"),
            "the uncertainty is not known after 2 cycles: no plateau",
        ),
    ],
)
def test_the_end_of_a_run_states_what_was_reached(assessment: StopAssessment, end: str) -> None:
    """After which of the planned cycles, and how many more were needed."""
    assert assessment.end == end


def test_u_takes_the_cycles_at_their_upper_limit() -> None:
    """Of two cycles the variance is known to a factor of 63, of eleven to 2.1; of one cycle nothing is known."""
    for cycles, chi2 in ((2, 0.0157907741), (11, 4.8651820519)):
        effect = CycleEffect(cycles, 18, 0.04, 0.01)
        upper = 0.04 * (cycles - 1) / chi2 * (1 + 1 / cycles)
        assert u_at_most(0.06, effect, 0.025) == pytest.approx(math.hypot(0.06, 0.05 * math.sqrt(upper - 0.04)))
    assert u_at_most(0.06, CycleEffect(1, 18, 0.0, 0.0), 0.025) == 0.06


def test_next_cycle_holds_the_fewest_plateaus_that_lead_to_u(run: Analysis) -> None:
    """The ends and nearly half of a branch at least; a smaller U takes more; all where one cycle does not reach it."""
    calibration, x_mm = run.sensors[0].calibration, 0.5
    assert calibration is not None
    at_middle = StopCriterion("U ", "mm", 0.2, 0.19, 0.0)
    counts = []
    for asked in (0.199, 0.19, 0.18, 0.17):
        found = held_plateaus(run, calibration, replace(at_middle, asked=asked), x_mm)
        assert found is not None
        low, high = run.loops.level_kpa[[0, -1]]
        assert {("unloading", low), ("loading", high)} <= set(found)
        assert len(set(found)) == len(found)
        for branch in ("unloading", "loading"):
            assert sum(one[0] == branch for one in found) >= HELD_SHARE * (run.loops.level_kpa.size - 1)
        counts.append(len(found))
    assert 2 * HELD_SHARE * (run.loops.level_kpa.size - 1) <= counts[0] <= counts[1] <= counts[2] < counts[3]
    assert held_plateaus(run, calibration, replace(at_middle, asked=0.1), x_mm) is None
    spline = cast(Any, SimpleNamespace(spline=object()))
    assert held_plateaus(run, spline, at_middle, x_mm) is None


def test_a_run_without_readings_says_why_u_is_unknown() -> None:
    """Without elongations there is no calibration, and no end to the run."""
    found = assess_calibration(analysed(Stairs(cycles=2, rate_hz=30.0, dwell_s=1.0), readings=False), 0.1, 5)
    assert found.more_cycles is None
    assert not found.reached
    assert "not known" in found.text


def with_intervals(run: Analysis, drift: float, spread: float, void: str = "") -> Analysis:
    """Return the run with other half widths of the intervals of drift and repeatability."""
    sensor = run.sensors[0]
    figures = dict(sensor.figures)
    for name, half in ((DRIFT, drift), (SPREAD, spread)):
        figures[name] = replace(figures[name], low=1.0 - half, high=1.0 + half, void=void)
    return replace(run, sensors=(replace(sensor, figures=figures),))


def test_a_repeatability_run_ends_when_drift_and_spread_are_known(run: Analysis) -> None:
    """Never before ten cycles; the drift's interval falls faster with the cycles than that of the repeatability."""
    early = assess_repeats(with_intervals(run, 0.05, 0.05), 0.1, 100)
    assert early.more_cycles == FEWEST_REPEATS - 2
    assert early.text.endswith("0.1 % FSO asked: 8 cycles more, 10 cycles at least")
    assert assess_repeats(with_intervals(run, 6.39, 0.1), 0.1, 100).more_cycles == 2 * 16 - 2
    wide = assess_repeats(with_intervals(run, 0.1, 0.2999), 0.1, 100)
    assert wide.more_cycles == 2 * 9 - 2
    assert wide.text.endswith("0.1 % FSO asked: 16 cycles more")
    assert "drift ±0.1, repeatability ±0.3 % FSO after" in wide.text
    unknown = assess_repeats(with_intervals(run, 0.1, 0.1, "one cycle only"), 0.1, 100)
    assert "one cycle only" in unknown.text
    assert not unknown.reached


@pytest.mark.parametrize("asked_mm", [0.0, -1.0, math.nan, math.inf])
def test_an_impossible_uncertainty_is_refused(asked_mm: float) -> None:
    """Only a length above 0 can be asked for."""
    with pytest.raises(RequestError):
        check_asked(asked_mm, "mm")


def test_numpy_is_not_stated(run: Analysis) -> None:
    """What is stated of a run are plain numbers and texts."""
    found = assess_calibration(run, 1.0, 5).as_json()
    assert not any(isinstance(one, np.generic) for branch in found["hold"] or () for one in branch)
