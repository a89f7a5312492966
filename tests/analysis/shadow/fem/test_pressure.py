"""The cavity's volume, its gradient and its second derivative."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.shadow.fem import pressure
from analysis.shadow.fem.band import empty_band
from analysis.shadow.fem.mesh import Mesh, build_mesh
from analysis.shadow.fem.parameters import ActuatorParameters
from tests.analysis.shadow.solids import dense


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    """Two bladders."""
    return build_mesh(ActuatorParameters(cells=2, axial_elements=4, wall_elements=1, lattice_elements=2))


def gradient(mesh: Mesh, u: np.ndarray) -> np.ndarray:
    out = np.zeros_like(u)
    pressure.volume_gradient(mesh.nodes, u, mesh.cavity, out)
    return out


def test_volume_of_a_straight_cavity_is_a_cylinder() -> None:
    """pi r2 L, to rounding."""
    mesh = build_mesh(ActuatorParameters(neck_radius_mm=6.0, belly_radius_mm=6.0))
    volume = pressure.cavity_volume(mesh.nodes, np.zeros_like(mesh.nodes), mesh.cavity)
    assert volume == pytest.approx(np.pi * 36 * 75, rel=1e-13)


def test_gradient_of_translation_and_stretch(mesh: Mesh) -> None:
    """Moving all along the axis changes no volume; stretching along it changes the volume in proportion."""
    u = np.zeros_like(mesh.nodes)
    along = gradient(mesh, u)[:, 1]
    assert along.sum() == pytest.approx(0.0, abs=1e-10)
    volume = pressure.cavity_volume(mesh.nodes, u, mesh.cavity)
    assert along @ mesh.nodes[:, 1] == pytest.approx(volume, rel=1e-12)


def test_gradient_and_tangent_are_derivatives(mesh: Mesh) -> None:
    """dV/du and d2V/du2 by central differences, and the band is the lower half of a symmetric matrix."""
    rng = np.random.default_rng(2)
    u, size, step = 0.1 * rng.standard_normal(mesh.nodes.shape), mesh.nodes.size, 1e-5
    band = empty_band(size, size - 1)
    numbers = np.arange(size).reshape(u.shape)
    pressure.pressure_tangent(mesh.nodes, u, mesh.cavity, 1.0, numbers, band)
    for _ in range(4):
        way = rng.standard_normal(u.shape)
        volumes = [pressure.cavity_volume(mesh.nodes, u + s * step * way, mesh.cavity) for s in (1, -1)]
        assert (gradient(mesh, u) * way).sum() == pytest.approx((volumes[0] - volumes[1]) / 2 / step, rel=1e-8)
        slopes = (gradient(mesh, u + step * way) - gradient(mesh, u - step * way)) / 2 / step
        np.testing.assert_allclose(dense(band) @ way.ravel(), -slopes.ravel(), atol=1e-7)
