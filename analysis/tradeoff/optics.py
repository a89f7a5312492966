"""The ray tracer and the ranking of designs: rays and secondaries against a far finer fan.

The paper's budget of 100 secondaries is for 250 rays. A finer fan with the same 100 is another model, so the rays
grow with a budget in proportion; what a smaller budget leaves out is measured by settings of its own. Each repeat turns
the fan by another phase: an independent sample.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.stats import spearmanr

from analysis.optics.compiled import Floats
from analysis.optics.curves import default_curves, frames_of
from analysis.optics.figure_of_merit import merit, resolution
from analysis.optics.frame import Frame
from analysis.optics.parameters import PAPER_OPTIMUM, Design, Light, Waveguide
from analysis.optics.sensitivity import proportional
from analysis.optics.simulation import trace
from analysis.optics.sweep import paper_grid
from analysis.tradeoff.measure import Method, Setting

DEFAULT = Light()
REFERENCE_PHASE = 0.47
PHASES = (-0.4, -0.27, -0.13, 0.01, 0.12, 0.26, 0.39)


@cache
def _frames() -> tuple[Frame, ...]:
    """The 15 states, built once: a sweep does so too."""
    return tuple(frames_of(default_curves(), Waveguide()))


def _ndr(designs: Sequence[Design], light: Light) -> Floats:
    guide = Waveguide()
    return np.array([[trace(frame, d, guide, light, threads=1).ndr for frame in _frames()] for d in designs])


def _p(designs: Sequence[Design], light: Light) -> Floats:
    return merit(_ndr(designs, light), resolution(light.rays)).p


def tracer_settings(quick: bool) -> list[Setting]:
    """Rays with secondaries in proportion; then the budget at 2,500 rays. One call is 15 states of one design."""
    designs = (PAPER_OPTIMUM,)
    truth = _ndr(designs, replace(proportional(DEFAULT, 10_000 if quick else 40_000), phase=REFERENCE_PHASE))

    def error(ndr: Floats) -> float:
        return float(np.sqrt(np.mean((ndr - truth) ** 2)))

    rays = (50, 250, 1_000, 2_500) if quick else (50, 100, 250, 500, 1_000, 2_500, 5_000, 10_000)
    lights = [(f"{n} rays", proportional(DEFAULT, n)) for n in rays]
    for budget, name in ((0, "no secondaries"), (100, "100 secondaries")):
        lights.append((f"2500 rays, {name}", replace(DEFAULT, rays=2_500, secondary=budget)))

    def sampler(light: Light) -> Callable[[int], Floats]:
        return lambda repeat: _ndr(designs, replace(light, phase=PHASES[repeat]))

    return [Setting(name, sampler(light), error, work=truth.size) for name, light in lights]


def ranking_settings(quick: bool) -> list[Setting]:
    """Rays against the rank correlation of P with a converged ranking; one call ranks a part of the paper's grid."""
    designs = paper_grid()[:: 36 if quick else 18]
    light = replace(proportional(DEFAULT, 5_000 if quick else 10_000), phase=REFERENCE_PHASE)
    truth = _p(designs, light)

    def ranked(rays: int) -> Callable[[int], Floats]:
        return lambda repeat: _p(designs, replace(proportional(DEFAULT, rays), phase=PHASES[repeat]))

    def error(p: Floats) -> float:
        return 1.0 - float(spearmanr(truth, p).statistic)

    rays = (50, 250, 1_000) if quick else (50, 250, 1_000, 2_500)
    return [Setting(f"{n} rays", ranked(n), error, work=len(designs)) for n in rays]


TRACER = Method(
    "tracer", "Ray tracer", "a finer fan, turned (40,000 rays; quick: 10,000), secondaries in proportion", False,
    "the reader of NDR, who reads whole rays of 250: half a ray", 0.5, "rays of 250", "a simulation",
    lambda f: f"{f.rays} rays", tracer_settings,
)  # fmt: skip
RANKING = Method(
    "ranking", "Ranking of designs by P", "the ranking with 10,000 rays (quick: 5,000), fan turned", False,
    "the choice of a design: a rank correlation of 0.95", 0.05, "1 - Spearman's correlation", "a design",
    lambda f: f"{f.ranking_rays} rays", ranking_settings,
)  # fmt: skip
