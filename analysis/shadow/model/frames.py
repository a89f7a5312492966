"""The digital shadow: from measured pressure and elongation to everything that is drawn.

The reduced model is used inside its rectangle, the full model outside it; the frame names the model. Lengths in mm; z
along the axis from the base, x across.
"""

from __future__ import annotations

import math
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from analysis.progress import Progress
from analysis.shadow.fem.element import deformation_gradients, nodal_stretch
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solution
from analysis.shadow.model.full import FullModel, check_values
from analysis.shadow.model.guides import both_guides
from analysis.shadow.model.reduced import ReducedModel
from analysis.shadow.model.table import load_table
from protocol.base.arrays import FloatArray, IntArray
from protocol.base.errors import ConvergenceError

Model = Literal["full", "reduced"]


@dataclass(frozen=True, slots=True)
class ShadowTopology:
    """The constant part of all frames.

    `outline`, `interface`, `cavity`: node numbers along the envelope with base and tip edge, along the wall's outside,
    and along the bladders' inside: three polylines.
    """

    rest_mm: FloatArray  # shape (n, 2), (x, z) of one half's nodes at rest; the other half is its mirror image, x -> -x
    quads: IntArray  # shape (m, 8), the elements
    triangles: IntArray  # shape (6 m, 3), the elements cut up for drawing with a colour at each node
    material: IntArray  # shape (m,), 0 lattice, 1 wall
    outline: IntArray
    interface: IntArray
    cavity: IntArray
    length_mm: float  # distance between base and tip plate at rest


@dataclass(frozen=True, slots=True)
class ShadowState:
    """One frame."""

    pressure_kpa: float
    elongation_mm: float
    nodes_mm: FloatArray  # shape (n, 2), deformed (x, z) of one half
    displacement_mm: FloatArray  # shape (n,), length of each node's displacement
    strain: FloatArray  # shape (n,), greatest principal stretch minus 1 at each node, dimensionless
    centrelines_mm: FloatArray  # shape (2, k, 2), (x, z) of both guides every 0.5 mm
    tracked_points_mm: FloatArray  # shape (2, 7, 2)
    # nominal_elongation_mm, nominal_sd_mm: x_nom(p) and its standard uncertainty from E; NaN outside the table
    nominal_elongation_mm: float
    nominal_sd_mm: float
    deviation_mm: float
    pressure_residual_kpa: float  # pressure minus p_nom(elongation); NaN outside the table
    tip_force_mn: float  # the force at the plate that the model needs to hold this state, mN
    model: Model
    seconds: float


class Shadow:
    """The shadow of one actuator, with its table from the program, from the cache, or built (about 3 s)."""

    def __init__(
        self,
        parameters: ActuatorParameters | None = None,
        table: ReducedModel | None = None,
        progress: Progress | None = None,
    ) -> None:
        self.parameters = parameters or ActuatorParameters()
        self.table = table or load_table(self.parameters, progress=progress)
        self.model = FullModel(self.parameters)
        self._last: Solution | None = None

    def __repr__(self) -> str:
        (low_kpa, high_kpa), (low_mm, high_mm) = self.table.pressure_range_kpa, self.table.elongation_range_mm
        return f"<Shadow: {low_kpa:.1f} to {high_kpa:.1f} kPa, {low_mm:.1f} to {high_mm:.1f} mm>"

    @cached_property
    def topology(self) -> ShadowTopology:
        mesh = self.model.mesh
        outer = np.isclose(mesh.nodes[:, 0], self.parameters.envelope_radius_mm)
        envelope = np.flatnonzero(outer)[np.argsort(mesh.nodes[outer, 1])]
        wall = np.unique(mesh.quads[mesh.material == 1])
        lattice = np.unique(mesh.quads[mesh.material == 0])
        base = mesh.base[np.argsort(mesh.nodes[mesh.base, 0])]
        tip = mesh.tip[np.argsort(-mesh.nodes[mesh.tip, 0])]
        outline = np.concatenate([base, envelope[1:-1], tip])
        inner = np.intersect1d(wall, lattice), np.unique(mesh.cavity)
        interface, cavity = (nodes[np.argsort(mesh.nodes[nodes, 1])] for nodes in inner)
        surface = mesh.nodes, mesh.quads, triangles(mesh.quads), mesh.material
        return ShadowTopology(*surface, outline, interface, cavity, self.parameters.length_mm)

    def state(
        self, *, elongation_mm: float | None = None, pressure_kpa: float | None = None, model: Model = "reduced"
    ) -> ShadowState:
        """Return the frame at a measured elongation, a measured pressure, or both."""
        begun = time.perf_counter()
        solution, answered = self.solution(elongation_mm=elongation_mm, pressure_kpa=pressure_kpa, model=model)
        return self._frame(solution, answered, begun)

    def solution(
        self, *, elongation_mm: float | None = None, pressure_kpa: float | None = None, model: Model = "reduced"
    ) -> tuple[Solution, Model]:
        """Return the state as nodal displacements, and the model used; arguments and errors as `state`."""
        q, p = self._complete(elongation_mm, pressure_kpa)
        if model == "reduced" and q is not None and p is not None and bool(self.table.holds(np.array(p), np.array(q))):
            u, force = self.table.displacement(p, q)
            return Solution(u, p, q, force, 0, 0.0), "reduced"
        self._last = self._solve_full(elongation_mm, pressure_kpa)
        return self._last, "full"

    def _complete(self, q: float | None, p: float | None) -> tuple[float | None, float | None]:
        """Complete what is not measured from the nominal curve; None outside the table."""
        check_values(p, q)
        if q is None:
            q = float(self.table.nominal_elongation(np.array(p))[0])
        elif p is None:
            p = float(self.table.nominal_pressure(np.array(q)))
        return (q if math.isfinite(q) else None), (p if p is not None and math.isfinite(p) else None)

    def _solve_full(self, q: float | None, p: float | None) -> Solution:
        start = self._last
        if start is not None and p is not None and abs(start.pressure_kpa - p) > 20.0:
            start = None
        if start is not None:
            with suppress(ConvergenceError):  # from the last state, the way may pass the limit of stability
                return self.model.solve(pressure_kpa=p, elongation_mm=q, start=start)
        return self.model.solve(pressure_kpa=p, elongation_mm=q)

    def _frame(self, solution: Solution, model: Model, begun: float) -> ShadowState:
        u, p, q = solution.displacement_mm, solution.pressure_kpa, solution.elongation_mm
        nominal, spread = (float(v) for v in self.table.nominal_elongation(np.array(p)))
        guides = self.model.guides
        return ShadowState(
            pressure_kpa=p,
            elongation_mm=q,
            nodes_mm=self.model.mesh.nodes + u,
            displacement_mm=np.hypot(u[:, 0], u[:, 1]),
            strain=self.strain(u),
            centrelines_mm=both_guides(guides.centreline.positions(u)),
            tracked_points_mm=both_guides(guides.tracked.positions(u)),
            nominal_elongation_mm=nominal,
            nominal_sd_mm=spread,
            deviation_mm=q - nominal,
            pressure_residual_kpa=p - float(self.table.nominal_pressure(np.array(q))),
            tip_force_mn=solution.tip_force_mn,
            model=model,
            seconds=time.perf_counter() - begun,
        )

    def strain(self, displacement_mm: FloatArray) -> FloatArray:
        """Return the greatest principal stretch minus 1 at each node, averaged over its elements' Gauss points."""
        problem = self.model.problem
        quads = problem.elements.quads
        f = deformation_gradients(problem.elements.gradient, displacement_mm, quads)
        return nodal_stretch(f, quads, len(problem.nodes)) - 1.0


def triangles(quads: IntArray) -> IntArray:
    """Cut each eight-node quadrilateral into six triangles over its nodes, shape (6 m, 3)."""
    corners = [(0, 4, 7), (4, 1, 5), (5, 2, 6), (6, 3, 7), (4, 5, 7), (5, 6, 7)]
    return np.concatenate([quads[:, list(c)] for c in corners])
