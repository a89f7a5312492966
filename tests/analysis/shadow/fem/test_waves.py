"""Forces of waves of finite size: against the tangents of small ones, and rigid motion."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.shadow.fem.harmonics import make_harmonics
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.waves import Waves
from analysis.shadow.model.full import FullModel
from tests.analysis.shadow.solids import dense

COARSE = ActuatorParameters(cells=2, axial_elements=4, wall_elements=1, lattice_elements=2)


@pytest.mark.parametrize(("order", "n"), [(1, 2), (2, 4)])
def test_small_waves_have_the_stiffness_of_the_harmonics(order: int, n: int) -> None:
    """Two derivations of one second variation: by hand around the circle, and of forces in three dimensions."""
    model = FullModel(COARSE)
    state = model.solver.solve(pressure_kpa=-20.0)
    harmonics = model.stability.harmonics
    waves, u = Waves(harmonics, 2), np.zeros((3, len(model.mesh.nodes), 3))
    u[0, :, ::2] = state.displacement_mm
    perfect = np.zeros_like(u[0])
    assert np.abs(waves.force(u, -20.0, perfect)[0]).max() < 1e-6  # the same equilibrium
    v = np.random.default_rng(0).standard_normal(harmonics.size)
    step = np.zeros_like(u)
    step[order] = 1e-5 * waves.spread(v)
    there, back = (waves.force(u + sign * step, -20.0, perfect)[order] for sign in (1.0, -1.0))
    expected = dense(harmonics.tangent(state.displacement_mm, -20.0, n)) @ v
    np.testing.assert_allclose((there - back) / 2e-5, expected, atol=1e-7 * np.abs(expected).max())


def test_a_shift_of_any_size_and_an_imperfect_shape_at_rest_need_no_force() -> None:
    """Sideways by 3 mm without pressure; an oval of 1 mm that is free of stress."""
    model = FullModel(COARSE)
    nodes = len(model.mesh.nodes)
    waves = Waves(make_harmonics(model.problem, np.zeros(nodes, dtype=bool)), 1)
    u, shape = np.zeros((3, nodes, 3)), np.zeros((nodes, 3))
    u[1, :, 0], u[1, :, 1] = 3.0, -3.0
    shape[:, 0] = np.sin(np.arange(nodes))
    for moved, error in ((u, 0.0 * shape), (0.0 * u, shape)):
        assert max(np.abs(part).max() for part in waves.force(moved, 0.0, error)) < 1e-7
