"""The precision of every computation: draft, normal or reference, chosen in one place (`--fidelity`).

The numbers of a level are those that the rule of the trade-off (`analysis.studies.tradeoff.measure.choose`) finds in
the measured table with the level's margin (tested). A level sets no geometry, mesh, data or seeds; explicit values
(rays) override it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from protocol.base.errors import RequestError

Level = Literal["draft", "normal", "reference"]
LEVELS: tuple[Level, ...] = get_args(Level)

MARGINS: dict[Level, float] = {"draft": 0.5, "normal": 2.0, "reference": 10.0}
"""The error, times this, stays below the tolerance of its use: a draft may err by twice that, a reference by a
tenth."""


@dataclass(frozen=True, slots=True)
class Fidelity:
    """One level of precision; the rays are those released in one scene, traced alone or in a sweep of designs."""

    level: Level
    rays: int
    ranking_rays: int
    walkers: int
    posterior_samples: int  # effective: 4,000 give an sd to 1.1 %, the width of the 95 % band to 1.5 %
    resamples: int


_LEVELS: dict[str, Fidelity] = {
    "draft": Fidelity(
        level="draft", rays=50, ranking_rays=2_500,
        walkers=64, posterior_samples=4_000, resamples=100,
    ),
    "normal": Fidelity(
        level="normal", rays=250, ranking_rays=5_000,
        walkers=64, posterior_samples=4_000, resamples=2_000,
    ),
    "reference": Fidelity(
        level="reference", rays=1_000, ranking_rays=25_000,
        walkers=128, posterior_samples=32_000, resamples=50_000,
    ),
}  # fmt: skip


def fidelity(level: str = "normal") -> Fidelity:
    """Return a level by its name. RequestError: there is no such level."""
    if level not in _LEVELS:
        raise RequestError(f"there is no precision {level!r}", f"choose among {', '.join(LEVELS)}")
    return _LEVELS[level]
