"""Scenes where a stated error is too small, found by search: random scenes, then an evolution strategy about the worst.

    python -m analysis.atlas.adversary tracer --seconds 3600

Strategy: a method's objective is the true error over the stated one (k = 2), root mean square over independent repeats:
about 0.5 where the statement holds; the mesh has one repeat. Half of the time goes to random scenes, half to normal
steps about the worst scene so far, whose width follows the one-fifth success rule (Rechenberg, Evolutionsstrategie,
1973). Twice the stated standard deviation of a count is a find, and twice the stated error of a mesh. Each find is to
become a test.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from analysis.arrays import FloatArray
from analysis.errors import AnalysisError
from analysis.optics.scene.curves import default_curves, frames_of, parametric_curves
from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.parameters import Design, Light, Waveguide
from analysis.optics.tracer.simulation import trace
from analysis.optics.tracer.tolerance import stated_error
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.tolerance import error_estimates, mesh_of

REPEATS = 6
_REFERENCE_RAYS = 40_000
_FIRST_STEP, _WIDER, _NARROWER = 0.2, 1.5, 0.9


@dataclass(frozen=True, slots=True)
class Find:
    """The worst scene of a search.

    Parameters
    ----------
    method, scene : what was computed, the scene by the names of its numbers.
    ratio : true error over the stated one. scenes, finds : how many were tried, and how many were finds.
    """

    method: str
    scene: dict[str, float]
    ratio: float
    scenes: int
    finds: int


@dataclass(frozen=True, slots=True)
class Objective:
    """What is searched: the bounds of a scene's numbers, and its ratio; a scene that is refused has none.

    Above the ratio `most` a scene is a find.
    """

    bounds: Mapping[str, tuple[float, float]]
    ratio: Callable[[Mapping[str, float], np.random.Generator], float]
    most: float = 1.0


def search(name: str, objective: Objective, seconds: float, seed: int = 0) -> Find:
    """Search for the scene with the largest ratio.

    Parameters
    ----------
    name, objective : the method. seconds : of the search. seed : of the scenes.
    """
    rng, ends = np.random.default_rng(seed), np.array(list(objective.bounds.values()))
    began, step, scenes, finds = time.perf_counter(), _FIRST_STEP, 0, 0
    worst, most = rng.random(len(ends)), -np.inf
    while scenes == 0 or (gone := time.perf_counter() - began) < seconds:
        climbing = scenes > 0 and gone > seconds / 2
        at = np.clip(worst + step * rng.standard_normal(len(ends)), 0.0, 1.0) if climbing else rng.random(len(ends))
        scene = dict(zip(objective.bounds, ends[:, 0] + at * (ends[:, 1] - ends[:, 0]), strict=True))
        try:
            ratio = objective.ratio(scene, rng)
        except AnalysisError:  # no such scene can be built
            ratio = -np.inf
        scenes, finds = scenes + 1, finds + int(ratio > objective.most)
        if climbing:
            step *= _WIDER if ratio > most else _NARROWER
        if ratio > most:
            worst, most, found = at, ratio, scene
    return Find(name, found if np.isfinite(most) else {}, float(most), scenes, finds)


@cache
def _frames(paper: bool, thickness_mm: float) -> tuple[SceneFrame, ...]:
    """Return the states of a guide; its thickness is rounded, so that few are built."""
    curves = default_curves() if paper else parametric_curves()
    return tuple(frames_of(curves, Waveguide(thickness_mm=thickness_mm)))


def tracer_ratio(scene: Mapping[str, float], rng: np.random.Generator) -> float:
    """Return the error of a count by the rays of a scene over the stated one, over fans turned at random."""
    thickness = round(scene["thickness_mm"], 1)
    guide = Waveguide(thickness_mm=thickness, index=scene["index"])
    design = Design(round(scene["cavities"]), scene["width_mm"], scene["depth_mm"], scene["spacing_mm"])
    frame = _frames(scene["curves"] < 0.5, thickness)[round(scene["state"])]
    light = Light().with_rays(round(np.exp(scene["log_rays"])))
    truth = trace(frame, design, guide, Light().with_rays(_REFERENCE_RAYS), threads=1).ndr
    ratios = []
    for _ in range(REPEATS):
        found = trace(frame, design, guide, replace(light, phase=float(rng.uniform(-0.5, 0.5))), threads=1)
        ratios.append((found.ndr - truth) / float(stated_error(found.ndr_sd, light.rays)))
    return float(np.sqrt(np.mean(np.square(ratios))))


def mesh_ratio(scene: Mapping[str, float], _: np.random.Generator) -> float:
    """Return the greatest error of an elongation by its mesh over the stated one, on the third and fourth mesh."""
    actuator = replace(
        ActuatorParameters(), wall_modulus_kpa=scene["wall_modulus_kpa"], neck_radius_mm=scene["neck_radius_mm"],
        wall_mm=scene["wall_mm"], belly_radius_mm=scene["belly_radius_mm"],
    )  # fmt: skip
    found: list[float] = []
    for level in range(1, 6):
        along, wall, lattice = mesh_of(level)
        mesh = replace(actuator, axial_elements=along, wall_elements=wall, lattice_elements=lattice)
        found.append(FullModel(mesh).solver.solve(pressure_kpa=scene["pressure_kpa"]).elongation_mm)
    truth = found[-1] + (found[-1] - found[-2]) / ((5 / 4) ** 2 - 1)
    stated: FloatArray = np.array(error_estimates(found))[1:3]
    return float(np.max(np.abs(np.array(found[2:4]) - truth) / stated))


OBJECTIVES = {
    "tracer": Objective(
        {
            "cavities": (0.0, 9.0), "width_mm": (0.1, 1.5), "depth_mm": (0.05, 1.4), "spacing_mm": (0.1, 1.5),
            "index": (1.3, 1.7), "thickness_mm": (1.5, 2.5), "state": (0.0, 14.0), "curves": (0.0, 1.0),
            "log_rays": (np.log(100), np.log(4_000)),
        },
        tracer_ratio,
    ),
    "mesh": Objective(
        {
            "wall_modulus_kpa": (600.0, 2_500.0), "neck_radius_mm": (3.0, 5.5), "wall_mm": (1.6, 2.8),
            "belly_radius_mm": (6.5, 8.5), "pressure_kpa": (-30.0, 50.0),
        },
        mesh_ratio,
        most=2.0,
    ),
}  # fmt: skip


def main() -> None:
    """Search and print the worst scene as JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("method", choices=OBJECTIVES)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    found = search(chosen.method, OBJECTIVES[chosen.method], chosen.seconds, chosen.seed)
    print(json.dumps({name: getattr(found, name) for name in Find.__dataclass_fields__}, indent=1))


if __name__ == "__main__":
    main()
