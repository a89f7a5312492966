"""The quick trial: offered before the first recording, three cycles on the virtual board, read and calibrated."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from boat_daq.engine.plan import StepMark
from boat_daq.engine.snapshot import LinkState, SessionState
from boat_daq.viewmodels.common.services import Page, Tab
from tests.boat_daq.gui.recorded_session import connected, filled_ring
from tests.boat_daq.gui.windows import ASKED, RAMPING, Grid
from tests.conftest import mostly_at_night


@pytest.fixture
def trial(empty, monkeypatch):
    """A window without recordings whose quick trial was clicked and whose board sends samples now."""
    model, armed = empty.model, []
    monkeypatch.setattr(model.connection, "start_virtual_board", lambda *, speed: armed.append(speed))
    monkeypatch.setattr(model.session, "arm", lambda plan, **how: armed.append((plan.cycles, how)), raising=False)
    monkeypatch.setattr(model.calibration, "analyse_current", lambda: armed.append("analysed"))
    model.run.calibration._analyse = model.calibration.analyse_current
    model.prepared = []
    monkeypatch.setattr(model.run.calibration, "prepare", lambda: model.prepared.append(len(armed)))

    def start():
        model.session.calls.append("start")
        model.session.change(state=SessionState.ARMED)  # until its first sample

    monkeypatch.setattr(model.session, "start", start, raising=False)
    model.armed = armed
    QTest.mouseClick(empty.live.first_steps.trial, Qt.MouseButton.LeftButton)
    model.connection.board = Grid(1.5)
    model.session.shown, model.session.live.ring = connected(), filled_ring(2.0)
    empty.refresh()
    return empty


def test_quick_trial_is_the_first_button_before_the_first_recording(empty):
    """With a recording in the folder it is not offered, and the virtual board is the next step."""
    steps = empty.live.first_steps
    assert (steps.trial.isVisible(), steps.virtual.property("role")) == (True, "")
    empty.model.services.recordings.mkdir(parents=True)
    (empty.model.services.recordings / "a.boat").touch()
    empty.go(Page.RECORDINGS)
    empty.go(Page.MEASURE)
    assert (steps.trial.isVisible(), steps.virtual.property("role")) == (False, "primary")


def test_quick_trial_runs_three_cycles_reads_them_and_calibrates(trial):
    """One click: three cycles at 20 times real time, each plateau read from the grid, then the analysis.

    Fewer give no uncertainty. The plan that is shown is the one that runs, until the run has ended.
    """
    model, session = trial.model, trial.model.session
    plan, cycles = model.sequence.plan, model.sequence.plan.cycles
    assert model.armed == [20.0, (3, {"wait_for_reading": True, "resume": False, "regulator": None, "hold": False})]
    assert session.calls == ["start_recording", "start"]
    assert (model.sequence.plan, cycles) == (plan, 5)
    session.marks = (StepMark(ASKED.step_id, 1, "unloading", 20.0, 10.0, 1),)
    session.change(state=SessionState.RUNNING, waiting_for_reading=ASKED, plan=replace(plan, cycles=3))
    trial.live.pane.setCurrentWidget(trial.live.plan)
    trial.refresh()
    field = trial.live.plan.fields["cycles"]
    assert (field.text(), field.isEnabled()) == ("3", False)
    assert [(r.elongation_mm, r.source) for r in session.kept] == [(1.5, "simulated")]
    session.change(waiting_for_reading=None, progress=RAMPING)
    trial.refresh()
    assert trial.live.reading.left.text() == "+1.50 taken"
    session.change(state=SessionState.IDLE)
    trial.refresh()
    trial.live.plan.refresh(session.shown)
    assert (field.text(), field.isEnabled()) == ("5", True)
    assert (trial.place, model.armed[-1]) == (Tab.CALIBRATION, "analysed")
    assert (model.run.trial.active, model.run.read_all) == (False, False)
    assert model.prepared == [1, 3]  # helpers: of the analysis during the run, of the report after it


@pytest.mark.parametrize(
    "ended", mostly_at_night({"state": SessionState.FAULT, "link": LinkState.LOST}, {"state": SessionState.ABORTED})
)
def test_quick_trial_that_was_vented_or_unplugged_ends(trial, ended):
    """Nothing is read or calibrated after it; the next run is the operator's."""
    trial.refresh()
    trial.model.session.change(state=SessionState.RUNNING)
    trial.refresh()
    trial.model.session.change(**ended)
    trial.refresh()
    assert (trial.model.run.trial.active, trial.model.run.read_all, trial.page) == (False, False, Page.MEASURE)
    assert "analysed" not in trial.model.armed


def test_virtual_board_is_refused_while_a_board_is_connected(live):
    """A trial would command its pressure; another virtual board would end the one of this run. The reason is shown."""
    model = live.model
    model.connection.board = running = SimpleNamespace(unit="SA1", close=lambda: pytest.fail("ended"))
    for start in (model.run.trial.start, model.connection.start_virtual_board):
        model.notices.attempt(start)
        assert model.notices.history[-1].cause == "a board is connected"
    assert (model.run.trial.active, model.connection.board, len(model.notices.history)) == (False, running, 2)
    model.connection.board = None
