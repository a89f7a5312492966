"""Beyond the grid: width, depth, spacing, count and face searched together, on detected power or counted rays.

Strategy: power converges where a count of rays does not, so the search uses power with every reflection followed,
unless it is told to count. The grid is scanned with half of the rays; its best designs, evaluated again, are the first
population of scipy's differential evolution (count and face as integers), each generation's candidates running side by
side. The search has converged when eight generations in a row have improved by less than a hundredth. The best of the
grid and of the search are then evaluated alike with ten times the rays, and both winners again with the fan turned
twice, so that chance at few rays is not reported as gain. A tolerance chooses the rays of that final evaluation.

With a confidence every design that was evaluated races the others, by fans of its own: the search prefers designs whose
errors are in their favour, so that its fan proves nothing of them. The race's best is then the one found.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.optimize import Bounds, OptimizeResult, differential_evolution

from analysis.optics.scene.curves import frames_of
from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.geometry import pattern_of
from analysis.optics.scene.parameters import PAPER_OPTIMUM, PAPER_RAYS, By, Design, Face, Light, Waveguide, light_by
from analysis.optics.sweep.fans import light_within, turned
from analysis.optics.sweep.figure_of_merit import FLOOR, merit
from analysis.optics.sweep.race import RACE_MOST_RAYS, Race, first_rays_of
from analysis.optics.sweep.sweep import (
    SweepRequest,
    SweepResult,
    common_of,
    compile_tracer,
    paper_grid,
    result_of,
    run_item,
)
from analysis.optics.tracer.tolerance import TRIES, finer, rays_for, stated_error, unmet
from analysis.progress import Progress
from protocol.base.arrays import FloatArray
from protocol.base.errors import ChoiceError, RequestError

POPULATION = 16  # designs of a generation
BOUNDS = ((1.0, 9.0), (0.3, 2.0), (0.2, 1.6), (0.3, 2.0), (0.0, 1.0))
PATIENCE, BETTER = 8, 0.01  # generations without a design better by that part, after which the search has converged
TURNS = 2  # number of further turns of the fan at which the winners are evaluated
_CHECK, _SCAN, _FINALISTS, _FEW = 10, 2, 6, 2
_SCAN_PART, _SEARCH_PART = 0.45, 0.8  # parts of the time after which the scan of the grid and the search are stopped

Scored = tuple[float, Design]


@dataclass(frozen=True, slots=True)
class Winner:
    """A design of a search."""

    design: Design
    p: float  # with p_range: its P, least and greatest P over three turns of the fan
    p_range: tuple[float, float]
    power: FloatArray  # with power_sd: (15,) detected power, emitted = 1, and its standard deviation
    power_sd: FloatArray
    given_up: float  # the largest power that was not followed to an end in a state


@dataclass(frozen=True, slots=True)
class Optimum:
    """Result of the search."""

    start: Winner  # with best: the grid's best design and the one found
    best: Winner
    paper_p: float  # P of the paper's; all at `checked_rays`
    evaluations: int
    seconds: float
    rays: int  # with checked_rays: released in the search and in the final evaluation
    checked_rays: int
    finished: bool  # False if the time ran out before the search converged
    by: By  # what P is computed from
    error: float  # greatest of the winners' responses in the final evaluation, rays of 250 at 2 standard deviations
    work_rays: int  # rays released for each state in search, race and final evaluation
    race: Race | None = None

    @property
    def saving(self) -> float:
        """Return how many times less work all of it was than the race's precision for every design evaluated."""
        return np.nan if self.race is None else self.race.equal_work / self.work_rays

    @property
    def gain(self) -> float:
        """Return the found P over the grid's best."""
        return self.best.p / self.start.p


class DesignMerit:
    """P of designs over the given states; safe to call from several threads."""

    def __init__(self, frames: Sequence[SceneFrame], guide: Waveguide, light: Light, by: By) -> None:
        self.request = SweepRequest((), guide, light, by=by)
        self._common = common_of(frames, guide, light)
        compile_tracer(self._common)
        self._free = min(f.free_mm for f in frames)
        self._mirrored = np.array([f.mirrored for f in frames])

    @property
    def mirrored(self) -> bool:
        """Return whether every state is its own mirror image."""
        return bool(np.all(self._mirrored))

    def fits(self, design: Design) -> bool:
        """Return whether the design can be built in every state."""
        return design.row_mm < self._free and design.cut_mm < self.request.guide.thickness_mm * (1 - 1e-6)

    def result(self, design: Design) -> SweepResult:
        """Return the sweep of one design."""
        return self.swept([design], map)

    def swept(self, designs: Sequence[Design], side_by_side: Callable[..., Iterable[Any]]) -> SweepResult:
        """Return the sweep of some designs, one call each of a function such as `map`."""
        each = side_by_side(lambda design: run_item(self._common, pattern_of(design)[None]), designs)
        counts, energy, changes = map(np.concatenate, zip(*each, strict=True))
        request = replace(self.request, designs=tuple(designs))
        return result_of(request, self._mirrored, (counts, energy, changes))

    def p(self, design: Design) -> float:
        """Return P of 250 rays, or of their power; -inf for a design that cannot be built."""
        return p_of(self.result(design)) if self.fits(design) else -np.inf


def p_of(result: SweepResult) -> float:
    """Return P of a single design, its RMSE no smaller than the paper's rays resolve."""
    return float(merit(result.response[0], FLOOR).p[0])


def design_at(x: FloatArray) -> Design:
    """Return the design at a point of the search space: count, width, depth, spacing (mm), face (0 outer, 1 inner)."""
    face: Face = "inner" if round(float(x[4])) else "outer"
    return Design(round(float(x[0])), float(x[1]), float(x[2]), float(x[3]), face)


def _point(design: Design) -> list[float]:
    return [*design.values, 1.0 if design.face == "inner" else 0.0]


def optimise(
    guide: Waveguide,
    curves: FloatArray,
    *,
    rays: int = 2_000,
    seconds: float = 50.0,
    first_face: Face = "outer",
    by: By = "power",
    seed: int = 0,
    confidence: float | None = None,
    most_rays: int = RACE_MOST_RAYS,
    race_seconds: float = np.inf,
    tolerance: float | None = None,
    progress: Progress | None = None,
) -> Optimum:
    """Search for the design with the largest P on power.

    Parameters
    ----------
    guide, curves : the guide and the states.
    rays : released in each evaluation, ten times as many in the final one, or as many as the tolerance takes.
    seconds : time after which the search stops; it is repeatable if it converges before.
    first_face : face of the grid from which the search starts.
    by : what P is computed from.
    confidence : probability that the race finds the best of the designs evaluated; None evaluates the six best.
    most_rays, race_seconds : bounds of the race, see `Race` and `Race.run`.
    tolerance : largest final error of the winners' counts, or of their power, rays of 250; None for any.

    Raises RequestError: no design of the grid can be built in these states, no time is allowed, or the tolerance cannot
    be met.
    """
    if not 0 < seconds < np.inf:
        raise ChoiceError(f"a search of {seconds:g} s", "allow more than 0 s, 50 s are enough")
    if first_face not in ("outer", "inner"):
        raise ChoiceError(f"a search of cavities in face '{first_face}'", "choose the outer or the inner face")
    began = time.perf_counter()
    frames = frames_of(curves, guide)
    pool = ThreadPoolExecutor(os.cpu_count() or 1)
    try:
        search = _Search(frames, guide, light_by(by, rays), by, pool, _watch(began, seconds, progress))
        final = light_by(by, _CHECK * rays)
        if tolerance is not None:  # refused before the search where most of the grid cannot meet it
            final = light_within(SweepRequest(tuple(search.grid(first_face)), guide, final, curves, by), tolerance)
        ranked = search.scan_grid(first_face, seed)
        if tolerance is not None:  # the grid's best may be noisier than most of it: refused before the long part
            search.require(tolerance, [design for _, design in ranked[:_FINALISTS]])
        found = search.evolve([design for _, design in ranked[:POPULATION]], seed)
        race = None if confidence is None else search.race(confidence, most_rays, seed, race_seconds, progress)
        return _evaluated(search, ranked, found, race, final, tolerance, began)
    finally:
        pool.shutdown(cancel_futures=True)


def _watch(began: float, allowed: float, progress: Progress | None) -> Callable[[float], bool]:
    """Return a clock that reports progress and returns whether a part of the time has passed."""

    def late(part: float) -> bool:
        gone = time.perf_counter() - began
        if progress is not None:
            progress(min(gone, allowed), allowed)
        return gone > part * allowed

    return late


@dataclass
class _Search:
    """Common state of the two stages: frames, light, threads, the clock, and the designs evaluated."""

    frames: Sequence[SceneFrame]
    guide: Waveguide
    light: Light
    by: By
    pool: ThreadPoolExecutor
    late: Callable[[float], bool]
    scanned: list[Design] = field(default_factory=list)
    seen: dict[Design, float] = field(default_factory=dict)
    evaluations: int = 0
    work: int = 0
    finished: bool = False

    @cached_property
    def merit(self) -> DesignMerit:
        """P at the rays of the search."""
        return self.merit_with(self.light)

    def merit_with(self, light: Light) -> DesignMerit:
        return DesignMerit(self.frames, self.guide, light, self.by)

    def scored(self, merit_of: DesignMerit, designs: Sequence[Design]) -> list[Scored]:
        """Return P and design of some designs that fit, evaluated side by side."""
        self.evaluations += len(designs)
        self.work += len(designs) * merit_of.request.light.rays
        return list(zip(self.pool.map(merit_of.p, designs), designs, strict=True))

    def grid(self, face: Face) -> list[Design]:
        """Return the designs of the paper's grid that fit. Raises RequestError where none does."""
        every = [design for design in paper_grid(face=face) if self.merit.fits(design)]
        if not every:
            raise RequestError("no design of the grid fits these states", "use longer or thicker guides")
        return every

    def scan_grid(self, face: Face, seed: int) -> list[Scored]:
        """Return the grid's best designs, best first; it is scanned in random order, as time may end the scan."""
        every = self.grid(face)
        grid = [every[i] for i in np.random.default_rng(seed).permutation(len(every))]
        coarse = self.merit_with(light_by(self.by, max(self.light.rays // _SCAN, 50)))
        rough: list[Scored] = []
        for first in range(0, len(grid), 2 * POPULATION):
            rough += self.scored(coarse, grid[first : first + 2 * POPULATION])
            if self.late(_SCAN_PART):
                break
        self.scanned = [design for _, design in rough]
        return _best(self.scored(self.merit, [design for _, design in _best(rough)[: 3 * POPULATION]]))

    def require(self, tolerance: float, designs: Sequence[Design]) -> None:
        """Check that one of some designs can meet a tolerance with the most rays."""
        self.evaluations += len(designs)
        self.work += len(designs) * self.light.rays
        results = self.pool.map(self.merit.result, designs)
        sd = min(float(np.max(result.response[1])) for result in results)
        rays_for(self.light, sd, tolerance, self.guide.thickness_mm, self.merit.mirrored)

    def evolve(self, first: Sequence[Design], seed: int) -> OptimizeResult:
        """Run differential evolution from some designs, until it converges or the time is over."""
        low, high = np.array(BOUNDS).T
        high[2] = min(BOUNDS[2][1], 0.9 * self.guide.thickness_mm)
        population = np.array([_point(design) for design in first])
        if len(population) < 5:
            population = np.concatenate([population, low + (high - low) * np.random.default_rng(seed).random((5, 5))])
        best, unimproved = np.inf, 0

        def spread(function: Callable[[Any], float], points: Iterable[Any]) -> list[float]:
            return list(self.pool.map(function, points))

        def loss(x: FloatArray) -> float:
            design = design_at(x)
            if design not in self.seen:
                self.seen[design] = self.merit.p(design)
            return -self.seen[design]

        def converged(intermediate_result: Any) -> Any:
            nonlocal best, unimproved
            now = float(intermediate_result.fun)
            unimproved = 0 if now < best - BETTER * abs(best) or not np.isfinite(best) else unimproved + 1
            best = min(best, now)
            self.finished = unimproved >= PATIENCE
            return self.finished or self.late(_SEARCH_PART)

        found = differential_evolution(
            loss,
            Bounds(low, high),
            init=population,
            integrality=[True, False, False, False, True],
            rng=seed,
            workers=spread,
            updating="deferred",
            polish=False,
            maxiter=1_000,
            tol=0.0,
            callback=converged,
        )
        self.evaluations += int(found.nfev)
        self.work += sum(np.isfinite(p) for p in self.seen.values()) * self.light.rays
        return found

    def race(self, confidence: float, most_rays: int, seed: int, seconds: float, progress: Progress | None) -> Race:
        """Return the race of all designs evaluated; parameters are those of `optimise`."""
        able = dict.fromkeys([*self.scanned, *(design for design, p in self.seen.items() if np.isfinite(p))])

        def simulate(designs: Sequence[Design], light: Light) -> SweepResult:
            self.evaluations += len(designs)
            return self.merit_with(light).swept(designs, self.pool.map)

        light, first_rays = light_by(self.by, PAPER_RAYS), first_rays_of(self.by)
        race = Race(tuple(able), light, confidence, most_rays, seed, first_rays)
        return race.run(simulate, seconds=seconds, progress=progress)


def _best(scored: Sequence[Scored]) -> list[Scored]:
    return sorted(scored, key=lambda pair: -pair[0])


def _evaluated(
    search: _Search, grid: Sequence[Scored], found: OptimizeResult, race: Race | None, light: Light,
    tolerance: float | None, began: float,
) -> Optimum:  # fmt: skip
    """Return both winners with many rays, and again with the fan turned; fewer finalists if it is late.

    `race`: decides which designs are the grid's best and the best; without one the final evaluation does.
    """
    if race is None:
        most = _FEW if search.late(1.0) else _FINALISTS
        searched = _best([(p, design) for design, p in list(search.seen.items())])[:most]
        first = [design for _, design in grid[:most]]
        chosen = [*(design for _, design in searched), design_at(found.x)]
    else:
        first, chosen = [race.designs[_leader(race, len(search.scanned))]], [race.designs[race.best]]
    able = [design for design in dict.fromkeys([*first, *chosen, PAPER_OPTIMUM]) if search.merit.fits(design)]

    def two(p: dict[Design, float]) -> tuple[Design, Design]:
        found = chosen if race is not None else [design for design in able if design in chosen or design in first]
        return max(first, key=p.__getitem__), max(found, key=p.__getitem__)

    results, (start, best), light, error, work = _with_rays(search, able, two, light, tolerance)
    p = {design: p_of(result) for design, result in results.items()}
    others = [search.merit_with(turned(light, turn)) for turn in range(1, TURNS + 1)]

    def winner(design: Design) -> Winner:
        over_turns, own = [p[design], *search.pool.map(lambda turn: turn.p(design), others)], results[design]
        spread = min(over_turns), max(over_turns)
        return Winner(design, p[design], spread, own.power[0], own.power_sd[0], float(np.max(own.given_up)))

    winners, paper_p = (winner(start), winner(best)), p.get(PAPER_OPTIMUM, np.nan)
    work += search.work + (0 if race is None else race.work) + TURNS * len(winners) * light.rays
    seconds, rays = time.perf_counter() - began, (search.light.rays, light.rays)
    return Optimum(*winners, paper_p, search.evaluations, seconds, *rays, search.finished, search.by, error, work, race)


def _with_rays(
    search: _Search, designs: Sequence[Design], two: Callable[[dict[Design, float]], tuple[Design, Design]],
    light: Light, tolerance: float | None,
) -> tuple[dict[Design, SweepResult], tuple[Design, Design], Light, float, int]:  # fmt: skip
    """Return results of designs, the two winners, the light, the winners' greatest error, and the rays released.

    `light`, `tolerance`: more rays are released where the winners' errors are above the tolerance.
    """
    work = 0
    for _ in range(TRIES):
        final = search.merit_with(light)
        results = dict(zip(designs, search.pool.map(final.result, designs), strict=True))
        work += len(designs) * light.rays
        winners = two({design: p_of(result) for design, result in results.items()})
        error = max(float(np.max(stated_error(results[each].response[1], light.rays))) for each in winners)
        if tolerance is None or error <= tolerance:
            return results, winners, light, error, work
        traced = light.rays
        light = finer(light, error, tolerance, search.guide.thickness_mm, mirrored=final.mirrored)
    raise unmet(traced, error)


def _leader(race: Race, first: int) -> int:
    """Return which of a race's first designs is the best: of those with the most rays the one with the largest P."""
    return max(range(first), key=lambda i: (race.level[i], race.p[i]))
