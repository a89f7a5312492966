"""Buckling around the circle and the limits of the actuator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.errors import RequestError
from analysis.shadow.fem.band import factorise, product
from analysis.shadow.fem.harmonics import Harmonics, make_harmonics
from analysis.shadow.fem.material import NeoHookean
from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.fem.solver import Solver
from analysis.shadow.model.full import FullModel
from tests.analysis.shadow.solids import mapped_mesh, solid


def test_rigid_motion_meets_no_stiffness(actuator: FullModel) -> None:
    """Shifting sideways and tilting are waves with n = 1 that strain nothing."""
    nodes = actuator.mesh.nodes
    free = make_harmonics(actuator.problem, np.zeros(len(nodes), dtype=bool))
    band = free.tangent(np.zeros_like(nodes), 0.0, 1)
    r, z = nodes.T
    for motion in ((np.ones_like(r), -np.ones_like(r), np.zeros_like(r)), (z, -z, -r)):
        v = np.empty(free.size)
        v[free.equations] = np.stack(motion, axis=1)
        force = product(band, v)
        assert np.abs(force).max() < 1e-9 * np.abs(band).max() * np.abs(v).max()


@pytest.mark.parametrize("n", [2, 3])
def test_a_ring_under_vacuum_buckles_as_bresse_says(n: int) -> None:
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
    low, high, solver = 0.5 * expected, 1.5 * expected, Solver(problem)
    for _ in range(12):
        middle = (low + high) / 2
        state = solver.solve(pressure_kpa=-middle)
        stable = factorise(ring.tangent(state.displacement_mm, -middle, n)) == ring.size
        low, high = (middle, high) if stable else (low, middle)
    assert low == pytest.approx(expected, rel=1.5e-2)


def test_limit_lies_below_the_papers_range(actuator: FullModel) -> None:
    """Under vacuum the bladders go oval between -40 kPa, which the paper uses, and -50 kPa."""
    limit = actuator.vacuum_limit
    assert -50.0 < limit.pressure_kpa < -40.0
    assert limit.wave_number == 2
    assert "oval" in limit.mode


def test_limit_does_not_depend_on_the_mesh(actuator: FullModel) -> None:
    """A finer mesh finds the same critical pressure within 0.5 %."""
    finer = FullModel(replace(ActuatorParameters(), axial_elements=12, wall_elements=3, lattice_elements=5))
    assert finer.vacuum_limit.pressure_kpa == pytest.approx(actuator.vacuum_limit.pressure_kpa, rel=5e-3)


def test_lowest_eigenvalue_falls_from_one_to_zero(actuator: FullModel) -> None:
    """It is 1 at rest, falls under vacuum, and is zero at the limit."""
    pressures = (0.0, -15.0, -30.0, -40.0, actuator.vacuum_limit.pressure_kpa)
    values = [actuator.stability.lowest_eigenvalue(actuator.solver.solve(pressure_kpa=p)) for p in pressures]
    assert values[0] == pytest.approx(1.0, abs=2e-5)
    assert (np.diff(values) < 0).all()
    assert values[-1] == pytest.approx(0.0, abs=2e-3)


@pytest.mark.fault(46, how="less pressure, or elongation, than the limit point's", times=4)
def test_beyond_the_limit_is_refused_with_the_critical_pressure(actuator: FullModel) -> None:
    """By pressure or by elongation, the refusal names the critical pressure."""
    named = f"{actuator.vacuum_limit.pressure_kpa:.1f} kPa"
    for asked in ({"pressure_kpa": -60.0}, {"elongation_mm": -6.0}, {"pressure_kpa": -60.0, "elongation_mm": -2.0}):
        with pytest.raises(RequestError) as refusal:
            actuator.solve(**asked)
        assert named in refusal.value.cause
        assert named in refusal.value.remedy
    with pytest.raises(RequestError):
        actuator.solve(pressure_kpa=500.0)


def test_a_thin_wall_buckles_early() -> None:
    """A bladder of a thin wall goes oval under less vacuum than the default one."""
    thin = FullModel(ActuatorParameters(cells=2, wall_mm=1.6, axial_elements=6, lattice_elements=3))
    assert -40.0 < thin.vacuum_limit.pressure_kpa < 0.0
    assert thin.vacuum_limit.wave_number >= 2
