"""Warnings of a calibration about wrong points."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import fit_calibration
from analysis.calibration.checks import (
    calibration_warnings,
    compare_degrees,
    fit_checks,
    lack_of_fit,
    leave_one_out,
    preferred_degree,
)
from analysis.warning import WarningCode
from tests.analysis.boat_builder import PAPER


def test_a_wrong_point_is_named_and_a_sound_fit_is_left_alone() -> None:
    """One point of twenty off by ten sd is named with its place; of 100 sound fits at most 6 (2 %) have one."""
    x = np.linspace(-2.7, 3.8, 20)
    rng = np.random.default_rng(0)
    sound = [x**3 + rng.standard_normal(20) for _ in range(100)]
    assert sum(bool(calibration_warnings(fit_calibration(x, y, 3))) for y in sound) <= 6
    off = sound[0].copy()
    off[7] += 10.0
    (found,) = calibration_warnings(fit_calibration(x, off, 3))
    assert f"the point at x = {x[7]:.4g}" in found.text


def test_the_weights_of_points_count_in_who_is_wrong() -> None:
    """A point that is known to be bad, and weighted so, is not called wrong; the same without weights is."""
    x = np.linspace(0.0, 1.0, 30)
    y = x + 0.01 * np.random.default_rng(1).standard_normal(30)
    y[4] += 0.5
    u = np.where(np.arange(30) == 4, 0.5, 0.01)
    assert calibration_warnings(fit_calibration(x, y, 1, standard_uncertainty=u)) == ()
    assert len(calibration_warnings(fit_calibration(x, y, 1))) == 1


def test_degree_three_is_right_for_the_papers_cubic() -> None:
    """AICc and cross-validation choose 3 for the paper's cubic with its noise, and lack of fit finds a line lacking."""
    x = np.repeat(np.linspace(-2.7, 3.8, 10), 5)
    group = np.tile(np.arange(5), 10)
    y = np.polynomial.Polynomial(PAPER[0])(x) + 0.3 * np.random.default_rng(4).standard_normal(x.size)
    rows = compare_degrees(x, y, group)
    assert preferred_degree(rows) == 3
    best = min(rows, key=lambda row: row["prediction_rms"])
    assert best["degree"] in (3, 4)
    line, cubic = (lack_of_fit(fit_calibration(x, y, degree)) for degree in (1, 3))
    assert line is not None
    assert cubic is not None
    assert line["p"] < 1e-6 < cubic["p"]
    assert leave_one_out(x, y, group, 3)["prediction_rms"] == pytest.approx(0.3, rel=0.3)


def test_lack_of_fit_is_the_f_test_by_hand() -> None:
    """Two replicates at three x, a line: sums of squares computed on paper."""
    x = np.asarray([0.0, 0.0, 1.0, 1.0, 2.0, 2.0])
    y = np.asarray([0.0, 1.0, 2.0, 3.0, 0.0, 1.0])
    found = lack_of_fit(fit_calibration(x, y, 1))
    assert found is not None
    # means 0.5, 2.5, 0.5; line is 7/6 flat: SS_lack = 2 (4/9 + 16/9 + 4/9) = 16/3, SS_pure = 3/2
    assert found["f"] == pytest.approx((16 / 3 / 1) / (1.5 / 3))
    assert lack_of_fit(fit_calibration(np.arange(5.0), y[:5], 1)) is None


def test_warnings_name_what_the_coefficients_do_not_show() -> None:
    """No degree of freedom, and coefficients that cancel far from zero, each get a sentence; a plain fit none."""
    exact = calibration_warnings(fit_calibration([0, 1, 2, 3], [1, 5, 2, 9], 3))
    assert "no uncertainty" in exact[0].text
    far = np.arange(10.0)
    noise = np.random.default_rng(0).standard_normal(10)
    assert "fit x - 1e+09" in calibration_warnings(fit_calibration(1e9 + 1e-3 * far, 2 * far + 0.1 * noise, 3))[0].text
    assert calibration_warnings(fit_calibration(far, far**2 + noise, 3)) == ()


def test_too_few_points_name_no_degree() -> None:
    """With four points no degree is preferred, and a fit through every point predicts none of them."""
    checks = fit_checks(fit_calibration([0, 1, 2, 3], [1, 5, 2, 9], 3))
    assert checks["preferred_degree"] is None
    assert np.isnan(checks["degrees"][2]["prediction_rms"])


def test_a_constant_and_a_point_off_an_exact_curve_are_warned_of() -> None:
    """A constant y does not depend on x; off a curve that all others lie on no multiple of a deviation is given."""
    x = np.arange(12.0)
    (found,) = calibration_warnings(fit_calibration(x, np.full(12, 5.0)))
    assert found.code is WarningCode.CONSTANT_Y
    assert found.text.startswith("y is constant, 5 at all 12 points")
    (found,) = calibration_warnings(fit_calibration(x, np.where(x == 5, 6.0, 5.0)))
    assert found.code is WarningCode.OUTLIER
    assert found.text.endswith("off the curve on which all others lie")
