"""A queue of runs: which plan with which unit, pauses between, and where it waits for the operator. A TOML file.

[[run]]
plan = "calibration"
unit = "SA1"
[[run]]
plan = "repeatability"
unit = "SA2"
cycles = 20
pause_s = 600.0
wait = "Mount SA2 and connect its tubes"
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from boat_daq.engine.plan import Plan, load_plan
from boat_daq.engine.toml_values import BadValue, build, parse_toml, read_text

RUNS_MAX = 200
PAUSE_MAX_S = 7 * 86_400.0


@dataclass(frozen=True, slots=True)
class QueuedRun:
    """One run of a queue."""

    plan: str  # name of a built-in plan, or its TOML file, relative to that of the queue
    unit: str = ""  # name of the unit; empty for none
    cycles: int = 0  # in place of the plan's; 0 for those
    pause_s: float = 0.0  # before this run, s
    wait: str = ""  # what the operator confirms before this run; empty to begin without
    name: str = ""  # template of the recording's name; empty for that of the settings
    note: str = ""

    def __post_init__(self) -> None:
        if not 0 <= self.pause_s <= PAUSE_MAX_S:
            raise BadValue("queue", "pause_s", f"must be 0 to {PAUSE_MAX_S:g}, not {self.pause_s}")
        if self.cycles < 0:
            raise BadValue("queue", "cycles", f"must not be negative, not {self.cycles}")

    def loaded(self, folder: Path) -> Plan:
        """Return its plan. RequestError: there is none of this name, or its file is refused."""
        beside = folder / self.plan
        plan = load_plan(str(beside) if beside.is_file() else self.plan)
        return plan.changed(cycles=self.cycles) if self.cycles else plan


def load_queue(path: Path) -> tuple[QueuedRun, ...]:
    """Return the runs of a file, each with a plan that can be read. RequestError: the file is refused, by key."""
    table = parse_toml(read_text(path), str(path))
    entries = table.pop("run", None)
    if table:
        raise BadValue(str(path), next(iter(table)), "is not known", "write [[run]] and its keys below it")
    if not isinstance(entries, list) or not entries or not all(isinstance(entry, dict) for entry in entries):
        raise BadValue(str(path), "run", "must be a list of tables", "write [[run]] and its keys below it")
    if len(entries) > RUNS_MAX:
        raise BadValue(str(path), "run", f"has {len(entries)} entries, more than {RUNS_MAX}")
    runs = tuple(build(QueuedRun, entry, f"{path}, run {number}") for number, entry in enumerate(entries, 1))
    for run in runs:
        run.loaded(path.parent)
    return runs
