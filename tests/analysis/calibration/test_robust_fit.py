"""Robust fits: the optimum, the standard errors, and a trail of every point that does not count in full."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize

from analysis import BoatDaqError, fit_calibration
from analysis.calibration.constrained_fit import through_zero
from analysis.calibration.robust_fit import HUBER_K, huber, leave_out
from tests.analysis.boat_builder import PAPER

CUBIC = np.polynomial.Polynomial(PAPER[0])
X = np.tile(np.linspace(-2.7, 3.8, 13), 7)  # 91 readings


def signal(seed: int = 0) -> np.ndarray:
    """The paper's cubic with 1.5 mV of noise."""
    return CUBIC(X) + 1.5 * np.random.default_rng(seed).standard_normal(X.size)


@pytest.mark.parametrize("seed", range(5))
def test_one_reading_wrong_by_a_millimetre_of_91_is_left_out_and_named(seed: int) -> None:
    """Row 40 is read 1 mm too far: the trail holds it alone, and the curve is that of the other 90 points."""
    x = X.copy()
    x[40] += 1.0
    found = leave_out(fit_calibration(x, signal(seed), 3))
    assert [one.row for one in found.trail] == [40]
    assert "standard deviations off" in found.trail[0].reason
    assert not found.kept[40]
    assert found.kept.sum() == 90
    rest = fit_calibration(x[found.kept], signal(seed)[found.kept], 3)
    np.testing.assert_allclose(found.calibration.coefficients, rest.coefficients)


def test_sound_points_are_left_alone() -> None:
    """Of 200 sound sets of 91 points 2 % lose one, as the bound promises: at most 10."""
    lost = [bool(leave_out(fit_calibration(X, signal(seed), 3)).trail) for seed in range(200)]
    assert sum(lost) <= 10


def test_eight_wrong_points_are_left_out_and_no_more_than_a_quarter() -> None:
    """Errors of 30 mV in eight of 91 points do not hide each other; noise without a curve loses a quarter at most."""
    y = signal()
    wrong = np.arange(3, 91, 11)
    y[wrong] += 30.0 * np.where(np.arange(wrong.size) % 2, 1, -1)
    found = leave_out(fit_calibration(X, y, 3))
    assert sorted(one.row for one in found.trail) == wrong.tolist()
    heavy = np.random.default_rng(1).standard_cauchy(91)
    assert (~leave_out(fit_calibration(X, heavy, 3)).kept).sum() <= 22


def test_hubers_estimate_is_the_minimum_of_its_loss() -> None:
    """At the scale that it ends with no coefficients have a smaller sum of Huber's rho: a general optimiser agrees."""
    y = signal()
    y[[5, 40]] += [60.0, -45.0]
    plain = fit_calibration(X, y, 3)
    found = huber(plain)
    half = np.sort(np.abs(found.calibration.residuals))
    scale = float(np.median(half)) * 1.482602218505602 * np.sqrt(91 / 87)
    design = plain.fit.basis.design(X)
    best = optimize.least_squares(
        lambda c: (y - design @ c) / scale, found.calibration.fit.basis_coefficients + 0.3, loss="huber",
        f_scale=HUBER_K, xtol=1e-14, ftol=1e-14, gtol=1e-12,
    )  # fmt: skip
    np.testing.assert_allclose(found.calibration.fit.basis_coefficients, best.x, atol=1e-4)
    assert {5, 40} <= {one.row for one in found.trail}
    assert min(found.trail, key=lambda one: one.weight).row == 5
    assert all(0 < one.weight < 1 for one in found.trail)


@pytest.mark.parametrize("sets", [100, pytest.param(400, marks=pytest.mark.nightly)])
def test_hubers_standard_errors_are_the_scatter_of_its_estimates(sets: int) -> None:
    """Sets with 5 % of their points off by 30 sd: the mean stated error of each coefficient within 12 %."""
    rng = np.random.default_rng(4)
    estimates, stated = [], []
    for _ in range(sets):
        y = CUBIC(X) + 1.5 * rng.standard_normal(X.size)
        y[rng.choice(91, 5, replace=False)] += 45.0 * rng.choice([-1, 1], 5)
        found = huber(fit_calibration(X, y, 3)).calibration
        estimates.append(found.coefficients)
        stated.append(found.std_errors)
    np.testing.assert_allclose(np.mean(stated, axis=0), np.std(estimates, axis=0), rtol=0.12)


def test_an_exact_fit_has_no_trail_and_too_few_points_are_refused() -> None:
    """Nothing is off an exact curve; with as many coefficients as points nothing can be judged."""
    exact = fit_calibration(X, CUBIC(X), 3)
    assert huber(exact).trail == leave_out(exact).trail == ()
    with pytest.raises(BoatDaqError, match="no point can be judged"):
        huber(fit_calibration([0, 1, 2, 3], [0, 1, 5, 2], 3))
    assert leave_out(fit_calibration([0, 1, 2, 3], [0, 1, 5, 2], 3)).trail == ()


@pytest.mark.parametrize("robust", [huber, leave_out])
def test_a_constraint_holds_in_a_robust_fit(robust) -> None:  # type: ignore[no-untyped-def]
    """Through the origin with one wrong point of thirty: zero at zero, and the slope of the others."""
    x = np.linspace(0.1, 3.0, 30)
    y = 10 * x + 0.01 * np.random.default_rng(2).standard_normal(30)
    y[20] += 5.0
    found = robust(through_zero(fit_calibration(x, y, 1)), through_zero)
    assert found.calibration.coefficients[0] == 0.0
    assert found.calibration.coefficients[1] == pytest.approx(10.0, abs=0.01)
    assert found.trail[0].row in range(30)
    assert 20 in {one.row for one in found.trail}
