"""The full model (mesh, integration) against CalculiX, and the reduced one (grid, shapes) against full solutions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np

from analysis.shadow.fem.mesh import build_mesh
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solution, Solver
from analysis.shadow.model.full import FullModel, actuator_problem
from analysis.shadow.model.reduced import ReducedModel, TableSettings
from analysis.shadow.model.table import build_table
from analysis.studies.tradeoff.measure import Method, Setting
from analysis.studies.tradeoff.references import load
from protocol.base.arrays import FloatArray

Elements = tuple[int, int, int]
READING_MM = 0.5 / 12**0.5  # standard uncertainty of an elongation read on the scale (METHODS.md of the analysis)
TRACKED_MM = 3.8e-3  # 0.1 % of the greatest displacement of a tracked point, the reduced model's guarantee
DEFAULT: Elements = ActuatorParameters().elements
MESHES: tuple[Elements, ...] = (
    (4, 1, 2), (6, 2, 3), (8, 2, 4), (12, 2, 4), (12, 3, 6), DEFAULT, (24, 2, 4), (16, 4, 8),
)  # fmt: skip
QUICK_MESHES = ((4, 1, 2), (8, 2, 4), DEFAULT)
_STATES = 256
QUICK_HELD_OUT = 16


def mesh_settings(quick: bool) -> list[Setting]:
    """Return meshes; a call solves from rest to both ends of the pressure range in steps of 10 kPa.

    The error is the greatest of the elongation; the reference and all meshes have the same actuator.
    """
    truth = load("calculix")
    pressures, elongations = np.array(truth["pressures_kpa"]), np.array(truth["elongations_mm"])
    given = replace(
        ActuatorParameters(), wall_modulus_kpa=truth["wall_modulus_kpa"], neck_radius_mm=truth["neck_radius_mm"]
    )

    def error(found: FloatArray) -> float:
        return float(np.abs(found - elongations).max())

    def setting(name: str, mesh: Elements, points_a_side: int = 2) -> Setting:
        along, wall, lattice = mesh
        actuator = replace(given, axial_elements=along, wall_elements=wall, lattice_elements=lattice)
        return Setting(name, _walk(actuator, pressures, points_a_side), error, work=len(pressures))

    found = [setting(_mesh_name(mesh), mesh) for mesh in (QUICK_MESHES if quick else MESHES)]
    return [*found, setting(f"{_mesh_name(DEFAULT)}, 3 x 3 points", DEFAULT, 3)]


def _mesh_name(elements: Elements) -> str:
    return "mesh {} x ({} + {})".format(*elements)


def _walk(actuator: ActuatorParameters, pressures: FloatArray, points_a_side: int) -> Callable[[int], FloatArray]:
    @cache
    def solver() -> Solver:
        return Solver(actuator_problem(actuator, build_mesh(actuator), points_a_side))

    def call(_: int) -> FloatArray:
        found, state = [], solver().rest()
        for before, pressure in zip([0.0, *pressures[:-1]], pressures, strict=True):
            start = state if before * pressure >= 0.0 else solver().rest()  # the second walk begins at rest again
            state = solver().solve(pressure_kpa=float(pressure), start=start)
            found.append(state.elongation_mm)
        return np.array(found)

    return call


@cache
def held_out(count: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return full solutions with prescribed elongation at states of the rectangle that no table is built from.

    Returns pressures and elongations (n,), tracked points (n, 7, 2) and forces on the plate (n,).
    """
    table, model = _table(5, 2), FullModel()
    rng = np.random.default_rng(20260101)
    p = np.sort(_between(rng, table.pressure_range_kpa, count))
    x = _between(rng, table.elongation_range_mm, count)
    states: list[Solution] = []
    for pressure, elongation in zip(p.tolist(), x.tolist(), strict=True):
        start = states[-1] if states else None
        states.append(model.solver.solve(pressure_kpa=pressure, elongation_mm=elongation, start=start))
    return p, x, np.array([model.tracked(one) for one in states]), np.array([one.tip_force_mn for one in states])


@cache
def _stiffness() -> float:
    """Return the actuator's stiffness along its axis, mN/mm."""
    return FullModel().solver.solve(pressure_kpa=0.0, elongation_mm=1.0).tip_force_mn


def _between(rng: np.random.Generator, ends: FloatArray, count: int) -> FloatArray:
    return rng.uniform(float(ends[0]), float(ends[1]), count)


@cache
def _table(side: int, held_out: int) -> ReducedModel:
    return build_table(settings=replace(TableSettings(), pressures=side, elongations=side, held_out=held_out))


def basis_settings(quick: bool) -> list[Setting]:
    """Return tables; a call is a batch of states, the error the greatest of a tracked point or of the force."""
    count = QUICK_HELD_OUT if quick else 64
    sides, modes = ((5, 7), (1, 2, 4, 8)) if quick else ((3, 5, 7, 9), (1, 2, 3, 4, 6, 8))
    made = {(side, k): cache(partial(_truncated, side, k)) for side in sides for k in modes}
    return [
        Setting(_basis_name(*size), _batch(table), partial(_farthest, table, count), work=_STATES)
        for size, table in made.items()
    ]


def _truncated(side: int, modes: int) -> ReducedModel:
    return _table(side, 2).truncated(modes)


def _batch(made: Callable[[], ReducedModel]) -> Callable[[int], ReducedModel]:
    @cache
    def states() -> tuple[FloatArray, FloatArray]:
        rng, table = np.random.default_rng(1), made()
        return _between(rng, table.pressure_range_kpa, _STATES), _between(rng, table.elongation_range_mm, _STATES)

    def call(_: int) -> ReducedModel:
        made().tracked(*states())
        return made()

    return call


def _farthest(made: Callable[[], ReducedModel], count: int, _: ReducedModel) -> float:
    p, x, points, forces = held_out(count)
    off_mn = [made().displacement(*state)[1] - force for *state, force in zip(p, x, forces, strict=True)]
    off_mm = np.linalg.norm(made().tracked(p, x) - points, axis=2)
    return max(float(off_mm.max()), float(np.abs(off_mn).max()) / _stiffness())


def _basis_name(side: int, modes: int) -> str:
    return f"{side} x {side} solutions, {modes} shapes"


MESH = Method(
    "full-fem", "Full model: mesh and integration",
    "CalculiX 2.20, a second program, of the same actuator on 24 x (5 + 10) elements", True,
    "the deviation from the readings: a tenth of the reading error", READING_MM / 10, "mm", "a solution near the last",
    lambda _: _mesh_name(DEFAULT), mesh_settings, one_for_all=True,
)  # fmt: skip
BASIS = Method(
    "reduced-fem", "Reduced model: grid and shapes",
    "full solutions with prescribed elongation, at random states that no table is built from", True,
    "the replay, which guarantees 0.1 % of the full model's tracked points", TRACKED_MM, "mm",
    f"a state, {_STATES} at once",
    lambda _: _basis_name(TableSettings().pressures, TableSettings().modes), basis_settings, one_for_all=True,
)  # fmt: skip
