"""Tests of residuals: their levels by simulation, their formulas by brute force, and the warnings that they give."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import fit_calibration
from analysis.calibration.general_fit import (
    chi_squared,
    explanation,
    residual_warnings,
)

X = np.linspace(0.0, 10.0, 40)
U = np.where(np.arange(40) % 2, 0.5, 2.0)


def codes(x: np.ndarray, y: np.ndarray, degree: int = 1) -> list[str]:
    """Return the codes of the warnings of a fit."""
    return [str(w.code) for w in residual_warnings(fit_calibration(x, y, degree))]


@pytest.mark.parametrize(("factor", "verdict"), [(1.0, "consistent"), (0.3, "too_small"), (3.0, "too_large")])
def test_stated_uncertainty_is_compared_with_the_scatter(factor: float, verdict: str) -> None:
    """Stated as it is, three times too small, three times too large; the ratio tells the factor within a fifth."""
    y = 3 * X + U * np.random.default_rng(1).standard_normal(X.size)
    calibration = fit_calibration(X, y, 1, standard_uncertainty=factor * U)
    found = chi_squared(calibration, factor * U)
    assert found is not None
    assert found.verdict == verdict
    assert found.ratio == pytest.approx(1 / factor, rel=0.2)
    texts = [w.text for w in residual_warnings(calibration, found) if w.code == "stated_uncertainty"]
    assert bool(texts) == (verdict != "consistent")


@pytest.mark.parametrize("sets", [250, pytest.param(1000, marks=pytest.mark.nightly)])
def test_a_true_statement_is_doubted_in_5_percent(sets: int) -> None:
    """Sets with their true uncertainty: 5 +- 2 % are called inconsistent."""
    rng = np.random.default_rng(2)
    doubted = 0
    for _ in range(sets):
        y = 3 * X + U * rng.standard_normal(X.size)
        found = chi_squared(fit_calibration(X, y, 1, standard_uncertainty=U), U)
        doubted += found is not None and found.verdict != "consistent"
    assert 0.03 <= doubted / sets <= 0.07


def test_data_without_a_relation_are_named() -> None:
    """R2 0.03 is no relation; R2 0.67 of two random walks explains too little."""
    rng = np.random.default_rng(8)
    assert codes(X, rng.standard_normal(40)) == ["nothing_explained"]
    walks = np.cumsum(np.random.default_rng(17).standard_normal((2, 200)), axis=1)
    found = codes(walks[0], walks[1])
    assert "nothing_explained" in found
    assert codes(X, 3 * X + rng.standard_normal(40)) == []


def test_f_against_a_constant_by_hand() -> None:
    """F = (R2 / 1) / ((1 - R2) / 38); p below 5 % in 5 % of 300 sets without a relation."""
    rng = np.random.default_rng(6)
    found = explanation(calibration := fit_calibration(X, X + 5 * rng.standard_normal(40), 1))
    assert found is not None
    assert found.f == pytest.approx(calibration.r2 / (1 - calibration.r2) * 38)
    p = [explanation(fit_calibration(X, rng.standard_normal(40), 1)) for _ in range(300)]
    assert np.mean([one is not None and one.p < 0.05 for one in p]) == pytest.approx(0.05, abs=0.02)


def test_what_cannot_be_tested_is_none() -> None:
    """As many points as coefficients, an exact line, a constant: no test, and no warning."""
    for x, y, degree in (([0, 1, 2], [0, 1, 3], 2), (X, 3 * X, 1), (X, np.full(40, 2.0), 0)):
        calibration = fit_calibration(x, y, degree)
        assert explanation(calibration) is None
        assert residual_warnings(calibration) == ()
