"""What determines the ranking of designs: number of rays, order of the budget, index, thickness (METHODS.md's table).

Strategy: the same designs are swept once for each case, everything else at its default, and each case's P is compared
with that of the first by rank. The budget of secondaries stays the paper's 100 as the rays grow, so
that secondaries count for less and less; two cases show what they do: in proportion to the rays, and none.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from analysis import figure_style as style
from analysis.arrays import FloatArray
from analysis.optics.scene.curves import default_curves
from analysis.optics.scene.parameters import ORDERS, PAPER_OPTIMUM, Design, Light, Waveguide
from analysis.optics.sweep.sweep import SweepRequest, SweepResult, paper_grid, run_sweep

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


def cases(guide: Waveguide, light: Light, rays: Sequence[int] = RAYS) -> list[tuple[str, Waveguide, Light]]:
    """The cases of a full study: ray counts, secondaries, orders of the budget, index +- 0.02, thickness +- 0.5 mm."""
    out = [(f"{n} rays", guide, replace(light, rays=n)) for n in rays]
    out += [
        (f"{_MANY} rays, secondaries in proportion", guide, light.with_rays(_MANY)),
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
) -> list[Case]:
    """Sweep the designs in each case.

    Parameters
    ----------
    chosen : name, guide and light of each case, from `cases`.
    designs : the paper's grid by default; `PAPER_OPTIMUM` is added where it is missing.

    Raises
    ------
    RequestError, DataError : a case cannot be built.
    """
    grid = tuple(dict.fromkeys([*(designs or paper_grid()), PAPER_OPTIMUM]))
    out: list[Case] = []
    for name, guide, light in chosen:
        result = run_sweep(SweepRequest(grid, guide, light, default_curves() if curves is None else curves))
        out.append(_case(name, result, out[0].p if out else None))
    return out


def _case(name: str, result: SweepResult, reference: FloatArray | None) -> Case:
    merit, spread = result.merit(), result.uncertainty()
    best, paper = int(np.argmax(merit.p)), result.designs.index(PAPER_OPTIMUM)
    alike = 1.0 if reference is None else float(spearmanr(reference, merit.p).statistic)
    return Case(
        name,
        result.request.guide,
        result.request.light,
        result.designs[best],
        float(merit.p[best]),
        (float(spread.p_ci[best, 0]), float(spread.p_ci[best, 1])),
        int(spread.tied.sum()),
        int(result.ranks()[paper]),
        float(merit.p[paper]),
        bool(spread.tied[paper]),
        alike,
        float(np.median(result.ndr_sd)),
        merit.p,
    )


def draw_convergence(cases: Sequence[Case]) -> Figure:
    """Draw how the scatter of NDR, the number of ties and the rank of the paper's optimum settle with the rays."""
    chosen = [case for case in cases if case.name == f"{case.light.rays} rays"]
    rays = [case.light.rays for case in chosen]
    shown = (
        ("standard deviation of NDR, of 250", [c.noise for c in chosen]),
        ("designs that tie with the best", [c.tied for c in chosen]),
        ("rank of the paper's optimum", [c.paper_rank for c in chosen]),
    )
    figure = Figure(figsize=(9.0, 3.0), layout="constrained")
    for axes, (label, values), colour in zip(figure.subplots(1, 3), shown, style.SENSORS, strict=False):
        axes.plot(rays, values, "o-", color=colour)
        axes.set(xscale="log", xlabel="rays", ylabel=label)
    return figure


if __name__ == "__main__":
    found = study(cases(Waveguide(), Light()))
    for case in found:
        print(
            case.name, case.best, f"{case.best_p:.2f} {case.best_p_ci} {case.tied} {case.paper_rank} {case.paper_p:.2f}"
        )
    draw_convergence(found).savefig(sys.argv[1] if len(sys.argv) > 1 else "analysis/optics/convergence.svg")
