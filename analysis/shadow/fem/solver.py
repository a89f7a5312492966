"""Equilibrium of a finite-strain problem: Newton's method, warm starts, line search, load stepping.

A state is controlled by its pressure, by its elongation (which passes a limit point), or by both; then the plate's
reaction follows. Newton steps reuse the last factorisation while it brings the residual down fivefold a step. A step
that inverts an element, or raises both the residual and the potential, is halved, and so is a load that is not reached.
A tangent that is not positive definite ends the search: the state is not stable.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analysis.shadow.fem import band
from analysis.shadow.fem.problem import Balance, Problem
from protocol.base.arrays import FloatArray
from protocol.base.errors import ConvergenceError

TOLERANCE = 1e-9
MOST_ITERATIONS = 40
SMALLEST_LOAD_STEP = 1.0 / 256.0
CHORD_RATIO = 0.2
CHORD_ENTRY = 1e-3
SMALLEST_SHARE = 1.0 / 512.0
PLATE_TOLERANCE_MM = 1e-12


@dataclass(frozen=True, slots=True)
class Solution:
    """One state of equilibrium."""

    displacement_mm: FloatArray  # shape (n, 2), (u_r, u_z) of each node
    pressure_kpa: float  # with elongation_mm: the state's pressure and its plate's displacement (0 without a plate)
    elongation_mm: float
    tip_force_mn: float  # force on the plate that holds it there, mN, positive pulling; 0 when the plate is free
    iterations: int  # Newton steps taken, over all load steps
    residual: float


@dataclass(frozen=True, slots=True)
class Factor:
    """Cholesky factor of a tangent, without a held plate, whose column and diagonal are kept apart, else zero."""

    cholesky: FloatArray
    column: FloatArray
    diagonal: float
    held: bool

    def solve(self, right: FloatArray) -> FloatArray:
        """Return the tangent's inverse times `right`, shape (size,)."""
        return np.asarray(band.backward(self.cholesky, band.forward(self.cholesky, right)))


class NotConvergedError(Exception):
    """One load step failed; the caller halves it."""


@dataclass(frozen=True, slots=True)
class Iterate:
    """A trial state and its forces out of balance; `norm` leaves out the plate where its reaction is free."""

    u: FloatArray
    pressure_kpa: float
    balance: Balance
    norm: float


@dataclass(frozen=True, slots=True)
class Control:
    """What a load step prescribes; None follows."""

    pressure_kpa: float | None
    elongation_mm: float | None

    @property
    def plate(self) -> bool:
        return self.elongation_mm is not None

    @property
    def both(self) -> bool:
        """Return whether pressure and elongation are prescribed, so that the plate has a reaction force."""
        return self.plate and self.pressure_kpa is not None


def factorise(problem: Problem, u: FloatArray, pressure_kpa: float, *, held: bool) -> Factor | None:
    """Factorise the tangent, without a `held` plate's row and column; return None where it is not positive definite."""
    matrix = problem.tangent(u, pressure_kpa)
    column, diagonal = np.zeros(problem.size), 0.0
    if held:
        plate, width = problem.plate, problem.bandwidth
        below = min(width, problem.size - 1 - plate)
        above = np.arange(max(0, plate - width), plate)
        column[plate + 1 : plate + 1 + below] = matrix[plate, 1 : below + 1]
        column[above] = matrix[above, plate - above]
        diagonal = float(matrix[plate, 0])
        matrix[plate] = 0.0
        matrix[above, plate - above] = 0.0
        matrix[plate, 0] = 1.0
    whole = band.factorise(matrix) == problem.size
    return Factor(matrix, column, diagonal, held) if whole else None


@dataclass(slots=True)
class Solver:
    """Solves one problem repeatedly, keeping its last factorisation for a warm start.

    `tolerance`: relative residual (Euclidean, to the greater of load and internal forces) of a solution.
    """

    problem: Problem
    tolerance: float = TOLERANCE
    _factor: Factor | None = None

    def rest(self) -> Solution:
        """Return the state without load."""
        return Solution(np.zeros_like(self.problem.nodes), 0.0, 0.0, 0.0, 0, 0.0)

    def solve(
        self, *, pressure_kpa: float | None = None, elongation_mm: float | None = None, start: Solution | None = None
    ) -> Solution:
        """Find the state at a given pressure, elongation, or both."""
        first = state = start or self.rest()
        done, step, spent = 0.0, 1.0, 0
        while done < 1.0:
            share = min(1.0, done + step)
            p, q = (first.pressure_kpa, pressure_kpa), (first.elongation_mm, elongation_mm)
            control = Control(interpolate(*p, share), interpolate(*q, share))
            try:
                state = self._newton(state, control)
            except NotConvergedError as failure:
                self._factor = None
                step /= 2.0
                if step < SMALLEST_LOAD_STEP:
                    raise ConvergenceError(
                        f"no equilibrium beyond {state.pressure_kpa:.4g} kPa, {state.elongation_mm:.4g} mm: {failure}",
                        "choose a smaller load, or a finer mesh",
                    ) from None
            else:
                spent += state.iterations
                done, step = share, 1.5 * step
        return replace(state, iterations=spent)

    def _newton(self, start: Solution, control: Control) -> Solution:
        """Iterate from `start` to the prescribed state."""
        if self._factor is not None and self._factor.held != control.plate:
            self._factor = None
        pressure = start.pressure_kpa if control.pressure_kpa is None else control.pressure_kpa
        now = self._evaluate(start.displacement_mm, pressure, control)
        before = np.inf
        for iteration in range(MOST_ITERATIONS):
            if self._converged(now, control):
                return self._solution(now, control, iteration)
            reuse = self._factor if iteration == 0 or now.norm < CHORD_RATIO * before else None
            before = now.norm
            moved = self._try_step(now, control, reuse) if reuse is not None else None
            if moved is None:
                self._factor = factorise(self.problem, now.u, now.pressure_kpa, held=control.plate)
                if self._factor is None:
                    raise NotConvergedError("the tangent stiffness is no longer positive definite")
                moved = self._line_search(now, control, self._factor)
            now = moved
        raise NotConvergedError(f"Newton's method did not converge in {MOST_ITERATIONS} steps")

    def _evaluate(self, u: FloatArray, pressure_kpa: float, control: Control) -> Iterate:
        balance = self.problem.balance(u, pressure_kpa)
        force = balance.force
        norm = float(np.linalg.norm(force))
        if control.both and norm > 0.0:
            norm = float(np.sqrt(max(norm**2 - force[self.problem.plate] ** 2, 0.0)))
        return Iterate(u, pressure_kpa, balance, norm)

    def _gap_mm(self, now: Iterate, control: Control) -> float:
        """Return the distance of the plate from its prescribed displacement."""
        if control.elongation_mm is None:
            return 0.0
        return control.elongation_mm - self.problem.plate_displacement(now.u)

    def _converged(self, now: Iterate, control: Control) -> bool:
        if not now.balance.smallest_j > 0.0:
            raise NotConvergedError("an element would be inverted")
        enough = self.tolerance * now.balance.scale + self.problem.roundoff_mn
        return now.norm <= enough and abs(self._gap_mm(now, control)) < PLATE_TOLERANCE_MM

    def _solution(self, now: Iterate, control: Control, iterations: int) -> Solution:
        tip_force = float(now.balance.force[self.problem.plate]) if control.both else 0.0
        elongation, residual = self.problem.plate_displacement(now.u), now.norm / (now.balance.scale or 1.0)
        return Solution(now.u, now.pressure_kpa, elongation, tip_force, iterations, residual)

    def _direction(self, now: Iterate, control: Control, factor: Factor) -> tuple[FloatArray, float]:
        """Return the Newton step (displacements by node, pressure)."""
        force, plate = now.balance.force, self.problem.plate
        if not control.plate:
            return self.problem.spread(-factor.solve(force)), 0.0
        gap = self._gap_mm(now, control)
        right = -(force + factor.column * gap)
        right[plate] = 0.0
        dp = 0.0
        if control.both:
            du = factor.solve(right)
        else:
            area = now.balance.area.copy()
            area[plate] = 0.0
            du, by_pressure = factor.solve(right), factor.solve(area)
            stiff = float(factor.column @ by_pressure) - now.balance.area[plate]
            dp = -(force[plate] + factor.diagonal * gap + float(factor.column @ du)) / stiff
            du = du + dp * by_pressure
        du[plate] = gap
        return self.problem.spread(du), float(dp)

    def _try_step(self, now: Iterate, control: Control, factor: Factor) -> Iterate | None:
        """Try one whole step with an old factor; return None if it does not improve the state."""
        du, dp = self._direction(now, control, factor)
        then = self._evaluate(now.u + du, now.pressure_kpa + dp, control)
        improves = then.norm < now.norm or then.norm <= CHORD_ENTRY * then.balance.scale
        return then if then.balance.smallest_j > 0.0 and improves else None

    def _line_search(self, now: Iterate, control: Control, factor: Factor) -> Iterate:
        """Shorten the Newton step until it improves the state."""
        du, dp = self._direction(now, control, factor)
        comparable = not control.plate or (control.both and self._gap_mm(now, control) == 0.0)
        share = 1.0
        while share > SMALLEST_SHARE:
            then = self._evaluate(now.u + share * du, now.pressure_kpa + share * dp, control)
            if then.balance.smallest_j > 0.0 and (not comparable or self._improves(now, then)):
                return then
            share /= 2.0
        raise NotConvergedError("no step length reduces the residual")

    def _improves(self, now: Iterate, then: Iterate) -> bool:
        """Return whether the residual falls, or the potential."""
        potential = self.problem.potential
        return then.norm < now.norm or potential(then.u, then.pressure_kpa) < potential(now.u, now.pressure_kpa)


def interpolate(first: float, last: float | None, share: float) -> float | None:
    """Return the value at a given share from `first` to `last`; None where nothing is prescribed."""
    if last is None:
        return None
    return last if share == 1.0 else first + share * (last - first)
