"""The two waveguides: their centrelines at rest, and their motion with the mesh.

Their points are embedded in the elements that contain them: a deformed centreline is one sparse product with the nodal
displacements. Junctions and end pieces move with the rigid pieces below the base and above the tip plate. z runs from
the base (0) to the tip, x across; guide 1 is at x > 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from analysis.shadow.fem.element import shape
from analysis.shadow.fem.mesh import Mesh
from analysis.shadow.fem.parameters import ActuatorParameters
from protocol.base.arrays import FloatArray, IntArray
from protocol.base.errors import RequestError

SAMPLING_MM = 0.5
TRACKED = 7
_INSIDE = 1.0 + 1e-9


@dataclass(frozen=True, slots=True)
class Embedding:
    """Points that move with a mesh."""

    rest_mm: FloatArray  # shape (n, 2), (r, z) at rest
    weights: sparse.csr_array  # sparse, shape (n, nodes): displacement of each point = weights @ nodal displacements

    def positions(self, displacement_mm: FloatArray) -> FloatArray:
        """Return the deformed (r, z), shape (n, 2), mm."""
        moved: FloatArray = self.rest_mm + self.weights @ displacement_mm
        return moved


@dataclass(frozen=True, slots=True)
class Guides:
    """The centreline at every 0.5 mm and the seven tracked points of a guide."""

    centreline: Embedding
    tracked: Embedding


def rest_centreline(parameters: ActuatorParameters, length_mm: float, points: int | None = None) -> FloatArray:
    """Return a guide at rest, equally spaced along its arc."""
    p = parameters
    half = length_mm / 2.0 + p.guide_end_mm
    s = np.linspace(-1.0, 1.0, 4001)
    curve = np.stack([p.guide_bow_mm * (1.0 - s * s), length_mm / 2.0 + half * s], axis=1)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    count = points or max(TRACKED, round(arc[-1] / SAMPLING_MM) + 1)
    at = np.interp(np.linspace(0.0, arc[-1], count), arc, s)
    return np.stack([p.guide_bow_mm * (1.0 - at * at), length_mm / 2.0 + half * at], axis=1)


def locate(mesh: Mesh, points: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the element of each point, -1 where none contains it, and the shape functions' values there, (n, 8)."""
    corners = mesh.nodes[mesh.quads]
    low, high = corners.min(axis=1), corners.max(axis=1)
    slack = 0.05 * (high - low)
    owner, values = np.full(len(points), -1), np.zeros((len(points), 8))
    near = (points[:, None] >= low - slack) & (points[:, None] <= high + slack)
    point, element = np.nonzero(near.all(axis=2))
    local = invert(corners[element], points[point])
    inside = np.flatnonzero(np.abs(local).max(axis=1, initial=0.0) <= _INSIDE)
    found, first = np.unique(point[inside], return_index=True)
    chosen = inside[first]
    owner[found] = element[chosen]
    values[found] = shape(local[chosen, 0], local[chosen, 1])[0]
    return owner, values


def invert(corners: FloatArray, point: FloatArray) -> FloatArray:
    """Return local coordinates of points (k, 2), or of one, in elements (k, 8, 2); 9 where there are none."""
    local = np.zeros((len(corners), 2))
    for _ in range(12):
        n, n_xi, n_eta = shape(local[:, 0], local[:, 1])
        gap = point - np.einsum("ki,kic->kc", n, corners)
        jacobian = np.stack([np.einsum("ki,kic->kc", d, corners) for d in (n_xi, n_eta)], axis=2)
        jacobian[np.abs(np.linalg.det(jacobian)) < 1e-300] = np.eye(2)
        local = np.clip(local + np.linalg.solve(jacobian, gap[..., None])[..., 0], -3.0, 3.0)
    scale = np.ptp(corners, axis=1).max(axis=1)
    n, _, _ = shape(local[:, 0], local[:, 1])
    missed = np.linalg.norm(point - np.einsum("ki,kic->kc", n, corners), axis=1) > 1e-9 * scale
    local[missed] = 9.0
    return local


def embed(mesh: Mesh, points: FloatArray, length_mm: float) -> Embedding:
    """Tie points (n, 2) to the mesh, or to the rigid pieces beyond base and tip; reject one that leaves the lattice."""
    between = (points[:, 1] > 0.0) & (points[:, 1] < length_mm)
    owner, values = locate(mesh, points[between])
    if (owner < 0).any() or (mesh.material[owner] != 0).any():
        r, z = points[between][(owner < 0) | (mesh.material[owner] != 0)][0]
        cause = f"a guide leaves the lattice at r = {r:.1f} mm, {z:.1f} mm above the base"
        raise RequestError(cause, "change guide_bow_mm or guide_end_mm so that it runs between bladder and envelope")
    inner = np.flatnonzero(between)
    above = np.flatnonzero(points[:, 1] >= length_mm)
    rows = np.concatenate([np.repeat(inner, 8), above])
    columns = np.concatenate([mesh.quads[owner].ravel(), np.full(len(above), mesh.tip[0])])
    entries = np.concatenate([values.ravel(), np.ones(len(above))])
    weights = sparse.csr_array((entries, (rows, columns)), shape=(len(points), len(mesh.nodes)))
    return Embedding(points, weights)


def make_guides(parameters: ActuatorParameters, mesh: Mesh) -> Guides:
    """Embed centreline and tracked points of a guide in a mesh whose base is at 0."""
    length = float(mesh.nodes[mesh.tip, 1].max())
    return Guides(
        embed(mesh, rest_centreline(parameters, length), length),
        embed(mesh, rest_centreline(parameters, length, TRACKED), length),
    )


def both_guides(half_plane: FloatArray) -> FloatArray:
    """Return guide 1 and its mirror image in (x, z), shape (2, n, 2), of points (r, z), shape (n, 2)."""
    return np.stack([half_plane, half_plane * (-1.0, 1.0) + 0.0])
