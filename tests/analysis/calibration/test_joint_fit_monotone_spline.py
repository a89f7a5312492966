"""The monotone spline's basis."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.calibration.joint_fit import MonotoneSplineBasis

Z = np.linspace(-1.0, 1.0, 401)


@pytest.mark.parametrize("falls", [False, True])
def test_positive_coefficients_make_a_monotone_curve(falls: bool) -> None:
    """Any coefficients that are not negative rise, or fall, from end to end; the slope is the derivative."""
    basis = MonotoneSplineBasis.through(np.repeat(np.linspace(-1, 1, 10), 2)[1:-1], falls)
    assert len(basis.knots) == 7
    assert basis.complexity == 11
    coefficients = np.random.default_rng(0).exponential(size=basis.complexity)
    curve = basis.design(Z) @ coefficients
    assert (np.diff(curve) * (-1.0 if falls else 1.0) > 0).all()
    slope = basis.slope_design(Z) @ coefficients
    assert slope[1:-1] == pytest.approx((curve[2:] - curve[:-2]) / (Z[2] - Z[0]), abs=2e-2 * np.abs(slope).max())
    assert list(basis.constrained(2)) == [False, *[True] * 10, False, False]


def test_beyond_the_ends_is_the_end() -> None:
    """The design outside -1..1 is that of the nearer end."""
    basis = MonotoneSplineBasis((0.0,))
    assert np.array_equal(basis.design([-1.5, 1.5]), basis.design([-1.0, 1.0]))
