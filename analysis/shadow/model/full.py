"""The full model of the actuator: parameters in, states of equilibrium out; what has no solution is rejected."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from analysis.published import LOOP_HALF_WIDTH_MM
from analysis.shadow.fem.harmonics import make_harmonics
from analysis.shadow.fem.mesh import WALL, Mesh, build_mesh
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.problem import Problem, make_problem
from analysis.shadow.fem.solver import TOLERANCE, Solution, Solver, factorise
from analysis.shadow.fem.stability import CriticalState, Stability, compressible, find_limit
from analysis.shadow.model.guides import Guides, make_guides
from analysis.warning import Warning, WarningCode
from protocol.base.arrays import FloatArray
from protocol.base.errors import ChoiceError, DataError, RequestError


@dataclass(frozen=True, slots=True)
class Assessment:
    """The margin of one state: its lowest eigenvalue is 1 at rest and 0 where the actuator buckles."""

    lowest_eigenvalue: float
    warnings: tuple[Warning, ...]


def assess(model: FullModel, state: Solution) -> Assessment:
    """Return the margin of a state, with warnings about the mesh, the imposed values and the stability."""
    lowest = model.stability.lowest_eigenvalue(state)
    warnings = [*model.warnings, *_contradiction(model, state)]
    if lowest <= 0.0:  # with both values imposed there is no critical pressure to refuse it by
        text = "this state is an unstable equilibrium: a real actuator would buckle"
        warnings.append(Warning(WarningCode.UNSTABLE_STATE, "", text))
    return Assessment(lowest, tuple(warnings))


def nominal_band(model: FullModel, pressure_kpa: float) -> tuple[float, float]:
    """Return the free actuator's elongation at a pressure, and half its band: modulus (k = 2) and loop, mm."""
    p = model.parameters
    stiffer = replace(p, lattice_modulus_kpa=p.lattice_modulus_kpa + p.lattice_modulus_sd_kpa)
    problems = model.problem, actuator_problem(stiffer, model.mesh)
    free, stiff = (Solver(problem).solve(pressure_kpa=pressure_kpa).elongation_mm for problem in problems)
    return free, 2.0 * abs(free - stiff) + LOOP_HALF_WIDTH_MM


def _contradiction(model: FullModel, state: Solution) -> list[Warning]:
    """Return a warning if pressure and elongation are both imposed, and outside the band of each other."""
    if state.tip_force_mn == 0.0:
        return []
    p, q = state.pressure_kpa, state.elongation_mm
    free, half = nominal_band(model, p)
    if abs(q - free) <= half:
        return []
    text = (
        f"{p:g} kPa and {q:g} mm contradict each other: the free actuator is at {free:+z.2f} mm \N{PLUS-MINUS SIGN} "
        f"{half:.2f} mm; a force of {state.tip_force_mn / 1e3:+.3g} N at the tip holds this state"
    )
    return [Warning(WarningCode.CONTRADICTORY_STATE, "", text)]


VACUUM_KPA = -101.325
FINE_ENOUGH = (8, 2, 2)
"""Least elements along a cell, across the wall and across the lattice for points within 0.05 mm (METHODS.md)."""
MESH_ERROR_MM, MESH_ERROR_PERCENT = 0.0058, 0.8
"""Error of the elongation by the mesh: greatest of the default actuator over the pressures that it is fitted to, and of
95 % of actuators (METHODS.md)."""
FITTED_KPA = (-40.0, 50.0)
_WORST_CONDITION = 1e9
"""Condition number of the scaled tangent at rest: Newton's method met its tolerance at 4e8 and no longer at 3e9."""
HIDDEN_SHARE = 1e-3  # rounding of the forces, as a share of the force of 1 kPa, that still leaves a result


def actuator_problem(parameters: ActuatorParameters, mesh: Mesh, points_a_side: int = 2) -> Problem:
    """Set up the actuator: base clamped, tip bonded to a rigid plate that only moves along the axis."""
    table = np.array([[m.c10_kpa, m.d1_per_kpa] for m in (parameters.lattice, parameters.wall)])
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[mesh.base] = True
    fixed[mesh.tip, 0] = True
    return make_problem(
        mesh, table[(mesh.material == WALL).astype(int)], fixed=fixed, tied=mesh.tip, points_a_side=points_a_side
    )


def check_values(pressure_kpa: float | None, elongation_mm: float | None) -> None:
    """Reject a state without a value, or with one that is not finite."""
    if pressure_kpa is None and elongation_mm is None:
        raise ChoiceError("neither a pressure nor an elongation is given", "give one of them, or both")
    for name, value in (("pressure", pressure_kpa), ("elongation", elongation_mm)):
        if value is not None and not math.isfinite(value):
            cause = f"the {name} is {value}, not a number"
            raise DataError(cause, "give a finite number; a calibration returns NaN outside its range")


def check_condition(problem: Problem) -> None:
    """Reject an actuator whose results rounding would spoil (condition in the 1-norm: Higham 2002, ch. 15)."""
    rest = np.zeros_like(problem.nodes)
    one_kpa = float(np.linalg.norm(problem.balance(rest, 1.0).area))
    if problem.roundoff_mn > HIDDEN_SHARE * one_kpa:
        cause = "the actuator is so stiff that rounding hides a pressure of 1 kPa"
        raise RequestError(cause, "make the moduli smaller, or Poisson's ratios less near to 0.5")
    reference = compressible(problem)
    root = np.sqrt(reference.tangent(rest, 0.0)[:, 0])
    factor = factorise(reference, rest, 0.0, held=False)
    found = math.inf
    if factor is not None:
        from scipy.sparse.linalg import LinearOperator, onenormest  # slow to import, and not needed for a frame

        def scaled(x: FloatArray) -> FloatArray:
            return root * factor.solve(root * x.ravel())

        found = float(onenormest(LinearOperator((problem.size, problem.size), scaled, scaled)))
    if not found <= _WORST_CONDITION:
        raise RequestError(
            f"the actuator is ill-conditioned: its greatest and least stiffness differ by a factor of {found:.0e}, "
            f"and double precision resolves {_WORST_CONDITION:.0e}",
            "make the moduli and the sizes of the elements more alike",
        )


class FullModel:
    """The actuator by finite elements."""

    def __init__(
        self, parameters: ActuatorParameters | None = None, *, mesh: Mesh | None = None, tolerance: float = TOLERANCE
    ) -> None:
        self.parameters = parameters or ActuatorParameters()
        self.parametric = mesh is None
        self.mesh = mesh or build_mesh(self.parameters)
        self.length_mm = float(self.mesh.nodes[self.mesh.tip, 1].max())
        self.problem = actuator_problem(self.parameters, self.mesh)
        self.solver = Solver(self.problem, tolerance)

    @property
    def warnings(self) -> tuple[Warning, ...]:
        elements = self.parameters.elements
        if not self.parametric or all(has >= least for has, least in zip(elements, FINE_ENOUGH, strict=True)):
            return ()
        along, wall, lattice = elements
        size = f"{along} elements along a cell, {wall} in the wall, {lattice} in the lattice"
        text = f"the mesh is coarse ({size}): points may be off by more than 0.05 mm"
        return (Warning(WarningCode.COARSE_MESH, "", text),)

    @cached_property
    def guides(self) -> Guides:
        return make_guides(self.parameters, self.mesh)

    @cached_property
    def stability(self) -> Stability:
        """Return the tangents that decide whether a state is stable."""
        clamped = np.zeros(len(self.mesh.nodes), dtype=bool)
        clamped[self.mesh.base] = clamped[self.mesh.tip] = True
        return Stability(self.problem, make_harmonics(self.problem, clamped))

    @cached_property
    def vacuum_limit(self) -> CriticalState:
        check_condition(self.problem)
        return find_limit(Solver(self.problem), self.stability, self.length_mm, -1)

    @cached_property
    def inflation_limit(self) -> CriticalState:
        """Return the last stable state under pressure."""
        check_condition(self.problem)
        return find_limit(Solver(self.problem), self.stability, self.length_mm, 1)

    def solve(
        self, *, pressure_kpa: float | None = None, elongation_mm: float | None = None, start: Solution | None = None
    ) -> Solution:
        """Find the state at a pressure, at an elongation, or with both imposed."""
        check_values(pressure_kpa, elongation_mm)
        self.check_limits(pressure_kpa, elongation_mm)
        return self.solver.solve(pressure_kpa=pressure_kpa, elongation_mm=elongation_mm, start=start)

    def check_limits(self, pressure_kpa: float | None, elongation_mm: float | None) -> None:
        """Reject a state beyond the limits of stability; an elongation is checked only where the plate is free."""
        p, q = pressure_kpa, elongation_mm
        if (p is not None and p < 0.0) or (p is None and q is not None and q < 0.0):
            limit = self.vacuum_limit
            beyond = p < limit.pressure_kpa if p is not None else (q or 0.0) < limit.elongation_mm
        else:
            limit = self.inflation_limit
            beyond = p > limit.pressure_kpa if p is not None else (q or 0.0) > limit.elongation_mm
        if beyond:
            state = f"{p:g} kPa" if p is not None else f"{q:g} mm"
            where = f"{limit.pressure_kpa:.3g} kPa ({limit.elongation_mm:+.3g} mm)"
            cause = f"{state} lies beyond {where}, the last state computed and found stable"
            if limit.wave_number >= 0:
                critical = f"{state} lies beyond the critical pressure of {where}"
                cause = f"{critical}, where the actuator loses its stability: {limit.mode}"
            raise RequestError(cause, f"stay on this side of {limit.pressure_kpa:.3g} kPa")
        if p is not None and p < VACUUM_KPA:
            vacuum = f"{p:g} kPa is less than perfect vacuum"
            raise RequestError(vacuum, f"give a gauge pressure above {VACUUM_KPA} kPa")

    def tracked(self, solution: Solution) -> FloatArray:
        """Return the deformed tracked points of one guide, shape (7, 2), (r, z) in mm."""
        return self.guides.tracked.positions(solution.displacement_mm)
