"""Older recordings from the window: readings corrected, broken runs that go on."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import pytest

from analysis import load_recording
from boat_daq.engine.plan import StepMark, built_in_plans
from boat_daq.engine.recording.resumption import BrokenRun
from boat_daq.engine.snapshot import LinkState, RunEnding, SessionState
from boat_daq.errors import OperatorError
from boat_daq.viewmodels.common.undo import UndoHistory
from boat_daq.viewmodels.live.readings import ReadingsModel
from boat_daq.viewmodels.live.resume_run import ResumeRun
from boat_daq.viewmodels.live.sequence import SequenceModel
from boat_daq.viewmodels.results.closed_run import ClosedRun
from boat_daq.viewmodels.results.runs import NONE_CHOSEN, RunEntry, obstacle, read_run, selection_text
from protocol.recording import RunEnd
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, idle, services_in

SAMPLE = Path(__file__).parents[3] / "recordings" / "simulated_SA1_two_cycles.boat"


@pytest.fixture
def closed(tmp_path):
    """A copy of the sample recording, closed."""
    return Path(shutil.copy(SAMPLE, tmp_path / "older.boat"))


def test_readings_of_an_older_run_are_corrected_by_newer_rows(closed):
    """A correction, its undo and its redo are rows behind the first; the last one counts, for the analysis too."""
    history, run = UndoHistory(), ClosedRun(closed)
    table = ReadingsModel(run, history)
    rows = table.rows(idle())
    step, before, entered = rows[4].step_id, rows[4].elongation_mm, len(run.readings())
    table.enter(step, "1.11")
    assert table.rows(idle())[4].elongation_mm == 1.11
    history.undo()
    assert table.rows(idle())[4].elongation_mm == before
    history.redo()
    kept = ClosedRun(closed).readings()
    assert [r.elongation_mm for r in kept[entered:]] == [1.11, before, 1.11]
    assert len(kept) == entered + 3
    read = load_recording(closed).readings
    assert float(read[read["step"] == step]["elongation_mm"].iloc[-1]) == 1.11


def test_a_reading_for_no_plateau_is_refused(closed):
    """What is not a plateau of the recording is refused, and nothing is added."""
    run = ClosedRun(closed)
    with pytest.raises(OperatorError, match="no step"):
        run.add_reading(9999, 1.0, "typed")
    assert ClosedRun(closed).readings() == run.readings()


def test_which_runs_can_go_on(closed):
    """A finished run cannot; one that was stopped, or killed, can; one that is recorded now cannot."""
    run = read_run(closed)
    assert (run.closed, run.resumable) == (True, False)

    def as_if(**changed: object) -> RunEntry:
        return dataclasses.replace(run, summary=dataclasses.replace(run.summary, **changed))

    assert as_if(run_end=RunEnd.FAULT).resumable
    assert as_if(status="interrupted", run_end=None).resumable
    assert not as_if(status="recording", run_end=None).resumable
    assert not as_if(run_end=RunEnd.STOPPED, steps=0).resumable
    assert not dataclasses.replace(run, summary=None).resumable


def resumption(tmp_path, session, read=lambda path, then: None):
    """A `ResumeRun` on a session that only shows, and its notices."""
    services = services_in(tmp_path)
    return ResumeRun(session, SequenceModel(session, UndoHistory()), read, services), services.notices


def marks(plan, cycles):
    """Marks of whole cycles, and one step of the next."""
    per_cycle = len(plan.targets_kpa)
    whole = [(c, "reached") for c in range(1, cycles + 1) for _ in range(per_cycle)] + [(cycles + 1, "aborted")]
    return tuple(StepMark(i, c, "unloading", 0.0, 10.0, i, status=s) for i, (c, s) in enumerate(whole, 1))


def test_a_run_broken_by_an_unplug_is_offered_to_go_on(tmp_path):
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
    assert session.asked == []
    offer.action()
    assert session.asked == ["arm"]
    session.change(state=SessionState.ARMED)
    model.follow(session.shown)
    assert notices.current() is None


@pytest.mark.parametrize("cycles", [0, 5])
def test_nothing_is_offered_where_nothing_is_left(tmp_path, cycles):
    """Without a whole cycle the run begins anew, with all of them it is done."""
    plan = built_in_plans()["calibration"]
    session = RecordedSession(connected())
    session.marks = marks(plan, cycles)
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


def test_a_closed_run_resumes_only_on_a_free_board(tmp_path, closed):
    """Without a board, or while something is recorded, it is refused; else armed, and Start is left to the operator."""
    plan = built_in_plans()["calibration"]
    broken = BrokenRun(closed, {}, plan, (), (), 3, 2, "stopped")
    session = RecordedSession(idle())
    model, notices = resumption(tmp_path, session, lambda path, then: then(broken))
    with pytest.raises(OperatorError, match="no board"):
        model.resume(closed)
    session.shown = dataclasses.replace(connected(), recording=tmp_path / "other.boat")
    with pytest.raises(OperatorError, match="being recorded"):
        model.resume(closed)
    session.shown = connected()
    model.resume(closed)
    assert session.asked == ["resume_recording", "arm"]
    assert "resumes at cycle 3: press Start" in notices.current().cause


def test_what_cannot_be_done_with_the_chosen_runs_says_why(closed):
    """Grey buttons stood there without a word; both sides of each border."""
    good = read_run(closed)
    damaged = dataclasses.replace(good, summary=None, problem="it is no recording")
    written = dataclasses.replace(good, summary=dataclasses.replace(good.summary, status="recording"))
    deeds = ("open", "repeat", "replay", "export", "readings", "report", "compare")

    def refused(*chosen: RunEntry) -> set[str]:
        return {deed for deed in deeds if obstacle(deed, chosen)}

    assert refused() == set(deeds)
    assert refused(good) == {"compare"}
    assert refused(written) == {"compare", "readings"}
    assert refused(good, good) == refused(*[good] * 4) == set(deeds) - {"report", "compare"}
    assert refused(*[good] * 5) == set(deeds) - {"report"}
    assert refused(damaged) == refused(good, damaged) == set(deeds)
    assert obstacle("report", [good, damaged]) == "older.boat: it is no recording."
    assert "2 recordings are chosen" in obstacle("open", [good, good])
    assert (selection_text([]), selection_text([damaged])) == (NONE_CHOSEN, damaged.problem)
    assert "37 readings" in selection_text([good])
