"""The stability margin of a state (METHODS.md), and the limit of stability of an actuator.

Limits are found by walking along the equilibria with prescribed elongation, which passes a limit point, and by
bisecting between the last stable and the first unstable state.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from analysis.shadow.fem import band
from analysis.shadow.fem.harmonics import Harmonics
from analysis.shadow.fem.problem import Problem
from analysis.shadow.fem.solver import Solution, Solver
from protocol.base.arrays import FloatArray
from protocol.base.errors import ConvergenceError

WAVE_NUMBERS = (0, 1, 2, 3, 4, 5, 6)
STEP_SHARE = 1.0 / 50.0
LONGEST_WALK_SHARE = 0.2
_BISECTIONS = 12
"""Step and length of the walk as shares of the actuator's length, and how often the last step is halved."""
EIGENVALUE_STEP = 1e-5
REFERENCE_POISSON = 0.4


@dataclass(frozen=True, slots=True)
class CriticalState:
    """The limit of stability.

    `wave_number`: waves around the circle of the mode that loses its stiffness first (0: a limit point of the
    axisymmetric path); -1 where the walk ended, still stable.
    """

    pressure_kpa: float  # with elongation_mm: the last stable state found
    elongation_mm: float
    wave_number: int

    @property
    def mode(self) -> str:
        names = {-1: "none found", 0: "axisymmetric (limit point)", 1: "sideways", 2: "the bladders become oval"}
        return names.get(self.wave_number, f"{self.wave_number} waves around the bladders")


@dataclass(frozen=True, slots=True)
class Stability:
    """The tangents of one actuator, whose signs decide about its stability.

    The margin is measured in the stiffness at rest of solids with Poisson's ratios of REFERENCE_POISSON at most: in
    that of a nearly incompressible solid, which has no bound, it would be 0 in every state.
    """

    problem: Problem
    harmonics: Harmonics

    def tangent(self, u: FloatArray, pressure_kpa: float, wave_number: int) -> FloatArray:
        """Return the band of K_n. `u`: shape (n, 2), mm."""
        if wave_number == 0:
            return self.problem.tangent(u, pressure_kpa)
        return self.harmonics.tangent(u, pressure_kpa, wave_number)

    def unstable_mode(self, solution: Solution) -> int | None:
        """Return the first wave number whose tangent is not positive definite; None for a stable state."""
        for n in WAVE_NUMBERS:
            matrix = self.tangent(solution.displacement_mm, solution.pressure_kpa, n)
            if band.factorise(matrix) < len(matrix):
                return n
        return None

    def lowest_eigenvalue(self, solution: Solution) -> float:
        """Return the margin of a state, the least over all wave numbers: 1 at rest, 0 at the limit, no unit.

        It is the greatest s for which K_n - s K_n(rest) is positive definite for all n, found by bisection.
        """
        rest, problem = np.zeros_like(solution.displacement_mm), compressible(self.problem)
        reference = Stability(problem, replace(self.harmonics, problem=problem))
        lowest = np.inf
        for n in WAVE_NUMBERS:
            now = self.tangent(solution.displacement_mm, solution.pressure_kpa, n)
            lowest = least_shift(now, reference.tangent(rest, 0.0, n), lowest)
        return lowest


def compressible(problem: Problem) -> Problem:
    """Return a problem with the same shear moduli and Poisson's ratios of at most REFERENCE_POISSON."""
    moduli, nu = problem.elements.moduli.copy(), REFERENCE_POISSON
    moduli[:, 1] = np.maximum(moduli[:, 1], 1.5 * (1.0 - 2.0 * nu) / (1.0 + nu) / moduli[:, 0])
    return replace(problem, elements=problem.elements._replace(moduli=moduli))


def least_shift(matrix: FloatArray, reference: FloatArray, known: float) -> float:
    """Return the smaller of `known` and the lowest eigenvalue of matrix v = s reference v, to EIGENVALUE_STEP."""

    def definite(shift: float) -> bool:
        return band.factorise(matrix - shift * reference) == len(matrix)

    if np.isfinite(known) and definite(known):
        return known
    low, high = (0.0, min(known, 2.0)) if definite(0.0) else (-1.0, 0.0)
    while low < 0.0 and not definite(low):
        low, high = 2.0 * low, low
        if low < -1e6:
            raise ConvergenceError("the actuator is not stable even at rest", "support it, or repair its mesh")
    while high - low > EIGENVALUE_STEP:
        middle = (low + high) / 2.0
        low, high = (middle, high) if definite(middle) else (low, middle)
    return low


def find_limit(solver: Solver, stability: Stability, length_mm: float, direction: Literal[-1, 1]) -> CriticalState:
    """Walk from rest in one direction until stability ends.

    `direction`: -1 towards vacuum, +1 towards inflation.
    Returns the last stable state, with the mode that ends it.
    """
    step = direction * STEP_SHARE * length_mm
    last, mode = solver.rest(), -1
    halvings = 0
    while abs(last.elongation_mm) < LONGEST_WALK_SHARE * length_mm and halvings < _BISECTIONS:
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
    if last.pressure_kpa == 0.0:
        cause = "no stable state can be computed beside the one at rest"
        raise ConvergenceError(cause, "make the moduli and the sizes of the elements more alike")
    return CriticalState(last.pressure_kpa, last.elongation_mm, mode)
