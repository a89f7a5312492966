"""Shape functions, assembled forces and tangents, against differences and against scikit-fem."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.shadow.fem import element
from analysis.shadow.fem.band import empty_band
from analysis.shadow.fem.mesh import build_mesh
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.problem import Problem
from analysis.shadow.model.full import actuator_problem
from tests.analysis.shadow.solids import dense
from tests.verification.scikit_fem import make_scikit_fem_problem


@pytest.fixture(scope="module")
def small() -> Problem:
    """One bladder, coarsely meshed."""
    chosen = ActuatorParameters(cells=1, axial_elements=3, wall_elements=1, lattice_elements=2)
    return actuator_problem(chosen, build_mesh(chosen))


def shaken(problem: Problem) -> np.ndarray:
    """Small random displacements that invert nothing."""
    return 0.05 * np.random.default_rng(3).standard_normal(problem.nodes.shape)


def force_of(problem: Problem, u: np.ndarray) -> np.ndarray:
    force = np.zeros_like(u)
    element.internal_force(problem.elements, u, force)
    return force


def full_tangent(problem: Problem, u: np.ndarray) -> np.ndarray:
    """The tangent over all displacements as a dense symmetric matrix."""
    size = u.size
    band = empty_band(size, size - 1)
    numbers = np.arange(size).reshape(u.shape)
    element.internal_tangent(problem.elements, u, numbers, band)
    return dense(band)


def test_shape_functions_reproduce_quadratics() -> None:
    """They sum to one, are one at their own node, and carry 1, x, y, xy, x2, y2, x2y, xy2 exactly, with derivatives."""
    nodes = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [0, -1], [1, 0], [0, 1], [-1, 0]], dtype=float)
    np.testing.assert_allclose(element.shape(*nodes.T)[0], np.eye(8), atol=1e-15)
    x, y = np.random.default_rng(0).uniform(-1, 1, (2, 20))
    value, along, across = element.shape(x, y)
    for i, j in [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 1), (1, 2)]:
        at_nodes = nodes[:, 0] ** i * nodes[:, 1] ** j
        np.testing.assert_allclose(value @ at_nodes, x**i * y**j, atol=1e-14)
        np.testing.assert_allclose(along @ at_nodes, i * x ** max(i - 1, 0) * y**j, atol=1e-14)
        np.testing.assert_allclose(across @ at_nodes, x**i * j * y ** max(j - 1, 0), atol=1e-14)


def test_weights_sum_to_the_volume() -> None:
    """A straight tube in its lattice has the volume of a hollow cylinder."""
    chosen = ActuatorParameters(neck_radius_mm=6.0, belly_radius_mm=6.0)
    problem = actuator_problem(chosen, build_mesh(chosen))
    assert problem.elements.weight.sum() == pytest.approx(np.pi * (25.0**2 - 6.0**2) * 75.0, rel=1e-13)


def test_force_is_the_derivative_of_energy(small: Problem) -> None:
    """dW/du by central differences in random directions."""
    u, rng = shaken(small), np.random.default_rng(1)
    for _ in range(5):
        way, step = rng.standard_normal(u.shape), 1e-6
        energies = [element.internal_energy(small.elements, u + s * step * way) for s in (1, -1)]
        assert (force_of(small, u) * way).sum() == pytest.approx((energies[0] - energies[1]) / 2 / step, rel=1e-6)


def test_force_and_tangent_are_those_of_scikit_fem(small: Problem) -> None:
    """A second assembly, from other code, of the same weak form."""
    u, scikit_fem = shaken(small), make_scikit_fem_problem(small)
    other_force, other_tangent = scikit_fem.internal_force(u), scikit_fem.internal_tangent(u).toarray()
    np.testing.assert_allclose(force_of(small, u), other_force, rtol=0, atol=1e-11 * np.abs(other_force).max())
    ours = full_tangent(small, u)
    np.testing.assert_allclose(ours, other_tangent, rtol=0, atol=1e-12 * np.abs(ours).max())


@pytest.mark.fault(46, how="an element turned inside out", times=1)
def test_an_inverted_element_is_detected(small: Problem) -> None:
    """J <= 0 gives infinite energy and a smallest J that is not positive, not a NaN."""
    u = np.zeros_like(small.nodes)
    u[small.elements.quads[0, 2]] = (-30.0, -30.0)
    assert element.internal_energy(small.elements, u) == np.inf
    assert not small.balance(u, 0.0).smallest_j > 0.0
