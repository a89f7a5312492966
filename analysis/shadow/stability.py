"""How far a state is from losing its stability, and where an actuator loses it.

Strategy: a state under given pressure is stable while its tangents K_n are positive definite for every wave number n
around the circle (n = 0 is axisymmetric; n = 2 makes a bladder oval). The margin is the lowest eigenvalue of
K_n v = lambda K_n(rest) v: 1 at rest, 0 at the limit, without unit, and the same on every mesh that is fine enough. The
limits themselves are found by walking along the equilibria with the elongation held, which passes a limit point, and by
bisecting between the last stable and the first unstable state.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.linalg import blas, lapack
from scipy.sparse.linalg import LinearOperator, eigsh

from analysis.errors import ConvergenceError
from analysis.shadow.arrays import Floats
from analysis.shadow.harmonics import Harmonics
from analysis.shadow.problem import Problem
from analysis.shadow.solver import Solution, Solver

WAVE_NUMBERS = (0, 1, 2, 3, 4)
STEP_SHARE = 1.0 / 100.0
LONGEST_WALK_SHARE = 0.2
BISECTIONS = 14
"""The walk goes in steps of this share of the length, as far as that share, and halves its last step so often."""


@dataclass(frozen=True, slots=True)
class CriticalState:
    """Where stability ends.

    Parameters
    ----------
    pressure_kpa, elongation_mm : the last stable state found.
    wave_number : waves around the circle of the mode that loses its stiffness first (0: a limit point of the
        axisymmetric path); -1 where the walk ended, still stable.
    """

    pressure_kpa: float
    elongation_mm: float
    wave_number: int

    @property
    def mode(self) -> str:
        """The mode in words."""
        names = {-1: "none found", 0: "axisymmetric (limit point)", 1: "sideways", 2: "the bladders go oval"}
        return names.get(self.wave_number, f"{self.wave_number} waves around the bladders")


@dataclass(frozen=True, slots=True)
class Stability:
    """The tangents of one actuator, whose signs decide."""

    problem: Problem
    harmonics: Harmonics

    def band(self, u: Floats, pressure_kpa: float, wave_number: int) -> tuple[Floats, int]:
        """Return the lower band of K_n and its bandwidth."""
        if wave_number == 0:
            return self.problem.tangent(u, pressure_kpa), self.problem.bandwidth
        return self.harmonics.tangent(u, pressure_kpa, wave_number), self.harmonics.bandwidth

    def unstable_mode(self, solution: Solution) -> int | None:
        """Return the first wave number whose tangent is not positive definite; None for a stable state."""
        for n in WAVE_NUMBERS:
            band, _ = self.band(solution.displacement_mm, solution.pressure_kpa, n)
            if lapack.dpbtrf(band, lower=1, overwrite_ab=1)[1] != 0:
                return n
        return None

    def lowest_eigenvalue(self, solution: Solution) -> float:
        """Return the margin of a state, the least over all wave numbers: 1 at rest, 0 at the limit, no unit."""
        return min(self._relative_eigenvalue(solution, n) for n in WAVE_NUMBERS)

    def _relative_eigenvalue(self, solution: Solution, wave_number: int) -> float:
        at_rest, width = self.band(np.zeros_like(solution.displacement_mm), 0.0, wave_number)
        root, info = lapack.dpbtrf(at_rest, lower=1, overwrite_ab=1)
        if info != 0:
            raise ConvergenceError("the actuator is not stable even at rest", "support it, or repair its mesh")
        band, _ = self.band(solution.displacement_mm, solution.pressure_kpa, wave_number)

        def apply(v: Floats) -> Floats:
            x, _ = lapack.dtbtrs(root, v, uplo="L", trans="T")
            y, _ = lapack.dtbtrs(root, blas.dsbmv(width, 1.0, band, np.ravel(x), lower=1), uplo="L")
            return np.ravel(y)

        size = band.shape[1]
        operator: Any = LinearOperator((size, size), matvec=apply, dtype=np.float64)
        start = np.random.default_rng(0).standard_normal((size,))
        values, _ = eigsh(operator, k=1, which="SA", v0=start, tol=1e-4, ncv=min(40, size - 1), maxiter=4000)
        return float(values[0])


def find_limit(solver: Solver, stability: Stability, length_mm: float, direction: Literal[-1, 1]) -> CriticalState:
    """Walk from rest in one direction until stability ends.

    Parameters
    ----------
    direction : -1 towards vacuum, +1 towards inflation.

    Returns
    -------
    CriticalState
        The last stable state, with what ends it.
    """
    step = direction * STEP_SHARE * length_mm
    last, mode = solver.rest(), -1
    halvings = 0
    while abs(last.elongation_mm) < LONGEST_WALK_SHARE * length_mm and halvings < BISECTIONS:
        try:
            then = solver.solve(elongation_mm=last.elongation_mm + step, start=last)
            found = 0 if direction * (then.pressure_kpa - last.pressure_kpa) < 0 else stability.unstable_mode(then)
        except ConvergenceError:
            then, found = last, 0
        if found is None:
            last = then
        else:
            mode = found
        if mode >= 0:
            step /= 2.0
            halvings += 1
    return CriticalState(last.pressure_kpa, last.elongation_mm, mode)
