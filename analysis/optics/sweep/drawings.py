"""Figures of scenes and sweeps, for files.

Rules: axes have units; the actuator lies along the page, from the emitter on the left to the receiver on the right,
wherever its axis points in the data.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from analysis import figure_style as style
from analysis.arrays import FloatArray
from analysis.errors import FileError
from analysis.optics.scene.frame import SceneFrame
from analysis.optics.scene.outline import outline
from analysis.optics.scene.parameters import PAPER_OPTIMUM, Design, Light, Waveguide
from analysis.optics.sweep.figure_of_merit import pareto
from analysis.optics.sweep.sweep import STEPS_MM, SweepResult
from analysis.optics.tracer.simulation import ray_paths

BLUE, VERMILLION = style.SENSORS[:2]
RESIN, GREEN = "#E3EDF5", style.PRESSURE
RING: Any = {"markerfacecolor": "none", "markeredgewidth": 1.6}
DPI = 160
_FAINT, _STRONG = 0.01, 0.22
_MOST_DRAWN = 400


def save(figure: Figure, path: Path) -> None:
    """Write a figure in the format of the file's suffix: PNG, SVG or PDF.

    Raises
    ------
    FileError : the folder cannot be written to, or the suffix is unknown.
    """
    try:
        figure.savefig(path, dpi=DPI)
    except OSError as error:
        raise FileError(f"{path} cannot be written: {error.strerror}", "choose another --out") from error
    except ValueError as error:
        raise FileError(f"{path}: its suffix names no picture", "name a file ending in .png, .svg or .pdf") from error


def _figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), layout="constrained")


def laid(frame: SceneFrame, points: FloatArray) -> FloatArray:
    """Return points (n, 2) turned so that the actuator lies along x from the emitter at 0, mm."""
    axis = frame.emitter[2:]
    moved = points - frame.emitter[:2]
    return np.stack([moved @ axis, moved @ np.array([-axis[1], axis[0]])], axis=1)


@style.styled
def draw_scene(frame: SceneFrame, design: Design, guide: Waveguide, light: Light, title: str = "") -> Figure:
    """Draw the resin, the emitter, the receiver and the rays of one design in one state.

    Parameters
    ----------
    frame, design, guide, light : as in `simulation.trace`. title : of the figure.
    """
    figure = _figure(9.0, 3.9)
    axes = figure.add_subplot()
    shape = outline(frame, design)
    rings = [laid(frame, contour.sampled()) for contour in shape.contours]
    codes = np.concatenate([[Outline.MOVETO, *[Outline.LINETO] * (len(r) - 1), Outline.CLOSEPOLY] for r in rings])
    ring = np.concatenate([np.concatenate([r, r[:1]]) for r in _opposed(rings)])
    axes.add_patch(PathPatch(Outline(ring, codes), facecolor=RESIN, edgecolor=style.SOFT, linewidth=0.6))
    paths = ray_paths(frame, design, guide, light)
    for secondary, colour in ((False, BLUE), (True, VERMILLION)):
        chosen = [p for p in paths if p.secondary == secondary]
        step = max(1, len(chosen) // _MOST_DRAWN)
        lines = [laid(frame, p.points) for p in chosen[::step]]
        strength = [min(_STRONG, max(_FAINT, _STRONG * float(p.power[-1]))) for p in chosen[::step]]
        axes.add_collection(LineCollection(lines, colors=colour, linewidths=0.4, alpha=strength))
    if np.isfinite(shape.receiver[0, 0]):
        axes.plot(*laid(frame, shape.receiver).T, color=GREEN, linewidth=3.0, solid_capstyle="butt", label="receiver")
    axes.plot([0], [0], "o", color=style.ELONGATION, markersize=4, label="emitter")
    axes.plot([], [], color=BLUE, linewidth=1, label="released")
    axes.plot([], [], color=VERMILLION, linewidth=1, label="secondary")
    axes.set_aspect("equal")
    axes.margins(0.02, 0.06)
    axes.set(xlabel="along the actuator, mm", ylabel="across, mm", title=title)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def _opposed(rings: Sequence[FloatArray]) -> list[FloatArray]:
    """Return the outside turning left and the holes turning right, so that holes stay empty."""
    out = []
    for number, ring in enumerate(rings):
        x, y = ring.T
        left = np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0
        out.append(ring if left == (number == 0) else ring[::-1])
    return out


@style.styled
def draw_response(result: SweepResult, chosen: Sequence[Design]) -> Figure:
    """Draw NDR with its standard deviation, and aNDR, over the states, as in the paper's figure 3B."""
    figure = _figure(5.6, 3.6)
    axes = figure.add_subplot()
    merit, states = result.merit(), np.arange(result.ndr.shape[1])
    for design, colour in zip(chosen, (BLUE, VERMILLION), strict=False):
        i = result.designs.index(design)
        name = (
            f"{design.cavities} x {design.width_mm:g} x {design.depth_mm:g}, spacing {design.spacing_mm:g} mm: "
            f"P {merit.p[i]:.2f}"
        )
        axes.errorbar(
            states, result.ndr[i], yerr=result.ndr_sd[i], fmt="o", markersize=3.5, linewidth=0.7, color=colour
        )
        axes.plot(states, merit.andr[i], color=colour, label=name)
    axes.set(xlabel=f"state: 0 most compressed to {len(states) - 1} most elongated", ylabel="detected rays of 250")
    axes.legend()
    return figure


def p_grid(result: SweepResult, cavities: int, width_mm: float) -> FloatArray:
    """Return P over the sweep's maximum, (6 depths, 6 spacings); NaN where a design was not simulated.

    Parameters
    ----------
    result : of the sweep. cavities, width_mm : of the designs shown.
    """
    p = result.merit().p_normalised
    out = np.full((len(STEPS_MM), len(STEPS_MM)), np.nan)
    for i, design in enumerate(result.designs):
        if design.cavities == cavities and design.width_mm == width_mm:
            out[STEPS_MM.index(design.depth_mm), STEPS_MM.index(design.spacing_mm)] = p[i]
    return out


@style.styled
def draw_maps(result: SweepResult, cavities: int) -> Figure:
    """Draw P over depth and spacing for each width, as in the paper's figure 3D, with both optima marked."""
    figure = _figure(9.0, 5.6)
    best = result.designs[int(np.argmax(result.merit().p))]
    grid = figure.subplots(2, 3, sharex=True, sharey=True)
    image = None
    for axes, width in zip(grid.flat, STEPS_MM, strict=True):
        image = axes.imshow(p_grid(result, cavities, width), origin="lower", cmap="viridis", vmin=0.0, vmax=1.0)
        axes.set(title=f"width {width:g} mm")
        axes.grid(visible=False)
        axes.set_xticks(range(6), [f"{s:g}" for s in STEPS_MM])
        axes.set_yticks(range(6), [f"{s:g}" for s in STEPS_MM])
        for design, mark in ((best, "*"), (PAPER_OPTIMUM, "o")):
            if (design.cavities, design.width_mm) == (cavities, width):
                place = STEPS_MM.index(design.spacing_mm), STEPS_MM.index(design.depth_mm)
                axes.plot(*place, mark, markersize=11, markeredgecolor="white", **RING)
    if image is not None:
        figure.colorbar(image, ax=grid, shrink=0.8).set_label("P / largest P of the sweep")
    figure.supxlabel("spacing, mm")
    figure.supylabel("depth, mm")
    figure.suptitle(f"{cavities} cavities   (star: our best, circle: the paper's optimum)")
    return figure


@style.styled
def draw_pareto(result: SweepResult) -> Figure:
    """Draw Delta against RMSE, n_sign as colour; the Pareto front is ringed, both optima are named."""
    figure = _figure(5.6, 4.2)
    axes = figure.add_subplot()
    merit = result.merit()
    front = pareto(merit.delta, merit.rmse, merit.n_sign)
    dots = axes.scatter(merit.rmse, merit.delta, c=merit.n_sign, cmap="viridis", s=14, linewidths=0)
    rings: Any = {"facecolors": "none", "edgecolors": style.INK, "linewidths": 0.8}
    axes.scatter(merit.rmse[front], merit.delta[front], s=46, label="Pareto-optimal", **rings)
    for i, name, colour in ((int(np.argmax(merit.p)), "our best", BLUE), (result.find(), "paper's", VERMILLION)):
        if i is not None:
            axes.plot(merit.rmse[i], merit.delta[i], "D", markersize=8, markeredgecolor=colour, label=name, **RING)
    figure.colorbar(dots).set_label("n_sign: steps in which NDR rises")
    axes.set(xlabel="RMSE about aNDR, rays of 250", ylabel="Delta, rays of 250")
    axes.legend()
    return figure
