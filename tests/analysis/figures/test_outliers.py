"""Outliers against the running fit of elongation over pressure."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.figures.outliers import FLOOR_MM, LEAST_READINGS, outlying

PRESSURE_KPA = np.array([50.0, 30.0, 10.0, -10.0, -30.0, -40.0, -30.0, -10.0, 10.0, 30.0, 50.0, 30.0, 10.0, -10.0])
LOADING = np.array([False] * 6 + [True] * 5 + [False] * 3)
SMOOTH_MM = 0.07 * PRESSURE_KPA - 2e-5 * PRESSURE_KPA**3 + 0.3 * LOADING
ELONGATION_MM = np.round(2 * SMOOTH_MM) / 2  # as read on a half-millimetre grid


def test_one_wrong_reading_is_an_outlier_and_no_other():
    """Two millimetres off, beside a hysteresis of 0.3 mm."""
    assert np.isnan(outlying(PRESSURE_KPA, LOADING, ELONGATION_MM)).all()
    read = ELONGATION_MM.copy()
    read[6] += 2.0
    far = outlying(PRESSURE_KPA, LOADING, read)
    assert np.flatnonzero(np.isfinite(far)).tolist() == [6]
    assert far[6] == pytest.approx(2.0, abs=0.5)


def test_fewer_readings_than_a_fit_needs_have_no_outlier():
    """One below the least number."""
    n = LEAST_READINGS - 1
    assert np.isnan(outlying(PRESSURE_KPA[:n], LOADING[:n], np.arange(n) ** 3.0)).all()


def test_reading_on_the_next_mark_of_the_grid_is_no_outlier():
    """The grid is half a millimetre: a distance below the floor is not marked, however exact the others are."""
    read = SMOOTH_MM.copy()
    read[6] += 0.9 * FLOOR_MM
    assert np.isnan(outlying(PRESSURE_KPA, LOADING, read)).all()
