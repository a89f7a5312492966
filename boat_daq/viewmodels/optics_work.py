"""What the optics page has computed for it, in a process of its own: one design in all states, and the sweep."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.optics.curves import default_curves, elongations, frames_of
from analysis.optics.figure_of_merit import merit, pareto, resolution
from analysis.optics.figures import laid
from analysis.optics.frame import Frame
from analysis.optics.parameters import PAPER_OPTIMUM, Design, Light, Waveguide
from analysis.optics.scene import outline
from analysis.optics.simulation import ray_paths, trace
from analysis.optics.sweep import SweepRequest, paper_grid, run_sweep
from boat_daq.viewmodels.optics_results import DesignResult, StateScene, SweepSummary

Array = NDArray[np.float64]
Progress = Callable[[float, float], None]
GAP = np.full((1, 2), np.nan)


def trace_design(
    values: tuple[int, float, float, float], rays: int, *, progress: Progress | None = None
) -> DesignResult:
    """Return a design's rays, NDR and power in every state.

    Parameters
    ----------
    values : cavities, width, depth, spacing (mm).

    Raises
    ------
    AnalysisError : the design does not fit.
    """
    design, guide, light = Design(*values), Waveguide(), Light(rays=rays)
    frames = frames_of(default_curves(), guide)
    scenes, outcomes = [], []
    for done, frame in enumerate(frames):
        scenes.append(_scene(frame, design, guide, light))
        outcomes.append(trace(frame, design, guide, light))
        if progress is not None:
            progress(done + 1, len(frames))
    ndr = np.array([outcome.ndr for outcome in outcomes])
    found = merit(ndr, float(resolution(rays)))
    return DesignResult(
        values, tuple(scenes), np.asarray(elongations()), ndr, np.array([o.ndr_sd for o in outcomes]),
        np.asarray(found.andr), np.array([o.power for o in outcomes]), float(found.p), float(found.delta),
        int(found.n_sign), float(found.rmse),
    )  # fmt: skip


def _scene(frame: Frame, design: Design, guide: Waveguide, light: Light) -> StateScene:
    shape = outline(frame, design)
    rings = [laid(frame, loop.sampled()) for loop in shape.loops]
    paths = ray_paths(frame, design, guide, light)
    released = [laid(frame, p.points) for p in paths if not p.secondary]
    secondary = [laid(frame, p.points) for p in paths if p.secondary]
    receiver = laid(frame, shape.receiver) if np.isfinite(shape.receiver[0, 0]) else GAP
    return StateScene(
        _joined([np.concatenate([r, r[:1]]) for r in rings]), _joined(released), _joined(secondary), receiver
    )


def _joined(lines: Sequence[Array]) -> Array:
    """Return polylines as one, a NaN between them."""
    return np.concatenate([part for line in lines for part in (line, GAP)]) if lines else GAP


def sweep(cavities: tuple[int, ...], rays: int, *, progress: Progress | None = None) -> SweepSummary:
    """Sweep the paper's grid; return what the page draws."""
    request = SweepRequest(designs=tuple(paper_grid(cavities)), light=Light(rays=rays))
    result = run_sweep(request, progress=progress)
    found = result.merit()
    paper = result.find(PAPER_OPTIMUM)
    values = np.array([d.values[:4] for d in result.designs], dtype=float)
    return SweepSummary(
        values, np.asarray(found.p_normalised), np.asarray(found.delta), np.asarray(found.rmse),
        np.asarray(found.n_sign),
        np.asarray(result.uncertainty().tied, dtype=bool),
        np.asarray(pareto(found.delta, found.rmse, found.n_sign), dtype=bool),
        int(np.argmax(found.p)), -1 if paper is None else paper, np.asarray(result.ranks()), result.seconds,
        result.simulated, result.hits, rays,
    )  # fmt: skip
