"""The check before the first pressure: each line says what it looked at, and why it says no.

Nothing is repaired here and nothing is overridden: what says no has a remedy, and the operator looks again.
"""

from __future__ import annotations

from dataclasses import dataclass

from boat_daq.errors import OperatorError

ZERO_TOLERANCE_KPA = 1.0  # of the pressure sensor, on a vented unit


@dataclass(frozen=True, slots=True)
class Check:
    """One line: `problem` is empty where all is well."""

    name: str
    problem: str = ""
    remedy: str = ""

    @property
    def ok(self) -> bool:
        """Whether nothing stands against pressure here."""
        return not self.problem


def zero_check(pressure_kpa: float | None, *, vented: bool, tolerance_kpa: float = ZERO_TOLERANCE_KPA) -> Check:
    """Return whether the pressure sensor reads zero on a vented unit.

    Parameters
    ----------
    pressure_kpa : mean of the last samples; None when there are none.
    vented : whether the board says it is idle or vented.
    """
    if pressure_kpa is None:
        return Check("zero", "no pressure is known yet", "wait for samples")
    if not vented:
        return Check("zero", f"the unit is under pressure ({pressure_kpa:.1f} kPa)", "vent it first")
    if not abs(pressure_kpa) <= tolerance_kpa:
        text = f"the pressure reads {pressure_kpa:.2f} kPa on a vented unit (tolerance {tolerance_kpa:g} kPa)"
        return Check("zero", text, "wait until it has vented, or check the sensor's zero")
    return Check("zero")


def require(checks: list[Check]) -> None:
    """Raise what the checks found.

    Raises
    ------
    OperatorError : every problem in one sentence, with its remedy.
    """
    failed = [check for check in checks if not check.ok]
    if failed:
        remedies = dict.fromkeys(check.remedy for check in failed if check.remedy)
        raise OperatorError("; ".join(check.problem for check in failed), "; ".join(remedies))
