"""The virtual board's control: its state, its limits, its watchdog and its commands (protocol/SPEC.md).

Levels are tested on every tick, not edges. The board never leaves its limits on command; it vents by itself beyond a
limit by more than 2 kPa, on a lost heartbeat, an e-stop, a target not reached and a failed pressure sensor; each of
these latches FAULT until CLEAR_FAULT finds its cause gone. VENT is executed in every state.
"""

from __future__ import annotations

from protocol.link import messages
from protocol.link.messages import AckStatus, EventCode
from protocol.recording import BoardState, SampleFlag
from protocol.simulator.plant import PUMP_KPA_PER_S, Pneumatics

HARD_LIMITS_PA = (-45_000, 55_000)  # the lattice buckles below -40 kPa
MARGIN_PA = 2_000
TOLERANCE_PA = 500
TARGET_TIMEOUT_US = 8_000_000  # after the ramp's end, until a target counts as not reached
HEARTBEAT_MS = range(100, 5001)

_MOVING = (BoardState.RAMPING, BoardState.HOLDING)


class BoardControl:
    def __init__(self, pneumatics: Pneumatics, rate_max_hz: int) -> None:
        self.pneumatics = pneumatics
        self.state = BoardState.IDLE
        self.events: list[tuple[EventCode, int]] = []  # until `take_events`
        self.rate_hz = 0  # samples a second; 0 = none
        self.estop = False
        self.pressure_invalid = False
        self._rate_max_hz = rate_max_hz
        self._limits_pa = HARD_LIMITS_PA
        self._timeout_us = 0  # of the watchdog; 0 = not armed
        self._fed_us = 0
        self._deadline_us = 0

    @property
    def flags(self) -> int:
        """The control's share of a sample's flags."""
        flags = SampleFlag.ESTOP if self.estop else SampleFlag(0)
        if self._timeout_us:
            flags |= SampleFlag.WATCHDOG_ARMED
        if self.pressure_invalid:
            flags |= SampleFlag.PRESSURE_INVALID
        return int(flags)

    def take_events(self) -> list[tuple[EventCode, int]]:
        """Return (code, value) of the events since the last call."""
        events, self.events = self.events, []
        return events

    def feed(self, now_us: int) -> None:
        """Feed the watchdog, on a good frame."""
        self._fed_us = now_us

    @property
    def watchdog_us(self) -> int | None:
        """Board time at which the watchdog vents if no frame comes; None where it is not armed, or has vented."""
        armed = self._timeout_us and self.state is not BoardState.FAULT
        return self._fed_us + self._timeout_us if armed else None

    def set_estop(self, pressed: bool, *, announce: bool = True) -> None:
        """Press or release the e-stop; pressed at power-on it is a level without an event."""
        self.estop = pressed
        if pressed:
            self._latch()
        if announce:
            self.events.append((EventCode.ESTOP_PRESSED if pressed else EventCode.ESTOP_RELEASED, 0))

    def set_pressure_invalid(self, invalid: bool) -> None:
        """Fail or restore the pressure sensor; without it nothing can be regulated."""
        self.pressure_invalid = invalid
        if invalid:
            self._latch()

    def tick(self, now_us: int) -> None:
        if self.state is BoardState.FAULT:
            return
        if self.watchdog_us is not None and now_us >= self.watchdog_us:
            self._trip(EventCode.HEARTBEAT_LOST, (now_us - self._fed_us) // 1000)
            return
        pressure_pa = round(self.pneumatics.pressure_kpa * 1000.0)  # the wire's resolution is the sensor's
        if pressure_pa > self._limits_pa[1] + MARGIN_PA:
            self._trip(EventCode.OVER_PRESSURE, pressure_pa)
        elif pressure_pa < self._limits_pa[0] - MARGIN_PA:
            self._trip(EventCode.UNDER_PRESSURE, pressure_pa)
        elif self.state in _MOVING:
            self._follow(now_us, pressure_pa)

    def execute(self, command: messages.Command, now_us: int) -> AckStatus:
        """Execute a command, or return the status that refuses it."""
        match command:
            case messages.Start():
                if not 0 < command.rate_hz <= self._rate_max_hz:
                    return AckStatus.OUT_OF_LIMITS
                self.rate_hz = command.rate_hz
            case messages.Stop():
                self.rate_hz = 0
            case messages.Vent():
                self._vent()
            case messages.SetPressure():
                return self._set_pressure(command, now_us)
            case messages.Heartbeat():
                return self._heartbeat(command)
            case messages.ClearFault():
                return self._clear_fault()
            case messages.SetLimits():
                return self._set_limits(command)
        return AckStatus.DONE

    def _follow(self, now_us: int, pressure_pa: int) -> None:
        """Choose RAMPING or HOLDING, and trip where the target is overdue."""
        near = abs(pressure_pa - round(1000.0 * self.pneumatics.target_kpa)) <= TOLERANCE_PA
        if near and self.pneumatics.setpoint_arrived:
            self.state = BoardState.HOLDING
            self._deadline_us = now_us + TARGET_TIMEOUT_US
        else:
            self.state = BoardState.RAMPING
            if now_us >= self._deadline_us:
                self._trip(EventCode.TARGET_NOT_REACHED, pressure_pa)

    def _trip(self, code: EventCode, value: int) -> None:
        self._latch()
        self.events.append((code, value))

    def _latch(self) -> None:
        self.pneumatics.vent()
        self.state = BoardState.FAULT

    def _vent(self) -> None:
        self.pneumatics.vent()
        if self.state is not BoardState.FAULT:
            self.state = BoardState.VENTED

    def _set_pressure(self, command: messages.SetPressure, now_us: int) -> AckStatus:
        if self.state is BoardState.FAULT:
            return AckStatus.FAULT_LATCHED
        if not self._limits_pa[0] <= command.target_pa <= self._limits_pa[1]:
            return AckStatus.OUT_OF_LIMITS
        target_kpa = command.target_pa / 1000.0
        travel_kpa = abs(target_kpa - self.pneumatics.pressure_kpa)
        self.pneumatics.command(target_kpa, command.ramp_pa_per_s / 1000.0)
        self._deadline_us = now_us + TARGET_TIMEOUT_US + round(1e6 * travel_kpa / self.pneumatics.ramp_kpa_per_s)
        self.state = BoardState.RAMPING
        return AckStatus.DONE

    def _heartbeat(self, command: messages.Heartbeat) -> AckStatus:
        if command.timeout_ms == 0 and self.state not in (BoardState.IDLE, BoardState.VENTED):
            return AckStatus.NOT_IN_THIS_STATE
        if command.timeout_ms != 0 and command.timeout_ms not in HEARTBEAT_MS:
            return AckStatus.OUT_OF_LIMITS
        self._timeout_us = command.timeout_ms * 1000
        return AckStatus.DONE

    def _clear_fault(self) -> AckStatus:
        pressure_pa = self.pneumatics.pressure_kpa * 1000.0
        beyond = not self._limits_pa[0] - MARGIN_PA <= pressure_pa <= self._limits_pa[1] + MARGIN_PA
        if self.state is not BoardState.FAULT or self.estop or self.pressure_invalid or beyond:
            return AckStatus.NOT_IN_THIS_STATE
        self.state = BoardState.VENTED
        return AckStatus.DONE

    def _set_limits(self, command: messages.SetLimits) -> AckStatus:
        """Accept limits inside the hard ones; a target beyond them becomes the new limit."""
        low, high = command.min_pa, command.max_pa
        if not HARD_LIMITS_PA[0] <= low < high <= HARD_LIMITS_PA[1]:
            return AckStatus.OUT_OF_LIMITS
        self._limits_pa = (low, high)
        if self.state in _MOVING:
            target_kpa = self.pneumatics.target_kpa
            inside_kpa = min(max(target_kpa, low / 1000.0), high / 1000.0)
            if inside_kpa != target_kpa:
                self.pneumatics.command(inside_kpa, PUMP_KPA_PER_S)
        return AckStatus.DONE
