"""The calibration page: acceptance, comparison, refusals."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from boat_daq.engine.settings import UnitLibrary
from boat_daq.engine.snapshot import SessionState
from boat_daq.errors import OperatorError
from boat_daq.viewmodels.common.jobs import JobRunner
from boat_daq.viewmodels.live.conversion import prepare
from boat_daq.viewmodels.results.analysis_view import PosteriorResult
from boat_daq.viewmodels.results.calibration import CalibrationModel, measured
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, services_in
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
    model.accept("tester")
    stored = UnitLibrary(tmp_path / "units").load("SA1").calibration
    assert stored.operator == "tester"
    assert stored.content["simulated"] is True
    conversion = prepare(stored.content)
    signal = np.column_stack([np.interp(1.0, s.grid, s.curve)[None] for s in result.sensors])
    assert conversion(signal).mm[0] == pytest.approx(1.0, abs=0.02)
    assert conversion.each(signal)[0] == pytest.approx([1.0, 1.0], abs=0.02)
    assert np.isnan(conversion(np.array([[0.0, 0.0]])).mm[0])


def test_next_calibration_is_compared_with_the_previous(tmp_path, result):
    """The same run against itself differs by nothing; without a history this is reported."""
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
    assert rows[0][0][1] == rows[0][0][2]
    assert model_on(tmp_path).coefficient_rows() == []


def test_acceptance_is_undone(tmp_path, result):
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
def test_value_with_its_standard_error(value, error, text):
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


def test_curve_that_turns_is_not_accepted(tmp_path, result):
    """A calibration without an inverse is refused with the sensor's name, and nothing is stored."""
    bent = dict(result.sensors[0].content) | {"fit": result.sensors[0].content["fit"] | {"monotone": False}}
    sensors = (dataclasses.replace(result.sensors[0], content=bent), result.sensors[1])
    model = model_on(tmp_path, dataclasses.replace(result, sensors=sensors))
    assert "Sensor 1: the curve turns" in str(model.obstacle())
    with pytest.raises(OperatorError):
        model.accept()
    assert UnitLibrary(tmp_path / "units").names() == []


def test_analysis_is_refused_during_a_run(tmp_path):
    """The recording is not closed under a run."""
    model = model_on(tmp_path)
    model.session.change(state=SessionState.RUNNING)
    with pytest.raises(OperatorError, match="in progress"):
        model.analyse_current()
    model.session.change(state=SessionState.IDLE)
    with pytest.raises(OperatorError, match="no recording"):
        model.analyse_current()


def test_damaged_file_is_reported_with_its_cause(tmp_path):
    """An analysis that cannot be made is reported without a traceback."""
    path = tmp_path / "broken.boat"
    path.write_bytes(b"no recording")
    model = model_on(tmp_path)
    model.analyse(path)
    until(lambda: (model.jobs.poll(), model.failure)[1] is not None)
    state, words = model.verdict()
    assert state == "fault"
    assert "broken.boat" in words
