"""The status strip: notices, their actions, jobs."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication

from boat_daq.engine.snapshot import (
    LinkState,
    Message,
    MessageKind,
)
from boat_daq.viewmodels.common.notices import Severity
from boat_daq.workflows.jobs import Job
from tests.boat_daq.gui.recorded_session import RecordedSession, connected, filled_ring
from tests.boat_daq.gui.windows import pause, run_command


def test_offer_can_be_dismissed(live):
    """The offer "The run is finished: Calibrate" stays until it is taken, or sent away with the mouse."""
    live.model.notices.add(Severity.INFORMATION, "an offer", action=("Do it", lambda: None))
    live.refresh()
    assert live.strip.close_.isVisible()
    live.strip.close_.click()
    assert live.model.notices.current() is None
    live.model.notices.inform("a message that leaves by itself")
    live.refresh()
    assert not live.strip.close_.isVisible()


def test_error_has_cause_remedy_details_and_copy(live):
    """What is not ours is shown with its cause; details at a click; all of it goes to the clipboard."""

    def wrong() -> None:
        raise ZeroDivisionError("nothing to divide by")

    live.model.notices.attempt(wrong)
    live.refresh()
    assert "Nothing to divide by" in live.strip.text.text()
    live.strip.more.click()
    assert "ZeroDivisionError" in live.strip.details.toPlainText()
    live.strip.copy.click()
    assert "ZeroDivisionError" in QGuiApplication.clipboard().text()
    run_command(live, "Dismiss message")
    assert live.strip.text.text() == ""


def test_suggested_action_is_applied_by_a_key(live):
    """What the strip offers is done by its command, once."""
    done = []
    live.model.notices.add(Severity.WARNING, "x", "y", action=("Do", lambda: done.append(1)))
    live.refresh()
    run_command(live, "Apply suggested action")
    live.refresh()
    run_command(live, "Apply suggested action")
    assert done == [1]


def test_job_has_a_progress_bar_and_a_cancel(live):
    """While a helper computes there is a bar; the key for cancel ends it."""
    job = live.model.jobs.start("long", Job("Waiting", pause, 60), lambda job: None)
    live.refresh()
    assert live.strip.bar.isVisible()
    assert live.strip.work.text() == "Waiting"
    run_command(live, "Cancel task")
    live.refresh()
    assert job.state.value == "cancelled"
    assert live.model.notices.history[-1].cause.endswith(": cancelled")  # else a report that was asked for is lost
    assert not live.strip.bar.isVisible()


def test_a_running_job_leaves_its_place_to_a_message(live, qtbot):
    """The name of a job takes a quarter of the strip; beside a message in a narrow window it is said on hover."""
    label = "Computing the posterior and its bands of sensors 1 and 2 from 4,000 samples"
    strip = live.strip
    live.model.jobs.start("long", Job(label, pause, 60), lambda job: None)
    live.resize(853, 600)
    live.refresh()
    assert strip.work.isVisible()
    live.model.notices.add(Severity.WARNING, "the regulator does not follow", "Check its supply.")
    live.refresh()
    assert not strip.work.isVisible()
    assert strip.bar.toolTip() == label
    qtbot.waitUntil(lambda: strip.text.width() > strip.width() // 4)
    live.resize(1280, 800)
    live.refresh()
    assert strip.work.isVisible()
    qtbot.waitUntil(lambda: strip.work.width() <= strip.width() // 4 < strip.text.width() + strip.work.width())


def test_warning_shows_cause_and_remedy(make):
    """A message of the session comes to the strip and stays until it is dismissed."""
    session = RecordedSession(connected(), filled_ring(10.0))
    window = make(session)
    session.change(
        messages=(Message(1, MessageKind.LINK_LOST, "error", "the port is gone", "Plug the board in again."),)
    )
    window.refresh()
    assert window.strip.text.text() == "The port is gone. Plug the board in again."
    assert window.strip.property("level") == "fault"
    window.strip.close_.click()
    assert window.strip.text.text() == ""


def test_silence_that_is_over_is_only_information(make):
    """Data that stopped for a moment and come again leave no warning that waits to be dismissed."""
    session = RecordedSession(connected(), filled_ring(10.0))
    window = make(session)
    session.change(messages=(Message(1, MessageKind.SILENT, "warning", "no data for 1 s", "Check the cable."),))
    window.refresh()
    assert window.strip.text.text() == "No data for 1 s; data resumed."
    assert window.strip.property("level") == "information"


def test_messages_of_a_lost_link_are_dismissed_when_it_returns(make):
    """A message of the lost link is not shown once the link is restored."""
    session = RecordedSession(connected(), filled_ring(10.0))
    window = make(session)
    session.change(
        link=LinkState.SILENT,
        messages=(Message(1, MessageKind.SILENT, "warning", "no data for 1 s", "Check the cable."),),
    )
    window.refresh()
    assert window.strip.text.text() == "No data for 1 s. Check the cable."
    assert "no data" in window.header.link.text()
    session.change(link=LinkState.UP)
    window.refresh()
    assert window.strip.text.text() == ""


def test_history_keeps_every_message(live):
    """A warning is replaced on the strip by the next one, and is still in the list, newest first, with its time."""
    for cause in ("the first cause", "the second cause"):
        live.model.notices.add(Severity.WARNING, cause, "Do something")
    live.model.notices.dismiss_all(Severity.WARNING)
    live.refresh()
    live.strip.messages.click()
    lines = live.strip.details.toPlainText().splitlines()
    assert live.strip.details.isVisible()
    assert ["The second cause" in lines[0], "The first cause" in lines[1]] == [True, True]
    assert lines[0][:8].count(":") == 2
    live.model.notices.inform("a new one")
    live.refresh()
    assert live.strip.details.isVisible()
    live.strip.messages.click()
    assert not live.strip.details.isVisible()


def test_a_remedy_is_never_cut_and_no_button_moves(live):
    """Two clicks missed where a task started or ended; the end of a long message could not be read."""
    strip, long = live.strip, "the regulator does not follow " + "and its valve does not close " * 4
    for width in (853, 1280):
        live.resize(width, 600)
        live.model.notices.add(Severity.WARNING, long, "Check its supply, then clear the fault.", action=("Do", pause))
        live.refresh()
        QApplication.processEvents()
        live.refresh()
        assert strip.text.height() >= strip.text.heightForWidth(strip.text.width())
        places = strip.act.pos().x(), strip.close_.pos().x(), strip.messages.pos().x()
        live.model.jobs.start("long", Job("Waiting", pause, 60), lambda job: None)
        live.refresh()
        QApplication.processEvents()
        assert (strip.act.pos().x(), strip.close_.pos().x(), strip.messages.pos().x()) == places
        strip.cancel_job()
        live.model.notices.dismiss_all(Severity.WARNING)
        live.model.notices.inform("short")
        live.refresh()
        QApplication.processEvents()
        assert strip.messages.pos().x() == places[2]
        assert strip.head.height() <= 40


def test_a_slow_disk_that_recovered_leaves_no_warning(make):
    """A message about the disk stayed after the recording had been closed."""
    session = RecordedSession(connected(), filled_ring(10.0))
    window = make(session)
    slow = Message(1, MessageKind.STORAGE, "warning", "disk is slow", "Use another.")
    session.change(messages=(slow,), recording=Path("a.boat"))
    window.refresh()
    assert "Disk is slow" in window.strip.text.text()
    session.change(recording=None)
    window.refresh()
    assert window.strip.text.text() == ""
    # one that failed was dismissed at once: it was not late yet
    full = Message(2, MessageKind.STORAGE, "error", "the disk is full", "Free disk space.")
    session.change(messages=(slow, full), recording=Path("a.boat"), not_saving="the disk is full")
    window.refresh()
    window.refresh()
    assert "The disk is full" in window.strip.text.text()
    assert window.header.recording.badge.text() == "\u25a0 NOT SAVING"
    session.change(not_saving="")
    window.refresh()
    assert window.strip.text.text() == "The recording is saved again."
