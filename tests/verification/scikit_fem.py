"""The same problem assembled by scikit-fem: an independent check, and the reference of the benchmark.

Strategy: the weak form is written once more, from the material's textbook formulas and scikit-fem's own elements,
mapping and quadrature; nothing is shared with `element.py` but the mesh. It is short, and therefore slow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import skfem
from skfem.helpers import ddot, grad

from analysis.shadow.fem.problem import Problem
from protocol.base.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class ScikitFemProblem:
    """A problem in scikit-fem.

    Parameters
    ----------
    basis : scikit-fem's, on the problem's mesh.
    numbers : shape (n, 2), scikit-fem's number of each of our displacements.
    c10, d1 : shape (m,), kPa and 1/kPa of each element.
    """

    basis: Any
    numbers: IntArray
    c10: FloatArray
    d1: FloatArray

    def internal_force(self, u: FloatArray) -> FloatArray:
        """Return dW/du, shape (n, 2), mN."""
        vector = skfem.LinearForm(_virtual_work).assemble(self.basis, **self._data(u))
        return np.asarray(vector[self.numbers])

    def internal_tangent(self, u: FloatArray) -> Any:
        """Return d2W/du2, mN/mm, as a sparse matrix in our order (2 node + component)."""
        matrix = skfem.BilinearForm(_linearised_work).assemble(self.basis, **self._data(u))
        order = self.numbers.ravel()
        return matrix.tocsr()[order][:, order]

    def _data(self, u: FloatArray) -> dict[str, Any]:
        values = np.zeros(self.basis.N)
        values[self.numbers] = u
        return {"now": self.basis.interpolate(values), "c10": self.c10[:, None], "d1": self.d1[:, None]}


def make_scikit_fem_problem(problem: Problem) -> ScikitFemProblem:
    """Set up a problem in scikit-fem.

    The serendipity map is a biquadratic one whose middle node is at -1/4 of the corners plus 1/2 of the midsides, so
    that scikit-fem's nine-node mesh follows our eight nodes.
    """
    quads, nodes = problem.elements.quads, problem.nodes
    corners, first = np.unique(quads[:, :4], return_inverse=True)
    straight = skfem.MeshQuad(nodes[corners].T.copy(), first.reshape(-1, 4).T.copy())
    curved = skfem.MeshQuad2.from_mesh(straight)
    local = nodes[quads]
    middle = -local[:, :4].sum(axis=1) / 4.0 + local[:, 4:].sum(axis=1) / 2.0
    places = np.array(curved.doflocs)
    places[:, curved.dofs.element_dofs] = np.concatenate([local, middle[:, None]], axis=1).transpose(2, 1, 0)
    curved = skfem.MeshQuad2(places, curved.t)
    basis = skfem.Basis(curved, skfem.ElementVector(skfem.ElementQuadS2()), intorder=3)
    numbers = np.empty(nodes.shape, dtype=np.int64)
    for a in range(8):
        for component in range(2):
            numbers[quads[:, a], component] = basis.element_dofs[2 * a + component]
    return ScikitFemProblem(basis, numbers, *problem.elements.moduli.T)


def _strain(field: Any, r: FloatArray) -> FloatArray:
    """Return the displacement gradient as a 3 x 3 tensor field in (r, z, t)."""
    plane = grad(field)
    h = np.zeros((3, 3, *plane.shape[2:]))
    h[:2, :2] = plane
    h[2, 2] = np.asarray(field)[0] / r
    return h


def _state(w: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return F, F^-T and J."""
    f = np.eye(3)[:, :, None, None] + _strain(w["now"], w.x[0])
    j = np.linalg.det(np.moveaxis(f, (0, 1), (-2, -1)))
    inverse = np.moveaxis(np.linalg.inv(np.moveaxis(f, (0, 1), (-2, -1))), (-2, -1), (0, 1))
    return f, np.swapaxes(inverse, 0, 1), j


def _virtual_work(v: Any, w: Any) -> Any:
    f, g, j = _state(w)
    stress = 2 * w["c10"] * j ** (-2 / 3) * (f - ddot(f, f) / 3 * g) + 2 / w["d1"] * (j - 1) * j * g
    return ddot(stress, _strain(v, w.x[0])) * 2 * np.pi * w.x[0]


def _linearised_work(du: Any, v: Any, w: Any) -> Any:
    f, g, j = _state(w)
    df = _strain(du, w.x[0])
    trace = ddot(g, df)
    dg = -np.einsum("ik...,lk...,lj...->ij...", g, df, g)
    i1 = ddot(f, f)
    deviator = f - i1 / 3 * g
    change = -2 / 3 * trace * deviator + df - 2 / 3 * ddot(f, df) * g - i1 / 3 * dg
    stress = 2 * w["c10"] * j ** (-2 / 3) * change
    stress = stress + 2 / w["d1"] * ((2 * j - 1) * j * trace * g + (j - 1) * j * dg)
    return ddot(stress, _strain(v, w.x[0])) * 2 * np.pi * w.x[0]
