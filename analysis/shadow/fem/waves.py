"""Finite displacements that are not axisymmetric: forces of a Fourier series around the circle, of an imperfect shape.

Strategy: displacements in (r, t, z) are sums over k = 0, 1, ... of (a_k cos k n t, b_k sin k n t, c_k cos k n t), n the
wave number. Gradient and position at an angle are a constant matrix times the amplitudes, and the force on the
amplitudes is its transpose times the stress, summed over equal steps of half a wave, enough of
them for the fourth order of the first wave. An imperfect print is a stress-free shape of its own,
whose points are off the perfect ones by one wave.

Rules: not compiled, as a state needs five evaluations (METHODS.md). `Harmonics.tangent` is the derivative of these
forces at an axisymmetric state of the perfect shape (tested).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from analysis.arrays import FloatArray, IntArray
from analysis.shadow.fem.element import Elements
from analysis.shadow.fem.harmonics import Harmonics
from analysis.shadow.fem.pressure import DERIVATIVES, VALUES, WEIGHTS

R, T, Z = 0, 1, 2


@cache
def trigonometry(waves: int, n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return cos k n t, sin k n t, both (angles, waves), and the orders k n, (waves,)."""
    k, angles = np.arange(waves), 2 * waves - 2
    angle = np.pi * (np.arange(angles)[:, None] + 0.5) / angles * k
    return np.cos(angle), np.sin(angle), n * k.astype(float)


@cache
def gradient_basis(waves: int, n: int) -> FloatArray:
    """Return the matrix from amplitudes to displacement gradients, shape (waves, 3, 3, angles, 3, 3).

    The amplitudes are those of a, b, c, each by r, by z, and divided by R; the gradient is in (r, t, z).
    """
    c, s, order = trigonometry(waves, n)
    basis = np.zeros((*c.shape, 3, 3, 3, 3))  # angle, wave, component, (d/dr, d/dz, 1/R), gradient
    for component, by in ((R, c), (T, s), (Z, c)):
        basis[:, :, component, 0, component, R] = by
        basis[:, :, component, 1, component, Z] = by
    basis[:, :, R, 2, R, T], basis[:, :, T, 2, R, T] = -order * s, -s
    basis[:, :, R, 2, T, T], basis[:, :, T, 2, T, T] = c, order * c
    basis[:, :, Z, 2, Z, T] = -order * s
    return np.ascontiguousarray(np.moveaxis(basis, 0, 3))


def solid_force(elements: Elements, u: FloatArray, error: FloatArray, n: int) -> FloatArray:
    """Return the derivative of the strain energy by the amplitudes, shape of `u`, mN.

    Parameters
    ----------
    u : shape (waves, nodes, 3), amplitudes of the deformed off the perfect shape, mm.
    error : shape (nodes, 3), amplitudes, of order n, of the stress-free off the perfect shape, mm.
    """
    basis = gradient_basis(len(u), n)
    local = np.einsum("eqdi,weik->eqwkd", elements.gradient, u[:, elements.quads], optimize=True)
    off = np.einsum("eqdi,eik->eqkd", elements.gradient, error[elements.quads], optimize=True)
    deformed = np.eye(3) + np.tensordot(local, basis, 3)
    inverse_shape = np.linalg.inv(np.eye(3) + np.tensordot(off, basis[1], 2))  # of the stress-free shape
    f = deformed @ inverse_shape
    j = np.linalg.det(f)[..., None, None]
    c10, d1 = (elements.moduli[:, k].reshape(-1, 1, 1, 1, 1) for k in (0, 1))
    shear = 2.0 * c10 * j ** (-2.0 / 3.0)
    bulk = 2.0 / d1 * (j * j - j) - shear * np.sum(f * f, axis=(-2, -1), keepdims=True) / 3.0
    stress = shear * f + bulk * np.swapaxes(np.linalg.inv(f), -1, -2)
    stress = stress @ np.swapaxes(inverse_shape, -1, -2) / np.linalg.det(inverse_shape)[..., None, None]
    share = elements.weight[..., None, None, None] / basis.shape[3]
    conjugate = share * np.tensordot(stress, basis, ([2, 3, 4], [3, 4, 5]))
    by_node = np.einsum("eqdi,eqwkd->weik", elements.gradient, conjugate, optimize=True)
    return summed(by_node, elements.quads, u)


def volume_force(nodes: FloatArray, u: FloatArray, edges: IntArray, n: int) -> FloatArray:
    """Return the derivative of the cavity's volume by the amplitudes, shape of `u`, mm^2.

    Parameters
    ----------
    nodes : shape (nodes, 2), (r, z), mm. u : as in `solid_force`. edges : shape (k, 3), wetted.

    Notes
    -----
    V = -1/2 integral of (A^2 + B^2 + A B_t - B A_t) z_s - (A B_s - B A_s) z_t over edges (s) and circle (t), where a
    point lies at A e_r + B e_t + z e_z.
    """
    c, s, order = trigonometry(len(u), n)
    place = u.copy()
    place[0, :, ::2] += nodes
    value, slope = (np.einsum("ga,weak->kegw", by, place[:, edges]) for by in (VALUES, DERIVATIVES))
    even, odd = (c, s, c), (-order * s, order * c, -order * s)  # of r, t, z, and their derivatives by t
    at = [value[k] @ even[k].T for k in (R, T, Z)]
    along = [slope[k] @ even[k].T for k in (R, T, Z)]
    around = [value[k] @ odd[k].T for k in (R, T, Z)]
    by_value = [2.0 * at[R] * along[Z] + around[T] * along[Z] - along[T] * around[Z],
                2.0 * at[T] * along[Z] - around[R] * along[Z] + along[R] * around[Z], np.zeros_like(at[Z])]  # fmt: skip
    by_slope = [at[T] * around[Z], -at[R] * around[Z],
                at[R] ** 2 + at[T] ** 2 + at[R] * around[T] - at[T] * around[R]]  # fmt: skip
    by_turn = [-at[T] * along[Z], at[R] * along[Z], at[T] * along[R] - at[R] * along[T]]
    share = -np.pi / len(c) * WEIGHTS[:, None]
    by_node = np.stack(
        [
            np.einsum("ga,egw->wea", VALUES, (share * by_value[k]) @ even[k] + (share * by_turn[k]) @ odd[k])
            + np.einsum("ga,egw->wea", DERIVATIVES, (share * by_slope[k]) @ even[k])
            for k in (R, T, Z)
        ],
        axis=3,
    )
    return summed(by_node, edges, u)


def summed(by_member: FloatArray, members: IntArray, like: FloatArray) -> FloatArray:
    """Sum what each element does on its nodes, shape (waves, elements, k, 3), into the shape of `like`."""
    total = np.zeros_like(like)
    for wave, part in zip(total, by_member, strict=True):
        np.add.at(wave, members, part)
    return total


@dataclass(frozen=True, slots=True)
class Waves:
    """Forces of one wave number and its multiples.

    Parameters
    ----------
    harmonics : the numbering of the freedoms.
    """

    harmonics: Harmonics
    wave_number: int

    def force(self, u: FloatArray, pressure_kpa: float, error: FloatArray) -> list[FloatArray]:
        """Return the forces out of balance by equation, mN, of order 0, n, 2 n, ...

        Parameters
        ----------
        u : shape (waves, nodes, 3), displacements off the stress-free shape, mm.
        error : shape (nodes, 3), the stress-free off the perfect shape, mm.
        """
        problem, n = self.harmonics.problem, self.wave_number
        off = u.copy()
        off[1] += error
        area = volume_force(problem.nodes, off, problem.cavity, n)
        out = solid_force(problem.elements, off, error, n) - pressure_kpa * area
        return [problem.gather(out[0][:, ::2]), *(self.gather(wave) for wave in out[1:])]

    def gather(self, nodal: FloatArray) -> FloatArray:
        """Return a nodal vector, shape (nodes, 3), by equation."""
        free = self.harmonics.equations >= 0
        out = np.empty(self.harmonics.size)
        out[self.harmonics.equations[free]] = nodal[free]
        return out

    def spread(self, values: FloatArray) -> FloatArray:
        """Return values by equation as a nodal vector, zero where clamped."""
        return np.where(self.harmonics.equations >= 0, values[self.harmonics.equations], 0.0)
