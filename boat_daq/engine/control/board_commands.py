"""Commands to one board, and what its answers, refusals and missing answers mean.

A refused command is not done, and a command without an answer is not known to be done: under pressure both are trips. A
vent is repeated until it is acknowledged. Nothing here commands a pressure; `Controller` does.

Whether pressure may be commanded: checks of link, limits, latch and the sensor's zero.

Nothing is repaired here and nothing is overridden: each check that fails has a remedy, and the operator tries again.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from boat_daq.engine.control.interlock import Interlock, Trip
from boat_daq.engine.control.sequencer import ControlEvent, SegmentBreak, StepChanged
from boat_daq.engine.control.watchdog import FAST, LONGEST_MS, REPEAT_MS, REPEATS_WITHIN, Feeder, SpeedMeter
from boat_daq.engine.plan import Plan
from boat_daq.engine.snapshot import MessageKind, RunEnding
from protocol.base.errors import RequestError
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
_LOWER_SPEED = "close other programs on this computer, or lower the speed of a virtual board"
_FIND_LEAK = "check for a leak, and that the pump runs"
_TRIPS: dict[int, tuple[str, str]] = {  # cause and remedy; the kind is BOARD_ and the code's name
    EventCode.OVER_PRESSURE: ("the board vented: over-pressure, {} Pa", "check supply and valve"),
    EventCode.UNDER_PRESSURE: ("the board vented: under-pressure, {} Pa", "check vacuum and valve"),
    EventCode.HEARTBEAT_LOST: ("the board vented: nothing received for {} ms", _LOWER_SPEED),
    EventCode.ESTOP_PRESSED: ("the e-stop was pressed", "release it when it is safe, then clear the fault"),
    EventCode.TARGET_NOT_REACHED: ("the board vented: target not reached, {} Pa", _FIND_LEAK),
}


@dataclass(frozen=True, slots=True)
class Send:
    """Request to send a frame.

    `feeds`: it, or a repeat in its place, has to be sent at once.
    """

    command: Command
    feeds: bool = False


Effect: TypeAlias = Send | StepChanged | SegmentBreak | ControlEvent | RunEnding


class BoardCommands:
    """Sends commands to one board and interprets its answers.

    Parameters
    ----------
    emit : takes every effect, in order.

    Attributes
    ----------
    can_command : False where no pressure can be commanded; then nothing is sent but IDENTIFY, START and STOP.
    can_write : False for a replay; then nothing is sent at all.
    whole_contract : False for firmware behind a text profile, which may have no watchdog and no limits of its own.
    """

    def __init__(self, emit: Callable[[Effect], None]) -> None:
        self._emit = emit
        self.can_command = self.can_write = self.whole_contract = True
        self.feeder = Feeder()
        self.meter = SpeedMeter()
        self.identifying = False
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
        if not hello.simulated:
            self.send(Heartbeat(LONGEST_MS))
        if limits is not None:
            self.send(limits)

    def send(self, command: Command, *, feeds: bool = False) -> None:
        """Send a command, where the link takes it; `feeds` as in `Send`."""
        harmless = isinstance(command, messages.Identify | messages.Start | messages.Stop)
        if not self.can_write or not (self.can_command or harmless):
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

    def tick(self, *, idle: bool) -> None:
        """Repeat a vent, feed the watchdog.

        `idle`: nothing is under pressure and the board is at rest.
        """
        if self._vent_sent_ns is not None and self.now_ns - self._vent_sent_ns > VENT_AGAIN_S * 1e9:
            self.send(Vent())
        if not self.leaving and self.feeder.due(self.now_ns, self.board_us, self.meter.speed):
            off = self.meter.speed > FAST and idle and not self.pending  # costly to feed, and nothing to guard
            feeds = REPEAT_MS * self.meter.speed > REPEATS_WITHIN * self.feeder.armed_ms  # repeats alone come too late
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
        """Return the trip that a refusal means, or report it.

        Parameters
        ----------
        status : the board's reason.
        pressurised : whether the unit may be under pressure.
        """
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
        """Go without a guard that firmware behind a text profile may lack.

        Warn once a pressure is requested.
        """
        if self.pending and isinstance(command, Heartbeat):
            text = "this firmware has no watchdog: it holds its pressure even if this program fails"
            self.note(MessageKind.NO_WATCHDOG, text, "warning", "stay with the unit while it is under pressure")
        self._settle(command)

    def lost(self, command: Command, *, watched: bool) -> Trip | None:
        """Return the trip that a command without an answer means; repeat IDENTIFY."""
        text = f"the board did not answer {_name(command)}, sent three times"
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
        if code in _TRIPS:
            cause, remedy = _TRIPS[code]
            return Trip(MessageKind[f"BOARD_{EventCode(code).name}"], cause.format(value), remedy, float(value))
        if code == EventCode.SENSOR_SATURATED:
            text = f"sensor {value + 1} is saturated"
            self.note(MessageKind.SATURATED, text, "warning", "reduce the light or its gain", value=value + 1)
        elif code == EventCode.SAMPLES_DROPPED:
            text = f"the board dropped {value} samples"
            self.note(MessageKind.DROPPED, text, "warning", "choose a lower rate", value=value)
        return None

    def note(self, kind: MessageKind, text: str, level: str, remedy: str = "", *, value: float | None = None) -> None:
        """Report an event.

        Parameters
        ----------
        level, remedy : of the message for the operator; no message where `level` is empty.
        """
        self._emit(ControlEvent(kind, text, level, remedy, value))


def _name(command: Command) -> str:
    """Return a command's name in the protocol."""
    return messages.COMMAND_TYPES[type(command)].name


ZERO_SAMPLES = 50


@dataclass(frozen=True, slots=True)
class Check:
    """One line: `problem` is empty where all is well."""

    name: str
    problem: str = ""
    remedy: str = ""

    @property
    def ok(self) -> bool:
        """Whether the check is passed."""
        return not self.problem


def require(checks: list[Check]) -> None:
    """Raise what the checks found.

    Raises
    ------
    RequestError : every problem in one sentence, with its remedy.
    """
    failed = [check for check in checks if not check.ok]
    if failed:
        remedies = dict.fromkeys(check.remedy for check in failed if check.remedy)
        raise RequestError("; ".join(check.problem for check in failed), "; ".join(remedies))


class Preflight:
    """Checks before any command to the board.

    Parameters
    ----------
    board : whether the link can command.

    Attributes
    ----------
    why_read_only : why the link cannot command; empty where it can, or the reason is unknown.
    """

    def __init__(self, interlock: Interlock, board: BoardCommands, *, zero_tolerance_kpa: float) -> None:
        self.why_read_only = ""
        self._interlock, self._board = interlock, board
        self._zero_tolerance_kpa = zero_tolerance_kpa
        self.recent_kpa: deque[float] = deque(maxlen=ZERO_SAMPLES)  # the newest pressures of the sensor
        self._no_pressure: tuple[str, str] | None = None  # why the board's limits allow none

    def take_limits(self, low_kpa: float, high_kpa: float) -> None:
        """Keep the board's hard limits.

        Limits that no vented unit is inside of leave no pressure at all.
        """
        usable = low_kpa <= 0 <= high_kpa and low_kpa < high_kpa
        self._interlock.set_limits("board", (low_kpa, high_kpa) if usable else None)
        self._no_pressure = None
        if not usable and self._board.can_command:  # a board that takes no commands has no limits
            limits = f"{low_kpa:g} to {high_kpa:g} kPa"
            text = f"the board's own limits, {limits}, do not include 0 kPa, the pressure of a vented unit"
            self._no_pressure = (text, "check the board's firmware: without usable limits it is read only")
            self._board.note(MessageKind.LIMITS, text, "warning", self._no_pressure[1])

    @property
    def limits_command(self) -> SetLimits | None:
        """The command that sends the limits in force to the board.

        None while none are known.
        """
        limits = self._interlock.limits
        if limits is None:
            return None
        return SetLimits(round(limits.min_kpa * 1000), round(limits.max_kpa * 1000))

    def checks(self, *, up: bool, vented: bool) -> list[Check]:
        """Return the lines of the check before the first pressure.

            Parameters
            ----------
            vented : whether the board reports that it is idle or vented.
        tolerance_kpa : of the sensor's zero.
        """
        latched, limits = self._interlock.latched, self._interlock.limits
        return [
            Check("link") if up else Check("link", "no samples arrive from the board", "check the link"),
            Check("limits") if limits else Check("limits", "no limits are known", "connect a board"),
            Check("fault", latched.cause, latched.remedy or "clear the fault first") if latched else Check("fault"),
            self._zero_check(vented=vented),
        ]

    def _zero_check(self, *, vented: bool) -> Check:
        """Return whether the pressure sensor reads zero on a vented unit."""
        if not self.recent_kpa:
            return Check("zero", "no pressure is known yet", "wait for samples")
        recent_kpa, tolerance_kpa = math.fsum(self.recent_kpa) / len(self.recent_kpa), self._zero_tolerance_kpa
        if not vented:
            return Check("zero", f"the unit is under pressure ({recent_kpa:.1f} kPa)", "vent it first")
        if not abs(recent_kpa) <= tolerance_kpa:
            text = f"the pressure reads {recent_kpa:.2f} kPa on a vented unit (tolerance {tolerance_kpa:g} kPa)"
            return Check("zero", text, "wait until it has vented, or check the zero of the sensor")
        return Check("zero")

    def require_plan(self, plan: Plan) -> None:
        """Refuse a plan outside the limits.

        Raises
        ------
        RequestError : it is outside them, or the link cannot command.
        """
        self.require_command()
        for target_kpa in reversed(plan.extremes_kpa):
            self._interlock.check(target_kpa, new_plan=True)

    def require_command(self) -> None:
        """Refuse where no pressure can be commanded.

        Raises
        ------
        RequestError : the link is read only, or the board's limits allow none.
        """
        if not self._board.can_command:
            why = f": {self.why_read_only}" if self.why_read_only else ""
            raise RequestError(f"this link is read only{why}", "use firmware or a profile that commands pressure")
        if self._no_pressure is not None:
            raise RequestError(*self._no_pressure)
