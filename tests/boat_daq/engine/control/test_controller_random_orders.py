"""Random orders of actions, faults and timings on the virtual board, no threads: no pressure without control."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from boat_daq.engine.snapshot import SessionState
from protocol.base.errors import RequestError
from protocol.link.messages import BootReason, Heartbeat, SetPressure
from tests.boat_daq.engine.controller_rig import QUICK, ControllerRig

LIMITS_KPA = (-40.0, 50.0)
BEYOND_KPA = 2.5  # the contract vents 2 kPa beyond a limit; the valve needs a tick
WATCHDOG_S = 5.0
STEP_S = 0.04  # of host time: what a busy computer reads at once
VENT_S = 1.5  # from 50 kPa to near 0 through the open valve, time constant 0.25 s


class Operators(RuleBasedStateMachine):
    """Whatever is pressed, unplugged or broken: limits hold, no pressure without a host, one end for each run."""

    @initialize(
        speed=st.sampled_from([1.0, 20.0, 100.0]),
        seed=st.integers(0, 1000),
        board_s=st.floats(0, 20),
        going=st.booleans(),
    )
    def begin(self, speed: float, seed: int, board_s: float, going: bool) -> None:
        self.rig = ControllerRig(speed=speed, seed=seed)
        self.rig.control.interlock.set_limits("unit", LIMITS_KPA)
        self.unheard_s = 0.0  # board time since the last byte from the host could arrive
        self.spoiled = False  # a fault changed the pressure, not a command
        self.rig.run(0.5 * speed)
        if going:
            self.initiate_run(board_s)

    def press(self, button: Any, *arguments: Any, **options: Any) -> None:
        """Press a button; a refusal is an answer as well."""
        try:
            self.rig.do(lambda: button(*arguments, **options))
        except RequestError as refusal:
            assert refusal.cause
            self.rig.flush()

    def pass_time(self, host_s: float, steps: int) -> None:
        rig = self.rig
        for _ in range(steps):
            rig.step(host_s / steps)
            heard = rig.plugged and rig.host_alive and not rig.stalled
            self.unheard_s = 0.0 if heard else self.unheard_s + host_s / steps * rig.speed
            self.look()

    def look(self) -> None:
        """What must hold at every instant."""
        rig = self.rig
        if not self.spoiled:
            assert LIMITS_KPA[0] - BEYOND_KPA <= rig.pressure_kpa <= LIMITS_KPA[1] + BEYOND_KPA
        if not self.spoiled and self.unheard_s > WATCHDOG_S + VENT_S:
            assert abs(rig.pressure_kpa) < 2.0, f"{rig.pressure_kpa} kPa without a host"

    # ---- the operator ----------------------------------------------------------------------------------------------

    @rule(wait=st.booleans())
    def arm(self, wait: bool) -> None:
        self.press(self.rig.control.arm, QUICK, wait_for_reading=wait)

    @rule()
    def start(self) -> None:
        self.press(self.rig.control.start)

    @rule(board_s=st.floats(1.0, 12.0))
    def initiate_run(self, board_s: float) -> None:
        """What an operator does most of the time: clear, arm, start, and watch."""
        for button in (self.rig.control.clear_fault, self.rig.control.vent):
            self.press(button)
        self.pass_time(1.5 / self.rig.speed + 0.1, 10)
        self.arm(wait=False)
        self.start()
        self.wait(board_s)

    @rule()
    def pause(self) -> None:
        self.press(self.rig.control.pause)

    @rule()
    def resume(self) -> None:
        self.press(self.rig.control.resume)

    @rule()
    def stop(self) -> None:
        self.press(self.rig.control.stop)
        self.press(self.rig.control.stop)

    @rule()
    def vent(self) -> None:
        self.press(self.rig.control.vent)

    @rule()
    def clear(self) -> None:
        self.press(self.rig.control.clear_fault)

    @rule(kpa=st.floats(-100, 100), ramp=st.floats(0.5, 100))
    def set_pressure(self, kpa: float, ramp: float) -> None:
        self.press(self.rig.control.set_pressure, kpa, ramp)

    @rule()
    def skip_reading(self) -> None:
        waiting = self.rig.control.sequencer.waiting()
        if waiting is not None:
            self.rig.control.sequencer.reading_given(waiting.step_id)

    # ---- time ------------------------------------------------------------------------------------------------------

    @rule(board_s=st.floats(0.01, 4.0))
    def wait(self, board_s: float) -> None:
        self.pass_time(board_s / self.rig.speed, max(2, round(board_s / self.rig.speed / STEP_S)))

    @rule(board_s=st.floats(0.5, 8.0))
    def stall(self, board_s: float) -> None:
        """The host does nothing for a while: one long gap, then all that was buffered at once."""
        self.rig.stalled = True
        self.pass_time(board_s / self.rig.speed, 10)
        self.rig.stalled = False

    # ---- the world -------------------------------------------------------------------------------------------------

    @rule()
    def unplug(self) -> None:
        if self.rig.plugged:
            self.rig.plugged = False
            self.rig.control.link_lost("the port is gone")
            self.rig.flush()

    @precondition(lambda self: not self.rig.plugged)
    @rule()
    def replug(self) -> None:
        self.rig.replug()
        self.unheard_s = 0.0  # the first commands on the fresh link arrive at once

    @rule()
    def estop(self) -> None:
        control = self.rig.board._control
        control.set_estop(not control.estop)

    @rule(reason=st.sampled_from(BootReason))
    def reset(self, reason: BootReason) -> None:
        self.rig.fault("reset", int(reason))

    @rule(status=st.integers(1, 6))
    def refuse_next(self, status: int) -> None:
        self.rig.fault("ack_refused", status)

    @rule(answers=st.integers(1, 4))
    def lose_answers(self, answers: int) -> None:
        self.rig.fault("ack_lost", answers)

    @rule(pressure=st.sampled_from([-60.0, 70.0]))
    def push(self, pressure: float) -> None:
        """Something outside pushes the pressure beyond a limit."""
        self.spoiled = True
        self.rig.fault("beyond_limit", pressure)
        self.pass_time(2.5 / self.rig.speed, 10)
        if not self.rig.board._pneumatics.regulated:
            self.spoiled = abs(self.rig.pressure_kpa) > 2.0
        assert not self.spoiled, "the unit was not vented"

    # ---- what must hold --------------------------------------------------------------------------------------------

    @invariant()
    def one_end_for_each_run(self) -> None:
        if not hasattr(self, "rig"):
            return
        going = self.rig.state in (SessionState.RUNNING, SessionState.PAUSED)
        assert len(self.rig.ends) == len(self.rig.reports(["run_started"])) - going
        assert len(self.rig.reports(["run_ended"])) == len(self.rig.ends)

    @invariant()
    def latched_means_fault(self) -> None:
        if hasattr(self, "rig") and self.rig.control.interlock.latched is not None:
            assert self.rig.state is SessionState.FAULT

    @invariant()
    def a_mark_has_an_end(self) -> None:
        """At most the newest step is open, and only while it runs."""
        if hasattr(self, "rig"):
            open_marks = [m for m in self.rig.marks.values() if m.status == "running"]
            assert len(open_marks) <= (self.rig.state in (SessionState.RUNNING, SessionState.FINISHING))

    def teardown(self) -> None:
        """The host is killed: the unit is at rest soon after, however it was left."""
        if not hasattr(self, "rig"):
            return
        rig = self.rig
        for at, command in enumerate(rig.sent):
            if isinstance(command, SetPressure):
                arming = [c for c in rig.sent[:at] if isinstance(c, Heartbeat)]
                assert arming and arming[-1].timeout_ms, "a pressure without the board's watchdog"
        rig.host_alive = False
        self.pass_time((WATCHDOG_S + VENT_S + 0.5) / rig.speed, 20)
        assert abs(rig.pressure_kpa) < 2.0


ORDERS = settings(
    max_examples=15,
    stateful_step_count=25,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much, HealthCheck.data_too_large],
)


@pytest.mark.fault(24, how="random orders of actions, faults and timings", times=25)
class TestRandomOrders(Operators.TestCase):  # type: ignore[misc, name-defined]
    """What every change must pass."""

    settings = ORDERS


@pytest.mark.fault(24, how="random orders of actions, faults and timings", times=10000)
@pytest.mark.nightly
@pytest.mark.timeout(3 * 3600)
class TestTenThousandRandomOrders(Operators.TestCase):  # type: ignore[misc, name-defined]
    """The same, ten thousand times."""

    settings = settings(ORDERS, max_examples=10_000)
