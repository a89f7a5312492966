"""Points left out: which, how many at most, and the curve of the others."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import fit_calibration
from analysis.calibration.constrained_fit import through_zero
from analysis.calibration.general_fit import leave_out
from tests.analysis.boat_builder import PAPER

CUBIC = np.polynomial.Polynomial(PAPER[0])
X = np.tile(np.linspace(-2.7, 3.8, 13), 7)  # 91 readings


def signal(seed: int = 0) -> np.ndarray:
    """The paper's cubic with 1.5 mV of noise."""
    return CUBIC(X) + 1.5 * np.random.default_rng(seed).standard_normal(X.size)


@pytest.mark.parametrize("seed", range(5))
def test_one_reading_wrong_by_a_millimetre_of_91_is_left_out_and_named(seed: int) -> None:
    """Row 40 is read 1 mm too far: it alone is left out, and the curve is that of the other 90 points."""
    x = X.copy()
    x[40] += 1.0
    found = leave_out(fit_calibration(x, signal(seed), 3))
    assert [one.row for one in found.left_out] == [40]
    assert "standard deviations off" in found.left_out[0].reason
    assert not found.kept[40]
    assert found.kept.sum() == 90
    rest = fit_calibration(x[found.kept], signal(seed)[found.kept], 3)
    np.testing.assert_allclose(found.calibration.coefficients, rest.coefficients)


def test_sound_points_are_left_alone() -> None:
    """Of 200 sound sets of 91 points 2 % lose one, as the bound promises: at most 10."""
    lost = [bool(leave_out(fit_calibration(X, signal(seed), 3)).left_out) for seed in range(200)]
    assert sum(lost) <= 10


def test_eight_wrong_points_are_left_out_and_no_more_than_a_quarter() -> None:
    """Errors of 30 mV in eight of 91 points do not hide each other; noise without a curve loses a quarter at most."""
    y = signal()
    wrong = np.arange(3, 91, 11)
    y[wrong] += 30.0 * np.where(np.arange(wrong.size) % 2, 1, -1)
    found = leave_out(fit_calibration(X, y, 3))
    assert sorted(one.row for one in found.left_out) == wrong.tolist()
    heavy = np.random.default_rng(1).standard_cauchy(91)
    assert (~leave_out(fit_calibration(X, heavy, 3)).kept).sum() <= 22


def test_an_exact_fit_and_too_few_points_are_left_alone() -> None:
    """Nothing is off an exact curve; with as many coefficients as points nothing can be judged."""
    exact = fit_calibration(X, CUBIC(X), 3)
    assert leave_out(exact).left_out == ()
    assert leave_out(fit_calibration([0, 1, 2, 3], [0, 1, 5, 2], 3)).left_out == ()


def test_a_constraint_holds_in_the_reduced_fit() -> None:
    """Through the origin with one wrong point of thirty: zero at zero, and the slope of the others."""
    x = np.linspace(0.1, 3.0, 30)
    y = 10 * x + 0.01 * np.random.default_rng(2).standard_normal(30)
    y[20] += 5.0
    found = leave_out(through_zero(fit_calibration(x, y, 1)), through_zero)
    assert found.calibration.coefficients[0] == 0.0
    assert found.calibration.coefficients[1] == pytest.approx(10.0, abs=0.01)
    assert [one.row for one in found.left_out] == [20]
