"""A branch that was not driven is not a branch: vented staircases, fast vents, two levels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis import Options, Recording, analyse
from analysis.conformity import Conformity
from analysis.figures.acceptance import judge
from analysis.figures.figure import Reason
from analysis.figures.pipeline import Analysis
from analysis.reports.build import build_report
from tests.analysis.boat_builder import Plant

RATE = 50.0


def driven(steps: list[tuple[float, float, float]], cycles: int = 3) -> Recording:
    """Return a run of steps, each a pressure in kPa, the time of its ramp and its hold in s, that begins at 0 kPa."""
    pressure, loading, at = [np.zeros(int(2 * RATE))], [np.ones(int(2 * RATE), bool)], 0.0
    for level, ramp_s, hold_s in steps * cycles:
        ramp = np.linspace(at, level, max(round(ramp_s * RATE), 1), endpoint=False)
        pressure += [ramp, np.full(round(hold_s * RATE), level)]
        loading += [np.full(ramp.size + round(hold_s * RATE), level > at)]
        at = level
    whole = np.concatenate(pressure)
    plant = Plant(loop_mm=0.25, noise_mv=(1.0,), cubics=((1650.0, 40.0, 0.0, 0.0),), rate_hz=RATE)
    return plant.run(whole, np.concatenate(loading), np.zeros(whole.size))


def figures(run: Recording, file: Path | None = None) -> Analysis:
    """Return the analysis without a posterior."""
    return analyse(run, file, options=Options(mcmc=False, x_resolution_mm=0.0))


UP = [(float(level), 0.5, 2.0) for level in (10, 20, 30, 40, 50)]
DOWN = [(float(level), 0.5, 2.0) for level in (40, 30, 20, 10, 0)]
ONE_WAY = {
    "up, vented": [*UP, (0.0, 1.0, 2.0)],
    "up, vented in 0.2 s": [*UP, (0.0, 0.2, 2.0)],
    "down only": [(50.0, 0.2, 2.0), *DOWN],
    "up, one level on the way back": [*UP, (25.0, 0.5, 2.0), (0.0, 0.5, 2.0)],
    "slow rise, vent of 0.2 s": [(50.0, 10.0, 0.0), (0.0, 0.2, 0.0)],
    "slow rise, vent of 1 s": [(50.0, 10.0, 0.0), (0.0, 1.0, 0.0)],
}


@pytest.mark.parametrize("name", ONE_WAY)
def test_one_branch_has_no_hysteresis(name: str) -> None:
    """Void with its reason and code, also the combined error; a limit of it is undetermined."""
    analysis = figures(driven(ONE_WAY[name], cycles=4))
    sensor = analysis.sensors[0]
    found = sensor.figures["system_hysteresis_percent_fso"]
    assert np.isnan([found.value, found.low, found.high]).all()
    assert found.reason is Reason.ONE_BRANCH
    which = "unloading" if name == "down only" else "loading"
    assert found.void.startswith(f"only the {which} branch was driven: ")
    assert sensor.figures["combined_error_percent_fso"].void
    assert np.isnan(sensor.system_hysteresis_per_cycle).all()
    assert [one.conformity for one in judge([sensor], {"hysteresis": 2.0})] == [Conformity.UNDETERMINED]
    assert sensor.figures["fso_mv"].value > 100.0


def test_full_scale_of_a_slow_rise_and_a_fast_vent_is_that_of_both_ends() -> None:
    """6 mV/kPa over 50 kPa are 300 mV; the middle of a turn lies half a kPa before its end."""
    rise, vent = np.linspace(0.0, 50.0, 500, endpoint=False), np.linspace(50.0, 0.0, 10, endpoint=False)
    pressure = np.concatenate([np.tile(np.concatenate([rise, vent]), 6), np.zeros(100)])
    rng = np.random.default_rng(0)
    measured, signal = (
        v + sd * rng.standard_normal(v.size) for v, sd in ((pressure, 0.02), (1650 + 6 * pressure, 0.3))
    )
    run = Recording.from_arrays(np.arange(pressure.size) / RATE, measured, signal[:, None])
    found = figures(run).sensors[0].figures["fso_mv"]
    assert found.value == pytest.approx(300.0, rel=0.002)


def test_two_levels_drive_no_branch() -> None:
    """The ends were held and jumped between: no loop is seen."""
    found = figures(driven([(50.0, 0.2, 2.0), (0.0, 0.2, 2.0)])).sensors[0].figures["system_hysteresis_percent_fso"]
    assert found.void.startswith("no branch was driven: 9 samples are inside the range")


@pytest.mark.parametrize(
    "steps",
    [
        [*UP, *DOWN],
        [*UP, (30.0, 0.5, 2.0), (10.0, 0.5, 2.0), (0.0, 0.5, 2.0)],
        [(25.0, 0.5, 2.0), (50.0, 0.5, 2.0), (25.0, 0.5, 2.0), (0.0, 0.5, 2.0)],
        [(50.0, 10.0, 0.0), (0.0, 10.0, 0.0)],
        [(50.0, 10.0, 0.0), (0.0, 3.0, 0.0)],
    ],
    ids=["all levels", "half of the levels", "one level inside", "continuous", "three times as fast"],
)
def test_two_driven_branches_have_a_loop(steps: list[tuple[float, float, float]]) -> None:
    """Of a span of 3.61 mm, a loop of 0.25 mm near 10 kPa is 6.9 %; 0.20 mm at 25 kPa, alone held, 5.6 %."""
    found = figures(driven(steps)).sensors[0].figures["system_hysteresis_percent_fso"]
    assert not found.void
    assert found.value == pytest.approx(5.6 if len(steps) == 4 else 6.9, abs=0.7)


def test_a_cycle_of_one_branch_is_left_out_of_the_loop() -> None:
    """Two whole cycles and a vented one: the loop is that of the two."""
    analysis = figures(driven([*UP, *DOWN, *UP, (0.0, 1.0, 2.0), *UP, *DOWN], cycles=1))
    sensor = analysis.sensors[0]
    assert np.isnan(sensor.system_hysteresis_per_cycle).tolist() == [False, True, False]
    assert sensor.figures["system_hysteresis_percent_fso"].value == pytest.approx(6.9, abs=0.7)


def test_readings_of_one_branch_give_no_u_and_a_report_says_why(tmp_path: Path) -> None:
    """Steps up only, read at every hold: no loop of sensor or actuator, so no U; the report is written all the same."""
    steps = [*UP, (0.0, 0.2, 2.0)]
    levels = np.array([0.0, *(level for level, _, _ in steps * 3)])
    read = pd.DataFrame({"pressure_kpa": levels, "elongation_mm": Plant(loop_mm=0.25).elongation(levels, levels >= 0)})
    read.to_csv(tmp_path / "e.csv", index=False)
    analysis = figures(driven(steps), tmp_path / "e.csv")
    why = "only the loading branch was driven: no level inside the range was held on the other"
    assert analysis.sensors[0].calibration is not None
    assert analysis.sensors[0].figures["sensor_hysteresis_percent_fso"].void == why
    assert analysis.actuator_hysteresis.void == why
    assert analysis.u_reason == (f"the loop of the sensor is not known: {why}",)
    assert why in repr(build_report([analysis]))
