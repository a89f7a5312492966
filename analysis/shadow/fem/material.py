"""Compressible neo-Hookean solid (METHODS.md), differentiated by hand.

A deformation gradient without torsion has five entries, in this order everywhere: F_rr, F_rz, F_zr, F_zz, F_tt (t is
the hoop). Stress and the symmetric 5 x 5 tangent are conjugate to them. J <= 0 is never differentiated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.compiled import compiled, inside
from protocol.base.arrays import FloatArray
from protocol.base.errors import RequestError

NEAREST_TO_HALF = 1e-6  # nearer to 0.5 a solid is so stiff against volume that rounding hides the load


@dataclass(frozen=True, slots=True)
class NeoHookean:
    """One material."""

    youngs_modulus_kpa: float  # small-strain Young's modulus E, kPa
    poisson_ratio: float  # small-strain Poisson's ratio, -1 < nu < 0.5

    def __post_init__(self) -> None:
        if not (np.isfinite(self.youngs_modulus_kpa) and self.youngs_modulus_kpa > 0):
            cause = f"Young's modulus is {self.youngs_modulus_kpa} kPa, not a positive number"
            raise RequestError(cause, "give a modulus above 0 kPa")
        if not -1.0 < self.poisson_ratio <= 0.5 - NEAREST_TO_HALF:
            raise RequestError(
                f"a Poisson's ratio of {self.poisson_ratio} is outside -1 .. 0.5 (less {NEAREST_TO_HALF:g})",
                "give a value below 0.5; rubber is 0.45 to 0.4999 here",
            )

    @property
    def c10_kpa(self) -> float:
        """C10 = mu / 2 = E / (4 (1 + nu)), kPa."""
        return self.youngs_modulus_kpa / (4.0 * (1.0 + self.poisson_ratio))

    @property
    def d1_per_kpa(self) -> float:
        """D1 = 2 / K = 6 (1 - 2 nu) / E, 1/kPa."""
        return 6.0 * (1.0 - 2.0 * self.poisson_ratio) / self.youngs_modulus_kpa


@inside
def determinant(f: FloatArray) -> float:
    """Return J = det F of the five entries `f`."""
    return float((f[0] * f[3] - f[1] * f[2]) * f[4])


@compiled
def energy(f: FloatArray, c10: float, d1: float) -> float:
    """Return W, kPa (energy per reference volume). `f`: shape (5,), F. `c10`, `d1`: kPa and 1/kPa."""
    j = determinant(f)
    i1 = f[0] ** 2 + f[1] ** 2 + f[2] ** 2 + f[3] ** 2 + f[4] ** 2
    return float(c10 * (j ** (-2.0 / 3.0) * i1 - 3.0) + (j - 1.0) ** 2 / d1)


@inside
def inverse_transpose(f: FloatArray, g: FloatArray) -> float:
    """Write G = F^-T into `g` and return J."""
    j = determinant(f)
    scale = f[4] / j
    g[0] = f[3] * scale
    g[1] = -f[2] * scale
    g[2] = -f[1] * scale
    g[3] = f[0] * scale
    g[4] = 1.0 / f[4]
    return j


@compiled
def stress(f: FloatArray, c10: float, d1: float, p: FloatArray) -> None:
    """Write the first Piola-Kirchhoff stress P = dW/dF into `p`."""
    j = inverse_transpose(f, p)
    i1 = f[0] ** 2 + f[1] ** 2 + f[2] ** 2 + f[3] ** 2 + f[4] ** 2
    a = 2.0 * c10 * j ** (-2.0 / 3.0)
    b = 2.0 / d1 * (j * j - j) - a * i1 / 3.0
    for i in range(5):
        p[i] = a * f[i] + b * p[i]


@compiled
def tangent(f: FloatArray, c10: float, d1: float, c: FloatArray) -> None:
    """Write dP/dF into the symmetric `c`.

    `f`: shape (5,), F. `c10`, `d1`: kPa and 1/kPa. `c`: shape (5, 5), kPa.

    dP = a dF - 2a/3 [F (G:dF) + G (F:dF)] + [2a I1/9 + 2/D1 (2J^2 - J)] G (G:dF) + (a I1/3 - b) G dF^T G
    with G = F^-T, a = 2 C10 J^(-2/3), b = 2/D1 (J^2 - J).
    """
    g = np.empty(5)
    j = inverse_transpose(f, g)
    i1 = f[0] ** 2 + f[1] ** 2 + f[2] ** 2 + f[3] ** 2 + f[4] ** 2
    a = 2.0 * c10 * j ** (-2.0 / 3.0)
    gg = 2.0 * a * i1 / 9.0 + 2.0 / d1 * (2.0 * j * j - j)
    ex = a * i1 / 3.0 - 2.0 / d1 * (j * j - j)
    for i in range(5):
        for k in range(i + 1):
            c[i, k] = gg * g[i] * g[k] - 2.0 * a / 3.0 * (f[i] * g[k] + g[i] * f[k])
        c[i, i] += a
    # (G dF^T G)_ij = G_ik dF_lk G_lj; row and column 0 rr, 1 rz, 2 zr, 3 zz, 4 hoop
    c[0, 0] += ex * g[0] * g[0]
    c[1, 0] += ex * g[0] * g[1]
    c[2, 0] += ex * g[2] * g[0]
    c[3, 0] += ex * g[2] * g[1]
    c[1, 1] += ex * g[1] * g[1]
    c[2, 1] += ex * g[0] * g[3]
    c[3, 1] += ex * g[3] * g[1]
    c[2, 2] += ex * g[2] * g[2]
    c[3, 2] += ex * g[2] * g[3]
    c[3, 3] += ex * g[3] * g[3]
    c[4, 4] += ex * g[4] * g[4]
    for i in range(5):
        for k in range(i):
            c[k, i] = c[i, k]
