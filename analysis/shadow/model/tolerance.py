"""As fine a mesh as an error of the elongation takes: a hierarchy of meshes, and the estimate that it gives.

Strategy: the same state is solved with more and more elements along a cell; two across the wall and the lattice leave
next to nothing of an extension and up to 0.2 % of a contraction. The change from one mesh to the next, with the order
1.5 that actuators show, estimates the error that is left (Richardson; Roache, Annu. Rev. Fluid Mech. 29, 1997, 123).
Each change states an error of the last mesh, by the order 1 from its own finer mesh on, and the greatest is believed:
where errors change their sign one change is small by chance. For the same reason a share of the elongation is stated at
least, of the size that errors have. A mesh whose error, by the same law, will be above the tolerance is not solved.

The reduced model's error is that of one state: its residual in the full model, brought to displacements by two Newton
steps or, where the second is long, more (`ReducedState`), for a tenth of a full solution. Of a table it is the greatest
over 19 states that were not used for it: the twentieth's is larger with a chance of 1 in 20 (Vovk et al., Algorithmic
learning in a random world, 2005).

Rules: the error of a mesh is that of the discretisation, for the parameters as given: not of the moduli, nor of the
model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from analysis.numbers import rounded_up
from analysis.progress import Progress
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solution
from analysis.shadow.model.frames import Model, Shadow
from analysis.shadow.model.full import FullModel, check_values
from analysis.shadow.model.reduced import ReducedModel, TableSettings
from analysis.shadow.model.table import load_table
from protocol.base.errors import ConvergenceError, RequestError

ALONG = (16, 20, 24, 32, 40, 48, 64)
"""Elements along a cell. On fewer than 16 the error grows or changes its sign from mesh to mesh."""
ACROSS = 2
"""Elements across the wall, and across the lattice."""
ORDER, SAFE_ORDER = 1.5, 1.0
"""Powers of the number of elements along a cell: by which errors fall, and by which they are trusted to."""
FACTOR = 1.1
"""On the estimate, so that it holds for 95 % of the actuators and not for half of them."""
LEAST_MM, LEAST_SHARE = 3e-4, 1.5e-3
"""Error that is stated at least: of the elements across, and as a share of the elongation on the first mesh."""
CONTRACTION_SHARE = 5e-4
"""Of a contraction, stated besides: near the limit of stability it follows small errors of the stiffness."""
RESIDUAL_FACTOR = 1.000001
"""On the sum of the Newton steps, so that it holds for 95 % of the states."""
MOST_STEPS, LAST_STEP = 6, 0.1
"""Of Newton from a reduced state: the most, and the last as a part of their sum."""
HELD_OUT = 19
TABLES = ((4, 4, 3), (5, 5, 4), (6, 6, 6), (7, 7, 8), (9, 9, 12))
"""Pressures, elongations and shapes of tables, from the coarsest."""


class ToleranceError(RequestError):
    """No mesh, or no table, has so small an error.

    Parameters
    ----------
    cause, remedy : the remedy after the tolerance to allow.
    allowed_mm : tolerance that can be met.
    """

    def __init__(self, cause: str, allowed_mm: float, remedy: str) -> None:
        super().__init__(cause, f"allow {allowed_mm:.2g} mm {remedy}")
        self.allowed_mm = allowed_mm


@dataclass(frozen=True, slots=True)
class ToleratedState:
    """A state with the error that its elongation has.

    Parameters
    ----------
    solved : elements along a cell of all meshes that were solved, its own last.
    """

    model: FullModel
    solution: Solution
    error_mm: float
    tolerance_mm: float
    solved: tuple[int, ...]

    @property
    def elements(self) -> tuple[int, int, int]:
        """Return the elements of the mesh that was fine enough: along a cell, across the wall, across the lattice."""
        return self.solved[-1], ACROSS, ACROSS


def on_mesh(parameters: ActuatorParameters, along: int, across: int = ACROSS) -> ActuatorParameters:
    """Return the actuator with so many elements along a cell, and across its wall and its lattice."""
    return replace(parameters, axial_elements=along, wall_elements=across, lattice_elements=across)


def error_estimate(elongations_mm: Mapping[int, float]) -> float:
    """Return the estimated error of the elongation on the finest of two meshes or more, mm."""
    along = sorted(elongations_mm)
    share = LEAST_SHARE * float((ALONG[0] / along[-1]) ** SAFE_ORDER)
    found = max(LEAST_MM, share * abs(elongations_mm[along[-1]]))
    for coarse, fine in pairwise(along):
        left = abs(elongations_mm[fine] - elongations_mm[coarse]) / float((fine / coarse) ** ORDER - 1.0)
        found = max(found, FACTOR * left * (fine / along[-1]) ** SAFE_ORDER)
    return found + CONTRACTION_SHARE * max(0.0, -elongations_mm[along[-1]])


def solve_within(parameters: ActuatorParameters, pressure_kpa: float, tolerance_mm: float) -> ToleratedState:
    """Solve the state at a pressure on no finer a mesh than an error of its elongation takes.

    Raises
    ------
    ToleranceError : the tolerance cannot be met. RequestError : it is no length, or the state lies beyond the limit of
    stability. DataError : no number.
    """
    check_values(pressure_kpa, None)
    check_length(tolerance_mm)
    found: dict[int, float] = {}
    best = float("inf")
    for along in ALONG:
        expected = best * (max(found) / along) ** SAFE_ORDER if len(found) > 1 else tolerance_mm
        if expected > tolerance_mm and along != ALONG[-1]:
            continue
        model = FullModel(on_mesh(parameters, along))
        try:
            solution = model.solver.solve(pressure_kpa=pressure_kpa)
        except ConvergenceError:  # a coarse mesh may lose its stability before
            continue
        found[along] = solution.elongation_mm
        if len(found) > 1 and (best := error_estimate(found)) <= tolerance_mm:
            model.check_limits(pressure_kpa, None)
            return ToleratedState(model, solution, best, tolerance_mm, tuple(found))
    if len(found) < 2:
        model.check_limits(pressure_kpa, None)
        raise RequestError("the state is stable on one mesh alone", "choose a pressure closer to 0 kPa")
    cause = f"an error of {tolerance_mm:g} mm takes more than {ALONG[-1]} elements along a cell"
    raise ToleranceError(cause, rounded_up(1.05 * best), "or more")


@dataclass(frozen=True, slots=True)
class ReducedState:
    """A state of the reduced model, or of the full one where that is needed.

    Parameters
    ----------
    solution, used : the state, and the model that it is of.
    error_mm : of elongation and tracked points against the full model on the same mesh; 0 of the full model.
    """

    solution: Solution
    used: Model
    error_mm: float


def reduced_error_mm(
    model: FullModel, solution: Solution, pressure_kpa: float | None, elongation_mm: float | None
) -> float:
    """Return the error of a state of the reduced model by its residual, at k = 2: of elongation and tracked points.

    Parameters
    ----------
    model, solution : full model, and the state. pressure_kpa, elongation_mm : prescribed; None where it follows.

    Raises
    ------
    ConvergenceError : the state is not stable, or too far from the full model's for Newton.
    """
    moved = np.zeros_like(solution.displacement_mm)
    for _ in range(MOST_STEPS):  # far from the nominal curve, or near a limit of stability, the first are too short
        state = replace(solution, displacement_mm=solution.displacement_mm + moved)
        step = model.solver.correction(state, pressure_kpa=pressure_kpa, elongation_mm=elongation_mm)
        moved += step
        if np.abs(step).max() <= LAST_STEP * np.abs(moved).max():  # the next would be its square
            break
    else:
        raise ConvergenceError("the error of the reduced state does not settle", "use the full model")
    points = np.linalg.norm(model.guides.tracked.weights @ moved, axis=1)
    return RESIDUAL_FACTOR * max(float(points.max()), abs(model.problem.plate_displacement(moved)))


def reduced_within(
    shadow: Shadow, pressure_kpa: float | None, elongation_mm: float | None, tolerance_mm: float
) -> ReducedState:
    """Return the state by the reduced model where its error is within a tolerance, else by the full one.

    Parameters
    ----------
    pressure_kpa, elongation_mm : prescribed; None where it follows.

    Raises
    ------
    RequestError, DataError : as `Shadow.solution`; or the tolerance is no length.
    """
    check_length(tolerance_mm)
    solution, used = shadow.solution(elongation_mm=elongation_mm, pressure_kpa=pressure_kpa)
    if used == "reduced":
        try:
            error_mm = reduced_error_mm(shadow.model, solution, pressure_kpa, elongation_mm)
        except ConvergenceError:  # near a limit of stability the reduced state may lie beyond it
            error_mm = float("inf")
        if error_mm <= tolerance_mm:
            return ReducedState(solution, used, error_mm)
        solution, used = shadow.solution(elongation_mm=elongation_mm, pressure_kpa=pressure_kpa, model="full")
    return ReducedState(solution, used, 0.0)


def table_within(
    parameters: ActuatorParameters, tolerance_mm: float, progress: Progress | None = None
) -> tuple[ReducedModel, TableSettings]:
    """Return the smallest table whose states have an error within a tolerance, and its size.

    Parameters
    ----------
    tolerance_mm : of a tracked point, in 95 % of the states.
    progress : as `load_table`, for each table.

    Raises
    ------
    ToleranceError : no table has so small an error. RequestError : the tolerance is no length.
    """
    check_length(tolerance_mm)
    best = float("inf")
    for pressures, elongations, modes in TABLES:
        settings = TableSettings(pressures, elongations, modes, HELD_OUT)
        found = load_table(parameters, settings, progress=progress)
        if found.errors_mm[-1] <= tolerance_mm:
            return found, settings
        best = min(best, float(found.errors_mm[-1]))
    cause = f"no table has an error below {tolerance_mm:g} mm"
    raise ToleranceError(cause, rounded_up(best), "or more, or use the full model")


def mesh_within(
    parameters: ActuatorParameters, pressures_kpa: Sequence[float], tolerance_mm: float
) -> tuple[ActuatorParameters, float]:
    """Return the actuator on the mesh that the elongations at some pressures take, and their greatest error, mm.

    Parameters
    ----------
    parameters, tolerance_mm : as `solve_within`. pressures_kpa : the ends of a range of states.

    Raises
    ------
    RequestError, DataError : as `solve_within`; a `ToleranceError` allows what can be met at all of the pressures.
    """
    solved: list[ToleratedState] = []
    refused: list[ToleranceError] = []
    for pressure in pressures_kpa:
        try:
            solved.append(solve_within(parameters, pressure, tolerance_mm))
        except ToleranceError as error:
            refused.append(error)
    if refused:
        raise max(refused, key=lambda one: one.allowed_mm)
    return max(solved, key=lambda one: one.elements).model.parameters, max(one.error_mm for one in solved)


def check_length(tolerance_mm: float) -> None:
    """Reject a tolerance that is no length above 0.

    Raises
    ------
    RequestError : it is none.
    """
    if not 0.0 < tolerance_mm < float("inf"):
        raise RequestError(f"a tolerance of {tolerance_mm:g} mm", "give a length above 0 mm")
