"""The same sweep with its fan turned: how far ranks, and the winner, depend on where the rays happen to start.

Strategy: a fan turned by another part of its step is another sample of the same light. The turns are multiples of the
golden ratio, which fill the step evenly for any number of fans, and none is the mirror image of another. P is compared
within three groups: all designs, those with the paper's number of cavities, and the paper's own map (figure 3D: five
cavities 1.0 mm wide).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from analysis.optics.scene.parameters import PAPER_OPTIMUM, PAPER_RAYS, Design, Light
from analysis.optics.sweep.figure_of_merit import ranks_within
from analysis.optics.sweep.sweep import SweepRequest, SweepResult, find_design, run_sweep
from analysis.optics.tracer.tolerance import PILOT_RAYS, jittered, rays_for, stated_error
from analysis.progress import Progress, part_of
from protocol.base.arrays import BoolArray, FloatArray, IntArray

PAPER_FANS = 7
CERTAIN = 0.95  # part of a sweep's counts that meet its tolerance
_GOLDEN = (5**0.5 - 1) / 2


def fans_of(rays: int) -> int:
    """Return the default number of fans of a sweep: several with the paper's rays, whose ranks scatter."""
    return PAPER_FANS if rays == PAPER_RAYS else 1


def turned(light: Light, fan: int) -> Light:
    """Return a light with its fan turned, or with other random places; fan 0 is its own."""
    if light.jitter is not None:
        return replace(light, jitter=light.jitter + fan)
    return replace(light, phase=(light.phase + fan * _GOLDEN + 0.5) % 1 - 0.5)


@dataclass(frozen=True, slots=True)
class Rank:
    """Rank of the paper's optimum in a group of `of` designs, least and greatest rank over the fans."""

    rank: int
    of: int
    low: int
    high: int


@dataclass(frozen=True, slots=True)
class FanResult:
    """A sweep with several fans."""

    designs: tuple[Design, ...]
    p: FloatArray  # (fans, n), the first as in the sweep itself

    def groups(self) -> dict[str, BoolArray]:
        """Return which designs (n,) are compared with the paper's in each group."""
        same = np.array([d.cavities == PAPER_OPTIMUM.cavities for d in self.designs])
        as_wide = np.array([d.width_mm == PAPER_OPTIMUM.width_mm for d in self.designs])
        return {"all": np.ones_like(same), "same_cavities": same, "paper_map": same & as_wide}

    def ranks(self) -> dict[str, IntArray]:
        """Return the ranks (fans,) of the paper's optimum in each group; none if it was not simulated."""
        at = find_design(self.designs)
        return {} if at is None else {name: ranks_within(self.p, each)[:, at] for name, each in self.groups().items()}

    def paper_ranks(self) -> dict[str, Rank]:
        """Return the same with the number of designs in each group and the range over the fans."""
        of = {name: int(np.sum(group)) for name, group in self.groups().items()}
        return {name: Rank(int(r[0]), of[name], int(r.min()), int(r.max())) for name, r in self.ranks().items()}

    def winners(self) -> list[tuple[Design, float]]:
        """Return the designs with the largest P of a fan, and the part of the fans that each wins; most first."""
        at, wins = np.unique(np.argmax(self.p, axis=1), return_counts=True)
        order = np.argsort(-wins, kind="stable")
        return [(self.designs[at[i]], float(wins[i] / len(self.p))) for i in order]


def light_within(request: SweepRequest, tolerance: float) -> Light:
    """Return the light whose rays leave 95 % of the counts of a sweep with an error within a tolerance.

    `request`: the sweep; about every 20th of its designs is traced with a pilot fan. `tolerance`: error of a count,
    rays of 250, or of the power of 250 rays, at 2 standard deviations.
    """
    light = jittered(request.light)
    fan = light.with_rays(PILOT_RAYS)
    pilot = run_sweep(replace(request, designs=request.designs[:: max(1, len(request.designs) // 32)], light=fan))
    sd = np.quantile(pilot.response[1], CERTAIN)
    thickness = request.guide.thickness_mm
    rays = rays_for(fan, float(sd), tolerance, thickness, bool(np.all(pilot.mirrored)))
    return light.with_rays(rays)


def count_errors(result: SweepResult) -> dict[str, float]:
    """Return the error that 95 % of a sweep's responses have at most, and the greatest, at 2 standard deviations."""
    errors = stated_error(result.response[1], result.request.light.rays)
    return {"of_95_percent": float(np.quantile(errors, CERTAIN)), "greatest": float(np.max(errors))}


def compare_fans(
    result: SweepResult,
    fans: int,
    *,
    file: Path | None = None,
    scheduler: str | None = None,
    allow_remote: bool = False,
    progress: Progress | None = None,
) -> FanResult:
    """Repeat a sweep with its fan turned.

    `fans`: how many, its own included. `file`: its results file; each further fan has one beside it.
    """
    request, size, p = result.request, result.ndr.size, [result.merit().p]
    for fan in range(1, fans):
        other = replace(request, light=turned(request.light, fan))
        beside = None if file is None else file.with_name(f"{file.stem}_fan_{fan}{file.suffix}")
        part = part_of(progress, (fan - 1) * size, size, (fans - 1) * size)
        swept = run_sweep(other, file=beside, scheduler=scheduler, allow_remote=allow_remote, progress=part)
        p.append(swept.merit().p)
    return FanResult(result.designs, np.array(p))
