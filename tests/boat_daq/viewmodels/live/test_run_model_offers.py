"""The offer to resume an interrupted run."""

from __future__ import annotations

import dataclasses
from unittest.mock import Mock

import pytest

from boat_daq.engine.plan import StepMark, built_in_plans
from boat_daq.engine.recording.resumption import BrokenRun
from boat_daq.engine.snapshot import LinkState, RunEnding, SessionState
from boat_daq.viewmodels.common.services import UndoHistory
from boat_daq.viewmodels.live.run_model import ResumeRun, RunModel
from boat_daq.viewmodels.live.sequence import SequenceModel
from protocol.base.errors import RequestError
from protocol.recording import RunEnd
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, idle, services_in


def resumption(tmp_path, session, read=lambda path, then: None):
    """A `ResumeRun` on a session for display only, and its notices."""
    services = services_in(tmp_path)
    return ResumeRun(
        session, SequenceModel(session, UndoHistory(), services.preferences), read, services
    ), services.notices


def marks(plan, cycles):
    """Marks of whole cycles, and one step of the next."""
    per_cycle = len(plan.targets_kpa)
    whole = [(c, "reached") for c in range(1, cycles + 1) for _ in range(per_cycle)] + [(cycles + 1, "aborted")]
    return tuple(StepMark(i, c, "unloading", 0.0, 10.0, i, status=s) for i, (c, s) in enumerate(whole, 1))


def vented_run(tmp_path, cycles):
    """Return a session whose run the operator vented after so many cycles."""
    plan = built_in_plans()["calibration"]
    session = RecordedSession(connected())
    session.marks = marks(plan, cycles)
    ended = RunEnding(RunEnd.ABORTED, "vented by the operator")
    session.change(plan=plan, recording=tmp_path / "x.boat", run_ended=ended, state=SessionState.ABORTED)
    return session


def test_run_interrupted_by_an_unplugged_board_is_offered(tmp_path):
    """Once the fault is cleared and the board is there, the strip offers it; nothing moves before it is taken."""
    plan = built_in_plans()["calibration"]
    session = RecordedSession(connected())
    session.marks = marks(plan, 2)
    session.change(
        plan=plan,
        recording=tmp_path / "x.boat",
        run_ended=RunEnding(RunEnd.FAULT, "unplugged"),
        state=SessionState.FAULT,
    )
    model, notices = resumption(tmp_path, session)
    model.follow(dataclasses.replace(session.shown, link=LinkState.LOST))
    model.follow(session.shown)
    assert notices.current() is None
    session.change(state=SessionState.IDLE)
    model.follow(session.shown)
    offer = notices.current()
    assert offer is not None
    assert "after 2 whole cycles" in offer.cause
    assert "cycle 4" in offer.remedy
    assert session.calls == []
    offer.action()
    assert session.calls == ["arm"]
    session.change(state=SessionState.ARMED)
    model.follow(session.shown)
    assert notices.current() is None


def test_offer_survives_a_vent_while_armed(tmp_path):
    """Esc before Start withdrew the offer; the run is broken until it has run."""
    session = vented_run(tmp_path, 0)
    model, notices = resumption(tmp_path, session)
    model.follow(session.shown)
    assert (model.first_cycle, "before its first cycle" in notices.current().cause) == (2, True)
    model.arm()
    session.change(state=SessionState.ARMED)
    model.follow(session.shown)
    assert (model.first_cycle, notices.current()) == (2, None)
    session.change(state=SessionState.IDLE)
    model.follow(session.shown)
    assert (model.first_cycle, notices.current().action_text) == (2, "Resume")
    session.change(state=SessionState.RUNNING, run_ended=None)
    model.follow(session.shown)
    assert (model.first_cycle, notices.current()) == (0, None)


def test_whole_plan_armed_anew_names_no_cycle(tmp_path):
    """Start over arms from the first cycle: its Start names none."""
    session = vented_run(tmp_path, 2)
    model, _ = resumption(tmp_path, session)
    model.follow(session.shown)
    session.change(state=SessionState.ARMED, recording=None)
    model.follow(session.shown)
    assert model.first_cycle == 0


def test_nothing_is_offered_where_nothing_is_left(tmp_path):
    """With all of its cycles the run is done."""
    plan = built_in_plans()["calibration"]
    session = RecordedSession(connected())
    session.marks = marks(plan, 5)
    session.change(
        plan=plan,
        recording=tmp_path / "x.boat",
        run_ended=RunEnding(RunEnd.FAULT, "unplugged"),
        state=SessionState.FAULT,
    )
    model, notices = resumption(tmp_path, session)
    model.follow(session.shown)
    session.change(state=SessionState.IDLE)
    model.follow(session.shown)
    assert notices.current() is None
    session = vented_run(tmp_path, 0)
    session.change(plan=dataclasses.replace(plan, cycles=1))  # it was "Resume at cycle 2" of one
    model.follow(session.shown)
    assert (model.first_cycle, notices.current()) == (0, None)


def test_closed_run_resumes_only_on_a_free_board(tmp_path, closed):
    """Without a board, or while something is recorded, it is refused; else armed, and Start is left to the operator."""
    plan = built_in_plans()["calibration"]
    broken = BrokenRun(closed, {}, plan, (), (), 3, 2, "stopped")
    session = RecordedSession(idle())
    model, notices = resumption(tmp_path, session, lambda path, then: then(broken))
    with pytest.raises(RequestError, match="no board"):
        model.resume(closed)
    session.shown = dataclasses.replace(connected(), recording=tmp_path / "other.boat")
    with pytest.raises(RequestError, match="being recorded"):
        model.resume(closed)
    session.shown = connected()
    model.resume(closed)
    assert session.calls == ["resume_recording", "arm"]
    assert "resumes at cycle 3: press Start" in notices.current().cause


def test_a_refused_first_pressure_deletes_the_recording_of_its_run(tmp_path, monkeypatch):
    """A file with nothing in it stayed; one that the operator had begun is kept."""
    path, session = tmp_path / "run.boat", Mock()
    run = RunModel(session, *[Mock() for _ in range(7)])
    monkeypatch.setattr(RunModel, "record", lambda self: path)
    for begun_before in (True, False):
        path.touch()
        session.snapshot.return_value = dataclasses.replace(connected(), recording=path if begun_before else None)
        run.press("start")
        run.services.notices.attempt.call_args.args[0]()
        run.follow(dataclasses.replace(connected(), recording=path, refused_first=True))
        assert path.exists() is begun_before
        path.touch()
        run.sequence.press.side_effect = RequestError("the unit is not vented (0.0 kPa)", "vent it first")
        run.press("start")
        with pytest.raises(RequestError, match="not vented"):
            run.services.notices.attempt.call_args.args[0]()
        run.sequence.press.side_effect = None
        assert path.exists() is begun_before
