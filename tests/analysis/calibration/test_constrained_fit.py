"""Fits through the origin and monotone fits, against closed forms and a general optimiser."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize

from analysis import BoatDaqError, fit_calibration
from analysis.calibration.constrained_fit import monotone, through_zero
from tests.analysis.calibration.test_fit import certified


def test_line_through_the_origin_is_the_closed_form() -> None:
    """b1 = sum xy / sum x^2 with its standard error s / sqrt(sum x^2), n - 1 degrees of freedom; b0 is exactly zero."""
    rng = np.random.default_rng(0)
    x = np.linspace(1, 9, 12)
    y = 3.2 * x + 0.1 * rng.standard_normal(x.size)
    found = through_zero(fit_calibration(x, y, 1))
    slope = float(x @ y / (x @ x))
    sd = float(np.sqrt(((y - slope * x) ** 2).sum() / (x.size - 1)))
    assert found.coefficients[0] == 0.0
    assert found.std_errors[0] == 0.0
    assert found.coefficients[1] == pytest.approx(slope, rel=1e-12)
    assert found.std_errors[1] == pytest.approx(sd / float(np.sqrt(x @ x)), rel=1e-10)
    assert found.dof == x.size - 1
    assert float(found.predict(0.0)) == pytest.approx(0.0, abs=1e-12)


def test_polynomial_through_the_origin_is_the_fit_without_a_constant() -> None:
    """Coefficients and covariance of y = b1 x + b2 x^2 + b3 x^3 by ordinary least squares on these columns."""
    rng = np.random.default_rng(1)
    x = rng.uniform(-2.7, 3.8, 40)
    y = 40 * x - 2.7 * x**2 - 0.36 * x**3 + rng.standard_normal(40)
    found = through_zero(fit_calibration(x, y, 3))
    columns = np.stack([x, x**2, x**3], axis=1)
    expected, *_ = np.linalg.lstsq(columns, y, rcond=None)
    np.testing.assert_allclose(found.coefficients[1:], expected, rtol=1e-9)
    covariance = ((y - columns @ expected) ** 2).sum() / 37 * np.linalg.inv(columns.T @ columns)
    np.testing.assert_allclose(found.covariance[1:, 1:], covariance, rtol=1e-8)


def test_noint1_of_nist() -> None:
    """NIST StRD NoInt1, y = b x: b = 2.07438016528926, sd 0.165289256198347E-01, residual sd 3.56753034006338."""
    x = np.arange(60.0, 71.0)
    y = np.arange(130.0, 141.0)
    found = through_zero(fit_calibration(x, y, 1))
    assert found.coefficients[1] == pytest.approx(2.07438016528926, rel=1e-12)
    assert found.std_errors[1] == pytest.approx(0.0165289256198347, rel=1e-9)
    assert found.residual_sd == pytest.approx(3.56753034006338, rel=1e-10)


def test_monotone_fit_is_the_best_under_its_constraint() -> None:
    """A quintic of a saturating curve turns without the constraint; with it the optimum of a general solver is met."""
    rng = np.random.default_rng(3)
    x = np.linspace(0, 10, 25)
    y = 100 * (1 - np.exp(-x)) + 2.0 * rng.standard_normal(x.size)
    plain = fit_calibration(x, y, 5)
    assert not plain.monotone
    found = monotone(plain)
    assert found.monotone
    assert np.diff(found.predict(np.linspace(0, 10, 5000))).min() > 0
    design, slopes = plain.fit.basis.design(x), plain.fit.basis.slope_design(np.linspace(0, 10, 401))
    best = optimize.minimize(
        lambda c: float(((y - design @ c) ** 2).sum()), found.fit.basis_coefficients * 1.01, method="SLSQP",
        jac=lambda c: -2 * design.T @ (y - design @ c),
        constraints={"type": "ineq", "fun": lambda c: slopes @ c, "jac": lambda c: slopes},
        options={"maxiter": 1000, "ftol": 1e-14},
    )  # fmt: skip
    assert float((found.residuals**2).sum()) == pytest.approx(best.fun, rel=1e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_falling_sensor_stays_falling(sign: float) -> None:
    """The direction is that of the data; a fit that is monotone already is returned unchanged."""
    x = np.linspace(-2.7, 4.9, 30)  # past the turn of the paper's cubic at 4.51 mm
    y = sign * np.polynomial.Polynomial([1651.9842, 46.4413, -2.6934, -0.36251])(x)
    found = monotone(fit_calibration(x, y, 3))
    assert found.monotone
    assert found.rises == (sign > 0)
    again = fit_calibration(x[:20], y[:20], 3)
    assert monotone(again) is again


def test_both_constraints_at_once() -> None:
    """Through the origin and monotone: zero at zero, one sign of the slope."""
    x = np.linspace(0.5, 10, 20)
    y = 50 * np.tanh(x / 2) - 0.4 * x
    found = monotone(through_zero(fit_calibration(x, y, 3)))
    assert found.monotone
    assert found.coefficients[0] == 0.0
    assert float(found.predict(0.0)) == pytest.approx(0.0, abs=1e-9)


def test_what_has_nothing_to_constrain_is_refused() -> None:
    """A constant through zero, and a constant that should rise."""
    with pytest.raises(BoatDaqError, match="through zero"):
        through_zero(fit_calibration([1, 2, 3], [1, 2, 4], 0))
    with pytest.raises(BoatDaqError, match="neither rises nor falls"):
        monotone(fit_calibration([1, 2, 3], [5, 5, 5], 1))


def test_constraint_that_the_data_nearly_meet_changes_little(shared_data) -> None:  # type: ignore[no-untyped-def]
    """Pontius goes nearly through zero: the constrained fit differs by less than ten standard errors."""
    x, y, coefficients, deviations = certified(shared_data / "nist_strd" / "Pontius.dat")
    found = through_zero(fit_calibration(x, y, 2))
    assert abs(found.coefficients[1] - coefficients[1]) < 10 * deviations[1]
    assert found.r2 > 0.999999
