"""Small solids with known answers: mapped meshes, and closed forms of thick cylinders and spheres."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from analysis.shadow.fem.band import PAD
from analysis.shadow.fem.element import EDGES
from analysis.shadow.fem.material import NeoHookean
from analysis.shadow.fem.mesh import Mesh, structured_quads
from analysis.shadow.fem.problem import Problem, make_problem
from protocol.base.arrays import BoolArray, FloatArray


def mapped_mesh(
    place: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]], across: int, along: int
) -> Mesh:
    """Mesh the image of the unit square; `place(s, t)` gives (r, z); wetted where s = 0, base t = 0, tip t = 1."""
    s, t = np.meshgrid(np.linspace(0, 1, 2 * across + 1), np.linspace(0, 1, 2 * along + 1))
    quads, used, column = structured_quads(along, across)
    nodes = np.stack(place(s, t), axis=2)[used]
    ends = np.arange(2 * across + 1)
    material = np.zeros(len(quads), dtype=np.int64)
    return Mesh(nodes, quads, material, quads[column == 0][:, EDGES[3]], ends, len(nodes) - 1 - ends[::-1])


def solid(mesh: Mesh, material: NeoHookean, fixed: BoolArray, points_a_side: int = 2) -> Problem:
    """One material on a mesh."""
    moduli = np.tile([material.c10_kpa, material.d1_per_kpa], (len(mesh.quads), 1))
    return make_problem(mesh, moduli, fixed=fixed, points_a_side=points_a_side)


def cylinder(inner: float, outer: float, across: int, material: NeoHookean) -> tuple[Mesh, Problem]:
    """A slice of a long cylinder under inner pressure: no axial displacement at its ends."""
    mesh = mapped_mesh(lambda s, t: (inner * (outer / inner) ** s, t), across, 1)
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[:, 1] = True
    return mesh, solid(mesh, material, fixed)


def sphere(inner: float, outer: float, across: int, material: NeoHookean) -> tuple[Mesh, Problem]:
    """Half a sphere under inner pressure, from its equator (symmetry) to its axis."""

    def place(s: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        radius = inner * (outer / inner) ** s
        return radius * np.cos(t * np.pi / 2), radius * np.sin(t * np.pi / 2)

    mesh = mapped_mesh(place, across, across)
    mesh.nodes[mesh.tip, 0] = 0.0
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[mesh.base, 1] = True
    fixed[mesh.tip, 0] = True
    return mesh, solid(mesh, material, fixed)


def cylinder_pressure(inner_now: float, inner: float, outer: float) -> float:
    """P / mu of an incompressible neo-Hookean cylinder in plane strain, inner radius `inner` -> `inner_now`."""
    a, b = inner_now / inner, np.sqrt(outer**2 + inner_now**2 - inner**2) / outer
    return float(np.log(a / b) + 0.5 * (b**-2 - a**-2))


def sphere_pressure(inner_now: float, inner: float, outer: float) -> float:
    """P / mu of an incompressible neo-Hookean sphere."""
    a, b = inner_now / inner, np.cbrt(outer**3 + inner_now**3 - inner**3) / outer
    return float(2.0 * (1 / b - 1 / a) + 0.5 * (b**-4 - a**-4))


def lame_displacement(r: FloatArray, inner: float, outer: float, load: tuple[float, float, float]) -> FloatArray:
    """Radial displacement of a thick cylinder in plane strain; `load` is (pressure, E, nu)."""
    p, e, nu = load
    return np.asarray((1 + nu) / e * p * inner**2 / (outer**2 - inner**2) * ((1 - 2 * nu) * r + outer**2 / r))


def dense(band: FloatArray) -> FloatArray:
    """A band as a full symmetric matrix."""
    size = len(band)
    lower = np.zeros((size, size))
    for j in range(size):
        below = min(band.shape[1] - PAD, size - j)
        lower[j : j + below, j] = band[j, :below]
    return lower + np.tril(lower, -1).T
