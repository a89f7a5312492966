"""Warnings of a calibration about wrong points."""

from __future__ import annotations

import numpy as np

from analysis import fit_calibration
from analysis.calibration.checks import calibration_warnings


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
