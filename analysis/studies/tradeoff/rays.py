"""The ray tracer and the ranking of designs: rays and secondaries against counts by a second tracer.

The paper's budget of 100 secondaries is for 250 rays. A finer fan with the same 100 is another model, so the budget is
in proportion to the rays; settings of their own measure the effect of a smaller budget. Each repeat turns the fan by
another phase: an independent sample. The scene is that of the reference, independent of the default curves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.stats import spearmanr

from analysis.optics.scene.curves import frames_of
from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.geometry import pattern_of
from analysis.optics.scene.parameters import PAPER_OPTIMUM, PAPER_RAYS, Light, Waveguide
from analysis.optics.sweep.figure_of_merit import merit, resolution
from analysis.optics.sweep.sweep import common_of, paper_grid, run_item
from analysis.optics.tracer.simulation import trace
from analysis.optics.tracer.tally import DETECTED
from analysis.studies.tradeoff.measure import Method, Setting
from analysis.studies.tradeoff.references import load
from protocol.base.arrays import FloatArray

PHASES = (-0.4, -0.27, -0.13, 0.01, 0.12, 0.26, 0.39)
MANY = 2_500
MOST_FOR_ALL_STATES = 100_000  # more rays are followed in one state only: the others would add time, not information


@cache
def _frames() -> tuple[SceneFrame, ...]:
    """Return the 15 states, built once, as in a sweep."""
    return tuple(frames_of(np.array(load("tracer")["curves_mm"]), Waveguide()))


def counting_limit() -> float:
    """Return the 95 % half-width of a count of 250 rays at the mean share that is detected, rays."""
    share = float(np.mean(load("tracer")["ndr"])) / PAPER_RAYS
    return 1.96 * float(np.sqrt(PAPER_RAYS * share * (1.0 - share)))


def tracer_settings(quick: bool) -> list[Setting]:
    """Return rays with secondaries in proportion, then other budgets. A call is five states."""
    table = load("tracer")
    states, truth = table["states"], np.array(table["ndr"])

    def error(ndr: FloatArray) -> float:
        return float(np.sqrt(np.mean((ndr - truth[: ndr.size]) ** 2)))

    def sampler(light: Light, count: int) -> Callable[[int], FloatArray]:
        return lambda repeat: _ndr(states[:count], turned(light, repeat))

    rays = (50, 250, 1_000, 2_500) if quick else (50, 100, 250, 500, 1_000, 2_500, 10_000, 100_000, 1_000_000)
    lights = {rays_text(n): Light().with_rays(n) for n in rays}
    many = replace(Light(), rays=MANY, secondary=0)
    lights[f"{rays_text(MANY)}, no secondaries"] = many
    lights[f"{rays_text(MANY)}, 100 secondaries"] = replace(many, secondary=100)
    counts = {name: 1 if light.rays > MOST_FOR_ALL_STATES else len(states) for name, light in lights.items()}
    return [Setting(name, sampler(light, counts[name]), error, work=counts[name]) for name, light in lights.items()]


def _ndr(states: Sequence[int], light: Light) -> FloatArray:
    frames = _frames()
    return np.array([trace(frames[s], PAPER_OPTIMUM, Waveguide(), light, threads=1).ndr for s in states])


def turned(light: Light, repeat: int) -> Light:
    """Return the rays of a repeat: the fan turned by another phase."""
    return replace(light, phase=PHASES[repeat])


def rays_text(count: int) -> str:
    return f"{count} rays"


def ranking_settings(quick: bool) -> list[Setting]:
    """Return numbers of rays: rank correlation of P with the second tracer's; a call sweeps a part of the grid."""
    table = load("tracer")
    part = slice(None, None, 2 if quick else 1)
    truth = merit(np.array(table["ranking_ndr"])[part], resolution(table["ranking_rays"])).p
    patterns = np.array([pattern_of(design) for design in paper_grid()[:: table["every"]][part]])

    def ranked(rays: int) -> Callable[[int], FloatArray]:
        return lambda repeat: _p(patterns, turned(Light().with_rays(rays), repeat))

    def error(p: FloatArray) -> float:
        return 1.0 - float(spearmanr(truth, p).statistic)

    rays = (50, 250, 1_000, 5_000) if quick else (50, 250, 1_000, 2_500, 5_000, 10_000, 25_000)
    return [Setting(rays_text(n), ranked(n), error, work=len(patterns)) for n in rays]


def _p(patterns: FloatArray, light: Light) -> FloatArray:
    counts, _, _ = run_item(common_of(_frames(), Waveguide(), light), patterns)
    ndr = np.asarray(PAPER_RAYS / light.rays * counts[..., DETECTED], dtype=np.float64)
    return merit(ndr, resolution(light.rays)).p


TRACER = Method(
    "tracer", "Ray tracer",
    "a second tracer that tries every segment of the outline (1,000,000 rays, secondaries in proportion)", True,
    "the counting error of the paper's 250 rays: 95 % of its statistics, 1.96 sqrt(250 p (1 - p))",
    counting_limit(), "rays of 250", "a simulation", lambda level: rays_text(level.rays), tracer_settings,
)  # fmt: skip
RANKING = Method(
    "ranking", "Ranking of designs by P",
    "the ranking by the second tracer (50,000 rays, secondaries in proportion)", True,
    "the choice of a design: a rank correlation of 0.95", 0.05, "of rank correlation", "a design in 15 states",
    lambda level: rays_text(level.ranking_rays), ranking_settings,
)  # fmt: skip
