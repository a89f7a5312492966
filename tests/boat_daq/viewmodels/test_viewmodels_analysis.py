"""Helper processes, calibration, repeatability, runs and optics: what comes back, what is stored, what is refused."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest

from analysis.errors import AnalysisError
from analysis.figures.figure import SENSOR_FIGURES
from analysis.optics.scene.curves import parametric_elongations
from boat_daq.engine.plan import built_in_plans
from boat_daq.engine.settings import UnitLibrary
from boat_daq.engine.snapshot import Progress, SessionState
from boat_daq.errors import OperatorError
from boat_daq.viewmodels.common.jobs import Job, JobRunner, JobState
from boat_daq.viewmodels.common.notices import Notices
from boat_daq.viewmodels.live.conversion import Preparation, prepare
from boat_daq.viewmodels.models import optics_jobs
from boat_daq.viewmodels.models.optics import PAPER, OpticsModel
from boat_daq.viewmodels.models.optics_jobs import SweepSummary
from boat_daq.viewmodels.results import calibration_jobs, run_jobs
from boat_daq.viewmodels.results.analysis_view import PosteriorResult, figure_text
from boat_daq.viewmodels.results.calibration import CalibrationModel, measured
from boat_daq.viewmodels.results.repeatability import GROUPS, RepeatabilityModel
from boat_daq.viewmodels.results.runs import RunsModel, read_run
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, services_in


def until(condition, timeout_s=60.0):
    """Wait for what another process or thread does."""
    end = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Two cycles of SA1 on the virtual board, every plateau read."""
    from boat_daq.commands.demo import record_on_virtual_board

    path = tmp_path_factory.mktemp("runs") / "SA1.boat"
    plan = dataclasses.replace(built_in_plans()["calibration"], cycles=2)
    record_on_virtual_board(path, plan, unit="SA1", seed=0, speed=50.0)
    return path


@pytest.fixture(scope="module")
def result(recording):
    return calibration_jobs.analyse_run(str(recording))


# ---- helper processes -----------------------------------------------------------------------------------------------


def slow_square(n, *, progress):
    """Square in ten steps."""
    for i in range(10):
        progress(i + 1, 10)
    return n * n


def refuse():
    """Refuse in the house's way."""
    raise OperatorError("the run has no sensor", "Record one.")


def leave():
    """End without a word."""
    import os

    os._exit(3)


def pause(seconds):
    """Wait."""
    time.sleep(seconds)


def test_work_comes_back_with_progress():
    """A function named by its place runs in another process; progress and result arrive by polling alone."""
    job = Job("Squaring", slow_square, 12)
    until(lambda: job.poll() is not JobState.RUNNING)
    assert (job.state, job.result, job.permille) == (JobState.DONE, 144, 1000)


def test_a_refusal_and_a_crash_are_told_apart():
    """An error of ours keeps cause and remedy; a process that just ends is said to have ended."""
    refused, crashed = Job("Refusing", refuse), Job("Crashing", leave)
    until(lambda: refused.poll() is not JobState.RUNNING and crashed.poll() is not JobState.RUNNING)
    assert (refused.failure.cause, refused.failure.remedy) == ("the run has no sensor", "Record one.")
    assert "ended before its result" in crashed.failure.cause


def test_cancelling_ends_the_process():
    """A cancelled work is over at once, and its place on the bench is free."""
    bench, ended = JobRunner(), []
    job = bench.start("long", Job("Sleeping", pause, 60), ended.append)
    bench.cancel("long")
    bench.poll()
    assert job.state is JobState.CANCELLED
    assert ended == [job]
    assert bench.get("long") is None


# ---- calibration ----------------------------------------------------------------------------------------------------


def model_on(tmp_path, result=None):
    units, services = UnitLibrary(tmp_path / "units"), services_in(tmp_path)
    model = CalibrationModel(RecordedSession(connected()), units, JobRunner(), services)
    model.show(result)
    return model


def test_a_run_comes_back_as_the_page_draws_it(result):
    """Points, curve and loops of both sensors, near the unit's own figures."""
    assert (result.unit, result.cycles, result.simulated, result.calibrated) == ("SA1", 2, True, True)
    for sensor, expected in zip(result.sensors, (39.3, 29.2), strict=True):
        assert sensor.x.size == sensor.y.size == sensor.residuals.size == sensor.loading.size
        assert np.all(np.diff(sensor.grid) > 0)
        assert np.all(sensor.band_95[0] <= sensor.band_68[0])
        assert np.all(sensor.band_68[0] <= sensor.curve)
        assert sensor.content["figures"]["sensitivity_mv_per_mm"] == pytest.approx(expected, rel=0.05)
    labels = {row.name for row in result.figures}
    assert labels <= {definition.label for definition in SENSOR_FIGURES.values()}
    assert len(labels) > 9


def test_accepting_stores_and_the_stored_converts(tmp_path, result):
    """What is accepted is in the unit's history, and converts its own points back to their elongations."""
    model = model_on(tmp_path, result)
    assert model.obstacle() is None
    model.accept("tester")
    stored = UnitLibrary(tmp_path / "units").load("SA1").calibration
    assert stored.operator == "tester"
    assert stored.content["simulated"] is True
    conversion = prepare(stored.content)
    signal = np.column_stack([np.interp(1.0, s.grid, s.curve)[None] for s in result.sensors])
    assert conversion(signal).mm[0] == pytest.approx(1.0, abs=0.02)
    assert conversion.each(signal)[0] == pytest.approx([1.0, 1.0], abs=0.02)
    assert np.isnan(conversion(np.array([[0.0, 0.0]])).mm[0])


def test_the_next_calibration_is_compared_with_the_last(tmp_path, result):
    """The same run against itself differs by nothing; without a history it says so."""
    model = model_on(tmp_path, result)
    assert "no earlier calibration" in model.comparison()
    model.accept()
    again = model_on(tmp_path, result)
    assert "Sensor 1: \u25cf agrees" in again.comparison()
    assert "0.0 mV" in again.comparison()
    grid, curve, apart = again.curve(0).previous
    assert curve == pytest.approx(np.interp(grid, result.sensors[0].grid, result.sensors[0].curve), abs=1e-3)
    assert np.abs(apart).max() < 1e-9
    rows = again.coefficient_rows()
    assert len(rows) == 8
    assert rows[0].cells[1] == rows[0].cells[2]
    assert model_on(tmp_path).coefficient_rows() == ()


def test_an_acceptance_can_be_undone(tmp_path, result):
    """Undo brings the calibration before back into force, or none; nothing stored is ever taken away."""
    services, units = services_in(tmp_path), UnitLibrary(tmp_path / "units")
    history = services.undo
    model = CalibrationModel(RecordedSession(connected()), units, JobRunner(), services)
    model.show(result)
    model.accept()
    history.undo()
    assert (units.load("SA1").calibration, model.accepted) == (None, None)
    history.redo()
    first = units.load("SA1").calibration
    assert model.accepted == first
    model.show(dataclasses.replace(result, path="another.boat"))
    model.accept()
    assert units.load("SA1").calibration.recording == "another.boat"
    history.undo()
    again = units.load("SA1").calibration
    assert (again.recording, again.content) == (first.recording, first.content)
    assert len(units.load("SA1").history) == 5


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (39.337, 0.118, "39.34(12)"),
        (-2.7, 0.0996, "\u22122.70(10)"),
        (1650.4, 12.0, "1\u2009650(12)"),
        (1.0, 0.0, "1.000"),
    ],
)
def test_a_value_with_its_standard_error(value, error, text):
    """Two digits of the standard error, in units of the value's last."""
    assert measured(value, error) == text


def test_curve_and_band_belong_together(tmp_path, result):
    """Once the posterior is there, its mean is the curve, inside its own bands, and the residuals are about it."""
    model = model_on(tmp_path, result)
    shown = model.curve(0)
    assert (shown.sampled, shown.new_reading_95) == (False, None)
    sensor = result.sensors[0]
    mean = sensor.curve + 5.0
    bands = [(mean - width, mean + width) for width in (1.0, 2.0, 4.0)]
    model.posterior = (PosteriorResult(sensor.grid, mean, *bands, {}),)
    shown = model.curve(0)
    assert shown.curve is mean
    assert np.all((shown.band_95[0] <= shown.band_68[0]) & (shown.band_68[0] <= shown.curve))
    assert shown.residuals == pytest.approx(sensor.residuals - 5.0, abs=1e-2)


def test_a_curve_that_turns_is_not_accepted(tmp_path, result):
    """A calibration without an inverse is refused with the sensor's name, and nothing is stored."""
    bent = dict(result.sensors[0].content) | {"fit": result.sensors[0].content["fit"] | {"monotone": False}}
    sensors = (dataclasses.replace(result.sensors[0], content=bent), result.sensors[1])
    model = model_on(tmp_path, dataclasses.replace(result, sensors=sensors))
    assert "Sensor 1: the curve turns" in str(model.obstacle())
    with pytest.raises(OperatorError):
        model.accept()
    assert UnitLibrary(tmp_path / "units").names() == []


def test_nothing_is_analysed_while_a_sequence_runs(tmp_path):
    """The recording is not closed under a run."""
    model = model_on(tmp_path)
    model.session.change(state=SessionState.RUNNING)
    with pytest.raises(OperatorError, match="in progress"):
        model.analyse_current()
    model.session.change(state=SessionState.IDLE)
    with pytest.raises(OperatorError, match="no recording"):
        model.analyse_current()


def test_a_damaged_file_is_said_with_its_reason(tmp_path):
    """An analysis that cannot be made ends in words, not in a traceback."""
    path = tmp_path / "broken.boat"
    path.write_bytes(b"no recording")
    model = model_on(tmp_path)
    model.analyse(path)
    until(lambda: (model.jobs.poll(), model.failure)[1] is not None)
    state, words = model.verdict()
    assert state == "fault"
    assert "broken.boat" in words


def test_the_live_conversion_is_prepared_beside_the_window(tmp_path, result):
    """The inverse comes from the helper thread once, and not again."""
    preparation = Preparation()
    preparation.ask({"sensors": [dict(s.content) for s in result.sensors]})
    found = []
    until(lambda: found.append(preparation.poll()) or found[-1] is not None)
    assert preparation.poll() is None
    preparation.close()


def test_figures_say_definition_and_interval():
    """A figure's cell is its value; definition, interval, count and reason are on hover."""
    from analysis.figures.figure import Figure, Reason

    cell = figure_text(Figure(39.31, "mV/mm", 5, 39.0, 39.6, definition="end to end"), 1)
    assert (cell.text, cell.tip) == ("39.3", "end to end\n95 %: 39.0 to 39.6 mV/mm\nn = 5")
    assert figure_text(Figure.nothing("dB", Reason.NO_FULL_SCALE, "no span"), 1).text == "\u2013"
    assert figure_text(None, 1).text == "\u2013"


# ---- repeatability --------------------------------------------------------------------------------------------------


def test_cycles_in_groups_cover_all_once(result):
    """However many cycles, at most a dozen groups, each cycle in exactly one."""
    model = RepeatabilityModel(JobRunner())
    for n in (1, 2, 12, 13, 100):
        model.show(dataclasses.replace(result, cycles=n))
        groups = model.groups()
        assert len(groups) <= GROUPS
        assert [cycle for group in groups for cycle in group] == list(range(n))


def test_drift_begins_at_the_first_cycle(result):
    """The change of both ends is counted from the first cycle."""
    model = RepeatabilityModel(JobRunner())
    model.show(result)
    numbers, top, bottom = model.extremes(0)
    assert numbers.tolist() == [1.0, 2.0]
    assert (top[0], bottom[0]) == (0.0, 0.0)


def test_every_cycle_has_its_figures(result):
    """Sensitivity by the readings of each cycle near the run's own; SNR and hysteresis near the run's."""
    model = RepeatabilityModel(JobRunner())
    assert model.warm_up() == ""
    model.show(result)
    each = model.cycles(0)
    assert each.sensitivity_unit == "mV/mm"
    assert each.sensitivity == pytest.approx([39.3, 39.3], rel=0.02)
    assert each.snr_db == pytest.approx([result.sensors[0].content["figures"]["snr_db"]] * 2, abs=1.0)
    assert each.hysteresis_percent_fso == pytest.approx(
        [result.sensors[0].content["figures"]["system_hysteresis_percent_fso"]] * 2, abs=0.5
    )
    long = dataclasses.replace(each, warm_up=3)
    sensors = tuple(dataclasses.replace(s, cycles=long) for s in result.sensors)
    model.show(dataclasses.replace(result, sensors=sensors, cycles=100))
    assert model.warm_up() == "warm-up: cycles 1 to 3"


def test_a_running_plan_is_read_again_now_and_then(recording):
    """Only a continuous run, only after new cycles, and never more often than the share of the machine allows."""
    now, asked = [100.0], []
    model = RepeatabilityModel(JobRunner(), lambda: now[0])
    model.analyse = lambda path, label="": asked.append(path)
    progress = Progress("repeatability", 9, 200, 5, 100, 4, (), "loading", "ramping", 50.0, 1.0, 90.0, 900.0)
    plan = built_in_plans()["repeatability"]
    running = dataclasses.replace(
        connected(), state=SessionState.RUNNING, recording=recording, progress=progress, plan=plan
    )
    model.follow(running)
    model.follow(running)
    assert len(asked) == 1
    now[0] += 60.0
    model.follow(running)
    assert len(asked) == 1
    model.follow(dataclasses.replace(running, progress=dataclasses.replace(progress, complete_cycles=5)))
    assert len(asked) == 2
    model.follow(dataclasses.replace(running, plan=built_in_plans()["calibration"]))
    assert len(asked) == 2
    over = dataclasses.replace(running, state=SessionState.IDLE, progress=None)
    model.follow(over)
    assert len(asked) == 2
    now[0] += 1.0
    for _ in range(3):
        model.follow(over)
    assert len(asked) == 3


# ---- runs -----------------------------------------------------------------------------------------------------------


def test_runs_are_listed_with_what_they_are(recording, tmp_path):
    """Unit, length, cycles and readings stand in the list; a broken file stands there with its reason."""
    run = read_run(recording)
    assert run.cells[1].startswith("SA1")
    assert "SIMULATED" in run.cells[1]
    assert run.cells[4].startswith("2")
    assert run.cells[5] == "37"
    assert len(run.outline) >= 2
    broken = tmp_path / "x.boat"
    broken.write_bytes(b"")
    assert read_run(broken).cells[6].startswith("\u25a0")


def test_the_list_comes_by_polling(recording, tmp_path):
    """The folder is read beside the window; a second look without change is no change."""
    model = RunsModel(recording.parent, UnitLibrary(tmp_path), JobRunner(), Notices())
    model.scan()
    until(lambda: (model.poll(), model.runs)[1])
    revision = model.revision
    model.scan()
    until(lambda: (model.poll(), model._future is None)[1])
    assert model.revision == revision
    assert model.interrupted() == []
    with pytest.raises(OperatorError, match="one recording"):
        model.export([], tmp_path / "x.csv")
    with pytest.raises(OperatorError, match="no recording"):
        model.report([], tmp_path / "x.pdf")
    with pytest.raises(OperatorError, match="chosen to compare"):
        model.compare([recording])
    model.close()


def test_exports_read_back(recording, tmp_path):
    """The exported CSV has every sample."""
    from analysis import load_recording

    files = run_jobs.export_run(recording, tmp_path / "run.csv", "csv")
    assert load_recording(files[0]).n == load_recording(recording).n


def test_a_run_compared_with_itself_differs_by_nothing(recording, tmp_path):
    """The difference of two equal runs is zero over the range."""
    model = RunsModel(recording.parent, UnitLibrary(tmp_path), JobRunner(), Notices())
    model.comparison = run_jobs.compare_runs([recording, recording])
    lines, words = model.comparison_lines()
    assert len(lines) == 2
    assert np.abs(lines[0][1][1]).max() < 1e-6
    assert words == "1: SA1   2: SA1"
    model.close()


# ---- optics ---------------------------------------------------------------------------------------------------------


def test_a_design_comes_with_all_its_states():
    """Fifteen scenes, one NDR each; the rays of a scene lie between emitter and receiver."""
    found = optics_jobs.trace_design(PAPER, 60)
    assert len(found.scenes) == found.ndr.size == 15
    assert np.all((found.ndr >= 0) & (found.ndr <= 350))
    rays = found.scenes[7].released
    assert np.nanmin(rays[:, 0]) >= -1.0
    model = OpticsModel(JobRunner())
    model.result = found
    model.state = 0
    assert "state 0 of 14" in model.state_text()
    assert model.scene() is found.scenes[0]


def test_a_cell_of_a_map_is_its_design():
    """A click takes spacing across and depth up; beside the map it takes nothing."""
    chosen = []
    model = OpticsModel(JobRunner())
    model.choose = lambda values, face: chosen.append((values, face))
    model.pick(5, 1.0, 4.3, 0.2)
    model.pick(5, 1.0, 6.5, 0.2)
    assert chosen == [((5, 1.0, 0.5, 0.9), "outer")]


def test_a_map_holds_each_design_in_its_place():
    """P stands at [spacing, depth]; what was not simulated is NaN."""
    values = np.array([[5, 1.0, 0.5, 0.9], [5, 1.0, 1.0, 0.5], [3, 1.0, 0.5, 0.9]])
    flags = np.zeros(3, bool)
    p = np.array([0.3, 0.7, 0.9])
    sweep = SweepSummary(values, p, p, p, p, flags, flags, 2, 0, np.array([3, 2, 1]), 1.0, 45, 9, 250)
    grid = sweep.grid(5, 1.0, (0.5, 0.6, 0.7, 0.8, 0.9, 1.0))
    assert grid[4, 0] == 0.3
    assert grid[0, 5] == 0.7
    assert np.isnan(grid).sum() == 34


def test_curves_go_by_a_word_or_a_file(tmp_path):
    """The parametric states' own elongation is found from the guides; a file of one state is refused by its name."""
    curves = optics_jobs.curves_of("parametric")
    assert np.allclose(optics_jobs.elongations_of("parametric", curves), parametric_elongations())
    path = tmp_path / "one.csv"
    rows = [f"{x},{z}" for x, z in curves[7, 0]]
    path.write_text("x,z\n" + "\n".join(rows), encoding="utf-8")
    with pytest.raises(AnalysisError, match="one state only"):
        optics_jobs.curves_of(str(path))
