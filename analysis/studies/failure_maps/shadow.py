"""Where the mechanics breaks down: nearly incompressible, distorted, coarse; the table's edge.

Truth: Lame's thick cylinder; a finer mesh; and for the table the full model.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from analysis.shadow.fem.element import EDGES
from analysis.shadow.fem.material import NeoHookean
from analysis.shadow.fem.mesh import Mesh, check_quality, structured_quads
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.problem import make_problem
from analysis.shadow.fem.solver import Solver
from analysis.shadow.model.frames import Shadow
from analysis.shadow.model.full import FullModel
from analysis.studies.failure_maps.sweep import Axis, Study, StudyResult, joined
from protocol.base.arrays import FloatArray

INNER_MM, OUTER_MM, MODULUS_KPA, LOAD_KPA = 3.0, 9.0, 1000.0, 0.1
_SIDE = 4  # elements across and along the cylinder's wall


def cylinder_mesh(distortion: float) -> Mesh:
    """Mesh a slice of a thick cylinder, its inner corners moved at random by a share of an element."""
    steps = np.linspace(0.0, 1.0, _SIDE + 1)
    r, z = np.meshgrid(INNER_MM * (OUTER_MM / INNER_MM) ** steps, 6.0 * steps)
    moved = distortion * np.random.default_rng(4).uniform(-1.0, 1.0, (2, _SIDE - 1, _SIDE - 1))
    r[1:-1, 1:-1] += moved[0] * np.diff(r, axis=1)[1:-1, :-1]
    z[1:-1, 1:-1] += moved[1] * 6.0 / _SIDE
    quads, used, column = structured_quads(_SIDE, _SIDE)
    places = np.full((*used.shape, 2), np.nan)
    places[::2, ::2] = np.stack([r, z], axis=2)
    places[::2, 1::2] = (places[::2, :-1:2] + places[::2, 2::2]) / 2
    places[1::2, ::2] = (places[:-1:2, ::2] + places[2::2, ::2]) / 2
    nodes = places[used]
    ends = [np.flatnonzero(nodes[:, 1] == end) for end in (0.0, 6.0)]
    return Mesh(nodes, quads, np.zeros(len(quads), dtype=np.int64), quads[column == 0][:, EDGES[3]], *ends)


def cylinder(half_less_nu: float, distortion: float) -> StudyResult:
    """Return the error of the inner radius of Lame's cylinder in plane strain; nu is one half less `half_less_nu`."""
    nu = 0.5 - half_less_nu
    material, mesh = NeoHookean(MODULUS_KPA, nu), cylinder_mesh(distortion)
    check_quality(mesh)
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[:, 1] = np.isin(np.arange(len(mesh.nodes)), [*mesh.base, *mesh.tip])
    moduli = np.tile([material.c10_kpa, material.d1_per_kpa], (len(mesh.quads), 1))
    found = Solver(make_problem(mesh, moduli, fixed=fixed)).solve(pressure_kpa=LOAD_KPA).displacement_mm
    square = INNER_MM**2 / (OUTER_MM**2 - INNER_MM**2)
    exact = (1 + nu) / MODULUS_KPA * LOAD_KPA * square * ((1 - 2 * nu) * INNER_MM + OUTER_MM**2 / INNER_MM)
    return StudyResult(float(np.abs(found[np.unique(mesh.cavity), 0] / exact - 1.0).max()))


@lru_cache(maxsize=16)
def actuator(**values: float) -> FullModel:
    """Return an actuator, cached with its limits."""
    return FullModel(ActuatorParameters(**values))  # type: ignore[arg-type]


def coarse(axial: float, across: float) -> StudyResult:
    """Return the error of the tracked points at -40 and 50 kPa on a coarse mesh against a fine one, mm."""
    wall = max(1, round(across / 2))
    model = actuator(axial_elements=int(axial), wall_elements=wall, lattice_elements=int(across))
    error = float(np.linalg.norm(_tracked(model) - _fine(), axis=-1).max())
    return StudyResult(error, joined([warning.text for warning in model.warnings]))


def _tracked(model: FullModel) -> FloatArray:
    return np.array([model.tracked(model.solver.solve(pressure_kpa=p)) for p in (-40.0, 50.0)])


@lru_cache(maxsize=1)
def _fine() -> FloatArray:
    return _tracked(FullModel(ActuatorParameters(axial_elements=16, wall_elements=4, lattice_elements=8)))


@lru_cache(maxsize=1)
def shadow() -> Shadow:
    """Return the default actuator with its table."""
    return Shadow()


def edge(pressure_kpa: float, elongation_mm: float) -> StudyResult:
    """Return the error of the tracked points near the edge of the table against the full model, mm."""
    state, model = shadow().state(pressure_kpa=pressure_kpa, elongation_mm=elongation_mm), shadow().model
    full = model.solve(pressure_kpa=pressure_kpa, elongation_mm=elongation_mm)
    drawn = model.guides.tracked.positions(state.nodes_mm - model.mesh.nodes)
    error = np.linalg.norm(drawn - model.tracked(full), axis=1).max()
    fell_back = "outside the table: the full model answered" if state.model == "full" else ""
    return StudyResult(float(error), fell_back)


SHADOW_STUDIES = (
    Study(
        "fem-incompressible", "full-fem", "Nearly incompressible, on a distorted mesh", "Lame's thick cylinder",
        "of the inner radius' growth", 5e-3,
        Axis("one half less Poisson's ratio", "", (0.5, 0.2, 0.01, 1e-3, 1e-4, 1e-5, 2e-6, 1e-7, 1e-12, 0.0)),
        Axis("corners moved by, of an element", "", (0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8)), cylinder,
    ),
    Study(
        "fem-coarse", "full-fem", "Too coarse a mesh", "a mesh of 16 x (4 + 8)", "mm", 0.05,
        Axis("elements along a bladder", "", (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0)),
        Axis("elements across the lattice", "", (1.0, 2.0, 3.0, 4.0, 6.0)), coarse,
    ),
    Study(
        "reduced-edge", "reduced-fem", "The edge of the table", "the full model", "mm", 3.8e-3,
        Axis("pressure", "kPa", (-60.0, -44.0, -43.0, -41.0, -40.0, -20.0, 0.0, 30.0, 50.0, 54.9, 55.1, 60.0, 90.0)),
        Axis("elongation", "mm", (-6.0, -4.0, -3.6, -3.4, -2.0, 0.0, 2.0, 4.0, 4.7, 5.0, 7.0)), edge,
    ),
)  # fmt: skip
