"""Objectives of the adversary: by method, the numbers of a scene, and its true error over the stated one (k = 2).

A ratio is the root mean square over the repeats of a scene with other random numbers (places of the rays, noise), at
the worst place where there are several; 1 means that the true standard deviation is twice the stated one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from analysis.optics.scene.curves import default_curves, frames_of, parametric_curves
from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.parameters import PAPER_RAYS, By, Design, Waveguide, light_by
from analysis.optics.sweep.figure_of_merit import FLOOR, merit, p_bounds
from analysis.optics.tracer.simulation import TraceResult, trace
from analysis.optics.tracer.tolerance import stated_error
from analysis.studies.failure_maps.sessions import ReadSession

TURNS, SESSIONS, RESPONSES = 6, 12, 500
_REFERENCE_RAYS = {"count": 40_000, "power": 20_000}
_PLACES = 21


@dataclass(frozen=True, slots=True)
class Objective:
    """What is searched: the bounds of a scene's numbers, and its ratio; a scene that is refused has none.

    Above the ratio `most` a scene is a find. It is above 1 where what one answer cannot show is known to be missed.
    """

    bounds: Mapping[str, tuple[float, float]]
    ratio: Callable[[Mapping[str, float], np.random.Generator], float]
    most: float = 1.0


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@cache
def _frames(paper: bool, thickness_mm: float) -> tuple[SceneFrame, ...]:
    """Return the states of a guide; its thickness is rounded, so that few are built."""
    curves = default_curves() if paper else parametric_curves()
    return tuple(frames_of(curves, Waveguide(thickness_mm=thickness_mm)))


def tracer_ratio(scene: Mapping[str, float], rng: np.random.Generator, by: By, *, even: bool = False) -> float:
    """Return the error of a count, or power, by the rays of a scene over the stated one, over random places of rays.

    Parameters
    ----------
    even : over turns of an even fan, which no tolerance chooses.
    """
    thickness = round(scene["thickness_mm"], 1)
    guide = Waveguide(thickness_mm=thickness, index=scene["index"])
    design = Design(round(scene["cavities"]), scene["width_mm"], scene["depth_mm"], scene["spacing_mm"])
    frame = _frames(scene["curves"] < 0.5, thickness)[round(scene["state"])]
    light = light_by(by, round(np.exp(scene["log_rays"])))

    def response(result: TraceResult) -> tuple[float, float]:
        return (
            (result.ndr, result.ndr_sd) if by == "count" else (PAPER_RAYS * result.power, PAPER_RAYS * result.power_sd)
        )

    truth, _ = response(trace(frame, design, guide, light_by(by, _REFERENCE_RAYS[by]), threads=1))
    ratios = []
    for _ in range(TURNS):
        other = replace(light, phase=0.0, jitter=int(rng.integers(1 << 30)))
        if even:
            other = replace(light, phase=float(rng.uniform(-0.5, 0.5)))
        found, sd = response(trace(frame, design, guide, other, threads=1))
        ratios.append((found - truth) / float(stated_error(sd, light.rays)))
    return _rms(ratios)


def fit_ratio(scene: Mapping[str, float], rng: np.random.Generator) -> float:
    """Return the error of a fitted cubic over U, at its worst place, over sessions of readings."""
    session = ReadSession(
        round(scene["grid_mm"], 3), loop_mv=scene["loop_mv"], noise_mv=float(np.exp(scene["log_noise_mv"])),
        levels=round(scene["levels"]), cycles=round(scene["cycles"]), actuator_mm=scene["actuator_mm"],
    )  # fmt: skip
    ratios = []
    for seed in rng.integers(1 << 30, size=SESSIONS):
        fit = replace(session, seed=int(seed)).calibration()
        at = np.linspace(*fit.x_range, _PLACES)
        ratios.append((fit.predict(at) - session.signal(at)) / fit.expanded_u(at))
    return float(np.max(np.sqrt(np.mean(np.square(ratios), axis=0))))


def bounds_ratio(scene: Mapping[str, float], rng: np.random.Generator) -> float:
    """Return how often a bound of P fails over the stated probability, the worse of both bounds."""
    states, error = np.arange(15.0), 0.04
    waves = (np.sin(scene["turns"] * states + shift) for shift in (0.0, 1.3))
    truth = 100.0 - scene["slope"] * states + scene["wave"] * next(waves)
    sd = np.exp(scene["log_sd"] + scene["unequal"] * next(waves))
    noisy = truth + sd * rng.standard_normal((RESPONSES, states.size))
    low, high = p_bounds(noisy, np.broadcast_to(sd, noisy.shape), FLOOR, low_error=error, high_error=error)
    p = float(merit(truth, FLOOR).p)
    return float(max(np.mean(low > p), np.mean(high < p))) / error


_OPTICS = {
    "cavities": (0.0, 9.0), "width_mm": (0.1, 1.5), "depth_mm": (0.05, 1.4), "spacing_mm": (0.1, 1.5),
    "index": (1.3, 1.7), "thickness_mm": (1.5, 2.5), "state": (0.0, 14.0), "curves": (0.0, 1.0),
    "log_rays": (np.log(100), np.log(4_000)),
}  # fmt: skip
OBJECTIVES = {
    "tracer": Objective(_OPTICS, lambda scene, rng: tracer_ratio(scene, rng, "count")),
    "power": Objective(_OPTICS, lambda scene, rng: tracer_ratio(scene, rng, "power")),
    "race": Objective(
        {
            "slope": (0.0, 4.0), "wave": (0.0, 4.0), "turns": (0.0, 3.0), "log_sd": (np.log(0.01), np.log(2.0)),
            "unequal": (0.0, 1.0),
        },
        bounds_ratio,
        most=1.25,
    ),
    "fit": Objective(
        {
            "levels": (6.0, 20.0), "cycles": (2.0, 8.0), "log_noise_mv": (np.log(0.01), np.log(3.0)),
            "grid_mm": (0.0, 0.5), "loop_mv": (0.0, 3.0), "actuator_mm": (0.0, 0.5),
        },
        fit_ratio,
    ),
}  # fmt: skip
