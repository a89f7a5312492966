"""Tangents of waves around the circle."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.shadow.fem.band import factorise
from analysis.shadow.fem.harmonics import Harmonics, make_harmonics
from analysis.shadow.fem.material import NeoHookean
from analysis.shadow.fem.solver import Solver
from analysis.shadow.model.full import FullModel
from tests.analysis.shadow.solids import dense, mapped_mesh, solid


def test_rigid_motion_meets_no_stiffness(actuator: FullModel) -> None:
    """Shifting sideways and tilting are waves with n = 1 that strain nothing."""
    nodes = actuator.mesh.nodes
    free = make_harmonics(actuator.problem, np.zeros(len(nodes), dtype=bool))
    band = free.tangent(np.zeros_like(nodes), 0.0, 1)
    r, z = nodes.T
    for motion in ((np.ones_like(r), -np.ones_like(r), np.zeros_like(r)), (z, -z, -r)):
        v = np.empty(free.size)
        v[free.equations] = np.stack(motion, axis=1)
        force = dense(band) @ v
        assert np.abs(force).max() < 1e-9 * np.abs(band).max() * np.abs(v).max()


@pytest.mark.parametrize("n", [2, 3])
def test_a_ring_under_vacuum_buckles_at_bresses_pressure(n: int) -> None:
    """A long thin tube collapses at E t3 (n2 - 1) / (12 (1 - nu2) R3), R its mean radius, within 1.5 %."""
    inner, thick, e, nu = 50.0, 1.0, 1e6, 0.3
    mesh = mapped_mesh(lambda s, t: (inner + thick * s, 5 * t), 2, 1)
    fixed = np.zeros(mesh.nodes.shape, dtype=bool)
    fixed[:, 1] = True
    problem = solid(mesh, NeoHookean(e, nu), fixed)
    ring = make_harmonics(problem, np.zeros(len(mesh.nodes), dtype=bool))
    flat = np.where(np.arange(3) == 2, -1, ring.equations)
    order = np.full(ring.size + 1, -1)
    order[np.unique(flat[flat >= 0])] = np.arange(2 * len(mesh.nodes))
    ring = Harmonics(problem, order[flat], 2 * len(mesh.nodes), ring.bandwidth)
    mean = inner + thick / 2
    expected = e * thick**3 * (n**2 - 1) / (12 * (1 - nu**2) * mean**3) * mean / inner  # pressed on its inner face
    stable = []
    for vacuum_kpa in (0.985 * expected, 1.015 * expected):
        state = Solver(problem).solve(pressure_kpa=-vacuum_kpa)
        stable.append(factorise(ring.tangent(state.displacement_mm, -vacuum_kpa, n)) == ring.size)
    assert stable == [True, False]
