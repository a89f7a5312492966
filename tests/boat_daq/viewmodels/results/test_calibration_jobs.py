"""The analysis of a run in a helper process."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.figures.figure import SENSOR_FIGURES


def test_analysis_returns_what_the_page_draws(result):
    """Points, curve and loops of both sensors, near the unit's own figures."""
    assert (result.unit, result.cycles, result.simulated, result.calibrated) == ("SA1", 2, True, True)
    for sensor, expected in zip(result.sensors, (39.3, 29.2), strict=True):
        assert sensor.x.size == sensor.y.size == sensor.residuals.size == sensor.loading.size
        assert np.all(np.diff(sensor.grid) > 0)
        assert np.all(sensor.band_95[0] <= sensor.band_68[0])
        assert np.all(sensor.band_68[0] <= sensor.curve)
        assert sensor.content["figures"]["sensitivity_mv_per_mm"] == pytest.approx(expected, rel=0.05)
    labels = {row.name for row in result.figures}
    assert labels <= {definition.label_with_unit for definition in SENSOR_FIGURES.values()}
    assert len(labels) > 9
