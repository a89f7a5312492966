"""The line of the run: state, buttons, offers."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import pytest
from PySide6.QtCore import QPoint
from PySide6.QtGui import QImage
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QApplication,
)

from analysis.stopping.criterion import StopAssessment, StopCriterion
from boat_daq.engine.plan import StepMark, built_in_plans
from boat_daq.engine.snapshot import (
    RunEnding,
    SessionState,
)
from boat_daq.viewmodels.common.notices import Severity
from protocol.recording import RunEnd
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import ASKED, NARROW, PATIENCE_MS, RAMPING, Grid, run_shortcut
from tests.conftest import mostly_at_night


def test_interrupted_run_has_buttons_to_resume_and_to_start_over(live):
    """After a vent there are two buttons, Resume the marked one; armed it names the cycle, and Esc keeps the offer."""
    panel, arm = live.live.sequence, live.live.sequence.buttons["arm"]
    session = live.model.session
    session.change(last=dataclasses.replace(session.shown.last, target_kpa=math.nan))  # nothing is held
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
    """The cycle of the pause is left out, the next one is named on the button; no reading is asked for."""
    running.model.session.change(state=SessionState.PAUSED)
    running.refresh()
    bar = running.live.reading
    assert (bar.question.text(), bar.unit.text()) == ("No reading while paused", "mm")
    assert not bar.field.isEnabled()
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
    session.change(not_saving="the disk is full")
    live.model.run.press("arm")  # refused by the session: what waits in memory is kept
    assert "stop_recording" not in session.calls
    session.change(not_saving="")
    live.model.run.press("arm")
    assert session.calls[-2:] == ["stop_recording", "arm"]


@pytest.mark.parametrize("state", mostly_at_night(SessionState.FAULT, SessionState.ABORTED))
def test_interrupted_run_shows_its_cause(live, state):
    """The strip's message goes once the link is up again: "Fault" was shown without a reason."""
    live.model.session.marks = (StepMark(1, 2, "unloading", 40.0, 10.0, 0),)
    live.model.session.add_reading(1, 3.0, "typed")
    live.model.session.change(state=state, run_ended=RunEnding(RunEnd.FAULT, "the board was unplugged"), progress=None)
    last = live.model.session.snapshot().last
    live.model.session.change(last=dataclasses.replace(last, target_kpa=math.nan))  # nothing is held
    live.refresh()
    assert live.live.sequence.progress.text() == "the board was unplugged"
    assert (
        live.live.sequence.uncertainty.text() == "Run interrupted at +40 kPa, unloading, cycle 2, 1 of 1 plateau read"
    )
    live.model.session.change(state=SessionState.IDLE, run_ended=RunEnding(RunEnd.FINISHED))
    live.refresh()
    assert "plateaus" in live.live.sequence.progress.text()
    live.resize(NARROW, 600)
    for now, cause in ((SessionState.ARMED, "the board was unplugged"), (state, "the board was unplugged " * 8)):
        live.model.session.change(state=now, run_ended=RunEnding(RunEnd.FAULT, cause))
        live.refresh()
        QApplication.processEvents()
        live.refresh()
        panel = live.live.sequence
        shown = panel.progress if panel.progress.text() else panel.uncertainty
        assert shown.heightForWidth(shown.width()) <= shown.height()  # no word is cut
        assert panel.rect().contains(shown.geometry())
        assert all(panel.rect().contains(b.geometry()) for b in panel.buttons.values() if b.isVisible())


@pytest.mark.parametrize(
    ("end", "words"), mostly_at_night((RunEnd.STOPPED, "the run was stopped"), (RunEnd.FINISHED, "the run is finished"))
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
    session.shown = dataclasses.replace(session.shown, can_command=False, why_read_only="no vent")
    window.refresh()
    assert shown() == set()
    run_shortcut(window, "F5")  # it was "Connect a board first"
    assert window.model.notices.current().remedy == "This link is read only: no vent."


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
    assert window.strip.text.text() == "The run is finished, 1 plateau read. Press Calibrate to fit the curve."
    window.strip.act.click()
    assert window.place == "Calibration"
    window.refresh()
    assert "There is no recording yet" in window.strip.text.text()


@pytest.mark.parametrize(
    "criteria",
    [
        pytest.param((StopCriterion("U ", "mm", 0.1, 0.08, 0.07),), marks=pytest.mark.nightly),
        (StopCriterion("drift \u00b1", "% FSO", 0.62, 0.5), StopCriterion("repeatability \u00b1", "% FSO", 0.14, 0.5)),
    ],
)
def test_the_uncertainty_of_the_run_is_never_cut(running, criteria):
    """It shared an elided line with the progress: at 1280 pixels the time left was cut, at 853 the numbers too."""
    run, panel = running.model.run, running.live.sequence
    plan = built_in_plans()["calibration" if len(criteria) == 1 else "repeatability"]
    for unit in ("mm", "% FSO"):
        run.enough.ask(criteria[0].asked, unit)
    run.enough.known = StopAssessment(2, 100, 2, criteria)
    run.enough.follow = lambda _: None
    running.model.session.change(plan=plan)
    shown, asked = panel.uncertainty, ("U 0.1 mm of 0.08 mm", "Drift ±0.62, repeatability ±0.14 % FSO of 0.5 % FSO")
    for width, height in ((1280, 800), (NARROW, 800), (NARROW, 600)):
        running.resize(width, height)
        running.refresh()
        QApplication.processEvents()
        assert shown.isVisible()
        assert shown.text().startswith(asked)
        assert "ends in about" in shown.text()
        assert shown.height() >= shown.heightForWidth(shown.width())
        assert panel.rect().contains(shown.geometry())
        for button in (panel.buttons["pause"], panel.buttons["stop"]):
            assert panel.rect().contains(button.geometry())
        assert panel.picture.isVisible() is (height > 640)
        assert not panel.picture.isVisible() or panel.picture.height() >= panel.picture.minimumHeight()


def test_what_a_run_had_reached_is_shown_after_it(running):
    """Until the next plan is armed, in the line of the run."""
    session, enough, shown = running.model.session, running.model.run.enough, running.live.sequence.uncertainty
    enough.ask(0.08, "mm")
    enough._cycles = 3  # of which the assessment is known
    progress, plan = dataclasses.replace(RAMPING, complete_cycles=3), built_in_plans()["calibration"]
    session.change(plan=plan, recording=Path("SA1.boat"), progress=progress)
    running.refresh()
    enough.ended_by = StopAssessment(3, 5, 2, (StopCriterion("U ", "mm", 0.078, 0.08, 0.05),))
    session.change(state=SessionState.IDLE, progress=None, run_ended=RunEnding(RunEnd.FINISHED))
    for _ in range(2):
        running.refresh()
        assert shown.text() == "Ended after cycle 3: U 0.078 mm of 0.08 mm asked."
        assert shown.isVisible()
    session.change(state=SessionState.ARMED)
    running.refresh()
    assert shown.text() == "U 0.08 mm asked, known after one cycle"
    enough.ask(None, "mm")
    running.refresh()
    assert shown.isHidden()


def test_the_progress_of_a_run_leaves_out_what_does_not_fit(running):
    """At 853 pixels the time left was cut in the middle of its digits."""
    progress = running.live.sequence.progress
    for width, whole in ((1280, True), (NARROW, False)):
        running.resize(width, 800)

        for _ in range(100):
            running.refresh()
            QTest.qWait(20)
            if progress.text().endswith("ramping to +20 kPa") is whole:
                break
        assert progress.text().endswith("ramping to +20 kPa") is whole
        assert progress.fontMetrics().horizontalAdvance(progress.text()) <= progress.width()
        assert "2:10 left" in progress.text()


def test_the_page_of_a_run_fits_a_narrow_window(running):
    """With the simulated grid the reading bar was 3 pixels too wide at 853 pixels, and both scroll bars came."""
    model = running.model
    model.connection.board = Grid(1.0)
    model.session.change(waiting_for_reading=ASKED)
    running.resize(NARROW, 800)
    for _ in range(2):
        running.refresh()
        QTest.qWait(50)
    scroll = running.scrolls["Measure"]
    assert (scroll.horizontalScrollBar().maximum(), scroll.verticalScrollBar().maximum()) == (0, 0)


def test_plan_is_copied_and_saved_by_a_right_click(running, tmp_path):
    """What every plot offers; truth: the first ramp of the plan, to 50 kPa at 10 kPa/s."""
    panel = running.live.sequence
    panel.picture.customContextMenuRequested.emit(QPoint(5, 5))
    menu = QApplication.activePopupWidget()
    assert [action.text() for action in menu.actions()] == [
        "Copy picture",
        *(f"Save {kind} \u2026" for kind in ("PNG", "SVG", "CSV")),
    ]
    menu.actions()[0].trigger()
    menu.close()
    assert QApplication.clipboard().pixmap().size() == panel.picture.grab().size()
    assert running.model.notices.current().cause == "Copied: Plan"
    for kind in ("png", "svg", "csv"):
        panel.save(tmp_path / f"plan.{kind}")
    assert QImage(str(tmp_path / "plan.png")).size() == panel.picture.grab().size()
    assert "<polyline" in (tmp_path / "plan.svg").read_text(encoding="utf-8")
    rows = (tmp_path / "plan.csv").read_text(encoding="utf-8").splitlines()
    assert rows[:3] == ["time_s,pressure_kpa", "0.0,0.0", "5.0,50.0"]
