"""The strain energy, its stress and its tangent."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.shadow.fem import material
from analysis.shadow.fem.material import NeoHookean
from protocol.base.errors import RequestError

entries = st.lists(st.floats(-0.25, 0.25), min_size=5, max_size=5).map(lambda d: np.array([1, 0, 0, 1, 1]) + d)


def stress(f: np.ndarray, c10: float, d1: float) -> np.ndarray:
    p = np.empty(5)
    material.stress(f, c10, d1, p)
    return p


@given(entries)
def test_stress_is_the_derivative_of_energy(f: np.ndarray) -> None:
    """P = dW/dF by central differences."""
    step = 1e-6
    slope = [
        (material.energy(f + step * e, 0.7, 0.3) - material.energy(f - step * e, 0.7, 0.3)) / 2 / step
        for e in np.eye(5)
    ]
    np.testing.assert_allclose(stress(f, 0.7, 0.3), slope, rtol=0, atol=2e-8)


@given(entries)
def test_tangent_is_the_derivative_of_stress_and_symmetric(f: np.ndarray) -> None:
    """dP/dF by central differences; a potential's second derivative is symmetric."""
    step, c = 1e-6, np.empty((5, 5))
    material.tangent(f, 0.7, 0.3, c)
    slope = [(stress(f + step * e, 0.7, 0.3) - stress(f - step * e, 0.7, 0.3)) / 2 / step for e in np.eye(5)]
    np.testing.assert_allclose(c, np.array(slope).T, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(c, c.T)


@given(entries, st.floats(-3, 3))
def test_a_rotation_stores_no_energy(f: np.ndarray, angle: float) -> None:
    """W(QF) = W(F) for a rotation Q in the half plane."""
    q = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = np.append((q @ f[:4].reshape(2, 2)).ravel(), f[4])
    assert material.energy(turned, 0.7, 0.3) == pytest.approx(material.energy(f, 0.7, 0.3), abs=1e-12)


def test_small_strains_follow_hooke() -> None:
    """At rest the stress is zero and the tangent is isotropic elasticity with the given E and nu."""
    chosen = NeoHookean(18.34, 0.3)
    c = np.empty((5, 5))
    rest = np.array([1.0, 0, 0, 1, 1])
    material.tangent(rest, chosen.c10_kpa, chosen.d1_per_kpa, c)
    lam, mu = 18.34 * 0.3 / (1.3 * 0.4), 18.34 / 2.6
    np.testing.assert_allclose(stress(rest, chosen.c10_kpa, chosen.d1_per_kpa), 0, atol=1e-13)
    np.testing.assert_allclose(
        [c[0, 0], c[0, 3], c[0, 4], c[1, 1], c[1, 2]], [lam + 2 * mu, lam, lam, mu, mu], rtol=1e-12
    )


@pytest.mark.parametrize(("e", "nu"), [(0.0, 0.3), (-5, 0.3), (np.nan, 0.3), (10, 0.5), (10, -1.0), (10, np.nan)])
def test_what_is_no_material_is_refused(e: float, nu: float) -> None:
    """A modulus that is not positive, or a Poisson's ratio at its bounds, is refused with a remedy."""
    with pytest.raises(RequestError) as refusal:
        NeoHookean(e, nu)
    assert refusal.value.remedy


def test_a_solid_stiffer_than_rounding_is_refused() -> None:
    """At nu = 0.5 - 1e-9 no displacement at all passed for a solution; such a material is not made any more."""
    assert NeoHookean(1000.0, 0.5 - 1.1e-6).d1_per_kpa > 0
    with pytest.raises(RequestError, match="Poisson's ratio of 0"):
        NeoHookean(1000.0, 0.5 - 1e-9)
