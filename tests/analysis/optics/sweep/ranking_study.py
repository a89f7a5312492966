"""What determines the ranking of designs: number of rays, order of the budget, index, thickness.

Strategy: the same designs are swept once for each case, everything else at its default, and each case's P is compared
with that of the first by rank. The budget of secondaries stays the paper's 100 as the rays grow, so that secondaries
count for less and less; other cases show what they do: in proportion to the rays, none, and all of them with P of
power. The fan is turned by a quarter step with any number of rays but the paper's.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from analysis import figure_style as style
from analysis.optics.scene.curves import default_curves, parametric_curves
from analysis.optics.scene.parameters import ORDERS, PAPER_OPTIMUM, Design, light_by, phase_of
from analysis.optics.sweep.sweep import SweepRequest, SweepResult, run_sweep
from protocol.base.arrays import FloatArray

RAYS = (250, 1_000, 4_000, 10_000)
"""All designs; 10^5 and 10^6 are for a choice of designs, a minute for each ten."""
INDICES = (1.48, 1.50, 1.52)
THICKNESSES_MM = (1.5, 2.0, 2.5)
_MANY = 1_000


@dataclass(frozen=True, slots=True)
class Case:
    """One sweep of a study.

    Parameters
    ----------
    name : what was changed. request : the sweep.
    best : the best design by P. best_p, best_p_ci : its figure and 95 % interval.
    tied : how many designs tie with it. paper_rank, paper_p, paper_tied : the same of the paper's optimum.
    rank_correlation : Spearman's, of P over all designs against the study's first case.
    noise : median over the designs of the standard deviation of NDR, of 250.
    p : (n,) of all designs.
    """

    name: str
    request: SweepRequest
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


def cases(base: SweepRequest, rays: Sequence[int] = RAYS) -> dict[str, SweepRequest]:
    """The sweeps of a full study: rays, secondaries, power, order of the budget, index +- 0.02, thickness +- 0.5 mm."""
    light, guide = base.light, base.guide

    def counted(n: int, secondary: int) -> SweepRequest:
        return replace(base, light=replace(light, rays=n, secondary=secondary, phase=phase_of(n)))

    out = {f"{n} rays": counted(n, light.secondary) for n in rays}
    out[f"{_MANY} rays, secondaries in proportion"] = replace(base, light=light.with_rays(_MANY))
    out[f"{_MANY} rays, no secondaries"] = counted(_MANY, 0)
    out[f"{_MANY} rays, by power"] = replace(base, light=light_by("power", _MANY), by="power")
    out |= {f"order {o}": replace(base, light=replace(light, order=o)) for o in ORDERS if o != light.order}
    out |= {f"index {n:g}": replace(base, guide=replace(guide, index=n)) for n in INDICES if n != guide.index}
    other = [mm for mm in THICKNESSES_MM if mm != guide.thickness_mm]
    return out | {f"thickness {mm:g} mm": replace(base, guide=replace(guide, thickness_mm=mm)) for mm in other}


def study(chosen: dict[str, SweepRequest]) -> Iterator[Case]:
    """Sweep the designs in each case; `PAPER_OPTIMUM` is added where it is missing.

    Raises
    ------
    RequestError, DataError : a case cannot be built.
    """
    reference: FloatArray | None = None
    for name, request in chosen.items():
        designs = tuple(dict.fromkeys([*request.designs, PAPER_OPTIMUM]))
        case = _case(name, run_sweep(replace(request, designs=designs)), reference)
        reference = case.p if reference is None else reference
        yield case


def _case(name: str, result: SweepResult, reference: FloatArray | None) -> Case:
    merit, spread = result.merit(), result.uncertainty()
    best, paper = int(np.argmax(merit.p)), result.designs.index(PAPER_OPTIMUM)
    alike = 1.0 if reference is None else float(spearmanr(reference, merit.p).statistic)
    return Case(
        name,
        result.request,
        result.designs[best],
        float(merit.p[best]),
        (float(spread.p_ci[best, 0]), float(spread.p_ci[best, 1])),
        int(spread.tied.sum()),
        int(result.ranks()[paper]),
        float(merit.p[paper]),
        bool(spread.tied[paper]),
        alike,
        float(np.median(result.response[1])),
        merit.p,
    )


def draw_convergence(cases: Sequence[Case]) -> Figure:
    """Draw how the scatter of NDR, the number of ties and the rank of the paper's optimum settle with the rays."""
    chosen = [case for case in cases if case.name == f"{case.request.light.rays} rays"]
    rays = [case.request.light.rays for case in chosen]
    shown = (
        ("standard deviation of NDR, of 250", [c.noise for c in chosen]),
        ("designs that tie with the best", [c.tied for c in chosen]),
        ("rank of the paper's optimum", [c.paper_rank for c in chosen]),
    )
    figure = Figure(figsize=(9.0, 3.0), layout="constrained")
    for axes, (label, values), colour in zip(figure.subplots(1, 3), shown, style.SENSOR_COLOURS, strict=False):
        axes.plot(rays, values, "o-", color=colour)
        axes.set(xscale="log", xlabel="rays", ylabel=label)
    return figure


if __name__ == "__main__":
    curves = parametric_curves() if "parametric" in sys.argv else default_curves()
    found = []
    for case in study(cases(SweepRequest(curves=curves))):
        found.append(case)
        n, *lengths = case.best.values
        low, high = case.best_p_ci
        paper = f"{case.paper_rank} | {case.paper_p:.2f}{', tied' if case.paper_tied else ''}"
        best = f"{n:.0f}, {', '.join(f'{mm:g}' for mm in lengths)} | {case.best_p:.1f}, {low:.1f} to {high:.1f}"
        print(
            f"| {case.name} | {best} | {case.tied} | {paper} | {case.rank_correlation:.2f} | {case.noise:.2g} |",
            flush=True,
        )
    draw_convergence(found).savefig(sys.argv[1])
