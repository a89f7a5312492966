"""Equilibrium against closed forms, exact states, order of convergence and the balance of energy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.shadow.fem import pressure
from analysis.shadow.fem.material import NeoHookean
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solution, Solver
from analysis.shadow.model.full import FullModel
from protocol.base.errors import ConvergenceError
from tests.analysis.shadow.solids import (
    cylinder,
    cylinder_pressure,
    lame_displacement,
    mapped_mesh,
    solid,
    sphere,
    sphere_pressure,
)


def patch_error(sheared: float, bent: float, points_a_side: int) -> float:
    """Greatest error, mm, of inner nodes whose boundary follows a homogeneous deformation."""

    def place(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        wave = bent * np.sin(np.pi * s) * np.sin(np.pi * t)
        return 5 + 3 * s + sheared * t + wave, 4 * t + wave

    mesh = mapped_mesh(place, 4, 4)
    corners = mesh.nodes[mesh.quads[:, :4]]
    mesh.nodes[mesh.quads[:, 4:]] = (corners + np.roll(corners, -1, axis=1)) / 2  # straight edges
    s, t = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9))
    used = np.ones(s.shape, dtype=bool)
    used[1::2, 1::2] = False
    rim = ((s == 0) | (s == 1) | (t == 0) | (t == 1))[used]
    problem = solid(mesh, NeoHookean(100.0, 0.4), np.repeat(rim[:, None], 2, axis=1), points_a_side)
    exact = mesh.nodes * (0.13, -0.08)
    shaken = exact + 0.02 * np.random.default_rng(5).standard_normal(exact.shape)
    start = Solution(np.where(rim[:, None], exact, shaken), 0.0, 0.0, 0.0, 0, 0.0)
    found = Solver(problem, 1e-14).solve(pressure_kpa=0.0, start=start)
    return float(np.abs(found.displacement_mm - exact).max())


def test_patch_test_of_affine_elements() -> None:
    """A homogeneous stretch is exact to 1e-12 with reduced integration on parallelograms."""
    assert patch_error(0.7, 0.0, 2) < 1e-12


@pytest.mark.parametrize("points_a_side", [2, 3])
def test_patch_test_of_distorted_elements(points_a_side: int) -> None:
    """And on distorted straight-sided elements, with reduced and with full integration."""
    assert patch_error(0.7, 0.3, points_a_side) < 1e-12


@pytest.mark.parametrize(("nu", "expected"), [(0.49, 5.0399e-3), (0.499, 5.0602e-3), (0.4999, 5.0623e-3)])
def test_thick_cylinder_does_not_lock(nu: float, expected: float) -> None:
    """Inner displacement within 0.5 % of Lame's (a = 3, b = 9, E = 1000, p = 1) as nu goes to one half."""
    mesh, problem = cylinder(3.0, 9.0, 4, NeoHookean(1000.0, nu))
    load = 1e-3  # small, so that the finite-strain answer is the linear one
    u = Solver(problem).solve(pressure_kpa=load).displacement_mm[mesh.cavity[0, 0], 0] / load
    assert u == pytest.approx(expected, rel=5e-3)
    assert lame_displacement(np.array(3.0), 3.0, 9.0, (1.0, 1000.0, nu)) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("inner_now", [1.1, 1.5, 2.0])
def test_inflated_cylinder(inner_now: float) -> None:
    """A nearly incompressible neo-Hookean cylinder follows the closed form to 0.2 % up to twice its radius."""
    mu = 1.0
    mesh, problem = cylinder(1.0, 2.0, 6, NeoHookean(2 * mu * 1.49999, 0.49999))
    p = cylinder_pressure(inner_now, 1.0, 2.0)
    assert p == pytest.approx({1.1: 0.131562, 1.5: 0.428228, 2.0: 0.574054}[inner_now], rel=2e-4)
    found = Solver(problem).solve(pressure_kpa=p * mu)
    reached = 1.0 + found.displacement_mm[mesh.cavity[0, 0], 0]
    assert cylinder_pressure(reached, 1.0, 2.0) == pytest.approx(p, rel=2e-3)


@pytest.mark.parametrize("inner_now", [1.1, 1.5, 2.0])
def test_inflated_sphere(inner_now: float) -> None:
    """The same for a sphere, whose curved elements run into the axis."""
    mu = 1.0
    mesh, problem = sphere(1.0, 2.0, 6, NeoHookean(2 * mu * 1.4999, 0.4999))
    p = sphere_pressure(inner_now, 1.0, 2.0)
    assert p == pytest.approx({1.1: 0.287155, 1.5: 0.755433, 2.0: 0.806927}[inner_now], rel=2e-4)
    found = Solver(problem).solve(pressure_kpa=p * mu)
    reached = 1.0 + found.displacement_mm[mesh.base[0], 0]
    assert sphere_pressure(reached, 1.0, 2.0) == pytest.approx(p, rel=2e-3)


def test_where_incompressibility_breaks_the_elements() -> None:
    """Past nu = 0.4999 a strongly stretched sphere loses its tangent to the mesh: refused, never a wrong number."""
    _, problem = sphere(1.0, 2.0, 6, NeoHookean(3.0, 0.49999))
    with pytest.raises(ConvergenceError, match="positive definite"):
        Solver(problem).solve(pressure_kpa=0.75)


def test_observed_order_of_convergence() -> None:
    """Displacements of quadratic elements converge with order 3 or better on Lame's cylinder."""
    load, errors = (1e-5, 1000.0, 0.3), []
    for across in (2, 4, 8):
        mesh, problem = cylinder(1.0, 3.0, across, NeoHookean(*load[1:]))
        found = Solver(problem, 1e-13).solve(pressure_kpa=load[0]).displacement_mm[:, 0]
        exact = lame_displacement(mesh.nodes[:, 0], 1.0, 3.0, load)
        errors.append(np.abs(found - exact).max() / np.abs(exact).max())
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert (orders > 2.9).all(), orders


def test_energy_balance(actuator: FullModel) -> None:
    """The work of the pressure over the way, integral of p dV, is the energy that the solid has stored."""
    x, w = np.polynomial.legendre.leggauss(8)
    problem, work, state = actuator.problem, 0.0, None
    volumes, pressures = [], np.concatenate([[0.0], 25 * (x + 1), [50.0]])
    for p in pressures:
        state = actuator.solve(pressure_kpa=float(p), start=state)
        volumes.append(pressure.cavity_volume(problem.nodes, state.displacement_mm, problem.cavity))
    inner = np.array(volumes[1:-1])
    work = 50.0 * volumes[-1] - 25.0 * float(w @ inner)  # by parts: p V - integral of V dp
    assert state is not None
    assert work == pytest.approx(problem.potential(state.displacement_mm, 0.0), rel=1e-9)


def test_held_plate_reads_the_force_of_the_potential(actuator: FullModel) -> None:
    """With pressure and elongation held, the plate's force is the derivative of the potential by elongation."""
    step = 1e-3
    states = [actuator.solve(pressure_kpa=30.0, elongation_mm=1.0 + s * step) for s in (-1, 0, 1)]
    low, high = (actuator.problem.potential(states[i].displacement_mm, 30.0) for i in (0, 2))
    assert states[1].tip_force_mn == pytest.approx((high - low) / (2 * step), rel=1e-5)


def test_pressure_and_elongation_control_agree(actuator: FullModel) -> None:
    """Holding the elongation that a pressure gave returns that pressure, and needs no force."""
    first = actuator.solve(pressure_kpa=-30.0)
    assert actuator.solve(elongation_mm=first.elongation_mm).pressure_kpa == pytest.approx(-30.0, rel=1e-8)
    both = actuator.solve(pressure_kpa=-30.0, elongation_mm=first.elongation_mm)
    assert abs(both.tip_force_mn) < 1e-4


@settings(max_examples=15, deadline=None)
@given(st.floats(-40.0, 50.0), st.floats(-40.0, 50.0))
def test_a_warm_start_finds_the_cold_state(first: float, then: float) -> None:
    """Wherever it starts from, the state at a pressure is the same."""
    model = FullModel(ActuatorParameters(cells=2, axial_elements=6, wall_elements=1, lattice_elements=3))
    cold = model.solver.solve(pressure_kpa=then)
    warm = model.solver.solve(pressure_kpa=then, start=model.solver.solve(pressure_kpa=first))
    np.testing.assert_allclose(warm.displacement_mm, cold.displacement_mm, atol=1e-6)


def test_missing_equilibrium_is_an_error(actuator: FullModel) -> None:
    """A load without a stable state ends in an error that names the last state reached, not in a wrong number."""
    with pytest.raises(ConvergenceError) as failure:
        Solver(actuator.problem).solve(pressure_kpa=-400.0)
    assert "kPa" in failure.value.cause
    assert failure.value.remedy
