"""Beyond the grid: width, depth, spacing, count and face searched together, on detected power.

Strategy: power converges where a count of rays does not, so the search uses power with practically every reflection
followed. The grid is looked through with a fifth of the rays; its best designs are the first population of scipy's
differential evolution (count and face as integers), each generation's candidates running side by side. What is found
is judged again with ten times the rays against the grid's best, so that luck at few rays is not reported as gain.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import Bounds, OptimizeResult, differential_evolution

from analysis.errors import RequestError
from analysis.optics.compiled import Floats
from analysis.optics.curves import frames_of
from analysis.optics.figure_of_merit import merit, resolution
from analysis.optics.frame import Frame
from analysis.optics.geometry import pattern_of
from analysis.optics.parameters import PAPER_OPTIMUM, Design, Face, Light, Waveguide
from analysis.optics.simulation import fan_of, rules_of, stacked
from analysis.optics.sweep import Progress, paper_grid, run_item

POPULATION = 24
FOLLOWED = 4
"""Budget of secondaries for each released ray: with this many practically none is refused."""
FAINTEST = 1e-3
FLOOR = float(resolution(250))
"""RMSE below what the paper's 250 rays resolve wins nothing."""
BOUNDS = ((1.0, 9.0), (0.3, 2.0), (0.2, 1.6), (0.3, 2.0), (0.0, 1.0))
_CHECK, _GLANCE = 10, 5
_LOOK, _SEARCH = 0.3, 0.85
"""Parts of the time after which the look through the grid and the search itself are cut short."""


@dataclass(frozen=True, slots=True)
class Optimum:
    """What the search found.

    Parameters
    ----------
    start, best : the grid's best design and the one found; start_p, best_p, paper_p : P on power at `checked_rays`.
    start_power, power : (15,) detected power of both.
    evaluations, seconds : what it took; rays, checked_rays : released in the search and in the last judgement.
    finished : False if the time ran out before the population had settled.
    """

    start: Design
    best: Design
    start_p: float
    best_p: float
    paper_p: float
    start_power: Floats
    power: Floats
    evaluations: int
    seconds: float
    rays: int
    checked_rays: int
    finished: bool


class PowerMerit:
    """P on detected power of designs over the given states; safe to call from several threads."""

    def __init__(self, frames: Sequence[Frame], guide: Waveguide, rays: int) -> None:
        light = Light(rays=rays, secondary=FOLLOWED * rays, faintest=FAINTEST, order="index")
        self.thickness_mm = guide.thickness_mm
        self._common = stacked(frames), rules_of(guide, light, frames[0]), fan_of(light, frames[0]), light.secondary
        self._free = min(f.free_mm for f in frames)

    def fits(self, design: Design) -> bool:
        """Whether the design can be built in every state."""
        return design.row_mm < self._free and design.depth_mm < self.thickness_mm * (1 - 1e-6)

    def power(self, design: Design) -> Floats:
        """Detected power over the states, emitted = 1."""
        _, energy, _ = run_item(*self._common, pattern_of(design)[None])
        return np.asarray(energy[0, :, 0])

    def p(self, design: Design) -> float:
        """P on power scaled to 250 rays; -inf for a design that cannot be built."""
        return float(merit(250.0 * self.power(design), FLOOR).p) if self.fits(design) else -np.inf


def design_at(x: Floats) -> Design:
    """The design at a point of the search space: count, width, depth, spacing (mm), face (0 outer, 1 inner)."""
    face: Face = "inner" if round(float(x[4])) else "outer"
    return Design(round(float(x[0])), float(x[1]), float(x[2]), float(x[3]), face)


def _point(design: Design) -> list[float]:
    return [*design.values, 1.0 if design.face == "inner" else 0.0]


def optimise(
    guide: Waveguide,
    curves: Floats,
    *,
    rays: int = 500,
    seconds: float = 50.0,
    first_face: Face = "outer",
    seed: int = 0,
    progress: Progress | None = None,
) -> Optimum:
    """Search for the design with the largest P on power.

    Parameters
    ----------
    guide, curves : the guide and the states.
    rays : released in each evaluation; ten times as many judge the result.
    seconds : the search stops about then, finished or not; it is repeatable if it finishes.
    first_face : face of the grid that the search starts from.
    progress : called with (seconds gone, seconds allowed); raising from it cancels.

    Raises
    ------
    RequestError : no design of the grid can be built in these states, or no time is allowed.
    """
    if seconds <= 0:
        raise RequestError(f"a search of {seconds:g} s", "allow some seconds, 50 are enough")
    began = time.perf_counter()
    frames = frames_of(curves, guide)
    glance, judge = PowerMerit(frames, guide, max(rays // _GLANCE, 50)), PowerMerit(frames, guide, rays)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        start, search, seen = _search(glance, judge, pool, _watch(began, seconds, progress), first_face, seed)
        careful = PowerMerit(frames, guide, _CHECK * rays)
        finalists = [start, design_at(search.x), PAPER_OPTIMUM]
        power = list(pool.map(careful.power, [d for d in finalists if careful.fits(d)]))
    p = [float(merit(250.0 * each, FLOOR).p) for each in power]
    best = int(p[1] > p[0])
    return Optimum(
        start,
        finalists[best],
        p[0],
        p[best],
        p[2] if len(p) > 2 else np.nan,
        power[0],
        power[best],
        int(search.nfev) + seen,
        time.perf_counter() - began,
        rays,
        _CHECK * rays,
        bool(search.success),
    )


def _watch(began: float, allowed: float, progress: Progress | None) -> Callable[[float], bool]:
    """A clock that reports progress and says whether a part of the time has gone."""

    def late(part: float) -> bool:
        gone = time.perf_counter() - began
        if progress is not None:
            progress(min(gone, allowed), allowed)
        return gone > part * allowed

    return late


def _search(
    glance: PowerMerit,
    judge: PowerMerit,
    pool: ThreadPoolExecutor,
    late: Callable[[float], bool],
    face: Face,
    seed: int,
) -> tuple[Design, OptimizeResult, int]:
    """The grid's best design, differential evolution from its best ones, and how many of it were seen."""
    every = [design for design in paper_grid(face=face) if judge.fits(design)]
    grid = [every[i] for i in np.random.default_rng(seed).permutation(len(every))]
    if not grid:
        raise RequestError("no design of the grid fits these states", "use longer or thicker guides")
    rough: list[float] = []
    for first in range(0, len(grid), 4 * POPULATION):
        rough += pool.map(glance.p, grid[first : first + 4 * POPULATION])
        if late(_LOOK):
            break
    likely = [grid[i] for i in np.argsort(rough)[::-1][: 2 * POPULATION]]
    ranked = [likely[i] for i in np.argsort(list(pool.map(judge.p, likely)))[::-1]]
    first_population = np.array([_point(design) for design in ranked[:POPULATION]])
    low, high = np.array(BOUNDS).T
    high[2] = min(BOUNDS[2][1], 0.9 * judge.thickness_mm)
    limits = Bounds(low, high)

    def spread(function: Callable[[Any], float], points: Iterable[Any]) -> list[float]:
        return list(pool.map(function, points))

    def loss(x: Floats) -> float:
        return -judge.p(design_at(x))

    def stop(x: Any, convergence: Any) -> Any:
        return late(_SEARCH)

    found = differential_evolution(
        loss,
        limits,
        init=first_population,
        integrality=[True, False, False, False, True],
        rng=seed,
        workers=spread,
        updating="deferred",
        polish=False,
        maxiter=400,
        tol=0.005,
        callback=stop,
    )
    return ranked[0], found, len(rough) + len(likely)
