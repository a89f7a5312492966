"""Profiles in kilopascal on the virtual board: followed, left when nothing follows, waiting for readings."""

from __future__ import annotations

import numpy as np
import pytest

from boat_daq.engine.plan import Plan
from boat_daq.engine.snapshot import MessageKind, Phase, SessionState
from protocol.link.messages import SetPressure
from protocol.recording import Segment
from tests.boat_daq.engine.controller_rig import ControllerRig

SINE = Segment("sine", 10.0, amplitude=8.0, frequency_hz=0.25, periods=1.0)


def plan(*segments: Segment, **changes: object) -> Plan:
    return Plan("profile", "profile", 1, ramp_kpa_per_s=20.0, min_dwell_s=1.0, segments=segments, **changes)


def test_a_sine_of_pressure_is_followed():
    rig = ControllerRig().running(plan(Segment("step", 10.0, hold_s=1.5), SINE))
    assert rig.run(12.0, lambda: rig.state is not SessionState.RUNNING)
    assert rig.ends[0].end == "finished"
    streamed = [command.target_pa / 1000 for command in rig.sent_of(SetPressure)]
    assert max(streamed) == pytest.approx(18.0, abs=0.1)
    assert min(streamed[5:]) == pytest.approx(2.0, abs=0.1)
    assert max(rig.pressures) == pytest.approx(18.0, abs=0.6)
    assert np.abs(np.diff(streamed[5:])).max() < 1.5


def test_ramp_moves_at_its_own_rate_and_marks_carry_the_segment():
    rig = ControllerRig().running(plan(Segment("ramp", 12.0, rate_per_s=3.0, hold_s=0.5)))
    assert rig.run(9.0, lambda: rig.state is not SessionState.RUNNING)
    mark = rig.marks[2]
    assert (mark.status, mark.detail["segment"]["kind"], mark.detail["quantity"]) == ("reached", "ramp", "kPa")
    assert (mark.ended_us - mark.started_us) / 1e6 == pytest.approx(4.5, abs=0.1)


def test_a_pressure_that_does_not_follow_ends_the_run_vented():
    rig = ControllerRig("dead_pump@1").running(plan(Segment("step", 20.0, hold_s=9.0), arrival_timeout_s=2.0))
    assert rig.run(8.0, lambda: rig.state is SessionState.ABORTED)
    assert rig.reports([MessageKind.STEP_TIMEOUT])
    rig.run(2.0)
    assert abs(rig.pressure_kpa) < 1.0


def test_a_segment_with_a_reading_waits_for_it():
    rig = ControllerRig().running(plan(Segment("step", 5.0, hold_s=0.5, reading=True)), wait_for_reading=True)
    assert rig.run(6.0, lambda: rig.control.sequencer.waiting() is not None)
    assert rig.control.sequencer.progress().phase is Phase.WAITING_FOR_READING
    rig.control.sequencer.reading_given(2)
    assert rig.run(2.0, lambda: rig.state is not SessionState.RUNNING)
