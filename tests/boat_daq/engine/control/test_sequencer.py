"""The run's state machine and the watch over one step, fed with made-up pressures."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from boat_daq.engine.control.plateau_dwell import StepWatch
from boat_daq.engine.control.sequencer import READING_S, GoTo, SegmentBreak, Sequencer, StepChanged, VentNow
from boat_daq.engine.plan import Plan, PlannedStep, StepMark, resume_point
from boat_daq.engine.sample_columns import Columns
from boat_daq.engine.snapshot import Phase, RunEnding, SessionState
from protocol.base.errors import RequestError
from protocol.recording import RunEnd, SampleFlag

PLAN = Plan("t", "staircase", 2, step_kpa=45.0, ramp_kpa_per_s=20.0, reading_timeout_s=5.0)
HZ = 100


def samples(
    pressure_kpa: object, start_us: int = 0, *, noise_mv: float = 1.0, drift_mv_per_s: float = 0.0, flags: int = 0
) -> Columns:
    """Return samples at 100 Hz from `start_us` on, with a noisy signal that may drift."""
    p = np.asarray(pressure_kpa, dtype=float)
    t = start_us + np.arange(p.size, dtype=np.int64) * (1_000_000 // HZ)
    rng = np.random.default_rng(start_us)
    mv = 1650 + drift_mv_per_s * t[:, None] / 1e6 + noise_mv * rng.standard_normal((p.size, 2))
    return Columns(t, p, mv, mv, np.zeros(p.size, np.uint8), np.full(p.size, flags, np.uint16))


def ramp_and_hold(to_kpa: float, hold_s: float, *, ramp_s: float = 2.0) -> np.ndarray:
    return np.concatenate([np.linspace(0, to_kpa, round(ramp_s * HZ)), np.full(round(hold_s * HZ), to_kpa)])


def watch(plan: Plan = PLAN, target: float = 50.0, *, plateau: bool = True, wait: bool = False) -> StepWatch:
    found = StepWatch(plan, PlannedStep(1, "loading", target, plateau), started_us=0, wait_for_reading=wait)
    found.commanded(0, 0.0)
    return found


def test_times_of_a_plateau_equal_the_calculated_ones() -> None:
    """A ramp of 2 s to 50: within 1 kPa at 98 %, settled 1 s later, ended when 2 s of steady samples follow."""
    step = watch()
    step.feed(samples(ramp_and_hold(50.0, 10.0)))
    assert step.arrived_us == pytest.approx(1.96e6, abs=2e4)
    assert step.settled_us == step.arrived_us + 1_000_000
    assert step.ended_us == pytest.approx(step.arrived_us + 3_000_000, abs=1e4)
    assert step.outcome == "reached"
    assert step.detail()["steady"] is True
    assert step.detail()["settling_time_s"] == pytest.approx(2.96, abs=0.03)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(1, 400), min_size=1, max_size=12), st.booleans())
def test_the_cut_into_blocks_changes_nothing(lengths: list[int], overshoot: bool) -> None:
    """Whole, or in blocks of any lengths: the same times, the same outcome. So 100x real time decides the same."""
    pressure = ramp_and_hold(50.0, 8.0)
    if overshoot:
        pressure[200:260] = 52.0
    whole, cut, at = watch(), watch(), 0
    data = samples(pressure)
    whole.feed(data)
    for length in [*lengths, len(data)]:
        cut.feed(data.part(slice(at, min(at + length, len(data)))))
        at = min(at + length, len(data))
    times = [(s.arrived_us, s.settled_us, s.ended_us, s.outcome) for s in (whole, cut)]
    assert times[0] == times[1]
    assert whole.detail()["drift"] == cut.detail()["drift"]


def test_a_drifting_signal_ends_at_the_longest_hold_as_not_steady() -> None:
    """5 mV/s is never steady: the hold lasts to its longest dwell and keeps its drift."""
    step = watch()
    step.feed(samples(ramp_and_hold(50.0, 30.0), drift_mv_per_s=5.0))
    assert step.outcome == "reached"
    assert step.ended_us is not None and step.arrived_us is not None
    assert step.ended_us - step.arrived_us == pytest.approx(PLAN.max_dwell_s * 1e6, abs=3e5)
    assert step.detail()["steady"] is False
    assert step.detail()["drift"]["s1_mv"]["slope"] == pytest.approx(5.0, abs=0.2)


@pytest.mark.fault(21, how="a pump that stalls at 30 of 50 kPa", times=1)
def test_a_pressure_that_never_arrives_times_out() -> None:
    """A pump that stalls at 30 of 50 kPa: timeout 10 s after the ramp should have been over."""
    step = watch()
    step.feed(samples(np.minimum(ramp_and_hold(50.0, 30.0), 30.0)))
    assert (step.outcome, step.arrived_us) == ("timeout", None)
    assert step.ended_us == pytest.approx(2.5e6 + 10e6, abs=2e4)


@pytest.mark.fault(21, how="the pressure arrives and leaves again", times=1)
def test_a_leak_under_the_hold_times_out_too() -> None:
    """The pressure arrives and leaves again for good: the hold does not count, and the step ends."""
    step = watch()
    step.feed(samples(np.concatenate([ramp_and_hold(50.0, 1.0), np.linspace(50, 20, 2000)])))
    assert step.outcome == "timeout"
    assert step.detail()["excursions"] == 1


@pytest.mark.fault(19, how="53 kPa on the way to 50", times=1)
def test_an_overshoot_is_kept_as_the_peak_and_ends_the_stay() -> None:
    """53 kPa on the way in: arrived only after it came back, and the detail holds the peak."""
    pressure = ramp_and_hold(50.0, 10.0)
    pressure[210:260] = 53.0
    step = watch()
    step.feed(samples(pressure))
    assert step.arrived_us == 2_600_000
    assert step.detail()["pressure_max_kpa"] == 53.0


def test_a_turning_point_waits_for_no_evidence() -> None:
    """A continuous run turns after its shortest dwell, however much the signal drifts."""
    plan = dataclasses.replace(PLAN, kind="continuous", min_dwell_s=0.5)
    step = watch(plan, plateau=False)
    step.feed(samples(ramp_and_hold(50.0, 3.0), drift_mv_per_s=100.0))
    assert step.ended_us is not None and step.arrived_us is not None
    assert step.ended_us - step.arrived_us == pytest.approx(5e5, abs=1e4)


def test_samples_without_a_pressure_are_passed_over() -> None:
    """Where the sensor is invalid nothing arrives and nothing leaves."""
    step = watch()
    step.feed(samples(np.full(500, 50.0), flags=SampleFlag.PRESSURE_INVALID))
    assert step.phase is Phase.RAMPING and step.outcome is None


def test_saturated_samples_are_no_evidence() -> None:
    """A plateau without a usable signal is held to the end and called not steady."""
    step = watch()
    step.feed(samples(ramp_and_hold(50.0, 30.0), flags=SampleFlag.SATURATED))
    assert step.outcome == "reached" and step.detail()["steady"] is False


def test_a_plateau_waits_for_its_reading() -> None:
    """Steady, it waits; given, it ends at once; not given, it ends after the plan's timeout with a warning."""
    given_one, not_given = watch(wait=True), watch(wait=True)
    data = samples(ramp_and_hold(50.0, 20.0))
    for step in (given_one, not_given):
        step.feed(data.part(slice(700)))
        assert step.phase is Phase.WAITING_FOR_READING and step.outcome is None
    given_one.reading_awaited = False
    given_one.feed(data.part(slice(700, 760)))
    assert given_one.outcome == "reached"
    not_given.feed(data.part(slice(700, None)))
    assert not_given.detail()["reading_timed_out"] is True


class Rig:
    """A sequencer and a perfect pump."""

    def __init__(self, plan: Plan = PLAN, **options: int) -> None:
        self.sequencer = Sequencer()
        self.time_us, self.pressure, self.target = 0, 0.0, 0.0
        self.ended: list[RunEnding] = []
        self.vents = 0
        self.breaks: list[str] = []
        self.marks: dict[int, StepMark] = {}
        self.run(0.1)
        self.sequencer.arm(plan, **options)
        self.sequencer.start()

    def take(self) -> None:
        for action in self.sequencer.take():
            match action:
                case GoTo(target):
                    self.target = target
                    self.sequencer.commanded()
                case VentNow():
                    self.target, self.vents = 0.0, self.vents + 1
                case RunEnding():
                    self.ended.append(action)
                case SegmentBreak(reason):
                    self.breaks.append(reason)
                case StepChanged(mark):
                    self.marks[mark.number] = mark

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 10)):
            self.take()
            step = np.clip(self.target - self.pressure, -2.0, 2.0)
            self.sequencer.feed(samples(self.pressure + step * np.arange(1, 11) / 10, self.time_us))
            self.time_us, self.pressure = self.time_us + 100_000, self.pressure + step
        self.take()


def test_a_whole_run() -> None:
    """Two cycles of a three-level staircase: opening, 4 plateaus a cycle, the way out; one end, one vent."""
    rig = Rig()
    rig.run(120)
    assert rig.sequencer.state is SessionState.IDLE
    assert (rig.ended, rig.vents, rig.sequencer.complete_cycles) == ([RunEnding(RunEnd.FINISHED)], 1, 2)
    marks = list(rig.marks.values())
    cycle = ["unloading", "unloading", "loading", "loading"]
    assert [m.branch for m in marks] == ["start", *cycle, *cycle, "end"]
    assert [m.target_kpa for m in marks] == [50, 5, -40, 5, 50, 5, -40, 5, 50, 0]
    assert {m.status for m in marks} == {"reached"}
    assert [m.number for m in marks] == list(range(1, 11))


def test_pause_leaves_the_cycle_out_and_continues_the_count() -> None:
    """Paused in cycle 1 of 2: vented, the cycle left out; resumed with cycle 2, and ended with two complete cycles."""
    rig = Rig()
    rig.run(15)
    assert rig.sequencer.cycle == 1
    rig.sequencer.pause()
    rig.run(10)
    assert rig.pressure == 0.0 and rig.sequencer.state is SessionState.PAUSED and not rig.ended
    steps = rig.sequencer.progress().steps
    rig.sequencer.resume()
    assert rig.sequencer.progress().steps == steps  # with the opening plateau, which is held again
    rig.run(150)
    assert rig.ended == [RunEnding(RunEnd.FINISHED)]
    assert rig.breaks == ["paused", "resumed"]
    assert rig.sequencer.incomplete_cycles == (1,)
    reached = [m.cycle for m in rig.marks.values() if m.status == "reached" and m.cycle]
    assert sorted(set(reached) - {1}) == [2, 3] and reached.count(2) == reached.count(3) == 4
    assert [m.branch for m in rig.marks.values()].count("start") == 2


def test_enough_cycles_finish_the_run_without_the_present_one() -> None:
    """Refused in the first cycle; in the second the run is finished, vented, and keeps its one complete cycle."""
    rig = Rig()
    rig.run(15)
    with pytest.raises(RequestError, match="no cycle"):
        rig.sequencer.finish_early("U is small enough")
    while rig.sequencer.complete_cycles < 1:
        rig.run(1)
    rig.run(5)
    rig.sequencer.finish_early("U is small enough")
    rig.run(20)
    assert (rig.ended, rig.vents, rig.sequencer.state) == ([RunEnding(RunEnd.FINISHED)], 1, SessionState.IDLE)
    assert rig.sequencer.incomplete_cycles == (2,)
    with pytest.raises(RequestError):
        rig.sequencer.finish_early("again")


def test_plateaus_that_are_not_needed_are_passed() -> None:
    """From the next step on, in the same order and with the same counts; both ends are held, and all of them again."""
    rig = Rig(dataclasses.replace(PLAN, cycles=3), wait_for_reading=False)
    while rig.sequencer.complete_cycles < 1:
        rig.run(0.5)
    held = rig.sequencer.progress()
    rig.sequencer.hold_at([("unloading", 4.0)])
    passing = rig.sequencer.progress()
    assert held is not None and passing is not None
    assert passing.time_left_s < held.time_left_s - 5.0
    assert passing.steps == held.steps
    while rig.sequencer.complete_cycles < 2:
        rig.run(0.5)
    rig.sequencer.hold_at(None)
    rig.run(60)
    assert rig.ended == [RunEnding(RunEnd.FINISHED)]
    passed = [(mark.cycle, mark.branch, mark.target_kpa) for mark in rig.marks.values() if mark.passed]
    assert passed == [(2, "loading", 5.0)]
    mark = next(mark for mark in rig.marks.values() if mark.passed)
    assert (mark.status, mark.settled_us, "steady" in mark.detail) == ("reached", None, False)
    assert mark.ended_us is not None
    assert mark.ended_us - mark.started_us < 2.5e6
    assert resume_point(rig.sequencer.plan, list(rig.marks.values())) == (4, 3)


def test_a_passed_plateau_awaits_no_reading() -> None:
    """The run that waits for readings does not stop there; the next run holds everything again."""
    rig = Rig(wait_for_reading=True)
    rig.sequencer.hold_at([])
    waited = []
    for _ in range(200):
        rig.run(0.5)
        waiting = rig.sequencer.waiting()
        if waiting is not None:
            waited.append((waiting.cycle, waiting.target_kpa))
            rig.sequencer.reading_given(waiting.step_id)
    assert waited == [(0, 50.0), (1, -40.0), (1, 50.0), (2, -40.0), (2, 50.0)]
    rig.sequencer.arm(PLAN)
    rig.sequencer.start()
    rig.run(60)
    assert not any(mark.passed for mark in list(rig.marks.values())[-5:])


def test_stop_twice_is_one_end() -> None:
    """One stop record, one vent, and the run is idle once vented."""
    rig = Rig()
    rig.run(8)
    for _ in range(3):
        rig.sequencer.stop()
    rig.run(20)
    rig.sequencer.stop()
    rig.take()
    assert (rig.ended, rig.vents, rig.sequencer.state) == ([RunEnding(RunEnd.STOPPED)], 1, SessionState.IDLE)


@pytest.mark.fault(24, how="stop while aborting", times=1)
def test_stop_during_abort_adds_nothing() -> None:
    """Aborted stays aborted, with its one end."""
    rig = Rig()
    rig.run(8)
    rig.sequencer.abort("x", SessionState.FAULT)
    rig.sequencer.stop()
    rig.sequencer.abort("y", SessionState.ABORTED)
    rig.take()
    assert rig.ended == [RunEnding(RunEnd.FAULT, "x")] and rig.sequencer.state is SessionState.FAULT


def test_a_unit_that_does_not_vent_is_reported() -> None:
    """A valve that stays closed after the end: aborted with a message, not waited for indefinitely."""
    rig = Rig()
    rig.run(8)
    rig.sequencer.stop()
    rig.take()
    rig.target = 50.0
    rig.run(70)
    assert rig.sequencer.state is SessionState.ABORTED
    assert rig.ended == [RunEnding(RunEnd.STOPPED)]
    assert list(rig.marks.values())[-1].status == "timeout"


@pytest.mark.parametrize(("left_kpa", "state"), [(1.5, SessionState.IDLE), (2.5, SessionState.ABORTED)])
def test_a_unit_is_vented_within_2_kpa(left_kpa: float, state: SessionState) -> None:
    """A remainder of 2.5 kPa after the vent is pressure, and reported; 1.5 kPa is not."""
    rig = Rig()
    rig.run(8)
    rig.sequencer.stop()
    rig.take()
    rig.target = left_kpa
    rig.run(70)
    assert rig.sequencer.state is state


@pytest.mark.parametrize(
    ("state", "refused"),
    [
        (SessionState.IDLE, ("start", "pause", "resume")),
        (SessionState.ARMED, ("pause", "resume")),
        (SessionState.RUNNING, ("start", "resume", "arm")),
        (SessionState.PAUSED, ("start", "pause", "arm")),
        (SessionState.FINISHING, ("start", "pause", "resume", "arm")),
        (SessionState.ABORTED, ("start", "pause", "resume")),
        (SessionState.FAULT, ("start", "pause", "resume", "arm")),
    ],
)
def test_buttons_that_make_no_sense_are_refused(state: SessionState, refused: tuple[str, ...]) -> None:
    """In every state: what is not possible is refused, and changes nothing."""
    for button in refused:
        sequencer = Sequencer()
        sequencer.state = state
        with pytest.raises(RequestError, match=f"cannot {button}"):
            getattr(sequencer, button)(*([PLAN] if button == "arm" else []))
        assert sequencer.state is state and sequencer.take() == []


def test_a_broken_run_resumed_at_the_next_whole_cycle() -> None:
    """After a break in cycle 2 of 3: on with number 3, one complete cycle to its credit, two more to do."""
    plan = dataclasses.replace(PLAN, cycles=3)
    rig = Rig(plan)
    while rig.sequencer.cycle < 2:
        rig.run(1)
    rig.sequencer.abort("unplugged", SessionState.FAULT)
    first, complete = resume_point(plan, rig.sequencer.marks)
    assert (first, complete) == (3, 1)
    again = Rig(plan, resume_at=(first, complete))
    again.run(150)
    assert sorted({m.cycle for m in again.marks.values()}) == [0, 3, 4]
    assert again.ended == [RunEnding(RunEnd.FINISHED)]


def test_time_left_comes_down_to_the_truth() -> None:
    """Half way through, the estimate is within a fifth of what is really left."""
    rig = Rig()
    rig.run(40)
    progress = rig.sequencer.progress()
    assert progress is not None
    begun = rig.time_us
    while not rig.ended:
        rig.run(0.5)
    assert progress.time_left_s == pytest.approx((rig.time_us - begun) / 1e6, rel=0.2)


class Reader:
    """A rig whose plateaus wait for a reading, and an operator that enters it."""

    def __init__(self, timeout_s: float = 600.0) -> None:
        self.plan = dataclasses.replace(PLAN, reading_timeout_s=timeout_s)
        self.rig = Rig(self.plan, wait_for_reading=True)
        self.plateaus = sum(step.plateau for step in self.plan.cycle_steps(1))

    @property
    def left_s(self) -> float:
        progress = self.rig.sequencer.progress()
        assert progress is not None
        return progress.time_left_s

    def read_after(self, seconds: float) -> None:
        """Let the next plateau wait so long, then give its reading."""
        while self.rig.sequencer.waiting() is None:
            self.rig.run(0.1)
        self.rig.run(seconds)
        self.rig.sequencer.reading_given(self.rig.sequencer.marks[-1].number)
        self.rig.run(0.2)


def test_a_wait_for_a_reading_takes_nothing_off_the_rest() -> None:
    """Forty seconds at a plateau that waits: the steps behind it still take what they did, their readings with them."""
    reader = Reader()
    while reader.rig.sequencer.waiting() is None:
        reader.rig.run(0.1)
    reader.rig.run(READING_S)
    behind_s = reader.left_s
    reader.rig.run(40)
    plan_s = 2 * reader.plan.cycle_duration_s
    assert reader.left_s == pytest.approx(behind_s)
    assert behind_s == pytest.approx(plan_s + 2 * reader.plateaus * READING_S, abs=0.5)


def test_wait_for_a_reading_counts_down_to_its_end() -> None:
    """The time left is that of the plan, less the wait; the run continues when it is over, and not before."""
    reader = Reader(timeout_s=60.0)
    while (waiting := reader.rig.sequencer.waiting()) is None:
        reader.rig.run(0.1)
    assert waiting.time_left_s == pytest.approx(60.0, abs=0.5)
    reader.rig.run(50.0)
    later = reader.rig.sequencer.waiting()
    assert later is not None and later.step_id == waiting.step_id
    assert later.time_left_s == pytest.approx(waiting.time_left_s - 50.0)
    reader.rig.run(later.time_left_s + 1.0)
    assert reader.rig.sequencer.marks[0].detail["reading_timed_out"] is True


@pytest.mark.parametrize("long_s", [3.0, 60.0])
def test_one_long_wait_does_not_bias_the_time_left(long_s: float) -> None:
    """Readings take 3 s, the first one a minute: the time left is then true within a fifth."""
    reader = Reader()
    reader.read_after(long_s)
    for _ in range(4):
        reader.read_after(3.0)
    estimate_s, begun_us = reader.left_s, reader.rig.time_us
    while not reader.rig.ended:
        reader.read_after(3.0) if reader.rig.sequencer.waiting() else reader.rig.run(0.1)
    assert estimate_s == pytest.approx((reader.rig.time_us - begun_us) / 1e6, rel=0.2)


def test_run_holds_the_last_level_of_a_cycle_until_it_is_assessed() -> None:
    """The cycle counts at once and its level stays; then the next begins with what is to be held, or the run ends."""
    rig = Rig(dataclasses.replace(PLAN, cycles=3))
    rig.sequencer.stop_at_cycles(on=True)
    rig.run(120)
    seen = rig.sequencer.progress()
    assert seen is not None
    assert (seen.phase, seen.complete_cycles, seen.cycle, rig.pressure) == (Phase.ASSESSING, 1, 1, 50.0)
    rig.sequencer.hold_at([])
    rig.sequencer.next_cycle()
    rig.run(120)
    assert rig.sequencer.complete_cycles == 2
    assert [(m.cycle, m.target_kpa) for m in rig.marks.values() if m.passed] == [(2, 5.0), (2, 5.0)]
    rig.sequencer.finish_early("U is small enough")
    rig.run(20)
    assert (rig.ended, rig.vents, rig.sequencer.incomplete_cycles) == ([RunEnding(RunEnd.FINISHED)], 1, ())
    assert {m.status for m in rig.marks.values()} == {"reached"}


def test_a_continuous_run_holds_where_it_turns_from_the_cycle_on_that_may_end_it() -> None:
    """Earlier cycles follow one another; an assessment of fewer cycles than are complete releases none."""
    rig = Rig(dataclasses.replace(PLAN, kind="continuous", cycles=4))
    rig.sequencer.stop_at_cycles(on=True, first=2)
    rig.run(200)
    seen = rig.sequencer.progress()
    assert (seen.phase, seen.complete_cycles, rig.pressure) == (Phase.ASSESSING, 2, PLAN.high_kpa)
    rig.sequencer.next_cycle(1)
    rig.run(20)
    assert rig.sequencer.progress().phase is Phase.ASSESSING
    rig.sequencer.next_cycle(2)
    rig.run(200)
    assert (rig.sequencer.progress().phase, rig.sequencer.complete_cycles) == (Phase.ASSESSING, 3)
    rig.sequencer.finish_early("known well enough")
    rig.run(20)
    assert (rig.ended, rig.sequencer.incomplete_cycles) == ([RunEnding(RunEnd.FINISHED)], ())


@pytest.mark.parametrize("leave", ["pause", "off", "late", "stop"])
def test_a_held_cycle_is_left_by_any_way(leave: str) -> None:
    """Paused it is vented and resumes; with no U asked, or after half an hour, the next begins; or it stops."""
    rig = Rig()
    rig.sequencer.stop_at_cycles(on=True)
    rig.run(60)
    assert rig.sequencer.progress().phase is Phase.ASSESSING
    if leave == "pause":
        rig.sequencer.pause()
        rig.run(10)
        assert rig.pressure == 0.0
        rig.sequencer.resume()
    elif leave == "off":
        rig.sequencer.stop_at_cycles(on=False)
    elif leave == "late":
        rig.time_us += 1_801_000_000
    else:
        rig.sequencer.stop()
        rig.run(10)
        assert rig.ended == [RunEnding(RunEnd.STOPPED)]
        return
    rig.run(80)
    assert (rig.ended, rig.sequencer.incomplete_cycles) == ([RunEnding(RunEnd.FINISHED)], ())
