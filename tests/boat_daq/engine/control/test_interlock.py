"""The interlock: limits, levels, the latch, and that there is no way around it."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from boat_daq.engine.control.interlock import FlatLine, Interlock, Trip
from boat_daq.engine.sample_columns import Columns
from boat_daq.errors import OperatorError
from protocol.recording import BoardState, SampleFlag

ENGINE = Path(__file__).resolve().parents[4] / "boat_daq"


def block(pressure_kpa: object, *, flags: int = 0, state: int = BoardState.HOLDING, raw: object = None) -> Columns:
    """Return samples at 100 Hz."""
    p = np.atleast_1d(np.asarray(pressure_kpa, dtype=float))
    n = len(p)
    counts = np.arange(2.0 * n).reshape(n, 2) if raw is None else np.asarray(raw, dtype=float)
    time_us = np.arange(n, dtype=np.int64) * 10_000
    return Columns(time_us, p, counts, counts, np.full(n, state, np.uint8), np.full(n, flags, np.uint16))


def interlock() -> Interlock:
    found = Interlock()
    found.set_limits("board", (-60, 80))
    found.set_limits("unit", (-45, 55))
    found.set_limits("plan", (-40, 60))
    return found


def test_the_tightest_limits_and_whose_they_are() -> None:
    """Each side takes the tightest of board, unit and plan, and names its source."""
    limits = interlock().limits
    assert limits is not None
    assert (limits.min_kpa, limits.min_source, limits.max_kpa, limits.max_source) == (-40, "plan", 55, "unit")


@given(st.floats(allow_nan=True, allow_infinity=True))
def test_a_pressure_is_authorised_inside_the_limits_only(target: float) -> None:
    """Whatever is requested, a command leaves only for a target inside the tightest limits."""
    try:
        command = interlock().authorise(target, 10.0)
    except OperatorError as refusal:
        assert not -40 <= target <= 55
        assert refusal.cause
    else:
        assert -40_000 <= command.target_pa <= 55_000


@pytest.mark.parametrize("ramp", [0.0, -1.0, math.inf, math.nan])
def test_a_ramp_that_is_none_is_refused(ramp: float) -> None:
    """On the wire a ramp of 0 means as fast as the pumps go; it cannot be requested by accident."""
    with pytest.raises(OperatorError, match="ramp"):
        interlock().authorise(10.0, ramp)


@pytest.mark.parametrize("limits", [(50, -40), (10, 50), (-50, -10), (0, 0), (math.nan, 50)])
def test_limits_that_cannot_be_kept_are_refused(limits: tuple[float, float]) -> None:
    """Swapped, not numbers, or without 0 kPa, where a vented unit is."""
    with pytest.raises(OperatorError):
        Interlock().set_limits("unit", limits)


def test_no_limits_no_pressure() -> None:
    """Before a board has sent its limits nothing is authorised."""
    with pytest.raises(OperatorError, match="no pressure limits"):
        Interlock().authorise(0.0, 10.0)


@pytest.mark.fault(19, 20, how="samples just beyond each level", times=7)
@pytest.mark.parametrize(
    ("kind", "samples"),
    [
        ("over_pressure", block([50, 57.01])),
        ("under_pressure", block([0, -42.01])),
        ("implausible", block(5000)),
        ("estop", block(0, flags=SampleFlag.ESTOP)),
        ("pressure_invalid", block(0, flags=SampleFlag.PRESSURE_INVALID)),
        ("pressure_invalid", block(math.nan)),
        ("board_fault", block(0, state=BoardState.FAULT)),
    ],
)
def test_levels_trip_and_latch(kind: str, samples: Columns) -> None:
    """Each level trips at once, latches, and is reported once; no pressure is authorised until it is cleared."""
    lock = interlock()
    found = lock.inspect(samples)
    assert found is not None and found.kind == kind
    assert lock.inspect(samples) is None
    with pytest.raises(OperatorError, match="no pressure"):
        lock.authorise(10.0, 10.0)


def test_within_the_margin_nothing_trips() -> None:
    """2 kPa beyond a limit is overshoot, and no alarm."""
    assert interlock().inspect(block([56.99, -41.99])) is None


def test_the_earliest_sample_is_the_reason() -> None:
    """Of many bad samples in one block the first is reported, with its time and value."""
    found = interlock().inspect(block([0, 0, 60, 70, -60]))
    assert found is not None
    assert (found.kind, found.time_us, found.value) == ("over_pressure", 20_000, 60.0)


def test_a_level_that_is_still_present_cannot_be_cleared() -> None:
    """The newest sample decides: gone, it can be cleared; still present, it is refused."""
    lock = interlock()
    lock.inspect(block(0, flags=SampleFlag.ESTOP))
    with pytest.raises(OperatorError, match="e-stop"):
        lock.require_gone()
    lock.inspect(block(0))
    lock.require_gone()


def test_what_is_latched_first_stays() -> None:
    """A second trip does not hide the first one's reason."""
    lock = interlock()
    assert lock.trip(Trip("silent", "no data"))
    assert lock.trip(Trip("estop", "pressed")) is None
    assert lock.latched is not None and lock.latched.kind == "silent"


def test_a_new_plan_is_not_held_to_the_old_one_s_limits() -> None:
    """The plan's own limits count for its pressures, not for the plan that comes after it."""
    lock = interlock()
    with pytest.raises(OperatorError, match="plan's limit"):
        lock.check(-43)
    lock.check(-43, new_plan=True)


def test_only_the_interlock_makes_a_pressure() -> None:
    """In the whole program no other line constructs a SET_PRESSURE."""
    makers = [
        path.name
        for path in ENGINE.rglob("*.py")
        if re.search(r"^(?!\s*case ).*\bSetPressure\(", path.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert makers == ["interlock.py"]


@pytest.mark.fault(16, how="one sensor repeats its value over 25 kPa", times=1)
def test_a_frozen_channel_is_found_while_the_pressure_moves() -> None:
    """One sensor repeats its value over 25 kPa: alarm once, for that sensor; it moves again: alarm over."""
    watch = FlatLine()
    pressure = np.linspace(0, 25, 100)
    raw = np.column_stack([np.full(100, 2000.0), 2000.0 + np.arange(100)])
    shown = [
        sensor for i in range(0, 100, 7) for sensor in watch.inspect(block(pressure[i : i + 7], raw=raw[i : i + 7]))
    ]
    assert shown == [1]
    assert watch.frozen == (1,)
    watch.inspect(block([25.0], raw=[[2001.0, 2100.0]]))
    assert watch.frozen == ()


def test_a_still_channel_under_still_pressure_is_no_alarm() -> None:
    """A steady sensor on a plateau raises no alarm."""
    assert FlatLine().inspect(block(np.full(500, 20.0), raw=np.full((500, 2), 1500.0))) == []
