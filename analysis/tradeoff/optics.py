"""The ray tracer and the ranking of designs: rays and secondaries against counts by a second tracer.

The paper's budget of 100 secondaries is for 250 rays. A finer fan with the same 100 is another model, so the rays
grow with a budget in proportion; what a smaller budget leaves out is measured by settings of its own. Each repeat turns
the fan by another phase: an independent sample. The scene is the reference's own, so that a change of the default
curves does not part the two.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.stats import spearmanr

from analysis.arrays import FloatArray
from analysis.optics.scene.curves import frames_of
from analysis.optics.scene.frame import Frame
from analysis.optics.scene.geometry import pattern_of
from analysis.optics.scene.parameters import PAPER_OPTIMUM, Light, Waveguide
from analysis.optics.sweep.figure_of_merit import merit, resolution
from analysis.optics.sweep.sensitivity import proportional
from analysis.optics.sweep.sweep import paper_grid, run_item
from analysis.optics.tracer.rays import DETECTED
from analysis.optics.tracer.simulation import fan_of, rules_of, stacked, trace
from analysis.tradeoff.measure import Method, Setting
from analysis.tradeoff.references import load
from analysis.tradeoff.variants import trace_variant

PAPER_RAYS = 250
PHASES = (-0.4, -0.27, -0.13, 0.01, 0.12, 0.26, 0.39)
MANY = 2_500
MOST_FOR_ALL_STATES = 100_000
"""More rays are followed in one state only: the others would not tell more for the time."""


@cache
def _frames() -> tuple[Frame, ...]:
    """The 15 states, built once: a sweep does so too."""
    return tuple(frames_of(np.array(load("tracer")["curves_mm"]), Waveguide()))


def counting_limit() -> float:
    """Return the 95 % half-width of a count of 250 rays at the mean share that is detected, rays."""
    share = float(np.mean(load("tracer")["ndr"])) / PAPER_RAYS
    return 1.96 * float(np.sqrt(PAPER_RAYS * share * (1.0 - share)))


def tracer_settings(quick: bool) -> list[Setting]:
    """Rays with secondaries in proportion; then other budgets, chords for arcs, and float32. A call is five states."""
    table = load("tracer")
    states, truth = table["states"], np.array(table["ndr"])

    def error(ndr: FloatArray) -> float:
        return float(np.sqrt(np.mean((ndr - truth[: ndr.size]) ** 2)))

    def sampler(light: Light, count: int) -> Callable[[int], FloatArray]:
        return lambda repeat: _ndr(states[:count], replace(light, phase=PHASES[repeat]))

    rays = (50, 250, 1_000, 2_500) if quick else (50, 100, 250, 500, 1_000, 2_500, 10_000, 100_000, 1_000_000)
    lights = [(_rays(n), proportional(Light(), n)) for n in rays]
    many = replace(Light(), rays=MANY, secondary=0)
    lights.append((f"{_rays(MANY)}, no secondaries", many))
    lights.append((f"{_rays(MANY)}, 100 secondaries", replace(many, secondary=100)))
    found = []
    for name, light in lights:
        count = 1 if light.rays > MOST_FOR_ALL_STATES else len(states)
        found.append(Setting(name, sampler(light, count), error, work=count))

    def variant(what: str, chord_mm: float | None, *, single: bool = False) -> Setting:
        light = proportional(Light(), MANY)

        def call(repeat: int) -> FloatArray:
            turned = replace(light, phase=PHASES[repeat])
            return np.array([_variant(s, turned, chord_mm, single) for s in states])

        return Setting(f"{_rays(MANY)}, {what}", call, error, work=len(states))

    found += [variant(f"chords of {mm:g} mm", mm) for mm in ((1.0,) if quick else (1.0, 0.25, 0.06))]
    return found if quick else [*found, variant("float32", None, single=True)]


def _ndr(states: Sequence[int], light: Light) -> FloatArray:
    frames = _frames()
    return np.array([trace(frames[s], PAPER_OPTIMUM, Waveguide(), light, threads=1).ndr for s in states])


def _variant(state: int, light: Light, chord_mm: float | None, single: bool) -> float:
    frame = _frames()[state]
    return trace_variant(frame, PAPER_OPTIMUM, Waveguide(), light, chord_mm=chord_mm, single=single).ndr


def _rays(count: int) -> str:
    return f"{count} rays"


def ranking_settings(quick: bool) -> list[Setting]:
    """Rays against the rank correlation of P with the second tracer's; one call sweeps a part of the paper's grid."""
    table = load("tracer")
    part = slice(None, None, 2 if quick else 1)
    truth = merit(np.array(table["ranking_ndr"])[part], resolution(table["ranking_rays"])).p
    patterns = np.array([pattern_of(design) for design in paper_grid()[:: table["every"]][part]])

    def ranked(rays: int) -> Callable[[int], FloatArray]:
        return lambda repeat: _p(patterns, replace(proportional(Light(), rays), phase=PHASES[repeat]))

    def error(p: FloatArray) -> float:
        return 1.0 - float(spearmanr(truth, p).statistic)

    rays = (50, 250, 1_000, 5_000) if quick else (50, 250, 1_000, 2_500, 5_000, 10_000, 25_000)
    return [Setting(_rays(n), ranked(n), error, work=len(patterns)) for n in rays]


def _p(patterns: FloatArray, light: Light) -> FloatArray:
    frame, guide = _frames()[0], Waveguide()
    counts, _, _ = run_item(
        stacked(_frames()), rules_of(guide, light, frame), fan_of(light, frame), light.secondary, patterns
    )
    return merit(
        np.asarray(PAPER_RAYS / light.rays * counts[..., DETECTED], dtype=np.float64), resolution(light.rays)
    ).p


TRACER = Method(
    "tracer", "Ray tracer",
    "a second tracer that tries every segment of the outline (1,000,000 rays, secondaries in proportion)", True,
    "who holds a count beside the paper's, of 250 rays: 95 % of its counting statistics, 1.96 sqrt(250 p (1 - p))",
    counting_limit(), "rays of 250", "a simulation", lambda level: _rays(level.rays), tracer_settings,
)  # fmt: skip
RANKING = Method(
    "ranking", "Ranking of designs by P",
    "the ranking by the second tracer (50,000 rays, secondaries in proportion)", True,
    "the choice of a design: a rank correlation of 0.95", 0.05, "1 - Spearman's correlation", "a design in 15 states",
    lambda level: _rays(level.ranking_rays), ranking_settings,
)  # fmt: skip
