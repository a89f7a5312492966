"""A boundary-value problem in discrete form: which displacement is which equation, and how forces are assembled.

Freedoms are numbered by reverse Cuthill-McKee so that the tangent is a narrow band. The rigid tip plate is one freedom,
the elongation, shared by the axial displacements of its nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from analysis.shadow.fem import element, pressure
from analysis.shadow.fem.band import empty_band
from analysis.shadow.fem.element import Elements, elements_of
from analysis.shadow.fem.mesh import Mesh
from protocol.base.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Balance:
    """The forces in a state."""

    force: FloatArray  # shape (size,), internal minus pressure force by equation, mN
    area: FloatArray  # shape (size,), dV/du by equation, mm^2: the force of a unit pressure
    scale: float  # the greater norm of internal and pressure forces over all nodes, supports included, mN
    smallest_j: float  # the smallest volume ratio J at any Gauss point; forces are undefined where it is not positive


@dataclass(frozen=True, slots=True)
class Problem:
    """Mesh, moduli, supports and numbering."""

    nodes: FloatArray  # shape (n, 2), reference (r, z), mm
    elements: Elements  # their nodes, moduli and reference gradients
    cavity: IntArray  # shape (k, 3), wetted edges, the solid on the left
    plate_node: int  # a node of the rigid plate, -1 without a plate
    equations: IntArray  # shape (n, 2), the equation of each displacement, -1 where it is prescribed
    plate: int  # the equation of the plate's axial displacement, -1 without a plate
    size: int  # with bandwidth: number of equations and of sub-diagonals
    bandwidth: int

    @property
    def roundoff_mn(self) -> float:
        """Return the force, mN, below which a residual is rounding: 50 ulp of the stiffest stress."""
        area = float(self.elements.weight.sum()) ** (2.0 / 3.0)
        stiffest = float((2.0 / self.elements.moduli[:, 1]).max())
        return 50.0 * float(np.finfo(float).eps) * float(area) * stiffest

    def balance(self, u: FloatArray, pressure_kpa: float) -> Balance:
        """Return the forces in the state of nodal displacements `u`, shape (n, 2), mm."""
        force, area = np.zeros_like(u), np.zeros_like(u)
        smallest = element.internal_force(self.elements, u, force)
        pressure.volume_gradient(self.nodes, u, self.cavity, area)
        load = pressure_kpa * area
        scale = max(float(np.linalg.norm(force)), float(np.linalg.norm(load)))
        return Balance(self.gather(force - load), self.gather(area), scale, float(smallest))

    def potential(self, u: FloatArray, pressure_kpa: float) -> float:
        """Return strain energy minus pressure times cavity volume, mN mm; infinite for inverted elements."""
        strain = element.internal_energy(self.elements, u)
        return float(strain - pressure_kpa * pressure.cavity_volume(self.nodes, u, self.cavity))

    def tangent(self, u: FloatArray, pressure_kpa: float) -> FloatArray:
        """Return the band of the tangent, mN/mm (see band.py)."""
        band = empty_band(self.size, self.bandwidth)
        element.internal_tangent(self.elements, u, self.equations, band)
        pressure.pressure_tangent(self.nodes, u, self.cavity, pressure_kpa, self.equations, band)
        return band

    def plate_displacement(self, u: FloatArray) -> float:
        """Return the rigid plate's axial displacement, mm; 0 without a plate."""
        return float(u[self.plate_node, 1]) if self.plate >= 0 else 0.0

    def gather(self, nodal: FloatArray) -> FloatArray:
        """Sum a nodal vector, shape (n, 2), into equations, shape (size,)."""
        free = self.equations >= 0
        return np.bincount(self.equations[free], nodal[free], self.size).astype(float)

    def spread(self, values: FloatArray) -> FloatArray:
        """Return equation values as a nodal vector, zero where the displacement is prescribed."""
        return np.where(self.equations >= 0, values[self.equations], 0.0)


def make_problem(
    mesh: Mesh, moduli: FloatArray, *, fixed: BoolArray, tied: IntArray | None = None, points_a_side: int = 2
) -> Problem:
    """Set up a problem on a mesh.

    `moduli`: shape (m, 2), C10 in kPa and D1 in 1/kPa. `fixed`: shape (n, 2), True where a displacement is prescribed.
    `tied`: nodes whose axial displacements are one freedom.
    """
    plate_nodes = np.empty(0, dtype=np.int64) if tied is None else tied
    elements = elements_of(mesh.nodes, mesh.quads, moduli, points_a_side)
    plate_node = int(plate_nodes[0]) if len(plate_nodes) else -1
    return Problem(mesh.nodes, elements, mesh.cavity, plate_node, *number_equations(mesh.quads, fixed, plate_nodes))


def number_equations(quads: IntArray, fixed: BoolArray, tied: IntArray) -> tuple[IntArray, int, int, int]:
    """Number the free displacements for a narrow band."""
    raw = np.full(fixed.shape, -1)
    free = ~fixed
    free[tied, 1] = False
    count = int(free.sum())
    raw[free] = np.arange(count)
    if len(tied):
        raw[tied, 1] = count
        count += 1
    groups = raw[quads].reshape(len(quads), 16)
    rows, columns = np.repeat(groups, 16, axis=1).ravel(), np.tile(groups, 16).ravel()
    keep = (rows >= 0) & (columns >= 0)
    graph = sparse.csr_matrix((np.ones(keep.sum(), np.int8), (rows[keep], columns[keep])), (count, count))
    order = sparse.csgraph.reverse_cuthill_mckee(graph, symmetric_mode=True)
    rank = np.empty(count + 1, np.int64)
    rank[order] = np.arange(count)
    rank[count] = -1
    equations = rank[raw]
    plate = int(equations[tied[0], 1]) if len(tied) else -1
    return equations, plate, count, int(np.abs(rank[rows[keep]] - rank[columns[keep]]).max())
