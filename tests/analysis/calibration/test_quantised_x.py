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
