"""The eight-node axisymmetric quadrilateral with 2 x 2 Gauss points (CAX8R): compiled loops over the elements.

Nodes run anticlockwise in the (r, z) half plane, corners first, then the midside after each corner. Energies and forces
are of the whole circle (2 pi), in mN mm and mN, because kPa mm^2 = mN.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from analysis.compiled import compiled, inside
from analysis.shadow.fem import material
from analysis.shadow.fem.band import add_to_band
from protocol.base.arrays import FloatArray, IntArray

NODE_XI = np.array([-1.0, 1.0, 1.0, -1.0, 0.0, 1.0, 0.0, -1.0])
NODE_ETA = np.array([-1.0, -1.0, 1.0, 1.0, -1.0, 0.0, 1.0, 0.0])
EDGES = np.array([[0, 4, 1], [1, 5, 2], [2, 6, 3], [3, 7, 0]])
"""Local nodes of each edge: start, middle, end, anticlockwise."""
_GAUSS = np.array([-1.0, 1.0])
EXTRAPOLATION = np.stack(
    [(1 + np.sqrt(3.0) * x * NODE_XI) * (1 + np.sqrt(3.0) * y * NODE_ETA) / 4.0 for y in _GAUSS for x in _GAUSS],
    axis=1,
)
"""Bilinear weights of the 2 x 2 Gauss points at the eight nodes, shape (8, 4)."""


def shape(xi: FloatArray, eta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the serendipity shape functions and their derivatives at local points.

    `xi`, `eta`: shape (n,), local coordinates in -1 .. 1.
    Returns values, d/dxi, d/deta: each of shape (n, 8).
    """
    xi, eta = np.atleast_1d(xi)[:, None], np.atleast_1d(eta)[:, None]
    corner_xi, corner_eta = NODE_XI[:4], NODE_ETA[:4]
    sx, sy = xi * corner_xi, eta * corner_eta
    corner = 0.25 * (1 + sx) * (1 + sy) * (sx + sy - 1)
    corner_x = 0.25 * corner_xi * (1 + sy) * (2 * sx + sy)
    corner_y = 0.25 * corner_eta * (1 + sx) * (sx + 2 * sy)
    bubble_x, bubble_y = 1 - xi**2, 1 - eta**2
    middle = np.hstack([bubble_x * (1 - eta), bubble_y * (1 + xi), bubble_x * (1 + eta), bubble_y * (1 - xi)]) / 2
    middle_x = np.hstack([-xi * (1 - eta), bubble_y / 2, -xi * (1 + eta), -bubble_y / 2])
    middle_y = np.hstack([-bubble_x / 2, -eta * (1 + xi), bubble_x / 2, -eta * (1 - xi)])
    return np.hstack([corner, middle]), np.hstack([corner_x, middle_x]), np.hstack([corner_y, middle_y])


class Elements(NamedTuple):
    """The elements of a mesh with their moduli, and the reference gradients at their Gauss points."""

    quads: IntArray  # shape (m, 8), nodes of each element
    moduli: FloatArray  # shape (m, 2), C10 in kPa and D1 in 1/kPa of each
    gradient: FloatArray  # shape (m, points, 3, 8), dN/dr, dN/dz and N/R
    weight: FloatArray  # shape (m, points), the reference volume 2 pi R det(J) w of each point, mm^3


def elements_of(nodes: FloatArray, quads: IntArray, moduli: FloatArray, points_a_side: int = 2) -> Elements:
    """Evaluate the gradients at 2 (reduced) or 3 points a side; det(J) < 0 is left to `mesh.check_quality`."""
    x, w = np.polynomial.legendre.leggauss(points_a_side)
    xi, eta = (a.ravel() for a in np.meshgrid(x, x))
    n, n_xi, n_eta = shape(xi, eta)
    corners = nodes[quads]  # (m, 8, 2)
    d_xi = np.einsum("gi,mic->mgc", n_xi, corners)
    d_eta = np.einsum("gi,mic->mgc", n_eta, corners)
    det = d_xi[..., 0] * d_eta[..., 1] - d_xi[..., 1] * d_eta[..., 0]
    safe = np.where(det == 0.0, np.finfo(float).tiny, det)[..., None]
    grad_r = (d_eta[..., 1:2] * n_xi - d_xi[..., 1:2] * n_eta) / safe
    grad_z = (d_xi[..., 0:1] * n_eta - d_eta[..., 0:1] * n_xi) / safe
    radius = np.einsum("gi,mi->mg", n, corners[..., 0])
    hoop = n[None] / np.where(radius == 0.0, np.finfo(float).tiny, radius)[..., None]
    gradient = np.ascontiguousarray(np.stack([grad_r, grad_z, hoop], axis=2))
    return Elements(quads, moduli, gradient, 2.0 * np.pi * radius * det * np.outer(w, w).ravel())


@inside
def clear(matrix: FloatArray) -> None:
    """Set a matrix to zero, as `matrix[:] = 0.0` does, which takes numba long to compile."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            matrix[i, j] = 0.0


@inside
def deformation_gradient(gradient: FloatArray, u: FloatArray, quad: IntArray, f: FloatArray) -> None:
    """Write the five entries of F at one point into `f`."""
    f[0], f[1], f[2], f[3], f[4] = 1.0, 0.0, 0.0, 1.0, 1.0
    for a in range(8):
        ur, uz = u[quad[a], 0], u[quad[a], 1]
        f[0] += gradient[0, a] * ur
        f[1] += gradient[1, a] * ur
        f[2] += gradient[0, a] * uz
        f[3] += gradient[1, a] * uz
        f[4] += gradient[2, a] * ur


@compiled
def deformation_gradients(gradient: FloatArray, u: FloatArray, quads: IntArray) -> FloatArray:
    """Return F at every Gauss point, shape (elements, points, 5)."""
    f = np.empty((gradient.shape[0], gradient.shape[1], 5))
    for e in range(gradient.shape[0]):
        for g in range(gradient.shape[1]):
            deformation_gradient(gradient[e, g], u, quads[e], f[e, g])
    return f


@compiled
def internal_energy(elements: Elements, u: FloatArray) -> float:
    """Return the strain energy, mN mm, of displacements `u`, (n, 2), mm; infinite where an element is inverted."""
    quads, moduli, gradient, weight = elements
    f = np.empty(5)
    total = 0.0
    for e in range(gradient.shape[0]):
        for g in range(gradient.shape[1]):
            deformation_gradient(gradient[e, g], u, quads[e], f)
            if not material.determinant(f) > 0.0:
                return np.inf
            total += weight[e, g] * material.energy(f, moduli[e, 0], moduli[e, 1])
    return total


@compiled
def internal_force(elements: Elements, u: FloatArray, force: FloatArray) -> float:
    """Add dW/du to `force`; return the smallest J (stop at the first J <= 0)."""
    quads, moduli, gradient, weight = elements
    f, p = np.empty(5), np.empty(5)
    smallest = np.inf
    for e in range(gradient.shape[0]):
        for g in range(gradient.shape[1]):
            grad = gradient[e, g]
            deformation_gradient(grad, u, quads[e], f)
            smallest = min(smallest, material.determinant(f))
            if not smallest > 0.0:
                return smallest
            material.stress(f, moduli[e, 0], moduli[e, 1], p)
            w = weight[e, g]
            for a in range(8):
                n = quads[e, a]
                force[n, 0] += w * (grad[0, a] * p[0] + grad[1, a] * p[1] + grad[2, a] * p[4])
                force[n, 1] += w * (grad[0, a] * p[2] + grad[1, a] * p[3])
    return smallest


@compiled
def internal_tangent(elements: Elements, u: FloatArray, equations: IntArray, band: FloatArray) -> None:
    """Add d2W/du2, mN/mm, to the band; `equations` [n, 2] are -1 where a displacement is prescribed."""
    quads, moduli, gradient, weight = elements
    f, c = np.empty(5), np.empty((5, 5))
    cb = np.empty((2, 5))
    ke = np.empty((16, 16))
    for e in range(gradient.shape[0]):
        clear(ke)
        for g in range(gradient.shape[1]):
            grad = gradient[e, g]
            deformation_gradient(grad, u, quads[e], f)
            material.tangent(f, moduli[e, 0], moduli[e, 1], c)
            w = weight[e, g]
            for b in range(8):
                for k in range(5):
                    cb[0, k] = w * (c[k, 0] * grad[0, b] + c[k, 1] * grad[1, b] + c[k, 4] * grad[2, b])
                    cb[1, k] = w * (c[k, 2] * grad[0, b] + c[k, 3] * grad[1, b])
                for a in range(b, 8):
                    for j in range(2):
                        ke[2 * a, 2 * b + j] += grad[0, a] * cb[j, 0] + grad[1, a] * cb[j, 1] + grad[2, a] * cb[j, 4]
                        ke[2 * a + 1, 2 * b + j] += grad[0, a] * cb[j, 2] + grad[1, a] * cb[j, 3]
        scatter(ke, quads[e], equations, band)


@inside
def scatter(ke: FloatArray, quad: IntArray, equations: IntArray, band: FloatArray) -> None:
    """Add an element matrix, given by its blocks a >= b, to the band; a pair of tied freedoms counts twice."""
    for a in range(8):
        for b in range(a + 1):
            for i in range(2):
                row = equations[quad[a], i]
                for j in range(2):
                    column = equations[quad[b], j]
                    if row < 0 or column < 0:
                        continue
                    value = ke[2 * a + i, 2 * b + j]
                    if a != b:
                        add_to_band(band, max(row, column), min(row, column), value if row != column else 2.0 * value)
                    else:
                        add_to_band(band, row, column, value)


@compiled
def nodal_stretch(f: FloatArray, quads: IntArray, nodes: int) -> FloatArray:
    """Extrapolate the greatest principal stretch from 2 x 2 Gauss points to the nodes and average, shape (nodes,)."""
    total, seen, at = np.zeros(nodes), np.zeros(nodes), np.empty(f.shape[1])
    for e in range(f.shape[0]):
        for g in range(f.shape[1]):
            rr, rz, zr, zz, tt = f[e, g]
            a, b, c = rr * rr + zr * zr, rz * rz + zz * zz, rr * rz + zr * zz
            plane = 0.5 * (a + b) + np.sqrt(0.25 * (a - b) ** 2 + c * c)
            at[g] = max(np.sqrt(plane), abs(tt))
        for i in range(8):
            total[quads[e, i]] += np.dot(EXTRAPOLATION[i], at)
            seen[quads[e, i]] += 1.0
    return total / np.maximum(seen, 1.0)
