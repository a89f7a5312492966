"""Elongation as a setpoint on the virtual board: it follows, it is refused, and it stops with a cause."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.elongation_control.controller import Bounds
from boat_daq.engine.control.elongation import SLOW_ANSWERS
from boat_daq.engine.plan import Plan
from boat_daq.engine.snapshot import MessageKind, SessionState
from protocol.base.errors import RequestError
from protocol.link.messages import SetPressure, Vent
from protocol.recording import Segment
from tests.boat_daq.engine.controller_rig import QUICK, ControllerRig
from tests.boat_daq.engine.regulators import regulator

STOPS = (
    MessageKind.SENSORS_DISAGREE, MessageKind.ELONGATION_UNKNOWN, MessageKind.NOT_FOLLOWING,
    MessageKind.STALE_SAMPLES, MessageKind.LINK_DELAY, MessageKind.ELONGATION_UNCERTAIN,
)  # fmt: skip


def controlled(mm: float = 1.0, *faults: str, hold: bool = False, bounds: Bounds | None = None) -> ControllerRig:
    """Return a rig whose elongation is controlled, and has arrived."""
    rig = ControllerRig(*faults).connected()
    rig.do(lambda: rig.control.control_elongation(mm, regulator(bounds=bounds), hold=hold))
    rig.run(2.5)
    return rig


def stopped(rig: ControllerRig, seconds: float = 6.0) -> MessageKind | None:
    """Step on until the loop opens; return why."""
    rig.run(seconds, lambda: rig.control.loop is None)
    found = rig.reports(STOPS)
    return found[-1].kind if found else None


def test_a_step_settles_on_the_true_elongation():
    rig = controlled(1.0)
    rig.do(lambda: rig.control.control_elongation(2.0))
    found = []
    for _ in range(150):
        rig.step()
        found.append(rig.board.elongation_mm)
    assert np.abs(np.array(found[100:]) - 2.0).max() < 0.05
    assert max(found) < 2.1
    assert rig.control.loop.state().elongation_mm == pytest.approx(2.0, abs=0.05)


def test_pressures_leave_only_through_the_interlock_and_within_its_limits():
    rig = ControllerRig().connected()
    rig.control.interlock.set_limits("unit", (-20.0, 20.0))
    rig.do(lambda: rig.control.control_elongation(3.5, regulator(bounds=Bounds(follow_s=2.0))))
    rig.run(3.0)
    assert max(command.target_pa for command in rig.sent_of(SetPressure)) <= 20_000
    assert stopped(rig) is MessageKind.NOT_FOLLOWING


def test_a_plan_in_millimetres_runs_to_its_end():
    segments = (Segment("step", 1.0, hold_s=1.5), Segment("ramp", 0.0, rate_per_s=0.5, hold_s=0.5))
    plan = Plan("mm", "profile", 1, quantity="mm", min_dwell_s=1.0, segments=segments)
    rig = ControllerRig().connected()
    rig.do(lambda: rig.control.arm(plan, regulator=regulator()), rig.control.start)
    assert rig.run(2.0, lambda: rig.state is SessionState.RUNNING)
    assert rig.run(8.0, lambda: rig.state is SessionState.FINISHING)
    assert rig.marks[2].detail["segment"]["target"] == 1.0
    assert rig.control.sequencer.ended.end == "finished"
    assert rig.control.loop is None
    assert rig.sent_of(Vent)


def test_a_sine_in_millimetres_is_tracked():
    sine = Segment("sine", 0.5, amplitude=1.5, frequency_hz=0.2, periods=2.0)
    plan = Plan("mm", "profile", 1, quantity="mm", min_dwell_s=2.0, segments=(sine,))
    rig = ControllerRig().connected()
    rig.do(lambda: rig.control.arm(plan, regulator=regulator()), rig.control.start)
    assert rig.run(4.0, lambda: rig.control.sequencer.cycle == 1)
    away = []
    for _ in range(450):
        rig.step()
        wanted = rig.control.sequencer.setpoint_mm(rig.board.now_us)
        away.append(rig.board.elongation_mm - wanted[0])
    assert np.sqrt(np.mean(np.square(away[100:]))) < 0.05


def test_what_makes_no_control_is_refused_before_anything_moves():
    rig = ControllerRig().connected()
    plan = Plan("mm", "profile", 1, quantity="mm", segments=(Segment("step", 9.0, hold_s=1.0),))
    for refused, error in (
        (lambda: rig.control.control_elongation(1.0), RequestError),
        (lambda: rig.control.control_elongation(9.0, regulator()), RequestError),
        (lambda: rig.control.arm(plan), RequestError),
        (lambda: rig.control.arm(plan, regulator=regulator()), RequestError),
    ):
        with pytest.raises(error):
            refused()
    assert not rig.sent_of(SetPressure)


def test_a_board_far_faster_than_real_time_is_refused():
    rig = ControllerRig(speed=50.0).connected()
    plan = Plan("mm", "profile", 1, quantity="mm", segments=(Segment("step", 1.0, hold_s=1.0),))
    with pytest.raises(RequestError, match="times real time"):
        rig.control.control_elongation(1.0, regulator())
    rig.control.arm(plan, regulator=regulator())
    with pytest.raises(RequestError, match="times real time"):
        rig.control.start()


@pytest.mark.parametrize(
    ("fault", "kind"),
    [
        ("sensor_disagreement@4:30", MessageKind.SENSORS_DISAGREE),
        ("leak@4:3000", MessageKind.NOT_FOLLOWING),
        ("silent@4", MessageKind.STALE_SAMPLES),
    ],
)
def test_a_fault_stops_the_control_and_vents(fault, kind):
    rig = controlled(2.5, fault)
    assert stopped(rig, 9.0) is kind
    rig.run(2.0)
    assert abs(rig.pressure_kpa) < 2.0


def test_a_stop_holds_the_last_pressure_where_the_operator_chose_so():
    rig = controlled(2.0, "sensor_disagreement@4:30", hold=True)
    before = rig.pressure_kpa
    assert stopped(rig) is MessageKind.SENSORS_DISAGREE
    rig.run(3.0)
    assert rig.pressure_kpa == pytest.approx(before, abs=6.0)
    assert not rig.sent_of(Vent)
    assert "the last pressure is held" in rig.reports(STOPS)[-1].text


def test_a_pump_at_its_limit_is_reported_once():
    rig = controlled(2.5, "stall@4:30")
    rig.run(11.0, lambda: bool(rig.reports([MessageKind.PRESSURE_AT_LIMIT])), step_s=0.04)
    rig.run(1.0)
    assert len(rig.reports([MessageKind.PRESSURE_AT_LIMIT])) == 1
    assert rig.control.loop is not None  # 0.3 mm away: less than what stops it


def test_loss_of_one_sensor_is_reported_and_the_other_carries_on():
    rig = controlled(1.0, "saturate@4:1")
    rig.run(2.0)
    assert [note.value for note in rig.reports([MessageKind.SENSOR_LOST])] == [1]
    assert rig.control.loop is not None
    assert rig.board.elongation_mm == pytest.approx(1.0, abs=0.1)


def test_answers_later_than_the_margin_stop_the_control():
    rig = controlled(1.0)
    loop = rig.control.loop
    for _ in range(SLOW_ANSWERS):
        loop.sent(rig.now_ns)
        loop.answered(rig.now_ns + 600_000_000, 1.0)
    assert stopped(rig) is MessageKind.LINK_DELAY


def test_vent_manual_pressure_and_trip_open_the_loop():
    for end in (
        lambda rig: rig.control.vent(),
        lambda rig: rig.control.set_pressure(5.0),
        lambda rig: rig.fault("estop", 0.0),
        lambda rig: rig.control.stop(),
    ):
        rig = controlled(1.0)
        rig.do(lambda end=end, rig=rig: end(rig))
        rig.run(0.5)
        assert rig.control.loop is None


def test_a_plan_in_kilopascal_waits_for_the_unit_to_be_vented():
    rig = controlled(1.0)
    rig.do(lambda: rig.control.arm(QUICK))
    with pytest.raises(RequestError, match="not vented"):
        rig.control.start()
    assert rig.control.loop is not None
