"""The latest command reaches the valve, whatever is lost or late on the way, or the caller gets an error."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st

from boat_daq.engine.control.board_commands import GUARDS_S
from boat_daq.engine.snapshot import SessionState
from protocol.base.errors import RequestError
from protocol.link.messages import SetLimits, SetPressure
from protocol.simulator.board import VirtualBoard
from tests.boat_daq.engine.controller_rig import QUICK, ControllerRig
from tests.firmware.conftest import firmware_folder, firmware_program, process  # noqa: F401  fixtures
from tests.firmware.firmware_build import FirmwareProcess

TICK_S = 0.01
SETTLE_S = 8.0  # the slowest change here is 80 kPa at 40 kPa/s, after three transmissions and the delays
RAMP_KPA_PER_S = 40.0


class FirmwareBoard:
    """The C firmware on its simulated plant, as the rig expects a board."""

    def __init__(self, firmware: FirmwareProcess) -> None:
        self._process = firmware
        firmware.transmitted("Z")
        self._out = firmware.boot()

    def receive(self, data: bytes) -> None:
        if data:
            self._out += self._process.receive(data)

    def advance(self, us: int) -> bytes:
        ticks = round(us / 1e6 / TICK_S)
        out, self._out = self._out + (self._process.transmitted(f"G {ticks}") if ticks else b""), b""
        return out

    @property
    def pressure_kpa(self) -> float:
        return int(self._process.request("Q").split()[0]) / 1000


class DelayedBoard:
    """A board behind a line that delays both directions; advanced in steps of the rig."""

    def __init__(self, board: Any, delay_s: float) -> None:
        self._board, self._delay_us, self._now_us = board, round(delay_s * 1e6), 0
        self._to: deque[tuple[int, bytes]] = deque()
        self._back: deque[tuple[int, bytes]] = deque()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._board, name)

    def receive(self, data: bytes) -> None:
        self._to.append((self._now_us + self._delay_us, data))
        if not self._delay_us:
            self._pass_on()

    def _pass_on(self) -> None:
        while self._to and self._to[0][0] <= self._now_us:
            self._board.receive(self._to.popleft()[1])

    def advance(self, us: int) -> bytes:
        self._now_us += us
        self._pass_on()
        self._back.append((self._now_us + self._delay_us, self._board.advance(us)))
        arrived = b""
        while self._back and self._back[0][0] <= self._now_us:
            arrived += self._back.popleft()[1]
        return arrived


def rig_with(board: Any, delay_s: float) -> ControllerRig:
    rig = ControllerRig()
    rig.board = DelayedBoard(board, 0.0)
    rig.control.link_opened(rig.now_ns)
    rig.flush()
    rig.connected()
    rig.run(1.0)
    rig.board._delay_us = round(delay_s * 1e6)
    return rig


def accepted(rig: ControllerRig, button: Callable[[], None]) -> bool:
    try:
        rig.do(button)
    except RequestError:
        rig.flush()
        return False
    return True


COMMANDS = st.one_of(
    st.integers(-35, 45).map(float), st.sampled_from([30.0, 5.0]), st.just("vent"), st.integers(1, 2).map(lambda n: n)
)
ORDERS = st.lists(st.tuples(COMMANDS, st.sampled_from([0.0, 0.0, 0.02, 0.1, 0.3, 1.0])), min_size=2, max_size=6)
DELAYS = st.sampled_from([0.0, 0.01, 0.05, 0.1, 0.2, 0.4, 1.0, 2.0])


def check_latest(board: Any, orders: list[tuple[Any, float]], delay_s: float) -> None:
    """Press the buttons in this order, then wait: the unit is at the last accepted pressure, or vented."""
    rig = rig_with(board, delay_s)
    wanted = 0.0
    for command, wait_s in orders:
        if isinstance(command, float):
            if accepted(rig, lambda kpa=command: rig.control.set_pressure(kpa, RAMP_KPA_PER_S)):
                wanted = command
        elif command == "vent":
            rig.do(rig.control.vent)
            wanted = 0.0
        elif isinstance(board, VirtualBoard):
            rig.fault("ack_lost", command)
        rig.run(wait_s)
    rig.run(SETTLE_S + GUARDS_S + 2 * delay_s)
    if rig.control.interlock.latched is not None:
        wanted = 0.0
    assert rig.pressure_kpa == pytest.approx(wanted, abs=1.5)


ONCE = settings(
    max_examples=settings.default.max_examples // 4,
    phases=(Phase.explicit, Phase.generate),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@pytest.mark.fault(55, how="random orders and delays on the virtual board", times=8)
@ONCE
@given(ORDERS, DELAYS)
@example([(30.0, 0.0), (5.0, 0.0)], 0.0)
@example([(30.0, 0.0), (5.0, 0.1), (20.0, 0.0)], 0.1)
def test_virtual_board_ends_at_the_latest_command(orders: list[tuple[Any, float]], delay_s: float) -> None:
    """Random commands, gaps, lost answers and delays of the line up to 2 s each way."""
    check_latest(VirtualBoard(), orders, delay_s)


@pytest.mark.fault(55, how="random orders and delays on the firmware", times=4)
@settings(ONCE, max_examples=settings.default.max_examples // 8)
@given(orders=ORDERS, delay_s=DELAYS)
@example(orders=[(30.0, 0.0), (5.0, 0.0)], delay_s=0.0)
def test_firmware_ends_at_the_latest_command(
    process: FirmwareProcess,  # noqa: F811
    orders: list[tuple[Any, float]],
    delay_s: float,
) -> None:
    """The same on the C firmware, whose answers are not lost."""
    check_latest(FirmwareBoard(process), orders, delay_s)


def test_manual_pressure_replaces_a_start_that_waits() -> None:
    """Start, then a pressure before the board has answered: no run begins, and the pressure is the manual one."""
    rig = ControllerRig().connected()
    rig.do(lambda: rig.control.arm(QUICK), rig.control.start, lambda: rig.control.set_pressure(5.0))
    rig.run(4.0)
    assert rig.state is SessionState.ARMED
    assert rig.pressure_kpa == pytest.approx(5.0, abs=1.0)


def test_limits_that_change_meanwhile_are_sent_before_the_pressure() -> None:
    """New limits of the unit while a pressure waits for the guards: the board gets them first."""
    rig = ControllerRig().connected()
    rig.do(lambda: rig.control.set_pressure(30.0))
    rig.control.interlock.set_limits("unit", (-20.0, 10.0))
    rig.do(lambda: rig.control.set_pressure(5.0))
    rig.run(4.0)
    assert [command.target_pa for command in rig.sent_of(SetPressure)] == [5000]
    at = rig.sent.index(rig.sent_of(SetPressure)[0])
    assert SetLimits(-20_000, 10_000) in rig.sent[:at]
    assert rig.pressure_kpa == pytest.approx(5.0, abs=1.0)
