"""Meshes of the half plane r >= 0: eight-node quadrilaterals with named parts, and their quality.

The actuator is a map of a rectangle: along it the row of bladders, across it wall and lattice. Nodes in the middle of
an edge lie on the bladder's curve itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.shadow.fem.element import EDGES, shape
from analysis.shadow.fem.parameters import ActuatorParameters
from protocol.base.arrays import BoolArray, FloatArray, IntArray
from protocol.base.errors import RequestError

LATTICE, WALL = 0, 1
WORST_SCALED_JACOBIAN = 0.05
_QUAD_STEPS = ((0, 0), (0, 2), (2, 2), (2, 0), (0, 1), (1, 2), (2, 1), (1, 0))  # (z, r) half steps of the 8 nodes


@dataclass(frozen=True, slots=True)
class Mesh:
    """A mesh and its parts."""

    nodes: FloatArray  # shape (n, 2), reference (r, z), mm
    quads: IntArray  # shape (m, 8), corners anticlockwise, then the midside after each corner
    material: IntArray  # shape (m,), LATTICE or WALL
    cavity: IntArray  # shape (k, 3), nodes of the wetted edges (start, middle, end), the solid on the left
    base: IntArray  # with tip: node numbers on the fixed base and on the rigid tip plate
    tip: IntArray


def bladder_radius(parameters: ActuatorParameters, z_mm: FloatArray) -> FloatArray:
    """Return the inner radius of the bladders at rest, mm: a cosine between neck and belly with the pitch's period."""
    p = parameters
    middle, swing = (p.belly_radius_mm + p.neck_radius_mm) / 2, (p.belly_radius_mm - p.neck_radius_mm) / 2
    return middle - swing * np.cos(2.0 * np.pi * np.asarray(z_mm) / p.pitch_mm)


def stations(parameters: ActuatorParameters) -> FloatArray:
    """Return positions of nodes across wall (0 .. 1) and lattice (1 .. 2), (2 (wall + lattice elements) + 1,)."""
    p = parameters
    widths = p.grading ** (np.arange(p.lattice_elements) / max(p.lattice_elements - 1, 1))
    ends = np.concatenate([[0.0], np.cumsum(widths)]) / widths.sum()
    lattice = np.sort(np.concatenate([ends, (ends[1:] + ends[:-1]) / 2.0]))
    return np.concatenate([np.linspace(0.0, 1.0, 2 * p.wall_elements + 1), 1.0 + lattice[1:]])


def structured_quads(rows: int, columns: int) -> tuple[IntArray, BoolArray, IntArray]:
    """Number a lattice of rows x columns elements, row by row.

    Returns quads (rows columns, 8); (2 rows + 1, 2 columns + 1) which half steps are nodes; the column of each element.
    """
    used = np.ones((2 * rows + 1, 2 * columns + 1), dtype=bool)
    used[1::2, 1::2] = False  # the serendipity element has no node in its middle
    number = np.full(used.shape, -1)
    number[used] = np.arange(used.sum())
    row, column = (a.ravel() for a in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
    quads = np.stack([number[2 * row + a, 2 * column + b] for a, b in _QUAD_STEPS], axis=1)
    return quads, used, column


def build_mesh(parameters: ActuatorParameters) -> Mesh:
    """Mesh the actuator. Returns the mesh, with base at z = 0 and tip at z = length."""
    p = parameters
    across = stations(p)
    z = np.linspace(0.0, p.length_mm, 2 * p.cells * p.axial_elements + 1)
    inner = bladder_radius(p, z)[:, None]
    outer = inner + p.wall_mm
    r = np.where(across <= 1.0, inner + across * p.wall_mm, outer + (across - 1.0) * (p.envelope_radius_mm - outer))
    quads, used, column = structured_quads(len(z) // 2, len(across) // 2)
    mesh = Mesh(
        nodes=np.stack([r, np.broadcast_to(z[:, None], r.shape)], axis=2)[used],
        quads=quads,
        material=np.where(column < p.wall_elements, WALL, LATTICE),
        cavity=quads[column == 0][:, EDGES[3]],
        base=np.arange(used[0].sum()),
        tip=np.arange(used.sum() - used[-1].sum(), used.sum()),
    )
    check_quality(mesh)
    return mesh


def scaled_jacobian(mesh: Mesh) -> float:
    """Return the least min det(J) / mean |det(J)| of the elements: 1 for parallelograms, 0 where the map folds."""
    xi, eta = (a.ravel() for a in np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]))
    _, n_xi, n_eta = shape(xi, eta)
    corners = mesh.nodes[mesh.quads]
    d_xi, d_eta = (np.einsum("gi,mic->mgc", n, corners) for n in (n_xi, n_eta))
    det = d_xi[..., 0] * d_eta[..., 1] - d_xi[..., 1] * d_eta[..., 0]
    mean = np.abs(det).mean(axis=1)
    return float(np.divide(det.min(axis=1), mean, out=np.full(len(det), -1.0), where=mean > 0).min())


def check_quality(mesh: Mesh) -> None:
    """Reject a mesh that cannot be used."""
    if not np.isfinite(mesh.nodes).all():
        raise RequestError("the mesh has a node that is not a number", "repair the mesh file")
    if mesh.nodes[:, 0].min() < -1e-9:
        cause = f"the mesh reaches r = {mesh.nodes[:, 0].min():.3g} mm, beyond the axis"
        raise RequestError(cause, "put the axis of the actuator at r = 0 and the mesh at r >= 0")
    found = scaled_jacobian(mesh)
    if found < WORST_SCALED_JACOBIAN:
        remedy = "choose more elements along a cell, or a shallower bladder"
        raise RequestError(f"no mesh can be built: an element is folded (scaled Jacobian {found:.2g})", remedy)
