"""What each fault of the virtual board leads to while the elongation is controlled.

    python -m tests.boat_daq.engine.elongation_faults > docs/reference/elongation-faults.md

Each fault begins 5 s after the board, under control of SA1 at 2.5 mm, and lasts to the end of 16 s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from protocol.simulator.faults import FAULTS
from tests.boat_daq.engine.controller_rig import ControllerRig
from tests.boat_daq.engine.regulators import regulator

GOAL_MM = 2.5
FROM_THE_START = {"reset_on_open": "", "wrong_protocol": "", "clock_wrap": ":8"}  # the values that they begin with
HEAD = """# Faults during control of elongation

SIMULATED. The elongation of SA1 is controlled at 2.5 mm on the virtual board. Each fault starts during the control
and is observed for at least 11 s. *Controlled*: the control continues. *Vented*: the control ends and the unit is
vented. *Refused*: the program does not connect.

`boat-daq board --fault list` describes the faults.

| fault | outcome | message | pressure, kPa | final error, mm |
|--|--|--|--:|--:|
"""


@dataclass(frozen=True)
class Outcome:
    """How it ended: "vented", "held", "controlled" or "refused"; the cause; extreme pressures, kPa; the error, mm."""

    ending: str
    cause: str
    low_kpa: float
    high_kpa: float
    error_mm: float


def outcome(fault: str) -> Outcome:
    """Return what a fault leads to."""
    begins = f"{fault}@8" if fault == "clock_wrap" else fault + ("" if fault in FROM_THE_START else "@5")
    rig = ControllerRig(begins)
    if not rig.run(5.0, lambda: rig.control.up):
        return Outcome("refused", "", 0.0, 0.0, np.nan)
    rig.do(lambda: rig.control.control_elongation(GOAL_MM, regulator()))
    rig.run(16.0)
    if fault == "unplug":
        rig.plugged = False
        rig.run(3.0)
    causes = [note.text for note in rig.notes if note.level in ("error", "warning")]
    error = rig.board.elongation_mm - GOAL_MM
    if rig.control.loop is not None:
        ending = "controlled"
    else:
        ending = "vented" if abs(rig.pressure_kpa) < 2.0 else "held"
    return Outcome(ending, causes[0] if causes else "", min(rig.pressures), max(rig.pressures), error)


def main() -> None:
    """Print the page."""
    print(HEAD, end="")
    for fault in FAULTS:
        found = outcome(fault)
        error = f"{found.error_mm:+.2f}" if found.ending == "controlled" else ""
        pressure = f"{found.low_kpa:.1f} to {found.high_kpa:.1f}" if found.ending != "refused" else ""
        cells = (f"`{fault}`", found.ending, found.cause, pressure, error)
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
