"""The repeatability page: groups of cycles, drift, a run that is followed."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from analysis.fidelity import fidelity
from analysis.stopping.criterion import DRIFT, SPREAD
from boat_daq.engine.plan import built_in_plans
from boat_daq.engine.snapshot import Phase, Progress, SessionState
from boat_daq.viewmodels.results.figure_tables import HYSTERESIS_KEY
from boat_daq.viewmodels.results.repeatability import CYCLE_FIGURES, GROUPS, RepeatabilityModel
from boat_daq.viewmodels.results.run_result import analyse_run
from boat_daq.workflows.jobs import JobRunner
from tests.boat_daq.gui.recorded_session import connected


def test_groups_cover_every_cycle_once(result):
    """However many cycles, at most a dozen groups, each cycle in exactly one."""
    model = RepeatabilityModel(JobRunner())
    for n in (1, 2, 12, 13, 100):
        model.show(dataclasses.replace(result, cycles=n))
        groups = model.groups()
        assert len(groups) <= GROUPS
        assert [cycle for group in groups for cycle in group] == list(range(n))


def test_cycles_are_shown_beside_the_figures_of_their_run(result):
    """Both ends have a mean of zero over the cycles; figure, interval and limit are those of the analysis."""
    model = RepeatabilityModel(JobRunner())
    model.show(result)
    assert model.numbers().tolist() == [1.0, 2.0]
    each, figures = result.sensors[0].cycles, result.sensors[0].record.figures
    assert each.ends.shape == (2, 2)
    assert each.ends.mean(axis=1) == pytest.approx([0.0, 0.0], abs=1e-9)
    assert each.whole[HYSTERESIS_KEY].value == pytest.approx(figures["system_hysteresis_percent_fso"], abs=0.01)
    hysteresis = next(shown for shown in CYCLE_FIGURES if shown.key == HYSTERESIS_KEY)
    assert model.limit(hysteresis) == (5.0, "limit \u2264 5 % FSO")
    apart = np.abs(result.loops.opened(0, each.full_scale_mv, np.arange(2))[1])
    assert np.nanmax(apart) == pytest.approx(max(each.hysteresis_percent_fso), abs=0.3)
    assert [row[0][0].partition(",")[0] for row in result.key_figures][:2] == ["Sensitivity", "Hysteresis"]


def test_every_cycle_has_its_figures(result):
    """Sensitivity by the readings of each cycle near the run's own; SNR and hysteresis near the run's."""
    model = RepeatabilityModel(JobRunner())
    assert model.warm_up() == ""
    model.show(result)
    each = result.sensors[0].cycles
    assert each.sensitivity_unit == "mV/mm"
    assert each.sensitivity == pytest.approx([39.3, 39.3], rel=0.02)
    assert each.snr_db == pytest.approx([result.sensors[0].record.figures["snr_db"]] * 2, abs=1.0)
    assert each.hysteresis_percent_fso == pytest.approx(
        [result.sensors[0].record.figures["system_hysteresis_percent_fso"]] * 2, abs=0.5
    )
    long = dataclasses.replace(each, warm_up=3)
    sensors = tuple(dataclasses.replace(s, cycles=long) for s in result.sensors)
    model.show(dataclasses.replace(result, sensors=sensors, cycles=100))
    assert model.warm_up() == "warm-up: cycles 1 to 3"


def test_what_is_known_of_drift_and_repeatability_has_its_unit(result):
    """Half widths of their intervals, of the worse sensor; an unknown one is left out."""
    model = RepeatabilityModel(JobRunner())
    assert model.known() == ""
    model.show(result)  # two cycles have no interval
    assert model.known() == ""
    model.show(dataclasses.replace(result, drift_half=0.42, spread_half=0.1349))
    assert model.known() == "95 % uncertainty: drift \u00b10.42 % FSO per 100 cycles, repeatability \u00b10.13 % FSO"
    model.show(dataclasses.replace(result, drift_half=math.nan, spread_half=12.0))
    assert model.known() == "95 % uncertainty: repeatability \u00b112 % FSO"
    model.show(dataclasses.replace(result, drift_half=math.nan, spread_half=math.nan))
    assert model.known() == ""


def test_the_intervals_are_those_at_which_a_run_ends(recording, monkeypatch):
    """Drift and repeatability of all sensors, as the assessment of a run with a % FSO asked for."""
    halves = {DRIFT: 0.4, SPREAD: 0.1}
    monkeypatch.setattr("analysis.stopping.criterion.half_width", lambda sensors, key: (halves[key] * len(sensors), ""))
    found = analyse_run(str(recording), level="draft")
    assert (found.drift_half, found.spread_half) == (0.8, 0.2)


def test_running_recording_is_analysed_again(recording):
    """Only a continuous run, only after new cycles, and never more often than the share of the machine allows."""
    now, requested = [100.0], []
    model = RepeatabilityModel(JobRunner(), lambda: now[0])
    model.analyse = lambda path, label="": requested.append(path)
    progress = Progress(9, 200, 5, 100, 4, (), "loading", "ramping", 50.0, 1.0, 90.0, 900.0)
    plan = built_in_plans()["repeatability"]
    running = dataclasses.replace(
        connected(), state=SessionState.RUNNING, recording=recording, progress=progress, plan=plan
    )
    model.follow(running)
    model.follow(running)
    assert len(requested) == 1
    now[0] += 60.0
    model.follow(running)
    assert len(requested) == 1
    model.follow(dataclasses.replace(running, progress=dataclasses.replace(progress, complete_cycles=5)))
    assert len(requested) == 2
    model.follow(dataclasses.replace(running, plan=built_in_plans()["calibration"]))
    assert len(requested) == 2
    over = dataclasses.replace(running, state=SessionState.IDLE, progress=None)
    model.follow(over)
    assert len(requested) == 2
    now[0] += 1.0
    for _ in range(3):
        model.follow(over)
    assert len(requested) == 3


def test_analysis_uses_the_chosen_fidelity(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The level goes with the work, as on the calibration page."""
    begun = Mock()
    monkeypatch.setattr("boat_daq.viewmodels.results.repeatability.Job", begun)
    model = RepeatabilityModel(Mock())
    for level in ("draft", "reference"):
        model.fidelity = fidelity(level)
        model.analyse(tmp_path / "run.boat")
        assert begun.call_args.kwargs["level"] == level


def test_what_a_run_in_progress_waits_for_is_said():
    """During the first cycles of a repeatability run it was "No repeatability run yet"."""
    model = RepeatabilityModel(Mock(get=lambda _: None))
    plan = built_in_plans()["repeatability"]
    progress = Progress(1, 100, 1, 100, 0, (), "unloading", Phase.RAMPING, 0.0, 0.0, 0.0, 100.0)
    running = dataclasses.replace(
        connected(), state=SessionState.RUNNING, plan=plan, progress=progress, recording=Path("run.boat")
    )
    revision = model.revision
    model.follow(running)
    assert model.missing() == ("The first results come after two cycles", "Cycle 1 is in progress.")
    assert (model.in_progress, model.revision) == (True, revision + 1)
    model.jobs.get = {"analysis": Mock()}.get
    model.follow(running)
    assert (model.missing()[0], model.revision) == ("Loading \u2026", revision + 2)
    model.jobs.get = lambda _: None
    model.follow(connected())
    assert (model.missing()[0], model.in_progress) == ("No repeatability run yet", False)
