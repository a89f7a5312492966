"""Plans of segments: their values over time, what makes no profile, in and out as TOML."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from boat_daq.engine.plan import Plan, plan_from_toml
from protocol.base.errors import RequestError
from protocol.recording import Segment

SEGMENTS = (
    Segment("step", 10.0, hold_s=2.0, reading=True),
    Segment("ramp", -20.0, rate_per_s=5.0, hold_s=1.0),
    Segment("sine", -20.0, amplitude=15.0, frequency_hz=0.5, periods=2.5),
)
PROFILE = Plan("profile", "profile", 3, segments=SEGMENTS)


def test_a_profile_returns_from_its_toml_unchanged():
    assert plan_from_toml(PROFILE.to_toml()) == PROFILE


def test_segments_follow_each_other_and_cycles_join():
    steps = PROFILE.steps
    assert [step.cycle for step in steps] == [0, *[c for c in (1, 2, 3) for _ in SEGMENTS]]
    assert [step.start for step in steps[1:5]] == [10.0, 10.0, -20.0, -20.0]
    assert PROFILE.cycle_duration_s == pytest.approx(2.0 + 6.0 + 1.0 + 5.0)
    assert PROFILE.extremes_kpa == (-35.0, 10.0)
    rise = replace(PROFILE, cycles=2, segments=(Segment("ramp", 50.0, rate_per_s=10.0, hold_s=3.0),))
    assert rise.duration_s == pytest.approx(rise.min_dwell_s + (5.0 + 3.0) + 3.0)  # only the first begins at 0 kPa


def test_values_rates_and_accelerations_of_a_segment():
    ramp, sine = SEGMENTS[1], SEGMENTS[2]
    assert ramp.at(2.0, 10.0) == (0.0, -5.0, 0.0)
    assert ramp.at(6.5, 10.0) == (-20.0, 0.0, 0.0)
    value, rate, acceleration = sine.at(0.5, -20.0)
    assert value == pytest.approx(-5.0)
    assert rate == pytest.approx(0.0, abs=1e-9)
    assert acceleration == pytest.approx(-15.0 * math.pi**2)
    assert sine.at(5.0, -20.0) == (-20.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("segment", "key"),
    [
        (Segment("jump", 1.0, hold_s=1.0), "kind"),
        (Segment("ramp", 1.0), "rate_per_s"),
        (Segment("step", 1.0), "hold_s"),
        (Segment("sine", 1.0, amplitude=1.0, frequency_hz=1.0, periods=0.3), "periods"),
        (Segment("step", 1.0, hold_s=1.0, amplitude=2.0), "amplitude"),
        (Segment("step", 60.0, hold_s=1.0), "segments"),
    ],
)
def test_a_segment_that_makes_no_profile_is_refused_by_key(segment, key):
    with pytest.raises(RequestError, match=f"'{key}'"):
        Plan("bad", "profile", 1, segments=(segment,))


def test_millimetres_are_of_a_profile_only_and_need_no_pressure_limits():
    with pytest.raises(RequestError, match="'kind'"):
        Plan("bad", "staircase", 1, quantity="mm")
    assert Plan("mm", "profile", 1, quantity="mm", segments=SEGMENTS).extremes_kpa == ()


def test_an_unknown_key_of_a_segment_is_refused_with_its_number():
    text = PROFILE.to_toml().replace("rate_per_s = 5.0", "rate = 5.0")
    with pytest.raises(RequestError, match=r"segment \d: 'rate'"):
        plan_from_toml(text)
