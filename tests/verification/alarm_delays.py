"""How many cycles after its beginning a fault raises its alarm, for `analysis/shadow/METHODS.md`.

    python -m tests.verification.alarm_delays

Nine runs of the virtual board's units for each fault, with other noise in each.
"""

from __future__ import annotations

import numpy as np

from analysis.shadow.model.reduced import ReducedModel
from analysis.shadow.model.table import load_table
from analysis.shadow.monitoring.monitor import Alarm, Monitor
from tests.analysis.shadow.simulated_actuator import Fault, Run, run_actuator

RUNS, UNITS = 9, ("SA1", "SA2", "SA3")
FAULTS = {
    "leak of 2 %/min, staircases": ("leak", Fault(begins=10, leak_percent_per_min=2.0), True, 24),
    "leak of 2 %/min, continuous": ("leak", Fault(begins=30, leak_percent_per_min=2.0), False, 55),
    "softening of 5 % in 50 cycles": ("softening", Fault(begins=20, softening_percent_in_50=5.0), False, 40),
    "sensors 4 mV apart": ("sensor disagreement", Fault(begins=20, disagreement_mv=4.0), False, 34),
}


def alarms_of(table: ReducedModel, run: Run) -> list[Alarm]:
    """Return all alarms of a run."""
    monitor = Monitor(table)
    figures = (monitor.figures(run.time_s[c], run.pressure_kpa[c], run.elongations_mm[c]) for c in run.cycles)
    return [alarm for one in figures for alarm in monitor.take(one)]


def delays(name: str, table: ReducedModel) -> list[int]:
    """Return the delay of the first alarm that names the fault in each run, cycles."""
    named, fault, staircase, cycles = FAULTS[name]
    found = []
    for k in range(RUNS):
        run = run_actuator(cycles, fault, staircase=staircase, seed=20 + k, unit_name=UNITS[k % len(UNITS)])
        found.append(next(alarm.cycle for alarm in alarms_of(table, run) if alarm.fault == named) - fault.begins)
    return found


if __name__ == "__main__":
    for name in FAULTS:
        print(f"{name}: 90 % within {np.percentile(delays(name, load_table()), 90):.0f} cycles")
