"""Polynomials through Chebyshev points."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial

from analysis.shadow.model import chebyshev


def test_chebyshev_points_carry_polynomials() -> None:
    """A cubic over an interval, and a product over a rectangle, come back exactly."""
    ends, sides = np.array([-3.0, 5.0]), np.array([0.5, 2.0])
    cubic, line = Polynomial([1.0, -2.0, 0.3, 0.1]), Polynomial([4.0, -1.0])
    at, across = chebyshev.points(ends, 4), chebyshev.points(sides, 2)
    x, y = np.array([-2.2, 0.0, 4.9]), np.array([0.6, 1.0, 1.9])
    found = chebyshev.basis(x, ends, 4) @ chebyshev.coefficients(cubic(at))
    np.testing.assert_allclose(found, cubic(x), atol=1e-12)
    both = chebyshev.tensor_coefficients(np.outer(cubic(at), line(across)))
    value = np.einsum("ni,ij,nj->n", chebyshev.basis(x, ends, 4), both, chebyshev.basis(y, sides, 2))
    np.testing.assert_allclose(value, cubic(x) * line(y), atol=1e-12)
