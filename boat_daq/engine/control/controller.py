"""The controller: link events and the operator's actions in, effects out. No thread, no port, no clock of its own.

    link events, the operator's actions, the time  ->  Controller  ->  effects, in order

It joins the sequencer (what next), the interlock (whether at all) and the commands to the board, and keeps the rules
between them: a pressure is sent only as `Interlock.authorise` returns it, and only once the board has acknowledged
limits and watchdog; whatever trips, vents, and latches. The same object runs behind a serial port and in the tests,
where a virtual board answers it without a thread.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from boat_daq.engine.control.board_commands import GUARDS_S, BoardCommands, Effect
from boat_daq.engine.control.elongation import AT_LIMIT_S, FASTEST, ElongationLoop, LoopStop, Regulator
from boat_daq.engine.control.interlock import FlatLine, Interlock, PressureWatch, SensorAlarms
from boat_daq.engine.control.preflight import Check, Preflight, require
from boat_daq.engine.control.sequencer import VENTED_KPA, GoTo, Sequencer, VentNow
from boat_daq.engine.control.trips import Trip
from boat_daq.engine.control.watchdog import REPEAT_MS, UNREAD_S, StreamWatch
from boat_daq.engine.plan import Plan
from boat_daq.engine.sample_columns import Columns, columns, last_sample, passed_us
from boat_daq.engine.snapshot import LastSample, MessageKind, RunEnding, SessionState
from protocol.base.errors import RequestError, cause_and_remedy
from protocol.link import messages
from protocol.link.events import (
    BoardEventReceived,
    BoardRestarted,
    ClockWentBack,
    CommandDone,
    CommandLost,
    HelloReceived,
    Samples,
)
from protocol.recording import BoardState, SampleFlag

CLOCK_STEP_S = 2.0  # of the board beyond the time that the host has waited: a longer one is another clock
BOOT_S = 0.2  # after the first HELLO: a second one, with no sample yet, is a boot
MANUAL_RAMP_KPA_PER_S = 10.0

NO_REGULATOR = (
    "the elongation of this unit cannot be controlled: it has no accepted calibration, or is not identified",
    "accept a calibration of this unit, and identify its hysteresis from that run",
)
_BUSY = "close other programs on this computer"
ALLOW_PRIORITY = "let its administrator allow this user a higher priority (nice -10)"
_EARLIER_FAULT = (
    "the board had vented and latched a fault before it was connected: its host may have failed under pressure"
)
_ASLEEP = "check its firmware; a computer that was suspended has to be kept awake in a run"
_VENT_LATER = "open the valve manually; VENT is sent once the board is connected again"
_AT_REST = (BoardState.IDLE, BoardState.VENTED)
_ACTIVE = (BoardState.RAMPING, BoardState.HOLDING)
_WATCHDOG_ARMED = int(SampleFlag.WATCHDOG_ARMED)  # a plain integer: compared for every block
_RUN = (SessionState.RUNNING, SessionState.PAUSED)


class Controller:
    """One board under control. `rate_hz`: samples per second to request; the board's highest where that is less."""

    def __init__(self, *, rate_hz: int = 100, zero_tolerance_kpa: float = 1.0) -> None:
        self.stream = StreamWatch(rate_hz)
        self.sequencer = Sequencer()
        self.interlock = Interlock()
        self.flat_line, self._sensors, self._pressure = FlatLine(), SensorAlarms(), PressureWatch()
        self.refused_first = False  # the board refused the first pressure of its run: nothing was measured
        self._obeyed = False  # it acknowledged one since
        self._engaged = False  # the board has reported that it is at the pressure commanded, or on its way
        self.hello: messages.Hello | None = None
        self.last: LastSample | None = None
        self.target_kpa: float | None = None
        self.loop: ElongationLoop | None = None  # while the elongation is controlled
        self._regulator: tuple[Regulator, bool] | None = None  # of an armed plan in millimetres, and whether it holds
        self._newest: Columns | None = None
        self.hold_samples = False  # request no samples after HELLO yet: a recording opens first
        self.sampled_us = 0  # board time between samples so far, over all clocks of the board
        self._sampled_ns = 0  # host time of the last sample
        self.pressurised = False  # a pressure was sent, and the unit has not been seen vented since
        self.mv_per_count = 1.0
        self._cleared_by = ""
        self._unanswered: messages.SetPressure | None = None  # the latest pressure, until the board acknowledges it
        self._effects: list[Effect] = []
        self.board = BoardCommands(self._effects.append)
        self.preflight = Preflight(self.interlock, self.board, zero_tolerance_kpa=zero_tolerance_kpa)

    def take(self) -> list[Effect]:
        """Return the effects since the last call, in order."""
        effects = list(self._effects)
        self._effects.clear()
        return effects

    # ---- the link --------------------------------------------------------------------------------------------------

    def link_opened(self, now_ns: int) -> None:
        """Identify the board on a port that is open now."""
        self.board.now_ns = now_ns
        self.stream.opened(now_ns)
        self.board.begin()

    def link_lost(self, cause: str) -> None:
        """End what depended on a port that is gone. Nothing can be sent: the board's watchdog vents."""
        self.stream.begun = False
        self.loop = None
        self.board.restart()
        if self.pressurised or self.sequencer.state in _RUN:
            remedy = f"check its cable: it reconnects automatically; {self._without_link}"
            self._trip(Trip(MessageKind.LINK_LOST, cause, remedy))
        else:
            self.board.note(MessageKind.LINK_LOST, cause, "warning")

    @property
    def up(self) -> bool:
        """Whether samples arrive and the speed of the board's clock is known."""
        return self.stream.begun and self.board.meter.known and not self.stream.silent

    @property
    def no_samples(self) -> tuple[str, str] | None:
        """Cause and remedy where the board refused to send samples, and none arrive."""
        return None if self.stream.begun else self.board.start_refused

    def events(self, events: Sequence[object], now_ns: int) -> None:
        """Take link events (`protocol.link.events.LinkEvent`) in order. Those that need no control are left out."""
        self.board.now_ns = now_ns
        for event in events:
            match event:
                case Samples(array):
                    self._take_samples(columns(array, self.mv_per_count))
                case CommandDone(command, _, status) if status is not None:
                    self._answered(command, status)
                case CommandLost(messages.Heartbeat(), _) if self.stream.paused_lately(now_ns):
                    pass  # nothing arrived at all: `tick` reports the silence
                case CommandLost(command, _):
                    self._trip(self.board.lost(command, watched=self.stream.begun))
                case BoardEventReceived(found, _):
                    self._trip(self.board.board_event(found.code, found.value))
                case HelloReceived(hello) if self.board.identifying or self._boots_again(now_ns):
                    self._greet(hello)
                case BoardRestarted(hello):
                    self._restarted(hello)
                case ClockWentBack(by_us):
                    self._clock_stepped(f"the board's clock went back by {by_us / 1e6:.3g} s")
                case _:
                    pass

    def tick(self, now_ns: int, heard_ns: int | None = None) -> None:
        """Do what is due by time alone: feed the watchdog, repeat a vent, detect silence. Called every 10 to 50 ms.

        `heard_ns`: time by which all that had arrived was read; by default `now_ns`.
        """
        self.board.now_ns = now_ns
        heard_ns = now_ns if heard_ns is None else heard_ns
        if self.stream.falls_silent(heard_ns):
            self._silence(f"no data for {self.stream.silence_s:g} s", f"check the cable; {self._without_link}")
        elif now_ns - heard_ns > UNREAD_S * 1e9 and self.stream.falls_silent(now_ns):
            cause = f"this computer was too busy to read the port for {UNREAD_S:g} s"
            self._silence(cause, _BUSY if self.stream.urgent else f"{_BUSY}, or {ALLOW_PRIORITY}")
        if self.loop is not None and self.stream.begun:
            found = self.loop.late(now_ns, self.stream.age_s(now_ns))
            if found is not None:
                self._stop_loop(found, hold=self.loop.hold)
        if self.board.guards_late:
            cause = f"the board has not acknowledged watchdog and limits for {GUARDS_S:g} s: no pressure was sent"
            self._trip(Trip(MessageKind.NO_ANSWER, cause, "check the link"))
        self.board.tick(idle=self._idle, unread=now_ns - heard_ns > REPEAT_MS * 1e6)

    # ---- the operator ----------------------------------------------------------------------------------------------

    def arm(
        self,
        plan: Plan,
        *,
        wait_for_reading: bool = False,
        resume_at: tuple[int, int] = (1, 0),
        regulator: Regulator | None = None,
        hold: bool = False,
    ) -> None:
        """Check a plan against the limits and make it ready. RequestError: see `Session.arm`."""
        self.preflight.require_plan(plan)
        latched = self.interlock.latched
        if latched is not None:
            raise RequestError(f"cannot arm: {latched.cause}", latched.remedy or "clear the fault first")
        if plan.controls_elongation:
            if regulator is None:
                raise RequestError(f"plan {plan.name} is in millimetres: {NO_REGULATOR[0]}", NO_REGULATOR[1])
            for end in (end for segment in plan.segments for end in segment.extremes):
                regulator.check(end)
        self._regulator = (regulator, hold) if regulator is not None else None
        self.sequencer.arm(plan, wait_for_reading=wait_for_reading, resume_at=resume_at)
        self.interlock.set_limits("plan", (plan.min_kpa, plan.max_kpa))

    def use_unit_limits(self, limits_kpa: tuple[float, float]) -> bool:
        """Take limits of the unit, disarm a plan that was checked against others; return whether they are others."""
        if self.interlock.of("unit") == limits_kpa:
            return False
        if self.sequencer.state in (SessionState.RUNNING, SessionState.PAUSED, SessionState.FINISHING):
            raise RequestError("a run is in progress with the unit", "stop the run first")
        self.disarm()
        self.interlock.set_limits("unit", limits_kpa)
        return True

    def checks(self) -> list[Check]:
        """Return the lines of the check before the first pressure."""
        at_rest = self.last is not None and self.last.state in _AT_REST
        return self.preflight.checks(up=self.up, vented=at_rest)

    def start(self, extra: Sequence[Check] = ()) -> None:
        """Begin the armed plan: pre-flight, limits and watchdog, then the first step."""
        if self.sequencer.state is not SessionState.ARMED:
            raise RequestError(f"cannot start in state {self.sequencer.state}", "arm a plan first")
        self._require_speed_of_run()
        self.refused_first = self._obeyed = False
        self._once_guarded(lambda: self._begin_run(self.sequencer.start), extra)

    def resume(self) -> None:
        """Resume after a pause, with the same checks as at the start."""
        if self.sequencer.state is not SessionState.PAUSED:
            raise RequestError(f"cannot resume in state {self.sequencer.state}")
        self._require_speed_of_run()
        self._once_guarded(lambda: self._begin_run(self.sequencer.resume))

    def pause(self) -> None:
        self.sequencer.pause()
        self._act()

    def stop(self) -> None:
        """End the run, or a pressure set manually."""
        self.board.forget_pending()
        self.sequencer.stop()
        if self.target_kpa is not None:
            self._vent()
        self._act()

    def finish_early(self, cause: str) -> None:
        """End a run as finished after its last complete cycle, for a recorded cause."""
        self.board.forget_pending()
        self.sequencer.finish_early(cause)
        self._act()

    def vent(self, cause: str | None = None, *, sent: bool = False, unreachable: bool = False) -> None:
        """Vent now, in any state, even while another vent is unacknowledged.

        `sent`: the command was sent already; `unreachable`: there is no port that takes it.
        """
        self.board.forget_pending()
        self._released()
        if sent:
            self.board.vent_sent()
        else:
            self.board.send(messages.Vent())
        text, level, remedy = cause or "vented by the operator", "info" if cause is None else "warning", ""
        if unreachable:
            listens = self.stream.begun and not self.board.can_command
            why = "this link is read only" if listens else "no board is connected"
            text, level = f"VENT was not sent: {why}", "error"
            remedy = _VENT_LATER if self.pressurised else ""
        elif self.stream.silent:
            text, level, remedy = "VENT was sent, but no data confirm it", "error", "open the valve manually"
        self.board.note(MessageKind.VENT, text, level, remedy)
        self.sequencer.abort(text, SessionState.ABORTED)
        self._act()

    def abort(self, cause: str) -> None:
        """Abort a run for a cause outside board and link, such as the disk."""
        self.board.forget_pending()
        self.sequencer.abort(cause, SessionState.ABORTED)
        self._act()

    def disarm(self) -> None:
        if self.sequencer.state is SessionState.ARMED:
            self.board.forget_pending()
            self.sequencer.disarm()
            self._act()

    def set_pressure(self, target_kpa: float, ramp_kpa_per_s: float = MANUAL_RAMP_KPA_PER_S) -> None:
        """Command a pressure manually. RequestError: see `Session.set_pressure`."""
        self.preflight.require_command()
        if self.sequencer.state not in (SessionState.IDLE, SessionState.ARMED, SessionState.ABORTED):
            raise RequestError(f"cannot set a pressure in state {self.sequencer.state}", "stop the run first")
        self.interlock.authorise(target_kpa, ramp_kpa_per_s)  # refuses now, not after the board's answers
        self.loop = None
        if self.target_kpa is not None:
            self._go(target_kpa, ramp_kpa_per_s)
        else:
            self._once_guarded(lambda: self._go(target_kpa, ramp_kpa_per_s))

    def control_elongation(self, mm: float, regulator: Regulator | None = None, *, hold: bool = False) -> None:
        """Control the elongation manually; a second call only moves the setpoint."""
        if self.loop is not None:
            if self.sequencer.state in _RUN:
                raise RequestError("cannot set an elongation while a plan runs", "stop the run first")
            self.loop.regulator.check(mm)
            self.loop.target_mm = mm
            return
        self.preflight.require_command()
        if regulator is None:
            raise RequestError(*NO_REGULATOR)
        if self.sequencer.state not in (SessionState.IDLE, SessionState.ARMED, SessionState.ABORTED):
            raise RequestError(f"cannot set an elongation in state {self.sequencer.state}", "stop it first")
        if self.interlock.latched is not None:
            raise RequestError(f"no pressure: {self.interlock.latched.cause}", self.interlock.latched.remedy)
        regulator.check(mm)
        self._require_speed()

        def begin() -> None:
            self._close_loop(regulator, hold=hold)
            if self.loop is not None:
                self.loop.target_mm = mm

        if self.target_kpa is not None:
            begin()
        else:
            self._once_guarded(begin)

    def clear_fault(self, by: str = "the operator") -> None:
        """Clear the latched fault, here and on the board. `by` whom goes into the recording."""
        self.interlock.require_gone()
        if self.stream.silent:
            raise RequestError("no data arrive: nothing tells whether the unit has vented", "wait, or check the cable")
        self._cleared_by = by
        if self.stream.begun and self.last is not None and self.last.state is BoardState.FAULT:
            self.board.send(messages.ClearFault())
        else:
            self._cleared()

    def leave(self) -> None:
        """Vent, disarm the watchdog, stop the samples: the port is closed next."""
        self.stop()
        self.board.vent()
        self.board.leaving = True
        self.board.send(messages.Heartbeat(0))
        self.board.send(messages.Stop())
        self.stream.begun = False

    # ---- samples ---------------------------------------------------------------------------------------------------

    def _pass_time(self, block: Columns, before_us: int) -> None:
        """Add the board time from an instant to the end of a block, without the steps of another clock."""
        host_s = (self.board.now_ns - self._sampled_ns) * 1e-9
        self._sampled_ns = self.board.now_ns
        longest_s = CLOCK_STEP_S + 2.0 * self.board.meter.speed * host_s
        passed, step_s = passed_us(block, before_us, longest_s)
        self.sampled_us += passed
        if step_s > longest_s and self.board.meter.known:
            self._clock_stepped(f"the board's clock went forward by {step_s:.3g} s", _ASLEEP)

    def _take_samples(self, block: Columns) -> None:
        if not len(block):
            return
        board, stream = self.board, self.stream
        first_us, before_us, board.board_us = int(block.time_us[0]), board.board_us, int(block.time_us[-1])
        goes_on = stream.begun and first_us > before_us
        self._pass_time(block, before_us if goes_on else first_us)
        board.meter.add(board.now_ns, board.board_us)
        first, was_silent = not stream.begun, stream.silent
        stream.came(board.now_ns)
        if was_silent:
            board.note(MessageKind.SAMPLES_AGAIN, "data resumed", "info")
        self.last = last_sample(block, self.target_kpa)
        self.preflight.recent_kpa.extend(block.pressure_kpa[block.pressure_known].tolist())
        found = self.interlock.inspect(block)
        if found is not None:
            if first and found.kind is MessageKind.BOARD_FAULT:
                found = self.interlock.latched = replace(found, cause=_EARLIER_FAULT)
            self._tripped(found)
        self._watch(block)
        self.sequencer.feed(block)
        self._act()
        self._newest = block
        self._regulate(block)
        if self.target_kpa is None and not board.venting and abs(self.last.pressure_kpa) <= VENTED_KPA:
            self.pressurised = False
        if int(self.last.flags) & _WATCHDOG_ARMED:
            board.adopt_watchdog()
        board.tick(idle=self._idle)

    def _watch(self, block: Columns) -> None:
        """Report what is wrong with sensors and pressure without a limit being passed."""
        assert self.last is not None
        for sensor in self.flat_line.inspect(block):
            remedy = "check its emitter, receiver and cable"
            self.board.note(MessageKind.FLAT_LINE, _constant(sensor), "warning", remedy, value=sensor)
        counts = self.hello is not None and block.raw is not block.signal_mv
        full_counts = 2**self.hello.adc_bits - 1 if self.hello is not None and counts else None
        self._effects += self._sensors.inspect(block, self.sampled_us, full_counts)
        state, goal_kpa, stopped = self.last.state, self.target_kpa, self.sequencer.state not in _RUN
        if goal_kpa is not None and self._unanswered is None:
            if self._engaged and state in _AT_REST:
                cause, remedy = "the board vented by itself", "check the board and its supply, then clear the fault"
                self._trip(Trip(MessageKind.BOARD_VENTED, cause, remedy))
                return
            self._engaged = state in _ACTIVE
        guarded = stopped and self.loop is None if goal_kpa is not None else state not in _ACTIVE
        if guarded and self.board.can_command and block.pressure_known[-1]:
            found = self._pressure.inspect(self.sampled_us, self.last.pressure_kpa, goal_kpa)
            if found is not None:
                self._effects.append(found)

    @property
    def alarms(self) -> tuple[str, ...]:
        """What was reported of sensors and pressure, and is so still."""
        off = [self._pressure.present.text] if self._pressure.present is not None else []
        return (*map(_constant, self.flat_line.frozen), *self._sensors.present, *off)

    @property
    def pressure_off(self) -> bool:
        """Whether a pressure set manually is not there, or one stays on a vented unit."""
        return self._pressure.present is not None

    @property
    def _idle(self) -> bool:
        """Whether nothing is under pressure and the board is at rest."""
        return not self.pressurised and self.last is not None and self.last.state in _AT_REST

    @property
    def _without_link(self) -> str:
        """What becomes of the unit while its board hears nothing, as the last sample knew."""
        armed = self.last is not None and int(self.last.flags) & _WATCHDOG_ARMED
        return "the board vents by itself" if armed else "no watchdog vents the unit"

    def _silence(self, cause: str, remedy: str) -> None:
        """Trip where a unit is under pressure; report a silence that follows another trip."""
        if self.interlock.latched is None and (self.pressurised or self.sequencer.state in _RUN):
            self._trip(Trip(MessageKind.SILENT, cause, remedy))
            return
        self.board.note(MessageKind.SILENT, cause, "warning", remedy)
        self.board.vent()

    # ---- answers ---------------------------------------------------------------------------------------------------

    def _greet(self, hello: messages.Hello) -> None:
        """Answer a HELLO with watchdog, limits and rate."""
        self.hello = hello
        self.mv_per_count = hello.vref_mv / 2**hello.adc_bits
        self.preflight.take_limits(hello.pressure_min_pa / 1000, hello.pressure_max_pa / 1000)
        if hello.rate_max_hz < self.stream.rate_hz:
            text = f"the board samples at most {hello.rate_max_hz} times a second"
            self.board.note(MessageKind.RATE, text, "warning")
            self.stream.rate_hz = hello.rate_max_hz
        if self.pressurised and self.target_kpa is None:  # a vent before the link was lost may not have arrived
            self.board.vent()
        self.board.introduce(hello, self.preflight.limits_command)
        if not self.hold_samples:
            self.board.send(messages.Start(self.stream.rate_hz))

    def release_samples(self) -> None:
        """Request the samples that were held back."""
        self.hold_samples = False
        self.board.send(messages.Start(self.stream.rate_hz))

    def _boots_again(self, now_ns: int) -> bool:
        """Whether a second HELLO means that the board has lost limits and watchdog. Opening its port reset it."""
        return not self.stream.begun and now_ns - self.board.introduced_ns > BOOT_S * 1e9

    def _restarted(self, hello: messages.Hello | None) -> None:
        """End the run: a board that restarted has vented and lost limits and watchdog."""
        reason = "" if hello is None else f" ({_boot_reason(hello.boot_reason)})"
        booting, self.stream.begun = not self.stream.begun, False  # before the first sample: opening its port reset it
        self.board.restart()
        if not booting or self.pressurised:
            cause = f"the board restarted{reason}"
            self._trip(Trip(MessageKind.BOARD_RESTARTED, cause, "check its supply, then clear the fault"))
        if hello is None:
            self.board.send(messages.Identify())
        else:
            self._greet(hello)

    def _clock_stepped(self, cause: str, remedy: str = "check its supply and its firmware") -> None:
        """End a run: its times, and all that the board times, are those of another clock."""
        if self.pressurised or self.sequencer.state in (*_RUN, SessionState.FINISHING):
            self._trip(Trip(MessageKind.BOARD_CLOCK, cause, remedy))
        else:
            self.board.note(MessageKind.BOARD_CLOCK, cause, "warning", remedy)

    def _answered(self, command: messages.Command, status: messages.AckStatus | int) -> None:
        if status != messages.AckStatus.DONE:
            first = isinstance(command, messages.SetPressure) or self.board.pending
            self.refused_first = first and not self._obeyed
            self._trip(self.board.refused(command, status, pressurised=self.pressurised))
            return
        if isinstance(command, messages.SetPressure):
            self._obeyed = True
            if command == self._unanswered:
                self._unanswered = None
            if self.loop is not None:
                self.loop.answered(self.board.now_ns, self.board.meter.speed)
            if self.target_kpa is not None and command.target_pa == round(self.target_kpa * 1000):
                self.sequencer.commanded()
        elif isinstance(command, messages.ClearFault):
            self._cleared()
        self.board.done(command)
        self._act()

    # ---- elongation ------------------------------------------------------------------------------------------------

    def _begin_run(self, begin: Callable[[], None]) -> None:
        """Begin or resume a run; one in millimetres with its control closed."""
        plan = self.sequencer.plan
        if plan is not None and plan.controls_elongation:
            assert self._regulator is not None  # `arm` requires it
            regulator, hold = self._regulator
            self._close_loop(regulator, hold=hold)
            if self.loop is None:
                return
        begin()

    def _require_speed_of_run(self) -> None:
        if self.sequencer.plan is not None and self.sequencer.plan.controls_elongation:
            self._require_speed()

    def _require_speed(self) -> None:
        speed = self.board.meter.speed
        if speed > FASTEST:
            text = (
                f"this board runs at {speed:.0f} times real time: its elongation is controlled up to {FASTEST:g} times"
            )
            raise RequestError(text, "choose a lower speed of the virtual board")

    def _close_loop(self, regulator: Regulator, *, hold: bool) -> None:
        """Close the loop at the present elongation; where it is not known, say so and leave it open."""
        if self._newest is None or self.last is None:
            raise RequestError("no samples arrive from the board", "check the link")
        loop = ElongationLoop(regulator, hold=hold)
        start_kpa = self.last.pressure_kpa if self.target_kpa is None else self.target_kpa
        try:
            loop.begin(self._newest, start_kpa)
        except Exception as error:
            found = cause_and_remedy(error)
            if found is None:
                raise
            self._stop_loop(LoopStop(MessageKind.ELONGATION_UNKNOWN, *found), hold=False)
            return
        self.loop = loop
        self.board.note(MessageKind.ELONGATION_CONTROL, f"elongation controlled, unit {regulator.unit}", "info")

    def _regulate(self, block: Columns) -> None:
        """Pass samples to the loop, and request the pressure that it returns."""
        loop, limits = self.loop, self.interlock.limits
        if loop is None or limits is None:
            return
        before, was_s = loop.lost, loop.at_limit_s
        point = self.sequencer.setpoint_mm(int(block.time_us[-1]))
        found = loop.feed(block, point, (limits.min_kpa, limits.max_kpa))
        for sensor in loop.lost[len(before) :]:
            text = f"sensor {sensor} is lost: the elongation is controlled by the others"
            self.board.note(MessageKind.SENSOR_LOST, text, "warning", "check its emitter and receiver", value=sensor)
        if was_s <= AT_LIMIT_S < loop.at_limit_s:
            text = f"the pressure has been at its limit, or its fastest change, for {AT_LIMIT_S:g} s"
            remedy = "choose a setpoint nearer or slower; check for a leak, and that the pump runs"
            self.board.note(MessageKind.PRESSURE_AT_LIMIT, text, "warning", remedy)
        if isinstance(found, LoopStop):
            self._stop_loop(found, hold=loop.hold)
        elif found is not None:
            self._go(found.pressure_kpa, found.ramp_kpa_per_s, streamed=True)

    def _stop_loop(self, stop: LoopStop, *, hold: bool) -> None:
        """Open the loop for a cause: vent, or hold the last pressure, as set; a run in millimetres is aborted."""
        self.loop = None
        ending = "the last pressure is held" if hold else "vented"
        self.board.note(stop.kind, f"{stop.cause}; {ending}", "error", stop.remedy)
        if self.sequencer.state in (*_RUN, SessionState.ARMED):
            self.sequencer.abort(stop.cause, SessionState.ABORTED)
        if not hold:
            self._vent()
        self._act(hold=hold)

    def _cleared(self) -> None:
        self.interlock.latched = None
        self.sequencer.cleared()
        self.board.note(MessageKind.FAULT_CLEARED, f"fault cleared by {self._cleared_by}", "info")

    # ---- pressure --------------------------------------------------------------------------------------------------

    def _once_guarded(self, then: Callable[[], None], extra: Sequence[Check] = ()) -> None:
        """Call `then` after the pre-flight, once limits and watchdog are acknowledged; the latest call wins."""
        limits = self.preflight.limits_command
        require([*self.checks(), *extra])
        assert limits is not None  # the pre-flight requires them
        self.board.once_guarded(limits, then)

    def _act(self, *, hold: bool = False) -> None:
        """Turn the sequencer's actions into effects. A pressure goes through the interlock. `hold`: none vents."""
        for action in self.sequencer.take():
            match action:
                case GoTo(target_kpa, ramp_kpa_per_s, streamed):
                    self._go(target_kpa, ramp_kpa_per_s, streamed=streamed)
                case VentNow():
                    if not hold:
                        self._vent()
                case _:
                    self._effects.append(action)
            if isinstance(action, RunEnding):  # the message of what aborted it has been given already
                self.board.note(MessageKind.RUN_ENDED, action.text, "" if action.aborted else "info")
        if self.sequencer.state in (SessionState.IDLE, SessionState.ABORTED, SessionState.FAULT):
            self.interlock.set_limits("plan", None)

    def _go(self, target_kpa: float, ramp_kpa_per_s: float, *, streamed: bool = False) -> None:
        """Command a pressure; of a stream only once the one before is acknowledged."""
        if streamed and self._unanswered is not None:
            return
        try:
            command = self.interlock.authorise(target_kpa, ramp_kpa_per_s)
        except RequestError as error:  # latched since it was requested
            self._trip(Trip(MessageKind.REFUSED, error.cause, error.remedy))
            return
        self.pressurised, self.target_kpa = True, target_kpa
        self._unanswered = command
        if self.last is not None and math.isfinite(self.last.pressure_kpa):
            self._pressure.commanded(self.sampled_us, self.last.pressure_kpa, target_kpa, ramp_kpa_per_s)
        if self.loop is not None:
            self.loop.sent(self.board.now_ns)
        if self.board.feeder.armed_ms and not streamed:  # a board that restarted, undetected yet, has lost it
            self.board.send(messages.Heartbeat(self.board.feeder.armed_ms))
        self.board.send(command)

    def _vent(self) -> None:
        self._released()
        self.board.vent()

    def _released(self) -> None:
        """Note that no pressure is commanded any more."""
        self.target_kpa = self.loop = self._unanswered = None
        self._engaged = False

    def _trip(self, found: Trip | None) -> None:
        if found is not None and self.interlock.trip(found):
            self._tripped(found)

    def _tripped(self, found: Trip) -> None:
        """Vent, report, abort the run."""
        self.board.forget_pending()
        self._vent()
        self.board.note(found.kind, found.cause, "error", found.remedy, value=found.value)
        self.sequencer.abort(found.cause, SessionState.FAULT)
        self._act()


def _constant(sensor: int) -> str:
    return f"the signal of sensor {sensor} is constant while the pressure changes"


def _boot_reason(value: int) -> str:
    known = value <= max(messages.BootReason)
    return messages.BootReason(value).name.lower().replace("_", " ") if known else f"reason {value}"
