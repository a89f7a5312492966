"""Whether stated errors are true: random scenes, the true error against the stated one, and the cost of knowing it.

    python -m tests.verification.coverage tracer --scenes 1000

A random scene is computed to a random tolerance and compared with a far finer computation. A zero error satisfies every
bound. A setting would have done if twice the root mean square of its errors, over repeats with other random numbers, is
within the tolerance. The cost in rays is within three times the cheapest where no setting of a third of it would have
done; errors fall with the rays, so only the dearest of those settings is tried.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.numbers import finite
from analysis.optics.scene.curves import default_curves, frames_of, parametric_curves
from analysis.optics.scene.parameters import Light, Waveguide
from analysis.optics.sweep.sweep import paper_grid
from analysis.optics.tracer.simulation import trace
from analysis.optics.tracer.tolerance import FEWEST_RAYS, trace_within
from protocol.base.errors import ConvergenceError, RequestError

_REFERENCE_RAYS = 60_000
REPEATS = 12


@dataclass(frozen=True, slots=True)
class Answer:
    """One scene: the true and the stated error, in the unit of the method.

    `third_does`: whether a third of its cost would have done; None where no tolerance was asked.
    """

    error: float
    stated: float
    third_does: bool | None = None


Method = Callable[[np.random.Generator], list[Answer]]


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def would_do(errors: Sequence[float], tolerance: float) -> bool:
    """Return whether a setting with these errors, of repeats, is within a tolerance at k = 2."""
    return 2.0 * float(np.sqrt(np.mean(np.square(errors)))) <= tolerance


def of_tracer(rng: np.random.Generator) -> list[Answer]:
    """Trace a design of the paper's grid in one of its states to 0.3 to 20 rays."""
    grid, curves = paper_grid(), default_curves() if rng.random() < 0.5 else parametric_curves()
    design, frame = grid[rng.integers(len(grid))], frames_of(curves, Waveguide())[rng.integers(15)]
    tolerance = log_uniform(rng, 0.3, 20.0)
    found = trace_within(frame, design, Waveguide(), Light(), tolerance)
    truth = trace(frame, design, Waveguide(), replace(Light().with_rays(_REFERENCE_RAYS), phase=0.113), threads=1).ndr
    third, errors = Light().with_rays(max(1, found.work // 3)), []
    for phase in rng.uniform(-0.5, 0.5, REPEATS):
        turned = replace(third, phase=float(phase))
        errors.append(trace(frame, design, Waveguide(), turned, threads=1).ndr - truth)
    does = third.rays >= FEWEST_RAYS and would_do(errors, tolerance)
    return [Answer(abs(found.result.ndr - truth), found.error, does)]


METHODS: dict[str, Method] = {"tracer": of_tracer}


def measured(method: Method, scenes: int, seed: int = 0, seconds: float = np.inf) -> tuple[list[Answer], int]:
    """Return the outcomes of random scenes, and how many were refused.

    Parameters
    ----------
    seconds : time after which no further scene is begun.
    """
    found: list[Answer] = []
    refused, end = 0, time.monotonic() + seconds
    for number in range(scenes):
        if time.monotonic() > end:
            break
        try:
            found += method(np.random.default_rng((seed, number)))
        except (RequestError, ConvergenceError):
            refused += 1
    return found, refused


def share_within(outcomes: list[Answer]) -> float:
    """Return the share of the scenes whose true error is within the stated one."""
    return float(np.mean([each.error <= each.stated + 1e-9 for each in outcomes]))


def share_within_three(outcomes: list[Answer]) -> float:
    """Return the share of the scenes that no third of the cost would have done for; NaN where none was tried."""
    tried = [each.third_does for each in outcomes if each.third_does is not None]
    return float(np.mean(np.logical_not(tried))) if tried else float("nan")


def main() -> None:
    """Measure a method and print the shares as JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("method", choices=METHODS)
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=np.inf)
    chosen = parser.parse_args()
    outcomes, refused = measured(METHODS[chosen.method], chosen.scenes, chosen.seed, chosen.seconds)
    ratios = [each.error / max(each.stated, 1e-9) for each in outcomes]
    quantiles = {f"{share:g}": float(np.quantile(ratios, share)) for share in (0.5, 0.9, 0.95, 0.99)}
    print(json.dumps({
        "method": chosen.method, "seed": chosen.seed, "answers": len(outcomes), "refused": refused,
        "within": share_within(outcomes), "cost_within_three": finite(share_within_three(outcomes)),
        "error_over_stated": quantiles,
    }))  # fmt: skip


if __name__ == "__main__":
    main()
