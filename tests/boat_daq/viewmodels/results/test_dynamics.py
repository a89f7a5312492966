"""The dynamics of a run for the window: computed and reported in the background, a failure told."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from analysis.elongation_control.dynamic_figures import BodePoint, DynamicCalibration, DynamicFigure
from boat_daq.engine.settings import UnitLibrary
from boat_daq.viewmodels.results import dynamics
from boat_daq.viewmodels.results.dynamics import DynamicsModel
from boat_daq.workflows.jobs import JobState
from boat_daq.workflows.unit_control import dynamics_of
from protocol.base.errors import RequestError
from tests.boat_daq.gui.recorded_session import services_in

NONE = DynamicFigure(*[float("nan")] * 3)
FOUND = DynamicCalibration("SA1", True, "sweep.boat", 0.05, {}, (BodePoint(0.5, -0.2, -20.0, 0.05, 1.0),), NONE)


class Here:
    """A job that is run when it is made, in this process."""

    target = None

    def __init__(self, label, function, *args) -> None:
        self.failure, self.result, self.state = None, None, JobState.DONE
        try:
            self.result = function(*args)
        except RequestError as error:
            self.failure = SimpleNamespace(cause=error.cause, remedy=error.remedy, details="")


@pytest.fixture
def model_of(monkeypatch, tmp_path):
    """Return what makes the model of a recording, with what it told."""
    monkeypatch.setattr(dynamics, "Job", Here)
    told: list[object] = []
    services = services_in(tmp_path)
    services.notices = SimpleNamespace(
        inform_saved=told.append, add=lambda _severity, cause, *_, **__: told.append(cause)
    )
    jobs = SimpleNamespace(start=lambda slot, job, ended: ended(job))
    return lambda path: (DynamicsModel(UnitLibrary(tmp_path / "units"), path, jobs, services), told)


def test_dynamics_are_taken_and_reported(model_of, monkeypatch, tmp_path):
    monkeypatch.setattr(dynamics, "dynamics_of", lambda units, path, mm: replace(FOUND, tolerance_mm=mm))
    model, told = model_of(tmp_path / "sweep.boat")
    assert model.found == FOUND
    model.settling.choose("0.02 mm")
    assert model.found.tolerance_mm == 0.02
    model.settling.choose("Automatic")
    assert model.found == FOUND
    model.report(tmp_path / "dynamics.html")
    assert "Frequency response" in (tmp_path / "dynamics.html").read_text(encoding="utf-8")
    assert told == [tmp_path / "dynamics.html"]


def test_a_unit_without_a_calibration_is_told(model_of, recording):
    model, told = model_of(recording)
    assert model.found is None
    assert told == [model.failed] == ["simulated unit SA1 has no accepted calibration"]


def test_the_units_of_the_runs_own_kind_of_board_are_asked(recording, tmp_path):
    with pytest.raises(RequestError, match="simulated unit SA1"):
        dynamics_of(UnitLibrary(tmp_path / "units"), recording)
