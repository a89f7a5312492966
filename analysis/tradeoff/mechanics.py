"""The full model (mesh) and the reduced one (basis), judged at the tracked points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from analysis.shadow.arrays import Floats
from analysis.shadow.charts import MESHES, REFERENCE_MESH, measured_mesh
from analysis.shadow.full_model import FullModel
from analysis.shadow.parameters import ActuatorParameters
from analysis.shadow.reduced import ReducedModel, TableSettings
from analysis.shadow.table import build_table
from analysis.tradeoff.measure import Method, Setting

READING_MM = 0.5 / 12**0.5
"""Standard uncertainty of an elongation that is read on the scale, as METHODS.md of the analysis has it."""
ENDS_KPA = (-40.0, 50.0)
QUICK_MESHES = ((4, 1, 2), (6, 2, 3), (8, 2, 4), (12, 3, 6))
STATES = 256


def _mesh_name(elements: tuple[int, int, int]) -> str:
    return "mesh {} x ({} + {})".format(*elements)


def _default_mesh() -> tuple[int, int, int]:
    p = ActuatorParameters()
    return p.axial_elements, p.wall_elements, p.lattice_elements


def mesh_settings(quick: bool) -> list[Setting]:
    """One call is both ends of the pressure range, each warm-started from 10 kPa short of it."""
    p = ActuatorParameters()
    truth, _, _ = measured_mesh(p, (16, 4, 8) if quick else REFERENCE_MESH, timed=False)
    meshes = QUICK_MESHES if quick else MESHES
    return [Setting(_mesh_name(m), _solver(p, m), lambda found: _farthest(found, truth), work=2) for m in meshes]


def _farthest(found: Floats, truth: Floats) -> float:
    return float(np.linalg.norm(found - truth, axis=-1).max())


def _solver(p: ActuatorParameters, elements: tuple[int, int, int]) -> Callable[[int], Floats]:
    axial, wall, lattice = elements
    model = FullModel(replace(p, axial_elements=axial, wall_elements=wall, lattice_elements=lattice))
    starts = [model.solver.solve(pressure_kpa=0.75 * end) for end in ENDS_KPA]

    def call(_: int) -> Floats:
        found = [model.solver.solve(pressure_kpa=end, start=start) for end, start in zip(ENDS_KPA, starts, strict=True)]
        return np.array([model.tracked(state) for state in found])

    return call


def basis_settings(quick: bool) -> list[Setting]:
    """One call is a batch of states; the error is the table's own, on full solutions that it was not made from."""
    default = TableSettings()
    settings: list[Setting] = []
    for side in (5, 7) if quick else (3, 5, 7):
        chosen = replace(default, pressures=side, elongations=side, held_out=16 if quick else default.held_out)
        table = build_table(settings=chosen)
        shapes = (1, 2, 4, 8) if quick else (1, 2, 3, 4, 6, 8)
        settings += [_table_setting(table.truncated(k), side, k) for k in shapes if k <= len(table.errors_mm)]
    return settings


def _table_setting(table: ReducedModel, side: int, modes: int) -> Setting:
    rng = np.random.default_rng(1)
    (p0, p1), (x0, x1) = table.pressure_range_kpa, table.elongation_range_mm
    p, x = rng.uniform(p0, p1, STATES), rng.uniform(x0, x1, STATES)
    worst = float(table.errors_mm[-1])
    return Setting(_basis_name(side, modes), lambda _: table.tracked(p, x), lambda _: worst, work=STATES)


def _basis_name(side: int, modes: int) -> str:
    return f"{side} x {side} solutions, {modes} shapes"


MESH = Method(
    "full-fem", "Full model: mesh", "a finer mesh (24 x (5 + 10); quick: 16 x (4 + 8)) of the same elements", False,
    "the deviation from the readings: a tenth of the reading error", READING_MM / 10, "mm", "a warm solution",
    lambda f: _mesh_name(f.mesh), mesh_settings,
)  # fmt: skip
BASIS = Method(
    "reduced-fem", "Reduced model: basis", "full solutions that the table was not made from", True,
    "the deviation from the readings: a tenth of the reading error", READING_MM / 10, "mm", "a state",
    lambda f: _basis_name(f.table[0], f.table[2]), basis_settings,
)  # fmt: skip
