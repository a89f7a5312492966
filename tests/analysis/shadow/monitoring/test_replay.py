"""A recording against the shadow: deviation, drift, alarms."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.shadow.model.reduced import ReducedModel
from analysis.shadow.monitoring.replay import drift, replay, replay_figure
from protocol.base.errors import DataError
from tests.analysis.shadow.simulated_actuator import Fault, Run, run_actuator


@pytest.fixture(scope="module")
def softening() -> Run:
    """Forty continuous cycles that soften from the twenty-first."""
    return run_actuator(40, Fault(begins=20, softening_percent_in_50=5.0), staircase=False)


def test_replay_raises_the_alarms_and_measures_the_deviation(table: ReducedModel, softening: Run) -> None:
    """Deviation, drift and alarms of a run; the summary holds a report's numbers."""
    result = replay(table, softening.time_s, softening.pressure_kpa, softening.elongations_mm, softening.cycles)
    summary = result.summary()
    assert summary["cycles"] == 40
    assert result.alarms[0].fault == "softening"
    assert 0.0 < float(summary["deviation_rms_mm"]) < 0.3  # type: ignore[arg-type]
    levels = np.array(summary["deviation_per_cycle_mm"])
    assert levels[0] == pytest.approx(float(np.nanmean(result.deviation_mm[softening.cycles[0]])))
    assert levels[-1] > levels[:20].max()  # a softer body is longer under pressure
    assert result.trend.endswith("significant")
    assert result.drift_interval[0] < result.drift_mm_per_cycle < result.drift_interval[1]
    assert result.left_out == ()
    figure = replay_figure(result)
    assert "deviation" in figure.axes[0].get_ylabel()
    assert any(t.get_text() == "softening" for t in figure.axes[1].texts)


def test_replay_leaves_out_what_is_no_cycle(table: ReducedModel, softening: Run) -> None:
    """A cycle without elongation is named; arrays that do not belong together, or hold nothing, are refused."""
    blind = softening.elongations_mm.copy()
    blind[softening.cycles[3]] = np.nan
    result = replay(table, softening.time_s, softening.pressure_kpa, blind, softening.cycles[:10])
    assert len(result.figures) == 9
    assert result.left_out[0].startswith("cycle 4")
    for x in (softening.elongations_mm[:-1], np.full(len(softening.time_s), np.nan)):
        with pytest.raises(DataError):
            replay(table, softening.time_s, softening.pressure_kpa, x, softening.cycles)


def test_drift_is_the_slope_over_cycles() -> None:
    """A straight line's slope, one outlier notwithstanding; NaN for fewer than three cycles."""
    levels = 0.01 * np.arange(12.0)
    levels[5] = 3.0
    assert drift(levels)[0] == pytest.approx(0.01, abs=1e-3)
    assert np.isnan(drift(np.array([1.0, np.nan, 2.0]))).all()
