"""Whether pressure may be commanded: checks of link, limits, latch and the sensor's zero.

Nothing is repaired here and nothing is overridden: each check that fails has a remedy, and the operator tries again.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from boat_daq.engine.control.board_commands import BoardCommands
from boat_daq.engine.control.interlock import Interlock
from boat_daq.engine.plan import Plan
from boat_daq.engine.snapshot import MessageKind
from protocol.base.errors import RequestError
from protocol.base.units import Quantity, UnitText
from protocol.link.messages import SetLimits

ZERO_SAMPLES = 50


@dataclass(frozen=True, slots=True)
class Check:
    """One line: `problem` is empty where all is well."""

    name: str
    problem: str = ""
    remedy: str = ""

    @property
    def ok(self) -> bool:
        return not self.problem


def require(checks: list[Check]) -> None:
    """Raise what the checks found. RequestError: every problem in one sentence, with its remedy."""
    failed = [check for check in checks if not check.ok]
    if failed:
        remedies = dict.fromkeys(check.remedy for check in failed if check.remedy)
        raise RequestError("; ".join(check.problem for check in failed), "; ".join(remedies))


class Preflight:
    """Checks before any command to the board.

    `why_read_only`: why the link cannot command; empty where it can, or the reason is unknown.
    """

    def __init__(self, interlock: Interlock, board: BoardCommands, *, zero_tolerance_kpa: float) -> None:
        self.why_read_only = ""
        self._interlock, self._board = interlock, board
        self._zero_tolerance_kpa = zero_tolerance_kpa
        self.recent_kpa: deque[float] = deque(maxlen=ZERO_SAMPLES)  # the newest pressures of the sensor
        self._no_pressure: tuple[str, str] | None = None  # why the board's limits allow none

    def take_limits(self, low_kpa: float, high_kpa: float) -> None:
        """Keep the board's hard limits. Limits that no vented unit is inside of leave no pressure at all."""
        usable = low_kpa <= 0 <= high_kpa and low_kpa < high_kpa
        self._interlock.set_limits("board", (low_kpa, high_kpa) if usable else None)
        self._no_pressure = None
        if not usable and self._board.can_command:  # a board that takes no commands has no limits
            limits = (Quantity(low_kpa, "kPa", named=False), " to ", Quantity(high_kpa, "kPa"))
            text = UnitText("the board's own limits, ", *limits, ", do not include 0, the pressure of a vented unit")
            self._no_pressure = (text, "check the board's firmware: without usable limits it is read only")
            self._board.note(MessageKind.LIMITS, text, "warning", self._no_pressure[1])

    @property
    def limits_command(self) -> SetLimits | None:
        """The command that sends the limits in force to the board. None while none are known."""
        limits = self._interlock.limits
        if limits is None:
            return None
        return SetLimits(round(limits.min_kpa * 1000), round(limits.max_kpa * 1000))

    def checks(self, *, up: bool, vented: bool) -> list[Check]:
        """Return the lines of the check before the first pressure. `tolerance_kpa`: of the sensor's zero."""
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
            return Check(
                "zero", UnitText("the unit is not vented (", Quantity(recent_kpa, "kPa", ".1f"), ")"), "vent it first"
            )
        if not abs(recent_kpa) <= tolerance_kpa:
            reads, tolerance = Quantity(recent_kpa, "kPa", ".2f"), Quantity(tolerance_kpa, "kPa")
            text = UnitText("the pressure reads ", reads, " on a vented unit (tolerance ", tolerance, ")")
            return Check("zero", text, "wait until it has vented, or check the zero of the sensor")
        return Check("zero")

    def require_plan(self, plan: Plan) -> None:
        """Refuse a plan outside the limits. RequestError: it is outside them, or the link cannot command."""
        self.require_command()
        for target_kpa in reversed(plan.extremes_kpa):
            self._interlock.check(target_kpa, new_plan=True)

    def require_command(self) -> None:
        """Refuse where no pressure can be commanded."""
        if not self._board.can_command:
            why = f": {self.why_read_only}" if self.why_read_only else ""
            raise RequestError(f"this link is read only{why}", "use firmware or a profile that commands pressure")
        if self._no_pressure is not None:
            raise RequestError(*self._no_pressure)
