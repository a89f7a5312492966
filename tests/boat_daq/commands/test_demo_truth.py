"""The demo's true values are those of the run: of the times that its levels were held."""

from __future__ import annotations

import pytest

from analysis import Options, analyse
from boat_daq.commands.demo import comparison, truth_of
from boat_daq.engine.plan import load_plan
from tests.boat_daq.viewmodels.helpers import SAMPLE

OF_HOLDS = ("full-scale output", "sensor hysteresis", "system hysteresis", "SNR", "noise, rms")


def test_truth_of_a_run_is_within_its_intervals() -> None:
    """A recording of the virtual board: what depends on its holds is within; every stated value has an interval."""
    found, plan = analyse(SAMPLE, options=Options(mcmc=False)), load_plan("calibration")
    rows = {row["figure"]: row for row in comparison(found, truth_of("SA1", plan, found))}
    stated = [row for row in rows.values() if row["truth"] is not None]
    assert all(row["interval"] is not None for row in stated)
    of_holds = [rows[f"s{number} {name}"] for number in (1, 2) for name in OF_HOLDS] + [rows["actuator hysteresis"]]
    outside = [row["figure"] for row in of_holds if not row["interval"][0] <= row["truth"] <= row["interval"][1]]
    assert outside == []
    of_plan = truth_of("SA1", plan).sensors[0]
    assert truth_of("SA1", plan, found).sensors[0].fso_mv == pytest.approx(of_plan.fso_mv, rel=0.01)
