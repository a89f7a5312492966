"""`boat-daq history`: the control chart of a unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from protocol.base.errors import BoatDaqError
from tests.analysis.boat_builder import PAPER, Plant, Staircase, write_boat
from tests.boat_daq.commands.calls import call


def test_calibrations_are_charted_in_order_of_time(tmp_path: Path) -> None:
    """En is the difference of two calibrations over its U, drift is their step, and an unreadable file is named."""
    for day, offset in ((2, 1.0), (1, 0.0)):
        cubics = tuple((c[0] + offset, *c[1:]) for c in PAPER)
        plan = Staircase(Plant(cubics=cubics, loop_mm=0.25, seed=day), cycles=2)
        plan.elongations().to_csv(tmp_path / f"run{day}.elongation.csv", index=False)
        meta = {"uuid": str(day), "started_utc": f"2026-01-0{day}T00:00:00+00:00"}
        write_boat(tmp_path / f"run{day}.boat", plan.recording(), meta=meta)
    (tmp_path / "bad.csv").write_text("no numbers\n")
    found = call("history", tmp_path, "--unit", "SA1")
    first, second = found["sensors"][0]["calibrations"]
    assert (first["started_utc"][:10], second["started_utc"][:10]) == ("2026-01-01", "2026-01-02")
    step = second["value_mv"] - first["value_mv"]
    assert step == pytest.approx(1.0, abs=0.6)
    assert second["en"] == pytest.approx(step / np.hypot(first["expanded_mv"], second["expanded_mv"]))
    drift = second["coefficients"][0] - first["coefficients"][0]
    assert found["sensors"][0]["drift_per_calibration"][0] == pytest.approx(drift)
    assert first["en"] is None
    assert found["left_out"][0]["run"] == "bad.csv"
    interval = found["sensors"][0]["interval"]
    assert interval["void"] == ""
    assert 0 < interval["days"] <= 2
    assert found["interval"]["days"] == min(sensor["interval"]["days"] for sensor in found["sensors"])
    assert second["u_elongation_mm"] == pytest.approx(interval["limit_mm"])
    with pytest.raises(BoatDaqError, match="no calibration of unit 'SB9'"):
        call("history", tmp_path, "--unit", "SB9")
    with pytest.raises(BoatDaqError, match="without a name"):
        call("history", tmp_path, "--unit", " ")


def test_simulated_and_real_runs_are_separate_histories(tmp_path: Path) -> None:
    """A virtual SA1 used to be charted together with the SA1 on the bench."""
    for day, simulated in ((1, False), (2, True)):
        plan = Staircase(Plant(loop_mm=0.25, seed=day), cycles=2)
        plan.elongations().to_csv(tmp_path / f"run{day}.elongation.csv", index=False)
        meta = {"uuid": str(day), "started_utc": f"2026-01-0{day}T00:00:00+00:00", "simulated": simulated}
        write_boat(tmp_path / f"run{day}.boat", plan.recording(), meta=meta)
    for options, kind, other in (
        ((), False, "simulated"),
        (("--real",), False, "simulated"),
        (("--simulated",), True, "real"),
    ):
        found = call("history", tmp_path, "--unit", "SA1", *options)
        assert found["simulated"] is kind
        assert len(found["sensors"][0]["calibrations"]) == 1
        assert found["left_out"] == [{"run": f"run{1 if kind else 2}.boat", "reason": f"of a {other} board"}]
    with pytest.raises(BoatDaqError, match="simulated and real runs are not compared"):
        call("report", tmp_path / "run1.boat", tmp_path / "run2.boat", "--no-mcmc", "--out", tmp_path / "r.html")
