"""Time against error of any method, measured; the front; and the rule by which a default is chosen.

Strategy: a method gives its settings as calls; each is called several times, timed by the clock and by the processor,
and its result is judged against a reference that the setting does not share. The first call of a setting is not timed:
it compiles and warms.

Rules: the choice is written once, in `choose`. Costs are compared in processor time, which other work on the machine
disturbs less than the clock. A result that is not a number is an infinite error, never left out.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

Progress = Callable[[float, float], None]

MARGIN = 2.0
"""An error counts as below a tolerance when it is below it by this factor."""
TIE = 1.3
"""Costs within this factor are the same: repeats on a busy machine differ by as much."""
SHORTEST_S = 2e-3
"""A call shorter than this is repeated until it is as long, and the time divided."""


@dataclass(frozen=True, slots=True)
class Setting:
    """One way to run a method.

    Parameters
    ----------
    name : what is set, as the chart writes it.
    call : does the work once; takes the number of the repeat, so that a sample can be another one each time.
    error : judges a result against the reference, in the method's unit.
    work : results that one call gives; the time is divided by it.
    """

    name: str
    call: Callable[[int], Any]
    error: Callable[[Any], float]
    work: int = 1


@dataclass(frozen=True, slots=True)
class Method:
    """A method and who uses its number.

    Parameters
    ----------
    name : as the command takes it. title : as the chart shows it.
    reference : what the error is measured against. consumer : who cannot notice less than `tolerance`, in `unit`.
    per : what one time is for.
    default : name of the setting that the program uses.
    settings : prepares the settings; True for the quick run.
    kept_because : why the program keeps its default although the rule chooses another; empty where it does not.
    """

    name: str
    title: str
    reference: str
    consumer: str
    tolerance: float
    unit: str
    per: str
    default: str
    settings: Callable[[bool], Sequence[Setting]]
    kept_because: str = ""


@dataclass(frozen=True, slots=True)
class Point:
    """One setting, measured.

    Parameters
    ----------
    seconds : median time by the clock; spread : greatest less smallest of the repeats.
    cpu_seconds : median processor time of all threads.
    error : root mean square over the repeats; error_spread : greatest less smallest.
    """

    setting: str
    seconds: float
    error: float
    spread: float
    cpu_seconds: float
    error_spread: float
    repeats: int


@dataclass(frozen=True, slots=True)
class Measured:
    """A method's points, the names of those on the front, and what the rule chooses (None: no point is good enough)."""

    method: Method
    points: tuple[Point, ...]
    front: tuple[str, ...]
    chosen: str | None

    @property
    def default_is_chosen(self) -> bool:
        """Whether the program's default is what the rule chooses."""
        return self.chosen == self.method.default

    @property
    def verdict(self) -> str:
        """One sentence about the default."""
        kept = f" It is kept: {self.method.kept_because}." if self.method.kept_because else ""
        if self.default_is_chosen:
            return f"the default, {self.method.default}, is the cheapest below the tolerance"
        if self.chosen is None:
            return (
                f"no setting measured is below the tolerance by {MARGIN:g}; the default is {self.method.default}.{kept}"
            )
        return f"the rule chooses {self.chosen}, the default is {self.method.default}.{kept}"


def front_of(points: Sequence[Point]) -> tuple[str, ...]:
    """Return the settings that no other beats in both processor time and error, cheapest first."""
    best, names = math.inf, []
    for point in sorted(points, key=lambda p: (p.cpu_seconds, p.error)):
        if point.error < best:
            best = point.error
            names.append(point.setting)
    return tuple(names)


def choose(points: Sequence[Point], tolerance: float, default: str | None = None) -> str | None:
    """Choose a setting: the cheapest whose error is below the consumer's tolerance with a margin.

    Parameters
    ----------
    points : measured.
    tolerance : what the consumer can notice, in the unit of the errors.
    default : kept where it is good enough and costs the same as the cheapest within `TIE`.

    Returns
    -------
    Its name, or None where no point is good enough.
    """
    enough = [p for p in points if p.error * MARGIN <= tolerance]
    if not enough:
        return None
    cheapest = min(enough, key=lambda p: p.cpu_seconds)
    same = [p.setting for p in enough if p.setting == default and p.cpu_seconds <= TIE * cheapest.cpu_seconds]
    return same[0] if same else cheapest.setting


def measure(method: Method, *, quick: bool, progress: Progress | None = None) -> Measured:
    """Measure every setting of a method.

    Parameters
    ----------
    quick : fewer settings, 3 repeats; else 7.
    progress : called with (settings done, settings) after each; raising from it cancels.
    """
    settings = method.settings(quick)
    points = []
    for done, setting in enumerate(settings, 1):
        points.append(measure_setting(setting, 3 if quick else 7))
        if progress is not None:
            progress(done, len(settings))
    return Measured(method, tuple(points), front_of(points), choose(points, method.tolerance, method.default))


def measure_setting(setting: Setting, repeats: int) -> Point:
    """Time one setting and judge its results."""
    began = time.perf_counter()
    setting.call(0)
    calls = max(1, math.ceil(SHORTEST_S / max(time.perf_counter() - began, 1e-7)))
    clock, busy, errors = [], [], []
    for repeat in range(repeats):
        began, began_cpu = time.perf_counter(), time.process_time()
        for _ in range(calls):
            result = setting.call(repeat)
        each = calls * setting.work
        busy.append((time.process_time() - began_cpu) / each)
        clock.append((time.perf_counter() - began) / each)
        error = abs(float(setting.error(result)))
        errors.append(error if math.isfinite(error) else math.inf)
    rms = math.sqrt(sum(e * e for e in errors) / repeats)
    return Point(setting.name, median(clock), rms, max(clock) - min(clock), median(busy), _range(errors), repeats)


def _range(errors: Sequence[float]) -> float:
    return max(errors) - min(errors) if math.isfinite(max(errors)) else math.inf
