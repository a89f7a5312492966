"""What the application model compiles when the window opens, in helper processes."""

from __future__ import annotations

import pytest

from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.viewmodels import app_model
from boat_daq.viewmodels.app_model import AppModel
from boat_daq.workflows.jobs import JobState
from boat_daq.workflows.live_conversion import compile_conversion, compile_rest
from protocol.base.errors import RequestError


@pytest.mark.parametrize(
    ("ended", "missing", "then"),
    [(JobState.DONE, True, [compile_rest]), (JobState.DONE, False, []), (JobState.CANCELLED, None, [])],
)
def test_the_conversion_is_compiled_first_and_then_released(tmp_path, monkeypatch, ended, missing, then):
    """It is held back until its job has ended, however it ended; the rest follows where it is not in the cache."""
    started = []

    class NamedJob:
        def __init__(self, label, function):
            started.append(function)
            self.label, self.state, self.result = label, JobState.RUNNING, None

        def poll(self):
            return self.state

        def cancel(self):
            self.state = JobState.CANCELLED

    monkeypatch.setattr(app_model, "Job", NamedJob)
    session = Session(Settings())
    model = AppModel(session, tmp_path, tmp_path, UnitLibrary(tmp_path))
    model.compile_ahead()
    model.jobs.poll()
    assert started == [compile_conversion]
    assert model.unit.held
    with pytest.raises(RequestError, match="being compiled"):
        model.unit.regulator(session.snapshot(), 1.0)
    job = model.jobs.get("conversion code")
    job.state, job.result = ended, missing
    model.jobs.poll()
    assert started == [compile_conversion, *then]
    assert not model.unit.held
    model.jobs.close()
    session.close()
