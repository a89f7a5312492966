"""The interlock: limits, levels, the latch, and that there is no way around it."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from boat_daq.engine.control.interlock import FlatLine, Interlock, PressureWatch, SensorAlarms
from boat_daq.engine.control.trips import Trip
from boat_daq.engine.sample_columns import Columns
from protocol.base.errors import RequestError
from protocol.link.messages import SetPressure
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


@settings(max_examples=100)
@given(st.floats(allow_nan=True, allow_infinity=True))
def test_a_pressure_is_authorised_inside_the_limits_only(target: float) -> None:
    """Whatever is requested, a command leaves only for a target inside the tightest limits."""
    try:
        command = interlock().authorise(target, 10.0)
    except RequestError as refusal:
        assert not -40 <= target <= 55
        assert refusal.cause
    else:
        assert -40_000 <= command.target_pa <= 55_000


@pytest.mark.parametrize(
    ("target", "ramp", "command"),
    [
        (12.345, 7.5, SetPressure(12_345, 7_500)),
        (-40.0, 1e-4, SetPressure(-40_000, 1)),  # as slow as the wire can say, never 0
        (55.0 + 1e-10, 99_999.0, SetPressure(55_000, 99_999_000)),  # the rounding of a sum of steps is no excess
        (-40.0 - 1e-10, 1.0, SetPressure(-40_000, 1_000)),
    ],
)
def test_command_carries_the_pressure_in_pascal(target: float, ramp: float, command: SetPressure) -> None:
    """kPa and kPa/s become Pa and Pa/s, the limits included."""
    assert interlock().authorise(target, ramp) == command


@pytest.mark.parametrize(("target", "cause"), [(55.000001, "above the unit's limit"), (-40.000001, "below the plan's")])
def test_pressure_just_beyond_a_limit_is_refused(target: float, cause: str) -> None:
    """A thousandth of a pascal is beyond, whichever rounding would bring it back."""
    with pytest.raises(RequestError, match=cause):
        interlock().authorise(target, 1.0)


@pytest.mark.parametrize("ramp", [0.0, -1.0, 1e5, math.inf, math.nan])
def test_a_ramp_that_is_none_is_refused(ramp: float) -> None:
    """On the wire a ramp of 0 means as fast as the pumps go; it cannot be requested by accident."""
    with pytest.raises(RequestError, match="ramp"):
        interlock().authorise(10.0, ramp)


@pytest.mark.parametrize("limits", [(50, -40), (10, 50), (-50, -10), (0, 0), (math.nan, 50)])
def test_limits_that_cannot_be_kept_are_refused(limits: tuple[float, float]) -> None:
    """Swapped, not numbers, or without 0 kPa, where a vented unit is."""
    with pytest.raises(RequestError):
        Interlock().set_limits("unit", limits)


@pytest.mark.parametrize("limits", [(0.0, 50.0), (-50.0, 0.0), (-0.5, 0.5)])
def test_limits_may_end_at_the_pressure_of_a_vented_unit(limits: tuple[float, float]) -> None:
    """A unit for pressure alone, or for vacuum alone; and one for less than a kilopascal."""
    lock = Interlock()
    lock.set_limits("unit", limits)
    assert lock.limits is not None
    assert (lock.limits.min_kpa, lock.limits.max_kpa) == limits


def test_no_limits_no_pressure() -> None:
    """Before a board has sent its limits nothing is authorised."""
    with pytest.raises(RequestError, match="no pressure limits"):
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
    with pytest.raises(RequestError, match="no pressure"):
        lock.authorise(10.0, 10.0)


def test_within_the_margin_nothing_trips() -> None:
    """2 kPa beyond a limit is overshoot, and no alarm; before limits are known, so is what a unit can read."""
    assert interlock().inspect(block([57.0, -42.0])) is None
    assert Interlock().inspect(block([1000.0, -1000.0])) is None
    assert Interlock().inspect(block([1000.1])).kind == "implausible"


@pytest.mark.parametrize("pressures", [[54.0, 57.0, 57.01], [-39.0, -42.0, -42.01], [0.0, 0.0, 1000.1]])
def test_first_sample_beyond_the_margin_is_reported(pressures: list[float]) -> None:
    """Those within it, just before it, are not."""
    found = interlock().inspect(block(pressures))
    assert (found.time_us, found.value) == (20_000, pressures[-1])


def test_plausible_pressure_beyond_a_limit_is_no_sensor_fault() -> None:
    """1,000 kPa is much, and can be read; 1,000.1 cannot."""
    assert interlock().inspect(block([1000.0])).kind == "over_pressure"
    assert interlock().inspect(block([-1000.0])).kind == "under_pressure"
    assert interlock().inspect(block([-1000.1])).kind == "implausible"


def test_the_earliest_sample_is_the_reason() -> None:
    """Of many bad samples in one block the first is reported, with its time and value."""
    found = interlock().inspect(block([0, 0, 60, 70, -60]))
    assert found is not None
    assert (found.kind, found.time_us, found.value) == ("over_pressure", 20_000, 60.0)


def test_a_level_that_is_still_present_cannot_be_cleared() -> None:
    """The newest sample decides: gone, it can be cleared; still present, it is refused."""
    lock = interlock()
    lock.inspect(block(0, flags=SampleFlag.ESTOP))
    with pytest.raises(RequestError, match="e-stop"):
        lock.require_gone()
    lock.inspect(block(0))
    lock.require_gone()
    lock.inspect(block([60.0, 0.0]))
    lock.require_gone()
    lock.inspect(block([0.0, 60.0]))
    with pytest.raises(RequestError, match="above the limit of 55 kPa"):
        lock.require_gone()


def test_what_is_latched_first_stays() -> None:
    """A second trip does not hide the first one's reason."""
    lock = interlock()
    assert lock.trip(Trip("silent", "no data"))
    assert lock.trip(Trip("estop", "pressed")) is None
    assert lock.latched is not None and lock.latched.kind == "silent"
    with pytest.raises(RequestError) as refusal:
        lock.authorise(0.0, 1.0)
    assert refusal.value.remedy == "clear the fault first"


def test_a_new_plan_is_not_held_to_the_old_one_s_limits() -> None:
    """The plan's own limits count for its pressures, not for the plan that comes after it."""
    lock = interlock()
    with pytest.raises(RequestError, match="plan's limit"):
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


@pytest.mark.parametrize(
    ("span_kpa", "samples", "frozen"), [(20.0, 20, [1, 2]), (19.9, 20, []), (20.0, 19, []), (25.0, 40, [1, 2])]
)
@pytest.mark.parametrize(("parts", "way"), [(1, 1), (3, 1), (1, -1)])
def test_frozen_is_20_samples_over_20_kpa(
    span_kpa: float, samples: int, frozen: list[int], parts: int, way: int
) -> None:
    """Counted from where the reading became what it is, in one block or in several."""
    watch = FlatLine()
    pressure = np.concatenate([[-30.0, 50.0], np.linspace(0, span_kpa, samples)[::way]])
    raw = np.full((samples + 2, 2), 1500.0)
    raw[:2] += [[3.0, 3.0], [4.0, 4.0]]
    several = zip(np.array_split(pressure, parts), np.array_split(raw, parts), strict=True)
    assert [sensor for p, r in several for sensor in watch.inspect(block(p, raw=r))] == frozen
    next_one = watch.inspect(block(pressure[-1:], raw=[[1500.0, 1500.0]]))
    assert next_one == ([1, 2] if samples == 19 else [])  # the twentieth; what is named once is not named again


def test_a_still_channel_under_still_pressure_is_no_alarm() -> None:
    """A steady sensor on a plateau raises no alarm."""
    assert FlatLine().inspect(block(np.full(500, 20.0), raw=np.full((500, 2), 1500.0))) == []


def pressures(
    watch: PressureWatch, goal_kpa: float | None, *spans: tuple[float, float], since_s: float = 0.0
) -> list[str]:
    """Show a watch pressures at 10 Hz, each for so many seconds; return what it reports, with the time of each."""
    found, now_s = [], since_s
    for kpa, seconds in spans:
        for _ in range(round(10 * seconds)):
            event = watch.inspect(round(1e6 * now_s), kpa, goal_kpa)
            found += [f"{now_s:.1f} {event.text}"] if event is not None else []
            now_s += 0.1
    return found


def test_a_manual_pressure_that_is_not_there_is_reported_once_until_it_is() -> None:
    """A stuck pressure stayed "Moving" for ever: 10 s after its ramp, or 1 s after it left, it is reported."""
    watch = PressureWatch()
    watch.commanded(0, 0.0, 20.0, 10.0)
    assert pressures(watch, 20.0, (0.0, 20.0)) == ["12.1 the pressure is 0.0 kPa, not 20 kPa"]
    assert pressures(watch, 20.0, (19.0, 5.0), since_s=20.0) == [] and watch.present is None
    assert pressures(watch, 20.0, (20.0, 5.0), (16.2, 5.0), since_s=25.0) == [
        "31.0 the pressure is 16.2 kPa, not 20 kPa"
    ]
    watch.commanded(40_000_000, 16.2, 36.2, 10.0)
    assert watch.present is None and pressures(watch, 36.2, (20.0, 11.0), since_s=40.0) == []


def test_a_pressure_that_stays_on_a_vented_unit_is_reported() -> None:
    """A vent that was not carried out was "Idle" at +26 kPa; one under way, or a unit at rest, is no alarm."""
    watch = PressureWatch()
    watch.commanded(0, 0.0, 20.0, 10.0)
    slowly = [(20.0 * math.exp(-s / 30.0), 0.1) for s in np.arange(0, 90, 0.1)]
    assert pressures(watch, None, *slowly, (0.2, 30.0)) == []
    stays = "the pressure stays at 26.0 kPa on a vented unit"
    drifted = "the pressure stays at -2.5 kPa on a vented unit"
    assert pressures(watch, None, (0.0, 1.0), (-2.5, 3.0), since_s=200.0) == [f"202.0 {drifted}"]
    assert pressures(PressureWatch(), None, (30.0, 5.0), (26.0, 20.0)) == [f"15.1 {stays}"]


def test_sensors_without_light_or_with_too_much_are_reported_while_they_are() -> None:
    """A dead sensor and a saturated one showed numbers without a word; a few spikes among good samples are none."""
    rng, watch = np.random.default_rng(1), SensorAlarms()

    def second(n: int, signal: object, *, flags: int = 0, full: int | None = 65535) -> list[str]:
        made = block(np.zeros(100), flags=flags, raw=np.zeros((100, 2)) + np.asarray(signal))
        parts = (made.part(slice(i, i + 10)) for i in range(0, 100, 10))
        return [e.text for i, part in enumerate(parts) for e in watch.inspect(part, n * 1_000_000 + 100_000 * i, full)]

    noise = rng.normal(0, 19, (100, 2))
    good = 26000 + noise
    spikes = good.copy()
    spikes[50] = 60000
    dead, full = np.where([True, False], noise, good), np.where([False, True], 65535, good)
    assert [second(n, s) for n, s in enumerate((good, good, spikes))] == [[], [], []]
    assert second(3, dead) + second(4, dead) == ["sensor 1 gives no signal"]
    assert second(5, full) + second(6, full) + second(7, full) == ["sensor 2 is saturated"]
    assert list(watch.present) == ["sensor 2 is saturated"]
    impossible = int(SampleFlag.IMPLAUSIBLE)
    assert second(8, good, flags=impossible) + second(9, good, flags=impossible) == [
        "samples with impossible values arrive, and are left out"
    ]
    assert second(10, good) + second(11, good) + second(12, good) == [] and not watch.present
    assert second(13, noise, full=None) + second(14, full, full=None) == []  # signals of other firmware may cross zero
