"""A rig without threads, ports or clocks: the virtual board, the link and the controller, advanced step by step."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from boat_daq.engine.control.board_commands import Send
from boat_daq.engine.control.controller import Controller
from boat_daq.engine.control.sequencer import ControlEvent, SegmentBreak, StepChanged
from boat_daq.engine.plan import Plan
from boat_daq.engine.snapshot import RunEnding, SessionState
from protocol.link.connection import Connection
from protocol.link.messages import Command
from protocol.simulator.board import VirtualBoard
from protocol.simulator.faults import make_fault, parse_fault

QUICK = Plan(
    name="quick", kind="staircase", cycles=1, step_kpa=45.0, ramp_kpa_per_s=20.0,
    settling_s=0.3, window_s=0.5, min_dwell_s=0.8, max_dwell_s=5.0, signal_drift_mv_per_s=8.0,
)  # fmt: skip


class ControllerRig:
    """One board on a table, at `speed` times real time; `step` moves both clocks on.

    Attributes
    ----------
    host_alive : False kills the host: nothing is received, nothing sent.
    stalled : True stops the host; what the board sends waits for it.
    plugged : False cuts both directions.
    pressures : true gauge pressure (kPa) after every step.
    """

    def __init__(
        self, *faults: str, speed: float = 1.0, seed: int = 0, rate_hz: int = 100, specimen: str = "SA1"
    ) -> None:
        self.board = VirtualBoard(specimen, seed=seed, faults=[parse_fault(fault) for fault in faults])
        self.link = Connection(in_turn=True)
        self.control = Controller(rate_hz=rate_hz)
        self.speed = speed
        self.now_ns = 1_000_000_000
        self.host_alive = self.plugged = True
        self.stalled = False
        self.buffer = b""
        self.sent: list[Command] = []
        self.marks: dict[int, object] = {}
        self.notes: list[ControlEvent] = []
        self.ends: list[RunEnding] = []
        self.breaks: list[SegmentBreak] = []
        self.pressures: list[float] = []
        self.control.link_opened(self.now_ns)
        self.flush()

    @property
    def state(self) -> SessionState:
        return self.control.sequencer.state

    @property
    def pressure_kpa(self) -> float:
        """True pressure, not as measured."""
        return self.board.pressure_kpa

    def fault(self, name: str, value: float) -> None:
        """Have a fault of `protocol.simulator.faults` begin now."""
        self.board._begin(make_fault(name, self.board.now_us / 1e6, value))

    def flush(self) -> None:
        """Carry the controller's effects out."""
        for effect in self.control.take():
            match effect:
                case Send(command, feeds):
                    self.sent.append(command)
                    send = self.link.feed if feeds else self.link.send
                    data = send(command, self.now_ns)
                    if self.plugged and self.host_alive:
                        self.board.receive(data)
                case StepChanged(mark):
                    self.marks[mark.number] = mark
                case ControlEvent():
                    self.notes.append(effect)
                case RunEnding():
                    self.ends.append(effect)
                case SegmentBreak():
                    self.breaks.append(effect)

    def step(self, host_s: float = 0.02) -> None:
        """Let `host_s` of host time pass, `speed` times that on the board."""
        self.now_ns += round(host_s * 1e9)
        data = self.board.advance(round(host_s * self.speed * 1e6))
        self.pressures.append(self.pressure_kpa)
        if not self.host_alive:
            return
        if self.stalled:
            self.buffer += data
            return
        data, self.buffer = self.buffer + data, b""
        if self.plugged and data:
            self.control.events(self.link.receive(data, self.now_ns), self.now_ns)
            self.flush()
        lost, again = self.link.poll(self.now_ns)
        if self.plugged:
            self.board.receive(again)
        self.control.events(lost, self.now_ns)
        self.control.tick(self.now_ns)
        self.flush()

    def replug(self) -> None:
        """The same board is there again, on a fresh link."""
        self.plugged = True
        self.link = Connection(in_turn=True)
        self.board.advance(0)
        self.control.link_opened(self.now_ns)
        self.flush()

    def do(self, *buttons: Callable[[], None]) -> None:
        """Press buttons, then carry out what follows."""
        for button in buttons:
            button()
        self.flush()

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False, *, step_s: float = 0.02) -> bool:
        """Step on for `seconds` of board time, or until the condition holds; returns whether it did."""
        for _ in range(round(seconds / step_s / self.speed)):
            if until():
                return True
            self.step(step_s)
        return until()

    def connected(self) -> ControllerRig:
        """Step on until samples come and their pace is known."""
        assert self.run(5.0 * self.speed, lambda: self.control.up)
        return self

    def running(self, plan: Plan = QUICK, **options: object) -> ControllerRig:
        """Connect, arm and start."""
        self.connected()
        self.do(lambda: self.control.arm(plan, **options), self.control.start)
        assert self.run(2.0 * self.speed, lambda: self.state is SessionState.RUNNING)
        return self

    def sent_of(self, kind: type[Command]) -> list[Command]:
        return [command for command in self.sent if isinstance(command, kind)]

    def reports(self, kinds: Iterable[str]) -> list[ControlEvent]:
        return [note for note in self.notes if note.kind in kinds]
