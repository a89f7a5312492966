"""The rank of the paper's optical design under each reading of what the paper leaves open.

Strategy: a reading is one choice of every open parameter: the default one, and those that differ from it in one choice.
Each is swept as the paper did it, with 250 rays, counted, 100 secondaries; with the fan turned; and with more rays,
because a rank that only one fan of 250 rays shows is chance. P is a product, so the distance to the best design is told
apart exactly into its three factors.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from analysis.optics.scene.parameters import (
    FACES,
    ORDERS,
    PAPER_RAYS,
    Design,
    Emission,
    Face,
    Light,
    Order,
    Waveguide,
)
from analysis.optics.sweep.fans import FanResult, compare_fans
from analysis.optics.sweep.sweep import SweepRequest, SweepResult, find_design, paper_grid, run_sweep
from analysis.progress import Progress, part_of
from analysis.version import program_version
from protocol.base.arrays import FloatArray
from protocol.base.errors import FileError, RequestError, writing
from protocol.base.whole_file import write_whole

THICKNESSES_MM = (2.0, 1.5)
EMISSIONS: tuple[Emission, ...] = ("uniform", "lambertian")
FANS, CONVERGED_RAYS = 3, 1_000
_FILE_NAME = "optics.json"
AXES = ("face", "thickness_mm", "states", "emission", "order")
_GROUPS = {"all": "all designs", "same_cavities": "designs with five cavities", "paper_map": "the paper's own map"}
DECIDED_BY = {
    "face": "where the cavities are: a section of the guide, or the geometry of figure 3A",
    "thickness_mm": "the thickness of the simulated guide",
    "states": "the deformation curves of the mechanical simulation, in mm, for the 15 states",
    "emission": "the distribution of directions that was set at the source",
    "order": "the order in which the 100 secondary rays were followed",
}


@dataclass(frozen=True, slots=True)
class PaperReading:
    """One choice of what the paper leaves open."""

    face: Face
    thickness_mm: float
    states: str  # name of the deformation curves
    emission: Emission
    order: Order  # of the secondary rays that are followed


@dataclass(frozen=True, slots=True)
class Sampling:
    """Sampling of a sweep: the number of rays, and the turns of the fan."""

    rays: int
    fans: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """The rank of the paper's design in one reading.

    `factors`: best P over the paper's, by Delta, n_sign and RMSE; their product is `best_p / paper_p`, where the
    paper's P is positive.
    """

    reading: PaperReading
    sampling: Sampling
    ranks: dict[str, list[int]]  # ranks of the paper's design by group, one for each turn of the fan
    of: dict[str, int]
    best: Design  # the design with the largest P without a further turn
    paper_p: float
    best_p: float
    factors: dict[str, float]
    p: list[float]  # (n,) of all designs, without a further turn

    def won(self, group: str) -> float:
        """Return the part of the turns in which the paper's design is the best of a group."""
        return float(np.mean(np.array(self.ranks[group]) == 1))


def readings(states: Sequence[str]) -> list[PaperReading]:
    """Return the default reading, and those that differ from it in one choice."""
    first = PaperReading(FACES[0], THICKNESSES_MM[0], states[0], EMISSIONS[0], ORDERS[0])
    choices: dict[str, Sequence[Any]] = dict(zip(AXES, (FACES, THICKNESSES_MM, states, EMISSIONS, ORDERS), strict=True))
    return [first, *(replace(first, **{axis: value}) for axis, every in choices.items() for value in every[1:])]


def plan(states: Sequence[str], fans: int, rays: int) -> list[tuple[PaperReading, Sampling]]:
    """Return the sweeps in order.

    `states`: names of the deformation curves. `fans`: turns of the fan with the paper's rays. `rays`: released in the
    converged sweeps.
    """
    samplings = Sampling(PAPER_RAYS, fans), Sampling(rays, 1)
    return [(reading, sampling) for sampling in samplings for reading in readings(states)]


def reproduce(
    curves: dict[str, FloatArray],
    *,
    fans: int = FANS,
    rays: int = CONVERGED_RAYS,
    folder: Path | None = None,
    progress: Progress | None = None,
) -> list[Outcome]:
    """Sweep every reading.

    `curves`: deformation curves (15, 2, points, 2) in mm by name, the default ones first.
    Raises RequestError, FileError, DataError: as `run_sweep`, or the folder holds something else.
    """
    if fans < 1:
        raise RequestError(f"{fans} turns of the fan", "compare one or more")
    todo = plan(list(curves), fans, rays)
    file = None if folder is None else folder / _FILE_NAME
    kept = {} if file is None else _kept(file)
    total, done, out = sum(sampling.rays * sampling.fans for _, sampling in todo), 0, []
    for reading, sampling in todo:
        key = _key(reading, sampling, curves[reading.states])
        if key not in kept:
            part = part_of(progress, done, sampling.rays * sampling.fans, total)
            kept[key] = asdict(_outcome(reading, sampling, curves[reading.states], part))
            if file is not None:
                with writing(file):
                    write_whole(file, json.dumps({"version": program_version(), "outcomes": kept}))
        out.append(_read(kept[key]))
        done += sampling.rays * sampling.fans
    return out


def _outcome(reading: PaperReading, sampling: Sampling, curves: FloatArray, progress: Progress | None) -> Outcome:
    designs = _designs(reading)
    light = replace(Light().with_rays(sampling.rays), emission=reading.emission, order=reading.order)
    request = SweepRequest(designs, Waveguide(thickness_mm=reading.thickness_mm), light, curves)
    result = run_sweep(request, progress=part_of(progress, 0, 1, sampling.fans))
    turned = compare_fans(result, sampling.fans, progress=part_of(progress, 1, sampling.fans - 1, sampling.fans))
    return _compared(reading, sampling, turned, result)


def _compared(reading: PaperReading, sampling: Sampling, turned: FanResult, result: SweepResult) -> Outcome:
    merit = result.merit()
    best, paper = int(np.argmax(turned.p[0])), find_design(turned.designs)
    if paper is None:
        cause = "the paper's design is not among those swept"
        raise RequestError(cause, "keep its width, depth and spacing in the grid")
    ranks = turned.ranks()
    rises, rmse = np.maximum(merit.n_sign, 1.0), np.maximum(merit.rmse, result.floor)
    factors = {
        "delta": float(merit.delta[best] / merit.delta[paper]),
        "n_sign": float(rises[paper] / rises[best]),
        "rmse": float(rmse[paper] / rmse[best]),
    }
    return Outcome(
        reading,
        sampling,
        {name: each.tolist() for name, each in ranks.items()},
        {name: int(np.sum(group)) for name, group in turned.groups().items()},
        turned.designs[best],
        float(merit.p[paper]),
        float(merit.p[best]),
        factors,
        [float(f"{p:.4g}") for p in turned.p[0]],
    )


def _key(reading: PaperReading, sampling: Sampling, curves: FloatArray) -> str:
    shape = hashlib.sha256(np.ascontiguousarray(curves).tobytes()).hexdigest()[:12]
    return json.dumps([*asdict(reading).values(), *asdict(sampling).values(), shape, program_version()])


def _kept(file: Path) -> dict[str, Any]:
    """Return the outcomes of an earlier run by their keys."""
    if not file.exists():
        return {}
    try:
        found = json.loads(file.read_text(encoding="utf-8"))["outcomes"]
        for each in found.values():
            _read(each)
    except (ValueError, KeyError, TypeError, AttributeError, RequestError, OSError) as error:
        raise FileError(f"{file} is damaged, or no result of this command", "choose another folder") from error
    return dict(found)


def _read(content: dict[str, Any]) -> Outcome:
    parts = {"reading": PaperReading, "sampling": Sampling, "best": Design}
    return Outcome(**{name: parts[name](**value) if name in parts else value for name, value in content.items()})


@dataclass(frozen=True, slots=True)
class Influence:
    """Effect of one change on the ranking, with more rays."""

    axis: str  # with value: the choice that differs from the default reading's
    value: str
    correlation: float  # Spearman's, of P over the designs that both have, against the default reading


def influences(outcomes: Sequence[Outcome]) -> list[Influence]:
    """Return how far each single change of the default reading changes the ranking, the most first."""
    default, *others = (o for o in outcomes if o.sampling.rays != PAPER_RAYS)
    out = []
    for outcome in others:
        axis = next(axis for axis in AXES if getattr(outcome.reading, axis) != getattr(default.reading, axis))
        out.append(Influence(axis, str(getattr(outcome.reading, axis)), _correlation(default, outcome)))
    return sorted(out, key=lambda influence: influence.correlation)


def _correlation(a: Outcome, b: Outcome) -> float:
    first, second = (dict(zip((d.values for d in _designs(o.reading)), o.p, strict=True)) for o in (a, b))
    both = [values for values in first if values in second]
    return float(spearmanr([first[v] for v in both], [second[v] for v in both]).statistic)


def _designs(reading: PaperReading) -> tuple[Design, ...]:
    """Return the paper's grid without designs whose opposite cavities would meet."""
    return tuple(d for d in paper_grid(face=reading.face) if d.cut_mm < reading.thickness_mm)


def readings_json(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return the object of `reproduce optics --json`."""
    return {
        "version": program_version(),
        "readings": [
            {
                **asdict(o.reading),
                **asdict(o.sampling),
                "ranks": {
                    name: {"rank": r[0], "of": o.of[name], "low": min(r), "high": max(r), "won": o.won(name)}
                    for name, r in o.ranks.items()
                },
                "best": asdict(o.best),
                "paper_p": o.paper_p,
                "best_p": o.best_p,
                "factors": o.factors,
            }
            for o in outcomes
        ],
        "influences": [asdict(influence) for influence in influences(outcomes)],
        "decided_by": {axis: DECIDED_BY[axis] for axis in dict.fromkeys(i.axis for i in influences(outcomes))},
    }


def readings_text(outcomes: Sequence[Outcome]) -> str:
    """Return in lines how often the paper's design wins, what changes the ranking most, and what would decide."""
    lines = []
    for sampling in dict.fromkeys(o.sampling for o in outcomes):
        chosen = [o for o in outcomes if o.sampling == sampling]
        lines.append(f"{_sampled(sampling)}, {len(chosen)} readings:")
        for name, words in _GROUPS.items():
            ranks = [rank for o in chosen for rank in o.ranks[name]]
            always = sum(o.won(name) == 1.0 for o in chosen)
            some = sum(0.0 < o.won(name) < 1.0 for o in chosen)
            lines.append(
                f"  {words}: the paper's design is first in {always} at every turn of the fan, in {some} at some; "
                f"ranks {min(ranks)} to {max(ranks)}, median {np.median(ranks):.0f}"
            )
    lines.append("change of the default reading, and Spearman's correlation of P with it (1 changes no rank):")
    lines += [f"  {i.axis} {i.value}: {i.correlation:.2f}" for i in influences(outcomes)]
    lines.append("information that would decide, by what changes the ranking most:")
    lines += [f"  {sentence}" for sentence in readings_json(outcomes)["decided_by"].values()]
    return "\n".join(lines)


def readings_table(outcomes: Sequence[Outcome]) -> str:
    """Return all outcomes as a Markdown table."""
    head = (
        "| cavities | thickness | states | emission | order | rays | all | as many cavities | own map | best | its P "
        "over the paper's = Delta x n_sign x RMSE |"
    )
    return "\n".join([head, "|" + "--|" * 11, *map(_row, outcomes)]) + "\n"


def _row(o: Outcome) -> str:
    ranks = []
    for name, found in o.ranks.items():
        turns = f" ({min(found)} to {max(found)})" if len(found) > 1 else ""
        ranks.append(f"{found[0]} of {o.of[name]}{turns}")
    n, *lengths = o.best.values
    ratio = f"{o.best_p / o.paper_p:.1f} = {' x '.join(f'{part:.2f}' for part in o.factors.values())}"
    r, best = o.reading, ", ".join([f"{n:.0f}", *(f"{mm:g}" for mm in lengths)])
    reading = f"{r.face} | {r.thickness_mm:g} mm | {r.states} | {r.emission} | {r.order}"
    return f"| {reading} | {_sampled(o.sampling)} | {' | '.join(ranks)} | {best} | {ratio} |"


def _sampled(sampling: Sampling) -> str:
    turns = f", {sampling.fans} turns" if sampling.fans > 1 else ""
    return f"{sampling.rays} rays{turns}"
