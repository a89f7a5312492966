"""As fine a mesh as an error of the elongation takes: a hierarchy of meshes, and the estimate that it gives.

Strategy: the same state is solved on meshes of 4 k x (k + 2 k) elements, k = 1, 2, ... The change from one mesh to the
next, with the second order that the elements show, estimates the error that is left (Richardson; Roache, Annu. Rev.
Fluid Mech. 29, 1997, 123). Where the error changes its sign between two meshes that change is small by chance, so an
estimate never falls below a quarter of what the one before leads to. A factor makes it hold for the worst actuator that
a search found. The answer is that of the last mesh.

Rules: the error is that of the discretisation, for the parameters as given: not of the moduli, nor of the model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from analysis.errors import ConvergenceError, RequestError
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solution
from analysis.shadow.model.full import FullModel, check_values

ORDER = 2.0
LEAST_OF_LAST = 0.25
"""Part of the estimate before, carried on by the order, below which an estimate does not fall."""
CALIBRATED = {2: 1.0, 3: 1.6, 4: 1.35}
"""Factor on that estimate, by mesh, which contains the error of the worst actuator that a search found; finer meshes as
the last."""
FINEST = 6


@dataclass(frozen=True, slots=True)
class ToleratedState:
    """A state with the error that its elongation has.

    Parameters
    ----------
    model, solution : on the mesh that was fine enough.
    error_mm, tolerance_mm : estimated, and asked for.
    elements : of the mesh: along a cell, across the wall, across the lattice.
    """

    model: FullModel
    solution: Solution
    error_mm: float
    tolerance_mm: float
    elements: tuple[int, int, int]


def mesh_of(level: int) -> tuple[int, int, int]:
    """Return the elements of a mesh of the hierarchy: along a cell, across the wall, across the lattice."""
    return 4 * level, level, 2 * level


def error_estimates(elongations_mm: list[float], first: int = 1) -> list[float]:
    """Return the estimated errors of elongations on meshes that follow each other, from the second on.

    Parameters
    ----------
    elongations_mm : on the meshes. first : number of the first one.
    """
    found: list[float] = []
    for i in range(1, len(elongations_mm)):
        finer = ((first + i) / (first + i - 1)) ** ORDER
        own = abs(elongations_mm[i] - elongations_mm[i - 1]) / (finer - 1.0)
        found.append(max(own, LEAST_OF_LAST * found[-1] / finer) if found else own)
    last = max(CALIBRATED)
    return [CALIBRATED[min(first + i, last)] * estimate for i, estimate in enumerate(found, start=1)]


def solve_within(parameters: ActuatorParameters, pressure_kpa: float, tolerance_mm: float) -> ToleratedState:
    """Solve the state at a pressure on no finer a mesh than an error of its elongation takes.

    Parameters
    ----------
    parameters : of the actuator; the elements of its mesh are chosen.
    pressure_kpa : in the bladders.
    tolerance_mm : of the elongation.

    Raises
    ------
    RequestError : the tolerance cannot be met, or the state lies beyond the limit of stability. DataError : no number.
    """
    check_values(pressure_kpa, None)
    if not 0.0 < tolerance_mm < float("inf"):
        raise RequestError(f"a tolerance of {tolerance_mm:g} mm", "give a length above 0 mm")
    found: list[float] = []
    first, best = 1, float("inf")
    for level in range(1, FINEST + 1):
        along, wall, lattice = elements = mesh_of(level)
        mesh = replace(parameters, axial_elements=along, wall_elements=wall, lattice_elements=lattice)
        model = FullModel(mesh)
        try:
            solution = model.solver.solve(pressure_kpa=pressure_kpa)
        except ConvergenceError:  # a coarse mesh may lose its stability before
            found, first = [], level + 1
            continue
        found.append(solution.elongation_mm)
        estimates = error_estimates(found, first)
        if estimates and estimates[-1] <= tolerance_mm:
            model.check_limits(pressure_kpa, None)
            return ToleratedState(model, solution, estimates[-1], tolerance_mm, elements)
        best = min([best, *estimates[-1:]])
    if not found:
        model.check_limits(pressure_kpa, None)
    cause = f"an error of {tolerance_mm:g} mm takes a finer mesh than {' x '.join(map(str, elements))} elements"
    raise RequestError(cause, f"allow {best:.2g} mm or more")
