"""The best design with a stated confidence: few rays for all designs, more only for those that may be the best.

Strategy: every design is traced with 1,000 rays, from which on neighbouring rays of the fan are related and the error
falls faster than its cost rises; by power with 2,000, for 1,000 leave half of the designs. Then, round after round,
those with the largest P and, of those with the fewest rays, those with the largest upper bound of P are traced with
more rays, twice as many up to 4,000 and then four times (lower and upper confidence bounds: Kalyanakrishnan et al.,
Proc. 29th ICML, 2012, 655), designs with as many rays all by the same fan, turned at random. A design is eliminated
when its upper bound is below the greatest lower bound. The race ends when every design left has the most rays, or when
its time is over: the bounds of all rounds hold together.

The best design is lost only if one of its own upper bounds fails, or a lower bound of another design does: half of the
error probability is shared by the numbers of rays for the one, half by numbers of rays and designs for the other
(union bound), so that the designs left contain the best one with the stated confidence, whatever the relation between
their errors and whichever designs were traced again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from analysis.optics.scene.parameters import By, Design, Light
from analysis.optics.sweep.figure_of_merit import FLOOR, merit, p_bounds
from analysis.optics.sweep.sweep import SweepRequest, SweepResult, run_sweep
from analysis.progress import Progress, part_of
from protocol.base.arrays import BoolArray, FloatArray, IntArray
from protocol.base.errors import ChoiceError

FIRST_RAYS, RELATED_RAYS = 1_000, 4_000
"""Up to the latter neighbouring rays become related, and twice the rays leave less than half of the error."""
FIRST_RAYS_OF_POWER = 2_000
"""Rays of the first round by power: with 1,000 half of the designs would remain, which saves nothing."""
RACE_MOST_RAYS = 256_000  # rays of the best design unless stated otherwise
LEADERS, CHALLENGERS = 2, 16
"""Designs that a round traces again: those with the largest P, and of the others with the fewest rays those with the
largest upper bound."""
_PIECE = 32  # designs that are traced between two looks at the clock

Simulate = Callable[[Sequence[Design], Light], SweepResult]


def first_rays_of(by: By) -> int:
    """Return the rays of a race's first round."""
    return FIRST_RAYS_OF_POWER if by == "power" else FIRST_RAYS


def rays_of_rounds(most_rays: int, first_rays: int = FIRST_RAYS) -> tuple[int, ...]:
    """Return the numbers of rays of a race: twice as many each time, then four times; the last the most.

    Raises RequestError: the most are fewer than any race's first.
    """
    if most_rays < FIRST_RAYS:
        raise ChoiceError(f"a race with {most_rays} rays at most", f"allow {FIRST_RAYS} rays or more")
    found = [most_rays]
    while (fewer := found[0] // (2 if found[0] <= RELATED_RAYS else 4)) >= first_rays:
        found.insert(0, fewer)
    return tuple(found)


@dataclass
class Race:
    """A race of designs (n,) with the bounds of each.

    `level`: (n,) how many of `rays` each design was traced with. `p`, `low`, `high`: (n,) P with the most rays so far,
    and its tightest bounds; infinite where it was not traced.
    """

    designs: tuple[Design, ...]
    light: Light  # its model, cone and emission are kept; rays and turn of the fan are those of each number of rays
    confidence: float  # that the candidates contain the best design, above 0 and below 1
    most_rays: int = RACE_MOST_RAYS
    seed: int = 0  # seed of the fan's turns
    first_rays: int = FIRST_RAYS
    history: list[tuple[int, int]] = field(default_factory=list)  # (work, candidates) after each round
    work: int = 0  # rays released for each state so far, all designs together

    def __post_init__(self) -> None:
        if not 0.0 < self.confidence < 1.0:
            raise ChoiceError(f"a confidence of {self.confidence:g}", "choose above 0 and below 1, 0.95 is usual")
        self.rays = rays_of_rounds(self.most_rays, self.first_rays)
        self.turns = np.random.default_rng(self.seed).uniform(-0.5, 0.5, len(self.rays))
        n = len(self.designs)
        self.level: IntArray = np.zeros(n, dtype=np.int64)
        self.p: FloatArray = np.full(n, -np.inf)
        self.low: FloatArray = np.full(n, -np.inf)
        self.high: FloatArray = np.full(n, np.inf)

    @property
    def left(self) -> BoolArray:
        """Return (n,) which designs may still be the best."""
        return np.asarray(self.high >= np.max(self.low))

    @property
    def finished(self) -> bool:
        """Return whether every candidate has the most rays; if not, the time ran out."""
        return not np.any(self.left & (self.level < len(self.rays)))

    @property
    def best(self) -> int:
        """Return the number of the candidate with the largest P."""
        return int(np.argmax(np.where(self.left, self.p, -np.inf)))

    @property
    def candidates(self) -> IntArray:
        """Return the numbers of the designs that cannot be told apart, best first; one if the race is decided."""
        found = np.flatnonzero(self.left)
        return np.asarray(found[np.argsort(-self.p[found], kind="stable")])

    @property
    def equal_rays(self) -> int:
        """Return the rays of the design with the most: those of equal precision everywhere."""
        return self.rays[max(int(np.max(self.level)), 1) - 1]

    @property
    def equal_work(self) -> int:
        """Return the rays that this precision for every design would take, for each state."""
        return self.equal_rays * len(self.designs)

    @property
    def saving(self) -> float:
        """Return how many times less work the race was than equal precision everywhere."""
        return self.equal_work / max(self.work, 1)

    @property
    def settled(self) -> float:
        """Return how many designs are settled: 1 for one that is eliminated or has the most rays, else a part."""
        return float(np.sum(np.where(self.left, self.level / len(self.rays), 1.0)))

    def run(self, simulate: Simulate, *, seconds: float = np.inf, progress: Progress | None = None) -> Race:
        """Trace designs until every candidate has the most rays, or the time is over; returns itself."""
        if not seconds > 0:
            raise ChoiceError(f"a race of {seconds:g} s", "allow more than 0 s")
        end = time.perf_counter() + seconds
        chosen = np.arange(len(self.designs))
        while chosen.size:
            for some, level in self._pieces(chosen, whole=np.isinf(seconds)):
                self._trace(some, level, simulate)
                if progress is not None:
                    progress(self.settled, len(self.designs))
                if late := time.perf_counter() > end:
                    break
            self.history.append((self.work, int(np.sum(self.left))))
            chosen = chosen[:0] if late else self._next()
        return self

    def _pieces(self, chosen: IntArray, *, whole: bool) -> Iterator[tuple[IntArray, int]]:
        """Yield designs of one level each with it; all of it together where the whole is wanted."""
        levels = self.level[chosen]
        for level in np.unique(levels):
            some = chosen[levels == level]
            size = some.size if whole else _PIECE
            yield from ((some[i : i + size], int(level)) for i in range(0, some.size, size))

    def _next(self) -> IntArray:
        """Return the candidates to trace again: the leaders and the challengers that do not have the most rays yet."""
        open_ = np.flatnonzero(self.left & (self.level < len(self.rays)))
        leaders = open_[np.argsort(-self.p[open_], kind="stable")][:LEADERS]
        cheap = open_[self.level[open_] == np.min(self.level[open_], initial=len(self.rays))]
        challengers = cheap[np.argsort(-self.high[cheap], kind="stable")][:CHALLENGERS]
        return np.unique(np.concatenate([leaders, challengers]))

    def _trace(self, chosen: IntArray, level: int, simulate: Simulate) -> None:
        """Trace designs of one level with the next number of rays."""
        light = replace(self.light.with_rays(self.rays[level]), phase=float(self.turns[level]))
        result = simulate([self.designs[i] for i in chosen], light)
        own = 0.5 * (1.0 - self.confidence) / len(self.rays)
        low, high = p_bounds(*result.response, FLOOR, low_error=own / len(self.designs), high_error=own)
        self.p[chosen] = merit(result.response[0], FLOOR).p
        self.low[chosen] = np.maximum(self.low[chosen], low)
        self.high[chosen] = np.minimum(self.high[chosen], high)
        self.level[chosen] += 1
        self.work += self.rays[level] * chosen.size


def race_sweep(
    request: SweepRequest,
    confidence: float,
    *,
    most_rays: int = RACE_MOST_RAYS,
    seconds: float = np.inf,
    folder: Path | None = None,
    scheduler: str | None = None,
    allow_remote: bool = False,
    progress: Progress | None = None,
) -> Race:
    """Find the best design of a sweep."""

    designs = tuple(dict.fromkeys(request.designs))
    first_rays = first_rays_of(request.by)
    race = Race(designs, request.light, confidence, most_rays, 0, first_rays)

    def simulate(designs: Sequence[Design], light: Light) -> SweepResult:
        part = replace(request, designs=tuple(designs), light=light)
        file = None if folder is None else folder / f"race_{light.rays}_rays.sqlite"
        share = part_of(progress, race.settled, len(designs) / len(race.rays), len(race.designs))
        return run_sweep(part, file=file, scheduler=scheduler, allow_remote=allow_remote, progress=share)

    return race.run(simulate, seconds=seconds, progress=progress)
