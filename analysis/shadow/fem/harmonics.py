"""Buckling around the circle: the tangent of an axisymmetric state for displacements that are not axisymmetric.

The gradient of a displacement (a cos n t, b sin n t, c cos n t) in (r, t, z) falls into two groups that do not couple:
rr, rz, zr, zz, tt with `material.tangent`, and rt, zt, tr, tz with dP = a dF + (a I1/3 - b) G dF^T G. Base and tip are
clamped for n >= 1. Integrals over the circle give pi: K_n is comparable only with itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.compiled import compiled, inside
from analysis.shadow.fem import material
from analysis.shadow.fem.band import empty_band
from analysis.shadow.fem.element import Elements, clear, deformation_gradient
from analysis.shadow.fem.pressure import DERIVATIVES, VALUES, WEIGHTS, edge_point
from analysis.shadow.fem.problem import Problem
from protocol.base.arrays import BoolArray, FloatArray, IntArray


@compiled
def harmonic_tangent(elements: Elements, u: FloatArray, n: int, equations: IntArray, band: FloatArray) -> None:
    """Add the solid's part of K_n to the lower band. `equations`: shape (nodes, 3) for r, t, z, -1 where clamped."""
    quads, moduli, gradient, weight = elements
    f, g, c = np.empty(5), np.empty(5), np.empty((5, 5))
    even, odd, shear = np.zeros((5, 24)), np.zeros((4, 24)), np.zeros((4, 4))
    ke = np.empty((24, 24))
    for e in range(gradient.shape[0]):
        clear(ke)
        for q in range(gradient.shape[1]):
            grad = gradient[e, q]
            deformation_gradient(grad, u, quads[e], f)
            material.tangent(f, moduli[e, 0], moduli[e, 1], c)
            shear_tangent(f, g, moduli[e], shear)
            for i in range(8):
                even[0, 3 * i] = even[2, 3 * i + 2] = grad[0, i]
                even[1, 3 * i] = even[3, 3 * i + 2] = grad[1, i]
                even[4, 3 * i], even[4, 3 * i + 1] = grad[2, i], n * grad[2, i]
                odd[0, 3 * i], odd[0, 3 * i + 1] = -n * grad[2, i], -grad[2, i]
                odd[1, 3 * i + 2] = -n * grad[2, i]
                odd[2, 3 * i + 1], odd[3, 3 * i + 1] = grad[0, i], grad[1, i]
            w = 0.5 * weight[e, q]
            ke += w * (even.T @ (c @ even) + odd.T @ (shear @ odd))
        scatter_block(ke, quads[e], equations, band)


@inside
def shear_tangent(f: FloatArray, g: FloatArray, moduli: FloatArray, c: FloatArray) -> None:
    """Write dP/dF of the group rt, zt, tr, tz into the symmetric `c`.

    `f`, `g`: shape (5,), F, and scratch. `moduli`: C10 in kPa and D1 in 1/kPa. `c`: shape (4, 4), kPa.
    """
    j = material.inverse_transpose(f, g)
    i1 = f[0] ** 2 + f[1] ** 2 + f[2] ** 2 + f[3] ** 2 + f[4] ** 2
    a = 2.0 * moduli[0] * j ** (-2.0 / 3.0)
    ex = (a * i1 / 3.0 - 2.0 / moduli[1] * (j * j - j)) * g[4]
    clear(c)
    for i in range(4):
        c[i, i] = a
    c[0, 2] = c[2, 0] = ex * g[0]
    c[0, 3] = c[3, 0] = ex * g[1]
    c[1, 2] = c[2, 1] = ex * g[2]
    c[1, 3] = c[3, 1] = ex * g[3]


@inside
def scatter_block(block: FloatArray, members: IntArray, equations: IntArray, band: FloatArray) -> None:
    """Add a full symmetric matrix of three freedoms a node to the lower band."""
    for a in range(len(members)):
        for i in range(3):
            row = equations[members[a], i]
            if row < 0:
                continue
            for b in range(len(members)):
                for j in range(3):
                    column = equations[members[b], j]
                    if 0 <= column <= row:
                        band[column, row - column] += block[3 * a + i, 3 * b + j]


@compiled
def harmonic_pressure(
    nodes: FloatArray, u: FloatArray, edges: IntArray, load: FloatArray, equations: IntArray, band: FloatArray
) -> None:
    """Add the pressure's part of K_n to the lower band.

    `nodes`, `u`: shape (nodes, 2), mm. `edges`: shape (k, 3), wetted. `load`: (pressure in kPa, wave number n).

    Minus p times the second variation of
    V2 = -pi/2 integral of (2 n a b + a^2 + b^2) z' + r (n b + 2 a) c' + n c (r b' - b r') along the wetted edges.
    """
    p, n = load[0], load[1]
    ke = np.empty((9, 9))
    for edge in edges:
        clear(ke)
        for g in range(3):
            r, dr, dz = edge_point(nodes, u, edge, g)
            w = 0.5 * np.pi * p * WEIGHTS[g]
            for i in range(3):
                for j in range(3):
                    v, d = VALUES[g, i], DERIVATIVES[g, j]
                    both = w * dz * v * VALUES[g, j]
                    ke[3 * i, 3 * j] += 2.0 * both
                    ke[3 * i + 1, 3 * j + 1] += 2.0 * both
                    ke[3 * i, 3 * j + 1] += 2.0 * n * both
                    ke[3 * i + 1, 3 * j] += 2.0 * n * both
                    ac = w * 2.0 * r * v * d
                    ke[3 * i, 3 * j + 2] += ac
                    ke[3 * j + 2, 3 * i] += ac
                    bc = w * n * v * (r * d - dr * VALUES[g, j])
                    cb = w * n * r * v * d
                    ke[3 * i + 1, 3 * j + 2] += bc
                    ke[3 * j + 2, 3 * i + 1] += bc
                    ke[3 * i + 2, 3 * j + 1] += cb
                    ke[3 * j + 1, 3 * i + 2] += cb
        scatter_block(ke, edge, equations, band)


@dataclass(frozen=True, slots=True)
class Harmonics:
    """The numbering of three freedoms a node (r, t, z), the narrow band of K_n, and the problem it belongs to."""

    problem: Problem
    equations: IntArray
    size: int
    bandwidth: int

    def tangent(self, u: FloatArray, pressure_kpa: float, wave_number: int) -> FloatArray:
        """Return the band of K_n, mN/mm. `u`: shape (nodes, 2), mm."""
        band = empty_band(self.size, self.bandwidth)
        p = self.problem
        harmonic_tangent(p.elements, u, wave_number, self.equations, band)
        harmonic_pressure(p.nodes, u, p.cavity, np.array([pressure_kpa, float(wave_number)]), self.equations, band)
        return band


def make_harmonics(problem: Problem, clamped: BoolArray) -> Harmonics:
    """Number the freedoms of all nodes but the clamped ones, following the problem's own order."""
    rank = problem.equations.max(axis=1)
    nodes = np.flatnonzero(~clamped)
    nodes = nodes[np.argsort(rank[nodes], kind="stable")]
    equations = np.full((len(rank), 3), -1)
    equations[nodes] = np.arange(3 * len(nodes)).reshape(-1, 3)
    quads = problem.elements.quads
    groups = equations[quads].reshape(len(quads), -1)
    low = np.where(groups < 0, groups.max() + 1, groups).min(axis=1)
    return Harmonics(problem, equations, 3 * len(nodes), int((groups.max(axis=1) - low).max()))
