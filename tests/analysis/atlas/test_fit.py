"""Where the polynomial fit and the inverse end: both sides of each border."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import fit_calibration
from analysis.atlas.sweep import Outcome
from analysis.calibration.checks import calibration_warnings
from tests.analysis.atlas.borders import DEGRADED, REFUSED, WORKS, place


@pytest.mark.parametrize(
    ("name", "x", "y", "outcome", "said"),
    [
        ("fit-clusters", 1e-7, 3, WORKS, ""),
        ("fit-clusters", 1e-3, 5, WORKS, ""),
        ("fit-clusters", 1e-4, 5, REFUSED, "clustered"),
        ("fit-clusters", 0.1, 7, WORKS, ""),
        ("fit-clusters", 1e-3, 7, REFUSED, "clustered"),
        ("fit-offset", 1e3, 3, WORKS, ""),
        ("fit-offset", 1e4, 3, DEGRADED, "fit x - 1"),
        ("fit-offset", 1e9, 1, WORKS, ""),
        ("fit-offset", 1e9, 2, DEGRADED, "fit x - 1"),
        ("fit-few-points", 3, 3, REFUSED, "3 distinct x where degree 3 needs 4"),
        ("fit-few-points", 4, 3, DEGRADED, "no uncertainty"),
        ("fit-few-points", 8, 3, DEGRADED, "alone determines the curve"),
        ("fit-few-points", 10, 3, WORKS, ""),
        ("fit-few-points", 10, 10, REFUSED, "10 distinct x where degree 10 needs 11"),
        ("fit-outlier", 4, 20, WORKS, ""),
        ("fit-outlier", 10, 20, DEGRADED, "off the curve"),
        ("fit-outlier", 1000, 8, DEGRADED, "would not be seen"),
    ],
)
def test_borders_of_the_fit(name: str, x: float, y: float, outcome: Outcome, said: str) -> None:
    """Right to its tolerance on one side; a reservation or a refusal with its reason on the other."""
    place(name, x, y, outcome, said)


@pytest.mark.parametrize(
    ("gap_mm", "where", "outcome", "said"),
    [
        (0.7, 0.95, WORKS, ""),
        (0.1, 0.95, DEGRADED, "the curve turns at"),
        (-0.1, 0.5, REFUSED, "no inverse"),
        (1.0, 0.1, WORKS, ""),
        (1.0, -0.03, REFUSED, "outside"),
        (1.0, 1.1, REFUSED, "outside"),
        (0.3, 1.1, DEGRADED, "is read as one inside"),
    ],
)
def test_borders_of_the_inverse(gap_mm: float, where: float, outcome: Outcome, said: str) -> None:
    """Towards the turning point, past it, and on both sides of the calibrated range."""
    place("inverse-turning", gap_mm, where, outcome, said)


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
