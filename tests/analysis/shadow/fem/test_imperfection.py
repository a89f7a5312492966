"""Imperfect prints: closed forms of a ring, and the direct solution as the second method."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest

from analysis.errors import ConvergenceError
from analysis.shadow.fem.band import factorise
from analysis.shadow.fem.harmonics import Harmonics, make_harmonics
from analysis.shadow.fem.imperfection import (
    LARGEST_REMAINDER,
    OvalGrowth,
    direct_growth,
    oval_growth,
    worst_imperfection,
)
from analysis.shadow.fem.material import NeoHookean
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solver
from analysis.shadow.fem.stability import Stability
from analysis.shadow.model.full import FullModel
from tests.analysis.shadow.solids import mapped_mesh, solid


class Ring(NamedTuple):
    """A long thin tube in plane strain, its mean radius, and the pressure at which it goes oval."""

    stability: Stability
    radius_mm: float
    critical_kpa: float


@pytest.fixture(scope="module")
def ring() -> Ring:
    """R/t = 50, under vacuum."""
    inner, thick = 50.0, 1.0
    mesh = mapped_mesh(lambda s, t: (inner + thick * s, 5 * t), 2, 1)
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[:, 1] = True
    problem = solid(mesh, NeoHookean(1e6, 0.3), fixed)
    free = make_harmonics(problem, np.zeros(len(mesh.nodes), dtype=bool))
    flat = np.where(np.arange(3) == 2, -1, free.equations)
    order = np.full(free.size + 1, -1)
    order[np.unique(flat[flat >= 0])] = np.arange(2 * len(mesh.nodes))
    stability = Stability(problem, Harmonics(problem, order[flat], 2 * len(mesh.nodes), free.bandwidth))
    low, high = 0.0, 3.0
    for _ in range(30):
        middle = (low + high) / 2
        u = Solver(problem).solve(pressure_kpa=-middle).displacement_mm
        stable = factorise(stability.harmonics.tangent(u, -middle, 2)) == stability.harmonics.size
        low, high = (middle, high) if stable else (low, middle)
    return Ring(stability, inner + thick / 2, low)


def grown(ring: Ring, share: float) -> OvalGrowth:
    """The expansion at a share of the critical pressure."""
    solver = Solver(ring.stability.problem)
    near = solver.solve(pressure_kpa=-0.9999 * ring.critical_kpa)
    imperfection = worst_imperfection(ring.stability, near, 2)
    state = solver.solve(pressure_kpa=-share * ring.critical_kpa)
    return oval_growth(ring.stability, state, imperfection, held=False)


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_an_oval_ring_grows_as_timoshenko_has_it(ring: Ring, share: float) -> None:
    """By p / (pc - p) of its error (Timoshenko and Gere 1961, 7.5), within 2 %."""
    assert grown(ring, share).gain == pytest.approx(share / (1 - share), rel=0.02)


def test_a_ring_stiffens_after_buckling_as_carrier_has_it(ring: Ring) -> None:
    """p / pc = 1 + 27/32 (w / R)^2 under a pressure that follows the surface (Budiansky 1974), within 2 %."""
    share = 0.998
    found = grown(ring, share)
    b = found.b_per_mm2 * (1.0 - share) / found.gain**2 * ring.radius_mm**2
    assert b == pytest.approx(27.0 / 32.0, rel=0.02)


def test_an_error_collapses_where_koiters_cubic_has_no_root() -> None:
    """e^2 = -4 / (27 b): just below there is a growth, just above none; b = 0 and b > 0 never collapse."""
    expansion = OvalGrowth(gain=2.0, b_per_mm2=-4.0, third_per_mm2=0.0, second_per_mm=0.0)
    most = math.sqrt(4.0 / 27.0 / 4.0)
    assert expansion.growth_mm(0.999 * most) == pytest.approx(3.0 * most, rel=0.05)  # xi = 3 e / 2 at the turn
    assert math.isnan(expansion.growth_mm(1.001 * most))
    assert OvalGrowth(2.0, 0.0, 0.0, 0.0).growth_mm(0.1) == pytest.approx(0.2)
    assert OvalGrowth(2.0, 100.0, 0.0, 0.0).multiplier_mm(0.3) == pytest.approx(0.12134, abs=1e-5)


SMALL = ActuatorParameters(cells=2, axial_elements=4, wall_elements=1, lattice_elements=2)


def test_the_expansion_agrees_with_a_direct_solution() -> None:
    """At 95 % of the critical pressure, an error of 0.01 mm, within 0.1 %; the linear response is off by more."""
    model = FullModel(SMALL)
    state = model.solver.solve(pressure_kpa=0.95 * model.vacuum_limit.pressure_kpa)
    assert model.imperfection is not None
    found = oval_growth(model.stability, state, model.imperfection, held=False)
    direct = direct_growth(model.stability, state, model.imperfection, 0.01)
    assert found.growth_mm(0.01) == pytest.approx(direct, rel=1e-3)
    assert abs(found.gain * 0.01 - direct) > 50.0 * abs(found.growth_mm(0.01) - direct)


def test_the_expansion_agrees_with_a_direct_solution_near_rest() -> None:
    """At 0.3 kPa, where the response is below 1 % of the error, an error of 0.2 mm, within 0.1 %."""
    model = FullModel(SMALL)
    state = model.solver.solve(pressure_kpa=0.3)
    assert model.imperfection is not None
    found = oval_growth(model.stability, state, model.imperfection, held=False)
    direct = direct_growth(model.stability, state, model.imperfection, 0.2)
    assert found.growth_mm(0.2) == pytest.approx(direct, rel=1e-3)


def test_growth_near_rest_is_proportional_to_pressure() -> None:
    """From 1e-6 to 0.1 kPa, of either sign, within 1 % of the mean at 0.3 kPa; without a warning."""
    model = FullModel(SMALL)
    assert model.imperfection is not None

    def growth(pressure_kpa: float) -> float:
        state = model.solver.solve(pressure_kpa=pressure_kpa)
        assert model.imperfection is not None
        found = oval_growth(model.stability, state, model.imperfection, held=False)
        assert found.remainder(0.2) < LARGEST_REMAINDER
        return found.growth_mm(0.2)

    each_kpa = (growth(0.3) - growth(-0.3)) / 0.6
    for pressure in (1e-6, 1e-5, 1e-4, 1e-3, 0.01, 0.1):
        for signed in (pressure, -pressure):
            assert growth(signed) == pytest.approx(each_kpa * signed, rel=0.01)


@pytest.mark.parametrize("held", [False, True])
def test_nothing_grows_at_rest(held: bool) -> None:
    """The imperfect shape is free of stress: no growth, and no error of the expansion."""
    model = FullModel(SMALL)
    assert model.imperfection is not None
    found = oval_growth(model.stability, model.solver.solve(pressure_kpa=0.0), model.imperfection, held=held)
    assert (found.gain, found.growth_mm(0.2), found.remainder(0.2)) == (0.0, 0.0, 0.0)


def test_an_unstable_state_has_no_growth() -> None:
    """Of the perfect shape, beyond its critical pressure, the expansion is refused by name."""
    model = FullModel(SMALL)
    state = model.solver.solve(pressure_kpa=1.05 * model.vacuum_limit.pressure_kpa)
    assert model.imperfection is not None
    with pytest.raises(ConvergenceError, match="not stable"):
        oval_growth(model.stability, state, model.imperfection, held=False)


@pytest.mark.nightly
@pytest.mark.parametrize(("pressure_kpa", "error_mm"), [(-42.0, 0.01), (-43.5, 0.01)])
def test_the_papers_actuator_agrees_with_a_direct_solution(
    actuator: FullModel, pressure_kpa: float, error_mm: float
) -> None:
    """Growth of the solution of the whole series: within 0.1 % at 0.2 mm, 1 % at 0.5 mm, warned."""
    state = actuator.solver.solve(pressure_kpa=pressure_kpa)
    assert actuator.imperfection is not None
    found = oval_growth(actuator.stability, state, actuator.imperfection, held=False)
    direct = direct_growth(actuator.stability, state, actuator.imperfection, error_mm)
    assert (found.remainder(error_mm) < LARGEST_REMAINDER) == (direct < 0.2)
    assert found.growth_mm(error_mm) == pytest.approx(direct, rel=1e-3 if direct < 0.2 else 0.01)
