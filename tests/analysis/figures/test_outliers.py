"""Outliers against the running fit of elongation over pressure."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import Options, analyse
from analysis.figures.outliers import FLOOR_MM, LEAST_READINGS, outlying
from tests.analysis.boat_builder import Plant, Staircase

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


def test_reading_wrong_by_a_millimetre_is_left_out_on_request(tmp_path):
    """One of 91 readings 1 mm too far: named and used by default, left out with a warning on request.

    Without it the curve is that of the other 90; a sound run loses no reading.
    """
    stairs = Staircase(Plant(loop_mm=0.1), cycles=5)
    table = stairs.elongations()
    sound = analyse_file(stairs, table, tmp_path, leave_out=True)
    table.loc[40, "elongation_mm"] += 1.0
    plain, robust = (analyse_file(stairs, table, tmp_path, leave_out=on) for on in (False, True))
    assert left_out(sound) == left_out(plain) == []
    (text,) = left_out(robust)
    assert f"the reading {table.loc[40, 'elongation_mm']:+.2f} mm at " in text
    assert text.endswith("is left out (sensor 1, sensor 2)")
    for before, after, truth in zip(plain.sensors, robust.sensors, sound.sensors, strict=True):
        assert after.calibration.n == before.calibration.n - 1
        off = np.abs(after.calibration.coefficients - truth.calibration.coefficients)
        assert (off < 0.5 * truth.calibration.std_errors_with_reading + 1e-9).all()


def left_out(analysis):
    """Return the warnings of readings that were left out."""
    return [warning.text for warning in analysis.warnings if warning.code == "reading_left_out"]


def analyse_file(stairs, table, folder, **options):
    """Analyse a staircase with a table of elongations."""
    table.to_csv(folder / "e.csv", index=False)
    return analyse(stairs.recording(), folder / "e.csv", options=Options(mcmc=False, x_resolution_mm=0.0, **options))
