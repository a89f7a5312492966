"""Readings on a grid: whether readings of one value share their error."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import fit_calibration
from analysis.calibration.quantised_x import share_their_error
from tests.analysis.boat_builder import PAPER

TRUTH = np.polynomial.Polynomial(PAPER[0])
GRID_SD = 1.0 / 12**0.5


@pytest.mark.parametrize(("noise_mv", "cycles", "shared"), [(0.3, 5, True), (0.3, 1, False), (30.0, 5, False)])
def test_signals_show_whether_readings_share_their_error(noise_mv: float, cycles: int, shared: bool) -> None:
    """The same ten positions again and again, or fifty of them once each, on one grid: distinguished in 20 of 20 runs.

    It fails where the noise is as large as the grid times the slope: independence is then not refuted.
    """
    verdicts = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        true = np.tile(rng.uniform(-2.7, 3.8, 50 // cycles), cycles)
        y = TRUTH(true) + noise_mv * rng.standard_normal(true.size)
        fitted = fit_calibration(np.round(true), y)
        verdicts.append(share_their_error(fitted.fit, fitted.x, fitted.y, GRID_SD))
    assert verdicts.count(shared) == 20


def test_cells_end_where_a_single_readings_rounding_does() -> None:
    """A reading may be off by half a mark; cells that reach 0.4 % further widen the posterior's band by 2 %."""
    x = np.linspace(-2.5, 3.5, 13)
    found = fit_calibration(x, TRUTH(x) + np.sin(7.0 * x)).with_reading(GRID_SD, np.arange(x.size)).reading
    assert found is not None
    assert found.edges[:, [0, -1]] - x[:, None] == pytest.approx(np.tile([-0.5, 0.5], (x.size, 1)), abs=3e-4)


def test_the_cells_of_scattered_readings_have_their_mean_and_variance() -> None:
    """Each position is read ten times by a reader as uncertain as the grid: its likelihood is nearly normal."""
    rng = np.random.default_rng(1)
    true, labels = np.repeat(rng.uniform(-2.7, 3.8, 20), 10), np.repeat(np.arange(20), 10)
    read = np.round(true + rng.standard_normal(true.size))
    fitted = fit_calibration(read, TRUTH(true) + 0.1 * rng.standard_normal(true.size))
    found = fitted.with_reading(GRID_SD, labels).reading
    assert found is not None
    middle, width = 0.5 * (found.edges[:, 1:] + found.edges[:, :-1]), np.diff(found.edges)
    mean = (found.shares * middle).sum(axis=1)
    variance = (found.shares * ((middle - mean[:, None]) ** 2 + width**2 / 12.0)).sum(axis=1)
    assert mean == pytest.approx(found.x, abs=0.02)
    assert variance == pytest.approx(found.x_variance, rel=0.05)
