"""Loops of a profile: the order of the segments, time, what is refused, in and out as TOML."""

from __future__ import annotations

from dataclasses import replace

import pytest

from boat_daq.engine.plan import Loop, Plan, plan_from_toml
from boat_daq.engine.toml_values import BadValue
from protocol.recording import Segment

A, B, C, D = (Segment("step", kpa, hold_s=1.0) for kpa in (0.0, 10.0, 20.0, 30.0))
PLAN = Plan("looped", "profile", 2, segments=(A, B, C, D), loops=(Loop(2, 4, 2), Loop(3, 3, 3)))


def test_segments_of_a_loop_are_run_so_many_times():
    """A loop inside another one is run in each of its passes; the loops' order does not matter."""
    wanted = [0.0, 10.0, 20.0, 20.0, 20.0, 30.0, 10.0, 20.0, 20.0, 20.0, 30.0]
    assert [segment.target for segment in PLAN.unrolled] == wanted
    assert replace(PLAN, loops=PLAN.loops[::-1]).unrolled == PLAN.unrolled
    assert [step.target_kpa for step in PLAN.cycle_steps(1)] == wanted
    assert PLAN.cycle_duration_s == 11.0
    assert len(PLAN.steps) == 1 + 2 * 11


def test_each_pass_begins_where_the_one_before_led():
    """A ramp at the beginning of a loop comes from its end."""
    ramps = (Segment("ramp", 10.0, rate_per_s=10.0), Segment("ramp", 20.0, rate_per_s=10.0))
    plan = Plan("ramps", "profile", 1, segments=ramps, loops=(Loop(1, 2, 2),))
    assert [step.start for step in plan.cycle_steps(1)] == [0.0, 10.0, 20.0, 10.0]


def test_a_plan_with_loops_returns_from_its_toml_unchanged():
    assert plan_from_toml(PLAN.to_toml()) == PLAN


@pytest.mark.parametrize(
    ("loops", "key"),
    [
        ((Loop(0, 2, 2),), "last"),
        ((Loop(3, 2, 2),), "last"),
        ((Loop(1, 5, 2),), "last"),
        ((Loop(1, 2, 1),), "times"),
        ((Loop(1, 2, 2), Loop(2, 3, 2)), "first"),
        ((Loop(1, 2, 2), Loop(1, 2, 3)), "first"),
        ((Loop(1, 4, 1000), Loop(2, 3, 1000)), "cycles"),
    ],
)
def test_a_loop_that_cannot_be_run_is_refused_by_key(loops, key):
    """Outside the list, once, crossing another one, endless."""
    with pytest.raises(BadValue) as caught:
        replace(PLAN, loops=loops)
    assert caught.value.key == key
