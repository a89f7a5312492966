"""Time against error of any method, measured; the Pareto front; and the rule by which a setting is chosen.

Strategy: a method lists its settings as calls; each is called several times, timed by the clock and by the processor,
and its result is compared with a reference that is independent of the setting. The first call of a setting prepares
and compiles; it is reported apart and is in no median.

Rules: the choice is written once, in `choose`. Costs are compared in processor time, which other work on the machine
disturbs less than the clock. A result that is not a number is an infinite error, never left out.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from analysis.fidelity import LEVELS, MARGINS, Fidelity, Level, fidelity
from analysis.progress import Progress
from analysis.studies.harness import run_all

MARGIN = MARGINS["normal"]  # an error counts as below a tolerance when it is below it by this factor
TIE = 1.3  # costs within this factor are the same: repeats on a busy machine differ by as much
SHORTEST_S = 2e-3  # a call shorter than this is repeated until it is as long, and the time divided
REPEATS, QUICK_REPEATS, _FEWEST = 7, 2, 3
LONGEST_S = 20.0  # repeats end here once there are `_FEWEST`


@dataclass(frozen=True, slots=True)
class Setting:
    """One setting of a method.

    `call`: does the work once; takes the number of the repeat, so that a sample can be another one each time. What it
    prepares and keeps at its first call is not timed.
    """

    name: str
    call: Callable[[int], Any]
    error: Callable[[Any], float]  # error of a result against the reference, in the method's unit
    work: float = 1.0  # results that one call gives; the time is divided by it


@dataclass(frozen=True, slots=True)
class Method:
    """A method and the consumer of its number."""

    name: str
    title: str
    reference: str  # what the error is measured against
    independent: bool  # whether it shares nothing with the method
    consumer: str  # reader of the number, who notices an error above `tolerance`, in `unit`
    tolerance: float
    unit: str
    per: str  # what one time is measured for
    setting_at: Callable[[Fidelity], str]  # name of the setting that the program uses at a fidelity
    settings: Callable[[bool], Sequence[Setting]]  # lists the settings; True for the quick run
    one_for_all: bool = False  # whether all levels of precision have the setting of normal
    kept: str = ""  # why the default is kept where the rule chooses another

    @property
    def in_code(self) -> dict[Level, str]:
        """Return the setting that the program uses at each fidelity."""
        return {level: self.setting_at(fidelity(level)) for level in LEVELS}

    @property
    def default(self) -> str:
        """Return the setting that the program uses by default."""
        return self.in_code["normal"]


@dataclass(frozen=True, slots=True)
class CostPoint:
    """One setting, measured."""

    setting: str
    seconds: float  # median time by the clock
    error: float  # root mean square over the repeats
    spread: float  # greatest less smallest of the repeats
    cpu_seconds: float  # median processor time of all threads; cpu_spread likewise
    error_spread: float
    repeats: int
    cpu_spread: float = 0.0
    first_seconds: float = 0.0  # the first call by the clock: what is prepared once, compilation among it


@dataclass(frozen=True, slots=True)
class Measured:
    """A method's points, the names of those on the front, and what the rule chooses (None: no point is sufficient).

    `levels` has the rule's choice for each fidelity.
    """

    method: Method
    points: tuple[CostPoint, ...]
    front: tuple[str, ...]
    chosen: str | None
    levels: Mapping[Level, str]

    @classmethod
    def of(cls, method: Method, points: Sequence[CostPoint]) -> Measured:
        """Find the front and apply the rule."""
        chosen = choose(points, method.tolerance, method.default)
        return cls(method, tuple(points), front_of(points), chosen, choose_levels(points, method))

    @property
    def default_is_chosen(self) -> bool:
        """Return whether the program's default is what the rule chooses."""
        return self.chosen == self.method.default

    @property
    def verdict(self) -> str:
        """Return one sentence about the default."""
        limit = f"an error of at most {part_of_tolerance(MARGIN)}"
        if self.default_is_chosen:
            return f"the default, {self.method.default}, is the cheapest with {limit}"
        if self.chosen is None:
            return f"no setting measured has {limit}; the default is {self.method.default}"
        return f"the rule chooses {self.chosen}, the default is {self.method.default}{self.method.kept}"


def part_of_tolerance(margin: float) -> str:
    """Return how much of a tolerance an error may be with a margin, as text."""
    return "half the tolerance" if margin == 2.0 else f"1/{margin:g} of the tolerance"


def front_of(points: Sequence[CostPoint]) -> tuple[str, ...]:
    """Return the settings that no other beats in both processor time and error, cheapest first."""
    best, names = math.inf, []
    for point in sorted(points, key=lambda p: (p.cpu_seconds, p.error)):
        if point.error < best:
            best = point.error
            names.append(point.setting)
    return tuple(names)


def choose(
    points: Sequence[CostPoint], tolerance: float, default: str | None = None, margin: float = MARGIN
) -> str | None:
    """Choose a setting: the cheapest whose error is below the consumer's tolerance with a margin.

    `tolerance`: what the consumer notices, in the unit of the errors. `default`: kept where it is sufficient and costs
    the same as the cheapest within `TIE`. `margin`: how far below the tolerance is below.
    Returns its name, or None where no point is sufficient.
    """
    sufficient = [p for p in points if p.error * margin <= tolerance]
    if not sufficient:
        return None
    cheapest = min(sufficient, key=lambda p: p.cpu_seconds)
    same = [p.setting for p in sufficient if p.setting == default and p.cpu_seconds <= TIE * cheapest.cpu_seconds]
    return same[0] if same else cheapest.setting


def choose_levels(points: Sequence[CostPoint], method: Method) -> dict[Level, str]:
    """Return the rule's choice for each precision; where nothing is sufficient, the cheapest as exact as the best."""
    in_code, best = method.in_code, TIE * min(p.error for p in points)

    def chosen(level: Level) -> str:
        margin = MARGIN if method.one_for_all else MARGINS[level]
        sufficient = choose(points, method.tolerance, in_code[level], margin)
        return sufficient or choose(points, best, in_code[level], 1.0) or in_code[level]

    return {level: chosen(level) for level in LEVELS}


def measure(method: Method, *, quick: bool, progress: Progress | None = None) -> Measured:
    """Measure every setting of a method. `quick`: fewer settings, 2 repeats; else 7, fewer where they take long."""
    settings, repeats = method.settings(quick), QUICK_REPEATS if quick else REPEATS
    return Measured.of(
        method, run_all(settings, lambda setting, part: measure_setting(setting, repeats, part), progress)
    )


def measure_all(methods: Sequence[Method], *, quick: bool, progress: Progress | None = None) -> list[Measured]:
    """Measure several methods."""
    return run_all(methods, lambda method, part: measure(method, quick=quick, progress=part), progress)


def measure_setting(setting: Setting, repeats: int, progress: Progress | None = None) -> CostPoint:
    """Time one setting and compare its results with the reference."""
    report = progress or (lambda done, calls: None)
    report(0, repeats + 1)
    first, _, _ = _timed(setting, 0, 1)
    calls, clock, busy, errors = 1, [], [], []
    for repeat in range(repeats):
        report(repeat + 1, repeats + 1)
        seconds, cpu, result = _timed(setting, repeat, calls)
        if repeat == 0 and seconds < SHORTEST_S:
            calls = math.ceil(SHORTEST_S / max(seconds, 1e-7))
            seconds, cpu, result = _timed(setting, repeat, calls)
        clock.append(seconds / calls / setting.work)
        busy.append(cpu / calls / setting.work)
        error = abs(float(setting.error(result)))
        errors.append(error if math.isfinite(error) else math.inf)
        if len(clock) >= _FEWEST and sum(clock) * calls * setting.work > LONGEST_S:
            break
    report(1, 1)
    rms, times = math.sqrt(sum(e * e for e in errors) / len(errors)), (_range(clock), median(busy))
    return CostPoint(setting.name, median(clock), rms, *times, _range(errors), len(clock), _range(busy), first)


def _timed(setting: Setting, repeat: int, calls: int) -> tuple[float, float, Any]:
    """Call a setting; return seconds by the clock, by the processor, and the last result."""
    result = None
    began, began_cpu = time.perf_counter(), time.process_time()
    for _ in range(calls):
        result = setting.call(repeat)
    return time.perf_counter() - began, time.process_time() - began_cpu, result


def _range(values: Sequence[float]) -> float:
    return max(values) - min(values) if math.isfinite(max(values)) else math.inf
