"""What accuracy costs: the number of shapes against error, the mesh against error and time, measured here and now.

Strategy: each chart measures its own points on this machine; the default is marked, and the tolerance of who uses the
number is drawn, so the chart shows why the default is what it is.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure

from analysis.arrays import FloatArray
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solver
from analysis.shadow.model.full import FullModel
from analysis.shadow.model.reduced import Progress, ReducedModel, TableSettings
from analysis.shadow.model.table import build_table

DATA, CHOSEN, LIMIT, MUTED = "#0072b2", "#d55e00", "#555f6b", "#555f6b"
SCREEN_TOLERANCE_MM = 0.05
"""A quarter of a pixel of the pane, and a third of the millimetre grid's reading error (0.5 / sqrt(12) = 0.14 mm)."""
MESHES = ((4, 1, 2), (6, 1, 3), (6, 2, 3), (8, 2, 4), (12, 2, 5), (12, 3, 6), (16, 4, 8))
REFERENCE_MESH = (24, 5, 10)


@dataclass(frozen=True, slots=True)
class MeshPoint:
    """One mesh: elements (along a cell, wall, lattice), unknowns, error of tracked points in mm, seconds a solution."""

    elements: tuple[int, int, int]
    unknowns: int
    error_mm: float
    seconds: float


def states_per_second(table: ReducedModel, states: int = 20_000) -> float:
    """Measure how many states a second the table evaluates (tracked points of a batch)."""
    rng = np.random.default_rng(1)
    (p0, p1), (q0, q1) = table.pressure_range_kpa, table.elongation_range_mm
    pressures, elongations = rng.uniform(p0, p1, states), rng.uniform(q0, q1, states)
    table.tracked(pressures[:10], elongations[:10])
    begun = time.perf_counter()
    table.tracked(pressures, elongations)
    return states / (time.perf_counter() - begun)


def solutions_per_second(solver: Solver, solutions: int = 100) -> float:
    """Measure warm-started solutions a second over one slow cycle of -40 .. +50 kPa."""
    state = solver.solve(pressure_kpa=5.0)
    begun = time.perf_counter()
    for k in range(1, solutions + 1):
        state = solver.solve(pressure_kpa=5.0 + 45.0 * float(np.sin(2.0 * np.pi * k / solutions)), start=state)
    return solutions / (time.perf_counter() - begun)


def mesh_points(
    parameters: ActuatorParameters,
    meshes: Sequence[tuple[int, int, int]] = MESHES,
    *,
    reference: tuple[int, int, int] = REFERENCE_MESH,
    progress: Progress | None = None,
) -> list[MeshPoint]:
    """Measure tracked-point error (against a finer mesh, at -40 and +50 kPa) and time of several meshes."""
    truth, _, _ = measured_mesh(parameters, reference, timed=False)
    points = []
    for i, elements in enumerate(meshes, 1):
        tracked, unknowns, seconds = measured_mesh(parameters, elements, timed=True)
        points.append(MeshPoint(elements, unknowns, float(np.linalg.norm(tracked - truth, axis=-1).max()), seconds))
        if progress is not None:
            progress(i, len(meshes))
    return points


def measured_mesh(
    parameters: ActuatorParameters, elements: tuple[int, int, int], *, timed: bool
) -> tuple[FloatArray, int, float]:
    """Return tracked points at both ends of the pressure range, unknowns, and seconds a warm solution."""
    axial, wall, lattice = elements
    model = FullModel(replace(parameters, axial_elements=axial, wall_elements=wall, lattice_elements=lattice))
    tracked = np.array([model.tracked(model.solver.solve(pressure_kpa=p)) for p in (-40.0, 50.0)])
    seconds = 1.0 / solutions_per_second(model.solver) if timed else np.nan
    return tracked, model.problem.size, seconds


def mesh_chart(points: Sequence[MeshPoint], chosen: ActuatorParameters) -> Figure:
    """Draw time a solution against error, one point a mesh."""
    figure = Figure(figsize=(7.0, 4.4), layout="constrained")
    axes = figure.subplots()
    default = (chosen.axial_elements, chosen.wall_elements, chosen.lattice_elements)
    for point in points:
        colour = CHOSEN if point.elements == default else DATA
        axes.loglog(point.error_mm, 1e3 * point.seconds, "o", color=colour, ms=7)
        axes.annotate(
            f"{point.unknowns:,}".replace(",", " "),
            (point.error_mm, 1e3 * point.seconds),
            xytext=(7, 3),
            textcoords="offset points",
            fontsize=8,
            color=MUTED,
        )
    axes.axvline(SCREEN_TOLERANCE_MM, color=LIMIT, lw=1, ls="--")
    axes.axhline(1e3 / 60.0, color=LIMIT, lw=1, ls=":")
    axes.annotate(
        "60 solutions/s",
        (axes.get_xlim()[0], 1e3 / 60.0),
        xytext=(4, 3),
        textcoords="offset points",
        fontsize=8,
        color=MUTED,
    )
    axes.set(
        xlabel="greatest error of a tracked point, mm (dashed: what the screen can show)",
        ylabel="time a warm solution, ms",
        title="Full model: mesh against error (labels: unknowns)",
    )
    axes.grid(True, which="major", color="#e4e7eb", lw=0.6)
    return figure


def basis_chart(parameters: ActuatorParameters) -> Figure:
    """Measure and draw the table's error against the number of shapes, for three sizes of grid."""
    figure = Figure(figsize=(7.0, 4.4), layout="constrained")
    axes = figure.subplots()
    default = TableSettings()
    for side, colour in ((3, "#56b4e9"), (5, "#009e73"), (7, DATA)):
        table = build_table(parameters, replace(default, pressures=side, elongations=side, modes=12))
        modes = np.arange(1, len(table.errors_mm) + 1)
        axes.semilogy(modes, table.errors_mm, "o-", color=colour, ms=4, lw=1, label=f"{side} x {side} solutions")
        if side == default.pressures:
            axes.semilogy(default.modes, table.errors_mm[default.modes - 1], "o", color=CHOSEN, ms=9, label="default")
    axes.axhline(SCREEN_TOLERANCE_MM, color=LIMIT, lw=1, ls="--", label="what the screen can show")
    axes.set(
        xlabel="number of shapes",
        ylabel="greatest error of a tracked point, mm",
        title="Reduced model: shapes against error on states that were held out",
    )
    axes.grid(True, color="#e4e7eb", lw=0.6)
    axes.legend(frameon=False, fontsize=8.5)
    return figure
