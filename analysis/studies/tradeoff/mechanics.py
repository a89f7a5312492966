"""The full model (mesh, integration) against CalculiX, and the reduced one (grid, shapes) against full solutions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial

import numpy as np

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solver
from analysis.shadow.model.full import FullModel, actuator_problem
from analysis.shadow.model.reduced import ReducedModel, TableSettings
from analysis.shadow.model.table import CRITICAL_SHARE, build_table
from analysis.studies.tradeoff.measure import Method, Setting
from analysis.studies.tradeoff.references import load
from protocol.base.arrays import FloatArray

Elements = tuple[int, int, int]
READING_MM = 0.5 / 12**0.5
"""Standard uncertainty of an elongation read on the scale (METHODS.md of the analysis)."""
TRACKED_MM = 3.8e-3
"""0.1 % of the greatest displacement of a tracked point, the reduced model's guarantee."""
MESHES: tuple[Elements, ...] = (
    (4, 1, 2), (6, 1, 3), (6, 2, 3), (8, 2, 4), (10, 2, 5), (12, 2, 5), (12, 3, 6), (16, 4, 8),
)  # fmt: skip
QUICK_MESHES = ((4, 1, 2), (6, 2, 3), (8, 2, 4), (12, 3, 6))
FULL_INTEGRATION: Elements = (8, 2, 4)
_STATES = 256
QUICK_HELD_OUT = 16


def actuator_on(mesh: Elements) -> ActuatorParameters:
    """Return the actuator on a mesh, its two fitted numbers fitted on that mesh."""
    fits = {tuple(row[:3]): row[3:] for row in load("fits")["rows"]}
    axial, wall, lattice = mesh
    modulus, neck = fits[mesh][:2]
    return replace(
        ActuatorParameters(), axial_elements=axial, wall_elements=wall, lattice_elements=lattice,
        wall_modulus_kpa=modulus, neck_radius_mm=neck,
    )  # fmt: skip


def mesh_settings(quick: bool) -> list[Setting]:
    """Return meshes; a call solves from rest to both ends of the pressure range in steps of 10 kPa.

    The error is that of the elongation, root mean square over the states that the fit does not use. A mesh that loses
    its stability so early that the shadow's table does not cover the whole range has no result at its lower end.
    """
    truth = load("calculix")
    pressures, elongations = np.array(truth["pressures_kpa"]), np.array(truth["elongations_mm"])
    free = ~np.isin(pressures, (pressures.min(), pressures.max()))

    def setting(name: str, mesh: Elements, points_a_side: int = 2) -> Setting:
        covers = CRITICAL_SHARE * _critical_kpa(mesh) <= pressures.min()

        def error(found: FloatArray) -> float:
            return float(np.sqrt(np.mean((found - elongations)[free] ** 2))) if covers else float("inf")

        return Setting(name, _walk(mesh, pressures, points_a_side), error, work=len(pressures))

    found = [setting(_mesh_name(mesh), mesh) for mesh in (QUICK_MESHES if quick else MESHES)]
    return [*found, setting(f"{_mesh_name(FULL_INTEGRATION)}, 3 x 3 points", FULL_INTEGRATION, 3)]


def _critical_kpa(mesh: Elements) -> float:
    return float(next(row[5] for row in load("fits")["rows"] if tuple(row[:3]) == mesh))


def _mesh_name(elements: Elements) -> str:
    return "mesh {} x ({} + {})".format(*elements)


def _walk(mesh: Elements, pressures: FloatArray, points_a_side: int) -> Callable[[int], FloatArray]:
    @cache
    def solver() -> Solver:
        model = FullModel(actuator_on(mesh))
        return Solver(actuator_problem(model.parameters, model.mesh, points_a_side))

    def call(_: int) -> FloatArray:
        found, state = [], solver().rest()
        for before, pressure in zip([0.0, *pressures[:-1]], pressures, strict=True):
            start = state if before * pressure >= 0.0 else solver().rest()  # the second walk begins at rest again
            state = solver().solve(pressure_kpa=float(pressure), start=start)
            found.append(state.elongation_mm)
        return np.array(found)

    return call


@cache
def held_out(count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return full solutions with prescribed elongation at states of the rectangle that no table is built from.

    Returns pressures and elongations (n,), tracked points (n, 7, 2).
    """
    table, model = _table(5, 2), FullModel()
    rng = np.random.default_rng(20260101)
    p = np.sort(_between(rng, table.pressure_range_kpa, count))
    x = _between(rng, table.elongation_range_mm, count)
    tracked, state = [], None
    for pressure, elongation in zip(p, x, strict=True):
        state = model.solver.solve(pressure_kpa=float(pressure), elongation_mm=float(elongation), start=state)
        tracked.append(model.tracked(state))
    return p, x, np.array(tracked)


def _between(rng: np.random.Generator, ends: FloatArray, count: int) -> FloatArray:
    return rng.uniform(float(ends[0]), float(ends[1]), count)


@cache
def _table(side: int, held_out: int) -> ReducedModel:
    return build_table(settings=replace(TableSettings(), pressures=side, elongations=side, held_out=held_out))


def basis_settings(quick: bool) -> list[Setting]:
    """Return tables; a call is a batch of states, the error the greatest of a tracked point."""
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
    p, x, truth = held_out(count)
    return float(np.linalg.norm(made().tracked(p, x) - truth, axis=2).max())


def _basis_name(side: int, modes: int) -> str:
    return f"{side} x {side} solutions, {modes} shapes"


MESH = Method(
    "full-fem", "Full model: mesh and integration",
    "CalculiX 2.20, a second program, on 24 x (5 + 10) elements; each mesh is fitted to the same two elongations", True,
    "the deviation from the readings: a tenth of the reading error", READING_MM / 10, "mm", "a solution near the last",
    lambda _: _mesh_name(ActuatorParameters().elements), mesh_settings, one_for_all=True,
)  # fmt: skip
BASIS = Method(
    "reduced-fem", "Reduced model: grid and shapes",
    "full solutions with prescribed elongation, at random states that no table is built from", True,
    "the replay, which guarantees 0.1 % of the full model's tracked points", TRACKED_MM, "mm", "a state",
    lambda _: _basis_name(TableSettings().pressures, TableSettings().modes), basis_settings, one_for_all=True,
)  # fmt: skip
