"""What the calibration page shows of a camera."""

from __future__ import annotations

import numpy as np
import pytest

from boat_daq.viewmodels.results.camera import camera_result
from tests.analysis.tracking.filmed_run import camera_analysis


def test_figures_of_the_continuous_record_are_beside_those_of_the_plateaus() -> None:
    """The plateaus' in the second line, loops and cycles as arrays."""
    analysis = camera_analysis()
    result = camera_result(analysis)
    assert result is not None
    assert analysis.camera is not None
    assert "0 missing" in result.text
    assert "corrected" in result.text
    sensitivity = result.rows[0]
    assert sensitivity[0][0] == "Sensitivity\nmV/mm"
    first, second = (float(part) for part in sensitivity[1][0].split("\n"))
    assert first == pytest.approx(analysis.camera.sensors[0].sensitivity_mv_per_mm, abs=0.01)
    assert second == pytest.approx(analysis.sensors[0].figures["sensitivity_mv_per_mm"].value, abs=0.01)
    for x, y in result.loops:
        assert np.isnan(y).sum() == 1
        assert np.nanmax(abs(y)) < 3.0
        assert x.size == y.size
    assert result.cycles.tolist() == [1.0, 2.0]
    assert [each.size for each in result.per_cycle] == [2, 2]
