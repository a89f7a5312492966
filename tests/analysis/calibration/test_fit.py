"""The fit against certified data, closed forms, and what it must refuse."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import curve_fit

from analysis import BoatDaqError, fit_calibration
from protocol.base.errors import RequestError
from tests.analysis.boat_builder import PAPER

DIGITS = {"Pontius": 10.0, "Wampler1": 5.0, "Wampler5": 5.0, "Filip": 5.0}


def certified(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y, certified coefficients and standard deviations of a NIST StRD file."""
    lines = path.read_text().splitlines()
    values = np.asarray([line.split()[1:3] for line in lines if re.match(r"\s+B\d", line)], dtype=float)
    start = max(i for i, line in enumerate(lines) if line.startswith("Data:"))
    data = np.asarray([line.split() for line in lines[start + 1 :] if line.strip()], dtype=float)
    return data[:, 1], data[:, 0], values[:, 0], values[:, 1]


def digits(found: np.ndarray, truth: np.ndarray) -> float:
    """Return the smallest number of correct digits (NIST's log relative error)."""
    scale = np.where(truth == 0, 1.0, np.abs(truth))
    return float(-np.log10(np.maximum(np.abs(found - truth) / scale, 1e-16)).min())


@pytest.mark.parametrize("name", DIGITS)
def test_certified_data_are_met_to_the_required_digits(shared_data: Path, name: str) -> None:
    """Coefficients and their standard deviations agree with NIST's certified values."""
    x, y, coefficients, deviations = certified(shared_data / "nist_strd" / f"{name}.dat")
    fit = fit_calibration(x, y, coefficients.size - 1)
    assert digits(fit.coefficients, coefficients) >= DIGITS[name]
    assert digits(fit.std_errors, deviations) >= 5.0


@pytest.mark.parametrize("noise_scale", [1.0, 100.0, 10000.0])
def test_polynomials_of_wampler_with_more_noise(noise_scale: float) -> None:
    """Wampler 3 to 5: y = 1 + x + ... + x^5 plus a pattern orthogonal to the powers leaves all coefficients at 1."""
    x = np.arange(21.0)
    pattern = np.asarray([759.0, -2048, 2048, -2048, 2523, -2048, 2048, -2048, 1838, -2048, 2048])
    pattern = np.concatenate([pattern, pattern[:-1][::-1]])
    fit = fit_calibration(x, sum(x**k for k in range(6)) + noise_scale * pattern, 5)
    assert digits(fit.coefficients, np.ones(6)) >= 5.0


def test_the_papers_coefficients_give_the_papers_sensitivities() -> None:
    """Over -2.70 to 3.80 mm the published cubics give 39.3 and 29.2 mV/mm, and turn at 4.51 and 4.96 mm."""
    x = np.linspace(-2.7, 3.8, 14)
    fits = [fit_calibration(x, np.polynomial.Polynomial(c)(x)) for c in PAPER]
    slopes = [fit.full_scale / 6.5 for fit in fits]
    assert [round(s, 1) for s in slopes] == [39.3, 29.2]
    assert round(sum(slopes) / 2, 1) in (34.2, 34.3)
    assert [round(fit.turning_points[-1], 2) for fit in fits] == [4.51, 4.96]
    assert all(fit.monotone for fit in fits)


def test_weights_follow_the_ratio_of_the_uncertainties() -> None:
    """A mean weighted by 1/u^2 is the degree-0 fit: the closed form."""
    y, u = np.asarray([1.0, 2.0, 4.0]), np.asarray([1.0, 2.0, 0.5])
    fit = fit_calibration(np.arange(3.0), y, 0, standard_uncertainty=u)
    assert fit.coefficients[0] == pytest.approx((y / u**2).sum() / (1 / u**2).sum(), rel=1e-14)


def test_stated_uncertainty_sets_the_standard_errors() -> None:
    """(A^T A)^-1 / u^2 whatever the scatter, by scipy's absolute_sigma; weights keep the scale of the residuals."""
    x = np.arange(8.0)
    y, u = 1 + 2 * x + 0.01 * np.cos(9 * x), np.linspace(0.3, 0.7, 8)
    for absolute, spread in ((True, {"standard_uncertainty": u}), (False, {"weights": 7 / u**2})):
        _, covariance = curve_fit(lambda t, a, b: a + b * t, x, y, sigma=u, absolute_sigma=absolute)
        found = fit_calibration(x, y, 1, **spread)
        np.testing.assert_allclose(found.covariance, covariance, rtol=1e-5)
        np.testing.assert_allclose(found.curve_sd([0.0]), np.sqrt(covariance[0, 0]), rtol=1e-5)
    assert fit_calibration(x, y, 1, standard_uncertainty=0.5).std_errors[1] == pytest.approx(0.5 / np.sqrt(42.0))
    with pytest.raises(RequestError, match="both"):
        fit_calibration(x, y, 1, standard_uncertainty=u, weights=u)


def test_covariance_is_that_of_the_normal_equations() -> None:
    """For a well-conditioned x the covariance equals s^2 (A^T A)^-1, computed directly."""
    rng = np.random.default_rng(3)
    x = rng.uniform(-1, 1, 40)
    fit = fit_calibration(x, rng.normal(size=40), 2)
    design = np.vander(x, 3, increasing=True)
    np.testing.assert_allclose(fit.covariance, fit.residual_sd**2 * np.linalg.inv(design.T @ design), rtol=1e-9)


@settings(deadline=None)
@given(
    st.lists(st.floats(-5, 5), min_size=1, max_size=5),
    st.floats(-1e4, 1e4),
    st.floats(1e-3, 1e3),
)
def test_an_exact_polynomial_is_found_again_wherever_x_lies(roots: list[float], shift: float, scale: float) -> None:
    """A polynomial without noise is fitted to 1e-9 of its size, whatever the offset and scale of x."""
    u = np.linspace(-1, 1, 25)
    y = np.polynomial.Polynomial(roots)(u)
    fit = fit_calibration(shift + scale * u, y, len(roots) - 1)
    np.testing.assert_allclose(fit.predict(fit.x), y, atol=1e-9 * (1 + np.abs(y).max()))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_falling_unit_calibrates_as_well(sign: float) -> None:
    """Changing the sign of the signal changes the sign of every coefficient and nothing else."""
    x = np.linspace(-2.7, 3.8, 20)
    y = np.polynomial.Polynomial(PAPER[0])(x)
    fit = fit_calibration(x, sign * y)
    np.testing.assert_allclose(sign * fit.coefficients, PAPER[0], rtol=1e-10)
    assert fit.rises == (sign > 0)
    assert fit.monotone


@pytest.mark.fault(40, how="too few, equal and clustered x, and values that are no numbers", times=6)
@pytest.mark.parametrize(
    ("x", "y", "cause"),
    [
        ([1, 1, 1, 1, 1], [1, 2, 3, 4, 5], "all 5 x are equal"),
        ([1, 2, 3, 1, 2], [1, 2, 3, 4, 5], "only 3 different positions; degree 3 needs 4"),
        ([1, 2, 3, 4, np.nan], [1, 2, 3, 4, 5], "of x are not numbers"),
        ([1, 2, 3, 4, 5], [1, 2, 3, np.inf, 5], "of y are not numbers"),
        ([1, 2, 3, 4], [1, 2, 3], "different lengths"),
        ([0, 1e-12, 2e-12, 3e-12, 4e-12, 1.0], [1, 2, 3, 4, 5, 6], "too clustered"),
    ],
)
def test_what_cannot_be_fitted_is_refused_with_its_reason(x: list[float], y: list[float], cause: str) -> None:
    """Fault 40: the message names which of the conditions failed."""
    with pytest.raises(BoatDaqError, match=cause):
        fit_calibration(x, y)


def test_a_curve_that_turns_inside_its_range_is_not_monotone() -> None:
    """x^2 over -1..2 turns at 0; over 1..2 it does not."""
    x = np.linspace(-1, 2, 30)
    assert not fit_calibration(x, x**2, 2).monotone
    x = np.linspace(1, 2, 30)
    fit = fit_calibration(x, x**2, 2)
    assert fit.monotone
    assert fit.turning_points == pytest.approx([0.0], abs=1e-9)


def test_values_without_a_square_are_refused() -> None:
    """1e300 has no square in double precision: refused, where it gave R2 and errors of nothing."""
    with pytest.raises(BoatDaqError, match="larger than"):
        fit_calibration(np.arange(8.0), np.arange(8.0) * 1e300)


@pytest.mark.parametrize(
    ("actuators", "grid", "reader"),
    [
        (40, 0.5, 0.3),
        (40, 1.0, 0.0),
        *(
            pytest.param(120, *each, marks=pytest.mark.nightly)
            for each in ((0.1, 0.0), (0.5, 0.3), (1.0, 0.0), (1.0, 0.3))
        ),
    ],
)
def test_stated_errors_hold_the_truth_where_x_is_read_on_a_grid(actuators: int, grid: float, reader: float) -> None:
    """Actuators of 18 positions, five cycles: the errors with reading cover 60 and 92 % or more, however they round.

    The fit's own hold the truth far less often, for five equal readings count five times.
    """
    rng, truth, share = np.random.default_rng(1), np.polynomial.Polynomial(PAPER[0]), np.repeat(np.arange(9) / 9, 2)
    loop, coefficients = np.tile([-0.12, 0.12], 9) * 4.0 * share * (1.0 - share), np.asarray(PAPER[0])
    away = []
    for _ in range(actuators):
        x = rng.uniform(-2.9, -2.5) + 6.5 * rng.uniform(0.95, 1.05) * share + rng.uniform(0.5, 1.5) * loop
        x = np.tile(x + rng.uniform(-0.4, 0.4) * np.sin(np.pi * share), 5)
        read = np.round((x + grid * reader * rng.standard_normal(x.size)) / grid) * grid
        fit = fit_calibration(read, truth(x) + 0.3 * rng.standard_normal(x.size))
        fit = fit.with_reading(grid / 12**0.5, np.tile(np.arange(18), 5))
        off = np.abs(fit.coefficients - coefficients)
        away.append([off / fit.std_errors_with_reading, off / fit.std_errors])
    with_reading_error, plain = np.moveaxis(np.asarray(away), 1, 0)
    assert (with_reading_error < 1.0).mean() > 0.6
    assert (with_reading_error < 2.0).mean() > 0.92
    assert reader > 0 or (plain < 2.0).mean() < 0.9
