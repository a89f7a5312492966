"""The run's state machine against times, counts and actions worked out by hand."""

from __future__ import annotations

import dataclasses

import pytest

from boat_daq.engine.control.sequencer import (
    Action,
    ControlEvent,
    GoTo,
    SegmentBreak,
    Sequencer,
    StepChanged,
    VentNow,
)
from boat_daq.engine.plan import Plan
from boat_daq.engine.snapshot import MessageKind, Phase, Progress, ReadingRequest, RunEnding, SessionState
from protocol.base.errors import RequestError
from protocol.recording import RunEnd
from tests.boat_daq.engine.control.test_sequencer import ramp_and_hold, samples

TURNS = Plan("t", "continuous", 2, ramp_kpa_per_s=10.0, min_dwell_s=1.0)  # opening 6 s, cycles of 10 + 10 s
STAIRS = Plan("t", "staircase", 2, step_kpa=45.0, ramp_kpa_per_s=20.0, max_dwell_s=4.0, reading_timeout_s=5.0)


def at(sequencer: Sequencer, time_s: float, *pressure_kpa: float) -> None:
    """Give samples from a time on, 10 ms apart."""
    sequencer.feed(samples(pressure_kpa, round(time_s * 1e6)))


def reach(sequencer: Sequencer, pressure_kpa: float, arrived_s: float) -> None:
    """Let the pressure arrive, and stay for the plan's shortest hold of 1 s."""
    sequencer.commanded()
    at(sequencer, arrived_s, pressure_kpa)
    at(sequencer, arrived_s + 1.0, pressure_kpa)


def started(plan: Plan = TURNS, **options: object) -> Sequencer:
    """Return a run that began at 1 s."""
    sequencer = Sequencer()
    at(sequencer, 1.0, 0.0)
    sequencer.arm(plan, **options)
    sequencer.start()
    return sequencer


def progress(sequencer: Sequencer) -> Progress:
    found = sequencer.progress()
    assert found is not None
    return found


def counts(sequencer: Sequencer) -> tuple[int, int, int, int, int, tuple[int, ...]]:
    p = progress(sequencer)
    return p.step, p.steps, p.cycle, p.cycles, p.complete_cycles, p.incomplete_cycles


def messages(actions: list[Action]) -> list[ControlEvent]:
    return [action for action in actions if isinstance(action, ControlEvent)]


def test_nothing_runs_before_the_start() -> None:
    """No plan, no steps, no progress; a lone sample changes nothing."""
    sequencer = Sequencer()
    at(sequencer, 1.0, 30.0)
    sequencer.feed(samples([]))
    sequencer.commanded()
    sequencer.reading_given(1)
    sequencer.stop()
    sequencer.cleared()
    assert (sequencer.state, sequencer.plan, sequencer.marks, sequencer.ended) == (SessionState.IDLE, None, [], None)
    assert (sequencer.cycle, sequencer.complete_cycles, sequencer.incomplete_cycles) == (0, 0, ())
    assert (sequencer.progress(), sequencer.waiting(), sequencer.take()) == (None, None, [])
    sequencer.arm(TURNS)
    assert (sequencer.state, sequencer.progress()) == (SessionState.ARMED, None)
    sequencer.disarm()
    assert (sequencer.state, sequencer.take()) == (SessionState.IDLE, [])


def test_actions_of_a_start_a_pause_and_a_stop_in_order() -> None:
    """Each once, in this order; a second look finds none."""
    sequencer = started()
    opening = sequencer.marks[0]
    assert (opening.number, opening.cycle, opening.branch, opening.ramp_kpa_per_s) == (1, 0, "start", 10.0)
    assert sequencer.take() == [
        ControlEvent(MessageKind.RUN_STARTED, "t: 2 cycles"), StepChanged(opening, new=True),
        GoTo(50.0, 10.0, streamed=False),
    ]  # fmt: skip
    assert sequencer.take() == []
    at(sequencer, 2.0, 9.0)
    sequencer.pause()
    aborted, *rest = sequencer.take()
    assert isinstance(aborted, StepChanged)
    assert (aborted.new, aborted.mark.status, aborted.mark.ended_us) == (False, "aborted", 2_000_000)
    assert aborted.mark.detail["pressure_max_kpa"] == 9.0
    paused = ControlEvent(MessageKind.PAUSED, "paused by the operator", "info")
    assert rest == [VentNow(), SegmentBreak("paused", paused=True), paused]
    sequencer.resume()
    resumed = ControlEvent(MessageKind.RESUMED, "resumed by the operator", "info")
    again = sequencer.marks[-1]
    assert again.number == 2
    assert sequencer.take() == [
        SegmentBreak("resumed", paused=False), resumed, StepChanged(again, new=True), GoTo(50.0, 10.0),
    ]  # fmt: skip
    sequencer.stop()
    kinds = [type(action) for action in sequencer.take()]
    assert kinds == [StepChanged, VentNow, RunEnding, StepChanged]
    end = sequencer.marks[-1]
    assert (end.number, end.cycle, end.branch, end.target_kpa, end.ramp_kpa_per_s) == (3, 0, "end", 0.0, 0.0)
    assert (sequencer.ended, sequencer.incomplete_cycles) == (RunEnding(RunEnd.STOPPED), ())


def test_progress_of_a_run_with_a_pause() -> None:
    """Opening 6 s, cycles of 20 s; the pace is the median of the steps taken over the steps planned."""
    sequencer = started()
    assert progress(sequencer) == Progress(1, 5, 0, 2, 0, (), "start", Phase.RAMPING, 50.0, 0.0, 0.0, 46.0)
    at(sequencer, 1.5, 5.0)
    assert progress(sequencer) == Progress(1, 5, 0, 2, 0, (), "start", Phase.RAMPING, 50.0, 0.5, 0.5, 45.5)
    reach(sequencer, 50.0, 7.0)  # 7 s for 6
    assert counts(sequencer) == (2, 5, 1, 2, 0, ())
    assert progress(sequencer).time_left_s == pytest.approx(40 * 7 / 6)
    reach(sequencer, -40.0, 17.0)  # 10 s for 10
    assert progress(sequencer).time_left_s == pytest.approx(30 * 13 / 12)
    at(sequencer, 20.0, 0.0)
    assert progress(sequencer).time_left_s == pytest.approx(30 * 13 / 12 - 2.0)
    reach(sequencer, 50.0, 27.0)  # 10 s for 10
    assert counts(sequencer) == (4, 5, 2, 2, 1, ())
    assert progress(sequencer).time_left_s == pytest.approx(20.0)
    at(sequencer, 30.0, 20.0)
    sequencer.pause()
    assert counts(sequencer) == (4, 7, 2, 3, 1, (2,))
    assert (progress(sequencer).phase, progress(sequencer).time_left_s) == (Phase.VENTING, 20.0)
    at(sequencer, 40.0, 0.0)
    sequencer.resume()
    assert counts(sequencer) == (5, 7, 2, 3, 1, (2,))
    assert progress(sequencer).time_left_s == pytest.approx(26.0)
    assert (progress(sequencer).step_time_s, progress(sequencer).elapsed_s) == (0.0, 39.0)
    for pressure, arrived in ((50.0, 45.0), (-40.0, 55.0), (50.0, 65.0)):
        reach(sequencer, pressure, arrived)
    assert sequencer.ended == RunEnding(RunEnd.FINISHED)
    assert counts(sequencer) == (8, 8, 3, 3, 2, (2,))
    assert (progress(sequencer).time_left_s, progress(sequencer).phase) == (0.0, Phase.VENTING)
    at(sequencer, 70.0, 0.0)
    at(sequencer, 70.5, 0.0)
    assert (sequencer.state, sequencer.progress()) == (SessionState.IDLE, None)
    assert [mark.status for mark in sequencer.marks] == [*["reached"] * 3, "aborted", *["reached"] * 4]
    sequencer.arm(TURNS)  # the counts are those of the new plan, the numbers continue
    assert (sequencer.cycle, sequencer.complete_cycles, sequencer.incomplete_cycles) == (0, 0, ())
    sequencer.start()
    assert (sequencer.ended, sequencer.marks[-1].number) == (None, 9)
    assert progress(sequencer).time_left_s == 46.0
    assert progress(sequencer).elapsed_s == 0.0


def test_overlong_step_counts_no_time_below_zero() -> None:
    """20 s into a step of 6 s: what is left is the two cycles."""
    sequencer = started()
    at(sequencer, 21.0, 30.0)
    assert progress(sequencer).time_left_s == 40.0


@pytest.mark.parametrize(
    ("pressures", "vented"),
    [
        ([(0.0, 2.0), (0.5, -2.0)], True),
        ([(0.0, 0.0), (0.49, 0.0)], False),
        ([(0.0, 0.0), (0.3, 2.1), (0.5, 0.0)], False),
        ([(0.0, 0.0), (0.3, 2.1), (0.5, 0.0), (1.0, 0.0)], True),
        ([(0.0, 0.0), (0.5, float("nan"))], False),
        ([(0.0, -2.1), (0.5, -2.1)], False),
    ],
)
def test_unit_is_vented_after_half_a_second_near_zero(pressures: list[tuple[float, float]], vented: bool) -> None:
    """Within 2 kPa of 0 without a break; a pressure that is not known is not near 0."""
    sequencer = started()
    sequencer.stop()
    for time_s, pressure in pressures:
        at(sequencer, 3.0 + time_s, pressure)
    assert (sequencer.state is SessionState.IDLE) is vented
    assert sequencer.marks[-1].status == ("reached" if vented else "running")


def test_vented_time_counts_from_the_first_low_sample_of_a_block() -> None:
    """A block that falls below 2 kPa at its second sample: half a second from there."""
    sequencer = started()
    sequencer.stop()
    at(sequencer, 3.0, 9.0, 1.0, 1.0)
    at(sequencer, 3.5, 1.0)
    assert sequencer.state is SessionState.FINISHING
    at(sequencer, 3.51, 1.0)
    assert (sequencer.state, sequencer.marks[-1].ended_us) == (SessionState.IDLE, 3_510_000)


def test_vented_time_counts_from_behind_the_last_high_sample_of_a_block() -> None:
    """A block with two high samples: half a second from behind the second."""
    sequencer = started()
    sequencer.stop()
    at(sequencer, 3.0, 9.0, 1.0, 9.0, 1.0)
    at(sequencer, 3.52, 1.0)
    assert sequencer.state is SessionState.FINISHING
    at(sequencer, 3.53, 1.0)
    assert (sequencer.state, sequencer.marks[-1].ended_us) == (SessionState.IDLE, 3_530_000)


@pytest.mark.parametrize(("level", "passed"), [(27.4, False), (27.5, True), (49.0, True)])
def test_plateau_is_held_for_a_level_within_half_a_step(level: float, passed: bool) -> None:
    """Of steps of 45 kPa the plateau at 5 kPa is held for 27.4 kPa, and not for half a step away."""
    sequencer = started(STAIRS)
    sequencer.hold_at([("unloading", level)])
    reach(sequencer, 50.0, 4.0)
    at(sequencer, 8.5, 50.0)  # beyond the longest hold
    assert (sequencer.marks[-1].target_kpa, sequencer.marks[-1].branch) == (5.0, "unloading")
    sequencer.commanded()
    at(sequencer, 12.0, 5.0)
    assert (sequencer.marks[-1].target_kpa == -40.0) is passed


def test_vent_that_does_not_end_is_reported_after_a_minute() -> None:
    """At 60 s not yet; behind it an error with the pressure, and ABORTED without a second ending."""
    sequencer = started()
    at(sequencer, 3.0, 30.0)
    sequencer.stop()
    sequencer.take()
    at(sequencer, 63.0, 30.0)
    assert (sequencer.state, sequencer.take()) == (SessionState.FINISHING, [])
    at(sequencer, 63.01, 30.0)
    changed, event, vent = sequencer.take()
    assert isinstance(changed, StepChanged) and (changed.mark.status, changed.new) == ("timeout", False)
    assert event == ControlEvent(
        MessageKind.VENT_TIMEOUT, "the pressure does not fall: 30.0 kPa after the vent", "error",
        "keep clear of the unit and open its valve manually",
    )  # fmt: skip
    assert (vent, sequencer.state) == (VentNow(), SessionState.ABORTED)


def test_step_that_times_out_names_its_target_and_leaves_its_cycle_out() -> None:
    """From 50 to -40 kPa in 9 s, and 10 s more; the pressure stays at 20 kPa."""
    sequencer = started()
    reach(sequencer, 50.0, 6.0)
    sequencer.commanded()
    sequencer.take()
    at(sequencer, 25.99, 20.0)
    assert messages(sequencer.take()) == []
    at(sequencer, 26.0, 20.0)
    (event,) = messages(sequencer.take())
    assert (event.kind, event.level) == (MessageKind.STEP_TIMEOUT, "error")
    assert event.text == "-40 kPa was not reached in time: 20.0 kPa"
    assert event.remedy == "check for a leak, and that the pump runs; for a slow pump choose a slower ramp"
    assert (sequencer.state, sequencer.ended) == (SessionState.ABORTED, RunEnding(RunEnd.ABORTED, event.text))
    assert (sequencer.incomplete_cycles, sequencer.complete_cycles) == ((1,), 0)
    assert [mark.status for mark in sequencer.marks] == ["reached", "timeout"]


@pytest.mark.parametrize("state", [SessionState.ABORTED, SessionState.FAULT])
def test_abort_while_the_run_ends_marks_the_vent_once(state: SessionState) -> None:
    """The vent's step is aborted, a vent is requested again, and the ending stays what it was."""
    sequencer = started()
    sequencer.stop()
    sequencer.take()
    sequencer.abort("x", state)
    changed, vent = sequencer.take()
    assert isinstance(changed, StepChanged) and changed.mark.status == "aborted"
    assert (vent, sequencer.state, sequencer.ended) == (VentNow(), state, RunEnding(RunEnd.STOPPED))


def test_abort_without_a_run() -> None:
    """The operator's vent discards an armed plan; a fault is a state of its own, left when it is cleared."""
    sequencer = Sequencer()
    sequencer.abort("vent", SessionState.ABORTED)
    assert sequencer.state is SessionState.IDLE
    sequencer.arm(TURNS)
    sequencer.abort("vent", SessionState.ABORTED)
    assert (sequencer.state, sequencer.ended, sequencer.take()) == (SessionState.IDLE, None, [])
    sequencer.abort("latch", SessionState.FAULT)
    assert (sequencer.state, sequencer.ended) == (SessionState.FAULT, None)
    with pytest.raises(RequestError, match="cannot arm in state fault") as caught:
        sequencer.arm(TURNS)
    assert caught.value.remedy == "clear the fault first"
    sequencer.cleared()
    assert sequencer.state is SessionState.IDLE
    with pytest.raises(RequestError, match="cannot pause") as caught:
        sequencer.pause()
    assert caught.value.remedy == ""


def test_plateau_that_drifts_is_reported_by_its_name() -> None:
    """5 mV/s are not steady after the longest hold of 4 s: a warning, and the next step."""
    sequencer = started(STAIRS)
    sequencer.commanded()
    sequencer.take()
    sequencer.feed(samples(ramp_and_hold(50.0, 6.0), 1_010_000, drift_mv_per_s=5.0))
    (event,) = messages(sequencer.take())
    assert event == ControlEvent(
        MessageKind.NOT_STEADY, "the plateau at +50 kPa, first plateau was not steady after 4 s", "warning",
        "its drift is recorded with the step",
    )  # fmt: skip
    sequencer.commanded()
    sequencer.feed(samples(50.0 - ramp_and_hold(45.0, 6.0), 10_000_000, drift_mv_per_s=5.0))
    assert [event.text for event in messages(sequencer.take())] == [
        "the plateau at +5 kPa, cycle 1 was not steady after 4 s"
    ]


def test_reading_is_awaited_given_and_missed() -> None:
    """A plateau waits 5 s at most; a reading for another step ends no wait."""
    sequencer = started(STAIRS, wait_for_reading=True)
    sequencer.commanded()
    assert sequencer.waiting() is None
    readings_s = 9 * 10.0  # each 10 s until some are timed
    assert progress(sequencer).time_left_s == pytest.approx(STAIRS.duration_s + readings_s)
    sequencer.feed(samples(ramp_and_hold(50.0, 3.5), 1_010_000))
    began_us = 1_000_000 + 5_000_000  # arrived after 2 s, 3 s of settling and window
    waiting = sequencer.waiting()
    waited_s = (sequencer._time_us - began_us) / 1e6
    assert waiting is not None
    assert dataclasses.replace(waiting, time_left_s=0.0) == ReadingRequest(1, 0, "start", 50.0, 50.0, 0.0)
    assert waiting.time_left_s == pytest.approx(5.0 - waited_s, abs=0.05)
    sequencer.reading_given(2)
    at(sequencer, 7.0, 50.0)
    assert sequencer.waiting() is not None
    sequencer.reading_given(1)
    at(sequencer, 7.01, *[50.0] * 50)
    assert sequencer.waiting() is None
    assert sequencer.marks[0].status == "reached"
    sequencer.take()
    first_s = sequencer._waits_s[0]
    assert first_s == pytest.approx(1.23, abs=0.01)  # its end is looked for every 0.2 s
    sequencer.commanded()
    sequencer.feed(samples(50.0 - ramp_and_hold(45.0, 11.0), 8_000_000))
    (event,) = messages(sequencer.take())
    assert sequencer.waiting() is None
    assert (event.kind, event.text, event.level) == (
        MessageKind.READING_MISSING, "no reading at +5 kPa, cycle 1", "warning",
    )  # fmt: skip
    assert list(sequencer._waits_s) == [first_s, pytest.approx(5.0, abs=0.05)]
    # the median of the two and of 10 s is 5 s, at the eight plateaus less one that are left
    pace = sorted(sequencer._paces)[0] / 2 + sorted(sequencer._paces)[1] / 2
    left_s = 3 * STAIRS.step_duration_s(5.0, -40.0) + STAIRS.cycle_duration_s
    assert progress(sequencer).time_left_s == pytest.approx(pace * left_s + 7 * sequencer._waits_s[1])


def test_start_before_the_first_sample() -> None:
    """Time and pressure are 0 until the board has sent some."""
    sequencer = Sequencer()
    sequencer.arm(TURNS)
    sequencer.start()
    assert sequencer.marks[0].started_us == 0
    assert (progress(sequencer).time_left_s, progress(sequencer).elapsed_s) == (46.0, 0.0)


def test_step_without_a_way_or_a_hold_gives_no_pace() -> None:
    """The unit is at 50 kPa already, and nothing is held: 0 s planned."""
    plan = dataclasses.replace(TURNS, min_dwell_s=0.0)
    sequencer = Sequencer()
    at(sequencer, 1.0, 50.0)
    sequencer.arm(plan)
    sequencer.start()
    sequencer.commanded()
    at(sequencer, 2.0, 50.0, 50.0)
    assert sequencer.marks[0].status == "reached"
    assert progress(sequencer).time_left_s == pytest.approx(36.0)


def test_reading_given_ahead_is_waited_for_no_more() -> None:
    """Given while the pressure still rises: 10 s less are left; the next plateau asks with its own number."""
    sequencer = started(STAIRS, wait_for_reading=True)
    before_s = progress(sequencer).time_left_s
    sequencer.reading_given(1)
    assert progress(sequencer).time_left_s == pytest.approx(before_s - 10.0)
    sequencer.commanded()
    sequencer.feed(samples(ramp_and_hold(50.0, 4.0), 1_010_000))
    sequencer.commanded()
    sequencer.feed(samples(50.0 - ramp_and_hold(45.0, 4.0), 8_000_000))
    waiting = sequencer.waiting()
    assert waiting is not None
    assert (waiting.step_id, waiting.cycle, waiting.branch, waiting.target_kpa) == (2, 1, "unloading", 5.0)
