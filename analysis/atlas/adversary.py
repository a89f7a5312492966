"""Scenes where a stated error is too small, found by search: random scenes, then an evolution strategy about the worst.

    python -m analysis.atlas.adversary tracer --seconds 3600

Strategy: a method's objective (`stated_errors.py`) is the true error of a scene over the stated one (k = 2), root mean
square over repeats: about 0.5 where the statement holds. Half of the time goes to random scenes, half to CMA-ES
(Hansen, The CMA Evolution Strategy: A Tutorial, arXiv 1604.00772, 2016) from the worst scene so far, and whenever it
has converged from the next worst. A scene above the objective's limit is a find if it is above it again, with other
random numbers and more repeats: the worst of thousands is otherwise found by chance. Each find is to become a test.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from analysis.arrays import FloatArray
from analysis.atlas.stated_errors import OBJECTIVES, Objective
from analysis.errors import AnalysisError

RANDOM_SHARE, CONFIRMATIONS = 0.5, 4
FIRST_STEP, LAST_STEP = 0.2, 0.003
"""Of the unit cube: the width of the first generation, and that of the last."""


class Evolution:
    """CMA-ES in the unit cube, for the largest value.

    Parameters
    ----------
    mean : (n,) where it begins. step : width of the first generation.
    """

    def __init__(self, mean: FloatArray, step: float, rng: np.random.Generator) -> None:
        n = mean.size
        self.mean, self.step, self._rng = mean, step, rng
        self.size = 4 + int(3 * math.log(n))
        weights = np.log((self.size + 1) / 2) - np.log(np.arange(1, self.size // 2 + 1))
        self._weights = weights / weights.sum()
        self._effective = float(1.0 / np.sum(self._weights**2))
        self._covariance, self._path, self._step_path = np.eye(n), np.zeros(n), np.zeros(n)
        self._generation = 0

    def points(self) -> FloatArray:
        """Return the points (size, n) of the next generation."""
        values, axes = np.linalg.eigh(self._covariance)
        normal = self._rng.standard_normal((self.size, self.mean.size))
        steps = self.step * (normal * np.sqrt(np.maximum(values, 1e-14))) @ axes.T
        return np.asarray(np.clip(self.mean + steps, 0.0, 1.0))

    def take(self, points: FloatArray, values: FloatArray) -> None:
        """Move, turn and size the next generation by the values (size,) of this one."""
        n, effective = self.mean.size, self._effective
        best = points[np.argsort(-values, kind="stable")[: self._weights.size]]
        moves = (best - self.mean) / self.step
        move = self._weights @ moves
        self.mean = self.mean + self.step * move
        fading, damping = (effective + 2) / (n + effective + 5), 1 + (effective + 2) / (n + effective + 5)
        damping += 2 * max(0.0, math.sqrt((effective - 1) / (n + 1)) - 1)
        along = (4 + effective / n) / (n + 4 + 2 * effective / n)
        one = 2 / ((n + 1.3) ** 2 + effective)
        many = min(1 - one, 2 * (effective - 2 + 1 / effective) / ((n + 2) ** 2 + effective))
        values_, axes = np.linalg.eigh(self._covariance)
        white = axes @ ((axes.T @ move) / np.sqrt(np.maximum(values_, 1e-14)))
        self._step_path = (1 - fading) * self._step_path + math.sqrt(fading * (2 - fading) * effective) * white
        self._generation += 1
        expected = math.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n))
        length = float(np.linalg.norm(self._step_path))
        short = length / math.sqrt(1 - (1 - fading) ** (2 * self._generation)) < (1.4 + 2 / (n + 1)) * expected
        self._path = (1 - along) * self._path + short * math.sqrt(along * (2 - along) * effective) * move
        own = np.outer(self._path, self._path) + (not short) * along * (2 - along) * self._covariance
        spread = (moves.T * self._weights) @ moves
        self._covariance = (1 - one - many) * self._covariance + one * own + many * spread
        self.step *= math.exp(fading / damping * (length / expected - 1))


@dataclass(frozen=True, slots=True)
class Find:
    """What a search found.

    Parameters
    ----------
    method, scene : what was computed; the worst scene, by the names of its numbers.
    scenes, refused : how many were tried, and of those how many cannot be built.
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
    """A search: its objective and random numbers, and what it has tried."""

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
        except AnalysisError:  # no such scene can be built
            return -math.inf


def search(name: str, objective: Objective, seconds: float, seed: int = 0) -> Find:
    """Search for the scene with the largest ratio."""
    found, began = _Search(objective, np.random.default_rng(seed)), time.perf_counter()
    n = len(objective.bounds)
    while not found.tried or time.perf_counter() - began < RANDOM_SHARE * seconds:
        found.value(found.rng.random(n))
    starts = iter(_worst_first(found.tried))
    while time.perf_counter() - began < seconds and (start := next(starts, None)) is not None:
        strategy = Evolution(start[1], FIRST_STEP, found.rng)
        while strategy.step > LAST_STEP and time.perf_counter() - began < seconds:
            points = strategy.points()
            strategy.take(points, np.array([found.value(at) for at in points]))
    ratio, worst = _worst_first(found.tried)[0]
    finds = tuple(found.scene(at) for _, at in _worst_first(found.finds))
    return Find(name, found.scene(worst), ratio, len(found.tried), found.refused, finds)


def _worst_first(tried: list[tuple[float, FloatArray]]) -> list[tuple[float, FloatArray]]:
    return sorted(tried, key=lambda pair: -pair[0])


def main() -> None:
    """Search and print the worst scene, and the finds, as JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("method", choices=OBJECTIVES)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    found = search(chosen.method, OBJECTIVES[chosen.method], chosen.seconds, chosen.seed)
    content: Mapping[str, object] = {name: getattr(found, name) for name in Find.__dataclass_fields__}
    print(json.dumps(content, indent=1))


if __name__ == "__main__":
    main()
