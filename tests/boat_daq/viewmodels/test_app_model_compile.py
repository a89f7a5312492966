"""What the application model compiles when the window opens, and what it withdraws when another run is followed."""

from __future__ import annotations

import pytest

from boat_daq.engine.session.session import Session
from boat_daq.engine.settings import Settings, UnitLibrary
from boat_daq.viewmodels import app_model
from boat_daq.viewmodels.app_model import AppModel
from boat_daq.workflows.jobs import JobState
from boat_daq.workflows.live_conversion import compile_rest, lacks_code


@pytest.mark.parametrize(
    ("ended", "missing", "then"),
    [(JobState.DONE, True, [compile_rest]), (JobState.DONE, False, []), (JobState.CANCELLED, None, [])],
)
def test_what_is_missing_is_compiled(tmp_path, monkeypatch, ended, missing, then):
    """Only where code is not in the cache, which a job looks up."""
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
    assert started == [lacks_code]
    job = model.jobs.get("missing code")
    job.state, job.result = ended, missing
    model.jobs.poll()
    assert started == [lacks_code, *then]
    model.jobs.close()
    session.close()


def test_alarms_of_one_run_leave_with_the_next(tmp_path, monkeypatch):
    """ "Leak since cycle 12; check the tubing before the next run" stayed through the next run."""
    model = AppModel(Session(Settings(), UnitLibrary(tmp_path)), tmp_path, tmp_path, UnitLibrary(tmp_path))
    found = [["leak since cycle 12"], [], []]
    monkeypatch.setattr(model.monitor, "poll", lambda: found.pop(0))
    shown = []
    for alarms in (["leak"], ["leak"], []):
        model.monitor.alarms = alarms
        model.tick()
        shown.append(model.notices.current() and model.notices.current().cause)
    model.close()
    assert shown == ["leak since cycle 12", "leak since cycle 12", None]
