"""The line of the run: state, buttons, offers."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from PySide6.QtWidgets import (
    QApplication,
)

from boat_daq.engine.plan import StepMark, built_in_plans
from boat_daq.engine.snapshot import (
    RunEnding,
    SessionState,
)
from boat_daq.viewmodels.common.notices import Severity
from protocol.recording import RunEnd
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import PATIENCE_MS, RAMPING


def test_interrupted_run_has_buttons_to_resume_and_to_start_over(live):
    """After a vent there are two buttons, Resume the marked one; armed it names the cycle, and Esc keeps the offer."""
    panel, arm = live.live.sequence, live.live.sequence.buttons["arm"]
    session = live.model.session
    live.refresh()
    assert (arm.text(), arm.property("role"), panel.resume.isVisible()) == ("Arm", "primary", False)
    plan = built_in_plans()["calibration"]
    whole = [StepMark(i, 1, "unloading", 0.0, 10.0, i, status="reached") for i in range(len(plan.targets_kpa))]
    session.marks = (*whole, StepMark(99, 2, "unloading", 0.0, 10.0, 99, status="aborted"))
    ended = RunEnding(RunEnd.ABORTED, "vented by the operator")
    session.change(plan=plan, recording=Path("SA1.boat"), run_ended=ended, state=SessionState.ABORTED)
    for _ in range(2):
        live.refresh()
        assert (arm.text(), arm.property("role")) == ("Start over", "")
        assert (panel.resume.text(), panel.resume.isVisible()) == ("Resume at cycle 3", True)
        panel.resume.click()
        session.change(state=SessionState.ARMED)
        live.refresh()
        assert panel.buttons["start"].text() == "Start at cycle 3"
        assert not panel.resume.isVisible()
        session.change(state=SessionState.IDLE)  # vented while armed


def test_paused_run_names_the_cycle_at_which_it_resumes(running):
    """The cycle of the pause is left out, the next one is named on the button."""
    running.model.session.change(state=SessionState.PAUSED)
    running.refresh()
    resume = running.live.sequence.buttons["resume"]
    assert (resume.text(), resume.isVisible()) == ("Resume at cycle 2", True)


def test_hidden_button_gives_its_focus_to_no_other(live, qtbot):
    """Start is pressed and gone: the focus is nowhere, not on Pause, where the next Space would vent."""
    live.activateWindow()
    qtbot.waitUntil(lambda: QApplication.activeWindow() is live, timeout=PATIENCE_MS)
    live.model.session.change(state=SessionState.ARMED)
    live.refresh()
    live.live.sequence.buttons["start"].setFocus()
    live.model.session.change(state=SessionState.RUNNING, progress=RAMPING)
    live.refresh()
    assert live.live.sequence.buttons["pause"].isVisible()
    assert QApplication.focusWidget() is None


def test_cleared_fault_is_dismissed(live):
    """The strip kept the fault after it was cleared, and hid the offer to calibrate behind it."""
    live.model.session.change(state=SessionState.FAULT)
    live.refresh()
    live.model.notices.add(Severity.FAULT, "the board did not answer")
    live.model.notices.inform("what comes next")
    assert live.model.notices.current().severity is Severity.FAULT
    live.model.session.change(state=SessionState.IDLE)
    live.refresh()
    assert live.model.notices.current().cause == "what comes next"


def test_each_run_has_its_own_recording(live):
    """Armed again, the recording that holds a run is closed first; one that was started manually continues."""
    session = live.model.session
    session.change(recording=Path("SA1.boat"))
    live.refresh()
    live.model.run.press("arm")
    assert session.calls[-1:] == ["arm"]
    assert "stop_recording" not in session.calls
    session.marks = (StepMark(1, 0, "start", 50.0, 10.0, 0),)
    live.model.run.press("arm")
    assert session.calls[-2:] == ["stop_recording", "arm"]


@pytest.mark.parametrize("state", [SessionState.FAULT, SessionState.ABORTED])
def test_interrupted_run_shows_its_cause(live, state):
    """The strip's message goes once the link is up again: "Fault" was shown without a reason."""
    live.model.session.change(state=state, run_ended=RunEnding(RunEnd.FAULT, "the board was unplugged"), progress=None)
    live.refresh()
    assert live.live.sequence.progress.text() == "the board was unplugged"
    live.model.session.change(state=SessionState.IDLE, run_ended=RunEnding(RunEnd.FINISHED))
    live.refresh()
    assert "plateaus" in live.live.sequence.progress.text()


@pytest.mark.parametrize(
    ("end", "words"), [(RunEnd.FINISHED, "the run is finished"), (RunEnd.STOPPED, "the run was stopped")]
)
def test_offer_to_calibrate_names_how_the_run_ended(running, end, words):
    """A run that was stopped with some plateaus read was called finished."""
    running.model.readings.put(4, 1.5, "typed")
    running.model.session.change(state=SessionState.IDLE, progress=None, run_ended=RunEnding(end))
    running.refresh()
    assert running.model.notices.current().cause == f"{words}, 1 plateau read"


def test_buttons_follow_the_state(make):
    """Only what may be pressed is shown: arm while idle, pause and stop while running."""
    session = RecordedSession(connected(), filled_ring(10.0))
    window = make(session)
    shown = lambda: {key for key, b in window.live.sequence.buttons.items() if b.isVisible()}  # noqa: E731
    window.refresh()
    assert shown() == {"arm"}
    session.change(state=SessionState.RUNNING)
    window.refresh()
    assert shown() == {"pause", "stop"}
    session.shown = dataclasses.replace(session.shown, can_command=False)
    window.refresh()
    assert shown() == set()


def test_end_of_a_run_offers_to_calibrate(make):
    """A finished run with readings is reported, with a button to its calibration; the offer waits."""
    session = RecordedSession(connected(), filled_ring(10.0))
    session.marks = (StepMark(3, 1, "unloading", 30.0, 10.0, 0),)
    session.change(state=SessionState.RUNNING)
    window = make(session)
    window.refresh()
    session.add_reading(3, 2.0, "typed")
    session.change(state=SessionState.IDLE)
    window.refresh()
    assert window.strip.text.text() == "The run is finished, 1 plateau read. Next: fit and look at it."
    window.strip.act.click()
    assert window.page == "Calibrate"
    window.refresh()
    assert "There is no recording yet" in window.strip.text.text()
