"""A plan: which pressures, in which order, and what ends each of them. A frozen value, in and out as TOML.

Two kinds. A *staircase* holds a plateau at every `step_kpa` from `high_kpa` down to `low_kpa` and back up, cycle after
cycle. A *continuous* plan only turns at the two ends. A cycle runs from `high_kpa` through `low_kpa` back to
`high_kpa`.

Neighbouring cycles share the plateau at `high_kpa`: it is held once, numbered as the last of the cycle that ends there,
and is also the point at which the next one begins. The plateau that opens the run belongs to no cycle and is marked
"start". So every cycle owns the same number of plateaus (its nine below and nine above in the calibration plan, -40 and
the closing +50 among them), none is counted twice in a fit, and each branch is whole when the plateau before its first
one is taken as its beginning. The opening plateau is held until it is steady like every other, so that the first cycle
begins from the same history as the rest.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import tomli_w

from boat_daq.engine.toml_values import BadValue, build, parse_toml, read_text
from boat_daq.errors import OperatorError

KINDS = ("staircase", "continuous")
MAX_STEPS = 100_000

Branch = Literal["start", "unloading", "loading", "end"]


@dataclass(frozen=True, slots=True)
class PlannedStep:
    """One target: `cycle` is 0 outside the cycles.

    `plateau` where it is held until it is steady.
    """

    cycle: int
    branch: Branch
    target_kpa: float
    plateau: bool


@dataclass(frozen=True, slots=True)
class StepMark:
    """One step of a run as the recording's table `step` keeps it.

    `number` is its `step_id`. Times are board time.
    """

    number: int
    cycle: int
    branch: str
    target_kpa: float
    ramp_kpa_per_s: float
    started_us: int
    arrived_us: int | None = None
    settled_us: int | None = None
    ended_us: int | None = None
    status: str = "running"  # running, reached, timeout, aborted
    detail: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Plan:
    """What a run does.

    Parameters
    ----------
    name : its name in lists and recordings.
    kind : "staircase" or "continuous".
    high_kpa, low_kpa : the two ends; a cycle starts at `high_kpa`.
    step_kpa : distance of the staircase's plateaus; divides the span.
    cycles : complete cycles to run.
    ramp_kpa_per_s : rate of change towards each target.
    min_kpa, max_kpa : the plan's own limits; the pressure never goes 2 kPa beyond them.
    tolerance_kpa : the pressure has arrived while it is this close to its target.
    settling_s : it has settled once it stayed so close for this long.
    window_s : shortest stretch of settled samples that may show a plateau to be steady.
    min_dwell_s, max_dwell_s : shortest and longest hold, from the arrival.
    pressure_drift_kpa_per_s, signal_drift_mv_per_s : a plateau is steady when no drift faster than this is credible.
    arrival_timeout_s : time allowed beyond the ramp's own until the pressure has arrived.
    reading_timeout_s : longest wait at a plateau for its reading, where readings are waited for.

    Raises
    ------
    OperatorError : a value that makes no plan, by key.
    """

    name: str
    kind: str
    cycles: int
    high_kpa: float = 50.0
    low_kpa: float = -40.0
    step_kpa: float = 10.0
    ramp_kpa_per_s: float = 10.0
    min_kpa: float = -40.0
    max_kpa: float = 50.0
    tolerance_kpa: float = 1.0
    settling_s: float = 1.0
    window_s: float = 2.0
    min_dwell_s: float = 3.0
    max_dwell_s: float = 20.0
    pressure_drift_kpa_per_s: float = 0.2
    signal_drift_mv_per_s: float = 1.0
    arrival_timeout_s: float = 10.0
    reading_timeout_s: float = 600.0

    def __post_init__(self) -> None:
        _check(self)

    @property
    def targets_kpa(self) -> tuple[float, ...]:
        """Targets of one cycle after its start: down to `low_kpa`, then up to `high_kpa`."""
        if self.kind == "continuous":
            return (self.low_kpa, self.high_kpa)
        n = round((self.high_kpa - self.low_kpa) / self.step_kpa)
        down = [self.high_kpa - (self.high_kpa - self.low_kpa) * i / n for i in range(1, n + 1)]
        return (*down, *reversed(down[:-1]), self.high_kpa)

    @property
    def opening(self) -> PlannedStep:
        """The step that brings the unit to where the cycles start."""
        return PlannedStep(0, "start", self.high_kpa, self.kind == "staircase")

    def cycle_steps(self, cycle: int) -> tuple[PlannedStep, ...]:
        """Return the steps of one cycle (numbered from 1)."""
        targets, plateau = self.targets_kpa, self.kind == "staircase"
        half = len(targets) // 2
        return tuple(
            PlannedStep(cycle, "unloading" if i < half else "loading", target, plateau)
            for i, target in enumerate(targets)
        )

    @property
    def steps(self) -> tuple[PlannedStep, ...]:
        """All steps of an unbroken run: the opening and every cycle's."""
        return (self.opening, *(step for c in range(1, self.cycles + 1) for step in self.cycle_steps(c)))

    def step_duration_s(self, from_kpa: float, to_kpa: float) -> float:
        """Estimate one step's time.

        Its ramp, its arrival within tolerance, and its shortest hold.
        """
        hold = self.min_dwell_s
        if self.kind == "staircase":
            hold = max(hold, self.settling_s + self.window_s)
        return abs(to_kpa - from_kpa) / self.ramp_kpa_per_s + hold

    @property
    def cycle_duration_s(self) -> float:
        """Estimated time of one cycle, seconds of board time."""
        path = (self.high_kpa, *self.targets_kpa)
        return sum(self.step_duration_s(a, b) for a, b in itertools.pairwise(path))

    @property
    def duration_s(self) -> float:
        """Estimated time of an unbroken run, seconds of board time."""
        return self.step_duration_s(0.0, self.high_kpa) + self.cycles * self.cycle_duration_s

    def with_dwell(self, dwell_s: float) -> Plan:
        """Return the plan with this shortest hold.

        One too short for settling and window shortens both to fit.
        """
        return dataclasses.replace(
            self,
            min_dwell_s=dwell_s,
            max_dwell_s=max(self.max_dwell_s, 3 * dwell_s),
            settling_s=min(self.settling_s, dwell_s / 2),
            window_s=min(self.window_s, dwell_s / 2) or self.window_s,
        )

    def changed(self, *, dwell_s: float | None = None, **values: Any) -> Plan:
        """Return the plan with other values of its fields; `dwell_s` as in `with_dwell`."""
        plan = dataclasses.replace(self, **values)
        return plan if dwell_s is None else plan.with_dwell(dwell_s)

    def to_toml(self) -> str:
        """Return the plan as TOML, every key written out."""
        return tomli_w.dumps(dataclasses.asdict(self))


def resume_point(plan: Plan, marks: list[StepMark]) -> tuple[int, int]:
    """Return (first cycle, complete cycles) with which a broken run resumes.

    The next number that was never begun.

    Parameters
    ----------
    marks : steps of the broken run, in order.
    """
    per_cycle = len(plan.targets_kpa)
    reached: dict[int, int] = {}
    for mark in marks:
        if mark.cycle:
            reached[mark.cycle] = reached.get(mark.cycle, 0) + (mark.status == "reached")
    return max(reached, default=0) + 1, sum(n == per_cycle for n in reached.values())


def _check(plan: Plan) -> None:
    """Refuse by key values that make no plan."""
    where = f"plan {plan.name!r:.60}"
    if plan.kind not in KINDS:
        raise BadValue(where, "kind", f"is {plan.kind!r:.40}", "use one of " + ", ".join(KINDS))
    if not plan.name.strip() or len(plan.name) > 100:
        raise BadValue(where, "name", "must have 1 to 100 characters")
    for key in ("ramp_kpa_per_s", "tolerance_kpa", "window_s", "max_dwell_s", "arrival_timeout_s", "step_kpa"):
        if not getattr(plan, key) > 0:
            raise BadValue(where, key, f"must be above 0, not {getattr(plan, key)}")
    for key in ("settling_s", "min_dwell_s", "pressure_drift_kpa_per_s", "signal_drift_mv_per_s", "reading_timeout_s"):
        if not getattr(plan, key) >= 0:
            raise BadValue(where, key, f"must not be negative, not {getattr(plan, key)}")
    for low, high in (("low_kpa", "high_kpa"), ("min_kpa", "max_kpa")):
        if not getattr(plan, low) < getattr(plan, high):
            raise BadValue(where, low, f"must be below '{high}'", "swap the two" if getattr(plan, low) else "")
    if not plan.min_kpa <= 0 <= plan.max_kpa:
        raise BadValue(where, "min_kpa" if plan.min_kpa > 0 else "max_kpa", "excludes 0 kPa, a vented unit's pressure")
    if plan.low_kpa < plan.min_kpa:
        raise BadValue(where, "low_kpa", f"is below the plan's own limit of {plan.min_kpa:g} kPa")
    if plan.high_kpa > plan.max_kpa:
        raise BadValue(where, "high_kpa", f"is above the plan's own limit of {plan.max_kpa:g} kPa")
    if plan.max_dwell_s < max(plan.min_dwell_s, plan.settling_s + plan.window_s):
        raise BadValue(where, "max_dwell_s", "is shorter than the shortest hold, or than settling_s + window_s")
    _check_staircase(plan, where)


def _check_staircase(plan: Plan, where: str) -> None:
    """Refuse by key a staircase that does not meet both ends, or never ends."""
    steps = (plan.high_kpa - plan.low_kpa) / plan.step_kpa
    if plan.kind == "staircase" and (steps < 1 or abs(steps - round(steps)) > 1e-6):
        raise BadValue(where, "step_kpa", f"must divide the span of {plan.high_kpa - plan.low_kpa:g} kPa evenly")
    if plan.kind == "staircase" and plan.step_kpa <= 2 * plan.tolerance_kpa:
        raise BadValue(where, "step_kpa", "must be more than twice 'tolerance_kpa', to distinguish the plateaus")
    per_cycle = 2 if plan.kind == "continuous" else 2 * steps
    if plan.cycles < 1 or plan.cycles * per_cycle > MAX_STEPS:
        why = f"must be at least 1 and make no more than {MAX_STEPS} steps, not {plan.cycles}"
        raise BadValue(where, "cycles", why)


def plan_from_toml(text: str, where: str = "the plan") -> Plan:
    """Return the plan that `text` describes.

    Raises
    ------
    OperatorError : not TOML, or refused by key.
    """
    return build(Plan, parse_toml(text, where), where)


def built_in_plans() -> dict[str, Plan]:
    """Return the plans that come with the program, by name."""
    folder = resources.files("boat_daq.engine") / "plans"
    files = sorted((f for f in folder.iterdir() if f.name.endswith(".toml")), key=lambda f: f.name)
    plans = (plan_from_toml(f.read_text(encoding="utf-8"), f.name) for f in files)
    return {plan.name: plan for plan in plans}


def load_plan(name_or_path: str) -> Plan:
    """Return a built-in plan by name, or the one in a file.

    Raises
    ------
    OperatorError : neither a built-in name nor a readable plan.
    """
    built_in = built_in_plans()
    if name_or_path in built_in:
        return built_in[name_or_path]
    path = Path(name_or_path).expanduser()
    if not path.exists():
        remedy = f"use {' or '.join(built_in)}, or the path of a TOML file"
        raise OperatorError(f"there is no plan '{name_or_path}'", remedy)
    return plan_from_toml(read_text(path), str(path))
