"""What decides the ranking: the number of rays, the budget's order, the index, the thickness.

Strategy: the same designs are swept once for each case, everything else at its default, and each case's P is compared
with that of the first by rank. The budget of secondaries stays the paper's 100 as the rays grow, so
that secondaries count for less and less; two cases show what they do: in proportion to the rays, and none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import spearmanr

from analysis.arrays import FloatArray
from analysis.optics.scene.curves import default_curves
from analysis.optics.scene.parameters import ORDERS, PAPER_OPTIMUM, Design, Light, Waveguide
from analysis.optics.sweep.sweep import Progress, SweepRequest, SweepResult, paper_grid, run_sweep

RAYS = (250, 1_000, 4_000, 25_000)
"""All designs; 10^5 and 10^6 are for a choice of designs, a minute for each ten."""
INDICES = (1.48, 1.50, 1.52)
THICKNESSES_MM = (1.5, 2.0, 2.5)
_MANY = 2_500


@dataclass(frozen=True, slots=True)
class Case:
    """One sweep of a study.

    Parameters
    ----------
    name : what was changed. guide, light : the parameters.
    best : the best design by P. best_p, best_p_ci : its figure and 95 % interval.
    tied : how many designs tie with it. paper_rank, paper_p, paper_tied : the same of the paper's optimum.
    rank_correlation : Spearman's, of P over all designs against the study's first case.
    noise : median over the designs of the standard deviation of NDR, of 250.
    p : (n,) of all designs.
    """

    name: str
    guide: Waveguide
    light: Light
    best: Design
    best_p: float
    best_p_ci: tuple[float, float]
    tied: int
    paper_rank: int
    paper_p: float
    paper_tied: bool
    rank_correlation: float
    noise: float
    p: FloatArray


def proportional(light: Light, rays: int) -> Light:
    """The same light with more rays and a budget of secondaries in proportion: a finer sample of the same model."""
    return replace(light, rays=rays, secondary=round(light.secondary * rays / light.rays))


def cases(guide: Waveguide, light: Light, rays: Sequence[int] = RAYS) -> list[tuple[str, Waveguide, Light]]:
    """The cases of a full study: ray counts, secondaries, orders of the budget, index +- 0.02, thickness +- 0.5 mm."""
    out = [(f"{n} rays", guide, replace(light, rays=n)) for n in rays]
    out += [
        (f"{_MANY} rays, secondaries in proportion", guide, proportional(light, _MANY)),
        (f"{_MANY} rays, no secondaries", guide, replace(light, rays=_MANY, secondary=0)),
    ]
    out += [(f"order {order}", guide, replace(light, order=order)) for order in ORDERS if order != light.order]
    out += [(f"index {n:g}", replace(guide, index=n), light) for n in INDICES if n != guide.index]
    out += [
        (f"thickness {t:g} mm", replace(guide, thickness_mm=t), light)
        for t in THICKNESSES_MM
        if t != guide.thickness_mm
    ]
    return out


def study(
    chosen: Sequence[tuple[str, Waveguide, Light]],
    designs: Sequence[Design] | None = None,
    curves: FloatArray | None = None,
    *,
    progress: Progress | None = None,
) -> list[Case]:
    """Sweep the designs in each case.

    Parameters
    ----------
    chosen : name, guide and light of each case, from `cases`.
    designs : the paper's grid by default; `PAPER_OPTIMUM` is added where it is missing.
    progress : called with (cases done, cases); raising from it cancels.

    Raises
    ------
    RequestError, DataError : a case cannot be built.
    """
    grid = tuple(dict.fromkeys([*(designs or paper_grid()), PAPER_OPTIMUM]))
    out: list[Case] = []
    for done, (name, guide, light) in enumerate(chosen, start=1):
        result = run_sweep(SweepRequest(grid, guide, light, default_curves() if curves is None else curves))
        out.append(_case(name, result, out[0].p if out else None))
        if progress is not None:
            progress(done, len(chosen))
    return out


def _case(name: str, result: SweepResult, reference: FloatArray | None) -> Case:
    merit, doubt = result.merit(), result.uncertainty()
    best, paper = int(np.argmax(merit.p)), result.designs.index(PAPER_OPTIMUM)
    alike = 1.0 if reference is None else float(spearmanr(reference, merit.p).statistic)
    return Case(
        name,
        result.request.guide,
        result.request.light,
        result.designs[best],
        float(merit.p[best]),
        (float(doubt.p_ci[best, 0]), float(doubt.p_ci[best, 1])),
        int(doubt.tied.sum()),
        int(result.ranks()[paper]),
        float(merit.p[paper]),
        bool(doubt.tied[paper]),
        alike,
        float(np.median(result.ndr_sd)),
        merit.p,
    )
