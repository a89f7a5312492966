"""The options of a fit together: their order, their kept points, and the coverage of stated uncertainties."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.calibration.general_fit import FitOptions, general_fit

X = np.linspace(0.2, 10.0, 50)


@pytest.mark.parametrize("lines", [250, pytest.param(1000, marks=pytest.mark.nightly)])
def test_stated_uncertainties_cover_the_truth_as_often_as_they_state(lines: int) -> None:
    """Weighted lines: slope and constant are within 1.96 standard errors in 93.5 to 96.5 % of cases."""
    rng = np.random.default_rng(5)
    u = np.where(np.arange(50) % 2, 0.2, 1.0)
    inside = np.zeros(2)
    for _ in range(lines):
        found = general_fit(X, 1 + 2 * X + u * rng.standard_normal(50), 1, standard_uncertainty=u).calibration
        inside += np.abs(found.coefficients - [1, 2]) < 1.96 * found.std_errors
    assert inside / lines == pytest.approx([0.95, 0.95], abs=0.017)


def test_all_options_hold_at_once() -> None:
    """Through zero, monotone and weighted, and the wrong point is left out."""
    y = 50 * np.tanh(X / 3) + 0.1 * np.random.default_rng(1).standard_normal(50)
    y[30] -= 15.0
    options = FitOptions(through_zero=True, monotone=True, leave_out=True)
    found = general_fit(X, y, 5, standard_uncertainty=np.full(50, 0.1), options=options)
    assert found.calibration.coefficients[0] == 0.0
    assert found.calibration.monotone
    assert 30 in {one.row for one in found.left_out}
    assert found.kept.sum() == found.calibration.n == 49
    assert found.stated.dof == found.calibration.n - 5


def test_without_options_it_is_the_plain_fit() -> None:
    """The keys of a plain fit, no point left out, no statement, no warnings about a sound line."""
    y = 1 + 2 * X + 0.1 * np.random.default_rng(2).standard_normal(50)
    found = general_fit(X, y, 1)
    content = found.as_json()
    assert content["left_out"] == []
    assert content["stated_uncertainty"] is None
    assert found.warnings == ()
    assert found.residual_sd == found.calibration.residual_sd
