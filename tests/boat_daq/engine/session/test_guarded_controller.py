"""The controller under its lock: who waits for whom, and a vent that crosses a pressure on its way to the port."""

from __future__ import annotations

import threading
from collections.abc import Callable

from boat_daq.engine.session import guarded_controller
from boat_daq.engine.session.guarded_controller import GuardedController
from boat_daq.engine.session.journal import Journal
from protocol.link.messages import Command, SetPressure, Vent

PRESSURE = SetPressure(30_000, 10_000)


class Port:
    """What leaves for the board, in order; `while_sending` runs before a command has left."""

    def __init__(self) -> None:
        self.left: list[Command] = []
        self.while_sending: Callable[[Command], None] = lambda _: None
        self.works = True

    def __call__(self, command: Command, _feeds: bool) -> bool:
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
    """Of vents within 100 ms one leaves; behind a pressure, or later, the next leaves too."""
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
