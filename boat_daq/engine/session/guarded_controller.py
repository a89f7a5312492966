"""The controller of a session under its lock: what it decides is sent to the board and kept in the journal, in order.

Nothing is waited for under the lock but a write to the port, 250 ms at the longest. `vent` writes to the port before it
takes the lock.
"""

from __future__ import annotations

import dataclasses
import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from boat_daq.engine.control.board_commands import Send
from boat_daq.engine.control.controller import Controller
from boat_daq.engine.control.elongation import Regulator
from boat_daq.engine.control.preflight import Check
from boat_daq.engine.plan import Plan, resume_point
from boat_daq.engine.session.journal import Journal
from protocol.base.errors import RequestError
from protocol.link.messages import Command, SetPressure, Vent
from protocol.recording import RunEnd

VENTS_MERGED_S = 0.1


class GuardedController:
    """Carries out the effects of one controller."""

    def __init__(self, journal: Journal, send: Callable[[Command, bool], bool]) -> None:
        self.lock, self._venting = threading.RLock(), threading.RLock()
        self.controller = Controller()
        self._journal, self._send = journal, send
        self._pressures = 0  # changes before and after a pressure is sent: see `vent`
        self._vented_s, self._vented_after = -math.inf, 0  # time of the last vent, and `_pressures` then
        self._resumes_at: tuple[int, int] | None = None  # first cycle and complete cycles of an armed resumption

    @contextmanager
    def acting(self) -> Iterator[Controller]:
        """Give the controller under the lock, and carry out its effects, even on an error."""
        with self.lock:
            self.controller.board.now_ns = time.monotonic_ns()
            try:
                yield self.controller
            finally:
                self._carry_out()

    def _carry_out(self) -> None:
        """Send and keep the controller's effects, in its order."""
        board_us = self.controller.board.board_us
        for effect in self.controller.take():
            if not isinstance(effect, Send):
                self._journal.take(effect, time_us=board_us)
            elif isinstance(effect.command, SetPressure):
                self._pressures += 1
                self._send(effect.command, False)
                self._pressures += 1
            else:
                self._send(effect.command, effect.feeds)

    def vent(self, cause: str | None = None) -> None:
        """Vent now; the command leaves before the lock is taken.

        Of requests within `VENTS_MERGED_S`, with nothing commanded between, one is carried out.
        """
        controller = self.controller
        with self._venting:
            before, now_s = self._pressures, time.monotonic()
            idle = controller.target_kpa is None and not controller.board.pending
            if now_s - self._vented_s < VENTS_MERGED_S and before == self._vented_after and idle:
                return
            sent = self._send(Vent(), False)
            if sent:
                self._vented_s, self._vented_after = now_s, before
        with self.acting() as control:
            # A pressure that was being sent at that instant may have left behind the vent: then vent once more.
            control.vent(cause, sent=sent and before == self._pressures, unreachable=not sent)

    def arm(self, plan: Plan, *, wait_for_reading: bool, resume: bool, regulator: Regulator | None, hold: bool) -> None:
        """Arm a plan, and state it in the recording. Parameters and errors are those of `Session.arm`."""
        with self.acting() as control:
            recorder, broken = self._journal.recorder, self._journal.broken
            if recorder is not None:
                recorder.require_saving()
            if recorder is not None and broken is not None:
                broken.check_plan(plan)
                if not resume:
                    cause = f"{broken.path.name} holds an interrupted run, which can only be resumed there"
                    raise RequestError(cause, "resume it, or begin a new recording")
            resume_at = resume_point(plan, control.sequencer.marks) if resume else (1, 0)
            if resume_at[1] >= plan.cycles:
                raise RequestError("the run has all its cycles", "begin a new one")
            control.arm(
                plan, wait_for_reading=wait_for_reading, resume_at=resume_at, regulator=regulator, hold=hold
            )  # fmt: skip
            self._resumes_at = resume_at if resume else None
            if recorder is not None and not resume:
                limits = control.interlock.limits
                assert limits is not None
                recorder.update_meta(plan=dataclasses.asdict(plan), limits_pa=limits.pascals)

    def start(self, space: Check) -> None:
        """Start the armed plan, and record a resumption; `space` is the check of the disk."""
        with self.acting() as control:
            control.start([space])
            resumes_at, self._resumes_at = self._resumes_at, None
            if resumes_at is not None and self._journal.recorder is not None:
                first, complete = resumes_at
                cause = self._journal.ended.text if self._journal.ended else str(RunEnd.INTERRUPTED)
                self._journal.recorder.run_resumed(cause, first_cycle=first, complete_cycles=complete)
