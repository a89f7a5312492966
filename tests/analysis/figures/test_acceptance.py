"""What is called poor of a calibration: both sides of each bound, and the bounds from the published curves."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from analysis import Options, analyse
from analysis.calibration.fit import fit_calibration
from analysis.figures.acceptance import BOUNDS, LEAST_R2, shortfalls
from analysis.figures.figure import Figure
from tests.analysis.boat_builder import Plant, Staircase

PUBLISHED = (1651.9842, 46.4413, -2.6934, -0.36251)
X = np.linspace(-2.7, 3.8, 37)
Y = np.polynomial.polynomial.polyval(X, PUBLISHED)


def sensor(y, **figures):
    return SimpleNamespace(calibration=fit_calibration(X, y), figures=figures)


def scattered(r2):
    """The published curve with residuals that a cubic cannot follow, so large that R2 comes near `r2`."""
    ripple = np.cos(np.pi * np.arange(X.size))
    return Y + ripple * np.sqrt((1 - r2) * np.var(Y))


@pytest.mark.parametrize(
    ("r2", "reading_sd", "poor"),
    [(0.99971, 0.0, False), (LEAST_R2 + 2e-4, 0.0, False), (LEAST_R2 - 2e-4, 0.0, True), (0.75, 0.0, True),
     (0.994, 0.5 / math.sqrt(12), False), (0.95, 0.5 / math.sqrt(12), True)],
)  # fmt: skip
def test_the_published_fit_is_good_and_four_times_its_residual_variance_the_limit(r2, reading_sd, poor):
    """R2 on both sides of its bound; readings on a half-millimetre grid are allowed what the grid makes, not more."""
    found = shortfalls(sensor(scattered(r2)), reading_sd)
    assert bool(found) is poor
    assert all(str(one).startswith("R² 0.") and one.source for one in found)


@pytest.mark.parametrize("bound", BOUNDS, ids=lambda b: b.name)
def test_a_figure_is_poor_beyond_its_bound_with_its_interval(bound):
    """Just inside, just beyond, beyond with an interval that reaches back: only what is surely beyond is poor."""
    away = -1.0 if bound.least else 1.0
    for off, half, poor in ((-0.1, 0.01, False), (0.1, 0.01, True), (0.1, 0.2, False), (0.1, math.nan, True)):
        value = bound.bound + away * off
        found = shortfalls(sensor(Y, **{bound.name: Figure(value, bound.unit, 5, value - half, value + half)}), 0.0)
        assert [str(one) for one in found] == (
            [f"{bound.words} {value:.1f} {bound.unit} (at {'least' if bound.least else 'most'} {bound.bound:.1f})"]
            if poor else []
        )  # fmt: skip


def test_the_bound_of_the_combined_error_is_that_of_the_published_curve():
    """Twice: largest distance of the published cubic of sensor 1 from its straight line, with 4.95 % hysteresis."""
    x = np.linspace(-2.7, 3.8, 4001)
    y = np.polynomial.polynomial.polyval(x, PUBLISHED)
    line = np.polynomial.Polynomial.fit(x, y, 1)
    combined = math.hypot(100 * np.abs(y - line(x)).max() / abs(y[-1] - y[0]), 4.95)
    (bound,) = (b.bound for b in BOUNDS if b.name.startswith("combined"))
    assert bound == pytest.approx(2 * combined, abs=0.1)


def test_without_a_calibration_nothing_is_poor_and_nothing_is_said():
    """A run without readings has another obstacle."""
    assert shortfalls(SimpleNamespace(calibration=None, figures={}), 0.1) == ()


def test_a_flag_of_a_reading_says_which_plateau_with_units(tmp_path):
    """A millimetre too much at one plateau: value, pressure, branch, cycle and the signal's unit are in its flag."""
    stairs = Staircase(cycles=2)
    table = stairs.elongations()
    row = len(table) - 5  # the last cycle ends at its highest pressure: loading
    table.loc[row, "elongation_mm"] += 1.0
    table.to_csv(tmp_path / "e.csv", index=False)
    found = analyse(stairs.recording(), tmp_path / "e.csv", options=Options(mcmc=False, x_resolution_mm=0.0))
    said = next(f["text"] for f in found.flags if f["code"] == "calibration" and f["text"].startswith("s1"))
    pressure, x = table.loc[row, "pressure_kpa"], table.loc[row, "elongation_mm"]
    assert f"the reading {x:+.2f} mm at {pressure:+.0f} kPa, loading, cycle 2 is " in said
    assert " mV off the curve" in said


@pytest.mark.parametrize("grid_mm", [0.1, 0.5])
def test_a_sound_session_is_not_called_poor(tmp_path, grid_mm):
    """The published sensors with their noise and loop, read on a grid up to half a millimetre: nothing is poor."""
    stairs = Staircase(Plant(loop_mm=0.25), cycles=2)
    table = stairs.elongations()
    table["elongation_mm"] = grid_mm * np.round(table["elongation_mm"] / grid_mm)
    table.to_csv(tmp_path / "e.csv", index=False)
    found = analyse(stairs.recording(), tmp_path / "e.csv", options=Options(mcmc=False, x_resolution_mm=grid_mm))
    assert [shortfalls(sensor, found.reading_sd_mm) for sensor in found.sensors] == [(), ()]
