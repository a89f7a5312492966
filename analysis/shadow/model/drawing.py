"""Figures of the shadow: one frame lengthwise, and the error of the reduced model against its number of shapes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from analysis import figure_style as style
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.frames import ShadowState, ShadowTopology
from analysis.shadow.model.reduced import TableSettings
from analysis.shadow.model.table import build_table

Colour = Literal["displacement", "strain"]
SCREEN_TOLERANCE_MM = 0.05
"""A quarter of a pixel of the pane, and a third of the millimetre grid's reading error (0.5 / sqrt(12) = 0.14 mm)."""


@style.styled
def shadow_figure(state: ShadowState, topology: ShadowTopology, colour: Colour = "displacement") -> Figure:
    """Draw one frame. `colour`: displacement in mm, or greatest principal strain in %."""
    figure = Figure(figsize=(9.0, 5.2), layout="constrained")
    axes = figure.subplots()
    values, title = (
        (state.displacement_mm, "displacement, mm")
        if colour == "displacement"
        else (100.0 * state.strain, "greatest principal strain, %")
    )
    scale: Any = {"cmap": "viridis", "vmin": min(0.0, float(values.min())), "vmax": max(float(values.max()), 1e-6)}
    shown = None
    for sign in (1.0, -1.0):
        x, z = sign * state.nodes_mm[:, 0], state.nodes_mm[:, 1]
        shown = axes.tripcolor(Triangulation(z, x, topology.triangles), values, shading="gouraud", **scale)
        for line in (topology.outline, topology.cavity):
            rest = topology.rest_mm[line]
            axes.plot(rest[:, 1], sign * rest[:, 0], color=style.SOFT, lw=0.8, ls=(0, (4, 3)))
        for line in (topology.outline, topology.cavity, topology.interface):
            axes.plot(z[line], x[line], color=style.INK, lw=0.7)
    draw_guides(axes, state)
    draw_tips(axes, state, topology)
    if shown is not None:
        figure.colorbar(shown, ax=axes, shrink=0.75, pad=0.02).set_label(title)
    axes.set(xlabel="along the actuator (z), mm", ylabel="across (x), mm", aspect="equal")
    axes.set_title(headline(state))
    axes.grid(visible=False)
    figure.legend(loc="outside lower center", ncols=5)
    return figure


def headline(state: ShadowState) -> str:
    """Return the frame's numbers in one line."""
    text = f"{state.pressure_kpa:+z.1f} kPa    elongation {state.elongation_mm:+z.2f} mm"
    if np.isfinite(state.deviation_mm):
        text += (
            f"    nominal {state.nominal_elongation_mm:+z.2f} ± {2 * state.nominal_sd_mm:.2f} mm (k = 2)"
            f"    deviation {state.deviation_mm:+z.2f} mm"
        )
    return text + f"    {state.model} model"


def draw_guides(axes: Axes, state: ShadowState) -> None:
    """Draw both centrelines with their tracked points."""
    for i, colour in enumerate(style.SENSOR_COLOURS[:2]):
        line, dots = state.centrelines_mm[i], state.tracked_points_mm[i]
        axes.plot(line[:, 1], line[:, 0], color="white", lw=3.4)
        axes.plot(line[:, 1], line[:, 0], color=colour, lw=1.8, label=f"guide {i + 1}")
        axes.plot(dots[:, 1], dots[:, 0], "o", color=colour, mec="white", mew=0.8, ms=5.5)


def draw_tips(axes: Axes, state: ShadowState, topology: ShadowTopology) -> None:
    """Draw the measured tip plate as a line and the nominal one with its band (k = 2)."""
    top = 1.08 * float(state.nodes_mm[:, 0].max())
    measured = topology.length_mm + state.elongation_mm
    axes.plot([measured, measured], [-top, top], color=style.ELONGATION_COLOUR, lw=2.0, label="measured tip")
    if np.isfinite(state.nominal_elongation_mm):
        nominal, half = topology.length_mm + state.nominal_elongation_mm, 2 * state.nominal_sd_mm
        axes.plot([nominal, nominal], [-top, top], color=style.INK, lw=1.0, ls="--", label="nominal tip")
        axes.axvspan(nominal - half, nominal + half, color=style.INK, alpha=0.12, lw=0, label="its band from E, k = 2")


@style.styled
def table_errors_figure(parameters: ActuatorParameters) -> Figure:
    """Build tables on three sizes of grid; draw their error against the number of shapes."""
    figure = Figure(figsize=(7.0, 4.4), layout="constrained")
    axes = figure.subplots()
    default = TableSettings()
    for side, colour in zip((3, 5, 7), ("#56B4E9", style.PRESSURE_COLOUR, style.SENSOR_COLOURS[0]), strict=True):
        table = build_table(parameters, replace(default, pressures=side, elongations=side, modes=12))
        modes = np.arange(1, len(table.errors_mm) + 1)
        axes.semilogy(modes, table.errors_mm, "o-", color=colour, ms=4, lw=1, label=f"{side} x {side} solutions")
        if side == default.pressures:
            error = table.errors_mm[default.modes - 1]
            axes.semilogy(default.modes, error, "o", color=style.SENSOR_COLOURS[1], ms=9, label="default")
    axes.axhline(SCREEN_TOLERANCE_MM, color=style.SOFT, lw=1, ls="--", label="visible on the screen")
    axes.set(xlabel="number of shapes", ylabel="greatest error of a tracked point, mm")
    axes.set_title("Reduced model: shapes against error on held-out states")
    axes.legend()
    return figure
