"""The controller under its lock: who waits for whom, and a vent that crosses a pressure on its way to the port."""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from boat_daq.engine.control.preflight import Check
from boat_daq.engine.plan import Plan
from boat_daq.engine.session import guarded_controller
from boat_daq.engine.session.guarded_controller import GuardedController
from boat_daq.engine.session.journal import Journal
from protocol.base.errors import RequestError
from protocol.link.messages import Command, SetPressure, Vent

PRESSURE = SetPressure(30_000, 10_000)
PLAN = Plan("short", "staircase", 2)
SPACE = Check("space")


class Port:
    """What leaves for the board, in order; `while_sending` runs before a command has left."""

    def __init__(self) -> None:
        self.left: list[Command] = []
        self.while_sending: Callable[[Command], None] = lambda _: None
        self.works = True

    def __call__(self, command: Command, feeds: bool) -> bool:
        assert not feeds  # a heartbeat alone is written past the turn of others
        self.while_sending(command)
        self.left.append(command)
        return self.works


def guarded() -> tuple[GuardedController, Port]:
    port = Port()
    return GuardedController(Journal(), port), port


def set_pressure(control: GuardedController) -> None:
    with control.acting() as controller:
        controller.board.send(PRESSURE)


def test_one_thread_acts_at_a_time() -> None:
    """A second thread waits until the first has decided and its commands have left."""
    control, port = guarded()
    inside: list[str] = []
    busy, end = threading.Event(), threading.Event()

    def first() -> None:
        with control.acting() as controller:
            controller.board.send(PRESSURE)
            busy.set()
            end.wait(5)
            inside.append("first")

    def second() -> None:
        with control.acting():
            inside.append(f"second after {len(port.left)}")

    threads = [threading.Thread(target=first), threading.Thread(target=second)]
    threads[0].start()
    assert busy.wait(5)
    threads[1].start()
    threads[1].join(0.1)
    assert inside == []
    end.set()
    for thread in threads:
        thread.join(5)
    assert inside == ["first", "second after 1"]


def test_vent_before_a_pressure_that_is_being_sent_is_repeated() -> None:
    """VENT does not wait for the lock: it left first, the pressure behind it, so it is sent once more."""
    control, port = guarded()
    vents: list[threading.Thread] = []

    def vent_meanwhile(command: Command) -> None:
        if isinstance(command, SetPressure):
            vents.append(threading.Thread(target=control.vent))
            vents[0].start()
            while Vent() not in port.left:
                vents[0].join(0.01)

    port.while_sending = vent_meanwhile
    set_pressure(control)
    vents[0].join(5)
    assert port.left == [Vent(), PRESSURE, Vent()]


def test_pressure_that_leaves_while_a_vent_is_sent_is_vented() -> None:
    """Another thread has commanded a pressure between the vent and the lock."""
    control, port = guarded()
    pressures = [PRESSURE]

    def press_meanwhile(command: Command) -> None:
        if isinstance(command, Vent) and pressures:
            pressures.pop()
            set_pressure(control)

    port.while_sending = press_meanwhile
    control.vent()
    assert port.left[0] == PRESSURE
    assert port.left[1:] == [Vent(), Vent()]


def test_vent_alone_is_sent_once_and_again_where_it_could_not_be() -> None:
    """Nothing crosses it: one frame. The port did not take it: the controller sends it."""
    control, port = guarded()
    control.vent()
    assert port.left == [Vent()]
    control, port = guarded()
    port.works = False
    control.vent()
    assert port.left == [Vent(), Vent()]


def test_vents_of_one_instant_are_one_and_a_pressure_between_them_makes_two(monkeypatch) -> None:
    """Of vents within 100 ms one leaves, of several threads too; behind a pressure, or later, the next leaves too."""
    now_s = [1000.0]
    monkeypatch.setattr(guarded_controller.time, "monotonic", lambda: now_s[0])
    control, port = guarded()
    for later_s in (0.0, 0.09):
        now_s[0] = 1000.0 + later_s
        control.vent()
    assert port.left == [Vent()]
    set_pressure(control)
    control.vent()
    assert port.left == [Vent(), PRESSURE, Vent()]
    now_s[0] += 0.11
    control.vent()
    assert port.left[-2:] == [Vent(), Vent()]
    now_s[0] += 0.11
    threads = [threading.Thread(target=control.vent) for _ in range(4)]
    port.while_sending = lambda _: time.sleep(0.1)  # so that the others come meanwhile
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(5)
    assert len(port.left) == 5


# ---- arming and starting a recorded run ------------------------------------------------------------------------------


class Recorder:
    """What is stated in the recording."""

    def __init__(self) -> None:
        self.meta: dict[str, object] = {}
        self.resumed: list[tuple[str, int, int]] = []
        self.asked = False  # whether it saves

    def require_saving(self) -> None:
        self.asked = True

    def update_meta(self, **meta: object) -> None:
        self.meta |= meta

    def run_resumed(self, cause: str, *, first_cycle: int, complete_cycles: int) -> None:
        self.resumed.append((cause, first_cycle, complete_cycles))


def recorded(monkeypatch, *, broken: bool = False) -> tuple[GuardedController, Recorder, list[object]]:
    """A controller that records, its recorder, and what the controller was asked to arm and start."""
    control, _ = guarded()
    control.controller.interlock.set_limits("board", (-60.0, 80.0))
    recorder, asked = Recorder(), []
    control._journal.recorder = recorder
    control._journal.broken = SimpleNamespace(path=Path("run.boat"), check_plan=asked.append) if broken else None
    monkeypatch.setattr(control.controller, "arm", lambda plan, **known: asked.append(known["resume_at"]))
    monkeypatch.setattr(control.controller, "start", asked.append)
    return control, recorder, asked


def arm(control: GuardedController, *, resume: bool) -> None:
    control.arm(PLAN, wait_for_reading=False, resume=resume, regulator=None, hold=False)


def test_a_new_run_is_stated_in_its_recording(monkeypatch) -> None:
    """Plan and limits; it begins at the first cycle, and its start is no resumption."""
    control, recorder, asked = recorded(monkeypatch)
    arm(control, resume=False)
    assert recorder.meta == {"plan": dataclasses.asdict(PLAN), "limits_pa": [-60_000, 80_000]}
    assert recorder.asked
    control.start(SPACE)
    assert asked == [(1, 0), [SPACE]]
    assert recorder.resumed == []


def test_a_run_that_is_not_recorded_is_armed_too(monkeypatch) -> None:
    control, recorder, asked = recorded(monkeypatch)
    control._journal.recorder = None
    arm(control, resume=False)
    control.start(SPACE)
    assert asked == [(1, 0), [SPACE]]
    assert recorder.meta == {}


def test_a_resumed_run_is_stated_at_its_start_once(monkeypatch) -> None:
    """With the cycle that it begins at and those that are complete; its plan is that of the file."""
    control, recorder, asked = recorded(monkeypatch, broken=True)
    monkeypatch.setattr(guarded_controller, "resume_point", lambda plan, marks: (2, 1))
    arm(control, resume=True)
    assert recorder.meta == {}
    control.start(SPACE)
    assert asked == [PLAN, (2, 1), [SPACE]]
    assert recorder.resumed == [("interrupted", 2, 1)]
    control.start(SPACE)
    assert len(recorder.resumed) == 1


def test_an_interrupted_run_is_only_resumed_in_its_recording(monkeypatch) -> None:
    """Another run there is refused, and a resumption of one that has all its cycles."""
    control, recorder, asked = recorded(monkeypatch, broken=True)
    with pytest.raises(RequestError, match=r"run\.boat holds an interrupted run"):
        arm(control, resume=False)
    monkeypatch.setattr(guarded_controller, "resume_point", lambda plan, marks: (3, 2))
    with pytest.raises(RequestError, match="has all its cycles"):
        arm(control, resume=True)
    assert asked == [PLAN, PLAN]
    assert (recorder.meta, recorder.resumed) == ({}, [])
