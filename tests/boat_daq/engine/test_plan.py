"""Plans: their steps, and what they refuse."""

from __future__ import annotations

import dataclasses
from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from boat_daq.engine.plan import Plan, built_in_plans, load_plan, plan_from_toml, plans_in
from protocol.base.errors import RequestError

CALIBRATION, REPEATABILITY = built_in_plans()["calibration"], built_in_plans()["repeatability"]


def test_calibration_is_the_paper_s_staircase() -> None:
    """Five cycles of +50 -> -40 -> +50 kPa in steps of 10: an opening plateau, then nine down and nine up each."""
    down = [40.0, 30.0, 20.0, 10.0, 0.0, -10.0, -20.0, -30.0, -40.0]
    assert CALIBRATION.opening.target_kpa == 50.0
    assert list(CALIBRATION.targets_kpa) == [*down, *down[-2::-1], 50.0]
    assert len(CALIBRATION.steps) == 1 + 5 * 18


def test_repeatability_turns_a_hundred_times_at_each_end() -> None:
    """A hundred continuous cycles have two turning points each and no plateau."""
    assert Counter(s.target_kpa for s in REPEATABILITY.steps) == {50.0: 101, -40.0: 100}
    assert not any(step.plateau for step in REPEATABILITY.steps)


def test_every_cycle_has_whole_branches_and_no_plateau_twice() -> None:
    """With the plateau before it, each branch of each cycle runs from end to end; none is held twice running."""
    targets = [s.target_kpa for s in CALIBRATION.steps]
    assert all(a != b for a, b in pairwise(targets))
    for cycle in range(1, 6):
        own = [i for i, s in enumerate(CALIBRATION.steps) if s.cycle == cycle]
        falling = [targets[own[0] - 1], *(targets[i] for i in own if CALIBRATION.steps[i].branch == "unloading")]
        rising = [falling[-1], *(targets[i] for i in own if CALIBRATION.steps[i].branch == "loading")]
        assert falling == [50.0 - 10 * n for n in range(10)]
        assert rising == falling[::-1]


def test_duration_of_a_plan_equals_the_calculated_one() -> None:
    """90 kPa each way at 10 kPa/s and 18 holds of 3 s make 72 s a cycle; the opening takes 5 s and its hold."""
    assert CALIBRATION.cycle_duration_s == pytest.approx(18 + 18 * 3)
    assert CALIBRATION.duration_s == pytest.approx(5 + 3 + 5 * 72)


@given(
    st.integers(1, 50),
    st.integers(1, 12),
    st.floats(0.1, 20),
    st.floats(0, 20),
    st.sampled_from(["staircase", "continuous"]),
)
def test_toml_round_trip(cycles: int, steps: int, ramp: float, dwell: float, kind: str) -> None:
    """What is written is read back as the same plan."""
    plan = Plan('a "name" ü', kind, cycles, step_kpa=90 / steps, ramp_kpa_per_s=ramp, tolerance_kpa=0.5).with_dwell(
        dwell
    )
    assert plan_from_toml(plan.to_toml()) == plan


@pytest.mark.fault(53, how="plans with each kind of mistake", times=18)
@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("colour", "3", "not a known key"),
        ("cycles", "5.0", "type int"),
        ("cycles", "true", "type int"),
        ("cycles", "0", "at least 1"),
        ("cycles", "100000", "no more than"),
        ("ramp_kpa_per_s", '"fast"', "type float"),
        ("ramp_kpa_per_s", "0", "above 0"),
        ("ramp_kpa_per_s", "nan", "finite"),
        ("low_kpa", "50", "below 'high_kpa'"),
        ("min_kpa", "60", "below 'max_kpa'"),
        ("low_kpa", "-50", "own limit"),
        ("high_kpa", "60", "own limit"),
        ("step_kpa", "7", "evenly"),
        ("step_kpa", "1.5", "tolerance_kpa"),
        ("kind", '"spiral"', "is 'spiral'"),
        ("name", '""', "characters"),
        ("min_dwell_s", "-1", "negative"),
        ("max_dwell_s", "1", "shorter"),
        ("end_percent_fso", "-0.5", "negative"),
        ("end_percent_fso", "0.5", "without plateaus"),
    ],
)
def test_a_bad_plan_is_refused_by_key(key: str, value: str, text: str) -> None:
    """Whatever makes no plan is named by its key, with the reason."""
    table = {"name": '"x"', "kind": '"staircase"', "cycles": "5", key: value}
    with pytest.raises(RequestError) as refusal:
        plan_from_toml("\n".join(f"{k} = {v}" for k, v in table.items()))
    assert text in refusal.value.cause
    assert f"'{key}'" in refusal.value.cause


def test_a_missing_key_is_refused() -> None:
    """A plan without its number of cycles is none."""
    with pytest.raises(RequestError, match="'cycles' is missing"):
        plan_from_toml('name = "x"\nkind = "staircase"')


def test_a_short_dwell_shortens_what_must_fit_into_it() -> None:
    """Settling and window fit into the given dwell; a long one leaves them unchanged."""
    assert CALIBRATION.with_dwell(1.0).settling_s + CALIBRATION.with_dwell(1.0).window_s == 1.0
    assert CALIBRATION.with_dwell(30.0).max_dwell_s == 90.0
    assert CALIBRATION.with_dwell(30.0).settling_s == CALIBRATION.settling_s


def test_load_by_name_or_path(tmp_path: Path) -> None:
    """A built-in plan by name, another by its file; neither is refused with the names there are."""
    own = dataclasses.replace(CALIBRATION, name="own", cycles=2)
    (tmp_path / "own.toml").write_text(own.to_toml(), encoding="utf-8")
    assert load_plan("calibration") == CALIBRATION
    assert load_plan(str(tmp_path / "own.toml")) == own
    with pytest.raises(RequestError, match="no plan 'no such'") as refusal:
        load_plan("no such")
    assert "calibration, repeatability" in refusal.value.remedy


def test_plans_of_a_folder_beside_the_built_in_ones(tmp_path: Path) -> None:
    """By the name that each states; a name that is taken, a file that is no plan and a missing folder are refused."""
    own = dataclasses.replace(CALIBRATION, name="own", cycles=2)
    (tmp_path / "any.toml").write_text(own.to_toml(), encoding="utf-8")
    assert plans_in(tmp_path) == {**built_in_plans(), "own": own}
    (tmp_path / "second.toml").write_text(CALIBRATION.to_toml(), encoding="utf-8")
    with pytest.raises(RequestError, match="name of another plan, 'calibration'"):
        plans_in(tmp_path)
    (tmp_path / "second.toml").write_text("cycles = 1", encoding="utf-8")
    with pytest.raises(RequestError, match="'name' is missing"):
        plans_in(tmp_path)
    with pytest.raises(RequestError, match="is not a folder"):
        plans_in(tmp_path / "none")


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"a = ", b"x" * 2_000_000, b"a = " + b"[" * 5000])
def test_a_file_that_is_no_plan(tmp_path: Path, content: bytes) -> None:
    """Not text, not TOML, too large, too deep: a cause and a remedy, never a traceback of another kind."""
    path = tmp_path / "plan.toml"
    path.write_bytes(content)
    with pytest.raises(RequestError):
        load_plan(str(path))
