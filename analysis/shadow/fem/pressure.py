"""Pressure on a deformed cavity, and its tangent.

The load is p dV/du, with V = - integral of pi r^2 dz along the wetted edges, the solid on the left. Differentiating V
gives a load that follows the surface, the thrust on the plate and a symmetric tangent. Each edge is a parabola: three
Gauss points are exact. The chain of edges ends on the axis, on a fixed node or on the plate; elsewhere the end term
would be a force without a source.
"""

from __future__ import annotations

import numpy as np

from analysis.compiled import compiled, inner
from analysis.shadow.fem.band import add_to_band
from protocol.base.arrays import FloatArray, IntArray

_POINTS, WEIGHTS = np.polynomial.legendre.leggauss(3)
VALUES = np.stack([_POINTS * (_POINTS - 1) / 2, 1 - _POINTS**2, _POINTS * (_POINTS + 1) / 2], axis=1)
DERIVATIVES = np.stack([_POINTS - 0.5, -2 * _POINTS, _POINTS + 0.5], axis=1)
_CROSS = np.einsum("g,gi,gj->gij", WEIGHTS, VALUES, DERIVATIVES)


@inner
def edge_point(nodes: FloatArray, u: FloatArray, edge: IntArray, g: int) -> tuple[float, float, float]:
    """Return r of a deformed edge at Gauss point `g`, mm, and the derivatives of r and z along the edge."""
    r, dr, dz = 0.0, 0.0, 0.0
    for a in range(3):
        radius = nodes[edge[a], 0] + u[edge[a], 0]
        r += VALUES[g, a] * radius
        dr += DERIVATIVES[g, a] * radius
        dz += DERIVATIVES[g, a] * (nodes[edge[a], 1] + u[edge[a], 1])
    return r, dr, dz


@compiled
def cavity_volume(nodes: FloatArray, u: FloatArray, edges: IntArray) -> float:
    """Return V, mm^3, of the cavity."""
    volume = 0.0
    for edge in edges:
        for g in range(3):
            r, _, dz = edge_point(nodes, u, edge, g)
            volume -= WEIGHTS[g] * np.pi * r * r * dz
    return volume


@compiled
def volume_gradient(nodes: FloatArray, u: FloatArray, edges: IntArray, gradient: FloatArray) -> None:
    """Add dV/du to `gradient`. `gradient`: shape (n, 2), mm^2."""
    for edge in edges:
        for g in range(3):
            r, _, dz = edge_point(nodes, u, edge, g)
            for a in range(3):
                gradient[edge[a], 0] -= WEIGHTS[g] * 2.0 * np.pi * r * dz * VALUES[g, a]
                gradient[edge[a], 1] -= WEIGHTS[g] * np.pi * r * r * DERIVATIVES[g, a]


@compiled
def pressure_tangent(
    nodes: FloatArray, u: FloatArray, edges: IntArray, pressure: float, equations: IntArray, band: FloatArray
) -> None:
    """Add -p d2V/du2 to the lower band."""
    for edge in edges:
        for a in range(3):
            for b in range(3):
                rr, rz = 0.0, 0.0
                for g in range(3):
                    r, _, dz = edge_point(nodes, u, edge, g)
                    rr += WEIGHTS[g] * 2.0 * np.pi * dz * VALUES[g, a] * VALUES[g, b]
                    rz += 2.0 * np.pi * r * _CROSS[g, a, b]
                row = equations[edge[a], 0]
                if row < 0:
                    continue
                add_to_band(band, row, equations[edge[b], 0], pressure * rr)
                column = equations[edge[b], 1]
                if column >= 0:
                    add_to_band(band, max(row, column), min(row, column), pressure * rz)
