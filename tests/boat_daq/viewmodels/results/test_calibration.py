"""The calibration page: acceptance, comparison, refusals."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from analysis.calibration.curve_choice import CurveCandidate
from analysis.calibration.record import CalibrationRecord
from analysis.fidelity import fidelity
from analysis.history.batch import readings_beside
from boat_daq.engine.settings import UnitLibrary
from boat_daq.engine.snapshot import SessionState
from boat_daq.viewmodels.results import calibration
from boat_daq.viewmodels.results.calibration import CalibrationModel
from boat_daq.viewmodels.results.calibration_texts import measured
from boat_daq.viewmodels.results.run_result import CurveBands
from boat_daq.workflows.jobs import JobFailure, JobRunner, JobState
from boat_daq.workflows.live_conversion import prepare
from protocol.base.errors import RequestError
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, services_in
from tests.boat_daq.gui.results.run_results import turning
from tests.boat_daq.viewmodels.helpers import until


def model_on(tmp_path, result=None):
    units, services = UnitLibrary(tmp_path / "units"), services_in(tmp_path)
    model = CalibrationModel(RecordedSession(connected()), units, JobRunner(), services)
    model.show(result)
    return model


def test_accepted_calibration_is_stored_and_converts(tmp_path, result):
    """What is accepted is in the unit's history, and converts its own points back to their elongations."""
    model = model_on(tmp_path, result)
    assert model.obstacle() is None
    model.accept()
    assert UnitLibrary(tmp_path / "units").load("SA1").calibration is None  # of a real unit
    stored = UnitLibrary(tmp_path / "units", simulated=True).load("SA1").calibration
    assert stored.recording == "SA1.boat"
    assert stored.content["simulated"] is True
    conversion = prepare(CalibrationRecord.parse(stored.content))
    signal = np.column_stack([np.interp(1.0, s.fit.grid, s.fit.curve)[None] for s in result.sensors])
    assert conversion(signal).mm[0] == pytest.approx(1.0, abs=0.02)
    assert conversion.each(signal)[0] == pytest.approx([1.0, 1.0], abs=0.02)
    assert np.isnan(conversion(np.array([[0.0, 0.0]])).mm[0])


def test_sampled_posterior_is_of_each_sensor(tmp_path, result, monkeypatch):
    """The sampler gets the points and the order of each accepted fit, and its curve lies near the fit."""

    class DoneJob:
        state = JobState.DONE

        def __init__(self, _label, function, sensors, level):
            assert level == fidelity().level
            self.result = function(sensors, "draft")

        def poll(self):
            return self.state

    monkeypatch.setattr("boat_daq.viewmodels.results.calibration.Job", DoneJob)
    model = model_on(tmp_path, result)
    before = model.revision
    model.sample()
    model.jobs.poll()
    assert model.revision == before + 1
    for bands, sensor in zip(model.posterior, result.sensors, strict=True):
        assert np.abs(np.interp(bands.grid, sensor.fit.grid, sensor.fit.curve) - bands.curve).max() < 5.0
    with pytest.raises(RequestError, match="no calibration yet"):
        model_on(tmp_path).sample()


def test_bands_that_cannot_be_sampled_leave_the_calibration(tmp_path, result, monkeypatch):
    """The cause is a message with its remedy; the verdict is still that of the calibration."""

    class RefusedJob:
        state, result = JobState.FAILED, None
        failure = JobFailure("the points lie on the curve exactly", "Skip the sampling.", "")

        def __init__(self, *_):
            pass

        def poll(self):
            return self.state

    monkeypatch.setattr("boat_daq.viewmodels.results.calibration.Job", RefusedJob)
    model = model_on(tmp_path, result)
    before = model.verdict(), model.headline()
    model.sample()
    model.jobs.poll()
    assert (model.verdict(), model.headline()) == before
    notice = model._services.notices.current()
    assert (notice.cause, notice.remedy) == (RefusedJob.failure.cause, RefusedJob.failure.remedy)


def test_run_is_compared_with_the_calibration_of_another_recording(tmp_path, result):
    """The same values of another run differ by nothing; its own calibration in force is no previous one."""
    model = model_on(tmp_path, result)
    assert "no earlier calibration" in model.comparison()
    model.accept()
    own = model_on(tmp_path, result)
    assert (own.before, own.agreements, own.verdict()[1][:10]) == (None, (), "\u2713 Accepted")
    assert "no earlier calibration" in own.comparison()
    assert model_on(tmp_path, dataclasses.replace(result, curve="4")).accepted is None
    again = model_on(tmp_path, dataclasses.replace(result, recording_id="another"))
    assert again.accepted is None
    assert "Sensor 1: \u25cf agrees" in again.comparison()
    assert "0.0 mV" in again.comparison()
    found, fit = again.agreement(0), result.sensors[0].fit
    assert found.before_mv == pytest.approx(np.interp(found.grid, fit.grid, fit.curve), abs=1e-3)
    assert np.abs(found.difference_mv).max() < 1e-9
    rows = again.coefficient_rows()
    assert [cells[0] for cells, _ in rows[:3]] == ["Sensor 1", "b\u2080, mV", "b\u2081, mV/mm"]
    assert (len(rows), rows[1][0][1]) == (10, rows[1][0][2])
    assert model_on(tmp_path).coefficient_rows() == []


def test_simulated_run_is_not_compared_with_a_real_calibration(tmp_path, result):
    """Nor the reverse: each is compared with and accepted into the library of its own kind."""
    units = UnitLibrary(tmp_path / "units")
    real = dataclasses.replace(result, simulated=False)
    for first, second in ((result, real), (real, result)):
        model_on(tmp_path, first).accept()
        model = model_on(tmp_path, dataclasses.replace(second, recording_id="another"))
        assert first is not result or model.before is None
        assert model.before is None or model.before.simulated is second.simulated
    assert len(units.load("SA1").history) == len(units.of(simulated=True).load("SA1").history) == 1
    assert "simulated unit" in model.verdict()[1] or model.accepted is None
    assert model.headline().startswith("SA1  SIMULATED")


def test_last_recording_of_the_other_kind_is_not_analysed_again(tmp_path, result):
    """With a real board connected, Calibrate used to take the last run of the virtual board."""
    taken = []
    units, services = UnitLibrary(tmp_path / "units"), services_in(tmp_path)
    session = RecordedSession(dataclasses.replace(connected(), simulated=False))
    model = CalibrationModel(session, units, JobRunner(), services, taken.append)
    model.show(result)
    model.last_path = tmp_path / "virtual.boat"
    with pytest.raises(RequestError, match="no recording yet"):
        model.analyse_current()
    assert taken == [False]


def test_acceptance_is_undone(tmp_path, result):
    """Undo brings the calibration before back into force, or none; nothing stored is ever taken away."""
    services, units = services_in(tmp_path), UnitLibrary(tmp_path / "units", simulated=True)
    history = services.undo
    model = CalibrationModel(RecordedSession(connected()), units, JobRunner(), services)
    model.show(result)
    model.accept()
    history.undo()
    assert (units.load("SA1").calibration, model.accepted) == (None, None)
    history.redo()
    first = units.load("SA1").calibration
    assert model.accepted.as_json() == first.content
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
def test_value_with_its_standard_error(value, error, text):
    """Two digits of the standard error, in units of the value's last."""
    assert measured(value, error) == text


def test_curve_and_band_belong_together(tmp_path, result):
    """Once the posterior is there, its mean is the curve, with its own bands."""
    model = model_on(tmp_path, result)
    fit = result.sensors[0].fit
    assert model.curve(0) is fit
    mean = fit.curve + 5.0
    bands = [(mean - width, mean + width) for width in (1.0, 2.0, 4.0)]
    found = CurveBands(fit.grid, mean, fit.residuals - 5.0, *bands[:2], {}, bands[2])
    model.posterior = (found,)
    assert model.curve(0) is found
    assert model.curve(1) is result.sensors[1].fit


def test_choice_of_a_curve_is_fitted_undone_and_stored(tmp_path, result, monkeypatch):
    """The run is analysed again by it, and by the one before on undo; what is accepted names it; a new run has none."""
    model, started = model_on(tmp_path, result), []
    monkeypatch.setattr(calibration, "Job", lambda label, job, path, **options: (path, options["curve"]))
    monkeypatch.setattr(model.jobs, "start", lambda name, job, then, first: started.append(job))
    with pytest.raises(RequestError, match="no run"):
        model.choose_curve("4")
    model.last_path = tmp_path / "a.boat"
    model.last_path.touch()
    for act in (lambda: model.choose_curve("4"), model._services.undo.undo, model._services.undo.redo):
        act()
    assert [curve for _, curve in started] == ["4", "", "4"]
    assert model.curve_shown == "4"
    model.choose_curve("4")
    assert len(started) == 3
    model.show(dataclasses.replace(result, curve="4"))
    model.accept()
    assert model.accepted.curve == "4"
    model.analyse(tmp_path / "b.boat")
    model._services.undo.undo()  # the acceptance
    model._services.undo.undo()  # of the run before: the one that is shown stays
    assert started[3:] == [(str(tmp_path / "b.boat"), "")]


def test_curves_are_compared_sensor_by_sensor(tmp_path, result):
    """The chosen one is marked; a curve without U has a dash and its reason; a spline has no uncertainty bands."""
    found = (CurveCandidate("3", "adequate", "it follows", 0.36, 0.0805), CurveCandidate("spline", void="it turns"))
    model = model_on(tmp_path, dataclasses.replace(result, candidates=(found, ())))
    rows = model.curve_rows()
    assert [cells[0] for cells, _ in rows] == ["Sensor 1", "\u25b8 Degree 3", "Spline", "Sensor 2"]
    assert rows[1] == (("\u25b8 Degree 3", "\u25cf adequate", "0.081", "0.36"), "it follows")
    assert rows[2] == (("Spline", "not tested", "\u2013", "\u2013"), "no U: it turns")
    assert model.samples()
    record = result.sensors[0].record
    spline = dataclasses.replace(record, fit={**record.fit, "curve": "spline"})
    model.show(dataclasses.replace(result, sensors=(dataclasses.replace(result.sensors[0], record=spline),)))
    assert not model.samples()
    with pytest.raises(RequestError, match="no uncertainty bands"):
        model.sample()


def test_cancelled_analysis_keeps_what_was_shown(tmp_path, result, monkeypatch):
    """Result, bands, acceptance and comparison stay, with the curve that they are of; another run leaves none."""

    class CancelledJob:
        state, first = JobState.CANCELLED, None

        def __init__(self, *args, **options):
            self.options = options

        def poll(self):
            return self.state

    monkeypatch.setattr(calibration, "Job", CancelledJob)
    model = model_on(tmp_path)
    model.last_path = tmp_path / "a.boat"
    model.last_path.touch()
    model.show(dataclasses.replace(result, curve="3"))
    model.accept()
    model.posterior = (result.sensors[0].fit,)
    shown = [getattr(model, name) for name in ("result", "before", "agreements", "posterior", "accepted")]
    for start in (lambda: model.choose_curve("4"), lambda: model.analyse(tmp_path / "a.boat")):
        start()
        assert model.working
        model.jobs.poll()
        kept = [getattr(model, name) for name in ("result", "before", "agreements", "posterior", "accepted")]
        assert all(one is other for one, other in zip(kept, shown, strict=True))
        assert (model.curve_shown, model.verdict()[0]) == ("3", "ok")
    model.analyse(tmp_path / "b.boat")
    model.jobs.poll()
    assert (model.result, model.choice, model.verdict()) == (None, "", ("", ""))


def test_result_ends_the_sampling_of_the_curve_before(tmp_path, result, monkeypatch):
    """Bands of another curve are never shown about the one that was fitted meanwhile."""
    model, cancelled = model_on(tmp_path, result), []
    model.posterior = (result.sensors[0].fit,)
    monkeypatch.setattr(model.jobs, "cancel", cancelled.append)
    model.show(dataclasses.replace(result, curve="4"))
    assert (cancelled, model.posterior) == (["posterior"], ())


def test_calibration_is_not_accepted_while_its_run_is_analysed_again(tmp_path, result, monkeypatch):
    """What is shown stays, its warnings too; it is not of the new curve, so that it cannot be accepted."""
    model = model_on(tmp_path, result)
    before = model.acceptance_warnings(), model.out_of_tolerance()
    monkeypatch.setattr(CalibrationModel, "working", True)
    assert model.verdict()[0] == ""
    assert model.detail() == "Analysing again \u2026"
    assert (model.acceptance_warnings(), model.out_of_tolerance()) == before
    with pytest.raises(RequestError, match="being analysed"):
        model.accept()


def test_curve_that_turns_is_not_accepted(tmp_path, result):
    """A calibration without an inverse is refused with the sensor's name, and nothing is stored."""
    sensors = (turning(result.sensors[0]), result.sensors[1])
    model = model_on(tmp_path, dataclasses.replace(result, sensors=sensors))
    assert "Sensor 1: the curve turns" in str(model.obstacle())
    with pytest.raises(RequestError):
        model.accept()
    assert UnitLibrary(tmp_path / "units").names() == []


def test_calibration_of_a_deleted_run_is_not_accepted(tmp_path, result):
    """It was stored from memory, with the name of a file that is not there."""
    model = model_on(tmp_path, result)
    model.last_path = tmp_path / "SA1.boat"
    with pytest.raises(RequestError, match="is gone"):
        model.accept()
    assert UnitLibrary(tmp_path / "units", simulated=True).names() == []


def test_analysis_is_refused_during_a_run(tmp_path):
    """The recording is not closed under a run."""
    model = model_on(tmp_path)
    model.session.change(state=SessionState.RUNNING)
    with pytest.raises(RequestError, match="in progress"):
        model.analyse_current()
    model.session.change(state=SessionState.IDLE)
    with pytest.raises(RequestError, match="no recording"):
        model.analyse_current()


def test_damaged_file_is_reported_with_its_cause(tmp_path):
    """An analysis that cannot be made is reported without a traceback."""
    path = tmp_path / "broken.boat"
    path.write_bytes(b"no recording")
    model = model_on(tmp_path)
    model.analyse(path)
    until(lambda: (model.jobs.poll(), model.failure)[1] is not None)
    state, words = model.verdict()
    assert state == "warning"
    notices = model._services.notices
    assert "broken.boat" in words and notices.current().cause in words
    assert "broken.boat" in notices.history_text()
    model.analyse(path)
    assert notices.current() is None


def test_file_of_readings_is_kept_beside_the_recording(tmp_path, monkeypatch):
    """It is copied to where every analysis finds it, and the run is analysed again; what is no such file is refused."""
    model, analysed = model_on(tmp_path), []
    monkeypatch.setattr(model, "analyse", analysed.append)
    model.last_path = tmp_path / "imported.boat"
    file = tmp_path / "notes.csv"
    file.write_text("pressure,mm\n1,2\n")
    with pytest.raises(RequestError, match="no column"):
        model.take_readings(file)
    file.write_text("pressure_kpa,elongation_mm\n50,3.8\n")
    model.take_readings(file)
    assert readings_beside(model.last_path).read_text() == file.read_text()
    assert analysed == [model.last_path]
