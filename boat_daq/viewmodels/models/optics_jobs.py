"""What the optics page computes in a helper process: one design in all states, the sweep, the search; their results.

Deformation curves have a name: `default` is the set that ships, `parametric` the one in closed form, anything else the
path of a file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from analysis.arrays import BoolArray, FloatArray, IntArray
from analysis.errors import DataError
from analysis.progress import Progress

if TYPE_CHECKING:
    from analysis.optics.scene.frame import SceneFrame
    from analysis.optics.scene.parameters import Design, Light, Waveguide
    from analysis.optics.sweep.figure_of_merit import Merit

Values = tuple[int, float, float, float]
"""Cavities, width, depth, spacing (mm) of a design."""
GAP = np.full((1, 2), np.nan)


class StateScene(NamedTuple):
    """One state, mm along and across the actuator: polylines [k, 2] with NaN between their parts."""

    outline: FloatArray
    released: FloatArray
    secondary: FloatArray
    receiver: FloatArray


@dataclass(frozen=True, slots=True)
class DesignResult:
    """One design in all states."""

    scenes: tuple[StateScene, ...]
    elongation_mm: FloatArray
    ndr: FloatArray
    ndr_sd: FloatArray
    merit: Merit


@dataclass(frozen=True, slots=True)
class SweepSummary:
    """A sweep: `values` [n, 4] cavities, width, depth, spacing; the rest [n]."""

    values: FloatArray
    merit: Merit
    tied: FloatArray
    front: BoolArray
    best: int
    paper: int
    ranks: IntArray
    seconds: float
    simulated: int
    rays: int

    def grid(self, cavities: int, width_mm: float, steps: tuple[float, ...]) -> FloatArray:
        """Return P, best = 1, over [spacing, depth] for one number of cavities and one width; NaN where there is none.

        Parameters
        ----------
        cavities : their number.
        width_mm : of a cavity.
        steps : depths and spacings, mm.
        """
        out = np.full((len(steps), len(steps)), np.nan)
        chosen = (self.values[:, 0] == cavities) & np.isclose(self.values[:, 1], width_mm)
        depth, spacing = (np.abs(self.values[chosen, k, None] - np.array(steps)).argmin(axis=1) for k in (2, 3))
        out[spacing, depth] = self.merit.p_normalised[chosen]
        return out


class OptimumSummary(NamedTuple):
    """The best design beyond the grid, its P and the P of the grid's best, on power with ten times the rays."""

    values: Values
    face: str
    p: float
    start_p: float
    finished: bool


def curves_of(name: str) -> FloatArray:
    """Return the fifteen states of `default`, `parametric` or a file, [15][2][points][2] mm.

    Raises
    ------
    AnalysisError : the file cannot be read, or holds one state only.
    """
    from analysis.optics.scene.curve_file import read_curves
    from analysis.optics.scene.curves import default_curves, parametric_curves

    if name == "default":
        return np.asarray(default_curves())
    if name == "parametric":
        return np.asarray(parametric_curves())
    curves = np.asarray(read_curves(Path(name)))
    if len(curves) == 1:
        raise DataError(f"{Path(name).name} holds one state only", "the page needs all 15, most compressed first")
    return curves


def elongations_of(name: str, curves: FloatArray) -> FloatArray:
    """Return the states' elongation, mm: as the set gives it, else the change of the guides' length end to end."""
    from analysis.optics.scene.curves import REST, elongations

    if name == "default":
        return np.asarray(elongations())
    apart = np.linalg.norm(curves[:, :, -1] - curves[:, :, 0], axis=-1).mean(axis=1)
    return np.asarray(apart - apart[REST])


def trace_design(
    values: Values,
    rays: int,
    curves: str = "default",
    face: str = "outer",
    *,
    progress: Progress | None = None,
) -> DesignResult:
    """Return a design's rays, NDR and power in every state.

    Parameters
    ----------
    values : cavities, width, depth, spacing (mm).
    rays : released in each state.
    curves : name of the states, see `curves_of`.
    face : outer or inner.
    progress : is called with the states done and their number.

    Raises
    ------
    AnalysisError : the design does not fit, or the curves cannot be read.
    """
    from analysis.optics.scene.curves import frames_of
    from analysis.optics.scene.parameters import Design, Light, Waveguide
    from analysis.optics.sweep.figure_of_merit import merit, resolution
    from analysis.optics.tracer.simulation import trace

    design = Design(*values, face)  # type: ignore[arg-type]  # Design checks the face
    guide, light = Waveguide(), Light().with_rays(rays)
    states = curves_of(curves)
    frames = frames_of(states, guide)
    scenes, detected = [], []
    for done, frame in enumerate(frames, 1):
        scenes.append(_scene(frame, design, guide, light))
        outcome = trace(frame, design, guide, light)
        detected.append((outcome.ndr, outcome.ndr_sd))
        if progress is not None:
            progress(done, len(frames))
    ndr, ndr_sd = np.array(detected).T
    return DesignResult(tuple(scenes), elongations_of(curves, states), ndr, ndr_sd, merit(ndr, resolution(rays)))


def _scene(frame: SceneFrame, design: Design, guide: Waveguide, light: Light) -> StateScene:
    from analysis.optics.scene.outline import outline
    from analysis.optics.sweep.report import laid
    from analysis.optics.tracer.simulation import ray_paths

    shape = outline(frame, design)
    rings = [laid(frame, contour.sampled()) for contour in shape.contours]
    paths = [(p.secondary, laid(frame, p.points)) for p in ray_paths(frame, design, guide, light)]
    released, secondary = (_joined([line for second, line in paths if second is kind]) for kind in (False, True))
    receiver = laid(frame, shape.receiver) if np.isfinite(shape.receiver[0, 0]) else GAP
    return StateScene(_joined([np.concatenate([r, r[:1]]) for r in rings]), released, secondary, receiver)


def _joined(lines: Sequence[FloatArray]) -> FloatArray:
    """Return polylines as one, a NaN between them."""
    return np.concatenate([part for line in lines for part in (line, GAP)]) if lines else GAP


def sweep(
    cavities: tuple[int, ...], rays: int, curves: str = "default", *, progress: Progress | None = None
) -> SweepSummary:
    """Return the sweep of the paper's grid of designs.

    Parameters
    ----------
    cavities : numbers of cavities.
    rays : released in each simulation.
    curves : name of the states, see `curves_of`.
    progress : is called with the designs done and their number.
    """
    from analysis.optics.scene.parameters import PAPER_OPTIMUM, Light
    from analysis.optics.sweep.figure_of_merit import pareto
    from analysis.optics.sweep.sweep import SweepRequest, paper_grid, run_sweep

    request = SweepRequest(designs=tuple(paper_grid(cavities)), light=Light().with_rays(rays), curves=curves_of(curves))
    result = run_sweep(request, progress=progress)
    found = result.merit()
    paper = result.find(PAPER_OPTIMUM)
    values = np.array([d.values[:4] for d in result.designs], dtype=float)
    front = np.asarray(pareto(found.delta, found.rmse, found.n_sign), dtype=bool)
    return SweepSummary(
        values, found, result.uncertainty().tied, front, int(np.argmax(found.p)), -1 if paper is None else paper,
        result.ranks(), result.seconds, result.simulated, rays,
    )  # fmt: skip


def search(curves: str = "default", seconds: float = 50.0, *, progress: Progress | None = None) -> OptimumSummary:
    """Return the best design found beyond the grid, on detected power.

    Parameters
    ----------
    curves : name of the states, see `curves_of`.
    seconds : about how long to search.
    progress : is called with what is done and the total.

    Raises
    ------
    AnalysisError : no design of the grid fits these states, or the curves cannot be read.
    """
    from analysis.optics.scene.parameters import Waveguide
    from analysis.optics.sweep.optimise import optimise

    found = optimise(Waveguide(), curves_of(curves), seconds=seconds, progress=progress)
    best = found.best.design
    values = (best.cavities, best.width_mm, best.depth_mm, best.spacing_mm)
    return OptimumSummary(values, best.face, found.best.p, found.start.p, found.finished)
