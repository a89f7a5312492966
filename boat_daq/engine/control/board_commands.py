"""Commands to one board, and what its answers, refusals and missing answers mean.

A refused command is not done, and a command without an answer is not known to be done: under pressure both are trips. A
vent is repeated until it is acknowledged. Nothing here commands a pressure; `Controller` does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from boat_daq.engine.control.sequencer import ControlEvent, SegmentBreak, StepChanged
from boat_daq.engine.control.trips import Trip, trip_of_event
from boat_daq.engine.control.watchdog import FAST, LONGEST_MS, REPEAT_MS, REPEATS_WITHIN, Feeder, SpeedMeter
from boat_daq.engine.snapshot import MessageKind, RunEnding
from protocol.link import messages
from protocol.link.messages import AckStatus, Command, EventCode, Heartbeat, SetLimits, Vent

VENT_AGAIN_S = 0.75  # the link itself has repeated it three times by then
GUARDS_S = 5.0  # for the answers to watchdog and limits, each sent three times in 0.75 s, behind other commands

_REFUSALS: dict[int, str] = {
    AckStatus.UNKNOWN_COMMAND: "unknown command",
    AckStatus.WRONG_LENGTH: "wrong length of the command",
    AckStatus.OUT_OF_LIMITS: "out of its limits",
    AckStatus.NOT_IN_THIS_STATE: "not possible in its present state",
    AckStatus.FAULT_LATCHED: "it has latched a fault",
    AckStatus.NOT_SUPPORTED: "command not supported",
}
_NO_START: dict[int, str] = {
    AckStatus.OUT_OF_LIMITS: "choose a lower rate in the settings",
    AckStatus.FAULT_LATCHED: "clear the board's fault, by its own switch or by its supply, then try again",
    AckStatus.NOT_IN_THIS_STATE: "switch the board off and on, then try again",
}
_GUARD = {
    SetLimits: "no pressure without limits: check those of unit and plan, and the board's firmware",
    Heartbeat: "no pressure without a watchdog: check the board's firmware",
}


@dataclass(frozen=True, slots=True)
class Send:
    """Request to send a frame. `feeds`: it, or a repeat in its place, has to be sent at once."""

    command: Command
    feeds: bool = False


Effect: TypeAlias = Send | StepChanged | SegmentBreak | ControlEvent | RunEnding


class BoardCommands:
    """Sends commands to one board and interprets its answers.

    `can_command`: False where no pressure can be commanded; then nothing is sent but IDENTIFY, START and STOP.
    `whole_contract`: False for firmware behind a text profile, which may have no watchdog and no limits of its own.
    """

    def __init__(self, emit: Callable[[Effect], None]) -> None:
        self._emit = emit
        self.can_command = self.whole_contract = True
        self.feeder = Feeder()
        self.meter = SpeedMeter()
        self.identifying = False
        self._simulated = False
        self.stopping = False  # a STOP waits for its answer
        self.leaving = False  # the watchdog is being disarmed: nothing arms it again
        self.start_refused: tuple[str, str] | None = None  # cause and remedy
        self.now_ns = self.introduced_ns = 0
        self.board_us = 0  # of the newest sample
        self._vent_sent_ns: int | None = None  # of a vent that is not acknowledged
        self._awaited: list[Command] = []
        self._pending_since_ns = 0
        self._limits: SetLimits | None = None  # among those awaited
        self._then: Callable[[], None] | None = None

    def begin(self) -> None:
        """Request identification; answers awaited on an earlier port are given up."""
        self.restart()
        self._vent_sent_ns = None
        self.send(messages.Identify())

    def restart(self) -> None:
        """Discard what a board that restarts has lost."""
        self.start_refused, self.leaving = None, False
        self.feeder, self.meter = Feeder(), SpeedMeter()
        self.identifying, self._adopted = True, False
        self.forget_pending()

    def introduce(self, hello: messages.Hello, limits: SetLimits | None) -> None:
        """Answer a HELLO with watchdog and limits.

        The watchdog of a virtual board, which may run faster than real time, waits until its speed is known.
        """
        self.identifying, self.introduced_ns = False, self.now_ns
        self._simulated = hello.simulated
        if not hello.simulated:
            self.send(Heartbeat(LONGEST_MS))
        if limits is not None:
            self.send(limits)

    def send(self, command: Command, *, feeds: bool = False) -> None:
        """Send a command, where the link takes it; `feeds` as in `Send`."""
        harmless = isinstance(command, messages.Identify | messages.Start | messages.Stop)
        if not (self.can_command or harmless):
            return
        if isinstance(command, Vent):
            self.vent_sent()
        self.stopping = isinstance(command, messages.Stop) or self.stopping
        self.feeder.sent(command, self.now_ns, self.board_us)
        self._emit(Send(command, feeds))

    def vent_sent(self) -> None:
        """Note that a vent has just been sent."""
        self._vent_sent_ns = self.now_ns
        self.feeder.sent(Vent(), self.now_ns, self.board_us)

    def vent(self) -> None:
        """Vent, unless a vent is unacknowledged."""
        if not self.venting:
            self.send(Vent())

    @property
    def venting(self) -> bool:
        """Whether a vent waits for its acknowledgement."""
        return self._vent_sent_ns is not None

    @property
    def pending(self) -> bool:
        """Whether an action waits for watchdog and limits."""
        return self._then is not None

    def once_guarded(self, limits: SetLimits, then: Callable[[], None]) -> None:
        """Call `then` once the board has acknowledged watchdog and limits; it replaces an action that waits."""
        if self._then is None:
            self._pending_since_ns = self.now_ns
        self._then = then
        if self._awaited and self._limits == limits:
            return
        guards: list[Command] = [Heartbeat(self.feeder.timeout_ms(self.meter.speed)), limits]
        self._awaited, self._limits = list(guards), limits
        for command in guards:
            self.send(command)

    @property
    def guards_late(self) -> bool:
        """Whether an action has waited `GUARDS_S` for watchdog and limits."""
        return self._then is not None and self.now_ns - self._pending_since_ns > GUARDS_S * 1e9

    def adopt_watchdog(self) -> None:
        """Feed a watchdog that an earlier host has armed, or it trips again.

        That begins once the board's speed is known.
        """
        if self._adopted or self.feeder.armed_ms or not self.meter.known:
            return
        self._adopted = True
        self.send(Heartbeat(self.feeder.timeout_ms(self.meter.speed)))

    def forget_pending(self) -> None:
        """Cancel what waits for watchdog and limits."""
        self._awaited, self._then = [], None

    def tick(self, *, idle: bool, unread: bool = False) -> None:
        """Repeat a vent, feed the watchdog.

        `idle`: nothing is under pressure and the board is at rest. `unread`: the port is read late, and with it the
        answers that repeats wait for.
        """
        if self._vent_sent_ns is not None and self.now_ns - self._vent_sent_ns > VENT_AGAIN_S * 1e9:
            self.send(Vent())
        if not self.leaving and self.feeder.due(self.now_ns, self.board_us, self.meter.speed):
            fast = self._simulated and self.meter.speed > FAST  # a real board's samples may also come late, in a burst
            off = fast and idle and not self.pending  # costly to feed, and nothing to guard
            feeds = (
                unread or REPEAT_MS * self.meter.speed > REPEATS_WITHIN * self.feeder.armed_ms
            )  # repeats alone come too late
            self.send(Heartbeat(0 if off else self.feeder.armed_ms), feeds=feeds)

    def done(self, command: Command) -> None:
        """Take an acknowledgement."""
        if isinstance(command, Vent):
            self._vent_sent_ns = None
        elif isinstance(command, Heartbeat):
            self.feeder.armed_ms = command.timeout_ms
        elif isinstance(command, messages.Stop):
            self.stopping = False
        elif isinstance(command, messages.Start):
            self.start_refused = None
        self._settle(command)

    def _settle(self, command: Command) -> None:
        """Call what waits once the last guard is acknowledged."""
        if self._then is not None and command in self._awaited:
            self._awaited.remove(command)
            if not self._awaited:
                then, self._then = self._then, None
                then()

    def refused(self, command: Command, status: AckStatus | int, *, pressurised: bool) -> Trip | None:
        """Return the trip that a refusal means, or report it."""
        text = f"the board refused {_name(command)}: {_REFUSALS.get(status, str(status))}"
        if isinstance(command, Heartbeat):
            self.feeder.refused(command)
        if status == AckStatus.NOT_SUPPORTED and not self.whole_contract and isinstance(command, Heartbeat | SetLimits):
            self._do_without(command)
            return None
        match command:
            case messages.SetPressure():
                return Trip(MessageKind.REFUSED, text, "check the limits, then clear the fault")
            case Heartbeat(0):
                pass  # the board keeps its watchdog
            case Heartbeat() | SetLimits() if self.pending or pressurised:
                return Trip(MessageKind.REFUSED, text, _GUARD[type(command)])
            case Heartbeat() | SetLimits():  # an error only once a pressure is requested
                self.note(MessageKind.REFUSED, text, "info", _GUARD[type(command)])
            case Vent():
                self.note(MessageKind.REFUSED, text, "error", "open the valve manually")
            case messages.ClearFault():
                self.note(MessageKind.REFUSED, text, "error", "remove the cause of the fault first")
            case messages.Stop():
                self.stopping = False  # the board sends no samples anyway
            case messages.Start() if self.meter.known:
                pass  # it samples already
            case messages.Start(rate_hz):
                unknown = "the board's firmware must know START: update it, or give its profile"
                self.start_refused = (f"{text}, at {rate_hz} Hz", _NO_START.get(status, unknown))
                self.note(MessageKind.REFUSED, text, "")  # reported where samples are missed
            case _:
                self.note(MessageKind.REFUSED, text, "error")
        return None

    def _do_without(self, command: Command) -> None:
        """Go without a guard that firmware behind a text profile may lack. Warn once a pressure is requested."""
        if self.pending and isinstance(command, Heartbeat):
            text = "this firmware has no watchdog: it holds its pressure even if this program fails"
            self.note(MessageKind.NO_WATCHDOG, text, "warning", "stay with the unit while it is under pressure")
        self._settle(command)

    def lost(self, command: Command, *, watched: bool) -> Trip | None:
        """Return the trip that a command without an answer means; repeat IDENTIFY."""
        text = f"the board did not answer {_name(command)} within {VENT_AGAIN_S:g} s"
        match command:
            case Vent():
                pass  # `tick` repeats it: one more for each that is lost would fill a slow link
            case messages.Identify():
                if self.identifying:
                    self.send(messages.Identify())
            case messages.Stop():
                self.stopping = False
            case _ if watched:
                return Trip(MessageKind.NO_ANSWER, text, "check the link")
            case messages.Start():
                self.note(MessageKind.NO_ANSWER, text, "error", "check the link")
            case _:
                pass  # sent to a board that has restarted, or gone, since
        return None

    def board_event(self, code: EventCode | int, value: int) -> Trip | None:
        """Return the trip that an event of the board means, or report it."""
        if (trip := trip_of_event(code, value)) is not None:
            return trip
        if code == EventCode.SENSOR_SATURATED:
            text = f"sensor {value + 1} is saturated"
            self.note(MessageKind.SATURATED, text, "warning", "reduce the light or its gain", value=value + 1)
        elif code == EventCode.SAMPLES_DROPPED:
            text = f"the board dropped {value} samples"
            self.note(MessageKind.DROPPED, text, "warning", "choose a lower rate", value=value)
        return None

    def note(self, kind: MessageKind, text: str, level: str, remedy: str = "", *, value: float | None = None) -> None:
        """Report an event."""
        self._emit(ControlEvent(kind, text, level, remedy, value))


def _name(command: Command) -> str:
    return messages.COMMAND_TYPES[type(command)].name
