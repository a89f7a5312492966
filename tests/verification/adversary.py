"""Scenes where a stated error is too small, found by search: random scenes, then CMA-ES about the worst of them.

    python -m tests.verification.adversary tracer --seconds 3600

A method's objective (`stated_errors.py`) is the true error of a scene divided by the stated one (k = 2), root mean
square over repeats: about 0.5 where the statement holds. Half of the time goes to random scenes, half to CMA-ES
(Hansen, The CMA Evolution Strategy: A Tutorial, arXiv 1604.00772, 2016) from the worst scene so far, and from the next
worst whenever it has converged. A scene above the objective's limit is a find if it is above it again, with other
random numbers and more repeats: the worst of thousands is otherwise found by chance. Each find is to become a test.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from dataclasses import asdict, dataclass, field

import cma
import numpy as np

from protocol.base.arrays import FloatArray
from protocol.base.errors import BoatDaqError
from tests.verification.stated_errors import OBJECTIVES, Objective

RANDOM_SHARE, CONFIRMATIONS = 0.5, 4
FIRST_STEP, LAST_STEP = 0.2, 0.003  # widths of the first and of the last generation, in the unit cube
REFUSED = -1e9  # value of a scene that cannot be built, for the strategy


@dataclass(frozen=True, slots=True)
class Find:
    """The result of a search.

    Parameters
    ----------
    scene : the worst one, by the names of its numbers; `ratio` is its ratio.
    scenes, refused : number of scenes tried, and of those that cannot be built.
    finds : confirmed scenes above the objective's limit, the worst first.
    """

    method: str
    scene: dict[str, float]
    ratio: float
    scenes: int
    refused: int
    finds: tuple[dict[str, float], ...]


@dataclass
class _Search:
    """The scenes of a search that were tried, as points of the unit cube with their ratios."""

    objective: Objective
    rng: np.random.Generator
    tried: list[tuple[float, FloatArray]] = field(default_factory=list)
    finds: list[tuple[float, FloatArray]] = field(default_factory=list)
    refused: int = 0

    def scene(self, at: FloatArray) -> dict[str, float]:
        """Return the scene at a point of the unit cube."""
        return {
            name: float(low + each * (high - low))
            for each, (name, (low, high)) in zip(at, self.objective.bounds.items(), strict=True)
        }

    def value(self, at: FloatArray) -> float:
        """Return the ratio of a scene, of more repeats where it is large; -inf where the scene is refused."""
        ratio = self._once(at)
        if ratio > self.objective.most:
            again = [self._once(at) for _ in range(CONFIRMATIONS)]
            ratio = math.sqrt(float(np.mean(np.square(again)))) if np.all(np.isfinite(again)) else -math.inf
            if ratio > self.objective.most:
                self.finds.append((ratio, at))
        self.refused += ratio == -math.inf
        self.tried.append((ratio, at))
        return ratio

    def _once(self, at: FloatArray) -> float:
        try:
            return self.objective.ratio(self.scene(at), self.rng)
        except BoatDaqError:  # no such scene can be built
            return -math.inf


def search(name: str, objective: Objective, seconds: float, seed: int = 0) -> Find:
    """Search for the scene with the largest ratio."""
    found, began = _Search(objective, np.random.default_rng(seed)), time.perf_counter()
    n = len(objective.bounds)
    while not found.tried or time.perf_counter() - began < RANDOM_SHARE * seconds:
        found.value(found.rng.random(n))
    starts = iter(_worst_first(found.tried))
    while time.perf_counter() - began < seconds and (start := next(starts, None)) is not None:
        strategy = evolution(start[1], found.rng)
        while strategy.sigma > LAST_STEP and not strategy.stop() and time.perf_counter() - began < seconds:
            points = strategy.ask()
            strategy.tell(points, [-max(found.value(np.asarray(at)[:n]), REFUSED) for at in points])
    ratio, worst = _worst_first(found.tried)[0]
    finds = tuple(found.scene(at) for _, at in _worst_first(found.finds))
    return Find(name, found.scene(worst), ratio, len(found.tried), found.refused, finds)


def evolution(start: FloatArray, rng: np.random.Generator) -> cma.CMAEvolutionStrategy:
    """Return CMA-ES in the unit cube, from a point of it, with the random numbers of `rng`."""
    options = {
        "bounds": [0.0, 1.0],
        "seed": math.nan,  # leaves NumPy's global generator alone
        "randn": lambda count, n: rng.standard_normal((count, n)),
        "verbose": -9,
    }
    if start.size == 1:  # the package needs two dimensions
        start = np.append(start, 0.5)
    return cma.CMAEvolutionStrategy(start, FIRST_STEP, options)


def _worst_first(tried: list[tuple[float, FloatArray]]) -> list[tuple[float, FloatArray]]:
    return sorted(tried, key=lambda pair: -pair[0])


def main() -> None:
    """Search and print the worst scene, and the finds, as JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("method", choices=OBJECTIVES)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    print(json.dumps(asdict(search(chosen.method, OBJECTIVES[chosen.method], chosen.seconds, chosen.seed)), indent=1))


if __name__ == "__main__":
    main()
