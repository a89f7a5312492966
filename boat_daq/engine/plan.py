"""A plan: which pressures, in which order, and what ends each of them. A frozen value, in and out as TOML.

Three kinds. A *staircase* holds a plateau at every `step_kpa` from `high_kpa` down to `low_kpa` and back up, cycle
after cycle. A *continuous* plan only turns at the two ends. A cycle of either runs from `high_kpa` through `low_kpa`
back to `high_kpa`. A *profile* is a list of segments, steps, ramps and sines, in kilopascal or in millimetres of
elongation, parts of which may be repeated in loops; once through the list is a cycle. Its segments last a given time.

Neighbouring cycles share the plateau at `high_kpa`: it is held once, numbered as the last of the cycle that ends there,
and is also the point at which the next one begins. The plateau that opens the run belongs to no cycle and is marked
"start". So every cycle owns the same number of plateaus (its nine below and nine above in the calibration plan, -40 and
the closing +50 among them), none is counted twice in a fit, and each branch is whole when the plateau before its first
one is taken as its beginning. The opening plateau is held until it is steady like every other, so that the first cycle
begins from the same history as the rest.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import tomli_w

from boat_daq.engine.toml_values import BadValue, build, parse_toml, read_text
from protocol.base.errors import ChoiceError, RequestError, one_of
from protocol.base.units import Quantity, UnitText
from protocol.recording import SEGMENT_KINDS, Segment

KINDS = ("staircase", "continuous", "profile")
QUANTITIES = ("kPa", "mm")
_MAX_STEPS = 100_000

Branch = Literal["start", "unloading", "loading", "end"]


@dataclass(frozen=True, slots=True)
class Loop:
    """Segments of a profile that are run several times: from `first` to `last`, numbered from 1, `times` times."""

    first: int
    last: int
    times: int


@dataclass(frozen=True, slots=True)
class PlannedStep:
    """One target: `cycle` is 0 outside the cycles.

    `plateau` where it is held until it is steady; `passed` where a run holds it no longer. Of a profile, `segment` and
    the value `start` it begins at; `target_kpa` is then in the plan's quantity.
    """

    cycle: int
    branch: Branch
    target_kpa: float
    plateau: bool
    segment: Segment | None = None
    start: float = 0.0
    passed: bool = False


@dataclass(frozen=True, slots=True)
class StepMark:
    """One step of a run as the recording's table `step` keeps it. `number` is its `step_id`. Times are board time."""

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

    @property
    def passed(self) -> bool:
        """Whether the pressure only passed it: no plateau to read."""
        return bool(self.detail.get("passed"))


@dataclass(frozen=True, slots=True)
class Plan:
    """What a run does."""

    name: str
    kind: str
    cycles: int
    high_kpa: float = 50.0  # a cycle starts at this end
    low_kpa: float = -40.0
    step_kpa: float = 10.0  # distance of the staircase's plateaus; divides the span
    ramp_kpa_per_s: float = 10.0
    min_kpa: float = -40.0  # the plan's own limits; the pressure never goes 2 kPa beyond them
    max_kpa: float = 50.0
    tolerance_kpa: float = 1.0  # the pressure has arrived while it is this close to its target
    settling_s: float = 1.0  # it has settled once it stayed so close for this long
    window_s: float = 2.0  # shortest stretch of settled samples that may show a plateau to be steady
    min_dwell_s: float = 3.0  # shortest and longest hold, from the arrival
    max_dwell_s: float = 20.0
    pressure_drift_kpa_per_s: float = 0.2  # a plateau is steady when no drift faster than this is credible
    signal_drift_mv_per_s: float = 1.0
    arrival_timeout_s: float = 10.0  # allowed beyond the ramp's own time until the pressure has arrived
    reading_timeout_s: float = 600.0  # longest wait at a plateau for its reading, where readings are waited for
    quantity: str = "kPa"  # of a profile's values: "kPa" or "mm"
    end_percent_fso: float = 0.0  # half width of drift's and repeatability's intervals that ends the run; 0: none
    segments: tuple[Segment, ...] = ()
    loops: tuple[Loop, ...] = ()

    def __post_init__(self) -> None:
        _check(self)

    @property
    def controls_elongation(self) -> bool:
        """Whether its values are elongations."""
        return self.quantity == "mm"

    @property
    def extremes_kpa(self) -> tuple[float, ...]:
        """The lowest and the highest pressure it commands; none where its values are elongations."""
        if self.kind != "profile":
            return self.low_kpa, self.high_kpa
        ends = [] if self.controls_elongation else [end for segment in self.segments for end in segment.extremes]
        return (min(ends), max(ends)) if ends else ()

    @property
    def unrolled(self) -> tuple[Segment, ...]:
        """The segments of one cycle of a profile in the order in which they are run, loops unrolled."""
        return tuple(self.segments[at] for at in _unrolled(0, len(self.segments), self.loops))

    @property
    def targets_kpa(self) -> tuple[float, ...]:
        """Targets of one cycle after its start: down to `low_kpa`, then up to `high_kpa`; those of a profile's list."""
        if self.kind == "profile":
            return tuple(segment.target for segment in self.unrolled)
        if self.kind == "continuous":
            return (self.low_kpa, self.high_kpa)
        n = round((self.high_kpa - self.low_kpa) / self.step_kpa)
        down = [self.high_kpa - (self.high_kpa - self.low_kpa) * i / n for i in range(1, n + 1)]
        return (*down, *reversed(down[:-1]), self.high_kpa)

    @property
    def opening(self) -> PlannedStep:
        """The step that brings the unit to where the cycles start."""
        if self.kind == "profile":
            begin = Segment("step", self._start, hold_s=self.min_dwell_s)
            return PlannedStep(0, "start", begin.target, False, begin)
        return PlannedStep(0, "start", self.high_kpa, self.kind == "staircase")

    def cycle_steps(self, cycle: int) -> tuple[PlannedStep, ...]:
        """Return the steps of one cycle (numbered from 1)."""
        if self.kind == "profile":
            segments = self.unrolled
            ends = [segment.target for segment in segments]
            starts = [self._start if cycle == 1 else ends[-1], *ends[:-1]]
            return tuple(
                PlannedStep(cycle, "loading" if s.target >= start else "unloading", s.target, s.reading, s, start)
                for s, start in zip(segments, starts, strict=True)
            )
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

    @property
    def _start(self) -> float:
        """The value at which a profile begins."""
        first = self.segments[0]
        return 0.0 if first.kind == "ramp" else first.target

    def step_duration_s(self, from_kpa: float, to_kpa: float) -> float:
        """Estimate one step's time. Its ramp, its arrival within tolerance, and its shortest hold."""
        hold = self.min_dwell_s
        if self.kind == "staircase":
            hold = max(hold, self.settling_s + self.window_s)
        return abs(to_kpa - from_kpa) / self.ramp_kpa_per_s + hold

    @property
    def cycle_duration_s(self) -> float:
        """Estimated time of one cycle, seconds of board time."""
        if self.kind == "profile":
            return self._segments_s(2)
        path = (self.high_kpa, *self.targets_kpa)
        return sum(self.step_duration_s(a, b) for a, b in itertools.pairwise(path))

    @property
    def duration_s(self) -> float:
        """Estimated time of an unbroken run, seconds of board time."""
        if self.kind == "profile":  # its first cycle begins at rest, the others where one ends
            return self.min_dwell_s + self._segments_s(1) + (self.cycles - 1) * self.cycle_duration_s
        return self.step_duration_s(0.0, self.high_kpa) + self.cycles * self.cycle_duration_s

    def _segments_s(self, cycle: int) -> float:
        return sum(s.segment.duration_s(s.start) for s in self.cycle_steps(cycle) if s.segment)

    def with_dwell(self, dwell_s: float) -> Plan:
        """Return the plan with this shortest hold. One too short for settling and window shortens both to fit."""
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
    """Return (first cycle, complete cycles) with which a broken run resumes. The next number that was never begun."""
    per_cycle = len(plan.targets_kpa)
    reached: dict[int, int] = {}
    for mark in marks:
        if mark.cycle:
            reached[mark.cycle] = reached.get(mark.cycle, 0) + (mark.status == "reached")
    return max(reached, default=0) + 1, sum(n == per_cycle for n in reached.values())


def _unrolled(first: int, last: int, loops: tuple[Loop, ...]) -> list[int]:
    """Return the places of the segments from `first` up to `last` in the order in which they are run."""
    order: list[int] = []
    at = first
    while at < last:
        inside = [loop for loop in loops if loop.first - 1 == at and loop.last <= last]
        if not inside:
            order.append(at)
            at += 1
            continue
        outer = max(inside, key=lambda loop: loop.last)
        order += _unrolled(at, outer.last, tuple(loop for loop in loops if loop is not outer)) * outer.times
        at = outer.last
    return order


def _check_loops(plan: Plan, where: str) -> float:
    """Refuse by key loops that cross, or are not of this list; return the number of segments that a cycle runs."""
    times = [1.0] * len(plan.segments)
    for number, loop in enumerate(plan.loops, 1):
        here = f"{where}, loop {number}"
        if not 1 <= loop.first <= loop.last <= len(plan.segments):
            why = f"is {loop.last}: the loop must be of segments 1 to {len(plan.segments)}, 'first' not after 'last'"
            raise BadValue(here, "last", why)
        if not 2 <= loop.times <= _MAX_STEPS:
            raise BadValue(here, "times", f"must be 2 to {_MAX_STEPS}, not {loop.times}")
        for other in plan.loops[: number - 1]:
            apart = loop.last < other.first or other.last < loop.first
            inside = other.first <= loop.first <= loop.last <= other.last
            around = loop.first <= other.first <= other.last <= loop.last
            if not (apart or inside or around) or (loop.first, loop.last) == (other.first, other.last):
                raise BadValue(here, "first", f"crosses the loop of segments {other.first} to {other.last}")
        times[loop.first - 1 : loop.last] = [n * loop.times for n in times[loop.first - 1 : loop.last]]
    return sum(times)


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
    durations = ("settling_s", "min_dwell_s", "reading_timeout_s")
    for key in (*durations, "pressure_drift_kpa_per_s", "signal_drift_mv_per_s", "end_percent_fso"):
        if not getattr(plan, key) >= 0:
            raise BadValue(where, key, f"must not be negative, not {getattr(plan, key)}")
    for low, high in (("low_kpa", "high_kpa"), ("min_kpa", "max_kpa")):
        if not getattr(plan, low) < getattr(plan, high):
            raise BadValue(where, low, f"must be below '{high}'", "swap the two" if getattr(plan, low) else "")
    if not plan.min_kpa <= 0 <= plan.max_kpa:
        raise BadValue(where, "min_kpa" if plan.min_kpa > 0 else "max_kpa", "excludes 0 kPa, a vented unit's pressure")
    _check_profile(plan, where)
    if plan.low_kpa < plan.min_kpa:
        raise BadValue(where, "low_kpa", UnitText("is below the plan's own limit of ", Quantity(plan.min_kpa, "kPa")))
    if plan.high_kpa > plan.max_kpa:
        raise BadValue(where, "high_kpa", UnitText("is above the plan's own limit of ", Quantity(plan.max_kpa, "kPa")))
    if plan.max_dwell_s < max(plan.min_dwell_s, plan.settling_s + plan.window_s):
        raise BadValue(where, "max_dwell_s", "is shorter than the shortest hold, or than settling_s + window_s")
    _check_staircase(plan, where)


def _check_profile(plan: Plan, where: str) -> None:
    """Refuse by key segments that make no profile, or segments of another kind of plan."""
    if plan.end_percent_fso and plan.kind != "continuous":
        raise BadValue(where, "end_percent_fso", "is of plans without plateaus only")
    if plan.quantity not in QUANTITIES:
        raise BadValue(where, "quantity", f"is {plan.quantity!r:.40}", "use one of " + ", ".join(QUANTITIES))
    if plan.kind != "profile":
        if plan.segments or plan.loops or plan.controls_elongation:
            raise BadValue(where, "kind", "must be 'profile' for segments, loops and millimetres")
        return
    if not plan.segments:
        raise BadValue(where, "segments", "is empty", "add at least one [[segments]]")
    for number, segment in enumerate(plan.segments, 1):
        _check_segment(segment, f"{where}, segment {number}")
    low, high = plan.extremes_kpa or (0.0, 0.0)
    if low < plan.min_kpa or high > plan.max_kpa:
        first, last, least, most = (Quantity(kpa, "kPa") for kpa in (low, high, plan.min_kpa, plan.max_kpa))
        text = UnitText("lead to ", first, " to ", last, ", beyond the plan's own limits, ", least, " to ", most)
        raise BadValue(where, "segments", text)


def _check_segment(segment: Segment, where: str) -> None:
    """Refuse by key values that make no segment."""
    if segment.kind not in SEGMENT_KINDS:
        raise BadValue(where, "kind", f"is {segment.kind!r:.40}", "use one of " + ", ".join(SEGMENT_KINDS))
    sine = segment.kind == "sine"
    needed = {"ramp": ("rate_per_s",), "sine": ("amplitude", "frequency_hz", "periods"), "step": ("hold_s",)}
    for key in needed[segment.kind]:
        if not getattr(segment, key) > 0:
            raise BadValue(where, key, f"must be above 0, not {getattr(segment, key)}")
    if segment.hold_s < 0 or segment.hold_s > 1e6:
        raise BadValue(where, "hold_s", f"must be 0 to 1e6, not {segment.hold_s}")
    if sine and abs(2 * segment.periods - round(2 * segment.periods)) > 1e-9:
        raise BadValue(where, "periods", "must be whole or half periods, so that the sine ends at its mean")
    for key in ("amplitude", "frequency_hz", "periods"):
        if not sine and getattr(segment, key):
            raise BadValue(where, key, "applies to a sine only")


def _check_staircase(plan: Plan, where: str) -> None:
    """Refuse by key a staircase that does not meet both ends, or never ends."""
    steps = (plan.high_kpa - plan.low_kpa) / plan.step_kpa
    if plan.kind == "staircase" and (steps < 1 or abs(steps - round(steps)) > 1e-6):
        span = Quantity(plan.high_kpa - plan.low_kpa, "kPa")
        raise BadValue(where, "step_kpa", UnitText("must divide the span of ", span, " evenly"))
    if plan.kind == "staircase" and plan.step_kpa <= 2 * plan.tolerance_kpa:
        raise BadValue(where, "step_kpa", "must be more than twice 'tolerance_kpa', to distinguish the plateaus")
    per_cycle = {"continuous": 2.0, "profile": _check_loops(plan, where)}.get(plan.kind, 2 * steps)
    if plan.cycles < 1 or plan.cycles * per_cycle > _MAX_STEPS:
        why = f"must be at least 1 and make no more than {_MAX_STEPS} steps, not {plan.cycles}"
        raise BadValue(where, "cycles", why)


def plan_from_toml(text: str, where: str = "the plan") -> Plan:
    """Return the plan that `text` describes. RequestError: not TOML, or refused by key."""
    return plan_from_table(parse_toml(text, where), where)


def plan_from_table(table: Mapping[str, Any], where: str) -> Plan:
    """Return the plan of a table, as `dataclasses.asdict` gives it. RequestError: refused by key."""
    found: dict[str, tuple[Any, ...]] = {}
    for key, kind in (("segments", Segment), ("loops", Loop)):
        entries = table.get(key, [])
        if not isinstance(entries, list | tuple) or not all(isinstance(one, dict) for one in entries):
            raise BadValue(where, key, "must be a list of tables", f"write [[{key}]] before each")
        found[key] = tuple(build(kind, one, f"{where}, {key[:-1]} {number}") for number, one in enumerate(entries, 1))
    rest = {key: value for key, value in table.items() if key not in found}
    return build(Plan, rest, where, **found)


@functools.cache
def built_in_plans() -> Mapping[str, Plan]:
    """Return the plans that come with the program, by name."""
    folder = resources.files("boat_daq.engine") / "plans"
    files = sorted((f for f in folder.iterdir() if f.name.endswith(".toml")), key=lambda f: f.name)
    plans = (plan_from_toml(f.read_text(encoding="utf-8"), f.name) for f in files)
    return MappingProxyType({plan.name: plan for plan in plans})


def load_plan(name_or_path: str) -> Plan:
    """Return a built-in plan by name, or the one in a file."""
    built_in = built_in_plans()
    if name_or_path in built_in:
        return built_in[name_or_path]
    path = Path(name_or_path).expanduser()
    if not path.exists():
        remedy = f"{one_of(name_or_path, built_in)} (a plan of your own: the path of its file)"
        raise ChoiceError(f"there is no plan '{name_or_path}'", remedy)
    return plan_from_toml(read_text(path), str(path))


def plans_in(folder: Path) -> Mapping[str, Plan]:
    """Return the built-in plans and those in the TOML files of a folder, by name."""
    found = dict(built_in_plans())
    if not folder.is_dir():
        raise RequestError(f"{folder} is not a folder", "choose the folder with the files of your plans")
    for path in sorted(folder.glob("*.toml")):
        plan = plan_from_toml(read_text(path), str(path))
        if plan.name in found:
            raise RequestError(f"{path} has the name of another plan, {plan.name!r}", "change 'name' in the file")
        found[plan.name] = plan
    return found
